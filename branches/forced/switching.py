"""Switching between families of forced orbits: at a period doubling, a broken symmetry, a branch point, and at a grazing.

At a bifurcation the orbit is written as one of a wider problem: twice its period, or the full period of a half. There its Jacobian has one
direction more, that of the new family. At a grazing the sequence on the other side is constructed: the impact that appears or vanishes is
inserted or removed. Both families are regular there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain, combinations, islice
from typing import Any, NamedTuple

import numpy as np

from branches.admissible import INSTANT, force_event
from branches.first_orbits import across_null_space, first_orbits
from branches.forced import resequencing as change
from branches.forced.closing import vanishes, without_moment
from branches.forced.family import ForcedFamily
from branches.forced.primitive import full_period, half_of, kind_of, primitive_orbit, twice
from branches.solved_family import begun_along
from bvp.closures import EndsError
from bvp.contact_sequence import CLOSES, OPENS
from bvp.forced import ForcedProblem
from bvp.multipoint import NotConverged, Solution
from continuation.problem import Step
from continuation.switching import branch_directions

__all__ = ["GrazingNeighbour", "beside_grazing", "beside_moment", "emanating_orbits"]

_SHORT = (1e-3, 1e-4, 1e-5)
"""Arclengths of the first step away from a grazing: the first one that leads to an orbit. Another event can be near."""

_BEYOND = (1e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Arclengths beyond a grazing at which an orbit is sought whose stop opens for a moment."""

_MOST = 63
"""Choices of impacts at one grazing that are tried: all of six."""

_SAMPLES = 401
"""Instants of a flight between which the contact force is compared."""

_Change = Callable[..., Any]
"""Makes the problem with another sequence from a grazing orbit, and the orbit in its unknowns; None where there is none."""


def emanating_orbits(problem: ForcedProblem, y: np.ndarray, tangent: np.ndarray, code: str) -> list[tuple[ForcedProblem, Step]]:
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
        return [_primitive(problem, step) for step in first_orbits(ForcedFamily(problem), y, direction, at_an_angle=True)]
    embed = twice if code == "PD" else full_period
    wide, repeated = embed(problem, y)
    known = embed(problem, y + 1e-6 * tangent)[1] - embed(problem, y - 1e-6 * tangent)[1]
    steps = list(first_orbits(ForcedFamily(wide), repeated, across_null_space(wide, repeated, known, code)))
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
        ahead = full_period(problem, solution.y + inwards)[1] - repeated
        symmetric, others = found, [] if whole is None else _across(wide, whole, ahead)
    else:
        half = half_of(problem, solution.y)
        if half is None:
            return found
        symmetric, others = _across(*half, np.append(inwards[: half[0].place], inwards[problem.place :])), found
    return symmetric + [one for one in others if one.problem.sequence and not one.problem.half]


def _across(problem: ForcedProblem, solution: Solution, inwards: np.ndarray) -> list[GrazingNeighbour]:
    """The families behind a grazing, in which one impact of the solved segment appears, vanishes or changes its place."""
    found, at = list[GrazingNeighbour](), problem.place
    side = np.sign(inwards[at])
    for make in _changes(problem, solution):
        if make is change.with_sticking:
            opened = _opening_again(problem, solution, inwards)
            if opened is not None:
                found.append(GrazingNeighbour(*opened, bool(np.sign(opened[1].parameter - solution.y[at]) != side)))
                continue
        if make is change.exchanged:
            # Beyond the orbit the family goes on, with the impacts in another order.
            node = problem.size + 1
            units = np.array([problem.units[problem.size], *problem.units[: problem.size]])
            ahead = -inwards / np.linalg.norm(inwards[:node] / units)
            found += _beside(problem, solution.y, np.pad(ahead, (0, len(ahead))), side)
            continue
        try:
            others = list(make(problem, solution)) if make is _other_choices else [make(problem, solution)]
        except (EndsError, NotConverged):
            continue  # the impact that appears pulls a stop open which sticks, or no bounce can be apart
        for made in others:
            # The orbits of a sequence with the first bounce apart are the same ones on this side.
            beside = [] if made is None else _both_sides(made[0], made[1], side)
            found += [one for one in beside if one.persists or make is not change.with_first_bounce]
    return [*{(kind_of(one.problem), one.persists): one for one in found[::-1]}.values()][::-1]  # of two mirror images the first one


