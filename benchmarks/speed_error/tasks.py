"""Tasks of the speed-error benchmark: orbits, a damped run, located points. Each has a reference to thirty digits or more.

The start values below are rough. They only select the orbit, and are corrected before anything is measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import mpmath as mp
import numpy as np

from benchmarks.backbone import DIGITS as CLOSED_DIGITS
from benchmarks.backbone import Backbone
from benchmarks.cases import MU, SIGMA, system
from benchmarks.speed_error.methods import Answer, Errors, OrbitAnswer, Task
from benchmarks.speed_error.references import DIGITS, ReferenceOrbit, ReferenceRun, reciprocal_pair, reference_orbit, reference_run
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, vibro_impact_nes

__all__ = ["LocateTask", "OrbitTask", "RunTask", "TASKS", "Wanted", "multiplier_error"]

STEP = 0.0125
"""Arclength between an orbit and the two neighbours that the start value is extrapolated from: half the longest continuation step."""


def largest(errors: Sequence[float]) -> float:
    """Return the largest error.

    Raises
    ------
    ArithmeticError
        If one is NaN, which `max` might ignore.
    """
    if any(math.isnan(error) for error in errors):
        raise ArithmeticError("the answer contains a value that is not a number")
    return max(errors)


def relative(value: Any, exact: Any) -> float:
    """|value - exact| / |exact|, with the difference in many digits."""
    return float(abs(mp.mpmathify(value) - exact) / abs(exact))


def farthest(values: Any, exact: list[Any]) -> float:
    """Norm of the difference of two vectors over the norm of the exact one, in many digits."""
    differences = [mp.mpf(float(a)) - b for a, b in zip(values, exact, strict=True)]
    return float(mp.norm(mp.matrix(differences)) / mp.norm(mp.matrix(exact)))


def multiplier_error(values: np.ndarray, exact: list[Any]) -> float:
    """Largest relative error of a multiplier; each exact one is compared with the nearest remaining value."""
    if len(values) != len(exact) or not np.all(np.isfinite(values)):
        return math.inf
    left = [complex(value) for value in values]
    worst = 0.0
    for target in exact:
        errors = [relative(mp.mpc(value), mp.mpc(target)) for value in left]
        best = int(np.argmin(errors))
        worst = max(worst, errors[best])
        left.pop(best)
    return worst


@dataclass(frozen=True)
class OrbitTask:
    """The orbit of a family at a quarter period."""

    name: str  # for files
    title: str  # for a reader
    ends: tuple[str, str]  # the first is the origin
    sequence: str  # inner impacts
    velocities: tuple[float, ...]  # approximate, at the start
    times: tuple[float, ...]  # approximate flight times
    alpha: float  # quarter period
    reference: str  # what the errors are measured against, as text
    closed: bool = False  # whether that is the closed form of one impact a half period

    point = "orbit"

    @property
    def system(self) -> ImpactSystem:
        """The system."""
        return system()

    @cached_property
    def problem(self) -> MultipointProblem:
        """The multipoint problem."""
        return MultipointProblem(self.system, self.ends, tuple(self.sequence))

    def unknowns(self) -> np.ndarray:
        """Unknowns of the orbit in double precision."""
        start = self.system.modes.from_state @ np.concatenate([np.zeros(len(self.velocities)), self.velocities])
        y = self.problem.pack(start, None, np.array(self.times))
        return self.problem.solve(y, quarter_period=self.alpha).y

    def guess(self) -> np.ndarray:
        """Start value of every method: extrapolated to the quarter period of the task from two neighbours on the family."""
        problem = self.problem
        here = problem.step(self.unknowns(), np.zeros(2 * problem.unknowns), 0.0, full=False)
        assert here is not None
        near = problem.step(here.y, here.tangent, -STEP, full=False)
        far = problem.step(here.y, here.tangent, -2.0 * STEP, full=False)
        if near is None or far is None:
            raise RuntimeError(f"{self.name}: the neighbours of the orbit were not found")
        alphas = problem.quarter_period(near.y), problem.quarter_period(far.y)
        return near.y + (near.y - far.y) * (self.alpha - alphas[0]) / (alphas[0] - alphas[1])

    def start_velocities(self, y: np.ndarray) -> np.ndarray:
        """Physical velocities at the start of unknowns."""
        return (self.system.modes.to_state @ self.problem.start(y))[len(self.velocities) :]

    def answer(self, y: np.ndarray, energy: float, multipliers: np.ndarray | None = None) -> OrbitAnswer:
        """The answer that unknowns of the multipoint problem are."""
        times = np.cumsum(self.problem.flight_times(y))[:-1]
        return OrbitAnswer(self.problem.quarter_period(y), energy, self.start_velocities(y), times, multipliers, y)

    def exact(self, alpha: float | None = None, y: np.ndarray | None = None) -> ReferenceOrbit:
        """The orbit at a quarter period (by default that of the task), near unknowns y, in many digits."""
        if alpha is None:
            alpha = self.alpha
        if y is not None and not self.closed:
            return reference_orbit(self.problem, y, alpha)
        if alpha != self.alpha and not self.closed:
            raise ValueError(f"{self.name}: unknowns are needed at a quarter period other than {self.alpha:g}")
        return _exact(self, alpha)

    def errors(self, answer: Answer) -> Errors:
        """The largest errors over the orbits of an answer, each against the reference at its own quarter period."""
        found: list[Errors] = []
        for orbit in answer.orbits:
            exact = self.exact(orbit.alpha, orbit.unknowns)
            with mp.workdps(DIGITS):
                in_orbit = None
                if orbit.velocities is not None:
                    in_orbit = farthest(orbit.velocities, exact.velocities)
                    if orbit.times is not None:
                        late = [abs(mp.mpf(float(a)) - b) for a, b in zip(orbit.times, exact.times, strict=True)]
                        in_orbit = largest([in_orbit, *(float(x / (4 * exact.alpha)) for x in late)])
                found.append(
                    Errors(
                        in_orbit,
                        None if orbit.energy is None else relative(orbit.energy, exact.h),
                        None if orbit.multipliers is None else multiplier_error(orbit.multipliers, exact.multipliers),
                    )
                )
        return Errors(*(None if None in column else largest(column) for column in zip(*found, strict=True)))


@cache
def _exact(task: OrbitTask, alpha: float) -> ReferenceOrbit:
    if not task.closed:
        return reference_orbit(task.problem, task.unknowns(), alpha)
    backbone = Backbone.of(task.system)
    # The closed form starts a quarter period before an impact on the upper side.
    sign = 1 if task.ends[1] == "stop+" else -1
    with mp.workdps(CLOSED_DIGITS):
        tau = backbone.tau_half(alpha) ** 2 - 2
        return ReferenceOrbit(
            mp.mpf(alpha), backbone.energy(alpha), [sign * v for v in backbone.velocities(alpha)], [], reciprocal_pair(tau / 2), mp.mpf(0)
        )


@dataclass(frozen=True)
class RunTask:
    """A damped motion through a number of impacts, from velocities at u = 0."""

    name: str
    title: str
    damping: float
    restitution: float
    velocities: tuple[float, ...]
    impacts: int
    reference: str

    point = "impact"

    @property
    def system(self) -> ImpactSystem:
        """The system."""
        return vibro_impact_nes(MU, SIGMA, lam=self.damping, rho=self.restitution)

    def exact(self) -> ReferenceRun:
        """The motion in many digits."""
        return _ran(self)

    def errors(self, answer: Answer) -> Errors:
        """Errors of the state, the time and the energy after the last impact."""
        if answer.ran is None:
            return Errors()
        time, state, energy = answer.ran
        exact = self.exact()
        with mp.workdps(DIGITS):
            return Errors(largest([relative(time, exact.time), farthest(state, exact.state)]), relative(energy, exact.energy))


@cache
def _ran(task: RunTask) -> ReferenceRun:
    return reference_run(task.system, np.array(task.velocities), task.impacts)


@dataclass(frozen=True)
class Wanted:
    """A special point to locate: its type, an orbit of its family, and the quarter periods between which it lies."""

    type: str
    family: OrbitTask
    low: float
    high: float


@dataclass(frozen=True)
class LocateTask:
    """Special points of the backbones."""

    name: str
    title: str
    wanted: tuple[tuple[str, Wanted], ...]  # by name
    reference: str

    point = "located point"

    def exact(self) -> dict[str, tuple[Any, Any]]:
        """Quarter period and energy of each, in many digits."""
        return _located(self)

    def errors(self, answer: Answer) -> Errors:
        """The largest error of a quarter period or an energy, over the located points."""
        exact = self.exact()
        with mp.workdps(CLOSED_DIGITS):
            found = [relative(a, b) for name, pair in answer.located.items() for a, b in zip(pair, exact[name], strict=True)]
        return Errors(located=largest(found) if found else None)


@cache
def _located(task: LocateTask) -> dict[str, tuple[Any, Any]]:
    out = {}
    for name, wanted in task.wanted:
        backbone = Backbone.of(wanted.family.system)
        find: dict[str, Callable[..., Any]] = {"SN": backbone.fold, "SB": backbone.symmetry_breaking}
        out[name] = find[wanted.type](wanted.low, wanted.high)
    return out


_CLOSED = "closed form"
_DIGITS = f"the same equations in {DIGITS} digits"


def _backbone(name: str, title: str, stop: str, velocities: tuple[float, float], alpha: float) -> OrbitTask:
    return OrbitTask(name, title, ("origin", stop), "", velocities, (alpha,), alpha, _CLOSED, closed=True)


IN_PHASE = _backbone("S13O00+", "S13O00+, quarter period 1.65", "stop+", (1.82, 3.07), 1.65)
OUT_OF_PHASE = _backbone("S11O00-", "S11O00- at h = 1e4", "stop-", (-426.4, 42.64), 0.00213200908706663)

TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        IN_PHASE,
        OrbitTask(
            "U8353-", "U8353-, 8 inner impacts", ("origin", "origin"), "+-+-+-+-", (0.059436725, -1.972621447),
            (0.54734943, 0.89065889, 0.95702120, 1.12608516, 0.86660931, 1.06450745, 1.23252467, 0.88055437, 2.24768973), 4.9065, _DIGITS,
        ),
        OrbitTask(
            "U(16)588-", "U(16)588-, 16 inner impacts", ("origin", "origin"), "+-" * 8, (3.9841075, 1.55328321),
            (0.41695582, 1.20945676, 1.20691748, 0.83343044, 1.19957028, 1.18751309, 0.83136071, 1.16979004, 1.13378856, 0.82721372,
             1.11638289, 1.03825688, 0.82818690, 1.05791723, 0.93091488, 0.85627355, 0.51578613), 8.18, _DIGITS,
        ),
        OUT_OF_PHASE,
        RunTask("damped", "damped run of 1,000 impacts", 0.001, 0.999, (2.894377, 4.377472), 1000, "the same run in 50 digits"),
        LocateTask(
            "located", "SN of S11O00- and SB of S13O00+",
            (
                ("SN", Wanted("SN", _backbone("S11O00-", "", "stop-", (-0.9, 0.1), 1.2), 1.05, 1.2)),
                ("SB", Wanted("SB", _backbone("S13O00+", "", "stop+", (0.9, 0.6), 1.7), 1.7, 1.73)),
            ),
            f"roots of the closed form in {CLOSED_DIGITS} digits",
        ),
    )
}  # fmt: skip
"""The tasks by name, in the order in which they are measured."""
