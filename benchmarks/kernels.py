"""Write the list of the kernels that each command calls, with the types of their arguments: `python -m benchmarks kernels`.

Each command runs in a process of its own, in an empty folder, on a small example.
"""

from __future__ import annotations

import argparse
import gc
import io
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

from benchmarks.report import progress, watched
from saltus import processes
from saltus.compiling import LIST, compile_kernels

__all__ = ["EXAMPLES", "add_arguments", "recorded", "run"]

EXAMPLES: dict[str, list[str]] = {
    "continue": ["continue S13O00+ --points 40", "orbit S13+ --alpha 1.7 --plot b.png"],
    "discover": ["discover --energy 0.2 --max-quarter-period 2 --max-impacts 2", "continue S73O33- --points 40"],
    "build": ["build --energy 0.06:0.2 --max-quarter-period 1.9 --max-impacts 2 --catalogue a.sqlite"],
    "modes": [
        "continue --scene three_mass_chain --from mode:1 --points 40 --catalogue a.sqlite --save",
        "continue --scene gear_pair --from mode:3 --points 40",
    ],
    "build modes": [
        "build --scene three_mass_chain --energy 0.25:0.45 --max-quarter-period 3.6 --max-impacts 1 --catalogue a.sqlite",
    ],
    "run": [
        "run --on S13+ --energy 10 --rho 0.7 --lam 0.01 --duration 20 --stages --plot a.png",
        "run --impulse 0.8 --rho 0 --sigma 0 --duration 5",
    ],
    "study": ["study study.toml --workers 1"],
    "section": [
        "section --energy 0.3 --orbits 3 --crossings 20 --plot a.png",
        "section --energy 0.06 --colour rotation --orbits 3 --crossings 50",
    ],
    "impulsive": ["impulsive --energy 0.1:0.3"],
    "response": [
        "continue --scene absorber --from rest --in w --range 0.7:2.2 --json b.json",
        "continue --from b.json:GR1 --plot c.png",
    ],
    "simulated response": [
        "continue --scene absorber --from simulate --in w --range 0.98:1.1 --points 40 --json a.json",
        "continue --scene impact_oscillator --set s=-0.2 --from simulate --start -0.66,0 --in s --range -1:0",
        "continue --scene absorber --from simulate --in mu --range 0.09:0.11 --points 20",
    ],
    "sticking response": [
        "continue --scene impact_oscillator --set r=0 --set s=-.5 --set w=.5 --from simulate --start -.6,0 --in s --range -.6:-.4 "
        "--json d.json",
    ],
    "parameter": [
        "continue S13+ --in mu --range 0.09:0.12 --keep energy=0.8 --json b.json",
        "continue --from b.json:RT1 --points 20",
    ],
    "curve": [
        "continue --scene absorber --from rest --in w --range 0.7:2.2 --json b.json",
        "continue --from b.json:GR1 --json c.json",
        "curve c.json:SB1 --in w,F --range 0.5:1.5,0.2:0.4 --points 20",
        "curve c.json:2.NS1 --in w,F --range 0.5:1.5,0.2:0.4 --points 20",
        "curve c.json:GR1 --in w,F --range 0.5:1.5,0.2:0.4 --points 20",
    ],
    "sticking curve": [
        "continue --scene impact_oscillator --set r=0 --set s=-.5 --set w=.5 --from simulate --start -.6,0 --in s --range -.6:.5 "
        "--json a.json",
        "curve a.json:GR1 --in s,w --range -1:1,.3:.7 --points 10",
    ],
    "free curve": [
        "continue S11- --energy 0.05:0.2 --json a.json",
        "curve a.json:SN1 --in energy,mu --range 0.01:1,0.09:0.11 --points 20",
        "continue S13+ --energy 0.3:0.8 --json b.json",
        "curve b.json:SB1 --in energy,mu --range 0.01:1,0.09:0.11 --points 20",
    ],
    "smooth curve": [
        "continue --scene ueda_oscillator --set B=0.5 --set w=0.4 --from rest --in w --range 0.25:0.45 --json a.json",
        "curve a.json:SN1 --in w,B --range 0.2:0.5,0.4:0.6 --points 10",
    ],
    "smooth free curve": [
        "continue S11- --scene smooth_wall --n 15 --energy 0.06:0.11 --json a.json",
        "curve a.json:SN1 --scene smooth_wall --n 15 --in energy,n --range 0.05:0.08,14.7:15.3 --points 10",
        "curve a.json:PD1 --scene smooth_wall --n 15 --in energy,n --range 0.08:0.12,14.7:15.3 --points 10",
    ],
    "smooth": [
        "continue S11- --scene cubic_nes --energy 1e-2:0.1 --points 20",
        "continue --scene beam_on_cubic_spring --from mode:2 --points 8",
    ],
    "smooth parameter": ["continue S13+@h=5 --scene smooth_wall --in 1/n --range 0:0.12"],
    "smooth discover": [
        "discover --scene cubic_nes --energy 1 --max-quarter-period 3 --max-starts 64",
        "discover --scene cubic_and_stops --energy 2 --max-quarter-period 2 --max-impacts 4 --max-starts 64",
    ],
    "smooth run": [
        "run --scene cubic_nes --impulse 0.8 --lam 0.01 --set lam_nes=0.01 --duration 20 --stages",
        "run --scene cubic_and_stops --impulse 2 --set rho=0.7 --lam 0.01 --duration 20",
    ],
    "smooth section": ["section --scene cubic_nes --energy 0.05 --orbits 3 --crossings 20"],
    "smooth sweep": ["sweep --scene ueda_oscillator --in w --range 0.9:1.1 --points 2 --transient 5 --record 5"],
    "smooth response": ["continue --scene ueda_oscillator --set B=1 --from rest --in w --range 0.98:1.1 --points 10"],
    "smooth simulated response": [
        "continue --scene ueda_oscillator --set B=1 --from simulate --in w --range 0.98:1.1 --points 10 --csv a.csv",
    ],
    "basin": [
        "basin --scene absorber --set w=1.4 --grid 6x6 --workers 1",
        "basin --scene damped_impact_oscillator --set w=2.2 --set A=1 --set c=0.02 --grid 6x6 --workers 1",
        "basin --scene bouncing_ball --set Gamma=0.5 --grid 3x3 --workers 1",
    ],
    "smooth basin": ["basin --scene ueda_oscillator --set B=1 --grid 2x2 --workers 1"],
    "sweep": ["sweep --scene bouncing_ball --in w --range 0.9:1.1 --points 2 --transient 5 --record 5"],
}
"""Commands whose kernels are compiled together, by the name of the group."""

