"""Orbits at an event in the unknowns of the sequence on its other side: an impact, or a flight, is put in or left out."""

from __future__ import annotations

import numpy as np

from branches.admissible import force_event
from bvp.contact_sequence import CLOSES, OPENS
from bvp.forced import ForcedProblem
from bvp.kernels.sticking import INTERACTION_LEVEL
from bvp.multipoint import Solution

__all__ = [
    "GRAZES", "at_rest", "exchanged", "in_order", "is_unordered", "later", "resequenced", "with_first_bounce", "with_sticking",
    "with_touch", "without_flight", "without_impact", "without_node",
]  # fmt: skip

_INSTANT, _ROUNDS = 1e-7, 12
"""Part of the period over which an acceleration is a difference of velocities, and updates of the time of a bounce."""

GRAZES = 1e-9
"""Clearance, impact speed and flight, in units of arclength and of the period, that are zero: at a grazing, and of impacts at once."""

_TOGETHER = 1e-10
"""Difference of states, in units of the system, within which images of one state touch together at a grazing that is located to 1e-12."""


def _first_touch(problem: ForcedProblem, solution: Solution) -> tuple[int, float, float]:
    """Flight, time and side of the touch of a grazing orbit. Where images of one state touch together, half periods of the loads apart, it
    is the first one after the slowest impact: which of them is the nearest is rounding."""
    nodes, times, size = problem.nodes(solution.y), problem.flight_times(solution.y), 2 * problem.degrees_of_freedom
    begins, whole = np.append(0.0, np.cumsum(times)[:-1]), float(np.sum(times))
    flight, time, side = int(solution["clearance_flight"]), float(solution["clearance_time"]), float(solution["clearance_side"])
    first, slowest = begins[flight] + time, begins[(int(solution["speed_node"]) + 1) % len(times)]
    found, touch = [((first - slowest) % whole, flight, time, side)], problem.fly(nodes[flight], time, flight)[0]
    sides = problem.modes.contacts.side[problem.modes.contact_stop == int(solution["clearance_stop"])]
    for turns in range(1, 2 * problem.load_periods if problem.load_periods > 1 and problem.has_clock and not problem.half else 1):
        instant, side, touch = (first + 0.5 * turns / problem.load_periods * whole) % whole, -side, -touch
        flight, since = int(np.searchsorted(begins, instant, "right")) - 1, (instant - slowest) % whole
        apart = np.abs(problem.fly(nodes[flight], instant - begins[flight], flight)[0] - touch) / problem.units[:size]
        if side in sides and apart.max() <= _TOGETHER and _INSTANT < since / whole < 1.0 - _INSTANT:  # it is not that impact
            found.append((since, flight, instant - begins[flight], side))
    return min(found)[1:]


def at_rest(problem: ForcedProblem, state: np.ndarray, stop: int) -> np.ndarray:
    """A state without the speed of a gap, which is rounding."""
    n, row = problem.degrees_of_freedom, np.asarray(problem.system.stops[stop].gap)
    return np.append(state[:n], state[n:] - row * (row @ state[n:]) / (row @ row))


def with_touch(problem: ForcedProblem, solution: Solution, *, at_once: bool = False) -> tuple[ForcedProblem, np.ndarray]:
    """The problem in which the touch of a grazing orbit is an impact of no speed, and the orbit in its unknowns. at_once: the touches of
    stops without impacts at the same instant are impacts, too."""
    n, size = problem.degrees_of_freedom, 2 * problem.degrees_of_freedom
    flight, time, side = _first_touch(problem, solution)
    y, nodes, modes, stop = solution.y, problem.nodes(solution.y), problem.modes, int(solution["clearance_stop"])
    state, fraction = problem.fly(nodes[flight], time, flight)
    # The touch is at zero speed: rounding of the place of the extremum must not leave an impact that pulls.
    state = at_rest(problem, state, stop)
    contacts = [int(np.flatnonzero((modes.contact_stop == stop) & (modes.contacts.side == side))[0])]
    if at_once:
        system, scale = problem.parametric.system(problem.parameters(y)), problem.units
        rows = np.array([system.stops[stop].gap for stop in modes.contact_stop])
        away = np.abs(rows @ state[:n] - system.modes.contacts.bound) / scale[0] + (rows @ state[n:] / scale[n]) ** 2
        known = {*contacts, *(event.contact for event in problem.events)}
        contacts += [contact for contact in np.flatnonzero(away <= GRAZES).tolist() if contact not in known]
    letters = [modes.contact_letters[contact] for contact in contacts]
    states, fractions, times = np.tile(state, (len(letters), 1)), np.full(len(letters), fraction), np.zeros(len(letters))
    if not problem.sequence:
        times[-1] = np.sum(problem.flight_times(y))
        return resequenced(problem, letters, states, fractions % 1.0, times, y)
    times[0], place = time, [flight + 1] * len(letters)
    times = np.insert(problem.flight_times(y), [flight] * len(letters), times)
    times[flight + len(letters)] -= time
    states, fractions = np.insert(nodes[:, :size], place, states, axis=0), np.insert(nodes[:, size], place, fractions)
    return resequenced(problem, [*problem.sequence[: flight + 1], *letters, *problem.sequence[flight + 1 :]], states, fractions, times, y)


