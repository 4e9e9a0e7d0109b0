"""Starts of families of forced orbits: the response without impacts, and what a simulation settles on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from branches.admissible import unphysical
from branches.forced.primitive import half_of
from branches.forced.resonance import is_driven
from bvp.closures import EndsError
from bvp.forced import ForcedProblem
from bvp.multipoint import NotConverged, Solution
from transitions.response.path import ParameterPath
from transitions.response.recognition import nodes_of
from transitions.sweep.settle import Settled, SettledKind

__all__ = ["NoOrbit", "Unbounded", "linear_response", "settled_orbit"]

_SAME = 1e-6
"""Largest distance of a simulated state from the solved orbit, relative to the orbit's size, at which both are one motion."""

_RESONANT = 1e-9
"""Distance of a multiplier of free motion from 1 below which the response is unbounded."""


_PERIODS = (1, 3, 10, 30, 100, 300, 1000)
"""Periods of the motion from rest after which Newton's method begins."""


class NoOrbit(RuntimeError):
    """A simulation did not settle on an orbit that can be solved; the message says what was found."""


class Unbounded(RuntimeError):
    """The load has the frequency of an undamped mode, or no response was found."""


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
        At an undamped resonance, and where free motion can be added to the response.
    """
    try:
        # Of an odd system under odd loads half a period is solved: it touches both stops of a pair at once.
        problem = path.problem((), half=True)
    except EndsError:
        problem = path.problem(())
    start = problem.pack(np.zeros((1, 2 * problem.degrees_of_freedom)), [0.0], path.start)
    if problem.is_smooth:
        solution = _smooth_response(path, problem, start)
        return problem, solution.y, unphysical(problem, solution)
    free = problem.multipliers(start)
    where = f"at {path.name} = {path.values[path.name]:.10g}"
    words = f"the response without impacts is unbounded {where}: the load has the frequency of an undamped mode"
    if np.abs(free - 1.0).min() < _RESONANT:
        if not is_driven(problem, 2.0 * math.pi * problem.load_periods / problem.period(start)):
            words = f"the response without impacts is not isolated {where}: free motion of an undamped mode repeats in its period"
        raise Unbounded(words)
    try:
        solution = problem.solve(start)
    except NotConverged as error:
        raise Unbounded(words) from error
    return problem, solution.y, unphysical(problem, solution)


def _smooth_response(path: ParameterPath, problem: ForcedProblem, start: np.ndarray) -> Solution:
    """A response without impacts beside smooth forces: the one to which Newton's method leads from that of the linear system, or from
    the motion that begins at rest, after some periods."""
    y, passed = start, 0
    for periods in _PERIODS:
        try:
            return problem.solve(y)
        except NotConverged:
            node, (sign, part) = problem.nodes(y)[0].copy(), problem.segment.closing
            while passed < periods:
                state, _ = problem.fly(node, part * problem.period(start))
                node[: len(state)] = sign * state
                passed += 1
            y = start.copy()
            problem.nodes(y)[0] = node
    where = f"at {path.name} = {path.values[path.name]:.10g}"
    words = "neither from the linear system's response nor from the motion that begins at rest"
    raise Unbounded(f"no response without impacts was found {where}, {words} in {passed} periods")


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
        raise NoOrbit(settled.text)
    if settled.sticking:
        raise NoOrbit(f"{settled.text}; orbits with a sticking contact are not followed")
    try:
        nodes = nodes_of(path, settled)
    except EndsError as error:
        raise NoOrbit(f"{settled.text}; {error}") from error
    try:
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
    # A state after an impact without rebound can be zero.
    scale = max(np.abs(part).max(initial=0.0) for part in (problem.nodes(solution.y)[:, : 2 * n], settled.states, settled.impacts.before))
    distance = float(np.abs(problem.nodes(solution.y) - problem.nodes(guess))[:, : 2 * n + 1].max() / max(scale, 1e-300))
    beyond = unphysical(problem, solution)
    if beyond is not None:
        raise NoOrbit(f"{settled.text}; the orbit found there is no motion: {beyond}")
    if linear and not problem.nodes(solution.y)[:, : 2 * n].any() and np.abs(problem.multipliers(solution.y)).max() < 1.0:
        return Periodic(problem, solution.y, 0.0)  # the motion decays to rest, but is never near it beside its own size
    if not distance < _SAME * max(1.0, settled.distance / 1e-9):
        raise NoOrbit(f"{settled.text}; the orbit found there is {distance:.1e} of its size away from it")
    symmetric = half_of(problem, solution.y)
    if symmetric is not None:
        return Periodic(symmetric[0], symmetric[1].y, distance)
    return Periodic(problem, solution.y, distance)
