"""Switching between families of forced orbits: at a period doubling, a broken symmetry, a branch point, and at a grazing.

At a bifurcation the orbit is written as one of a wider problem: twice its period, or the full period of a half. There its Jacobian has one
direction more, that of the new family. At a grazing the sequence on the other side is constructed: the impact that appears or vanishes is
inserted or removed. Both families are regular there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from branches.first_orbits import across_null_space, first_orbits
from branches.forced.family import ForcedFamily
from bvp.closures import EndsError
from bvp.forced import ForcedProblem
from bvp.multipoint import Solution
from continuation.problem import Step
from continuation.switching import branch_directions

__all__ = ["GrazingNeighbour", "beside_grazing", "exchanged", "full_period", "half_of", "later", "leaving", "twice"]

_SAME = 1e-6
"""Largest change, beside the largest unknown, that makes one symmetric orbit of half a period."""

_SHORT = 1e-3
"""Arclength of the first step away from a grazing."""

_GRAZES = 1e-9
"""Clearance, impact speed and flight, in units of arclength and of the period, that are zero at a located grazing."""

_INSTANT = 1e-6
"""Part of the period within which a touch is at an impact."""

_Change = Callable[[ForcedProblem, Solution], tuple[ForcedProblem, np.ndarray]]
"""Makes the problem with another sequence from a grazing orbit, and the orbit in its unknowns."""


def twice(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit, traversed twice, as a solution of the problem with twice the period."""
    wide = problem.sibling(problem.sequence * 2, load_periods=2 * problem.load_periods)
    return wide, _repeated(problem, wide, y, np.eye(2 * problem.degrees_of_freedom), 0.5)