def without_impact(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray] | None:
    """The problem without the slowest impact, whose speed has vanished, and the orbit in its unknowns; None as for `without_node`."""
    # Node i of the speeds is the impact that ends flight i; the last one is the first of the orbit.
    return without_node(problem, solution.y, (int(solution["speed_node"]) + 1) % len(problem.nodes(solution.y)))


def without_node(problem: ForcedProblem, y: np.ndarray, gone: int) -> tuple[ForcedProblem, np.ndarray] | None:
    """The problem without an impact whose speed has vanished, and the orbit in its unknowns. None where its stop sticks after it, and
    without a clock where no impact is left: the periods of such a motion are those of a linear mode without growth."""
    size, nodes, times = 2 * problem.degrees_of_freedom, problem.nodes(y), problem.flight_times(y).copy()
    if problem.events[gone].sticks or (len(problem.sequence) == 1 and not problem.has_clock):
        return None
    times[gone - 1] += times[gone]
    sequence = [*problem.sequence[:gone], *problem.sequence[gone + 1 :]]
    if not sequence:
        # Without impacts the orbit begins at the phase 0.
        state, _ = problem.fly(nodes[0], (1.0 - nodes[0, size] % 1.0) * problem.period(y))
        return resequenced(problem, sequence, state[None], np.zeros(1), problem.flight_times(y), y)
    states, fractions = np.delete(nodes[:, :size], gone, axis=0), np.delete(nodes[:, size], gone)
    return resequenced(problem, sequence, states, fractions, np.delete(times, gone), y)