def _slow(problem: ForcedProblem, y: np.ndarray, limit: float = change.GRAZES) -> dict[int, int]:
    """The contacts with an impact without speed, and the node of it, the first one of each."""
    speeds = problem.impact_speeds(y) / problem.units[problem.degrees_of_freedom]
    nodes = [k for k, speed in enumerate(speeds) if abs(speed) <= limit and not problem.events[k].is_release]
    return {problem.events[k].contact: k for k in reversed(nodes)}


def _other_choices(problem: ForcedProblem, solution: Solution) -> Iterator[tuple[ForcedProblem, np.ndarray] | None]:
    """The problems with another choice of the impacts without speed, one of each contact, and the orbit in their unknowns.

    Parts that do not interact can touch their stops together, and their impacts can vanish together. Each choice of these impacts is that
    of a family. Those with the fewest changes come first."""
    reach, fast = problem.units[0], problem.units[problem.degrees_of_freedom]
    limit = max(change.GRAZES, min(abs(solution["clearance"] / reach), abs(solution["speed"] / fast)))
    y, before = solution.y, set(_slow(problem, solution.y, limit))
    rest: Solution | None = solution
    while rest is not None and abs(rest["clearance"]) <= limit * reach and rest["clearance_side"] != 0.0 and not force_event(problem, rest):
        if rest["clearance_stop"] in [problem.modes.contact_stop[contact] for contact in _slow(problem, y, limit)]:
            if rest is solution and not _is_at_slowest_impact(problem, rest):
                yield change.with_touch(problem, rest)
            break
        problem, y = change.with_touch(problem, rest, at_once=True)
        rest = problem.step(y, np.zeros(2 * problem.unknowns), 0.0)
    problem, y = change.in_order(problem, y)
    slow = _slow(problem, y, limit)
    for changed in islice(chain.from_iterable(combinations(sorted(slow), count) for count in range(1, len(slow) + 1)), _MOST):
        made: tuple[ForcedProblem, np.ndarray] | None = (problem, y)
        for node in sorted((slow[contact] for contact in before.symmetric_difference(slow).symmetric_difference(changed)), reverse=True):
            made = made and change.without_node(*made, node)
        yield made


def _both_sides(problem: ForcedProblem, start: np.ndarray, side: float) -> list[GrazingNeighbour]:
    """The orbits next to a grazing one in its family, where they are orbits. side: where the other family has its parameter."""
    family = ForcedFamily(problem)
    begin = family.begin(start)
    turned = [family.step(begin.y, sign * begin.tangent, 0.0) for sign in (1.0, -1.0) if begin.converged]
    return [found for step in turned for found in _beside(problem, step.y, step.tangent, side)]


def _beside(problem: ForcedProblem, start: np.ndarray, tangent: np.ndarray, side: float) -> list[GrazingNeighbour]:
    """The first orbit beside a grazing one along a tangent, with its impacts in their order there, if it is an orbit."""
    at = problem.place
    for length in _SHORT:
        step = ForcedFamily(problem).step(start, tangent, length)
        if step.converged:
            ordered, y = change.in_order(problem, step.y)
            if ordered is not problem:  # another order can begin with another impact: its parameter has the same tangent
                step = begun_along(ForcedFamily(ordered), y, step.tangent[[at]], np.ones(1), np.array([ordered.place]))
            if _is_inside(step):
                return [GrazingNeighbour(*_primitive(ordered, step), bool(np.sign(step.y[at] - start[at]) != side))]
    return []


