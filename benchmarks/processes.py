"""Whole-process times: from the start of Python to its end, with and without a compiled cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Process", "PROCESSES", "cold_and_warm", "seconds_of"]

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
    """Seconds of a process: the first with no compiled code on disk, and the later ones."""

    words: str
    cold: float
    warm: list[float]


def cold_and_warm(words: str, arguments: tuple[str, ...], repeats: int) -> Process:
    """Run a process once with an empty directory for compiled code, and again with what it left there.

    Parameters
    ----------
    words : str
        What is run, for the reader.
    arguments : tuple of str
        Of the interpreter.
    repeats : int
        Number of later runs.

    Raises
    ------
    RuntimeError
        When the process fails; the message holds the last line it wrote.
    """
    with tempfile.TemporaryDirectory(prefix="saltus-benchmark-") as directory:
        cold = seconds_of(arguments, directory)
        warm = [seconds_of(arguments, directory) for _ in range(repeats)]
    return Process(words, cold, warm)


def seconds_of(arguments: tuple[str, ...], cache: str) -> float:
    """Seconds of one process of this interpreter, with compiled code kept in the directory `cache`."""
    path = os.pathsep.join(part for part in (str(ROOT), os.environ.get("PYTHONPATH")) if part)
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "PYTHONPATH": path}
    began = time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - began
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise RuntimeError(f"python {' '.join(arguments)} ended with code {done.returncode}: {last}")
    return seconds
