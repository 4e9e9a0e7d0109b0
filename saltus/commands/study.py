"""`saltus study FILE.toml`: many damped motions over a grid or a Latin hypercube of parameters."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from saltus import options, processes
from saltus.errors import DONE, INTERRUPTED, BadInput, say
from saltus.terminal import ProgressBar, counted, table_lines

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from saltus.motion.study import StudyFile
    from transitions.study.study import Study

FORMATS = ("npz", "parquet")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("file", metavar="FILE", help="TOML file of the study")
    parser.add_argument("--out", metavar="FOLDER", help="folder of the results (default: FILE with .study instead of .toml)")
    options.add_set(parser)
    options.add_shared(parser, "workers", "dask")
    parser.add_argument("--format", metavar="KIND", choices=FORMATS, default="npz", help="npz (default), or parquet")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    from importlib.util import find_spec

    from saltus.motion.study import check_folder, read_study_file

    study = read_study_file(arguments.file, options.parameters_of(arguments))
    folder = _folder(arguments)
    if arguments.format == "parquet" and find_spec("pyarrow") is None:
        raise BadInput("--format parquet needs the package pyarrow, which is not installed; expected pip install 'saltus[parquet]'")
    check_folder(folder, study.plan, arguments.format)
    with processes.open_executor(arguments.workers, arguments.dask) as (executor, count):
        try:
            return _study(study, folder, arguments.format, executor, count)
        except KeyboardInterrupt:
            say(f"interrupted; {folder} keeps what was finished, and the same command goes on" if folder.exists() else "interrupted")
            return INTERRUPTED


def _folder(arguments: argparse.Namespace) -> Path:
    """The study's folder, after looking whether it can be made."""
    folder = Path(arguments.out if arguments.out is not None else Path(arguments.file).with_suffix(".study"))
    parent = folder if folder.is_dir() else folder.parent
    if not parent.is_dir():
        raise BadInput(f"cannot make the folder {folder}: the directory {parent} does not exist")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise BadInput(f"cannot make the folder {folder}: permission is denied in the directory {parent}")
    return folder


def _study(study: StudyFile, folder: Path, kind: str, executor: Executor, workers: int) -> int:
    from branches.catalogue.database import WriterLock
    from saltus import __version__
    from saltus.motion.study import carry_out, find_all_starts, keep_starts, kept_starts
    from transitions.study.study import Study, finished_blocks, write_plan

    plan = study.plan
    damaged: list[str] = []
    starts, wanted = kept_starts(study, folder, damaged.append)
    if wanted:
        # Errors of a family are reported before anything is written.
        with ProgressBar():
            starts = find_all_starts(study, executor)
    folder.mkdir(exist_ok=True)
    lock = WriterLock(folder / "study.json")
    try:
        finished = finished_blocks(folder, plan, plan.digest, kind, damaged.append)
        if wanted and starts is not None:
            keep_starts(starts, folder, plan.digest)
        write_plan(folder, plan, kind, __version__)
        for text in damaged:
            print(f"DAMAGED  {text}; done again")
        over = [f"{name} ({count})" for name, count in zip(plan.names, plan.shape, strict=True)] if plan.design == "grid" else plan.names
        size = f"a {plan.design} over {', '.join(over)}, {plan.count} runs in {counted(plan.blocks, 'block')}"
        print(f"study    {folder}: {size}; {len(finished)} of {plan.blocks} blocks are finished")
        with ProgressBar(plan.count, "runs") as bar:
            carry_out(plan, starts, folder, kind, finished, executor, workers, bar.update)
    finally:
        lock.release()
    for line in study_lines(Study(folder)):
        print(line)
    return DONE


def study_lines(study: Study) -> list[str]:
    """The lines about a study's results."""
    import numpy as np

    endings = ", ".join(f"{count}: {ending.text}" for ending, count in study.endings().items())
    lines = [f"done     {len(study)} runs, {int(study['impacts'].sum())} impacts", f"ended    {endings}"]
    cells: list[tuple[str, ...]] = []
    for name in study.names:
        values = study.read(name).astype(float)
        values = values[np.isfinite(values)]
        if not len(values) or name == "ended":
            continue
        if name == "balance_error":
            lines.append(f"balance  closes to {values.max():.1e} of the initial energy at worst")
        else:
            cells.append((name, *(f"{value:.5g}" for value in np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0]))))
    return lines + table_lines(("", "least", "quartile", "median", "quartile", "most"), cells, columns="lrrrrr")
