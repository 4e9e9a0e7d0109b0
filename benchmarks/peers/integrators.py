"""Shooting at a given quarter period on `scipy.integrate.solve_ivp`: careful use of an integrator, one method for each integrator.

The unknowns are the velocities at the origin. The motion is integrated with its variational equations, with events on the gap and the
saltation matrix at each impact. So Newton's matrix and the multipliers are as accurate as the integration. The last flight runs to its end
without events, where the end condition is evaluated. Nothing guarantees that the events are complete: an impact between two steps of the
integrator is missed. A careful user therefore limits the steps to a part of the fastest period; otherwise impacts of these orbits are lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.peers.shooting import ShootingError
from benchmarks.speed_error.methods import Answer, Method, OrbitAnswer, Task, Work
from benchmarks.speed_error.tasks import LocateTask, OrbitTask, RunTask, Wanted
from bvp.multipliers import sort_multipliers
from bvp.system import ImpactSystem

__all__ = ["INTEGRATORS", "Integrator", "PeriodShooting", "Shooting", "Shot"]

CORRECTIONS = 15
"""Most corrections of Newton's method."""

LATEST = 100.0
"""Longest time without an impact."""

STEPS = 32
"""Least number of steps in a period of the fastest mode. With 16, DOP853 misses a shallow impact of the tasks."""


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
        self.restitution = np.eye(2 * n)
        self.restitution[n:, n:] -= (1.0 + stop.restitution) / (self.gap @ push) * np.outer(push, self.gap)

    def flight(self, y: np.ndarray, longest: float, events: bool = True) -> tuple[float, np.ndarray, bool]:
        """Integrate the columns y (2 n, m), the first being the state, to the next impact (True) or for `longest` (False)."""
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
            jacobian = np.kron(matrix, np.eye(shape[1]))
            options["jac"] = lambda t, x: jacobian
        found = solve_ivp(
            motion, (0.0, longest), y.ravel(), method=self.method, rtol=self.rtol, atol=self.rtol,
            events=(lower, upper) if events else None, **options,
        )  # fmt: skip
        if not found.success:
            raise ShootingError(f"the integration failed: {found.message}")
        return float(found.t[-1]), found.y[:, -1].reshape(shape), found.status == 1

    def impact(self, y: np.ndarray) -> np.ndarray:
        """Return the columns after an impact: the state by restitution, the others by the saltation matrix."""
        before = y[:, 0]
        after = self.restitution @ before
        coming = self.matrix @ before
        jump = self.matrix @ after - self.restitution @ coming
        row = np.concatenate([self.gap, np.zeros(self.n)])
        out = (self.restitution + np.outer(jump, row) / (row @ coming)) @ y
        out[:, 0] = after
        return out


