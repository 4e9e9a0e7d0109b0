"""Reading the pages that set the paper beside saltus: their tables, and the numbers printed there against numbers that are computed."""

import re
from pathlib import Path


def page(name):
    """The text of a page of docs/reference."""
    return (Path(__file__).parents[2] / "docs" / "reference" / name).read_text(encoding="utf-8")


def table(text, title):
    """The cells of the rows of the table under a title."""
    part = text.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if line.startswith("|")]
    return rows[2:]


def numbers(text):
    """The numbers printed in a cell, as texts; labels stand in code type or in their usual form, and are none."""
    bare = re.sub(r"`[^`]*`|\b[SUL]\(?[0-9][\w()]*[+-]*|\bu[12]\b|m 2 pi/T|T/4", " ", text)
    return re.findall(r"(?<![\w.])-?[0-9]+(?:\.[0-9]+)?", bare)


def compare(text, values):
    """Each number of a cell is one of the values, in order, rounded to its digits."""
    printed = numbers(text)
    assert len(printed) == len(values), (printed, values)
    for one, value in zip(printed, values, strict=True):
        digits = len(one.partition(".")[2])
        assert abs(float(one) - value) <= 0.5 * 10.0**-digits + 1e-9 * abs(value), (one, value)
