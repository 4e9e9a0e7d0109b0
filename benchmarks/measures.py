"""The sections of the benchmark: each measures one thing and gives its table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import saltus
from benchmarks import cases
from benchmarks.breakdown import breakdown
from benchmarks.following import BareFamily, Spread, spread, timed_runs
from benchmarks.memory import held
from benchmarks.processes import PROCESSES, cold_and_warm
from benchmarks.shooting import PlainShooting, ShootingError, ShotOrbit
from benchmarks.tables import Table, number
from branches.family import Family
from branches.tracing import SETTINGS, follow_family
from tests.bvp import backbone

__all__ = ["FULL", "QUICK", "SECTIONS", "Effort"]


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Parameters
    ----------
    points : int
        Points of a run of saltus.
    repeats : int
        Runs of saltus.
    shot : dict of int to int
        Points by shooting for each number of inner impacts.
    rtols : dict of int to tuple of float
        Tolerances of the integrator for each number of inner impacts.
    differenced : int
        Most inner impacts for which the multipliers of shooting are computed.
    families : tuple of str
        Names of families that are followed as a whole.
    processes : int
        Repeats of a warm process.
    """

    points: int
    repeats: int
    shot: dict[int, int]
    rtols: dict[int, tuple[float, ...]]
    differenced: int
    families: tuple[str, ...]
    processes: int


ALL_RTOLS = (1e-6, 1e-9, 1e-12)
FULL = Effort(
    40, 25, {0: 12, 2: 8, 4: 6, 8: 5, 64: 2}, {k: ALL_RTOLS for k in cases.INNER}, 64, ("S13O00+", "S11O00-", "S73O33-", "U8353-"), 7
)
QUICK = Effort(
    12, 5, {0: 3, 2: 2, 4: 1, 8: 1, 64: 1}, {0: ALL_RTOLS, 2: ALL_RTOLS, 4: (1e-9,), 8: (1e-9,), 64: (1e-9,)}, 8, ("S13O00+",), 2
)

SHOOTING_STEP = 0.5 * SETTINGS.maximum_step
"""Step of shooting as a fraction of the velocities: h goes with their square, and arclength measures log h."""


def points(effort: Effort, say: Callable[[str], object]) -> Table:
    """Microseconds an accepted point beside shooting, and the error of both."""
    system = cases.system()
    rows: list[tuple[str, ...]] = []
    for inner in cases.INNER:
        problem, y = cases.segment(system, inner)
        full = timed_runs(Family(problem), y, effort.points, effort.repeats)
        bare = timed_runs(BareFamily(problem), y, effort.points, effort.repeats)
        error = max(cases.step_error(problem, step) for step in (*full[0].steps, *bare[0].steps))
        ours = [spread([run.clean_point for run in runs]) for runs in (full, bare)]
        located = _location(full)
        for rtol in effort.rtols[inner]:
            say(f"{inner} inner impacts: shooting at rtol {rtol:g}")
            theirs = _shooting(inner, rtol, effort.shot[inner], inner <= effort.differenced)
            rows.append(
                (
                    str(inner),
                    _microseconds(ours[0]),
                    _microseconds(ours[1]),
                    located,
                    number(error, 2),
                    f"{rtol:.0e}",
                    *theirs.cells(ours),
                )
            )
    return Table(
        "Microseconds an accepted point, beside shooting on scipy",
        (
            "inner impacts", "saltus, all on", "saltus, orbit only", "an event", "error", "rtol", "shooting with multipliers",
            "shooting, orbit only", "error", "ratio, all on", "ratio, orbit only",
        ),
        rows,
        (
            "S13O00+ from h = 5.14 upward; k inner impacts are 2k + 1 quarters of it in one segment, whose closed form is known: error is",
            "the largest relative one in h or in the start, against the closed form at the orbit's own quarter period.",
            f"saltus: median (least) of {effort.repeats} runs of {effort.points} points, points with an event on their way left out.",
            "An event: what a point with an event on its way costs more, in multiples of a point.",
            "All on: multipliers, admissibility, half-waves and all test functions; orbit only: none of these, but the tangent and the fold.",
            "Shooting: solve_ivp (DOP853, atol = rtol) with an event on the gap; finite-difference Jacobian, Broyden's updates; multipliers",
            f"by differences over the period. Median (least) of {min(effort.shot.values())} to {max(effort.shot.values())} points"
            " of the same spacing. Ratio: shooting to saltus, of the medians.",
        ),
    )  # fmt: skip


