"""Starts of families of forced orbits: the response without impacts, and what a simulation settles on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from branches.admissible import unphysical
from branches.forced.primitive import half_of
from branches.forced.resequencing import in_order
from branches.forced.resonance import is_driven
from bvp.closures import EndsError
from bvp.contact_sequence import CLOSES, OPENS
from bvp.forced import ForcedProblem
from bvp.kernels.flight import fastest_rate
from bvp.motion import EventKind, Motion
from bvp.multipoint import LARGEST, NotConverged, Solution, enough_pieces
from bvp.simulate import simulate
from transitions.response.path import ParameterPath
from transitions.sweep.forced import Carried, carried_into
from transitions.sweep.returns import drift_directions
from transitions.sweep.settle import Settled, SettledKind

__all__ = ["NoOrbit", "Unbounded", "linear_response", "settled_orbit"]

_SAME = 1e-6
"""Largest distance of a simulated state from the solved orbit, relative to the orbit's size, at which both are one motion."""

_RESONANT = 1e-9
"""Distance of a multiplier of free motion from 1 below which the response is unbounded."""

_PERIODS = (1, 3, 10, 30, 100, 300, 1000)
"""Periods of the motion from rest after which Newton's method begins."""

_SUMMED = 0.3
"""Largest duration of the bounces that are summed, times the fastest rate: those before are impacts of their own."""

_INSTANT = 1e-9
"""Part of the period within which two events are at one instant."""


class NoOrbit(RuntimeError):
    """A simulation did not settle on an orbit that can be solved; the message says what was found."""


class Unbounded(NoOrbit):
    """The load has the frequency of an undamped mode, free motion decays too slowly, or no response was found."""


def linear_response(path: ParameterPath) -> tuple[ForcedProblem, np.ndarray, str | None]:
    """The steady response without impacts.

    Parameters
    ----------
    path : ParameterPath
        The system at the values of its parameters, and those that are released.

    Returns
    -------
    ForcedProblem, (u,) ndarray, str or None
        The problem, the solution, and why it is no orbit: it passes beyond a stop.

    Raises
    ------
    Unbounded
        At an undamped resonance, and where free motion can be added to the response or hardly decays in a period.
    """
    try:
        # Of an odd system under odd loads half a period is solved: it touches both stops of a pair at once.
        problem = path.problem((), half=True)
    except EndsError:
        problem = path.problem(())
    if problem.is_smooth:
        problem, solution = _smooth_response(path, problem)
        return problem, solution.y, unphysical(problem, solution)
    cuts = list(_cut_problems(problem, path))
    start = _linear_start(path, cuts[0])
    where = f"at {path.name} = {path.values[path.name]:.10g}"
    why = _not_isolated(cuts[0], start)
    if why is not None:
        if is_driven(problem, 2.0 * math.pi * problem.load_periods / problem.period(start)):
            raise Unbounded(f"the response without impacts is unbounded {where}: the load has the frequency of an undamped mode")
        raise Unbounded(f"the response without impacts is not isolated {where}: {why}")
    for cut in cuts:
        with suppress(NotConverged):
            solution = cut.solve(_linear_start(path, cut))
            return cut, solution.y, unphysical(cut, solution)
    raise Unbounded(f"Newton's method finds no response without impacts {where}")


def _not_isolated(problem: ForcedProblem, y: np.ndarray) -> str | None:
    """Why a response without impacts is not isolated, or known to too few digits; None where it is isolated."""
    change = np.abs(problem.multipliers(y) - 1.0).min()
    return f"free motion changes by a part {change:.1e} in its period, expected {_RESONANT:g} or more" if change < _RESONANT else None


def _linear_start(path: ParameterPath, problem: ForcedProblem) -> np.ndarray:
    """The unknowns of the linear system's response without impacts, in the pieces of a problem. A single flight begins with zeros: Newton's
    first step leads to that response."""
    system, layout, entries = problem.system, path.parametric.layout, path.parametric.entries(problem.values)
    n, fractions = problem.degrees_of_freedom, np.arange(problem.pieces) * problem.closing[1] / problem.pieces
    states = np.zeros((problem.pieces, 2 * n))
    loads = entries[layout.cosine].reshape(-1, n) - 1j * entries[layout.sine].reshape(-1, n)
    for k, load in zip((0.0, *layout.harmonics), (entries[layout.constant], *loads), strict=True) if problem.pieces > 1 else ():
        rate = 1j * k * entries[layout.frequency][0]
        shape = np.linalg.lstsq(system.stiffness + rate * system.damping + rate * rate * system.mass, load, rcond=1e-12)[0]
        turned = np.exp(2j * math.pi * problem.load_periods * k * fractions)[:, None] * shape
        states += np.hstack([turned, rate * turned]).real
    return problem.pack(states, fractions, path.start)


