"""Periodic orbits by the nonsmooth time transformation and shooting: the method of the reference paper, as it stands there.

With u(t) = e(t/alpha) y(tau(t/alpha)), tau the triangular sine and e its derivative, a periodic orbit that passes u = 0 twice a period
is a two-point problem over half its period, -1 <= tau <= 1, at a fixed quarter period alpha:

    y'' = -alpha^2 M^-1 K y,   y(-1) = y(1) = 0,   impacts where a gap closes

It is solved as an initial-value problem from tau = -1 whose end is matched: |y_i(1)| < tolerance. The answer is approximate: it
has the error of the integrator, and one of the size of the tolerance in the orbit. `bvp.multipoint` solves the same orbits exactly; this
method is here to be compared with, and for nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.checks import number
from bvp.impact import checked_state, restitute

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from bvp.system import ImpactSystem

__all__ = ["LEAST_TOLERANCE", "TOLERANCE", "NonsmoothTimeOrbit", "NotMatched", "StandsStill", "why_not", "solve_nonsmooth_time"]

TOLERANCE = 1e-6
"""The smaller of the two matching tolerances that the paper names."""

LEAST_TOLERANCE = 1e-13
"""The least that is asked for: displacements of size 1 round to some 1e-15 over a half period, and shooting would not end below that."""

_CORRECTIONS = 25
_NEAR = 1e-4  # below this mismatch Newton's method is at an orbit, in units of displacement ...
_IDLE = 4  # ... and so many corrections in a row that bring it no lower are the last
_FLIGHTS = 1000
_BETWEEN = 1e-12  # impacts nearer to each other in tau are one that the integrator has met twice
_OUTSIDE = 1e-6  # a gap passed by more than this, in units of displacement, at one of the integrator's steps


class NotMatched(RuntimeError):
    """Shooting did not come to an orbit; the message says how far it came."""


class StandsStill(NotMatched):
    """Shooting came to an orbit, and further corrections match its end no better: the tolerance asks for more than the integrator has."""


class TauImpact(NamedTuple):
    """An impact inside the half period: tau in (-1, 1), the contact's letter, the speed of approach along the gap coordinate."""

    tau: float
    contact: str
    speed: float


class Flight(NamedTuple):
    """A free flight from one tau to another, and its state (y, y') (2n,) at any tau between them, None where it was not kept."""

    first: float
    last: float
    state: Callable[[Any], np.ndarray] | None


class Shot(NamedTuple):
    """An initial-value problem from tau = -1 to 1: displacements (n,) there, impacts, flights, largest relative change of energy."""

    end: np.ndarray
    impacts: list[TauImpact]
    flights: list[Flight]
    drift: float


def why_not(system: ImpactSystem) -> str | None:
    """Why the method has no orbits of a system; None where it has."""
    reason = system.why_not_conservative()
    if reason is not None:
        return reason
    if not system.has_odd_symmetry:
        return "the method continues an orbit over its half period by u -> -u, and the gaps of a stop are not equal"
    return None