def _is_inside(step: Step) -> bool:
    """Whether a step leads to an orbit, at no grazing."""
    return step.converged and all(step.extra[name] > 0.0 for name in ("clearance", "speed", "flight"))


def beside_moment(problem: ForcedProblem, y: np.ndarray, inwards: np.ndarray) -> list[GrazingNeighbour] | None:
    """The families that meet another one where a stop opens no more, or bounces no more before it sticks. None for another orbit.

    Parameters
    ----------
    problem, y : ForcedProblem, (u,) float
        The orbit there: see `branches.forced.closing`.
    inwards : (u,) float
        A direction along its family, away from the end.
    """
    if not vanishes(problem, y):
        return None
    made = without_moment(problem, y)
    return [] if made is None else _both_sides(*made[:2], np.sign(inwards[problem.place]))


def _primitive(problem: ForcedProblem, step: Step) -> tuple[ForcedProblem, Step]:
    """An orbit with its tangent; the orbit that it repeats, if it does, and over half the period if it is symmetric."""
    primitive, y = primitive_orbit(problem, step.y)
    if primitive is problem:
        return problem, step
    # Both begin with the same state, and have the same parameter.
    here, there = ([*range(one.size + 1), one.place] for one in (problem, primitive))
    begin = begun_along(ForcedFamily(primitive), y, step.tangent[here], np.ones(len(here)), np.array(there))
    return (primitive, begin) if begin.converged else (problem, step)


def _changes(problem: ForcedProblem, solution: Solution) -> list[_Change]:
    """The changes of the sequence at a grazing: of what is zero to rounding, else the one that is nearest to it."""
    # A single impact that vanishes is the largest one of its orbit, too: the units are those of arclength.
    reach, fast = problem.units[0], problem.units[problem.degrees_of_freedom]
    touch, speed = abs(solution["clearance"] / reach), abs(solution["speed"] / fast)
    flight = abs(solution["flight"] / problem.duration(solution))
    if any(event.closed for event in problem.events) and flight < INSTANT:
        # The contact force, and the speed of a stop that opens for a moment, vanish faster than the time between two events.
        return [change.without_flight]
    limit = max(change.GRAZES, min(touch, speed, flight))
    if touch <= limit and solution["clearance_side"] == 0.0:
        return [change.with_first_bounce] if solution["clearance_time"] > 0.0 else []
    if touch <= limit and force_event(problem, solution) is not None:
        return [change.with_sticking]
    found: list[_Change] = [_other_choices] if min(touch, speed) <= limit else []
    return found if flight > limit or speed <= limit else [*found, change.exchanged]  # an impact that vanishes can meet another one


def _is_at_slowest_impact(problem: ForcedProblem, solution: Solution) -> bool:
    """Whether the closest touch is the turning point at the slowest impact."""
    flight, slowest, times = int(solution["clearance_flight"]), int(solution["speed_node"]), problem.flight_times(solution.y)
    ends = (slowest, times[flight] - solution["clearance_time"]), ((slowest + 1) % len(times), solution["clearance_time"])
    return any(at == flight and time < INSTANT * problem.duration(solution) for at, time in ends)


