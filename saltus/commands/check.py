"""`saltus check FILE`: whether a catalogue is what it says; nothing is repaired."""

from __future__ import annotations

import argparse

from saltus import outputs
from saltus.errors import DONE, FAILED
from saltus.files import check_writable
from saltus.wording import counted

__all__ = ["add_arguments", "run"]

THINGS = {"families": "family", "points": "point", "events": "event", "edges": "edge"}
"""What is counted, and what one of it is called."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("file", metavar="FILE", help="the catalogue")
    outputs.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code: 1 where something fails."""
    if arguments.json is not None:
        check_writable(arguments.json)

    from branches.catalogue import Catalogue
    from saltus.catalogue_records import tell
    from saltus.first_run import prepare
    from saltus.progress import ProgressBar

    with Catalogue(arguments.file) as catalogue:
        prepare()

        from branches.catalogue.check import check

        with ProgressBar(len(catalogue), "families") as bar:
            counts, failures = check(catalogue, bar.update)
    looked = ", ".join(counted(counts[name], thing) for name, thing in THINGS.items())
    lines = [f"FAILS  {failure.where}: {failure.text}" for failure in failures]
    lines.append(f"{looked} looked at: " + (f"{counted(len(failures), 'failure')}" if failures else "all hold"))
    if counts["hidden"]:
        lines.append(f"{counted(counts['hidden'], 'event')} hidden by rounding: stability changes there, seen in fifty digits")
    tell(arguments.json, lines, lambda: {"counts": counts, "failures": [failure._asdict() for failure in failures]})
    return FAILED if failures else DONE
