"""Stops that open for a moment: where a contact force touches zero, the sticking phase splits in two.

The stop opens and is hit again after a flight that begins without duration. There its equations are singular: gap, speed and time vanish
together. So the new family is entered a little way off, from the first terms of the flight. With the force g = g'' ((t - s)^2 - d^2)/2 the
stop opens at s - d and is hit at s + 3 d. If it would open at its impact, with g = g_0 + g' t, it is hit after 3 |g_0|/g'.
"""

from __future__ import annotations

import numpy as np

from branches.admissible import force_event
from branches.forced.family import ForcedFamily
from bvp.contact_sequence import CLOSES, OPENS
from bvp.forced import ForcedProblem
from bvp.multipoint import NotConverged, Solution
from continuation.problem import Step

__all__ = ["opening_again"]

_STEPS = (1e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Arclengths beyond the event at which the new orbit is sought."""

_SAMPLES = 401


def opening_again(problem: ForcedProblem, solution: Solution, inwards: np.ndarray) -> tuple[ForcedProblem, Step] | None:
    """The family in which a stop opens for a moment while it sticks, beyond an orbit at which its contact force touches zero.

    Parameters
    ----------
    problem, solution : ForcedProblem, Solution
        The orbit at the event.
    inwards : (u,) float
        A direction along its family, away from the event.

    Returns
    -------
    (ForcedProblem, Step) or None
        Its first orbit, whose tangent points away from the event; None where none was found.
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
    for length in _STEPS:
        beyond = problem.step(solution.y, tangent, length)
        if beyond is None:
            break
        y = beyond.y
        opened = _moments(problem, y, flight, contact)
        if opened is None:
            continue
        start, end = opened
        half = 0.5 * (end - start)
        begin, hit = (0.0, 3.0 * end) if at_begin else (start, start + 4.0 * half)
        times, nodes = problem.flight_times(y), problem.nodes(y)
        if not hit < times[flight]:
            continue
        symbols = [letter, letter + CLOSES] if at_begin else [problem.sequence[flight], letter + OPENS, letter + CLOSES]
        sequence = [*problem.sequence[:flight], *symbols, *problem.sequence[flight + 1 :]]
        size = 2 * problem.degrees_of_freedom
        places = [hit] if at_begin else [begin, hit]
        inserted = [problem.fly(nodes[flight], place, flight) for place in places]
        states = np.insert(nodes[:, :size], flight + 1, [state for state, _ in inserted], axis=0)
        fractions = np.insert(nodes[:, size], flight + 1, [fraction for _, fraction in inserted])
        durations = np.diff([0.0, *places, times[flight]])
        at = problem.parameters(y)
        wide = problem.sibling(sequence, values=at)
        guess = wide.pack(states, fractions, [at[name] for name in problem.released], [*times[:flight], *durations, *times[flight + 1 :]])
        found = _first(wide, guess, flight if at_begin else flight + 1)
        if found is not None:
            return wide, found
    return None


def _moments(problem: ForcedProblem, y: np.ndarray, flight: int, contact: int) -> tuple[float, float] | None:
    """Times in a flight between which the force of a contact pulls; None where it does not."""
    node, duration = problem.nodes(y)[flight], float(problem.flight_times(y)[flight])
    times = np.linspace(0.0, duration, _SAMPLES)[:-1]
    forces = []
    for time in times.tolist():
        state, fraction = problem.fly(node, time, flight)
        forces.append(problem.contact_force(np.concatenate([state, [fraction], node[len(state) + 1 :]]), flight, contact))
    pulls = np.flatnonzero(np.array(forces) < 0.0)
    if not len(pulls) or pulls[-1] + 1 >= len(times):
        return None
    k, last = int(pulls[0]), int(pulls[-1])

    def zero(i: int) -> float:
        return float(times[i] - forces[i] * (times[i + 1] - times[i]) / (forces[i + 1] - forces[i]))

    return zero(k - 1) if k else 0.0, zero(last)


def _first(problem: ForcedProblem, guess: np.ndarray, flight: int) -> Step | None:
    """The orbit near a guess, with its tangent turned so that a flight grows; None where it is none."""
    try:
        y = problem.solve(guess).y
    except NotConverged:
        return None
    family = ForcedFamily(problem)
    step = family.begin(y)
    if not step.converged or not all(step.extra[name] > 0.0 for name in ("clearance", "speed", "flight")):
        return None
    grows = problem.flight_times(step.tangent[: problem.unknowns])[flight] > 0.0
    turned = step if grows else family.step(step.y, -step.tangent, 0.0)
    return turned if turned.converged else None
