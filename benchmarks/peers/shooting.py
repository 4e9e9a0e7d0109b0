"""Plain shooting continuation of the vibro-impact sink with `scipy.integrate.solve_ivp`, as a user would write it in an afternoon.

The unknowns are the two velocities at the origin. The equation is that the momentum vanishes at impact k + 1, which reverses the orbit.
DOP853 integrates the motion with an event on the gap, and a loop applies the restitution. The Jacobian is a finite difference at the
predicted point, with Broyden's updates; steps are pseudo-arclength along a secant. The multipliers come from finite differences of the
period map in the four initial values. The integrator misses an impact between two of its steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

__all__ = ["PlainShooting", "ShootingError", "ShotOrbit"]

_LONGEST = 100.0


class ShootingError(RuntimeError):
    """The iteration did not converge, or there was no impact."""


@dataclass(frozen=True, eq=False)
class ShotOrbit:
    """An orbit found by shooting: velocities (2,) at the origin, time to impact k + 1, number of corrections."""

    velocities: np.ndarray
    duration: float
    corrections: int


class PlainShooting:
    """Orbits from the origin through `inner` impacts to a stop.

    Parameters
    ----------
    mu, sigma : float
        Mass and coupling of the sink, as in `bvp.system.vibro_impact_nes`.
    inner : int
        Number of inner impacts.
    rtol : float
        Relative and absolute tolerance of the integrator.
    """

    def __init__(self, mu: float, sigma: float, inner: int, rtol: float) -> None:
        self.mu = mu
        self.sigma = sigma
        self.inner = inner
        self.rtol = rtol
        self.tolerance = 10.0 * rtol
        self.difference = math.sqrt(rtol)

        def motion(t, x):
            force = sigma * (x[0] - x[1])
            return [x[2], x[3], -force / mu, force - x[1]]

        def gap(t, x):
            return 1.0 - abs(x[0] - x[1])

        self._motion = motion
        event: Any = gap
        event.terminal = True
        event.direction = -1.0
        self._gap = event

    def flight(self, x: np.ndarray, longest: float = _LONGEST) -> tuple[float, np.ndarray, bool]:
        """Time and state (4,) at the next impact, True; or after `longest`, False."""
        found = solve_ivp(self._motion, (0.0, longest), x, method="DOP853", rtol=self.rtol, atol=self.rtol, events=self._gap)
        if not found.success:
            raise ShootingError(f"the integration failed: {found.message}")
        if found.t_events[0].size:
            return float(found.t_events[0][0]), found.y_events[0][0], True
        return longest, found.y[:, -1], False

    def impact(self, x: np.ndarray) -> np.ndarray:
        """State (4,) after an elastic impact: the momentum is conserved, the relative velocity changes its sign."""
        relative = x[2] - x[3]
        total = 1.0 + self.mu
        return np.array([x[0], x[1], x[2] - 2.0 * relative / total, x[3] + 2.0 * self.mu * relative / total])

    def shoot(self, velocities: np.ndarray) -> tuple[float, float]:
        """Momentum at impact k + 1, and its time."""
        x = np.array([0.0, 0.0, velocities[0], velocities[1]])
        elapsed = 0.0
        for i in range(self.inner + 1):
            if i > 0:
                x = self.impact(x)
            duration, x, hit = self.flight(x)
            if not hit:
                raise ShootingError(f"no impact in a time of {_LONGEST:g}")
            elapsed += duration
        return float(self.mu * x[2] + x[3]), elapsed

    def gradient(self, velocities: np.ndarray, value: float) -> np.ndarray:
        """Forward differences (2,) of the momentum."""
        out = np.empty(2)
        step = self.difference * float(np.linalg.norm(velocities))
        for j in range(2):
            moved = velocities.copy()
            moved[j] += step
            out[j] = (self.shoot(moved)[0] - value) / step
        return out

    def correct(self, guess: np.ndarray, tangent: np.ndarray) -> ShotOrbit:
        """Return the orbit on the line through the guess, perpendicular to the tangent.

        Raises
        ------
        ShootingError
            If 15 corrections do not reach the tolerance.
        """
        y = guess.copy()
        value, duration = self.shoot(y)
        matrix = np.vstack([self.gradient(y, value), tangent])
        for corrections in range(1, 16):
            update = np.linalg.solve(matrix, [-value, -tangent @ (y - guess)])
            y = y + update
            old = value
            value, duration = self.shoot(y)
            if np.linalg.norm(update) <= self.tolerance * np.linalg.norm(y):
                return ShotOrbit(y, duration, corrections)
            matrix[0] += (value - old - matrix[0] @ update) / (update @ update) * update
        raise ShootingError(f"15 corrections do not converge (the last is {np.linalg.norm(update):.1e})")

    def next_orbit(self, older: ShotOrbit, last: ShotOrbit, ds: float) -> ShotOrbit:
        """Return the orbit at ds along the secant through two orbits; ds is a fraction of the norm of the velocities."""
        secant = last.velocities - older.velocities
        secant /= np.linalg.norm(secant)
        return self.correct(last.velocities + ds * float(np.linalg.norm(last.velocities)) * secant, secant)

    def energy(self, velocities: np.ndarray) -> float:
        """h of an orbit that starts at the origin."""
        return float(0.5 * (self.mu * velocities[0] ** 2 + velocities[1] ** 2))

    def period_map(self, x: np.ndarray, period: float) -> np.ndarray:
        """State (4,) after a period."""
        left = period
        while True:
            duration, x, hit = self.flight(x, left)
            left -= duration
            if not hit:
                return x
            x = self.impact(x)
            if left <= 0.0:
                return x

    def monodromy(self, orbit: ShotOrbit) -> np.ndarray:
        """Forward differences (4, 4) of the period map; its eigenvalues are the multipliers."""
        start = np.array([0.0, 0.0, *orbit.velocities])
        period = 4.0 * orbit.duration
        image = self.period_map(start, period)
        scale = (1.0, 1.0, *2 * [float(np.linalg.norm(orbit.velocities))])
        columns = []
        for j in range(4):
            moved = start.copy()
            moved[j] += self.difference * scale[j]
            columns.append((self.period_map(moved, period) - image) / (self.difference * scale[j]))
        return np.array(columns).T
