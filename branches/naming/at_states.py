"""The orbit to which the motion of a conservative system from a given state leads: it starts at rest, or on a stop that it has just hit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from branches.naming.matching import NameNotFound
from branches.orbit import Orbit
from branches.search.orbit_search import judged
from bvp.motion import EventKind
from bvp.multipoint import EndsError, MultipointProblem, NotConverged
from bvp.simulate import simulate
from bvp.system import ImpactSystem

__all__ = ["FROM_STATE", "orbit_near"]

FROM_STATE = "--from simulate --start U1,..,V1,.. with a state of zero speed"
"""Advice where no linear mode exists."""

MOST_IMPACTS = 24
"""Most impacts up to which the far end of an orbit is sought."""

SWINGS = 40.0
"""Time up to which it is sought, in units of the longest time of a swing or a fall."""

SAMPLES = 400
"""Instants between which the speed is compared where an end at rest is sought."""

SIDEWAYS = 0.2
"""Largest part of the speed, by kinetic energy, that is not that of an end, from which Newton's method starts."""

MOVED = 0.5
"""How far the start may move, relative to its size."""


def orbit_near(system: ImpactSystem, u: Sequence[float], v: Sequence[float]) -> Orbit:
    """The first periodic orbit that Newton's method finds along the motion from (u, v), with the energy of this state.

    Parameters
    ----------
    system : ImpactSystem
        Conservative.
    u, v : sequence of n floats
        At rest, v = 0; or on a stop, with the velocity after an impact there that reverses the motion.

    Raises
    ------
    NameNotFound
        A ValueError, where no orbit is found.

    Examples
    --------
    >>> from bvp.springs import Spring
    >>> from bvp.system import ImpactSystem, Stop
    >>> ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0)], springs=[Spring((1.0,), potential="w")])
    >>> orbit = orbit_near(ball, [2.0], [0.0])
    >>> orbit.ends, round(orbit.h, 12), round(orbit.period, 12)
    (('rest', 'stop-'), 2.0, 4.0)
    """
    at, speed = np.array(u, float), np.array(v, float)
    energy, state = float(system.energy(at, speed)), np.concatenate([at, speed])
    begin = _end_at(system, at, speed)
    if not energy > 0.0:
        raise NameNotFound(f"the start has the energy {energy:.10g}; expected one above 0, that of the system at rest")
    motion = simulate(system, at, speed, _lasting(system, at, speed), MOST_IMPACTS)
    impacts = np.flatnonzero(motion.kinds == EventKind.IMPACT.value)
    letters = [system.modes.contact_letters[k] for k in motion.contacts[impacts]]
    times = motion.times[impacts]
    ends: list[tuple[float, int, str]] = []  # the time of a far end, the impacts before it, and what it is
    for k, (row, letter) in enumerate(zip(motion.before[impacts], letters, strict=True)):
        if _sideways(system, row[len(at) :], letter) < SIDEWAYS:
            ends.append((float(times[k]), k, f"stop{letter}"))
    instants = np.linspace(0.0, motion.duration, SAMPLES + 1)
    velocities = motion.sample(instants)[1]
    kinetic = 0.5 * np.sum((velocities @ system.mass) * velocities, axis=1)
    lowest = np.flatnonzero((kinetic[1:-1] < kinetic[:-2]) & (kinetic[1:-1] <= kinetic[2:]) & (kinetic[1:-1] < SIDEWAYS * energy)) + 1
    ends += [(float(instants[i]), int(np.searchsorted(times, instants[i])), "rest") for i in lowest]
    start = system.modes.from_state @ state
    for time, count, end in sorted(ends):
        try:
            problem = MultipointProblem(system, (begin, end), letters[:count])
            flights = np.diff(np.concatenate([[0.0], times[:count], [time]]))
            solution = problem.solve(problem.pack(start, None, flights), energy=energy)
        except (NotConverged, EndsError):
            continue
        moved = np.linalg.norm(problem.start(solution.y) - start)
        if moved <= MOVED * np.linalg.norm(start) and not isinstance(judged(problem, solution), str):
            return Orbit(problem, solution)
    raise NameNotFound(f"no periodic orbit is near the motion from this state, within {len(impacts)} impacts; expected another one")


def _end_at(system: ImpactSystem, u: np.ndarray, v: np.ndarray) -> str:
    """The end of an orbit that a state is."""
    if not v.any():
        return "rest"
    for k, letter in enumerate(system.modes.contact_letters):
        stop = system.stops[system.modes.contact_stop[k]]
        side, bound = (1.0, stop.upper) if letter.endswith("+") else (-1.0, stop.lower)
        gap = np.array(stop.gap)
        closed = abs(gap @ u - bound) <= 1e-12 * (abs(bound) + np.abs(gap) @ np.abs(u))
        if closed and side * (gap @ v) < 0.0 and _sideways(system, v, letter) < SIDEWAYS:
            return f"stop{letter}"
    raise NameNotFound(
        "an orbit starts at rest, with all velocities 0, or on a stop, with the velocity of an impact there that reverses the motion; "
        f"received the velocities {', '.join(f'{value:g}' for value in v.tolist())}"
    )


def _sideways(system: ImpactSystem, v: np.ndarray, letter: str) -> float:
    """The part of the kinetic energy that an impact leaves as it is."""
    gap = np.array(system.stops[system.modes.contact_stop[system.modes.contact_letters.index(letter)]].gap)
    return 1.0 - float(gap @ v) ** 2 / float((gap @ np.linalg.solve(system.mass, gap)) * (v @ system.mass @ v))


def _lasting(system: ImpactSystem, u: np.ndarray, v: np.ndarray) -> float:
    """The time in which the far end of an orbit from a state is sought."""
    frequencies = system.modes.frequencies
    times = [2.0 * math.pi / w for w in frequencies.tolist() if w > 0.0]
    pull = system.stiffness @ u + (0.0 if system.smooth_forces is None else system.smooth_forces.acting(u, np.zeros_like(u)))
    rate = np.abs(np.linalg.solve(system.mass, pull))
    for stop in system.stops:
        gap = np.array(stop.gap)
        across, pace = np.abs(gap) @ rate, abs(float(gap @ v))
        for bound in filter(math.isfinite, (stop.lower, stop.upper)):
            distance = abs(float(gap @ u) - bound)
            if across > 0.0:
                times.append(math.sqrt(2.0 * distance / across) + 2.0 * pace / across)
            elif pace > 0.0:
                times.append(distance / pace)
    return SWINGS * max(times, default=1.0)