def _location(runs: list) -> str:
    """How many times a point's cost an event on its way adds, as text."""
    if runs[0].events == 0:
        return "none met"
    extra = np.median([np.sum(run.seconds[~run.clean] - run.clean_point) / run.events for run in runs])
    return number(float(extra) / float(np.median([run.clean_point for run in runs])), 2)


@dataclass(frozen=True)
class _Shot:
    """Seconds of the orbits by shooting, those of their multipliers, and the largest error; or why there are none."""

    orbits: list[float]
    multipliers: list[float]
    error: float
    failure: str = ""

    def cells(self, ours: list[Spread]) -> tuple[str, ...]:
        if self.failure:
            return (self.failure, self.failure, "-", "-", "-")
        orbit = spread(self.orbits)
        if not self.multipliers:
            return ("not run", _microseconds(orbit), number(self.error, 2), "-", number(orbit.median / ours[1].median))
        whole = spread([a + b for a, b in zip(self.orbits, self.multipliers, strict=True)])
        return (
            _microseconds(whole),
            _microseconds(orbit),
            number(self.error, 2),
            number(whole.median / ours[0].median),
            number(orbit.median / ours[1].median),
        )


def _shooting(inner: int, rtol: float, count: int, differenced: bool) -> _Shot:
    """Orbits by shooting from the same start; its first two orbits are given."""
    system = cases.system()
    method = PlainShooting(cases.MU, cases.SIGMA, inner, rtol)
    older, last = (
        ShotOrbit(backbone.origin_velocity(system, alpha), (2 * inner + 1) * alpha, 0) for alpha in (cases.ALPHA + 1e-3, cases.ALPHA)
    )
    orbits, multipliers, error = [], [], 0.0
    try:
        for _ in range(count):
            began = time.perf_counter()
            new = method.next_orbit(older, last, SHOOTING_STEP)
            orbits.append(time.perf_counter() - began)
            older, last = last, new
            found = method.energy(new.velocities)
            error = max(error, cases.closed_form_error(system, inner, found, new.duration, new.velocities))
            if differenced:
                began = time.perf_counter()
                np.linalg.eigvals(method.monodromy(new))
                multipliers.append(time.perf_counter() - began)
    except ShootingError as failure:
        return _Shot([], [], float("nan"), f"fails: {failure}")
    return _Shot(orbits, multipliers, error)


def layers(effort: Effort, say: Callable[[str], object]) -> Table:
    """Where the time of a point goes."""
    system = cases.system()
    rows = []
    for inner in cases.INNER:
        say(f"{inner} inner impacts: layers")
        parts = breakdown(*cases.segment(system, inner), effort.points, effort.repeats)
        rows.append(
            (
                str(inner),
                number(parts.steps),
                number(parts.iterations),
                number(parts.compiled_calls),
                *(_microseconds(x) for x in (parts.compiled, parts.entering, parts.problem, parts.family, parts.engine, parts.total)),
                f"{100.0 * parts.python / parts.total.median:.0f} %",
            )
        )
    return Table(
        "Where the microseconds of a point go, all on",
        (
            "inner impacts", "steps", "iterations", "compiled calls", "compiled", "entering", "problem", "family", "engine", "total",
            "not compiled",
        ),
        rows,
        (
            "The accepted steps of the run above are asked for again, layer by layer; a layer is what it adds to the one inside it.",
            "Compiled: arithmetic. Entering: the same arguments into compiled code that does nothing. Problem, family, engine: Python in",
            "MultipointProblem.step, Family.step and continuation.follow. Total: measured as a whole; the layers sum to it. Median (least).",
        ),
    )  # fmt: skip


