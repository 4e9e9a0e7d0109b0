"""The table of docs/hard_cases.md: every hard case with the error that its test measures.

    python -m benchmarks.hard_cases [--quick]

runs tests/hard, and what belongs to it in tests/full unless --quick (those rows then stay as they are), and writes the tables into the
page. Tests that fail leave the page alone.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from branches.files import write_text
from saltus.bench.machine import describe
from tests.hard.cases import HEADINGS, RECORD, Case, all_cases

__all__ = ["main", "old_errors", "page", "tables"]

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "hard_cases.md"
BEGIN = "<!-- tables: python -m benchmarks.hard_cases -->"
END = "<!-- end of the tables -->"


def cells(case: Case) -> str:
    """What stands in the line of a case before its number."""
    return "| " + " | ".join(part.replace("|", "\\|") for part in (case.text, case.source, case.what)) + " | "


def row(case: Case, error: float | None) -> str:
    """The line of a case; "not measured" where there is no error."""
    measured = "not measured" if error is None else f"{error:.1e}" if error else "0"
    return f"{cells(case)}{measured} | {case.limit:g} |"


def tables(errors: dict[tuple[str, str], float]) -> str:
    """All tables, a heading each."""
    lines = []
    for heading, title in HEADINGS.items():
        lines += ["", f"## {title}", "", "| case | expected answer | error of | measured | allowed |", "|---|---|---|---|---|"]
        lines += [row(case, errors.get((case.heading, case.text))) for case in all_cases() if case.heading == heading]
    return "\n".join(lines)


def page(text: str, errors: dict[tuple[str, str], float], where: list[str]) -> str:
    """The page with its tables made anew."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page has no lines {BEGIN!r} and {END!r} to write between")
    return f"{before}{BEGIN}\n\n{where[0]} {where[-1]}\n{tables(errors)}\n\n{END}{after}"


def old_errors(text: str) -> dict[tuple[str, str], float]:
    """The errors that the page has."""
    known: dict[tuple[str, str], float] = {}
    for case in all_cases():
        for line in text.splitlines():
            if line.startswith(cells(case)) and "not measured" not in line:
                known[case.heading, case.text] = float(line[len(cells(case)) :].split("|")[0])
    return known


def main(arguments: list[str] | None = None) -> int:
    """Run the tests, write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hard_cases", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="without what is in tests/full")
    quick = parser.parse_args(arguments).quick
    paths = ["tests/hard"] if quick else ["tests/hard", "tests/full/test_missed_events.py"]
    text = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "errors.jsonl"
        environment = {**os.environ, RECORD: str(record)}
        code = subprocess.call([sys.executable, "-m", "pytest", "--deselect", "tests/hard/test_page.py", *paths], cwd=ROOT, env=environment)
        if code != 0:
            print("a hard case fails: the page stays as it is", file=sys.stderr)
            return 1
        errors = old_errors(text) if quick else {}
        found: dict[tuple[str, str], float] = {}
        for line in record.read_text(encoding="utf-8").splitlines():
            heading, case, error = json.loads(line)
            found[heading, case] = max(error, found.get((heading, case), 0.0))
    write_text(PAGE, page(text, {**errors, **found}, describe()))
    print(f"{PAGE.relative_to(ROOT)}: {len(found)} cases measured")
    return 0


if __name__ == "__main__":
    sys.exit(main())
