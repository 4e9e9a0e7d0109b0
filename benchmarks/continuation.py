"""`python -m benchmarks continuation`: points compared with shooting, their layers, full families, the memory of a branch, processes.

    python -m benchmarks continuation                                print all tables (about ten minutes)
    python -m benchmarks continuation --quick                        the same with few repeats (less than a minute)
    python -m benchmarks continuation --out docs/reference/speed.md  and put the tables into the page
"""

from __future__ import annotations

import argparse
import gc
import tempfile
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import saltus
from benchmarks import cases
from benchmarks.following import least_time, timed_runs
from benchmarks.measure import least_times, run_python, spread, timed
from benchmarks.points import FULL, QUICK, Scope, layers, microseconds, points
from benchmarks.report import Table, check_page, machine, number, progress, show, write_page
from branches.branch import Branch
from branches.family import Family
from branches.search.intervals import segment_limits, segments
from branches.search.starts import Sampler, curves
from branches.tracing import SETTINGS, follow_family
from bvp.multipoint import MultipointProblem
from bvp.simulate import Simulator, run_linear
from bvp.system import vibro_impact_nes
from saltus.errors import DONE, BadInput, nearest

__all__ = ["SECTIONS", "Held", "add_arguments", "families", "held", "memory", "paths", "processes", "run", "time_process"]

PROCESSES = (
    ("python -c pass", ("-c", "pass")),
    ("python -c 'import numpy, numba'", ("-c", "import numpy, numba")),
    ("saltus --help", ("-m", "saltus", "--help")),
    ("saltus continue S13O00+", ("-m", "saltus", "continue", "S13O00+")),
)
"""Processes: what a person types, and the arguments of the interpreter. The first two are the base of the ratios."""