def full_period(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit whose half period was solved, as a solution of the problem of its full period."""
    modes = problem.modes
    letters = modes.contact_letters
    mirrored = [letters[int(modes.contact_opposite[letters.index(letter)])] for letter in problem.sequence]
    wide = problem.sibling([*problem.sequence, *mirrored], half=False)
    return wide, _repeated(problem, wide, y, -np.eye(2 * problem.degrees_of_freedom), 1.0)


def _repeated(problem: ForcedProblem, wide: ForcedProblem, y: np.ndarray, image: np.ndarray, part: float) -> np.ndarray:
    """The unknowns of the wide problem: those of the narrow one, and their image. part: its period over that of the wide one. Linear in y
    but for a constant."""
    size = 2 * problem.degrees_of_freedom
    if not problem.sequence:
        out = np.array(y)
        wide.flight_times(out)[:] *= 2.0
        return out
    out = np.zeros(wide.unknowns)
    count = problem.inner + 1
    nodes, times = wide.nodes(out), wide.flight_times(out)
    nodes[:count] = nodes[count:] = problem.nodes(y)
    nodes[count:, :size] = nodes[:count, :size] @ image.T
    nodes[:, size] *= part
    nodes[count:, size] += 0.5 * problem.has_clock
    times[:count] = times[count:] = problem.flight_times(y)
    return out


def leaving(problem: ForcedProblem, y: np.ndarray, tangent: np.ndarray, code: str) -> list[tuple[ForcedProblem, Step]]:
    """The first orbits of the family that leaves another one at a bifurcation, with tangents that point away from it.

    Parameters
    ----------
    problem, y : ForcedProblem, (u,) float
        The orbit at the bifurcation.
    tangent : (u,) float
        Along its family.
    code : {"PD", "SB", "BP"}

    Raises
    ------
    RuntimeError
        Where the orbit is at no bifurcation.

    Notes
    -----
    Both sides of a period doubling are one family: each orbit is the other one begun a period later. Those of a broken symmetry are mirror
    images.
    """
    if code == "BP":
        direction = branch_directions(ForcedFamily(problem), y, tangent)[0]
        return [(problem, step) for step in first_orbits(ForcedFamily(problem), y, direction)]
    wide, repeated = (twice if code == "PD" else full_period)(problem, y)
    embed = twice if code == "PD" else full_period
    known = embed(problem, y + 1e-6 * tangent)[1] - embed(problem, y - 1e-6 * tangent)[1]
    direction = across_null_space(wide, repeated, known, code)
    steps = list(first_orbits(ForcedFamily(wide), repeated, direction))
    return [(wide, step) for step in (steps[:1] if code == "PD" else steps)]


class GrazingNeighbour(NamedTuple):
    """The family on the other side of a grazing.

    Attributes
    ----------
    problem : ForcedProblem
    step : Step
        Its first orbit, with its tangent pointing away from the grazing.
    persists : bool
        Whether it exists on the other side of the parameter than the family that ends: the motion persists. Else both are on one side: a
        nonsmooth fold.
    """

    problem: ForcedProblem
    step: Step
    persists: bool


def beside_grazing(problem: ForcedProblem, solution: Solution, inwards: np.ndarray) -> list[GrazingNeighbour]:
    """The families that meet another one at a grazing orbit.

    Parameters
    ----------
    problem : ForcedProblem
    solution : Solution
        The grazing orbit.
    inwards : (u,) float
        A direction along the family that ends, away from the grazing.
    """
    found = _across(problem, solution, inwards)
    if problem.half:
        # Of a symmetric pair one impact alone can appear or vanish, too: the symmetry breaks there.
        wide, repeated = full_period(problem, solution.y)
        whole = wide.step(repeated, np.zeros(2 * wide.unknowns), 0.0)
        others = [] if whole is None else _across(wide, whole, inwards)
        return found + [one for one in others if len(one.problem.sequence) % 2]
    symmetric = half_of(problem, solution.y)
    return found if symmetric is None else found + _across(*symmetric, inwards)


def _across(problem: ForcedProblem, solution: Solution, inwards: np.ndarray) -> list[GrazingNeighbour]:
    """The families behind a grazing, in which one impact of the solved segment appears, vanishes or changes its place."""
    found = []
    at = 2 * problem.degrees_of_freedom + 1
    side = np.sign(inwards[at])
    for make in _changes(problem, solution):
        neighbour, start = make(problem, solution)
        family = ForcedFamily(neighbour)
        begin = family.begin(start)
        for sign in (1.0, -1.0) if begin.converged else ():
            turned = family.step(begin.y, sign * begin.tangent, 0.0)
            step = family.step(turned.y, turned.tangent, _SHORT)
            if step.converged and all(step.extra[name] > 0.0 for name in ("clearance", "speed", "flight")):
                found.append(GrazingNeighbour(neighbour, step, bool(np.sign(step.y[at] - solution.y[at]) != side)))
    return found


def _changes(problem: ForcedProblem, solution: Solution) -> list[_Change]:
    """The changes of the sequence at a grazing: of what is zero to rounding, else the one that is nearest to it."""
    # A single impact that vanishes is the largest one of its orbit, too: the units are those of arclength.
    reach, fast = problem.segment.scale[0], problem.segment.scale[problem.degrees_of_freedom]
    sizes: dict[_Change, float] = {
        _with_touch: abs(solution["clearance"] / reach),
        _without: abs(solution["speed"] / fast),
        exchanged: abs(solution["flight"] / problem.duration(solution)),
    }
    limit = max(_GRAZES, min(sizes.values()))
    if sizes[_without] <= limit and _is_at_slowest_impact(problem, solution):
        del sizes[_with_touch]
    if sizes[_without] <= limit:
        del sizes[exchanged]  # the impact that vanishes has met another one
    return [make for make, size in sizes.items() if size <= limit]


def _is_at_slowest_impact(problem: ForcedProblem, solution: Solution) -> bool:
    """Whether the closest touch is the turning point at the slowest impact."""
    flight, slowest = int(solution["clearance_flight"]), int(solution["speed_node"])
    time, whole = float(solution["clearance_time"]), problem.duration(solution)
    times = problem.flight_times(solution.y)
    before = flight == slowest and abs(times[flight] - time) < _INSTANT * whole
    return bool(before or (flight == (slowest + 1) % len(times) and time < _INSTANT * whole))


def half_of(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, Solution] | None:
    """A symmetric orbit as one of half its period; None where the orbit is not symmetric. Impacts appear and vanish there in pairs."""
    count, odd = divmod(len(problem.sequence), 2)
    if odd:
        return None
    try:
        half = ForcedProblem(
            problem.parametric,
            problem.sequence[:count],
            problem.released,
            load_periods=problem.load_periods,
            half=True,
            values=problem.parameters(y),
            keep=problem.keep,
        )
    except EndsError:
        return None
    nodes, size = problem.nodes(y)[: max(count, 1)], 2 * problem.degrees_of_freedom
    begun = half.pack(nodes[:, :size], nodes[:, size], nodes[0, size + 1 :])
    if count and problem.sequence != full_period(half, begun)[0].sequence:
        return None
    solution = half.step(begun, np.zeros(2 * half.unknowns), 0.0)
    return None if solution is None or np.abs(solution.y - begun).max() > _SAME * np.abs(begun).max() else (half, solution)


def _with_touch(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray]:
    """The problem in which the touch of a grazing orbit is an impact of no speed, and the orbit in its unknowns."""
    n, size = problem.degrees_of_freedom, 2 * problem.degrees_of_freedom
    flight, time = int(solution["clearance_flight"]), float(solution["clearance_time"])
    side = solution["clearance_side"]
    modes = problem.modes
    contact = next(
        c
        for c in range(len(modes.contact_stop))
        if modes.contact_stop[c] == int(solution["clearance_stop"]) and modes.contacts.side[c] == side
    )
    y = solution.y
    nodes = problem.nodes(y)
    state, fraction = problem.fly(nodes[flight], time)
    # The touch is at zero speed: rounding of the place of the extremum must not leave an impact that pulls.
    row = np.asarray(problem.system.stops[int(solution["clearance_stop"])].gap)
    state[n:] -= row * (row @ state[n:]) / (row @ row)
    letter = modes.contact_letters[contact]
    if not problem.sequence:
        return _made(problem, [letter], state[None], np.array([fraction % 1.0]), problem.flight_times(y), y)
    sequence = [*problem.sequence[: flight + 1], letter, *problem.sequence[flight + 1 :]]
    times = np.insert(problem.flight_times(y), flight, time)
    times[flight + 1] -= time
    states, fractions = np.insert(nodes[:, :size], flight + 1, state, axis=0), np.insert(nodes[:, size], flight + 1, fraction)
    return _made(problem, sequence, states, fractions, times, y)


def _without(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray]:
    """The problem without the impact whose speed has vanished, and the orbit in its unknowns."""
    size, y = 2 * problem.degrees_of_freedom, solution.y
    nodes, times = problem.nodes(y), problem.flight_times(y).copy()
    # Node i of the speeds is the impact that ends flight i; the last one is the first of the orbit.
    gone = (int(solution["speed_node"]) + 1) % len(nodes)
    times[gone - 1] += times[gone]
    sequence = [*problem.sequence[:gone], *problem.sequence[gone + 1 :]]
    if not sequence:
        # Without impacts the orbit begins at the phase 0.
        state, _ = problem.fly(nodes[0], (1.0 - nodes[0, size] % 1.0) * problem.period(y))
        return _made(problem, sequence, state[None], np.zeros(1), problem.flight_times(y), y)
    states, fractions = np.delete(nodes[:, :size], gone, axis=0), np.delete(nodes[:, size], gone)
    return _made(problem, sequence, states, fractions, np.delete(times, gone), y)


def later(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit, begun at its second impact."""
    size, modes = 2 * problem.degrees_of_freedom, problem.modes
    sign, part = problem.segment.closing
    letters = modes.contact_letters
    first = problem.sequence[0]
    last = letters[int(modes.contact_opposite[letters.index(first)])] if problem.half else first
    nodes = np.roll(problem.nodes(y), -1, axis=0)
    nodes[-1, :size] *= sign
    nodes[-1, size] += part
    times = np.roll(problem.flight_times(y), -1)
    return _made(problem, [*problem.sequence[1:], last], nodes[:, :size], nodes[:, size], times, y)


def exchanged(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray]:
    """The problem in which two impacts at the same instant, at stops that do not interact, have the other order, and the orbit in its
    unknowns."""
    flight, y = int(solution["flight_index"]), solution.y
    if flight == problem.inner:
        problem, y = later(problem, y)
        flight -= 1
    size = 2 * problem.degrees_of_freedom
    nodes = problem.nodes(y)
    states = nodes[:, :size].copy()
    # The impacts change velocities in directions at right angles, in M: the second one taken back from the state after both, the first one
    # kept.
    states[flight] += states[flight + 1] - states[flight] - (states[flight] - _before(problem, y, flight))
    sequence = list(problem.sequence)
    sequence[flight], sequence[flight + 1] = sequence[flight + 1], sequence[flight]
    return _made(problem, sequence, states, nodes[:, size], problem.flight_times(y), y)


def _before(problem: ForcedProblem, y: np.ndarray, node: int) -> np.ndarray:
    """The state before the impact of a node."""
    size = 2 * problem.degrees_of_freedom
    nodes, times = problem.nodes(y), problem.flight_times(y)
    state, _ = problem.fly(nodes[node - 1], float(times[node - 1]))
    return state * problem.segment.closing[0] if node == 0 else state[:size]


def _made(
    problem: ForcedProblem, sequence: list[str], states: np.ndarray, fractions: np.ndarray, times: np.ndarray, y: np.ndarray
) -> tuple[ForcedProblem, np.ndarray]:
    """The problem with another sequence, and its unknowns."""
    at = problem.parameters(y)
    made = problem.sibling(sequence, values=at)
    return made, made.pack(states, fractions, [at[name] for name in problem.released], times)
