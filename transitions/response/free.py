"""Simulate a motion without periodic loads until its transient is gone, and say what it has settled to: its period is free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from bvp.forcing import Constant, Force
from bvp.motion import EventKind, Motion, MotionStatus, StopEvents
from bvp.simulate import Simulator
from bvp.system import ImpactSystem
from transitions.sweep.forced import ImpactRecord
from transitions.sweep.returns import RETURN, distance_scale, without_drift
from transitions.sweep.settle import CLOSED, Settled, SettledKind

__all__ = ["FreeSettled", "settle_free"]

FIRST, MOST = 64, 16_384
"""Impacts of the first simulation and of the last one. Each is twice as long as the one before."""

LONGEST = 64
"""Most impacts in a period that are sought."""

_PERIODS = 1e5
"""Periods of the slowest vibration in which the impacts must happen."""

_STILL = 1e-14
"""Largest force at a start, beside those of springs and loads, that counts as an equilibrium."""

_DOUBLED = 2.0
"""Growth of the state in the later half of a simulation from which on it counts as unbounded."""


class FreeSettled(Settled):
    """What a motion without periodic loads has settled to.

    The attributes are those of `Settled`. `period` is 1 for a periodic motion, and `period_of_loads` its period T. Times are counted
    from the first impact, states[0] is the state after it, `elapsed` counts impacts. `growth` is that of the distance of returns in a
    period. The multipliers are not computed.
    """

    _counted = "impacts"

    def _found(self, after: str) -> str:
        if self.kind is SettledKind.PERIODIC:
            return f"{self.kind.value} with {len(self.impacts)} impacts, T = {self.period_of_loads:.10g}, {after}"
        if self.kind is SettledKind.AT_REST:
            what = f"it sticks to {' and '.join(self.sticking)} for ever" if self.sticking else "nothing moves or no stop is reached"
            return f"no impacting motion: {what}, {after}; expected another state in --start"
        if self.growth > 0.0:
            return f"the motion grows without bound ({after}; growth {self.growth:.4g} from impact to impact)"
        near = f"a return after {len(self.impacts)} impacts is {self.distance:.1e} from closing; growth {self.growth:.4g} in a return"
        return f"it has not settled ({after}; {near}): it converges slowly, or it is a torus or chaos"


def settle_free(system: ImpactSystem, forces: Sequence[Force], u: Any = None, v: Any = None) -> FreeSettled:
    """Simulate a motion under constant loads, or none, until its impacts repeat.

    Parameters
    ----------
    system : ImpactSystem
    forces : sequence of Constant
    u, v : (n,) array_like, optional
        The start; by default rest at zero.

    Raises
    ------
    BeyondStop
        For a start beyond a stop.

    Examples
    --------
    A motor drives an oscillator: its damping is negative. It loses at its stop what it gains.

    >>> from bvp.system import ImpactSystem, Stop
    >>> driven = ImpactSystem([[1.0]], [[-0.1]], [[1.0]], [Stop((1.0,), upper=1.0, restitution=0.6)])
    >>> found = settle_free(driven, [], [0.5], [0.0])
    >>> found.kind.name, len(found.impacts), round(found.period_of_loads, 6)
    ('PERIODIC', 1, 4.614438)
    """
    n = system.degrees_of_freedom
    zero = np.zeros(n)
    simulator = Simulator(system, list(forces))
    vibrating = np.sqrt(np.abs(system.modes.squares[system.modes.squares != 0.0]))
    slowest = float(vibrating.min()) if len(vibrating) else float(np.abs(system.damping).max() / np.abs(system.mass).max()) or 1.0
    impacts, last, duration = FIRST, math.nan, _PERIODS * 2.0 * math.pi / slowest
    u, v = (zero if given is None else given for given in (u, v))
    constant = sum((force.load for force in forces if isinstance(force, Constant)), zero)
    sizes = np.abs(system.stiffness) @ np.abs(u) + np.abs(constant)
    if not np.any(v) and np.all(np.abs(system.stiffness @ u - constant) <= _STILL * np.max(sizes)):
        return _settled(SettledKind.AT_REST, simulator.run(u, v, 0.0), 0)
    while True:
        motion = simulator.run(u, v, duration, impacts)
        if motion.status is MotionStatus.DURATION_REACHED:
            return _settled(SettledKind.AT_REST, motion, 0)
        ended = motion.status is not MotionStatus.IMPACTS_FULL
        count, distance, growth = _nearest_return(motion, slowest) if not ended or motion.impacts >= FIRST else (0, math.nan, math.nan)
        if ended and not growth > 0.0:
            return _settled(SettledKind.FAILED, motion, 0)
        if distance <= CLOSED or (distance <= RETURN and distance >= 0.5 * last):
            return _settled(SettledKind.PERIODIC, motion, count, distance, growth)
        if ended or impacts >= MOST:
            return _settled(SettledKind.NOT_CONVERGED, motion, count, distance, growth)
        impacts, last = 2 * impacts, distance


def _nearest_return(motion: Motion, frequency: float) -> tuple[int, float, float]:
    """Number k of impacts in the period that the last impacts suggest, the distance of the return relative to the largest state, and the
    logarithm of its growth in a return."""
    events = _impacts(motion)
    points = distance_scale(without_drift(motion.system, events.after), frequency)
    sizes = np.linalg.norm(points, axis=1)
    half = len(points) // 2
    if sizes[-1] > _DOUBLED * sizes[half] > 0.0:
        return 1, math.inf, math.log(sizes[-1] / sizes[half]) / (len(points) - 1 - half)
    best, found = math.inf, 1
    contacts = np.array(events.contacts)
    for k in range(1, min(LONGEST, len(points) // 2 - 1) + 1):
        if not np.array_equal(contacts[-k:], contacts[-2 * k : -k]):
            continue
        distance = float(np.linalg.norm(points[-k:] - points[-2 * k : -k], axis=1).max()) / sizes.max()
        if distance <= RETURN:
            best, found = distance, k
            break
        if distance < 0.5 * best:
            best, found = distance, k
    steps = np.linalg.norm(points[found:] - points[:-found], axis=1)[half:]
    steps = steps[steps > CLOSED * sizes.max()]
    growth = math.log(steps[-1] / steps[0]) / (len(steps) - 1) * found if len(steps) > 1 else -math.inf
    return found, best, min(growth, 0.0)


def _impacts(motion: Motion) -> StopEvents:
    """The impacts of a motion, without touches."""
    events = motion.stop_events
    kept = np.flatnonzero(~events.touches)
    contacts = tuple(events.contacts[k] for k in kept)
    arrays = (getattr(events, name)[kept] for name in ("touches", "speeds", "losses", "before", "after"))
    return StopEvents(events.times[kept], contacts, *arrays)


def _settled(kind: SettledKind, motion: Motion, count: int, distance: float = math.nan, growth: float = math.nan) -> FreeSettled:
    """The result, with the last `count` impacts before the last one."""
    events = _impacts(motion)
    rows = slice(len(events.times) - count - 1, len(events.times) - 1) if count else slice(0)
    begin = float(events.times[rows.start]) if count else 0.0
    letters = motion.system.modes.contact_letters
    sticking = motion.contact_intervals[-1].sticking
    if count:
        stuck = (motion.kinds == EventKind.STICK.value) & (motion.times >= begin)
        sticking = tuple(dict.fromkeys(letters[contact] for contact in motion.contacts[stuck]))
    return FreeSettled(
        kind=kind,
        period=1 if kind is SettledKind.PERIODIC else 0,
        states=events.after[rows] if count else motion.final[None],
        impacts=ImpactRecord(
            np.array([letters.index(letter) for letter in events.contacts[rows]], dtype=np.int64),
            np.zeros(count, dtype=np.int64),
            events.times[rows] - begin,
            events.speeds[rows],
            events.before[rows],
            events.after[rows],
        ),
        stops=tuple(events.contacts[rows]),
        sticking=sticking,
        sticking_time=motion.sticking_time if sticking else 0.0,
        period_of_loads=float(events.times[-1]) - begin if count else math.nan,
        growth=growth,
        distance=distance,
        elapsed=motion.impacts,
        status=motion.status,
    )
