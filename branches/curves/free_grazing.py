"""The conditions of grazings of free orbits: an impact without speed, inside the solved segment or at one of its ends, and a flight without
duration.

A touch is an impact without speed of the sequence with that impact: inside the segment, or as a stop end in place of an end at rest.
"""

from __future__ import annotations

import math

import numpy as np

from branches.curves.grazing import Grazing, _flown
from branches.curves.plane import ParameterPlane
from branches.grazing.touching import candidate, touching
from branches.released.presentation import released_orbit
from bvp.multipoint import MultipointProblem, Solution
from bvp.released import ReleasedProblem
from continuation.curves import Linearised, ScalarCondition

__all__ = ["Grazing", "approach_speeds", "beside_grazing", "free_grazing_at", "free_grazing_condition"]

_ZERO = 1e-9
"""Clearance, speed and flight time, in units of arclength and of the segment, that are zero at a located grazing."""

_NEXT = 1e-4
"""Part of the segment beside a touch in which no other one is looked for."""


def approach_speeds(problem: ReleasedProblem, y: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nodes that are impacts, and the speeds of approach there. Node i ends flight i; node k + 1 is a stop at the start."""
    segment, n, k = problem.segment, problem.degrees_of_freedom, problem.inner
    nodes = np.array([i for i in range(k + 2) if problem.contacts[i] >= 0 and not (i == k + 1 and problem.structure.periodic)], dtype=int)
    velocities = [-y[n : 2 * n] if i == k + 1 else ends[i, n : 2 * n] for i in nodes]
    speeds = [float(segment.side[i] * (segment.gap[i, :n] @ v)) for i, v in zip(nodes, velocities, strict=True)]
    return nodes, np.array(speeds)


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
    n, scale = problem.degrees_of_freedom, problem.segment.scale
    sizes = {
        "clearance": abs(solution["clearance"]) / scale[0],
        "speed": abs(solution["speed"]) / scale[n],
        "flight": abs(solution["flight"]) / float(np.sum(problem.flight_times(y))),
    }
    # The gap turns where an impact has no speed, and an impact that vanishes can meet another one: the speed comes first.
    limit = max(_ZERO, min(sizes.values()))
    least = next(name for name in ("speed", "clearance", "flight") if sizes[name] <= limit)
    if least == "flight":
        return problem, y, Grazing("flight", int(solution["flight_index"]))
    plain, at = problem.orbit_problem(y)
    orbit = touching(plain, at)
    every = (1 << len(orbit.times)) - 1
    if least == "speed" and orbit.kept == every:
        return problem, y, Grazing("speed", int(solution["speed_node"]))
    # With all its touches as impacts the orbit has all its symmetries, and no image of the touch is another grazing.
    choice = candidate(orbit, every)
    other = MultipointProblem(plain.system, choice.ends, choice.sequence)
    made, start = released_orbit(problem, problem.parameters(y), other, other.pack(choice.start, choice.nodes, choice.times))
    made.residual(start)
    nodes, speeds = approach_speeds(made, start, made._factor.before)
    slowest = int(np.argmin(np.abs(speeds)))
    if abs(speeds[slowest]) > 1e-6 * scale[n]:
        raise ValueError("the impact at the touch was not found; expected another event")
    return made, start, Grazing("speed", int(nodes[slowest]))


def free_grazing_condition(plane: ParameterPlane, grazing: Grazing) -> ScalarCondition:
    """The condition of a grazing."""
    problem, flight = plane.problem, grazing.flight
    width, n, k = problem.size, problem.degrees_of_freedom, problem.inner
    at = flight * (width + 1)

    def row() -> np.ndarray:
        found: np.ndarray = problem.segment.side[flight] * problem.segment.gap[flight, :n]
        return found

    def speed(point: Linearised) -> tuple[float, np.ndarray]:
        gap, gradient = row(), np.zeros(plane.size)
        out, jacobian, rate = _flown(problem, point.y[at : at + width], point.y[at + width], flight)
        gradient[at : at + width] = gap @ jacobian[n : 2 * n]
        gradient[at + width] = gap @ rate[n : 2 * n]
        return float(gap @ out[n : 2 * n]), gradient

    def speed_at_start(point: Linearised) -> tuple[float, np.ndarray]:
        gradient = np.zeros(plane.size)
        gradient[n : 2 * n] = -row()
        return float(gradient[n : 2 * n] @ point.y[n : 2 * n]), gradient

    def duration(point: Linearised) -> tuple[float, np.ndarray]:
        gradient = np.zeros(plane.size)
        gradient[at + width] = 1.0
        return float(point.y[at + width]), gradient

    if grazing.kind == "flight":
        return ScalarCondition(duration)
    return ScalarCondition(speed_at_start if flight == k + 1 else speed)


def beside_grazing(problem: ReleasedProblem, y: np.ndarray, ends: np.ndarray, grazing: Grazing) -> tuple[np.ndarray, np.ndarray, float]:
    """The orbit without the neighbourhood of its touch: unknowns, and states after the flights; and the acceleration of the gap there, away
    from the stop."""
    shown, shown_ends = np.array(y), ends.copy()
    times, nodes = problem.flight_times(shown), problem.nodes(shown)
    if grazing.kind == "flight":
        times[grazing.flight] = 0.0
        return shown, shown_ends, 1.0
    n, i, k = problem.degrees_of_freedom, grazing.flight, problem.inner
    row = problem.segment.side[i] * problem.segment.gap[i, :n]
    short = _NEXT * float(np.sum(times))
    bend = math.nan
    if i <= k:
        bend = -float(row @ _flown(problem, nodes[i], times[i], i)[2][n : 2 * n])
        shown_ends[i] = _flown(problem, nodes[i], times[i] - short, i)[0]
        times[i] -= short
    after = 0 if i > k or (i == k and problem.structure.periodic) else i + 1
    if after <= k:
        if i > k:
            bend = -float(row @ _flown(problem, nodes[0], 0.0, 0)[2][n : 2 * n])
        nodes[after] = _flown(problem, nodes[after], short, after)[0]
        times[after] -= short
    return shown, shown_ends, bend
