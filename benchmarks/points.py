"""Tables for one accepted point: its time and error compared with shooting, and its time layer by layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks import backbone, cases
from benchmarks.following import BareFamily, Run, layers_of, timed_runs
from benchmarks.measure import BELOW, Spread, difference, spread, timed
from benchmarks.peers.shooting import PlainShooting, ShootingError, ShotOrbit
from benchmarks.report import Table, number, progress, watched
from branches.family import Family
from branches.tracing import SETTINGS

__all__ = ["FULL", "QUICK", "Scope", "Shot", "layers", "microseconds", "points", "shoot"]


@dataclass(frozen=True)
class Scope:
    """How much is measured."""

    points: int  # of a run of saltus
    repeats: int  # runs of saltus
    shot: dict[int, int]  # points by shooting for each number of inner impacts
    rtols: dict[int, tuple[float, ...]]  # tolerances of the integrator for each number of inner impacts
    differenced: int  # most inner impacts for which shooting computes multipliers
    families: tuple[str, ...]  # that are followed completely
    processes: int  # repeats of a warm process
    cold: bool  # whether processes also run without compiled code on disk


_RTOLS = (1e-6, 1e-9, 1e-12)

FULL = Scope(
    points=40,
    repeats=25,
    shot={0: 12, 2: 8, 4: 6, 8: 5, 64: 2},
    rtols={inner: _RTOLS for inner in cases.INNER},
    differenced=64,
    families=("S13O00+", "S11O00-", "S73O33-", "U8353-"),
    processes=7,
    cold=True,
)
"""The figures of the page."""

QUICK = Scope(
    points=16,
    repeats=7,
    shot={0: 3, 2: 2, 4: 1, 8: 1, 64: 1},
    rtols={0: _RTOLS, 2: _RTOLS, 4: (1e-9, 1e-12), 8: (1e-12,), 64: (1e-12,)},
    differenced=8,
    families=("S13O00+", "S73O33-"),
    processes=2,
    cold=False,
)
"""Less than a minute on an idle machine with compiled kernels on disk."""

STEP = 0.5 * SETTINGS.maximum_step
"""Step of shooting as a fraction of the velocities. h grows with their square, and arclength measures log h."""


@dataclass(frozen=True)
class Shot:
    """Seconds of orbits by shooting and of their multipliers, and the largest error; or the reason of a failure."""

    orbits: list[float]
    multipliers: list[float]
    error: float
    failure: str = ""

    def cells(self, all_on: Spread, orbit_only: Spread) -> tuple[str, ...]:
        """Times, error and ratios to the times of saltus, as text."""
        if self.failure:
            return (self.failure, "-", "-", "-", "-")
        orbit = spread(self.orbits)
        last = (microseconds(orbit), number(self.error, 2))
        ratio = number(orbit.least / orbit_only.least)
        if not self.multipliers:
            return ("not run", *last, "-", ratio)
        together = spread([a + b for a, b in zip(self.orbits, self.multipliers, strict=True)])
        return (microseconds(together), *last, number(together.least / all_on.least), ratio)


def microseconds(seconds: Spread) -> str:
    """Median and, in parentheses, least of repeated times, in microseconds.

    Examples
    --------
    >>> microseconds(Spread(1e-5, 1.25e-5))
    '12.5 (10)'
    """
    return f"{number(1e6 * seconds.median)} ({number(1e6 * seconds.least)})"


def shoot(inner: int, rtol: float, count: int, differenced: bool) -> Shot:
    """Follow `count` of the same orbits by shooting, from two given ones; `differenced`: compute their multipliers as well."""
    system = cases.system()
    method = PlainShooting(cases.MU, cases.SIGMA, inner, rtol)
    older, last = (
        ShotOrbit(backbone.origin_velocity(system, alpha), (2 * inner + 1) * alpha, 0) for alpha in (cases.ALPHA + 1e-3, cases.ALPHA)
    )
    orbits: list[float] = []
    multipliers: list[float] = []
    error = 0.0
    try:
        for _ in range(count):
            new, seconds = timed(method.next_orbit, older, last, STEP)
            orbits.append(seconds)
            older, last = last, new
            energy = method.energy(new.velocities)
            error = max(error, cases.closed_form_error(system, inner, energy, new.duration, new.velocities))
            if differenced:
                monodromy, seconds = timed(method.monodromy, new)
                multipliers.append(seconds + timed(np.linalg.eigvals, monodromy)[1])
    except ShootingError as failure:
        return Shot([], [], float("nan"), f"fails: {failure}")
    return Shot(orbits, multipliers, error)


def points(scope: Scope) -> Table:
    """Microseconds an accepted point beside shooting, and the errors of both."""
    system = cases.system()
    rows: list[tuple[str, ...]] = []
    for inner in watched(cases.INNER, "{} inner impacts: points".format):
        problem, y = cases.segment(system, inner)
        full = timed_runs(Family(problem), y, scope.points, scope.repeats)
        bare = timed_runs(BareFamily(problem), y, scope.points, scope.repeats)
        error = max(cases.step_error(problem, step) for step in (*full[0].steps, *bare[0].steps))
        all_on, orbit_only = (spread([run.clean_point for run in runs]) for runs in (full, bare))
        ratio = number(all_on.least / orbit_only.least)
        ours = (str(inner), microseconds(all_on), microseconds(orbit_only), ratio, _location(full), number(error, 2))
        for rtol in scope.rtols[inner]:
            progress(f"{inner} inner impacts: shooting at rtol {rtol:g}")
            theirs = shoot(inner, rtol, scope.shot[inner], inner <= scope.differenced)
            rows.append((*ours, f"{rtol:.0e}", *theirs.cells(all_on, orbit_only)))
    least, most = min(scope.shot.values()), max(scope.shot.values())
    return Table(
        "Microseconds an accepted point, beside shooting on scipy",
        (
            "inner impacts", "saltus, all on", "saltus, orbit only", "all on to orbit only", "an event", "error", "rtol",
            "shooting with multipliers", "shooting, orbit only", "error", "ratio, all on", "ratio, orbit only",
        ),
        rows,
        (
            f"S13O00+ from h = {number(backbone.energy(system, cases.ALPHA))} upward. A segment with k inner impacts covers 2k + 1",
            "quarters of it, so its closed form is known. Error: the largest relative error of h or of the velocities at the start,",
            "against the closed form at the orbit's own quarter period.",
            f"saltus: median (least) of {scope.repeats} runs of {scope.points} points, without the points that have an event before them.",
            "An event: the cost of locating one, in multiples of a point. All on: multipliers, admissibility, half-waves, all test",
            "functions. Orbit only: the orbit, its tangent and the fold.",
            "Shooting: solve_ivp (DOP853, atol = rtol) with an event on the gap, restitution in a loop, finite-difference Jacobian with",
            f"Broyden's updates, multipliers by differences over the period. Median (least) of {least} to {most} points of the same",
            "spacing. Ratio: shooting to saltus, the least to the least.",
            BELOW,
        ),
    )  # fmt: skip


def _location(runs: list[Run]) -> str:
    """Cost of locating an event in multiples of a point, as text."""
    if runs[0].events == 0:
        return "none"
    point = min(run.clean_point for run in runs)
    eventful = [float(np.sum(run.seconds[~run.clean])) for run in runs]
    points = int(np.sum(~runs[0].clean))
    return difference(eventful, [run.clean_point * points for run in runs]).per(runs[0].events * point).text


def layers(scope: Scope) -> Table:
    """The time of a point, layer by layer."""
    system = cases.system()
    rows = []
    for inner in cases.INNER:
        progress(f"{inner} inner impacts: layers")
        parts = layers_of(*cases.segment(system, inner), scope.points, scope.repeats)
        counts = (parts.steps, parts.iterations, parts.compiled_calls)
        times = (parts.compiled, parts.entering, parts.family, parts.engine)
        outside = f"{100.0 * (parts.total.least - parts.compiled.value) / parts.total.least:.0f} %"
        cells = (*map(number, counts), *(seconds.per(1e-6).text for seconds in times), microseconds(parts.total), outside)
        rows.append((str(inner), *cells))
    return Table(
        "Where the microseconds of a point go, all on",
        (
            "inner impacts", "steps", "iterations", "compiled calls", "compiled", "entering", "family", "engine", "total", "not compiled",
        ),
        rows,
        (
            "The blocks of steps of the run above are repeated, layer by layer. A layer is the difference of its least time and that of",
            "the layer inside it, so the layers sum to the least total, which is measured directly.",
            "Compiled: arithmetic. Entering: the same arguments into compiled code that does nothing. Family, engine: Python",
            f"in Family.advance and continuation.follow. {scope.repeats} repeats.",
            BELOW,
        ),
    )  # fmt: skip