def later(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit, begun at its second impact."""
    size = 2 * problem.degrees_of_freedom
    sign, part = problem.closing
    count = int(problem.impacts[1]) if len(problem.impacts) > 1 else len(problem.sequence)
    first = problem.sequence[:count]
    last = map(problem.mirrored, first) if problem.half else first
    nodes = np.roll(problem.nodes(y), -count, axis=0)
    nodes[-count:, :size] *= sign
    nodes[-count:, size] += part
    times = np.roll(problem.flight_times(y), -count)
    return resequenced(problem, [*problem.sequence[count:], *last], nodes[:, :size], nodes[:, size], times, y)


def is_unordered(problem: ForcedProblem, flight: int) -> bool:
    """Whether a flight lies between impacts at two stops that do not act on each other."""
    before = (flight - 1) % (problem.inner + 1)
    acting = problem.rate[flight] * problem.push[before]
    between = min(problem.entries_of_nodes[[before, flight], 0]) >= 0 and before != flight  # a release has no impulse
    return bool(between and abs(np.sum(acting)) <= INTERACTION_LEVEL * np.sum(np.abs(acting)))


def in_order(problem: ForcedProblem, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit with its impacts in order of time, those that do not act on each other and are at one instant in that of their stops.

    To the equations of an orbit this order makes no difference. Where it was another one, the unknowns are near the orbit."""
    instant, count = GRAZES * problem.period(y), len(problem.events)
    for _ in range(count * (count + 1)):
        times, last = problem.flight_times(y), problem.inner
        place = np.maximum(problem.contacts, np.asarray(problem.modes.contact_opposite)[problem.contacts])  # a mirror image has the same
        short = (k for k in range(last + 1) if times[k] <= instant and is_unordered(problem, k))
        flight = next((k for k in short if k == last or times[k] < -instant or place[k - 1] > place[k]), None)
        if flight is None:
            break
        problem, y = later(problem, y) if flight == last else exchanged(problem, y, flight)
    return problem, y


def exchanged(problem: ForcedProblem, y: np.ndarray, flight: int) -> tuple[ForcedProblem, np.ndarray]:
    """The problem in which the impacts around a flight, which do not act on each other, have the other order, and the orbit in its
    unknowns. The flight is short, or negative; it is not the last one."""
    size, nodes, times = 2 * problem.degrees_of_freedom, problem.nodes(y), problem.flight_times(y).copy()
    states, fractions, sequence = nodes[:, :size].copy(), nodes[:, size].copy(), list(problem.sequence)
    short = float(times[flight])
    arrived, _ = problem.fly(nodes[flight - 1], float(times[flight - 1]), (flight - 1) % len(nodes))
    before = np.append(arrived if flight else problem.closing[0] * arrived, nodes[flight, size:])
    # The impacts change velocities in directions at right angles, in M: without the first one the second one is the same.
    change = states[flight + 1] - problem.fly(nodes[flight], short, flight)[0]
    states[flight] = problem.fly(before, short, flight)[0] + change
    states[flight + 1] = problem.fly(nodes[flight + 1], -short, flight)[0]
    for listed in (sequence, fractions):
        listed[flight], listed[flight + 1] = listed[flight + 1], listed[flight]
    np.add.at(times, [flight - 1, flight, flight + 1], [short, -2.0 * short, short])
    return resequenced(problem, sequence, states, fractions, times, y)


def resequenced(
    problem: ForcedProblem, sequence: list[str], states: np.ndarray, fractions: np.ndarray, times: np.ndarray, y: np.ndarray
) -> tuple[ForcedProblem, np.ndarray]:
    """The problem with another sequence, and its unknowns."""
    at = problem.parameters(y)
    made = problem.sibling(sequence, values=at)
    return made, made.pack(states, fractions, [at[name] for name in problem.released], times)


def with_sticking(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray] | None:
    """The problem in which the stop of an impact without rebound, after which there is no contact force, sticks for no time. None where the
    force of a stop that sticks is zero."""
    force = force_event(problem, solution)
    if force is None or force.kind != "after":
        return None
    flight, y = int(solution["clearance_flight"]), solution.y
    nodes, size = problem.nodes(y), 2 * problem.degrees_of_freedom
    letter = problem.modes.contact_letters[problem.events[flight].contact]
    sequence = [*problem.sequence[:flight], letter + CLOSES, letter + OPENS, *problem.sequence[flight + 1 :]]
    twice = np.insert(nodes, flight, nodes[flight], axis=0)
    return resequenced(problem, sequence, twice[:, :size], twice[:, size], np.insert(problem.flight_times(y), flight, 0.0), y)


def with_first_bounce(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray]:
    """The problem in which the first impact of a chatter that is summed is one of its own, and the orbit in its unknowns."""
    flight, y = int(solution["clearance_flight"]), solution.y
    nodes, times, size = problem.nodes(y), problem.flight_times(y), 2 * problem.degrees_of_freedom
    state, fraction = problem.fly(nodes[flight], float(times[flight]), flight)
    node = np.array([*problem.landed(y, flight, state), fraction, *nodes[flight, size + 1 :]])
    row, short, half = problem.rate[flight], _INSTANT * problem.period(y), size // 2
    bounce = -2.0 * short * (row @ node[:size]) / (row @ (problem.fly(node, short, flight)[0] - node[:size]))
    for _ in range(_ROUNDS):  # Newton's method for the mean speed of the gap, which is 0 where it closes again
        ahead = problem.fly(node, bounce, flight)[0]
        mean = row[half:] @ (ahead[:half] - node[:half]) / bounce
        bounce -= mean * bounce / (row @ ahead - mean)
    place, sign = flight + 1, 1.0
    if flight == problem.inner:
        place, sign = 0, problem.closing[0]
        node[size] -= problem.closing[1]
    letter = problem.sequence[place].removesuffix(CLOSES)
    sequence = [*problem.sequence[:place], letter, *problem.sequence[place:]]
    states, fractions = np.insert(nodes[:, :size], place, sign * node[:size], axis=0), np.insert(nodes[:, size], place, node[size])
    made, guess = resequenced(problem, sequence, states, fractions, np.insert(times, place, bounce), y)
    return made, made.solve(guess).y  # at this value of the parameter: near a guess there are orbits on one side of it


def without_flight(problem: ForcedProblem, solution: Solution) -> tuple[ForcedProblem, np.ndarray] | None:
    """The problem without a flight that has no duration, between two events at one stop, of which one is sticking or its end.

    What they do together takes their place: nothing where the stop opens and is hit at once. None where that leaves no impact, since the
    stop sticks for ever, and where bounces do not end."""
    flight, y = int(solution["flight_index"]), solution.y
    if flight == problem.inner or (flight == 0 and problem.events[1].is_release and not problem.events[0].sticks):
        if len(problem.impacts) < 2:
            return None
        flight -= int(problem.impacts[1])
        problem, y = later(problem, y)
        flight %= problem.inner + 1
    first, second = problem.events[flight], problem.events[flight + 1]
    letter = problem.modes.contact_letters[first.contact]
    restitution = problem.restitution(y, first.contact)
    if first.contact != second.contact or (restitution > 0.0 and not first.is_release):
        return None  # of bounces that end without sticking there is no end
    if first.is_release:
        together = [] if second.sticks else [letter + OPENS]
    else:
        together = [letter + CLOSES] if second.sticks else [letter]
    nodes, size = problem.nodes(y), 2 * problem.degrees_of_freedom
    kept = np.r_[0:flight, [flight + 1] * len(together), flight + 2 : len(nodes)].astype(int)
    times = np.delete(problem.flight_times(y), flight)
    if not together:
        # The flight that ended with the release goes on with that after the impact.
        times[flight - 1] += times[flight]
        times = np.delete(times, flight)
    sequence = [*problem.sequence[:flight], *together, *problem.sequence[flight + 2 :]]
    return resequenced(problem, sequence, nodes[kept, :size], nodes[kept, size], times, y)
