"""Measurement of processor time: of calls, of repeated work, and of processes."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

__all__ = ["FinishedProcess", "Spread", "least_times", "processor_of_children", "processor_time", "run_python", "spread", "timed"]

Result = TypeVar("Result")

ROOT = Path(__file__).resolve().parents[1]

SAMPLE = 2e-3
"""Seconds of work between two readings of the clock. A clock that is read too often is not reliable."""


class Spread(NamedTuple):
    """Least and median of repeated measurements."""

    least: float
    median: float


def spread(values: list[float]) -> Spread:
    """Least and median of one or more numbers."""
    return Spread(min(values), float(np.median(values)))


def timed(function: Callable[..., Result], *arguments: Any) -> tuple[Result, float]:
    """Result and processor seconds of one call."""
    began = time.process_time()
    result = function(*arguments)
    return result, time.process_time() - began


def processor_time(work: Callable[[], object], many: int = 1) -> float:
    """Mean processor time of a work that is done so many times. Other work on the machine does not count."""
    began = time.process_time()
    for _ in range(many):
        work()
    return (time.process_time() - began) / many


def least_times(works: Mapping[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Least processor time of each work, from at least five measurements and this many seconds of each.

    The works alternate, so that a disturbance of the machine affects all of them. A short work is done many times per measurement.
    """
    many = {name: max(1, round(SAMPLE / max(processor_time(work), 1e-6))) for name, work in works.items()}
    times: dict[str, list[float]] = {name: [] for name in works}
    while any(len(done) < 5 or sum(done) * many[name] < seconds for name, done in times.items()):
        for name, work in works.items():
            times[name].append(processor_time(work, many[name]))
    return {name: min(done) for name, done in times.items()}


def processor_of_children() -> float:
    """Processor seconds of all finished child processes; NaN if the system does not count them."""
    try:
        import resource
    except ImportError:
        return math.nan
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


class FinishedProcess(NamedTuple):
    """Standard output of a process, seconds from its start to its end, and its processor seconds."""

    output: str
    seconds: float
    processor: float


def run_python(*arguments: str, cache: str | None = None, codes: tuple[int, ...] = (0,)) -> FinishedProcess:
    """Run this interpreter as a process of its own, with the packages of this checkout.

    Parameters
    ----------
    *arguments : str
        Of the interpreter.
    cache : str, optional
        Folder for compiled code; by default the usual one.
    codes : tuple of int
        Exit codes of a process that did not fail.

    Raises
    ------
    RuntimeError
        If the process fails; the message contains the last line that it wrote.
    """
    path = os.pathsep.join(part for part in (str(ROOT), os.environ.get("PYTHONPATH")) if part)
    environment = {**os.environ, "PYTHONPATH": path} | ({} if cache is None else {"NUMBA_CACHE_DIR": cache})
    used, began = processor_of_children(), time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - began
    if done.returncode not in codes:
        last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
        raise RuntimeError(f"python {' '.join(arguments)} ended with code {done.returncode}: {last}")
    return FinishedProcess(done.stdout, seconds, processor_of_children() - used)