_STUDY = """
title = "example"
scene = "lee2009"
design = "grid"
fixed = { lam = 0.01, rho = 0.7 }
vary.energy = { from = 0.1, to = 10.0, points = 2 }
vary.sigma = { from = 0.0, to = 0.1, points = 2 }
"""


def called(commands: list[str]) -> list[list[Any]]:
    """The kernels that some commands call in this process, which has called none before: module, name and types of each, in order of their
    names."""
    from bvp.kernels.compiled import Kernel
    from saltus.__main__ import main

    @contextmanager
    def here(workers: int | None = None, dask: str | None = None) -> Iterator[tuple[Executor, int]]:
        with ThreadPoolExecutor(1) as pool:
            yield pool, 1

    processes.open_executor = here  # the kernels of worker processes are recorded, too
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        os.chdir(folder)
        Path("study.toml").write_text(_STUDY, encoding="utf-8")
        codes = [main(words.split()) for words in commands]
        assert not any(codes), codes
    kernels = [item for item in gc.get_objects() if isinstance(item, Kernel)]
    found = [[kernel.__module__, kernel.function.__qualname__, types] for kernel in kernels for types in kernel.entries]
    # Lists in place of tuples, as in the file.
    return sorted(json.loads(json.dumps(found)), key=repr)


def recorded(examples: Mapping[str, list[str]] = EXAMPLES) -> tuple[list[list[Any]], dict[str, list[int]]]:
    """All kernels that the examples call, and for each group the places of its kernels among them."""
    with ProcessPoolExecutor(1, mp_context=processes.new_processes(), max_tasks_per_child=1) as pool:
        results = zip(examples, pool.map(called, examples.values()), strict=True)
        by_group = dict(watched(results, lambda result: f"found the kernels of {result[0]!r}"))
    kernels = sorted({repr(call): call for calls in by_group.values() for call in calls}.items())
    places = {text: place for place, (text, _) in enumerate(kernels)}
    return [call for _, call in kernels], {group: [places[repr(call)] for call in calls] for group, calls in by_group.items()}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The task has no options."""
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the list, with the processor time that each kernel takes to compile. That of a kernel which is listed already stays."""
    kernels, commands = recorded()
    seconds = {repr(call[1:]): call[0] for call in json.loads(LIST.read_text(encoding="utf-8"))["kernels"]}
    with tempfile.TemporaryDirectory() as folder, patch.dict(os.environ, NUMBA_CACHE_DIR=folder):
        new = [[0.0, *call] for call in kernels if repr(call) not in seconds]
        progress(f"compiling {len(new)} new kernels")
        seconds |= {repr(call[1:]): call[0] for call in compile_kernels(new, 1)}
    lines = ",\n".join(json.dumps([round(seconds[repr(call)], 1), *call]) for call in kernels)
    groups = ",\n".join(f"{json.dumps(group)}: {json.dumps(places)}" for group, places in commands.items())
    LIST.write_text(f'{{"kernels": [\n{lines}\n],\n"commands": {{\n{groups}\n}}}}\n', encoding="utf-8")
    total = sum(seconds[repr(call)] for call in kernels)
    print(f"{LIST.name}: {len(kernels)} kernels of {len(commands)} groups of commands, {total:.0f} s to compile")
    return 0