@dataclass(frozen=True, eq=False)
class Shot:
    """An orbit: velocities (n,) at the origin, times of the inner impacts, number of corrections."""

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
            # On the stop, with the velocities along M^-1 c: the components across that direction vanish.
            push = np.linalg.inv(integrator.system.mass) @ integrator.gap
            self.condition[0, :n] = integrator.gap
            self.target[0] = integrator.bounds[end.endswith("+")]
            across = np.linalg.svd(push[None, :])[2][1:]
            self.condition[1:, n:] = across

    def shoot(self, velocities: np.ndarray, alpha: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residual (n,) of the end condition, its derivative (n, n), and the times of the inner impacts."""
        integrator, n = self.integrator, self.integrator.n
        y = np.zeros((2 * n, 1 + n))
        y[n:, 0] = velocities
        y[n:, 1:] = np.eye(n)
        now, times = 0.0, []
        for _ in range(self.inner):
            duration, y, hit = integrator.flight(y, LATEST)
            if not hit:
                raise ShootingError(f"no impact in a time of {LATEST:g}")
            y = integrator.impact(y)
            now += duration
            times.append(now)
        rest = self.quarters * alpha - now
        if rest <= 0.0:
            raise ShootingError("the impacts come too late")
        _, y, _ = integrator.flight(y, rest, events=False)
        return self.condition @ y[:, 0] - self.target, self.condition @ y[:, 1:], np.array(times)

    def solve(self, velocities: np.ndarray, alpha: float) -> Shot:
        """Solve for the orbit near start velocities.

        Raises
        ------
        ShootingError
            If the corrections do not reach the tolerance of the integrator.
        """
        v = np.array(velocities, dtype=float)
        last = np.inf
        for corrections in range(1, CORRECTIONS + 1):
            residual, matrix, times = self.shoot(v, alpha)
            change = np.linalg.solve(matrix, residual)
            v = v - change
            size = float(np.linalg.norm(change) / np.linalg.norm(v))
            if size <= self.integrator.rtol or (size < 1e-3 and size >= 0.5 * last):
                # Below the tolerance, or stagnating: the integrator is not more accurate.
                return Shot(v, times, corrections)
            last = size
        raise ShootingError(f"{CORRECTIONS} corrections do not converge (the last is {size:.1e})")

    def monodromy(self, velocities: np.ndarray, duration: float) -> np.ndarray:
        """Derivative (2 n, 2 n) of the flow over a duration, from u = 0."""
        integrator, n = self.integrator, self.integrator.n
        y = np.zeros((2 * n, 1 + 2 * n))
        y[n:, 0] = velocities
        y[:, 1:] = np.eye(2 * n)
        left = duration
        while True:
            passed, y, hit = integrator.flight(y, left)
            if not hit:
                return y[:, 1:]
            y = integrator.impact(y)
            left -= passed
            if left <= 0.0:
                return y[:, 1:]


_TARGET = {"SN": 2.0, "SB": -2.0}
"""Trace of the reduced half map, composed with u -> -u, at a fold and at a loss of symmetry."""


@dataclass(frozen=True)
class Shooting(Method):
    """Shooting with one of scipy's integrators.

    Parameters
    ----------
    name : str
    integrator : str
        A method of `solve_ivp`.
    """

    name: str
    integrator: str

    setting = "rtol"

    def does(self, task: Task) -> bool:
        return True

    def prepare(self, task: Task, setting: float | None) -> Work:
        assert setting is not None
        if isinstance(task, OrbitTask):
            integrator = Integrator(task.system, self.integrator, setting)
            velocities = task.start_velocities(task.guess())
            return Work(lambda: _orbit(task, integrator, velocities))
        if isinstance(task, RunTask):
            integrator = Integrator(task.system, self.integrator, setting)
            return Work(lambda: _simulate(task, integrator))
        assert isinstance(task, LocateTask)
        return Work(lambda: _locate(task, self.integrator, setting))


def _orbit(task: OrbitTask, integrator: Integrator, velocities: np.ndarray) -> Answer:
    method = PeriodShooting(integrator, task.ends[1], len(task.sequence))
    shot = method.solve(velocities, task.alpha)
    reduced = _reduced(integrator, shot.velocities, method.monodromy(shot.velocities, 4.0 * task.alpha))
    multipliers = sort_multipliers(np.linalg.eigvals(reduced))
    return Answer(orbits=(OrbitAnswer(task.alpha, _energy(integrator, shot.velocities), shot.velocities, shot.times, multipliers),))


def _reduced(integrator: Integrator, velocities: np.ndarray, monodromy: np.ndarray) -> np.ndarray:
    """The monodromy matrix at u = 0, reduced to the energy level across the flow, (2 n - 2, 2 n - 2)."""
    n = integrator.n
    start = np.concatenate([np.zeros(n), velocities])
    flow = integrator.matrix @ start
    slope = np.concatenate([np.zeros(n), integrator.system.mass @ velocities])
    columns = np.column_stack([flow / np.linalg.norm(flow), slope / np.linalg.norm(slope), np.eye(2 * n)])
    rest = np.linalg.qr(columns)[0][:, 2:]
    return rest.T @ monodromy @ rest


def _energy(integrator: Integrator, velocities: np.ndarray) -> float:
    return float(0.5 * velocities @ integrator.system.mass @ velocities)


def _simulate(task: RunTask, integrator: Integrator) -> Answer:
    n = integrator.n
    y = np.concatenate([np.zeros(n), task.velocities])[:, None]
    now = 0.0
    for impact in range(task.impacts):
        duration, y, hit = integrator.flight(y, 1e4)
        if not hit:
            raise ShootingError(f"no impact after impact {impact}")
        now += duration
        y = integrator.impact(y)
    system = integrator.system
    return Answer(task.impacts, ran=(now, y[:, 0], float(system.energy(y[:n, 0], y[n:, 0]))))


def _locate(task: LocateTask, method: str, rtol: float) -> Answer:
    return Answer(len(task.wanted), located={name: _special(wanted, method, rtol) for name, wanted in task.wanted})


def _special(wanted: Wanted, method: str, rtol: float) -> tuple[float, float]:
    """Quarter period and energy at which the trace of the half map has the value of a special point."""
    from scipy.optimize import brentq

    task = wanted.family
    integrator = Integrator(task.system, method, rtol)
    shooting = PeriodShooting(integrator, task.ends[1], len(task.sequence))
    velocities = task.start_velocities(task.unknowns())

    def trace(alpha: float) -> float:
        nonlocal velocities
        velocities = shooting.solve(velocities, alpha).velocities
        # Over a half period, composed with u -> -u, the orbit returns to its start.
        half = -shooting.monodromy(velocities, 2.0 * alpha)
        return float(np.trace(half)) - 2.0 - _TARGET[wanted.type]

    if trace(wanted.low) * trace(wanted.high) > 0.0:
        raise ShootingError(f"the trace of the half map has no {wanted.type} between {wanted.low:g} and {wanted.high:g}")
    alpha = float(brentq(trace, wanted.low, wanted.high, xtol=4e-16, rtol=max(rtol, 4.0 * math.ulp(1.0))))
    velocities = shooting.solve(velocities, alpha).velocities
    return alpha, _energy(integrator, velocities)


INTEGRATORS = tuple(Shooting(f"solve_ivp {name}", name) for name in ("DOP853", "LSODA", "RK45", "Radau"))