SHORT_STEPS = replace(SETTINGS, initial_step=2e-3, maximum_step=2e-3)
"""Many points on a short part of a family with few events, so that points use most of the memory."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the task."""
    parser.add_argument("--quick", action="store_true", help="few repeats: less than a minute")
    parser.add_argument("--only", metavar="SECTION", action="append", help=f"one of {', '.join(SECTIONS)}; may be given several times")
    parser.add_argument("--out", metavar="PAGE", help="put the tables between the two marks of this Markdown page")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the task; return the exit code."""
    for name in arguments.only or ():
        if name not in SECTIONS:
            raise BadInput(f"unknown section {name!r}, expected one of {', '.join(SECTIONS)}{nearest(name, SECTIONS)}")
    if arguments.out is not None:
        if arguments.only or arguments.quick:
            raise BadInput("--out writes a complete page; expected no --only and no --quick with it")
        check_page(arguments.out)
    described = machine()
    print("\n".join(described), end="\n\n")
    began = time.perf_counter()
    tables = []
    for name, section in SECTIONS.items():
        if not arguments.only or name in arguments.only:
            tables.append(section(QUICK if arguments.quick else FULL))
            show(tables[-1])
    took = f"Measured in {time.perf_counter() - began:.0f} s by `python -m benchmarks continuation{' --quick' if arguments.quick else ''}`."
    print(took)
    if arguments.out is not None:
        write_page(arguments.out, "\n\n".join(["\n".join([*described, took]), *(table.markdown() for table in tables)]))
    return DONE


def families(scope: Scope) -> Table:
    """Full families by name, as a user gets them: with events and the record of every point."""
    rows: list[tuple[str, ...]] = []
    repeats = max(2, scope.repeats // 5)
    for name in scope.families:
        progress(f"{name}: found and followed")
        found: list[float] = []
        began = time.process_time()
        branch = saltus.trace(name, on_start=lambda text, found=found: found.append(time.process_time()))
        problem, start = branch.problem, branch.unknowns(branch.start)
        times = []
        for _ in range(repeats):
            branch, seconds = timed(_follow, problem, start)
            times.append(seconds / len(branch))
        complete = spread(times)
        plain = spread([run.clean_point for run in timed_runs(Family(problem), start, scope.points, repeats)])
        rows.append(
            (
                name, str(problem.inner), str(len(branch)), str(len(branch.events)), number(1e3 * (found[0] - began)),
                number(1e3 * complete.median * len(branch)), microseconds(complete), microseconds(plain),
                number(complete.median / plain.median),
            )
        )  # fmt: skip
    return Table(
        "Full families by name",
        (
            "name", "inner impacts", "points", "events", "found in ms", "followed in ms", "a point, events and record",
            "a point without", "ratio",
        ),
        rows,
        (
            "Found: from the name to a first orbit, by search, once. Followed: in both directions to the ends within the scene's energies,",
            "with all events located and the record of every point (stability, labels). Without: points with no event before them and no",
            f"record, from the same start upward. Microseconds a point, median (least) of {repeats}.",
        ),
    )  # fmt: skip


def _follow(problem: MultipointProblem, start: np.ndarray) -> Branch:
    return follow_family(problem, start, energy=saltus.load_scene().bounds["energy"])


@dataclass(frozen=True)
class Held:
    """Bytes of a branch: kept at its end, most while it was traced, and of the arrays in `Branch.points`."""

    points: int
    kept: int
    most: int
    arrays: int


def held(problem: MultipointProblem, y: np.ndarray, points: int) -> Held:
    """Trace a branch of so many points upward from unknowns y, and count the bytes that Python and numpy hold for it, by tracemalloc."""

    def traced() -> Branch:
        return follow_family(problem, y, points=points, direction="up", settings=SHORT_STEPS)

    traced()  # everything that is made only once
    gc.collect()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        branch = traced()
        gc.collect()
        after, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    arrays = sum(column.nbytes for column in branch.points.values())
    return Held(len(branch), after - before, most - before, arrays)


def memory(scope: Scope) -> Table:
    """Bytes a point against points and impacts."""
    system = cases.system()
    rows: list[tuple[str, ...]] = []
    previous = None
    for inner in cases.INNER:
        progress(f"{inner} inner impacts: memory")
        problem, y = cases.segment(system, inner)
        short, middle, long = (held(problem, y, count * scope.points) for count in (1, 2, 4))
        kept, later = (
            (more.kept - less.kept) / (more.points - less.points) for less, more in ((short, middle), (middle, long))
        )
        most = (long.most - short.most) / (long.points - short.points)
        unknowns = 8 * problem.unknowns
        an_impact = ("-", "-") if previous is None else tuple(
            number((now - then) / (inner - previous[0])) for now, then in ((later, previous[1]), (most, previous[2]))
        )
        rows.append(
            (
                str(inner), f"{short.points}, {middle.points}, {long.points}", number(kept), number(later), an_impact[0],
                number(long.arrays / long.points), number(most), an_impact[1], str(unknowns), number(later / unknowns),
            )
        )  # fmt: skip
        previous = (inner, later, most)
    return Table(
        "Memory of a branch, bytes",
        (
            "inner impacts", "points", "kept a point", "the same, longer", "kept an impact", "in arrays a point", "at most a point",
            "at most an impact", "unknowns of a point", "kept to unknowns",
        ),
        rows,
        (
            "Branches of three lengths, counted by tracemalloc. Kept a point: the difference between the first two lengths divided by that",
            "of their points, and the same for the last two. They are equal if memory is linear in points. An impact: the difference",
            "between rows, constant if memory is linear in impacts. At most: while it is traced. Unknowns: 8 bytes each.",
        ),
    )  # fmt: skip


def paths(scope: Scope) -> Table:
    """The special paths, each beside the general one that does the same."""
    system = cases.system()
    problem, y = cases.segment(system, 2)
    general = MultipointProblem(system, problem.ends, problem.sequence)
    general._two_dof = False
    damped = vibro_impact_nes(lam=0.01, rho=0.7)
    table = Simulator(damped).table
    starts = np.zeros((50, 4))
    starts[:, 3] = np.sqrt(2.0 * np.geomspace(0.06, 10.0, len(starts)))  # impulsive starts
    most, energies = np.full(len(starts), 100_000), 0.5 * starts[:, 3] ** 2
    found, limits = Sampler(system, "origin", 10.0, [8]), {"origin": segment_limits("origin", "origin", 10.0, 9)}

    def complete() -> None:
        list(segments(system, curves(system, "origin", 1.0), limits, 1_000_000, Counter(), []))

    works: dict[str, dict[str, Callable[[], object]]] = {
        "50 damped motions: without and with a record": {
            "special": lambda: run_linear(table, starts, energies, most, 100.0, np.zeros(0), with_peaks=True),
            "general": lambda: [saltus.simulate(damped, state[:2], state[2:], 100.0) for state in starts],
        },
        "starts at h = 1 for a name with 8 inner impacts: the fast scan, the complete one": {
            "special": lambda: list(found.segments(1.0, 512)),
            "general": complete,
        },
    }  # fmt: skip
    seconds = 0.02 * scope.repeats
    special, any_number = Family(problem), Family(general)
    point = {
        kind: least_time(family, y, scope.points, SETTINGS, seconds)[1] for kind, family in (("special", special), ("general", any_number))
    }  # fmt: skip
    times = {"a point of a family with 2 inner impacts: compiled for two degrees of freedom, and for any number": point}
    times |= {name: least_times(pair, seconds) for name, pair in works.items()}
    rows = [(name, *(number(1e6 * t) for t in pair.values()), number(pair["general"] / pair["special"])) for name, pair in times.items()]
    return Table(
        "Special paths, microseconds",
        ("work: special path, general path", "special", "general", "ratio"),
        rows,
        ("Least processor time. The tests compare the results of each pair.",),
    )


def time_process(arguments: tuple[str, ...], repeats: int, cold: bool) -> list[float]:
    """Seconds of a process with an empty folder for compiled code, and of so many repeats with the code that it left there.

    If not `cold`, the folder is the usual one, and the first run may fill it.

    Raises
    ------
    RuntimeError
        If the process fails.
    """
    with tempfile.TemporaryDirectory(prefix="saltus-benchmark-") as folder:
        return [run_python(*arguments, cache=folder if cold else None).seconds for _ in range(1 + repeats)]


def processes(scope: Scope) -> Table:
    """Times of whole processes, from the start of Python to its end, by the clock."""
    first, warm = {}, {}
    for words, arguments in PROCESSES:
        progress(words)
        first[words], *later = time_process(arguments, scope.processes, scope.cold)
        warm[words] = spread(later)
    rows = []
    for words, (least, median) in warm.items():
        cold, slower = (number(first[words]), number(first[words] / median)) if scope.cold else ("not run", "-")
        ratios = [number(median / base.median) for base in list(warm.values())[:2]]
        rows.append((words, cold, f"{number(median)} ({number(least)})", slower, *ratios))
    return Table(
        "Whole processes, seconds",
        ("process", "cold", "warm", "cold to warm", *(f"warm to {words}" for words, _ in PROCESSES[:2])),
        rows,
        (
            f"Cold: the first run with an empty NUMBA_CACHE_DIR, once. Warm: the runs after it, median (least) of {scope.processes}.",
            "saltus is run as python -m saltus; no figure is drawn.",
        ),
    )


SECTIONS: dict[str, Callable[[Scope], Table]] = {
    "points": points, "layers": layers, "families": families, "memory": memory, "paths": paths, "processes": processes,
}  # fmt: skip
"""The tables in the order in which they are measured."""
