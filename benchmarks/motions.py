"""`python -m benchmarks sections` and `studies`: Poincare sections and many damped runs, compared with scipy's integrator.

The integrator is `scipy.integrate.solve_ivp` (DOP853) with events. Nothing guarantees that the events are complete: it misses an impact
between two of its steps.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import saltus
from benchmarks.measure import Difference, difference, timed
from benchmarks.report import Table, machine, number, progress, show, watched
from bvp.simulate import Simulator, run_linear
from bvp.system import vibro_impact_nes
from saltus.errors import DONE
from saltus.motion.study import carry_out
from saltus.options import whole_above_zero
from saltus.processes import open_executor
from transitions.section.plane import SectionPlane
from transitions.study.plan import Axis, StudyPlan
from transitions.study.runs import results_of
from transitions.study.study import Study, write_plan

__all__ = [
    "Integrated", "Studied", "integrate", "integrated_section", "plan", "section_table", "sections_arguments", "studies_arguments", "study",
    "study_table", "tail_time",
]  # fmt: skip

MU, SIGMA, LAM, RHO = 0.1, 0.1, 0.01, 0.7
"""Parameters of the runs; sections are undamped and elastic."""

RTOL, ATOL = 1e-10, 1e-12
"""Tolerances of the integrator in the runs."""

STARTS = 12
"""Starts that are followed to five points, to count those with missed impacts."""

ENERGIES = (0.06, 0.3, 1.0, 5.0)
"""Energies of the sections."""


def sections_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of `sections`."""
    parser.add_argument("--quick", action="store_true", help="fewer energies, orbits and points")
    parser.set_defaults(run=_run_sections)


