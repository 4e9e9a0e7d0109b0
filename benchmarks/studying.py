"""How long many damped runs take, against scipy's integrator with events on the same runs.

    python -m benchmarks.studying [--runs N] [--workers N] [--sample N]

The reference system with restitution 0.7 and damping 0.01, impulsive starts of energies log-uniform in 0.06 to 10, until no impact is
possible any more. Kernels are compiled before. scipy.integrate.solve_ivp (DOP853, a terminal event at each side of the stop) runs a sample
of the same starts, impact by impact, up to the last impact that is known; its energy error is what it misses in the balance, with the loss
of each impact and the integral of lam v^2 as a fifth equation.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
import time
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bvp.swift import swift_numbers, swift_runs
from bvp.system import vibro_impact_nes
from saltus.bench.machine import describe
from saltus.bench.tables import Table, number
from saltus.executors import open_executor
from saltus.studying import carry_out
from saltus.threads import one_thread
from transitions.study.axes import Axis
from transitions.study.plan import Plan
from transitions.study.study import Study, write_plan

__all__ = ["Integrated", "Studied", "integrate", "main", "study", "table", "tail_time"]

MU, SIGMA, LAM, RHO = 0.1, 0.1, 0.01, 0.7
RTOL, ATOL = 1e-10, 1e-12


@dataclass(frozen=True)
class Studied:
    """A study: seconds, those of all processors together, runs, impacts, bytes of memory and of files a run, the worst error of the
    balance; energy and last impact of each run."""

    workers: int
    seconds: float
    processor: float
    runs: int
    impacts: int
    memory: float
    size: float
    error: float
    energies: np.ndarray
    last: np.ndarray


@dataclass(frozen=True)
class Integrated:
    """Runs of scipy's integrator: seconds, runs, impacts, the worst and the median error of the balance."""

    seconds: float
    runs: int
    impacts: int
    worst: float
    median: float


def plan(runs: int) -> Plan:
    """The study."""
    system = vibro_impact_nes(MU, SIGMA, LAM, RHO)
    energy = Axis("energy", low=0.06, high=10.0, scale="log")
    return Plan(system.describe(), (0,), (1,), (energy,), {}, "hypercube", runs=runs, seed=1)


def study(runs: int, workers: int) -> Studied:
    """Run the study with so many processes, its blocks written to a folder of its own; processes are started and warm before the clock."""
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
        return Studied(
            workers, seconds, used, runs, int(found["impacts"].sum()), found.nbytes / runs, size / runs, error, found["h"],
            found["last_impact"],
        )  # fmt: skip


def _used(executor: Executor, workers: int) -> list[float]:
    """Processor seconds of this process and of each of its workers, so far."""
    found = {}
    for _ in range(100):
        found.update(executor.map(_worker, range(4 * workers)))
        if len(found) == workers:
            break
    return [time.process_time(), *found.values()]


def _worker(_: int) -> tuple[int, float]:
    time.sleep(0.01)
    return os.getpid(), time.process_time()


def _warm(plan: Plan) -> None:
    from transitions.study.runs import run_block

    run_block(plan, plan.values(0, plan.count))
    time.sleep(0.05)


def tail_time(energies: np.ndarray) -> tuple[float, float]:
    """Processor seconds a run, in all, and in the tail after the last impact: what the same runs save that end with it."""
    numbers = swift_numbers(vibro_impact_nes(MU, SIGMA, LAM, RHO))
    assert numbers is not None
    which, states = np.zeros(len(energies), dtype=np.int64), np.zeros((len(energies), 4))
    states[:, 3] = np.sqrt(2.0 * energies)

    def seconds(most: Any) -> tuple[float, np.ndarray]:
        """The least of three."""
        times = []
        for _ in range(3):
            begin = time.process_time()
            found = swift_runs(
                numbers[None], which, states, energies, duration=1e4, to_rest=True, max_impacts=most, fractions=(0.5, 0.9, 0.99)
            )
            times.append(time.process_time() - begin)
        return min(times), found.impacts

    whole, impacts = seconds(10**7)
    return whole / len(energies), (whole - seconds(impacts)[0]) / len(energies)


def integrate(energies: np.ndarray, last: np.ndarray) -> Integrated:
    """The same runs by scipy.integrate.solve_ivp, up to a little after the last impact."""
    from scipy.integrate import solve_ivp

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


def table(runs: list[Studied], other: Integrated | None, tail: tuple[float, float]) -> Table:
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
    notes.append(f"Of {1e6 * tail[0]:.1f} us of processor a run, about {1e6 * tail[1]:.1f} us are spent in the impact-free tail.")
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


def main(words: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.studying", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--sample", type=int, default=20, help="runs of solve_ivp")
    arguments = parser.parse_args(words)
    one_thread()
    print("\n".join(describe()), flush=True)
    runs = [study(arguments.runs, workers) for workers in arguments.workers]
    some = np.random.default_rng(1).permutation(arguments.runs)[: arguments.sample]
    other = integrate(runs[0].energies[some], runs[0].last[some]) if arguments.sample else None
    tail = tail_time(runs[0].energies[: min(arguments.runs, 50_000)])
    print(table(runs, other, tail).text())


if __name__ == "__main__":
    main(sys.argv[1:])
