"""Periodic orbits by the nonsmooth time transformation and shooting, the method of the reference paper, for comparison only.

With u(t) = e(t/alpha) y(tau(t/alpha)), tau the triangular sine and e its derivative, a periodic orbit with u = 0 twice a period is a
two-point problem over half its period, -1 <= tau <= 1, at a fixed quarter period alpha:

    y'' = -alpha^2 M^-1 K y,   y(-1) = y(1) = 0,   with impacts at the stops

It is solved as an initial-value problem from tau = -1 until |y_i(1)| < tolerance. The result is approximate: its error is that of the
integrator plus one of the size of the tolerance. `bvp.multipoint` solves the same orbits exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from benchmarks.speed_error.methods import Answer, Method, OrbitAnswer, Task, Work
from benchmarks.speed_error.tasks import OrbitTask
from bvp.checks import checked_number
from bvp.simulate import checked_state
from tests.lab.paths import restitute

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from bvp.system import ImpactSystem

__all__ = [
    "LEAST_TOLERANCE", "TOLERANCE", "NonsmoothTime", "NonsmoothTimeOrbit", "NotMatched", "Stagnates", "check_impacts",
    "solve_nonsmooth_time", "why_not",
]  # fmt: skip

TOLERANCE = 1e-6
"""The smaller of the two matching tolerances that the paper names."""

LEAST_TOLERANCE = 1e-13
"""Least matching tolerance. Displacements of size 1 have rounding errors of some 1e-15 over a half period."""

_CORRECTIONS = 25
_NEAR = 1e-4  # below this mismatch, in units of displacement, Newton's method is near an orbit
_IDLE = 4  # near an orbit, this many corrections without a decrease of the mismatch are the last
_FLIGHTS = 1000
_BETWEEN = 1e-12  # two impacts closer than this in tau are one that the integrator found twice
_OUTSIDE = 1e-6  # largest penetration of a stop at a step of the integrator, in units of displacement
_AWAY = 0.01  # largest difference of an impact time on the same orbit, as a part of the quarter period


class NotMatched(RuntimeError):
    """Shooting did not reach the orbit; the message gives the reason."""


class Stagnates(NotMatched):
    """Shooting is near an orbit, but the mismatch no longer decreases: the tolerance is below the accuracy of the integrator."""


class TauImpact(NamedTuple):
    """An impact inside the half period: tau in (-1, 1), the contact's letter, the speed of approach along the gap coordinate."""

    tau: float
    contact: str
    speed: float


class Shot(NamedTuple):
    """Solution of the initial-value problem: displacements (n,) at tau = 1, impacts, largest relative change of the energy."""

    end: np.ndarray
    impacts: list[TauImpact]
    drift: float


def why_not(system: ImpactSystem) -> str | None:
    """Return why the method does not apply to a system, or None."""
    reason = system.why_not_conservative()
    if reason is not None:
        return reason
    if not system.has_odd_symmetry:
        return "the method needs the symmetry u -> -u, and the gaps of a stop are not equal"
    return None


@dataclass(frozen=True, eq=False)
class NonsmoothTimeOrbit:
    """A periodic orbit found by shooting in nonsmooth time."""

    system: ImpactSystem
    quarter_period: float  # alpha, as given
    slope: np.ndarray  # (n,) y'(-1), the derivative with respect to tau; the velocities are slope/alpha
    half: tuple[TauImpact, ...]  # inside the first half period
    mismatch: float  # largest |y_i(1)|, below `tolerance`
    drift: float  # largest relative change of the energy at the end of a flight
    tolerance: float  # of the matching
    integrator_tolerance: float  # relative and absolute
    integrator: str  # name of the method of `scipy.integrate.solve_ivp`
    corrections: int  # their number

    @property
    def h(self) -> float:
        """Energy by the paper's Eq. (8), with the prefactor 1/(2 alpha^2): y'(-1) M y'(-1)/(2 alpha^2)."""
        return float(self.slope @ self.system.mass @ self.slope) / (2.0 * self.quarter_period**2)

    @property
    def velocities(self) -> np.ndarray:
        """Velocities (n,) at time 0, where u = 0."""
        return self.slope / self.quarter_period

    @property
    def impacts(self) -> list[tuple[float, str, float]]:
        """Impacts over a period in order of time: time, contact, speed of approach.

        The second half period is the first one reversed in time, with u -> -u. An impact at t returns at 4 alpha - t on the other side.
        """
        alpha = self.quarter_period
        letters, other = self.system.modes.contact_letters, self.system.modes.contact_opposite
        first = [(alpha * (1.0 + impact.tau), impact.contact, impact.speed) for impact in self.half]
        second = [(4.0 * alpha - time, letters[other[letters.index(letter)]], speed) for time, letter, speed in reversed(first)]
        return first + second


