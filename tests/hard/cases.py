"""The hard cases: what each shows, where its expected answer comes from, and the error that is measured.

A test that is decorated with `hard` returns the largest error that it has met; the decorator asks that it stays within the limit, and
records it on demand: `python -m benchmarks hard-cases` writes the tables of docs/reference/hard_cases.md from that.
"""

import functools
import importlib
import json
import math
import os
from dataclasses import dataclass

HEADINGS = {
    "multipliers": "Multipliers",
    "grazing": "Grazing",
    "branching": "Branching",
    "resonance": "Resonance",
    "range": "Range",
    "missed_events": "Missed events",
    "saltation": "Saltation",
}
"""The files of tests/hard (test_*.py), some with a part of the same name in tests/full, in the order of the page."""

RECORD = "SALTUS_HARD_CASES"
"""Environment variable with the file to which errors are appended, one JSON list [heading, case, error] a line."""


@dataclass(frozen=True)
class Case:
    """One line of the table: heading, the case in words, what the expected answer is and where it comes from, the error allowed."""

    heading: str
    text: str
    source: str
    limit: float
    what: str


CASES: list[Case] = []
"""All cases whose files were imported, in the order of the files."""


def largest(*errors):
    """The largest error; NaN where one of them is, which `max` would pass over.

    Examples
    --------
    >>> largest(1e-15, float("nan"))
    nan
    """
    return math.nan if any(math.isnan(error) for error in errors) else max(errors)


def hard(text, *, source, limit, what):
    """Decorate a test that returns its largest measured error.

    Parameters
    ----------
    text : str
        The case in words.
    source : str
        Where the expected answer comes from.
    limit : float
        Largest error allowed.
    what : str
        What the error is of.
    """

    def wrap(test):
        heading = test.__module__.rpartition(".test_")[2]
        if not any((case.heading, case.text) == (heading, text) for case in CASES):
            CASES.append(Case(heading, text, source, limit, what))

        @functools.wraps(test)
        def run(*arguments, **options):
            error = float(test(*arguments, **options))
            if RECORD in os.environ:
                with open(os.environ[RECORD], "a", encoding="utf-8") as file:
                    file.write(json.dumps([heading, text, error]) + "\n")
            assert math.isfinite(error) and error <= limit, f"{text}: {what} {error:.3e}, allowed {limit:g}"

        return run

    return wrap


def all_cases():
    """Every case, whether its tests run or not."""
    for heading in HEADINGS:
        importlib.import_module(f"tests.hard.test_{heading}")
    importlib.import_module("tests.full.test_missed_events")
    return [case for heading in HEADINGS for case in CASES if case.heading == heading]
