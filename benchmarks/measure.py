"""Measurement of processor time: of calls, of repeated work, and of processes."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from benchmarks.report import number

__all__ = [
    "Difference", "FinishedProcess", "Spread", "difference", "least_times", "processor_of_children", "processor_time", "repeated_times",
    "run_python", "spread", "timed",
]  # fmt: skip

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


class Difference(NamedTuple):
    """A time that is the difference of two repeated measurements, and their scatter: a value below it is not a figure."""

    value: float
    scatter: float

    @property
    def text(self) -> str:
        """The value, or the bound below which it is.

        Examples
        --------
        >>> Difference(12.34, 0.5).text, Difference(-31.0, 40.0).text, Difference(0.2, 0.5).text
        ('12.3', 'below 71', 'below 0.7')
        """
        return number(self.value) if self.value > self.scatter else f"below {number(abs(self.value) + self.scatter, 2)}"

    def per(self, divisor: float) -> Difference:
        """Return the difference divided by a number above zero."""
        return Difference(self.value / divisor, self.scatter / divisor)


BELOW = "\"below x\": a difference of two times below their scatter; its bound is x."
"""Note of a table with differences."""


def difference(longer: Sequence[float], shorter: Sequence[float]) -> Difference:
    """Difference of the least times of two works. Scatter: by how much the medians are longer than the least times, together.

    Raises
    ------
    ValueError
        For a work that is measured once: its scatter is not known.
    """
    if min(len(longer), len(shorter)) < 2:
        raise ValueError("a time that is measured once has no known scatter; expected two or more of each work")
    return Difference(min(longer) - min(shorter), sum(float(np.median(times)) - min(times) for times in (longer, shorter)))


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
    """Least of the `repeated_times` of each work."""
    return {name: min(times) for name, times in repeated_times(works, seconds).items()}


def repeated_times(works: Mapping[str, Callable[[], object]], seconds: float) -> dict[str, list[float]]:
    """Processor times of each work, from at least five measurements and this many seconds of each.

    The works alternate, so that a disturbance of the machine affects all of them. A short work is done many times per measurement.
    """
    many = {name: max(1, round(SAMPLE / max(processor_time(work), 1e-6))) for name, work in works.items()}
    times: dict[str, list[float]] = {name: [] for name in works}
    while any(len(done) < 5 or sum(done) * many[name] < seconds for name, done in times.items()):
        for name, work in works.items():
            times[name].append(processor_time(work, many[name]))
    return times


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
