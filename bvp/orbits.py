"""The orbits of a conservative multipoint problem, as the compiled core computes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import saltus_core

from bvp.smooth_flights import make_flight, why_not_flown
from bvp.texts import brief

if TYPE_CHECKING:
    from bvp.modes import Modes
    from bvp.multipoint import MultipointProblem

__all__ = ["DIVERGED", "FAILED", "GROWN", "RESULT_INDEX", "ROUNDS", "SOLVED", "UNSETTLED", "Orbits", "Period", "Solution"]

RESULT_INDEX = {name: k for k, name in enumerate(saltus_core.POINT_NAMES)}

SOLVED, DIVERGED, GROWN, UNSETTLED, FAILED = range(5)
"""Outcomes of `Orbits.solve`: not finite; growing; not settled after `ROUNDS`; the last correction, along the family, failed."""

ROUNDS = 30
"""Most corrections onto an energy or a quarter period."""

_ENTRIES = len(RESULT_INDEX)


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


class Period(NamedTuple):
    """The P nodes of an orbit over its period, in order of time: impacts, and cuts of flights.

    before, after (P, N): states. duration (P,): of the flights that follow. node: that of the problem that each is an image of. lead: time
    from the orbit's start to the first one."""

    before: np.ndarray
    after: np.ndarray
    duration: np.ndarray
    node: list[int]
    lead: float


def _empty(problem: MultipointProblem) -> Solution:
    """Arrays for a solution."""
    sizes = problem.unknowns, problem.tangent_size, problem.coordinates, (problem.inner + 1, problem.size), _ENTRIES
    return Solution(*map(np.empty, sizes))


def _numbers(array: Any) -> np.ndarray:
    """An array as compiled code takes it."""
    return np.ascontiguousarray(array, dtype=float)


@lru_cache(maxsize=64)
def _contacts(modes: Modes) -> Any:
    """The contacts of a system for the core."""
    contacts = modes.contacts
    rows = (contacts.gap, contacts.rate, contacts.acceleration, contacts.side, contacts.bound, contacts.push, contacts.restitution)
    return saltus_core.Contacts(*map(_numbers, rows))


class Orbits:
    """The orbits of a problem.

    Attributes
    ----------
    flight : saltus_core.LinearFlight or SmoothFlight
    core : saltus_core.OrbitProblem
    """

    def __init__(self, problem: MultipointProblem):
        self.problem = problem
        self.flight = make_flight(problem.system)
        observed = problem.observed
        self.core = saltus_core.OrbitProblem(
            self.flight, _contacts(problem.modes), np.array(problem.contacts, dtype=np.int64), problem.kinds, problem.quarters,
            problem.modes.pace, _numbers(problem.start_map), _numbers(problem.start_offset), _numbers(problem.end_map),
            _numbers(problem.end_offset), _numbers(observed.rows).reshape(-1, problem.size), _numbers(observed.bounds[0]),
            _numbers(observed.bounds[1]), _numbers(problem.held), _numbers(problem.free).reshape(-1, problem.half),
            problem.half == 2 and not problem._two_dof,
        )  # fmt: skip

    def why_not_flown(self) -> str:
        """Where and why the flight that was computed last has no end; empty where it has one."""
        return why_not_flown(self.flight)

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
        """The largest factor by which perturbations grow along a flight."""
        found: float = self.core.growth(_numbers(y))
        return found

    def unfold(self, y: np.ndarray) -> Period:
        """The nodes of the full period."""
        return Period(*self.core.unfold(_numbers(y)))

    def length(self, y: np.ndarray, direction: np.ndarray) -> float:
        """The length of a direction (u,) of the unknowns in the metric of the arclength."""
        found: float = self.core.course(_numbers(y), _numbers(direction))[-1]
        return found

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
        """The solution near y at an energy or a quarter period (NaN: not wanted): outcome (`SOLVED` ..), last change, the one before, and
        the solution."""
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
