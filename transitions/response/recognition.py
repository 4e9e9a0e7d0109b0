"""The impact sequence of a simulated periodic motion: its impacts, and the stops that stick after them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bvp.closures import EndsError
from bvp.contact_sequence import CLOSES, OPENS
from bvp.motion import EventKind, Motion
from bvp.simulate import simulate
from transitions.response.path import ParameterPath
from transitions.sweep.forced import Carried, carried_into
from transitions.sweep.settle import Settled

__all__ = ["MotionNodes", "nodes_of"]

_SUMMED = 0.3
"""Largest duration of the bounces that are summed, times the fastest rate: those before are impacts of their own."""

_INSTANT = 1e-9
"""Part of the period within which two events are at one instant."""


class MotionNodes(NamedTuple):
    """The k events of a period: impacts and releases."""

    symbols: tuple[str, ...]
    states: np.ndarray  # (k, 2n) (u, v) after each
    fractions: np.ndarray  # (k,) their times as fractions of the period
    times: np.ndarray  # (k,) durations of the flights after them


def nodes_of(path: ParameterPath, settled: Settled) -> MotionNodes:
    """The events of a settled motion in its period.

    A motion that sticks is simulated again for two more periods, of which the second one is taken, from an impact that follows a release
    on. An impact after which its stop stays closed gets one symbol.

    Raises
    ------
    EndsError
        Where an impact at another stop pulls a stop open that sticks.
    """
    p, period = settled.period, settled.period_of_loads * settled.period
    if settled.sticking_time == 0.0 or path.problem(()).has_clock is False:
        fractions = (settled.impacts.times / settled.period_of_loads + settled.impacts.periods) / p
        times = np.diff([*fractions, *(fractions[:1] + 1.0)]) * period
        return MotionNodes(settled.stops, settled.impacts.after, fractions, times)
    system, forces = path.parametric.system(path.values), path.parametric.forces(path.values)
    n = system.degrees_of_freedom
    # Rounding can leave a sticking stop a little beyond its bound.
    state = carried_into(system, Carried(settled.states[0]))[0].state
    motion = simulate(system, state[:n], state[n:], 3.0 * period, forces=forces)
    fastest = max([float(np.sqrt(np.abs(system.modes.squares).max())), *(getattr(force, "frequency", 0.0) for force in forces)])
    return _last_period(motion, period, _SUMMED / fastest)


def _last_period(motion: Motion, period: float, longest: float) -> MotionNodes:
    """The events of one period, from the first impact after a release in the second one on. longest: duration of chatter that is summed."""
    letters = motion.system.modes.contact_letters
    impact, stick, release = (kind.value for kind in (EventKind.IMPACT, EventKind.STICK, EventKind.RELEASE))
    kept = np.flatnonzero(np.isin(motion.kinds, (impact, stick, release)) & (motion.times >= period)).tolist()
    sticking, opened = (set(motion.contacts[(motion.kinds == kind) & (motion.times >= period)].tolist()) for kind in (stick, release))
    if not sticking <= opened:
        letter = letters[min(sticking - opened)]
        raise EndsError(f"stop {letter} sticks until an impact at another stop pulls it open; such motions are not followed")
    first = next(j for i, j in zip(kept, kept[1:], strict=False) if motion.kinds[i] == release and motion.kinds[j] == impact)
    end = motion.times[first] + (1.0 - _INSTANT) * period
    found: list[tuple[str, np.ndarray, float, float]] = []
    for k in kept:
        if not (k >= first and motion.times[k] < end):
            continue
        letter, kind, time = letters[motion.contacts[k]], int(motion.kinds[k]), float(motion.times[k])
        if kind == stick:
            # The impact before it is the one after which the stop stays closed, or the first of the bounces that are summed. Rounding can
            # leave a speed, and more impacts at one instant.
            arrival = found.pop()[3] if found and found[-1][0] == letter else time
            bounces = motion.system.stops[motion.system.modes.contact_stop[motion.contacts[k]]].restitution > 0.0
            while found and found[-1][0] == letter and time - found[-1][3] <= (longest if bounces else _INSTANT * period):
                arrival = found.pop()[3]
            found.append((letter + CLOSES, motion.after[k], time, arrival))
        else:
            found.append((letter + (OPENS if kind == release else ""), motion.after[k], time, time))
    symbols, states, leaves, arrivals = zip(*found, strict=True)
    times = np.array([*arrivals[1:], arrivals[0] + period]) - np.array(leaves)
    return MotionNodes(symbols, np.array(states), np.array(leaves) / period - 1.0, times)
