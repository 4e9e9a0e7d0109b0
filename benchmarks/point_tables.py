"""Tables of one accepted point: its time and error beside shooting, and where its time goes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.effort import Effort
from branches.family import Family
from branches.tracing import SETTINGS
from saltus.bench import backbone, cases
from saltus.bench.breakdown import breakdown
from saltus.bench.following import BareFamily, Run, Spread, spread, timed_runs
from saltus.bench.shooting import PlainShooting, ShootingError, ShotOrbit
from saltus.bench.tables import Table, microseconds, number

__all__ = ["Shot", "layers", "points", "shoot"]

STEP = 0.5 * SETTINGS.maximum_step
"""Step of shooting as a fraction of the velocities: h goes with their square, and arclength measures log h."""


@dataclass(frozen=True)
class Shot:
    """Seconds of the orbits by shooting, those of their multipliers, and the largest error; or why there are none."""

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
        whole = spread([a + b for a, b in zip(self.orbits, self.multipliers, strict=True)])
        return (microseconds(whole), *last, number(whole.least / all_on.least), ratio)


def shoot(inner: int, rtol: float, count: int, differenced: bool) -> Shot:
    """Follow the same orbits by shooting, from two that are given.

    Parameters
    ----------
    inner : int
        Number of inner impacts.
    rtol : float
        Of the integrator.
    count : int
        Number of orbits.
    differenced : bool
        Whether the multipliers are computed too.
    """
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
            began = time.perf_counter()
            new = method.next_orbit(older, last, STEP)
            orbits.append(time.perf_counter() - began)
            older, last = last, new
            energy = method.energy(new.velocities)
            error = max(error, cases.closed_form_error(system, inner, energy, new.duration, new.velocities))
            if differenced:
                began = time.perf_counter()
                np.linalg.eigvals(method.monodromy(new))
                multipliers.append(time.perf_counter() - began)
    except ShootingError as failure:
        return Shot([], [], float("nan"), f"fails: {failure}")
    return Shot(orbits, multipliers, error)


def points(effort: Effort, say: Callable[[str], object]) -> Table:
    """Microseconds an accepted point beside shooting, and the error of both."""
    system = cases.system()
    rows: list[tuple[str, ...]] = []
    for inner in cases.INNER:
        problem, y = cases.segment(system, inner)
        full = timed_runs(Family(problem), y, effort.points, effort.repeats)
        bare = timed_runs(BareFamily(problem), y, effort.points, effort.repeats)
        error = max(cases.step_error(problem, step) for step in (*full[0].steps, *bare[0].steps))
        all_on, orbit_only = (spread([run.clean_point for run in runs]) for runs in (full, bare))
        ours = (
            str(inner),
            microseconds(all_on),
            microseconds(orbit_only),
            number(all_on.least / orbit_only.least),
            _location(full),
            number(error, 2),
        )
        for rtol in effort.rtols[inner]:
            say(f"{inner} inner impacts: shooting at rtol {rtol:g}")
            theirs = shoot(inner, rtol, effort.shot[inner], inner <= effort.differenced)
            rows.append((*ours, f"{rtol:.0e}", *theirs.cells(all_on, orbit_only)))
    least, most = min(effort.shot.values()), max(effort.shot.values())
    return Table(
        "Microseconds an accepted point, beside shooting on scipy",
        (
            "inner impacts", "saltus, all on", "saltus, orbit only", "all on to orbit only", "an event", "error", "rtol",
            "shooting with multipliers", "shooting, orbit only", "error", "ratio, all on", "ratio, orbit only",
        ),
        rows,
        (
            f"S13O00+ from h = {number(backbone.energy(system, cases.ALPHA))} upward. k inner impacts are 2k + 1 quarters of it in one",
            "segment: a solution of that word's problem whose closed form is known. Error: the largest relative one, in h or in the",
            "velocities at the start, against the closed form at the orbit's own quarter period.",
            f"saltus: median (least) of {effort.repeats} runs of {effort.points} points, those with an event on their way left out.",
            "An event: what locating one adds, in multiples of a point. All on: multipliers, admissibility, half-waves, all test",
            "functions; orbit only: none of these, but the tangent and the fold.",
            "Shooting: solve_ivp (DOP853, atol = rtol) with an event on the gap, restitution in a loop, finite-difference Jacobian with",
            f"Broyden's updates, multipliers by differences over the period. Median (least) of {least} to {most} points of the same",
            "spacing. Ratio: shooting to saltus, the least to the least.",
        ),
    )  # fmt: skip


def _location(runs: list[Run]) -> str:
    """How many times a point's cost an event on its way adds, as text."""
    if runs[0].events == 0:
        return "none met"
    point = min(run.clean_point for run in runs)
    eventful = min(float(np.sum(run.seconds[~run.clean])) for run in runs)
    extra = (eventful - int(np.sum(~runs[0].clean)) * point) / runs[0].events
    return number(extra / point, 2)


def layers(effort: Effort, say: Callable[[str], object]) -> Table:
    """Where the time of a point goes."""
    system = cases.system()
    rows = []
    for inner in cases.INNER:
        say(f"{inner} inner impacts: layers")
        parts = breakdown(*cases.segment(system, inner), effort.points, effort.repeats)
        times = (parts.compiled, parts.entering, parts.family, parts.engine)
        rows.append(
            (
                str(inner),
                number(parts.steps),
                number(parts.iterations),
                number(parts.compiled_calls),
                *(number(1e6 * seconds) for seconds in times),
                microseconds(parts.total),
                f"{100.0 * parts.python / parts.total.least:.0f} %",
            )
        )
    return Table(
        "Where the microseconds of a point go, all on",
        (
            "inner impacts", "steps", "iterations", "compiled calls", "compiled", "entering", "family", "engine", "total", "not compiled",
        ),
        rows,
        (
            "The blocks of the run above are asked for again, layer by layer; a layer is what it adds to the one inside it (difference",
            "of the least times, so the layers sum to the least total, which is measured as a whole).",
            "Compiled: arithmetic. Entering: the same arguments into compiled code that does nothing. Family, engine: Python",
            f"in Family.march and continuation.follow. {effort.repeats} repeats.",
        ),
    )  # fmt: skip
