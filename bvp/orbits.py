"""What computes the orbits of a multipoint problem: the compiled core for linear flights, kernels for smooth forces.

Both have the same methods, so `bvp.multipoint` does not ask which it has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import saltus_core

from bvp.kernels.correction import meet_position, solve_orbit
from bvp.kernels.multipoint import Factor, Segment, evaluate, fill, make_factor, nodes_by_flight
from bvp.kernels.newton import set_scale
from bvp.kernels.paths import state_at
from bvp.kernels.stability import make_period, orbit_stability
from bvp.kernels.step import CompiledProblem, Landing, Request, end_states, orbit_observe, orbit_step
from bvp.texts import brief

if TYPE_CHECKING:
    from bvp.modes import Modes
    from bvp.multipoint import MultipointProblem

__all__ = ["RESULT_INDEX", "CoreOrbits", "KernelOrbits", "Solution", "dense_jacobian", "largest_growth"]

RESULT_INDEX = {name: k for k, name in enumerate(saltus_core.POINT_NAMES)}

_ENTRIES = len(RESULT_INDEX)
_NOTHING = np.full(_ENTRIES, np.nan)
"""No entry of a result is known. A copy takes a fifth of the time of making it."""

_COMPILED: dict[tuple[bool, int], tuple[Any, int]] = {}
"""Each kernel with its address in memory."""


@brief
@dataclass(eq=False, slots=True)
class Solution:
    """A point where the corrections arrived; not changed afterwards.

    Parameters
    ----------
    y : (u,) float
        Unknowns of the multipoint problem.
    tangent : (2 u,) or (3 u,) float
        Unit tangent of the family in the metric, then its change with arclength (0 where not known); with smooth forces the third
        derivative too.
    position : (N + 2,) float
        (start state / sqrt(2 h), log h, log alpha): the coordinates in which arclength is measured.
    ends : (k + 1, N) float
        State at the end of each flight, before the impact there.
    result : (len(RESULT_INDEX),) float
        The numbers of `saltus_core.POINT_NAMES`; entries that do not exist are NaN.
    """

    y: np.ndarray
    tangent: np.ndarray
    position: np.ndarray
    ends: np.ndarray
    result: np.ndarray

    def __getitem__(self, name: str) -> float:
        return float(self.result[RESULT_INDEX[name]])


def _empty(problem: MultipointProblem) -> Solution:
    """Arrays for a solution."""
    sizes = problem.unknowns, problem.tangent_size, problem.coordinates, (problem.inner + 1, problem.size), _ENTRIES
    return Solution(*map(np.empty, sizes))


def _numbers(array: Any) -> np.ndarray:
    """An array as compiled code takes it."""
    return np.ascontiguousarray(array, dtype=float)


@lru_cache(maxsize=64)
def _flight_and_contacts(modes: Modes) -> tuple[Any, Any]:
    """The linear flight and the contacts of a system for the core."""
    contacts, half = modes.contacts, len(modes.squares)
    pairs, mean, delta, matrix = modes.flight
    flight = saltus_core.LinearFlight(pairs, mean, delta, _numbers(matrix), np.concatenate([modes.squares, np.ones(half)]))
    rows = (contacts.gap, contacts.rate, contacts.acceleration, contacts.side, contacts.bound, contacts.push, contacts.restitution)
    return flight, saltus_core.Contacts(*map(_numbers, rows))


class CoreOrbits:
    """The orbits of a problem with linear flights."""

    def __init__(self, problem: MultipointProblem):
        self.problem = problem
        self.flight, contacts = _flight_and_contacts(problem.modes)
        observed = problem.observed
        self.core = saltus_core.OrbitProblem(
            self.flight, contacts, np.array(problem.contacts, dtype=np.int64), problem.kinds, problem.quarters, problem.modes.pace,
            _numbers(problem.start_map), _numbers(problem.start_offset), _numbers(problem.end_map), _numbers(problem.end_offset),
            _numbers(observed.rows).reshape(-1, problem.size), _numbers(observed.bounds[0]), _numbers(observed.bounds[1]),
            _numbers(problem.held), _numbers(problem.free).reshape(-1, problem.half), problem.half == 2 and not problem._two_dof,
        )  # fmt: skip

    def path_state(self, z: np.ndarray, time: float) -> np.ndarray:
        """State at a time of the flight from z."""
        return self.flight.end(_numbers(z), time)

    def nodes(self, start: np.ndarray, times: np.ndarray) -> np.ndarray:
        """States after the inner nodes, (k, N), by exact flight from the start."""
        return self.core.nodes(_numbers(start), _numbers(times))

    def end_states(self, y: np.ndarray) -> np.ndarray:
        """State at the end of each flight, (k + 1, N)."""
        return self.core.end_states(_numbers(y))

    def residual(self, y: np.ndarray) -> np.ndarray:
        """F(y), (u - 1,)."""
        return self.core.residual(_numbers(y))

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y), (u - 1, u)."""
        return self.core.jacobian(_numbers(y))

    def scales(self, y: np.ndarray) -> np.ndarray:
        """Typical size of each unknown, (u,)."""
        return self.core.scales(_numbers(y))

    def growth(self, y: np.ndarray) -> float:
        """Linear flights are exact: it is not asked for."""
        return 1.0

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float, maximum: int, full: bool) -> Solution | None:
        """See `MultipointProblem.step`."""
        out = _empty(self.problem)
        found = self.core.step(
            _numbers(y), _numbers(tangent), ds, maximum, full, out.y, out.tangent, out.position, out.ends, out.result
        )
        return out if found else None

    def correct(self, y: np.ndarray, row: np.ndarray, target: float, maximum: int) -> Solution:
        """Correct y on the plane row . y = target, `maximum` times at most; the result says whether it converged."""
        out = _empty(self.problem)
        self.core.correct(_numbers(y), _numbers(row), target, maximum, out.y, out.tangent, out.position, out.ends, out.result)
        return out

    def solve(self, y: np.ndarray, energy: float, quarter_period: float) -> tuple[int, float, float, Solution]:
        """The solution near y at an energy or a quarter period (NaN: not wanted): outcome of `bvp.kernels.correction`, last change, the one
        before, and the solution."""
        out = _empty(self.problem)
        found = self.core.solve(_numbers(y), energy, quarter_period, out.y, out.tangent, out.position, out.ends, out.result)
        return *found, out

    def meet_position(self, y: np.ndarray, along: np.ndarray, position: np.ndarray, near: float, most: int) -> np.ndarray | None:
        """See `MultipointProblem.family_orbit_at`."""
        out = _empty(self.problem)
        found = self.core.meet_position(
            _numbers(position), near, most, _numbers(y), _numbers(along), out.y, out.tangent, out.position, out.ends, out.result
        )
        return out.y if found else None