def _run_sections(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    show(section_table(arguments.quick))
    return DONE


def integrated_section(
    mu: float, sigma: float, u: np.ndarray, v: np.ndarray, crossings: int, rtol: float, step: float = math.inf
) -> np.ndarray:
    """Integrate to the first upward crossings of u2 = 0 after the start; return their states (k, 4).

    `step` is the longest step of the integrator.
    """

    def motion(t: float, x: np.ndarray) -> list[float]:
        force = sigma * (x[0] - x[1])
        return [x[2], x[3], -force / mu, force - x[1]]

    def gap(t: float, x: np.ndarray) -> float:
        return 1.0 - abs(x[0] - x[1])

    def oscillator(t: float, x: np.ndarray) -> float:
        return x[1]

    gap.terminal, gap.direction, oscillator.direction = True, -1.0, 1.0  # type: ignore[attr-defined]
    state, found = np.concatenate([u, v]), np.zeros((0, 4))
    first = True
    while len(found) < crossings:
        run = solve_ivp(motion, (0.0, 100.0), state, "DOP853", events=(gap, oscillator), rtol=rtol, atol=rtol, max_step=step)
        late = run.t_events[1] > (1e-6 if first else 0.0)
        found = np.concatenate([found, np.reshape(run.y_events[1], (-1, 4))[late]])
        state = run.y[:, -1].copy()
        relative = state[2] - state[3]
        if run.status == 1 and relative * (state[0] - state[1]) > 0.0:
            state[2] -= 2.0 * relative / (1.0 + mu)
            state[3] += 2.0 * relative * mu / (1.0 + mu)
        first = False
    return found[:crossings]


def _wrong(system: saltus.ImpactSystem, energy: float, count: int, rtol: float) -> int:
    """Number of starts of which the integrator's fifth point is wrong, because it missed an impact."""
    plane = SectionPlane(system, energy)
    starts = plane.starts(count)
    found = saltus.section(system, energy, starts=starts, crossings=6)
    u, v = plane.states(starts)
    wrong = 0
    for m in range(count):
        states = integrated_section(MU, SIGMA, u[m], v[m], 5, rtol)
        apart = np.abs(plane.coordinates(states[:, :2], states[:, 2:])[-1] - found.points[m, 5]).max()
        wrong += bool(apart > 1e-6 * math.exp(max(0.0, float(found.growths[m].max()))))
    return wrong


def section_table(quick: bool) -> Table:
    """Section points a second and the largest relative energy drift, with Lyapunov exponents, beside the integrator."""
    system = saltus.vibro_impact_nes(MU, SIGMA)
    orbits, crossings, few, rtol = (10, 40, 1, 1e-9) if quick else (150, 400, 4, 1e-12)
    starts = 2 if quick else STARTS
    saltus.section(system, 0.06, orbits=1, crossings=2)  # loads the kernels

    def section(energy: float) -> saltus.Section:
        found = saltus.section(system, energy, orbits=orbits, crossings=crossings)
        _ = found.exponents
        return found

    rows = []
    for energy in watched(ENERGIES[: 2 if quick else None], "h = {:g}".format):
        runs = [timed(section, energy) for _ in range(3)]
        found, seconds = runs[0][0], min(run[1] for run in runs)
        ours = len(found) / seconds
        plane = SectionPlane(system, energy)
        u, v = plane.states(plane.starts(few))
        pieces = [timed(integrated_section, MU, SIGMA, u[m], v[m], crossings // 4, rtol) for m in range(few)]
        states = np.concatenate([piece[0] for piece in pieces])
        theirs = len(states) / sum(piece[1] for piece in pieces)
        drift = float(np.abs(system.energy(states[:, :2], states[:, 2:]) / energy - 1.0).max())
        rows.append(
            (
                f"{energy:g}", f"{found.impacts.sum() / len(found):.2f}", f"{ours:.0f}", f"{found.drift:.1e}", f"{theirs:.1f}",
                f"{drift:.1e}", f"{ours / theirs:.0f}", str(_wrong(system, energy, starts, rtol)),
            )
        )  # fmt: skip
    return Table(
        "Sections",
        (
            "h", "impacts a point", "points a second", "drift", "points a second, solve_ivp", "its drift", "ratio",
            f"wrong starts of {starts}, solve_ivp",
        ),
        rows,
        (
            f"{orbits} orbits of {crossings} points; DOP853 with atol = rtol = {rtol:g}, {few} orbits of {crossings // 4} points.",
            "A start is wrong if its fifth point is wrong, because of a missed impact.",
        ),
    )  # fmt: skip


def studies_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of `studies`."""
    parser.add_argument("--runs", type=whole_above_zero, default=1_000_000, help="damped runs (default: 1000000)")
    parser.add_argument("--workers", type=whole_above_zero, nargs="+", default=[1, 2], help="numbers of worker processes (default: 1 2)")
    parser.add_argument("--sample", type=int, default=20, help="runs of solve_ivp (default: 20)")
    parser.set_defaults(run=_run_studies)


def _run_studies(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    runs = [study(arguments.runs, workers) for workers in watched(arguments.workers, lambda n: f"{arguments.runs} runs, {n} workers")]
    some = np.random.default_rng(1).permutation(arguments.runs)[: arguments.sample]
    progress(f"{arguments.sample} runs by solve_ivp")
    other = integrate(runs[0].energies[some], runs[0].last[some]) if arguments.sample else None
    show(study_table(runs, other, tail_time(runs[0].energies[: min(arguments.runs, 50_000)])))
    return DONE


@dataclass(frozen=True)
class Studied:
    """A study."""

    workers: int
    seconds: float  # by the clock
    processor: float  # seconds of all processors together
    runs: int
    impacts: int
    memory: float  # bytes a run
    size: float  # the same on disk
    error: float  # largest of the energy balance
    energies: np.ndarray  # (runs,)
    last: np.ndarray  # (runs,) time of the last impact


@dataclass(frozen=True)
class Integrated:
    """Runs of scipy's integrator: seconds, runs, impacts, the largest and the median error of the energy balance."""

    seconds: float
    runs: int
    impacts: int
    worst: float
    median: float


def plan(runs: int) -> StudyPlan:
    """The study: energies log-uniform in 0.06 to 10, impulsive starts, until no further impact is possible."""
    system = vibro_impact_nes(MU, SIGMA, LAM, RHO)
    energy = Axis("energy", low=0.06, high=10.0, scale="log")
    return StudyPlan(system.describe(), (0,), (1,), (energy,), {}, "hypercube", runs=runs, seed=1)


def study(runs: int, workers: int) -> Studied:
    """Run the study with so many processes, which are started and have loaded their kernels before."""
    wanted = plan(runs)
    with tempfile.TemporaryDirectory() as place, open_executor(workers) as (executor, count):
        folder = Path(place)
        warm = plan(2)
        list(executor.map(_warm, [warm] * (4 * workers)))
        write_plan(folder, wanted, "npz", "")
        begin, used = time.perf_counter(), sum(_used(executor, workers))
        carry_out(wanted, None, folder, "npz", set(), executor, count, lambda done: None)
        seconds, used = time.perf_counter() - begin, sum(_used(executor, workers)) - used
        found = Study(folder)
        size = sum(path.stat().st_size for path in folder.glob("block-*"))
        error = float(np.nanmax(found["balance_error"]))
        held = sum(values.nbytes for values in (*map(found.numbers, wanted.names), *map(found.read, results_of(wanted))))
        return Studied(
            workers, seconds, used, runs, int(found["impacts"].sum()), held / runs, size / runs, error, found["h"],
            found["last_impact"],
        )  # fmt: skip


def _used(executor: Executor, workers: int) -> list[float]:
    """Processor seconds so far, of this process and of each worker."""
    found: dict[int, float] = {}
    for _ in range(100):
        found.update(executor.map(_worker, range(4 * workers)))
        if len(found) == workers:
            break
    return [time.process_time(), *found.values()]


def _worker(_: int) -> tuple[int, float]:
    """Id and processor seconds of a worker; the pause lets the others answer as well."""
    time.sleep(0.01)
    return os.getpid(), time.process_time()


def _warm(plan: StudyPlan) -> None:
    from transitions.study.runs import run_block

    run_block(plan, plan.values(0, plan.count))
    time.sleep(0.05)


def tail_time(energies: np.ndarray) -> tuple[float, Difference]:
    """Processor seconds a run: in total, and in the part after the last impact."""
    table, states = Simulator(vibro_impact_nes(MU, SIGMA, LAM, RHO)).table, np.zeros((len(energies), 4))
    states[:, 3] = np.sqrt(2.0 * energies)

    def seconds(most: Any) -> tuple[list[float], np.ndarray]:
        """Seconds, three times, and the impacts of each run."""
        fractions = np.array([0.5, 0.9, 0.99])
        runs = partial(run_linear, table, states, energies, most, 1e4, fractions, with_peaks=True, to_rest=True)
        found = [timed(runs) for _ in range(3)]
        return [seconds for _, seconds in found], found[0][0].summary[:, 2].astype(np.int64)

    total, impacts = seconds(np.full(len(energies), 10**7))
    # Runs that end with their last impact need no tail.
    return min(total) / len(energies), difference(total, seconds(impacts)[0]).per(len(energies))


def integrate(energies: np.ndarray, last: np.ndarray) -> Integrated:
    """Simulate the same runs by `solve_ivp`, impact by impact, up to just after the known last impact.

    The error of the energy balance includes the loss at each impact and the integral of lam v^2, which is the fifth equation.
    """

    def flow(t: float, y: np.ndarray) -> list[float]:
        pull = SIGMA * (y[0] - y[1])
        return [y[2], y[3], -pull / MU, pull - y[1] - LAM * y[3], LAM * y[3] * y[3]]

    def upper(t: float, y: np.ndarray) -> float:
        return 1.0 - (y[0] - y[1])

    def lower(t: float, y: np.ndarray) -> float:
        return 1.0 + (y[0] - y[1])

    for event in (upper, lower):
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    errors, impacts = [], 0
    begin = time.perf_counter()
    for h, end in zip(energies, last, strict=True):
        y, t, lost = np.array([0.0, 0.0, 0.0, math.sqrt(2.0 * h), 0.0]), 0.0, 0.0
        stop = end + 1e-6 if math.isfinite(end) else 1.0
        while t < stop:
            found = solve_ivp(flow, (t, stop), y, method="DOP853", events=(upper, lower), rtol=RTOL, atol=ATOL)
            t, y = float(found.t[-1]), found.y[:, -1].copy()
            if found.status != 1:
                break
            impacts += 1
            speed = y[2] - y[3]
            mass = MU / (1.0 + MU)
            lost += 0.5 * mass * (1.0 - RHO**2) * speed**2
            y[2] -= (1.0 + RHO) * speed / (1.0 + MU)
            y[3] += MU * (1.0 + RHO) * speed / (1.0 + MU)
        energy = 0.5 * (MU * y[2] ** 2 + y[3] ** 2 + y[1] ** 2 + SIGMA * (y[0] - y[1]) ** 2)
        errors.append(abs(h - energy - lost - y[4]) / h)
    return Integrated(time.perf_counter() - begin, len(energies), impacts, max(errors), float(np.median(errors)))


def study_table(runs: list[Studied], other: Integrated | None, tail: tuple[float, Difference]) -> Table:
    """The figures as rows."""
    columns = ("", "workers", "seconds", "runs/s", "impacts/s", "us an impact", "of processor", "bytes a run", "balance error")
    rows = [
        (
            "saltus study", str(run.workers), number(run.seconds), number(run.runs / run.seconds), number(run.impacts / run.seconds),
            number(1e6 * run.seconds / run.impacts), number(1e6 * run.processor / run.impacts),
            f"{run.memory:.0f} ({run.size:.0f} on disk)", f"{run.error:.1e}",
        )
        for run in runs
    ]  # fmt: skip
    notes = [f"{runs[0].runs} runs with {runs[0].impacts} impacts, {runs[0].impacts / runs[0].runs:.1f} a run."]
    notes.append(f"Of {1e6 * tail[0]:.1f} us of processor a run, about {tail[1].per(1e-6).text} us come after the last impact.")
    if other is not None:
        rows.append(
            (
                f"solve_ivp, {other.runs} of the runs", "1", number(other.seconds), number(other.runs / other.seconds),
                number(other.impacts / other.seconds), number(1e6 * other.seconds / max(1, other.impacts)), "", "",
                f"{other.worst:.1e}",
            )
        )  # fmt: skip
        ratio = (other.seconds / max(1, other.impacts)) / (runs[-1].seconds / runs[-1].impacts)
        notes.append(f"solve_ivp (DOP853, rtol {RTOL:g}, atol {ATOL:g}) takes {number(ratio)} times as long an impact; its median error is "
                     f"{other.median:.1e}.")  # fmt: skip
    return Table("Many damped runs", columns, rows, tuple(notes))
