"""Shooting on `scipy.integrate.solve_ivp` as methods of the bench, one for each integrator."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bvp.multipliers import sort_multipliers
from saltus.bench.answers import Answer, OrbitAnswer
from saltus.bench.fixed_period import Integrator, PeriodShooting
from saltus.bench.methods import Method, Work
from saltus.bench.shooting import ShootingError
from saltus.bench.tasks import LocateTask, OrbitTask, RunTask, Task, Wanted

__all__ = ["INTEGRATORS", "Shooting"]

_TARGET = {"SN": 2.0, "SB": -2.0}
"""Trace of the reduced half map, composed with u -> -u, where a symmetric family folds or loses its symmetry."""


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
        """See `saltus.bench.methods.Method`."""
        return True

    def prepare(self, task: Task, setting: float | None) -> Work:
        """See `saltus.bench.methods.Method`."""
        assert setting is not None
        if isinstance(task, OrbitTask):
            integrator = Integrator(task.system, self.integrator, setting)
            velocities = task.start_velocities(task.guess())
            return Work(lambda: _orbit(task, integrator, velocities))
        if isinstance(task, RunTask):
            moving = Integrator(task.system, self.integrator, setting)
            return Work(lambda: _run(task, moving))
        return Work(lambda: _locate(task, self.integrator, setting))


def _orbit(task: OrbitTask, integrator: Integrator, velocities: np.ndarray) -> Answer:
    method = PeriodShooting(integrator, task.ends[1], len(task.word))
    shot = method.solve(velocities, task.alpha)
    reduced = _reduced(integrator, shot.velocities, method.monodromy(shot.velocities, 4.0 * task.alpha))
    multipliers = sort_multipliers(np.linalg.eigvals(reduced))
    return Answer(orbits=(OrbitAnswer(task.alpha, _energy(integrator, shot.velocities), shot.velocities, shot.times, multipliers),))


def _reduced(integrator: Integrator, velocities: np.ndarray, monodromy: np.ndarray) -> np.ndarray:
    """The monodromy across the flow and within the energy level, (2 n - 2, 2 n - 2), at u = 0."""
    n = integrator.n
    start = np.concatenate([np.zeros(n), velocities])
    flow = integrator.matrix @ start
    slope = np.concatenate([np.zeros(n), integrator.system.mass @ velocities])
    columns = np.column_stack([flow / np.linalg.norm(flow), slope / np.linalg.norm(slope), np.eye(2 * n)])
    rest = np.linalg.qr(columns)[0][:, 2:]
    return rest.T @ monodromy @ rest


def _energy(integrator: Integrator, velocities: np.ndarray) -> float:
    return float(0.5 * velocities @ integrator.system.mass @ velocities)


def _run(task: RunTask, integrator: Integrator) -> Answer:
    n = integrator.n
    y = np.concatenate([np.zeros(n), task.velocities])[:, None]
    now = 0.0
    for impact in range(task.impacts):
        duration, y, hit = integrator.flight(y, 1e4)
        if not hit:
            raise ShootingError(f"no impact came after impact {impact}")
        now += duration
        y = integrator.strike(y)
    system = integrator.system
    return Answer(task.impacts, ran=(now, y[:, 0], float(system.energy(y[:n, 0], y[n:, 0]))))


def _locate(task: LocateTask, method: str, rtol: float) -> Answer:
    return Answer(len(task.wanted), located={name: _special(wanted, method, rtol) for name, wanted in task.wanted})


def _special(wanted: Wanted, method: str, rtol: float) -> tuple[float, float]:
    """Quarter period and energy where the trace of the half map has the value of a special point."""
    from scipy.optimize import brentq

    task = wanted.family
    integrator = Integrator(task.system, method, rtol)
    shooting = PeriodShooting(integrator, task.ends[1], len(task.word))
    velocities = task.start_velocities(task.unknowns())

    def trace(alpha: float) -> float:
        nonlocal velocities
        velocities = shooting.solve(velocities, alpha).velocities
        # A half period is a flight, an impact and a flight; with u -> -u it returns to its start.
        half = -shooting.monodromy(velocities, 2.0 * alpha)
        return float(np.trace(half)) - 2.0 - _TARGET[wanted.type]

    if trace(wanted.low) * trace(wanted.high) > 0.0:
        raise ShootingError(f"the trace of the half map has no {wanted.type} between {wanted.low:g} and {wanted.high:g}")
    alpha = float(brentq(trace, wanted.low, wanted.high, xtol=4e-16, rtol=max(rtol, 4.0 * math.ulp(1.0))))
    velocities = shooting.solve(velocities, alpha).velocities
    return alpha, _energy(integrator, velocities)


INTEGRATORS = tuple(Shooting(f"solve_ivp {name}", name) for name in ("DOP853", "LSODA", "RK45", "Radau"))
