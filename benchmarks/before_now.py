"""The same measurements with an earlier commit and with this checkout, in one run: `python -m benchmarks before-now`.

Each side has a folder and a virtual environment of its own, made as the README says. Each process runs from there. The sides alternate.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.report import Table, machine, number, progress, show
from saltus.errors import DONE, FAILED, BadInput
from saltus.options import whole_above_zero

__all__ = ["BEFORE", "ROWS", "Side", "add_arguments", "run"]

BEFORE = "0e10fe2"
"""The commit that is compared, by default: the last one before families of any number of degrees of freedom had compiled
steps. It also loaded the compiler at every start."""

_ROOT = Path(__file__).resolve().parents[1]

_FIGURES = Path(__file__).with_name("figures.py").read_text(encoding="utf-8")
"""Program of the figures in microseconds. Each side runs this checkout's text with its own modules."""

_SECONDS = 1.0
"""Processor time for each of them."""

_MEMORY = """
import resource, subprocess, sys
subprocess.run([sys.executable, "-m", "saltus", "study", *sys.argv[1:]], check=True, capture_output=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""

_STUDY = """
scene = "lee2009"
design = "grid"
[vary]
energy = {{ from = 0.1, to = 10.0, scale = "log", points = {count} }}
rho = {{ from = 0.3, to = 0.9, points = {count} }}
[fixed]
lam = 0.01
[run]
until = 3.0
"""
"""Short runs: the memory does not depend on how long a run lasts."""


@dataclass
class Side:
    """A checkout with its environment."""

    name: str
    folder: Path
    python: Path  # its interpreter
    installing: float = 0.0  # seconds of the clock for its environment and the installation

    def call(self, words: Sequence[str | Path], cache: Path, python: Path | None = None, codes: Sequence[int] = (DONE,)) -> str:
        """Run an interpreter, by default its own, in its folder. Returns the standard output. codes: exit codes that are no failure."""
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "OPENBLAS_NUM_THREADS": "1"}
        environment.pop("PYTHONPATH", None)  # a checkout there would stand before what is installed
        done = subprocess.run([python or self.python, *words], cwd=self.folder, env=environment, capture_output=True, text=True)
        if done.returncode not in codes:
            done.check_returncode()
        return done.stdout

    def processor(self, words: Sequence[str], cache: Path, wall: bool = False, codes: Sequence[int] = (DONE,)) -> float:
        """Seconds of a process: of the processor with its children, or of the clock."""
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        self.call(words, cache, codes=codes)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if wall:
            return time.perf_counter() - began
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _made(name: str, commit: str, place: Path) -> Side:
    """A copy of a commit with an environment, in which saltus is installed."""
    side = Side(name, place / name, place / name / ".venv/bin/python")
    progress(f"installing {name} ({commit})")
    try:
        subprocess.run(["git", "clone", "--quiet", "--shared", _ROOT, side.folder], check=True, capture_output=True)
        subprocess.run(["git", "checkout", "--quiet", commit], cwd=side.folder, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise BadInput(f"cannot take commit {commit} from {_ROOT}: the benchmark needs git, and a checkout with its history") from error
    began = time.perf_counter()
    subprocess.run([sys.executable, "-m", "venv", ".venv"], cwd=side.folder, check=True)
    subprocess.run([side.python, "-m", "pip", "install", "--quiet", "."], cwd=side.folder, check=True)
    side.installing = time.perf_counter() - began
    subprocess.run([side.python, "-m", "pip", "install", "--quiet", ".[test]", "build"], cwd=side.folder, check=True)
    return side


_CONTINUE = ("-m", "saltus", "continue", "S13O00+")
_PICTURE = (*_CONTINUE, "--plot", "first.png")
_SADDLE = ("-m", "saltus", "continue", "S11-", "--json", "S11.json")
_CURVE = ("-m", "saltus", "curve", "S11.json:SN1", "--in", "energy,mu", "--range", "0.01:10,0.02:1", "--json", "fold.json")
_RESPONSE = ("-m", "saltus", "continue", "--scene", "absorber", "--from", "simulate", "--in", "w", "--range", "0.7:2.2", "--plot", "r.png")
_SECTION = ("-m", "saltus", "section", "--energy", "0.3", "--orbits", "3", "--crossings", "20")
_RUN = ("-m", "saltus", "run", "--on", "S13+", "--energy", "10", "--rho", "0.7", "--lam", "0.01", "--duration", "20")
_BUILD = ("-m", "saltus", "build", "--catalogue", "built.sqlite", "--workers", "2")
_TESTS = ("-m", "pytest", "-n", "2", "--dist", "loadfile", "-q")


def _first(*commands: Sequence[str]) -> Callable[[Side, Path], float]:
    """Measure the last command with kernels of the others alone on disk."""

    def measure(side: Side, cache: Path) -> float:
        shutil.rmtree(cache, ignore_errors=True)
        for words in commands[:-1]:
            side.processor(words, cache)
        return side.processor(commands[-1], cache, wall=True)

    return measure


def _warm(words: Sequence[str], repeats: int = 7, wall: bool = False) -> Callable[[Side, Path], float]:
    """Measure a command with everything on disk: the least of a few processes."""

    def measure(side: Side, cache: Path) -> float:
        side.processor(words, cache)
        return min(side.processor(words, cache, wall) for _ in range(repeats))

    return measure


def _source(side: Side) -> list[Path]:
    """The files of the numerical package, in any language."""
    return [file for file in (side.folder / "bvp").rglob("*") if file.suffix in (".py", ".hpp", ".cpp")]


def _lines(side: Side, cache: Path) -> float:
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in _source(side))


ROWS: dict[str, tuple[str, Callable[[Side, Path], float]]] = {
    "first continue S13O00+": ("s, wall", _first(_CONTINUE)),
    "first section after it": ("s, wall", _first(_CONTINUE, _SECTION)),
    "first run after it": ("s, wall", _first(_CONTINUE, _RUN)),
    "first response after it": ("s, wall", _first(_CONTINUE, _RESPONSE)),
    "first curve after a continue": ("s, wall", _first(_SADDLE, _CURVE)),
    "warm continue S13O00+": ("s, processor", _warm(_CONTINUE)),
    "warm continue S13O00+ --plot": ("s, processor", _warm(_PICTURE)),
    "warm continue S13O00+, wall": ("s, wall", _warm(_CONTINUE, wall=True)),
    "warm continue S13O00+ --plot, wall": ("s, wall", _warm(_PICTURE, wall=True)),
    "environment and installation": ("s, wall", lambda side, cache: side.installing),
    "first continue S13O00+ --plot": ("s, wall", _first(_PICTURE)),
    "lines of bvp": ("lines", _lines),
    "files of bvp": ("files", lambda side, cache: len(_source(side))),
}


def _from_a_wheel(*commands: Sequence[str]) -> Callable[[Side, Path], float]:
    """Measure the last of the first commands in a new environment with a wheel of the side, as `python -m build` makes it."""

    def measure(side: Side, cache: Path) -> float:
        side.call(["-m", "build"], cache)
        shutil.rmtree(cache, ignore_errors=True)
        wheel = next((side.folder / "dist").glob("*.whl"))
        with tempfile.TemporaryDirectory(prefix="saltus-wheel-") as place:
            subprocess.run([sys.executable, "-m", "venv", place], check=True)
            other = Side(side.name, Path(place), Path(place) / "bin/python")
            other.call(["-m", "pip", "install", "--quiet", wheel], cache)
            for words in commands[:-1]:
                other.processor(words, cache)
            return other.processor(commands[-1], cache, wall=True)

    return measure


def _tests(side: Side, cache: Path) -> float:
    """The test command, with nothing on disk."""
    shutil.rmtree(cache, ignore_errors=True)
    return side.processor(_TESTS, cache, wall=True)


def _build(side: Side, cache: Path) -> float:
    """A build. One that could not follow a family ends with code 1, and has computed all others."""
    return side.processor(_BUILD, cache, wall=True, codes=(DONE, FAILED))


def _memory(count: int) -> Callable[[Side, Path], float]:
    """Largest memory of a study with count^2 runs, in MB."""

    def measure(side: Side, cache: Path) -> float:
        with tempfile.TemporaryDirectory(prefix="saltus-study-") as place:
            file = Path(place) / "memory.toml"
            file.write_text(_STUDY.format(count=count), encoding="utf-8")
            return int(side.call(["-c", _MEMORY, file, "--workers", "1"], cache)) / 1024

    return measure


LONG: dict[str, tuple[str, Callable[[Side, Path], float]]] = {
    "first continue S13O00+ from a wheel": ("s, wall", _from_a_wheel(_CONTINUE)),
    "first curve from a wheel": ("s, wall", _from_a_wheel(_SADDLE, _CURVE)),
    "build, shipped scene, two workers": ("s, wall", _build),
    "test command after installing": ("s, wall", _tests),
    "study of 10,000 runs": ("MB", _memory(100)),
    "study of 1,000,000 runs": ("MB", _memory(1000)),
}
"""What takes minutes."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the task."""
    parser.add_argument("--commit", metavar="COMMIT", default=BEFORE, help=f"the earlier commit (default: {BEFORE})")
    parser.add_argument("--rounds", metavar="N", type=whole_above_zero, default=1, help="measure N times, and take the least (default: 1)")
    parser.add_argument("--long", action="store_true", help="also a wheel, a build of the shipped scene, the tests, and studies: an hour")
    parser.add_argument("--only", metavar="TEXT", default="", help="only the rows whose name contains this text")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the task; return the exit code."""
    described = machine()
    print("\n".join(described), end="\n\n")
    with tempfile.TemporaryDirectory(prefix="saltus-before-now-") as folder:
        place = Path(folder)
        head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=_ROOT, check=True, capture_output=True, text=True).stdout.strip()
        sides = [_made("before", arguments.commit, place), _made("now", head, place)]
        least: dict[str, list[float]] = {}
        units: dict[str, str] = {}
        notes = [f"Before: commit {arguments.commit}. The least of {arguments.rounds} rounds."]
        asked = {name: row for name, row in {**ROWS, **(LONG if arguments.long else {})}.items() if arguments.only in name}
        for _ in range(arguments.rounds):
            for name, (unit, measure) in asked.items():
                progress(name)
                units[name] = unit
                try:
                    _note(least, name, [measure(side, place / f"cache-{side.name}") for side in sides])
                except subprocess.CalledProcessError as error:  # a row without a figure must not cost the others
                    said = (error.stderr or error.stdout or "nothing").strip().splitlines()[-1]
                    notes.append(f"Not measured: {name}. A process ended with code {error.returncode} and said: {said}")
            progress("points, multipliers and impacts")
            points = [_points(side, place / f"cache-{side.name}", arguments.only) for side in sides]
            for side, (_, failed) in zip(sides, points, strict=True):
                notes += [f"Not measured {side.name}: {name}. {reason}" for name, reason in failed.items()]
            for name in points[0][0].keys() & points[1][0].keys():
                _note(least, name, [1e6 * found[name] for found, _ in points])
                units[name] = "us"
    rows = [[name, units[name], number(before), number(now), number(before / now)] for name, (before, now) in least.items()]
    show(Table("Before and now", ["what", "unit", "before", "now", "times as fast"], rows, notes))
    return DONE


def _note(least: dict[str, list[float]], name: str, values: list[float]) -> None:
    least[name] = [min(pair) for pair in zip(values, least.get(name, values), strict=True)]


def _points(side: Side, cache: Path, only: str) -> tuple[dict[str, float], dict[str, str]]:
    """Seconds of the figures whose names contain a text, and why others have none."""
    found, failed = json.loads(side.call(["-c", _FIGURES, str(_SECONDS), only], cache).splitlines()[-1])
    return found, failed
