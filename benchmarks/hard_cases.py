"""`python -m benchmarks hard-cases`: the tables of docs/reference/hard_cases.md, every hard case with the error that its test measures.

The task runs tests/hard and the long cases of tests/full, and writes the tables into the page. With `--quick` it leaves the long cases out,
and their rows stay as they are. If a test fails, the page does not change.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.report import machine, write_page
from saltus.errors import DONE
from tests.hard.cases import HEADINGS, RECORD, Case, all_cases

__all__ = ["add_arguments", "old_errors", "page_tables", "run", "tables"]

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reference" / "hard_cases.md"
BEGIN = "<!-- tables: python -m benchmarks hard-cases -->"
END = "<!-- end of the tables -->"


def cells(case: Case) -> str:
    """The first columns of a case, up to the measured error."""
    return "| " + " | ".join(part.replace("|", "\\|") for part in (case.text, case.source, case.what)) + " | "


def row(case: Case, error: float | None) -> str:
    """The row of a case; "not measured" without an error."""
    measured = "not measured" if error is None else f"{error:.1e}" if error else "0"
    return f"{cells(case)}{measured} | {case.limit:g} |"


def tables(errors: dict[tuple[str, str], float]) -> str:
    """All tables with their headings."""
    lines = []
    for heading, title in HEADINGS.items():
        lines += ["", f"## {title}", "", "| case | expected answer | error of | measured | allowed |", "|---|---|---|---|---|"]
        lines += [row(case, errors.get((case.heading, case.text))) for case in all_cases() if case.heading == heading]
    return "\n".join(lines)


def page_tables(errors: dict[tuple[str, str], float], where: list[str]) -> str:
    """The text between the marks of the page: the machine and the tables."""
    return f"{where[0]} {where[-1]}\n{tables(errors)}"


def old_errors(text: str) -> dict[tuple[str, str], float]:
    """The errors on the page."""
    known: dict[tuple[str, str], float] = {}
    for case in all_cases():
        for line in text.splitlines():
            if line.startswith(cells(case)) and "not measured" not in line:
                known[case.heading, case.text] = float(line[len(cells(case)) :].split("|")[0])
    return known


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the task."""
    parser.add_argument("--quick", action="store_true", help="without the cases in tests/full")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the tests and write the page; return the exit code."""
    paths = ["tests/hard"] if arguments.quick else ["tests/hard", "tests/full/test_missed_events.py"]
    text = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "errors.jsonl"
        environment = {**os.environ, RECORD: str(record)}
        code = subprocess.call([sys.executable, "-m", "pytest", "--deselect", "tests/hard/test_page.py", *paths], cwd=ROOT, env=environment)
        if code != 0:
            raise RuntimeError("a hard case fails: the page stays as it is")
        errors = old_errors(text) if arguments.quick else {}
        found: dict[tuple[str, str], float] = {}
        for line in record.read_text(encoding="utf-8").splitlines():
            heading, case, error = json.loads(line)
            found[heading, case] = max(error, found.get((heading, case), 0.0))
    write_page(PAGE, page_tables({**errors, **found}, machine()), BEGIN, END)
    print(f"{PAGE.name}: {len(found)} cases measured")
    return DONE
