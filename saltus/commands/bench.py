"""`saltus bench`: speed against error, beside other methods, in one go on one machine."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from saltus.errors import DONE, FAILED, INTERRUPTED, say
from saltus.files import WriteFailure, output_folder, replacing, write_data
from saltus.printing import plain_stream
from saltus.threads import one_thread

if TYPE_CHECKING:
    from saltus.bench.effort import Effort
    from saltus.bench.methods import Method
    from saltus.bench.rows import RowFile
    from saltus.bench.tasks import Task

__all__ = ["FILES", "add_arguments", "run"]

ROWS, DATA, PAGE, PRECISION, GROWTH = FILES = ("bench.rows.jsonl", "bench.json", "bench.md", "work_precision.png", "growth.png")
"""What is written: each row as it is finished, all data, the tables, and the pictures."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--quick", action="store_true", help="fewer tasks, methods and settings: below a minute, for a look")
    parser.add_argument("--out", metavar="DIR", default="bench", help="folder of the results, made if there is none (default: bench)")


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    folder = output_folder("--out", arguments.out, FILES)
    one_thread()
    from saltus.bench.effort import FULL, QUICK
    from saltus.bench.methods import methods
    from saltus.bench.tasks import TASKS

    effort = QUICK if arguments.quick else FULL
    tasks = [task for name, task in TASKS.items() if effort.tasks is None or name in effort.tasks]
    used = [method for name, method in methods().items() if effort.methods is None or name in effort.methods]
    return bench(folder, effort, tasks, used)


def bench(folder: Path, effort: Effort, tasks: Sequence[Task], used: Sequence[Method]) -> int:
    """Do the work and write the results into a folder; return the exit code."""
    from saltus.bench.machine import describe
    from saltus.bench.rows import RowFile

    machine = describe()
    print("\n".join(machine), flush=True)
    for method in used:
        reason = method.missing()
        if reason is not None:
            print(f"skipped  {method.name}: {reason}", flush=True)
    try:
        rows = RowFile(folder / ROWS)
        try:
            _measure(rows, effort, tasks, used)
        finally:
            rows.close()
    except KeyboardInterrupt:
        say(f"interrupted; {folder / ROWS} keeps the {len(rows.rows)} rows that were finished")
        return INTERRUPTED
    except WriteFailure as failure:
        say(str(failure))
        return FAILED
    return _write(folder, effort, machine, rows.rows, tasks, used)


def _measure(rows: RowFile, effort: Effort, tasks: Sequence[Task], used: Sequence[Method]) -> None:
    from saltus.bench.growth import growth
    from saltus.bench.rows import rows_of
    from saltus.progress import ProgressBar

    with ProgressBar(things="rows") as bar:
        for row in rows_of(tasks, used, effort, lambda text: bar.update(len(rows.rows), text)):
            rows.add(row)
        bar.update(len(rows.rows), "growth")
        for row in growth(effort):
            rows.add(row)
            bar.update(len(rows.rows), "growth")


def _write(
    folder: Path, effort: Effort, machine: list[str], rows: list[dict[str, Any]], tasks: Sequence[Task], used: Sequence[Method]
) -> int:
    """Write and print what the rows say."""
    from saltus.bench.picture import draw_growth, draw_work_precision
    from saltus.bench.report import page_text, tables

    skipped = {method.name: reason for method in used if (reason := method.missing()) is not None}
    record = {"schema": 1, "effort": effort.name, "machine": machine, "skipped": skipped, "rows": rows}
    found = tables(rows, tasks, {method.name: method.setting for method in used})
    _print(found)
    code = DONE

    def drawn(name: str, draw: Any) -> None:
        with replacing(folder / name) as beside:
            draw(beside)

    jobs = (
        (DATA, lambda name: write_data(str(folder / name), json.dumps(record, indent=1, allow_nan=False) + "\n")),
        (PAGE, lambda name: write_data(str(folder / name), page_text(record, found))),
        (PRECISION, lambda name: drawn(name, lambda beside: draw_work_precision(beside, rows, tasks))),
        (GROWTH, lambda name: drawn(name, lambda beside: draw_growth(beside, rows))),
    )
    for name, job in jobs:
        try:
            job(name)
        except WriteFailure as failure:
            say(str(failure))
            code = FAILED
        else:
            print(f"wrote  {folder / name}", flush=True)
    return code


def _print(found: Sequence[Any]) -> None:
    """The tables in the terminal."""
    from rich.console import Console
    from rich.table import Table

    console = Console(file=plain_stream(), width=None if sys.stdout.isatty() else 140)
    for table in found:
        shown = Table(
            title=table.title, title_justify="left", caption=" ".join(table.notes) or None, caption_justify="left", box=None,
            header_style="bold", pad_edge=False,
        )  # fmt: skip
        for index, column in enumerate(table.columns):
            shown.add_column(column, justify="left" if index == 0 else "right")
        for row in table.rows:
            shown.add_row(*row)
        console.print(shown)
