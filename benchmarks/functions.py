"""`python -m benchmarks functions`: elementary functions of the core beside those of the system's library, and flights with derivatives by
jets. A C++ program measures both in the same run; it needs a compiler."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from benchmarks.report import Table, machine, progress, show
from saltus.errors import DONE, BadInput

__all__ = ["add_arguments", "function_tables"]

CORE = Path(__file__).parents[1] / "bvp" / "core"

FLAGS = ("-std=c++20", "-O3", "-ffp-contract=off", "-fno-math-errno")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser."""
    parser.add_argument("--repeats", type=int, default=15, help="how often each time is measured; the shortest counts (default 15)")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    for table in function_tables(arguments.repeats):
        show(table)
    return DONE


def measured(repeats: int) -> list[list[str]]:
    """The lines of the program, in words."""
    compiler = os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        raise BadInput("no C++ compiler: set CXX to one")
    sources = [Path(__file__).with_suffix(".cpp"), CORE / "functions.cpp"]
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "functions"
        progress("compiling")
        subprocess.run([*compiler.split(), *FLAGS, f"-I{CORE}", *map(str, sources), "-o", str(program)], check=True)
        progress("measuring")
        lines = subprocess.run([str(program), str(repeats)], check=True, capture_output=True, text=True)
        return [line.split() for line in lines.stdout.splitlines()]


def function_tables(repeats: int) -> list[Table]:
    """Times of the functions, and of flights with derivatives."""
    lines = measured(repeats)
    rows = []
    for name, low, high, own, waiting, system, system_waiting in (line for line in lines if line[0] != "flight"):
        rows.append([name, f"{low} to {high}", own, system, f"{float(own) / float(system):.2f}", waiting, system_waiting])
    functions = Table(
        "Elementary functions",
        ["function", "arguments", "core (ns)", "system (ns)", "ratio", "core, chained (ns)", "system, chained (ns)"],
        rows,
        ["Chained: each argument depends on the result before. The core's sincos is one call; the system's is sin and cos."],
    )
    times = {(words[1], words[2]): words[3] for words in lines if words[0] == "flight"}
    sizes = sorted({size for size, _ in times}, key=int)
    flights = Table(
        "A flight and an impact, by jets",
        ["modes", "values (ns)", "all first derivatives (ns)", "second derivatives along a direction (ns)"],
        [[size, times[size, "values"], times[size, "jacobian"], times[size, "second"]] for size in sizes],
    )
    return [functions, flights]