def _smooth_response(path: ParameterPath, problem: ForcedProblem) -> tuple[ForcedProblem, Solution]:
    """A response without impacts beside smooth forces, with its problem: the one to which Newton's method leads from that of the linear
    system, or from the motion that begins at rest, after some periods."""
    for cut in _cut_problems(problem, path):
        with suppress(NotConverged):
            return cut, cut.solve(_linear_start(path, cut))
    start, (sign, part), passed = _linear_start(path, problem), problem.closing, 0
    for periods in _PERIODS:
        while passed < periods:
            state, _ = problem.fly(problem.nodes(start)[0], part * problem.period(start))
            problem.states(start)[0] = sign * state
            passed += 1
        with suppress(NotConverged):
            return problem, problem.solve(start)
    where = f"at {path.name} = {path.values[path.name]:.10g}"
    words = "neither from the linear system's response nor from the motion that begins at rest"
    raise Unbounded(f"no response without impacts was found {where}, {words} in {passed} periods")


def _cut_problems(problem: ForcedProblem, path: ParameterPath) -> Iterator[ForcedProblem]:
    """The problem, and where the linear system is unstable also in more and more pieces: the motion from the state 0 leaves it then."""
    rate = float(np.linalg.eigvals(problem.modes.flight.matrix).real.max())
    exponent = rate * problem.closing[1] * problem.period(_linear_start(path, problem))
    pieces = enough_pieces(math.exp(min(exponent, LARGEST)), 1, problem.most_pieces)
    yield problem.sibling((), pieces=pieces)
    while exponent > 1.0 and pieces < problem.most_pieces:
        pieces = min(2 * pieces, problem.most_pieces)
        yield problem.sibling((), pieces=pieces)


@dataclass(frozen=True)
class Periodic:
    """The orbit of a settled motion: its problem, the solved unknowns, and the distance of the simulated states from it."""

    problem: ForcedProblem
    y: np.ndarray
    distance: float


def settled_orbit(path: ParameterPath, settled: Settled) -> Periodic:
    """The orbit that a simulation has settled on, solved and compared with the simulation.

    An orbit with x(t + T/2) = -x(t) is solved over half its period, if the stops and loads are odd and p is odd.

    Parameters
    ----------
    path : ParameterPath
        As for `linear_response`.
    settled : Settled

    Raises
    ------
    NoOrbit
        If the motion is not periodic, sticks for ever, or is not the orbit that was solved.
    """
    if settled.kind is not SettledKind.PERIODIC:
        raise (Unbounded if settled.remaining > 0.0 else NoOrbit)(settled.text)
    if settled.sticking:
        raise NoOrbit(f"{settled.text}; orbits with a sticking contact are not followed")
    if drift_directions(path.parametric.system(path.values)).size:
        raise NoOrbit(f"{settled.text}; orbits of what can drift are not followed: expected coordinates between the bodies, as of a gap")
    try:
        nodes = nodes_of(path, settled)
        problem = path.problem(nodes.symbols, load_periods=settled.period)
    except EndsError as error:
        raise NoOrbit(f"{settled.text}; {error}") from error
    if nodes.symbols:
        # Without a clock a node has no time.
        fractions = nodes.fractions if problem.has_clock else np.zeros(len(nodes.fractions))
        guess = problem.pack(nodes.states, fractions, path.start, nodes.times)
    else:
        guess = problem.pack(settled.states[:1], [0.0], path.start)
    n = problem.degrees_of_freedom
    # A linear system has one response without impacts. From the state 0 it is exact if the system comes to rest there.
    linear = not nodes.symbols and not problem.is_smooth
    try:
        solution = problem.solve(problem.pack(np.zeros((1, 2 * n)), [0.0], path.start) if linear else guess)
    except NotConverged as error:
        raise NoOrbit(f"{settled.text}; Newton's method finds no orbit there") from error
    if linear and (why := _not_isolated(problem, solution.y)) is not None:
        raise Unbounded(f"{settled.text}; it is not isolated: {why}")
    # A state after an impact without rebound can be zero; a time is a fraction of the period.
    sizes = problem.scales(solution.y)[1 : 2 * n + 1]
    for states in (settled.states, settled.impacts.before):
        sizes = np.maximum(sizes, np.repeat(np.abs(states).reshape(-1, 2, n).max(axis=(0, 2), initial=0.0), n))
    apart = np.abs(problem.nodes(solution.y) - problem.nodes(guess))[:, : 2 * n + 1]
    distance = float((apart / np.append(sizes, 1.0)).max())
    beyond = unphysical(problem, solution)
    if beyond is not None:
        raise NoOrbit(f"{settled.text}; the orbit found there is no motion: {beyond}")
    decays = linear and np.abs(problem.multipliers(solution.y)).max() < 1.0  # to the one response without impacts, if slowly
    if decays and not problem.nodes(solution.y)[:, : 2 * n].any():
        return Periodic(problem, solution.y, 0.0)  # the motion decays to rest, but is never near it beside its own size
    if not decays and not distance < _SAME * max(1.0, settled.distance / 1e-9):
        raise NoOrbit(f"{settled.text}; the orbit found there is {distance:.1e} of its size away from it")
    problem, solution = half_of(problem, solution.y) or (problem, solution)
    return Periodic(*in_order(problem, solution.y), distance)


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
    fastest = max([fastest_rate(system.modes.flight), *(getattr(force, "frequency", 0.0) for force in forces)])
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