def families(effort: Effort, say: Callable[[str], object]) -> Table:
    """Whole families by name: what a user gets, events and record included."""
    rows: list[tuple[str, ...]] = []
    for name in effort.families:
        say(f"{name}: found and followed as a whole")
        begun: list[float] = []
        began = time.perf_counter()
        branch = saltus.trace(name, on_start=lambda text, begun=begun: begun.append(time.perf_counter()))
        start = branch.unknowns(branch.start)
        times = []
        for _ in range(max(2, effort.repeats // 5)):
            again = time.perf_counter()
            branch = follow_family(branch.problem, start)
            times.append((time.perf_counter() - again) / len(branch))
        whole = spread(times)
        step = timed_runs(Family(branch.problem), start, effort.points, max(2, effort.repeats // 5))
        plain = spread([run.clean_point for run in step])
        rows.append(
            (
                name,
                str(branch.problem.inner),
                str(len(branch)),
                str(len(branch.events)),
                number(1e3 * (begun[0] - began)),
                number(1e3 * whole.median * len(branch)),
                _microseconds(whole),
                _microseconds(plain),
                number(whole.median / plain.median),
            )
        )
    return Table(
        "Whole families by name",
        (
            "name", "inner impacts", "points", "events", "found in ms", "followed in ms", "us a point, events and record",
            "us a point without", "ratio",
        ),
        rows,
        (
            "Found: from the name to a first orbit, by search, once. Followed: both ways to the ends, with events located and the record",
            "of every point made (stability, labels). Without: points with no event on their way, and no record. Median (least).",
        ),
    )  # fmt: skip


def memory(effort: Effort, say: Callable[[str], object]) -> Table:
    """Bytes a point against points and impacts."""
    system = cases.system()
    rows: list[tuple[str, ...]] = []
    previous = None
    for inner in cases.INNER:
        say(f"{inner} inner impacts: memory")
        problem, y = cases.segment(system, inner)
        half, whole = (held(problem, y, count) for count in (effort.points, 2 * effort.points))
        a_point = (whole.kept - half.kept) / (whole.points - half.points)
        at_most = (whole.most - half.most) / (whole.points - half.points)
        unknowns = 8 * problem.unknowns
        an_impact = "-" if previous is None else number((a_point - previous[1]) / (inner - previous[0]))
        most_impact = "-" if previous is None else number((at_most - previous[2]) / (inner - previous[0]))
        rows.append(
            (
                str(inner),
                f"{half.points}, {whole.points}",
                number(a_point, 4),
                number(an_impact_value, 4) if (an_impact_value := whole.arrays / whole.points) else "0",
                an_impact,
                number(at_most, 4),
                most_impact,
                str(unknowns),
                number(a_point / unknowns),
            )
        )
        previous = (inner, a_point, at_most)
    return Table(
        "Memory of a branch in bytes",
        (
            "inner impacts", "points", "kept a point", "in arrays a point", "kept an impact", "at most a point", "at most an impact",
            "unknowns of a point", "kept to unknowns",
        ),
        rows,
        (
            "tracemalloc, branches of two lengths; a point: the difference between them, so memory is linear in points where this does not",
            "depend on the lengths. An impact: the difference between rows. At most: while it is traced. Unknowns: 8 bytes each.",
        ),
    )  # fmt: skip


def processes(effort: Effort, say: Callable[[str], object]) -> Table:
    """Whole-process times."""
    measured = []
    for words, arguments in PROCESSES:
        say(f"{words}: cold, then warm")
        measured.append(cold_and_warm(words, arguments, effort.processes))
    base = {process.words: spread(process.warm).median for process in measured[:2]}
    rows = []
    for process in measured:
        warm = spread(process.warm)
        rows.append(
            (
                process.words,
                number(process.cold),
                f"{number(warm.median)} ({number(warm.least)})",
                *(number(warm.median / seconds) for seconds in base.values()),
            )
        )
    return Table(
        "Whole processes, seconds",
        ("process", "cold", "warm", *(f"warm to {words}" for words in base)),
        rows,
        (
            "Cold: the first run with an empty NUMBA_CACHE_DIR, once. Warm: the runs after it, median (least) of "
            f"{effort.processes}. saltus is run as python -m saltus.",
        ),
    )


def _microseconds(seconds: Spread) -> str:
    return f"{number(1e6 * seconds.median)} ({number(1e6 * seconds.least)})"


SECTIONS: dict[str, Callable[[Effort, Callable[[str], object]], Table]] = {
    "points": points,
    "layers": layers,
    "families": families,
    "memory": memory,
    "processes": processes,
}
"""The sections by name, in the order in which they are measured."""
