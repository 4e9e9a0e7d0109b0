"""Whole-process times: from the start of Python to its end, with and without a compiled cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

__all__ = ["PROCESSES", "Process", "measure", "seconds_of"]

ROOT = Path(__file__).resolve().parent.parent

PROCESSES = (
    ("python -c pass", ("-c", "pass")),
    ("python -c 'import numpy, numba'", ("-c", "import numpy, numba")),
    ("saltus --help", ("-m", "saltus", "--help")),
    ("saltus continue S13O00+", ("-m", "saltus", "continue", "S13O00+")),
)
"""What is run: the words that a person types, and the arguments of the interpreter."""


@dataclass(frozen=True)
class Process:
    """Seconds of a process: the first with no compiled code on disk (None: not run so), and the later ones."""

    words: str
    cold: float | None
    warm: list[float]


def measure(words: str, arguments: tuple[str, ...], repeats: int, cold: bool) -> Process:
    """Run a process with an empty directory for compiled code, and again with what it left there.

    Parameters
    ----------
    words : str
        What is run, for the reader.
    arguments : tuple of str
        Of the interpreter.
    repeats : int
        Number of later runs.
    cold : bool
        False: the directory is the usual one, and the first run, which may fill it, is not counted.

    Raises
    ------
    RuntimeError
        When the process fails; the message holds the last line it wrote.
    """
    if not cold:
        seconds_of(arguments)
        return Process(words, None, [seconds_of(arguments) for _ in range(repeats)])
    with tempfile.TemporaryDirectory(prefix="saltus-benchmark-") as directory:
        first = seconds_of(arguments, directory)
        return Process(words, first, [seconds_of(arguments, directory) for _ in range(repeats)])


def seconds_of(arguments: tuple[str, ...], cache: str | None = None) -> float:
    """Seconds of one process of this interpreter, with compiled code kept in the directory `cache` (None: the usual one)."""
    path = os.pathsep.join(part for part in (str(ROOT), os.environ.get("PYTHONPATH")) if part)
    environment = {**os.environ, "PYTHONPATH": path}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = cache
    began = time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - began
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise RuntimeError(f"python {' '.join(arguments)} ended with code {done.returncode}: {last}")
    return seconds
