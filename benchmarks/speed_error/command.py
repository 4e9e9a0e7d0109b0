"""`python -m benchmarks speed-error`: speed against error of all methods on all tasks, and the growth of cost."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from benchmarks.peers.auto import Auto07p
from benchmarks.peers.collocation import Collocation
from benchmarks.peers.integrators import INTEGRATORS
from benchmarks.peers.nonsmooth_time import NonsmoothTime
from benchmarks.report import check_page, machine, show, write_page
from benchmarks.speed_error.exact import EXACT
from benchmarks.speed_error.methods import Method, Task
from benchmarks.speed_error.results import draw_growth, draw_work_precision, page_text, tables
from benchmarks.speed_error.rows import FULL, QUICK, Effort, RowFile, growth, task_rows
from benchmarks.speed_error.tasks import TASKS
from branches.files import WriteFailure, replacing, write_text
from saltus.errors import DONE, FAILED, INTERRUPTED, BadInput, say
from saltus.outputs import output_folder

__all__ = ["FILES", "METHODS", "add_arguments", "fill", "measure", "read_results", "run"]

ROWS, DATA, PAGE, PRECISION, GROWTH = FILES = ("bench.rows.jsonl", "bench.json", "bench.md", "work_precision.png", "growth.png")
"""The files written: each row as soon as it is finished; all data; the tables; the figures."""

SCHEMA = 3
"""Of `DATA`. In schema 1, rows of discoveries had the key "settled" instead of "complete". Before schema 3, layers had no scatter."""

METHODS: dict[str, Method] = {
    method.name: method for method in (*EXACT, *INTEGRATORS, NonsmoothTime(), Collocation(), Auto07p())
}
"""All methods by name, in the order in which they are measured."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the task."""
    parser.add_argument("--quick", action="store_true", help="fewer tasks, methods and settings: less than a minute")
    parser.add_argument("--out", metavar="DIR", default="bench", help="folder of the results, created if missing (default: bench)")
    parser.add_argument("--fill", metavar="PAGE", type=Path, help="measure nothing: put the results in DIR into this page")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the task; return the exit code."""
    if arguments.fill is not None:
        fill(Path(arguments.out), arguments.fill)
        return DONE
    folder = output_folder("--out", arguments.out, FILES)
    effort = QUICK if arguments.quick else FULL
    tasks = [task for name, task in TASKS.items() if effort.tasks is None or name in effort.tasks]
    used = [method for name, method in METHODS.items() if effort.methods is None or name in effort.methods]
    return measure(folder, effort, tasks, used)


def measure(folder: Path, effort: Effort, tasks: Sequence[Task], used: Sequence[Method]) -> int:
    """Measure methods on tasks and write the results into a folder; return the exit code."""
    described = machine()
    print("\n".join(described), flush=True)
    skipped = {method.name: why for method in used if (why := method.missing()) is not None}
    for name, why in skipped.items():
        print(f"skipped  {name}: {why}", flush=True)
    used = [method for method in used if method.name not in skipped]
    with closing(RowFile(folder / ROWS)) as file:
        try:
            for task in tasks:
                for method in used:
                    for row in task_rows(task, method, effort) if method.does(task) else ():
                        file.add(row)
            for row in growth(effort):
                file.add(row)
        except KeyboardInterrupt:
            say(f"interrupted; {folder / ROWS} keeps the {len(file.rows)} finished rows")
            return INTERRUPTED
    record = {"schema": SCHEMA, "effort": effort.name, "machine": described, "skipped": skipped, "rows": file.rows}
    return _write(folder, record, tasks, {method.name: method.setting for method in used})


def _write(folder: Path, record: dict[str, Any], tasks: Sequence[Task], settings: dict[str, str]) -> int:
    """Print the tables and write all files that can be written; return the exit code."""
    found = tables(record["rows"], tasks, settings)
    for table in found:
        show(table)

    def draw(name: str, figure: Callable[[Path], None]) -> None:
        with replacing(folder / name) as beside:
            figure(beside)

    jobs: dict[str, Callable[[], None]] = {
        DATA: lambda: write_text(folder / DATA, json.dumps(record, indent=1, allow_nan=False) + "\n"),
        PAGE: lambda: write_text(folder / PAGE, page_text(record, found)),
        PRECISION: lambda: draw(PRECISION, lambda path: draw_work_precision(path, record["rows"], tasks)),
        GROWTH: lambda: draw(GROWTH, lambda path: draw_growth(path, record["rows"])),
    }
    code = DONE
    for name, job in jobs.items():
        try:
            job()
        except WriteFailure as failure:
            say(str(failure))
            code = FAILED
        else:
            print(f"wrote  {folder / name}", flush=True)
    return code


def read_results(folder: Path) -> dict[str, Any]:
    """Read the data in a folder of results, of this schema or an earlier one.

    Raises
    ------
    BadInput
        If it cannot be read.
    """
    try:
        record = json.loads((folder / DATA).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"cannot read the results in {folder}: {error.strerror}") from error
    for row in record.get("rows", ()):
        if "settled" in row:
            row["complete"] = row.pop("settled")
        if record.get("schema", 1) < SCHEMA and row.get("layers"):
            row["layers"] = {name: [seconds, 0.0] for name, seconds in row["layers"].items()}
    return record


def fill(results: Path, page: Path) -> None:
    """Put the tables of a full run between the marks of a page, and its figures into the folder of images beside the page.

    Raises
    ------
    BadInput
        If the results are missing or those of a quick run, or the page has no place for them.
    """
    check_page(page)
    record = read_results(results)
    if record["effort"] != "full":
        raise BadInput(f"{results} has the results of a {record['effort']} run; expected a full one")
    images = page.resolve().parent / "images"
    images.mkdir(exist_ok=True)
    tasks = list(TASKS.values())
    draw_work_precision(images / PRECISION, record["rows"], tasks)
    draw_growth(images / GROWTH, record["rows"])
    settings = {name: method.setting for name, method in METHODS.items()}
    write_page(page, page_text(record, tables(record["rows"], tasks, settings)))