@dataclass(frozen=True, eq=False)
class NonsmoothTimeOrbit:
    """A periodic orbit that shooting in nonsmooth time has matched.

    Parameters
    ----------
    system : ImpactSystem
    quarter_period : float
        alpha, as it was given.
    slope : (n,) float
        y'(-1), the derivative with respect to tau; the velocities are slope/alpha.
    half : tuple of TauImpact
        Impacts inside the half period.
    mismatch : float
        Largest |y_i(1)|, below `tolerance`.
    drift : float
        Largest relative change of the energy at the ends of the flights.
    tolerance, integrator_tolerance : float
        That of the matching, and the relative and absolute one of the integrator.
    integrator : str
        Name of the method of `scipy.integrate.solve_ivp`.
    corrections : int
        Corrections that shooting made.
    """

    system: ImpactSystem
    quarter_period: float
    slope: np.ndarray
    half: tuple[TauImpact, ...]
    mismatch: float
    drift: float
    tolerance: float
    integrator_tolerance: float
    integrator: str
    corrections: int

    @property
    def h(self) -> float:
        """Energy by the paper's Eq. (8), with the prefactor 1/(2 alpha^2): y'(-1) M y'(-1)/(2 alpha^2)."""
        return float(self.slope @ self.system.mass @ self.slope) / (2.0 * self.quarter_period**2)

    @property
    def velocities(self) -> np.ndarray:
        """Velocities (n,) where the orbit passes u = 0, at time 0."""
        return self.slope / self.quarter_period

    @property
    def impacts(self) -> list[tuple[float, str, float]]:
        """Impacts over a period in order of time: time, contact, speed of approach. The second half is the first one backward, u -> -u,
        so that each impact comes again at the time 4 alpha - t on the opposite side."""
        alpha = self.quarter_period
        letters, other = self.system.modes.contact_letters, self.system.modes.contact_opposite
        first = [(alpha * (1.0 + impact.tau), impact.contact, impact.speed) for impact in self.half]
        second = [(4.0 * alpha - time, letters[other[letters.index(letter)]], speed) for time, letter, speed in reversed(first)]
        return first + second

    @cached_property
    def _flights(self) -> list[Flight]:
        return _shoot(self.system, self.quarter_period, self.slope, self.integrator, self.integrator_tolerance, keep=True).flights

    def sample(self, times: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (m, n) at any times (m,), Eq. (5); at an impact the velocity is the one after it."""
        alpha, n = self.quarter_period, len(self.slope)
        x = np.remainder(np.asarray(times, dtype=float) / alpha, 4.0)
        backward = x > 2.0
        tau = np.where(backward, 3.0 - x, x - 1.0)  # the triangular sine, its zero at the time alpha
        flights = self._flights
        begins = np.array([flight.first for flight in flights])
        # In the second half tau runs backward: the flight after an impact is there the one before it.
        index = np.where(backward, np.searchsorted(begins, tau, side="left"), np.searchsorted(begins, tau, side="right")) - 1
        states = np.empty((len(tau), 2 * n))
        for i, flight in enumerate(flights):
            mine = np.clip(index, 0, None) == i
            if np.any(mine):
                assert flight.state is not None
                states[mine] = np.asarray(flight.state(np.clip(tau[mine], flight.first, flight.last))).T
        displacements = np.where(backward[:, None], -1.0, 1.0) * states[:, :n]
        return displacements, states[:, n:] / alpha


def solve_nonsmooth_time(
    system: ImpactSystem,
    quarter_period: float,
    velocities: ArrayLike,
    *,
    tolerance: float = TOLERANCE,
    integrator_tolerance: float | None = None,
    integrator: str = "RK45",
) -> NonsmoothTimeOrbit:
    """Find an orbit that passes u = 0 at the time 0 and half a period later, at a fixed quarter period.

    Parameters
    ----------
    system : ImpactSystem
        Conservative, with stops of equal gaps.
    quarter_period : float
        alpha > 0.
    velocities : (n,) array_like
        A guess of u'(0).
    tolerance : float
        The end is matched where every |y_i(1)| is below it, in units of displacement; `LEAST_TOLERANCE` or more.
    integrator_tolerance : float, optional
        Relative and absolute tolerance of the integrator, by default a hundredth of the other one; the paper names none.
    integrator : str
        Method of `scipy.integrate.solve_ivp`.

    Returns
    -------
    NonsmoothTimeOrbit

    Raises
    ------
    ValueError
        For a system that the method has no orbits of, and for numbers out of range.
    NotMatched
        When the end is not matched, or the integrator fails or passes a stop.

    References
    ----------
    Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Eqs. (3) and (5)-(8). The transformation is Pilipchuk's.

    Notes
    -----
    The paper does not say how shooting corrects its start: here by Newton's method with forward differences. Nor is the orbit the one
    that was guessed: where orbits lie near each other, or the integrator passes two impacts in one step, it is another one, and the caller
    has to look.

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
        raise ValueError(f"tolerance is {LEAST_TOLERANCE:g} or more, as rounding leaves less to no orbit; received {tolerance:g}")
    fine = 0.01 * tolerance if integrator_tolerance is None else _positive(integrator_tolerance, "integrator_tolerance")
    fine = max(fine, 100.0 * float(np.finfo(float).eps))  # the integrator's own least
    n = system.degrees_of_freedom
    slope = quarter_period * checked_state(system, np.zeros(n), velocities)[n:]
    if not np.any(slope):
        raise ValueError("velocities are all zero: expected a guess of an orbit that moves")

    shot = _shoot(system, quarter_period, slope, integrator, fine)
    least, idle = math.inf, 0
    for corrections in range(_CORRECTIONS + 1):
        mismatch = float(np.max(np.abs(shot.end)))
        idle = idle + 1 if mismatch >= least else 0
        least = min(least, mismatch)
        if mismatch < tolerance:
            if not shot.impacts:
                raise NotMatched("shooting ended on a motion without impacts: expected a nearer guess")
            return NonsmoothTimeOrbit(
                system, quarter_period, slope, tuple(shot.impacts), mismatch, shot.drift, tolerance, fine, integrator, corrections
            )
        if corrections == _CORRECTIONS:
            break
        if idle >= _IDLE and least < _NEAR:
            raise StandsStill(
                f"shooting stands still at a mismatch of {least:.1e}, not below {tolerance:.1e}: the last {_IDLE} corrections bring it no "
                "lower; expected a larger tolerance"
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
            raise NotMatched(f"the end does not change with the start: shooting stands still at a mismatch of {mismatch:.1e}") from None
        if not np.all(np.isfinite(slope)):
            raise NotMatched(f"shooting diverged from a mismatch of {mismatch:.1e}")
        shot = _shoot(system, quarter_period, slope, integrator, fine)
    raise NotMatched(f"{_CORRECTIONS} corrections leave a mismatch of {mismatch:.1e}, not below {tolerance:.1e}: expected a nearer guess")


def _positive(value: float, name: str) -> float:
    value = number(value, name)
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} is a finite number above 0; received {value:g}")
    return value


def _shoot(
    system: ImpactSystem, alpha: float, slope: np.ndarray, integrator: str, rtol: float, keep: bool = False
) -> Shot:
    """Integrate Eq. (7) from y(-1) = 0, y'(-1) = slope to tau = 1; with `keep`, every flight's state at any tau."""
    from scipy.integrate import solve_ivp

    n = len(slope)
    pull = -(alpha**2) * np.linalg.solve(system.mass, system.stiffness)

    def motion(tau: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[n:], pull @ state[:n]])

    modes = system.modes
    rows = (modes.contact_gap @ modes.from_state)[:, :n] * modes.contact_side[:, None]
    bounds = modes.contact_side * modes.contact_bound

    def distance(row: np.ndarray, bound: float) -> Callable[[float, np.ndarray], float]:
        def event(tau: float, state: np.ndarray) -> float:
            return float(bound - row @ state[:n])

        setattr(event, "terminal", True)  # noqa: B010 - the integrator's way of being told, unknown to the type of a function
        setattr(event, "direction", -1.0)  # noqa: B010
        return event

    events = [distance(row, bound) for row, bound in zip(rows, bounds, strict=True)]
    state = np.concatenate([np.zeros(n), slope])
    energy = _energy(system, state, alpha)
    tau, drift = -1.0, 0.0
    impacts: list[TauImpact] = []
    flights: list[Flight] = []
    for _ in range(_FLIGHTS):
        found = solve_ivp(motion, (tau, 1.0), state, method=integrator, rtol=rtol, atol=rtol, events=events, dense_output=keep)
        if not found.success:
            raise NotMatched(f"the integrator failed: {found.message}")
        passed = float(np.max(rows @ found.y[:n] - bounds[:, None]))
        if passed > _OUTSIDE:
            raise NotMatched(f"the integrator passed a stop by {passed:.1e} between two of its steps: expected a smaller tolerance")
        flights.append(Flight(tau, float(found.t[-1]), found.sol))
        state = found.y[:, -1]
        drift = max(drift, abs(_energy(system, state, alpha) / energy - 1.0))
        contact = next((k for k, times in enumerate(found.t_events) if times.size), None)
        if contact is None:
            return Shot(state[:n], impacts, flights, drift)
        at = float(found.t_events[contact][0])
        if at - tau < _BETWEEN:
            raise NotMatched(f"the integrator passed a whole flight at tau = {at:.6g} in one step: expected a smaller tolerance")
        tau, state = at, found.y_events[contact][0]
        letter = modes.contact_letters[contact]
        impacts.append(TauImpact(tau, letter, float(rows[contact] @ state[n:]) / alpha))
        state = np.concatenate([state[:n], restitute(system, letter, state[n:])])
    raise NotMatched(f"more than {_FLIGHTS} impacts in half a period")


def _energy(system: ImpactSystem, state: np.ndarray, alpha: float) -> float:
    """Energy of a state (y, y')."""
    n = len(state) // 2
    return float(system.energy(state[:n], state[n:] / alpha))
