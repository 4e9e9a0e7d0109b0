"""Tables of whole things: families followed by name, the memory of a branch, processes."""

from __future__ import annotations

import time
from collections.abc import Callable

import saltus
from benchmarks.effort import Effort
from benchmarks.memory import held
from benchmarks.processes import PROCESSES, measure
from branches.family import Family
from branches.tracing import follow_family
from saltus.bench import cases
from saltus.bench.following import spread, timed_runs
from saltus.bench.tables import Table, microseconds, number

__all__ = ["families", "memory", "processes"]


def families(effort: Effort, say: Callable[[str], object]) -> Table:
    """Whole families by name: what a user gets, events and record included."""
    rows: list[tuple[str, ...]] = []
    repeats = max(2, effort.repeats // 5)
    for name in effort.families:
        say(f"{name}: found and followed as a whole")
        found: list[float] = []
        began = time.perf_counter()
        branch = saltus.trace(name, on_start=lambda text, found=found: found.append(time.perf_counter()))
        problem, start = branch.problem, branch.unknowns(branch.start)
        times = []
        for _ in range(repeats):
            again = time.perf_counter()
            branch = follow_family(problem, start, energy=saltus.load_scene().energy)
            times.append((time.perf_counter() - again) / len(branch))
        whole = spread(times)
        plain = spread([run.clean_point for run in timed_runs(Family(problem), start, effort.points, repeats)])
        rows.append(
            (
                name,
                str(problem.inner),
                str(len(branch)),
                str(len(branch.events)),
                number(1e3 * (found[0] - began)),
                number(1e3 * whole.median * len(branch)),
                microseconds(whole),
                microseconds(plain),
                number(whole.median / plain.median),
            )
        )
    return Table(
        "Whole families by name",
        (
            "name", "inner impacts", "points", "events", "found in ms", "followed in ms", "a point, events and record",
            "a point without", "ratio",
        ),
        rows,
        (
            "Families with so many different flights. Found: from the name to a first orbit, by search, once. Followed: both ways to",
            "the ends over the scene's energies, with events located and the record of every point made (stability, labels).",
            "Without: points with no event on their way, and no record, from the same start upward.",
            f"Microseconds a point, median (least) of {repeats}.",
        ),
    )  # fmt: skip


def memory(effort: Effort, say: Callable[[str], object]) -> Table:
    """Bytes a point against points and impacts."""
    system = cases.system()
    rows: list[tuple[str, ...]] = []
    previous = None
    for inner in cases.INNER:
        say(f"{inner} inner impacts: memory")
        problem, y = cases.segment(system, inner)
        short, middle, long = (held(problem, y, count * effort.points) for count in (1, 2, 4))
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
                str(inner),
                f"{short.points}, {middle.points}, {long.points}",
                number(kept),
                number(later),
                an_impact[0],
                number(long.arrays / long.points),
                number(most),
                an_impact[1],
                str(unknowns),
                number(later / unknowns),
            )
        )
        previous = (inner, later, most)
    return Table(
        "Memory of a branch, bytes",
        (
            "inner impacts", "points", "kept a point", "the same, longer", "kept an impact", "in arrays a point", "at most a point",
            "at most an impact", "unknowns of a point", "kept to unknowns",
        ),
        rows,
        (
            "Branches of three lengths, counted by tracemalloc. Kept a point: the difference between the first two lengths by that of",
            "their points, and the same between the last two: equal where memory is linear in points. An impact: the difference",
            "between rows, constant where memory is linear in impacts. At most: while it is traced. Unknowns: 8 bytes each.",
        ),
    )  # fmt: skip


def processes(effort: Effort, say: Callable[[str], object]) -> Table:
    """Whole-process times."""
    measured = []
    for words, arguments in PROCESSES:
        say(words)
        measured.append(measure(words, arguments, effort.processes, effort.cold))
    base = {process.words: spread(process.warm).median for process in measured[:2]}
    rows = []
    for process in measured:
        warm = spread(process.warm)
        cold = "not run" if process.cold is None else number(process.cold)
        ratios = [number(warm.median / seconds) for seconds in base.values()]
        slower = "-" if process.cold is None else number(process.cold / warm.median)
        rows.append((process.words, cold, f"{number(warm.median)} ({number(warm.least)})", slower, *ratios))
    return Table(
        "Whole processes, seconds",
        ("process", "cold", "warm", "cold to warm", *(f"warm to {words}" for words in base)),
        rows,
        (
            "Cold: the first run with an empty NUMBA_CACHE_DIR, once. Warm: the runs after it, median (least) of "
            f"{effort.processes}.",
            "saltus is run as python -m saltus; no picture is drawn.",
        ),
    )