class KernelOrbits:
    """The orbits of a problem with smooth forces."""

    def __init__(self, problem: MultipointProblem):
        self.problem = problem
        self.segment: Segment = problem.segment
        size = problem.size
        self.factor = make_factor(self.segment)
        self._work = np.zeros((2 * size + 8, max(size, problem.unknowns)))
        self._period = make_period(4 * (problem.inner + 1), True)
        self._zero = np.zeros(2 * problem.unknowns)

    def path_state(self, z: np.ndarray, time: float) -> np.ndarray:
        """State at a time of the flight from z."""
        out = np.empty(self.problem.size)
        state_at(self.segment.flight, np.array(z, float), time, out)
        return out

    def nodes(self, start: np.ndarray, times: np.ndarray) -> np.ndarray:
        """States after the inner nodes, (k, N), by exact flight from the start."""
        out = np.empty((self.problem.inner, self.problem.size))
        nodes_by_flight(self.segment, start, times, self._work[0, : self.problem.size].copy(), out)
        return out

    def end_states(self, y: np.ndarray) -> np.ndarray:
        """State at the end of each flight, (k + 1, N)."""
        out = np.empty((self.problem.inner + 1, self.problem.size))
        end_states(self.segment, np.array(y, float), self._work, out)
        return out

    def residual(self, y: np.ndarray) -> np.ndarray:
        """F(y), (u - 1,)."""
        residual = np.empty(self.problem.unknowns - 1)
        factor = self.factor
        evaluate(self.segment, np.array(y, float), factor.before, factor.flights, self._work[0, : self.problem.size].copy(), residual)
        return residual

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y), (u - 1, u)."""
        y = np.array(y, float)
        self.residual(y)
        self.factor.scale[:] = 1.0
        fill(self.segment, y, self.factor)
        return dense_jacobian(self.factor, self.problem.size + 1)

    def scales(self, y: np.ndarray) -> np.ndarray:
        """Typical size of each unknown, (u,)."""
        self.residual(y)
        self.factor.before[:] = self.end_states(y)
        set_scale(self.segment, np.array(y, float), self.factor)
        return self.factor.scale.copy()

    def growth(self, y: np.ndarray) -> float:
        """The largest factor by which perturbations grow along a flight."""
        self.residual(y)
        return largest_growth(self.segment, self.factor, y, self.problem.half)

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float, maximum: int, full: bool) -> Solution | None:
        """See `MultipointProblem.step`."""
        out, metric = self._taken(np.array(y, float), np.array(tangent, float), Request(ds, math.nan, maximum))
        if out.result[0] != 1.0:
            return None
        out.position, out.ends = metric[0], self.factor.before.copy()
        if full:
            self._kernel(1)[0](self.segment, self.problem.observed, out.y, out.ends, self._work, out.result)
            if self.problem._two_dof:
                self._kernel(2)[0](self.segment, out.y, out.ends, self._period, out.result)
        return out

    def correct(self, y: np.ndarray, row: np.ndarray, target: float, maximum: int) -> Solution:
        """Correct y on the plane row . y = target, `maximum` times at most; the result says whether it converged."""
        self.factor.work[5, : self.problem.unknowns] = row
        return self._taken(np.array(y, float), self._zero, Request(0.0, target, maximum))[0]

    def solve(self, y: np.ndarray, energy: float, quarter_period: float) -> tuple[int, float, float, Solution]:
        """The solution near y at an energy or a quarter period: see `CoreOrbits.solve`."""
        out, metric = self._landing(), np.empty((4, self.problem.coordinates))
        landing = Landing(out.y, out.tangent, out.result)
        found = solve_orbit(self.compiled(), (energy, quarter_period), np.array(y, float), self._zero, metric, landing, out.ends)
        out.position = metric[0]
        return *found, out

    def meet_position(self, y: np.ndarray, along: np.ndarray, position: np.ndarray, near: float, most: int) -> np.ndarray | None:
        """See `MultipointProblem.family_orbit_at`."""
        out, here, metric = self._landing(), np.empty((2, self.problem.coordinates)), np.empty((4, self.problem.coordinates))
        tangent = np.concatenate([along, np.zeros(self.problem.unknowns)])
        place, landing = (np.array(position, float), near), Landing(out.y, out.tangent, out.result)
        found = meet_position(self.compiled(full=False), place, most, np.array(y, float), tangent, here, metric, landing)
        return out.y if found else None

    def compiled(self, *, full: bool = True) -> CompiledProblem:
        """The problem for a kernel that takes steps of its own; where not `full`, only the address of `orbit_step` is given.
        `orbit_stability` is for two degrees of freedom."""
        wanted = (True, full, full and self.problem._two_dof)
        addresses = np.array([self._kernel(k)[1] if wanted[k] else 0 for k in range(3)])
        return CompiledProblem(addresses, self.segment, self.factor, self.problem.observed, self._work, self._period)

    def _landing(self) -> Solution:
        out = _empty(self.problem)
        out.tangent, out.result = out.tangent[: 2 * self.problem.unknowns], _NOTHING.copy()
        return out

    def _taken(self, y: np.ndarray, tangent: np.ndarray, request: Request) -> tuple[Solution, np.ndarray]:
        """A step, and the metric, whose first row is the position."""
        out, metric = _empty(self.problem), np.empty((4, self.problem.coordinates))
        out.result = _NOTHING.copy()
        landing = Landing(out.y, out.tangent, out.result)
        self._kernel(0)[0](self.segment, self.factor, y, tangent, request, metric, landing)
        return out, metric

    def _kernel(self, k: int) -> tuple[Any, int]:
        """The kernel of a point - 0: `orbit_step`, 1: `orbit_observe`, 2: `orbit_stability` - and its address."""
        key = self.problem._two_dof, k
        if key not in _COMPILED:
            unknowns, inner, size = self.problem.unknowns, self.problem.inner, self.problem.size
            y, tangent, ends = np.empty(unknowns), np.empty(2 * unknowns), np.empty((inner + 1, size))
            metric, result = np.empty((4, size + 2)), np.empty(_ENTRIES)
            arguments: tuple[Any, ...] = (
                (self.segment, self.factor, y, tangent, Request(0.0, 0.0, 0), metric, Landing(y, tangent, result)),
                (self.segment, self.problem.observed, y, ends, self._work, result),
                (self.segment, y, ends, self._period, result),
            )[k]
            function = (orbit_step, orbit_observe, orbit_stability)[k]
            _COMPILED[key] = function, function.entry(*arguments).address
        return _COMPILED[key]


def largest_growth(segment: Any, factor: Factor, y: np.ndarray, n: int) -> float:
    """The largest factor by which perturbations of n displacements and velocities grow along a flight of the orbit y that was evaluated
    last, relative to their sizes."""
    displacement, velocity, _ = set_scale(segment, np.array(y, float), factor)
    sizes = np.repeat([displacement, velocity], n)
    return float(np.max(np.abs(factor.flights[:, : 2 * n, : 2 * n]) * sizes / sizes[:, None]))


def dense_jacobian(factor: Factor, rows: int) -> np.ndarray:
    """The Jacobian that `fill` wrote into the factor arrays, (u - 1, u). rows: equations of a flight."""
    inner, unknowns = len(factor.window) // rows, factor.closing.shape[1]
    out = np.zeros((unknowns - 1, unknowns))
    for i in range(inner):
        base = max(0, (i - 1) * rows)
        width = min(factor.window.shape[1], unknowns - base)
        out[i * rows : (i + 1) * rows, base : base + width] = factor.window[i * rows : (i + 1) * rows, :width]
    out[inner * rows :] = factor.closing
    return out
