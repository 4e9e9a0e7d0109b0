"""Where a curve of grazings of free orbits starts.

A touch is an impact without speed of the sequence with that impact: inside the segment, or as a stop end in place of an end at rest.
"""

from __future__ import annotations

import numpy as np

from branches.curves.grazing import Grazing, grazing_sizes, what_grazes
from branches.grazing.touching import candidate, touching
from branches.released.presentation import released_orbit
from bvp.multipoint import MultipointProblem, Solution
from bvp.released import ReleasedProblem

__all__ = ["approach_speeds", "are_at", "free_grazing_at", "impact_places", "touch_as_impact"]

_SLOW = 1e-6
"""Speed of an impact, in units of arclength, that is zero at a located grazing."""


def approach_speeds(problem: ReleasedProblem, y: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nodes that are impacts, and the speeds of approach there. Node i ends flight i; node k + 1 is a stop at the start."""
    n, k = problem.degrees_of_freedom, problem.inner
    nodes = np.array([i for i in range(k + 2) if problem.contacts[i] >= 0 and not (i == k + 1 and problem.structure.periodic)], dtype=int)
    velocities = [-problem.states(y)[0, n:] if i == k + 1 else ends[i, n:] for i in nodes]
    speeds = [float(problem.side[i] * (problem.gap[i, :n] @ v)) for i, v in zip(nodes, velocities, strict=True)]
    return nodes, np.array(speeds)


def impact_places(problem: ReleasedProblem, y: np.ndarray, ends: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """The displacements (p, n) at nodes of `approach_speeds`."""
    n, k = problem.degrees_of_freedom, problem.inner
    return np.array([problem.states(y)[0, :n] if i > k else ends[i, :n] for i in nodes.tolist()]).reshape(-1, n)


def free_grazing_at(problem: ReleasedProblem, y: np.ndarray, solution: Solution) -> tuple[ReleasedProblem, np.ndarray, Grazing]:
    """The problem in which a grazing orbit is continued, its unknowns, and what grazes there.

    Parameters
    ----------
    problem, y : ReleasedProblem, (u,) float
    solution : Solution
        The orbit, with its clearance, slowest impact and shortest flight.

    Raises
    ------
    ValueError
        For a grazing that cannot be continued.
    """
    least = what_grazes(grazing_sizes(problem, solution))
    if least == "flight":
        return problem, y, Grazing("flight", int(solution["flight_index"]))
    if least == "speed":
        orbit = touching(*problem.orbit_problem(y))
        if orbit.kept == (1 << len(orbit.times)) - 1:
            return problem, y, Grazing("speed", int(solution["speed_node"]))
    return touch_as_impact(problem, y)


def touch_as_impact(
    problem: ReleasedProblem, y: np.ndarray, besides: np.ndarray | None = None
) -> tuple[ReleasedProblem, np.ndarray, Grazing]:
    """The same of an orbit that touches a stop. besides: the displacements (n,) at another touch of the orbit, which is not meant."""
    plain, at = problem.orbit_problem(y)
    orbit = touching(plain, at)
    # With all its touches as impacts the orbit has all its symmetries, and no image of the touch is another grazing.
    choice = candidate(orbit, (1 << len(orbit.times)) - 1)
    other = MultipointProblem(plain.system, choice.ends, choice.sequence)
    made, start = released_orbit(problem, problem.parameters(y), other, other.pack(choice.start, choice.nodes, choice.times))
    n, before = problem.degrees_of_freedom, made.end_states(start)
    nodes, speeds = approach_speeds(made, start, before)
    if besides is not None:
        apart = ~are_at(impact_places(made, start, before, nodes), besides, made.structure.periodic)
        nodes, speeds = nodes[apart], speeds[apart]
    slowest = int(np.argmin(np.abs(speeds))) if len(speeds) else -1
    if slowest < 0 or abs(speeds[slowest]) > _SLOW * problem.units[n]:
        raise ValueError("the impact at the touch was not found; expected another event")
    return made, start, Grazing("speed", int(nodes[slowest]))


def are_at(places: np.ndarray, place: np.ndarray, mirrored: bool) -> np.ndarray:
    """Which displacements (p, n) are those of another instant (n,), or their mirror image. Two instants of a segment between two reversals
    are no images of each other."""
    limit = _SLOW * float(np.max(np.abs(place)))
    found: np.ndarray = np.abs(places - place).max(axis=1, initial=0.0) <= limit
    return found | (np.abs(places + place).max(axis=1, initial=0.0) <= limit) if mirrored else found