def solve_nonsmooth_time(
    system: ImpactSystem,
    quarter_period: float,
    velocities: ArrayLike,
    *,
    tolerance: float = TOLERANCE,
    integrator_tolerance: float | None = None,
    integrator: str = "RK45",
) -> NonsmoothTimeOrbit:
    """Find an orbit with u = 0 at time 0 and half a period later, at a fixed quarter period.

    Parameters
    ----------
    system : ImpactSystem
        Conservative, with stops of equal gaps.
    quarter_period : float
        alpha > 0.
    velocities : (n,) array_like
        Guess of u'(0).
    tolerance : float
        Largest |y_i(1)| of a solution, in units of displacement; `LEAST_TOLERANCE` or more.
    integrator_tolerance : float, optional
        Relative and absolute, by default a hundredth of `tolerance`. The paper does not give it.
    integrator : str
        Method of `scipy.integrate.solve_ivp`.

    Returns
    -------
    NonsmoothTimeOrbit

    Raises
    ------
    ValueError
        If the method does not apply to the system, or a number is out of range.
    NotMatched
        If the end is not matched, or the integrator fails or penetrates a stop.

    References
    ----------
    Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Eqs. (3) and (5)-(8). The transformation is Pilipchuk's.

    Notes
    -----
    The paper does not say how shooting corrects its start; here it is Newton's method with forward differences. The result can be another
    orbit than the guess if orbits are close, or if the integrator misses two impacts in one step. `check_impacts` detects this.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> orbit = solve_nonsmooth_time(vibro_impact_nes(), 1.7, [1.4, 1.0])
    >>> round(orbit.h, 4), [impact.contact for impact in orbit.half], orbit.mismatch < orbit.tolerance
    (0.5887, ['+'], True)
    """
    reason = why_not(system)
    if reason is not None:
        raise ValueError(f"the nonsmooth time transformation needs an undamped, elastic system with odd symmetry: {reason}")
    quarter_period = _positive(quarter_period, "quarter_period")
    tolerance = _positive(tolerance, "tolerance")
    if tolerance < LEAST_TOLERANCE:
        raise ValueError(f"tolerance is {LEAST_TOLERANCE:g} or more, because of rounding; received {tolerance:g}")
    fine = 0.01 * tolerance if integrator_tolerance is None else _positive(integrator_tolerance, "integrator_tolerance")
    fine = max(fine, 100.0 * float(np.finfo(float).eps))  # the integrator's own least
    n = system.degrees_of_freedom
    slope = quarter_period * checked_state(system, np.zeros(n), velocities)[n:]
    if not np.any(slope):
        raise ValueError("velocities are all zero: expected those of an orbit")

    shot = _shoot(system, quarter_period, slope, integrator, fine)
    least, idle = math.inf, 0
    for corrections in range(_CORRECTIONS + 1):
        mismatch = float(np.max(np.abs(shot.end)))
        idle = idle + 1 if mismatch >= least else 0
        least = min(least, mismatch)
        if mismatch < tolerance:
            if not shot.impacts:
                raise NotMatched("shooting converged to a motion without impacts: expected a closer guess")
            return NonsmoothTimeOrbit(
                system, quarter_period, slope, tuple(shot.impacts), mismatch, shot.drift, tolerance, fine, integrator, corrections
            )
        if corrections == _CORRECTIONS:
            break
        if idle >= _IDLE and least < _NEAR:
            raise Stagnates(
                f"shooting stagnates at a mismatch of {least:.1e}, not below {tolerance:.1e}: the last {_IDLE} corrections do not reduce "
                "it; expected a larger tolerance"
            )
        step = math.sqrt(fine) * float(np.linalg.norm(slope))
        gradient = np.empty((n, n))
        for j in range(n):
            moved = slope.copy()
            moved[j] += step
            gradient[:, j] = (_shoot(system, quarter_period, moved, integrator, fine).end - shot.end) / step
        try:
            slope = slope - np.linalg.solve(gradient, shot.end)
        except np.linalg.LinAlgError:
            raise NotMatched(f"shooting stagnates at a mismatch of {mismatch:.1e}: the end does not depend on the start") from None
        if not np.all(np.isfinite(slope)):
            raise NotMatched(f"shooting diverged from a mismatch of {mismatch:.1e}")
        shot = _shoot(system, quarter_period, slope, integrator, fine)
    raise NotMatched(f"{_CORRECTIONS} corrections leave a mismatch of {mismatch:.1e}, not below {tolerance:.1e}: expected a closer guess")


def _positive(value: float, name: str) -> float:
    value = checked_number(value, name)
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} is a finite number above 0; received {value:g}")
    return value


