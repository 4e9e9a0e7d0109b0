"""Put the results of `saltus bench` into docs/speed_error.md: tables between the marks of the page, pictures beside it.

    saltus bench --out bench
    python -m benchmarks.speed_error bench
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from saltus.bench.methods import methods
from saltus.bench.picture import draw_growth, draw_work_precision
from saltus.bench.report import page_text, tables
from saltus.bench.tables import PageError, check_page, write_page
from saltus.bench.tasks import TASKS
from saltus.commands.bench import DATA, GROWTH, PRECISION

__all__ = ["fill", "main"]

PAGE_IN_DOCS = Path("docs/speed_error.md")


def fill(results: Path, page: Path) -> None:
    """Put tables into a page and pictures into its folder of images.

    Raises
    ------
    PageError
        Where the results are not there, are those of a quick look, or the page has no place for them.
    """
    check_page(page)
    try:
        record = json.loads((results / DATA).read_text(encoding="utf-8"))
    except OSError as error:
        raise PageError(f"cannot read the results in {results}: {error.strerror}") from error
    if record["effort"] != "full":
        raise PageError(f"{results} has the results of a {record['effort']} bench; the page shows those of a full one")
    images = page.resolve().parent / "images"
    images.mkdir(exist_ok=True)
    tasks = list(TASKS.values())
    draw_work_precision(images / PRECISION, record["rows"], tasks)
    draw_growth(images / GROWTH, record["rows"])
    settings = {name: method.setting for name, method in methods().items()}
    write_page(page, page_text(record, tables(record["rows"], tasks, settings)))


def main(words: list[str] | None = None) -> int:
    """Fill the page; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed_error", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path, help="folder of `saltus bench --out`")
    parser.add_argument("--page", type=Path, default=PAGE_IN_DOCS, help=f"default: {PAGE_IN_DOCS}")
    arguments = parser.parse_args(words)
    try:
        fill(arguments.results, arguments.page)
    except PageError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
