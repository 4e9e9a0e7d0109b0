"""Shooting for the orbit at a given quarter period on `scipy.integrate.solve_ivp`: what careful use of an integrator gives.

The unknowns are the velocities at the origin. The motion is integrated with its variational equations, with events on the gap and the
saltation matrix at each impact, so that Newton's matrix and the multipliers are as good as the integration. The last flight of the
segment runs to its end without events; there the condition of the end is asked for. No bound stands behind the events: an impact between
two steps of the integrator is missed. Its steps are kept to a part of the fastest mode's period, as a careful user would: without that,
it loses impacts of these orbits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from bvp.system import ImpactSystem
from saltus.bench.shooting import ShootingError

__all__ = ["Integrator", "PeriodShooting", "Shot"]

CORRECTIONS = 15
LATEST = 100.0

STEPS = 32
"""Steps of the integrator in a period of the fastest mode, at least. With 16, DOP853 passes over an impact of the tasks that is shallow."""


class Integrator:
    """Flights and impacts of a system with one stop, by an integrator of scipy.

    Parameters
    ----------
    system : ImpactSystem
    method : str
        A method of `solve_ivp`.
    rtol : float
        Relative and absolute tolerance.
    """

    def __init__(self, system: ImpactSystem, method: str, rtol: float) -> None:
        n = system.degrees_of_freedom
        (stop,) = system.stops
        self.system, self.method, self.rtol, self.n = system, method, rtol, n
        inverse = np.linalg.inv(system.mass)
        self.matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ system.stiffness, -inverse @ system.damping]])
        self.longest_step = 2.0 * np.pi / (STEPS * float(np.max(np.abs(np.linalg.eigvals(self.matrix)))))
        self.gap = np.array(stop.gap)
        self.bounds = (float(stop.lower), float(stop.upper))
        push = inverse @ self.gap
        self.impact = np.eye(2 * n)
        self.impact[n:, n:] -= (1.0 + stop.restitution) / (self.gap @ push) * np.outer(push, self.gap)

    def flight(self, y: np.ndarray, longest: float, events: bool = True) -> tuple[float, np.ndarray, bool]:
        """Columns y (2 n, m), of which the first is the state, at the next impact (True) or after `longest` (False)."""
        shape, matrix, gap, n = y.shape, self.matrix, self.gap, self.n
        low, high = self.bounds

        def motion(t: float, x: np.ndarray) -> np.ndarray:
            return (matrix @ x.reshape(shape)).ravel()

        def lower(t: float, x: np.ndarray) -> float:
            return float(gap @ x[:: shape[1]][:n] - low)

        def upper(t: float, x: np.ndarray) -> float:
            return float(high - gap @ x[:: shape[1]][:n])

        for event in (lower, upper):
            event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        options: dict[str, Any] = {"max_step": self.longest_step}
        if self.method in ("Radau", "BDF"):
            options["jac"] = np.kron(matrix, np.eye(shape[1]))
        elif self.method == "LSODA":
            whole = np.kron(matrix, np.eye(shape[1]))
            options["jac"] = lambda t, x: whole
        found = solve_ivp(
            motion, (0.0, longest), y.ravel(), method=self.method, rtol=self.rtol, atol=self.rtol,
            events=(lower, upper) if events else None, **options,
        )  # fmt: skip
        if not found.success:
            raise ShootingError(f"the integration failed: {found.message}")
        return float(found.t[-1]), found.y[:, -1].reshape(shape), found.status == 1

    def strike(self, y: np.ndarray) -> np.ndarray:
        """The columns after an impact: the state by restitution, the others by the saltation matrix."""
        before = y[:, 0]
        after = self.impact @ before
        coming = self.matrix @ before
        jump = self.matrix @ after - self.impact @ coming
        row = np.concatenate([self.gap, np.zeros(self.n)])
        out = (self.impact + np.outer(jump, row) / (row @ coming)) @ y
        out[:, 0] = after
        return out


@dataclass(frozen=True, eq=False)
class Shot:
    """An orbit: velocities (n,) at the origin, times of the inner impacts, corrections made."""

    velocities: np.ndarray
    times: np.ndarray
    corrections: int


class PeriodShooting:
    """Orbits from the origin to an end, with a number of inner impacts, at a given quarter period.

    Parameters
    ----------
    integrator : Integrator
    end : str
        "origin", "rest", "stop+" or "stop-".
    inner : int
        Number of inner impacts.
    """

    def __init__(self, integrator: Integrator, end: str, inner: int) -> None:
        self.integrator, self.end, self.inner = integrator, end, inner
        n = integrator.n
        self.quarters = 2 if end == "origin" else 1
        self.condition = np.zeros((n, 2 * n))
        self.target = np.zeros(n)
        if end == "origin":
            self.condition[:, :n] = np.eye(n)
        elif end == "rest":
            self.condition[:, n:] = np.eye(n)
        else:
            # On the stop, with the velocities along M^-1 c: their components across it vanish.
            push = np.linalg.inv(integrator.system.mass) @ integrator.gap
            self.condition[0, :n] = integrator.gap
            self.target[0] = integrator.bounds[end.endswith("+")]
            across = np.linalg.svd(push[None, :])[2][1:]
            self.condition[1:, n:] = across

    def shoot(self, velocities: np.ndarray, alpha: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the end's condition lacks (n,), its derivative (n, n), and the times of the inner impacts."""
        integrator, n = self.integrator, self.integrator.n
        y = np.zeros((2 * n, 1 + n))
        y[n:, 0] = velocities
        y[n:, 1:] = np.eye(n)
        now, times = 0.0, []
        for _ in range(self.inner):
            duration, y, hit = integrator.flight(y, LATEST)
            if not hit:
                raise ShootingError(f"no impact in a time of {LATEST:g}")
            y = integrator.strike(y)
            now += duration
            times.append(now)
        rest = self.quarters * alpha - now
        if rest <= 0.0:
            raise ShootingError("the impacts come too late")
        _, y, _ = integrator.flight(y, rest, events=False)
        return self.condition @ y[:, 0] - self.target, self.condition @ y[:, 1:], np.array(times)

    def solve(self, velocities: np.ndarray, alpha: float) -> Shot:
        """The orbit near start velocities.

        Raises
        ------
        ShootingError
            When the corrections do not reach the tolerance of the integrator.
        """
        v = np.array(velocities, dtype=float)
        last = np.inf
        for corrections in range(1, CORRECTIONS + 1):
            lack, matrix, times = self.shoot(v, alpha)
            change = np.linalg.solve(matrix, lack)
            v = v - change
            size = float(np.linalg.norm(change) / np.linalg.norm(v))
            if size <= self.integrator.rtol or (size < 1e-3 and size >= 0.5 * last):
                # Below the tolerance, or no smaller for another correction: the integrator does not give more.
                return Shot(v, times, corrections)
            last = size
        raise ShootingError(f"{CORRECTIONS} corrections do not converge (the last is {size:.1e})")

    def monodromy(self, velocities: np.ndarray, duration: float) -> np.ndarray:
        """Derivative (2 n, 2 n) of the motion over a duration."""
        integrator, n = self.integrator, self.integrator.n
        y = np.zeros((2 * n, 1 + 2 * n))
        y[n:, 0] = velocities
        y[:, 1:] = np.eye(2 * n)
        left = duration
        while True:
            passed, y, hit = integrator.flight(y, left)
            if not hit:
                return y[:, 1:]
            y = integrator.strike(y)
            left -= passed
            if left <= 0.0:
                return y[:, 1:]