def _shoot(system: ImpactSystem, alpha: float, slope: np.ndarray, integrator: str, rtol: float) -> Shot:
    """Integrate Eq. (7) from y(-1) = 0, y'(-1) = slope to tau = 1."""
    from scipy.integrate import solve_ivp

    n = len(slope)
    pull = -(alpha**2) * np.linalg.solve(system.mass, system.stiffness)

    def motion(tau: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[n:], pull @ state[:n]])

    modes = system.modes
    rows = (modes.contacts.gap @ modes.from_state)[:, :n] * modes.contacts.side[:, None]
    bounds = modes.contacts.side * modes.contacts.bound

    def distance(row: np.ndarray, bound: float) -> Callable[[float, np.ndarray], float]:
        def event(tau: float, state: np.ndarray) -> float:
            return float(bound - row @ state[:n])

        setattr(event, "terminal", True)  # noqa: B010 - scipy reads it, the type of a function lacks it
        setattr(event, "direction", -1.0)  # noqa: B010
        return event

    events = [distance(row, bound) for row, bound in zip(rows, bounds, strict=True)]
    state = np.concatenate([np.zeros(n), slope])
    energy = _energy(system, state, alpha)
    tau, drift = -1.0, 0.0
    impacts: list[TauImpact] = []
    for _ in range(_FLIGHTS):
        found = solve_ivp(motion, (tau, 1.0), state, method=integrator, rtol=rtol, atol=rtol, events=events)
        if not found.success:
            raise NotMatched(f"the integrator failed: {found.message}")
        passed = float(np.max(rows @ found.y[:n] - bounds[:, None]))
        if passed > _OUTSIDE:
            raise NotMatched(f"the integrator penetrated a stop by {passed:.1e} between two steps: expected a smaller tolerance")
        state = found.y[:, -1]
        drift = max(drift, abs(_energy(system, state, alpha) / energy - 1.0))
        contact = next((k for k, times in enumerate(found.t_events) if times.size), None)
        if contact is None:
            return Shot(state[:n], impacts, drift)
        at = float(found.t_events[contact][0])
        if at - tau < _BETWEEN:
            raise NotMatched(f"the integrator missed a flight at tau = {at:.6g} in one step: expected a smaller tolerance")
        tau, state = at, found.y_events[contact][0]
        impacts.append(TauImpact(tau, modes.contact_letters[contact], float(rows[contact] @ state[n:]) / alpha))
        state = np.concatenate([state[:n], restitute(system, modes.contact_letters[contact], state[n:])])
    raise NotMatched(f"more than {_FLIGHTS} impacts in half a period")


def _energy(system: ImpactSystem, state: np.ndarray, alpha: float) -> float:
    """Energy of a state (y, y')."""
    n = len(state) // 2
    return float(system.energy(state[:n], state[n:] / alpha))


def check_impacts(found: NonsmoothTimeOrbit, expected: Sequence[tuple[float, str]]) -> None:
    """Check that an orbit has the expected impacts, given by time and contact, in the first half period; NotMatched if it is another."""
    alpha = found.quarter_period
    if [impact.contact for impact in found.half] != [contact for _, contact in expected]:
        raise NotMatched(f"this is another orbit, with {len(found.half)} impacts in half a period instead of {len(expected)}, or elsewhere")
    away = max(abs(alpha * (1.0 + impact.tau) - time) for impact, (time, _) in zip(found.half, expected, strict=True))
    if away > _AWAY * alpha:
        raise NotMatched(f"this is another orbit: its impacts are up to {away:.2g} earlier or later")


@dataclass(frozen=True)
class NonsmoothTime(Method):
    """Orbits and their energies by shooting in nonsmooth time, without stability."""

    name = "nonsmooth time (the paper's)"
    setting = "matched to"

    def prepare(self, task: Task, setting: float | None) -> Work:
        assert isinstance(task, OrbitTask) and setting is not None
        velocities = task.start_velocities(task.guess())
        times = np.cumsum(task.problem.flight_times(task.unknowns()))[:-1]
        return Work(lambda: _answer(task, velocities, times, setting))


def _answer(task: OrbitTask, velocities: np.ndarray, times: np.ndarray, tolerance: float) -> Answer:
    """The orbit, if it has the inner impacts of the task at times (k,)."""
    found = solve_nonsmooth_time(task.system, task.alpha, velocities, tolerance=tolerance)
    inner = list(zip(times.tolist(), task.sequence, strict=True))
    expected = inner
    if task.problem.quarters == 1:
        # The second quarter is the first one reversed in time, with an impact between them at a stop end.
        middle = [(task.alpha, task.ends[1][-1])] if task.ends[1].startswith("stop") else []
        expected = inner + middle + [(2.0 * task.alpha - time, contact) for time, contact in reversed(inner)]
    check_impacts(found, expected)
    own = np.array([task.alpha * (1.0 + impact.tau) for impact in found.half[: len(inner)]])
    return Answer(orbits=(OrbitAnswer(task.alpha, found.h, found.velocities, own),))