def _opening_again(problem: ForcedProblem, solution: Solution, inwards: np.ndarray) -> tuple[ForcedProblem, Step] | None:
    """The family in which a stop opens for a moment while it sticks, beyond an orbit at which its contact force touches zero.

    It is hit again after a flight that begins without duration. There its equations are singular: gap, speed and time vanish together. So
    the family is entered a little way off, from the first terms of the flight. With the force g = g'' ((t - s)^2 - d^2)/2 the stop opens at
    s - d and is hit at s + 3 d. If it would open at its impact, with g = g_0 + g' t, it is hit after 3 |g_0|/g'. The result is
    its first orbit, whose tangent points away from the event.
    """
    flight, stop = int(solution["clearance_flight"]), int(solution["clearance_stop"])
    force = force_event(problem, solution)
    if force is None or force.kind == "after":
        return None
    contact = next(c for c in problem.events[flight].closed if problem.modes.contact_stop[c] == stop)
    if force.kind == "begin" and problem.restitution(solution.y, contact) > 0.0:
        return None  # the bounces do not end
    letter = problem.modes.contact_letters[contact]
    tangent = solution.tangent.copy()
    if tangent[: problem.unknowns] @ inwards > 0.0:
        for odd in (tangent[: problem.unknowns], tangent[2 * problem.unknowns :]):
            odd *= -1.0
    at_begin = float(solution["clearance_time"]) == 0.0 and problem.events[flight].contact == contact
    for length in _BEYOND:
        beyond = problem.step(solution.y, tangent, length)
        if beyond is None:
            break
        y = beyond.y
        opened = _moments(problem, y, flight, contact)
        if opened is None:
            continue
        start, end = opened
        places = [3.0 * end] if at_begin else [start, 2.0 * end - start]
        times, nodes = problem.flight_times(y), problem.nodes(y)
        if not places[-1] < times[flight]:
            continue
        symbols = [letter, letter + CLOSES] if at_begin else [problem.sequence[flight], letter + OPENS, letter + CLOSES]
        sequence = [*problem.sequence[:flight], *symbols, *problem.sequence[flight + 1 :]]
        size = 2 * problem.degrees_of_freedom
        inserted = [problem.fly(nodes[flight], place, flight) for place in places]
        states = np.insert(nodes[:, :size], flight + 1, [state for state, _ in inserted], axis=0)
        fractions = np.insert(nodes[:, size], flight + 1, [fraction for _, fraction in inserted])
        lasting = np.concatenate([times[:flight], np.diff([0.0, *places, times[flight]]), times[flight + 1 :]])
        wide, guess = change.resequenced(problem, sequence, states, fractions, lasting, y)
        found = _first_opened(wide, guess, flight if at_begin else flight + 1)
        if found is not None:
            return wide, found
    return None


def _moments(problem: ForcedProblem, y: np.ndarray, flight: int, contact: int) -> tuple[float, float] | None:
    """Times in a flight between which the force of a contact pulls; None where it does not."""
    node, duration = problem.nodes(y)[flight], float(problem.flight_times(y)[flight])
    times = np.linspace(0.0, duration, _SAMPLES)[:-1]
    rest = node[2 * problem.degrees_of_freedom + 1 :]
    places = (np.hstack([*problem.fly(node, time, flight), rest]) for time in times.tolist())
    forces = np.array([problem.contact_force(place, flight, contact) for place in places])
    pulls = np.flatnonzero(forces < 0.0)
    if not len(pulls) or pulls[-1] + 1 >= len(times):
        return None

    def zero(i: int) -> float:
        return float(times[i] - forces[i] * (times[i + 1] - times[i]) / (forces[i + 1] - forces[i]))

    return zero(int(pulls[0]) - 1) if pulls[0] else 0.0, zero(int(pulls[-1]))


def _first_opened(problem: ForcedProblem, guess: np.ndarray, flight: int) -> Step | None:
    """The orbit near a guess, with its tangent turned so that a flight grows; None where it is none."""
    try:
        y = problem.solve(guess).y
    except NotConverged:
        return None
    ahead, width = np.zeros(problem.unknowns), problem.size + 1
    ahead[(flight + 1) % (problem.inner + 1) * width] += 1.0  # the flight lasts longer
    if problem.has_clock:
        ahead[flight * width] -= 1.0
    else:
        ahead = np.zeros(problem.unknowns)
        ahead[flight * width] = 1.0
    step = begun_along(ForcedFamily(problem), y, ahead, np.ones(problem.unknowns))
    return step if _is_inside(step) else None
