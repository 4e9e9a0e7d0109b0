"""`saltus list`: the families of a catalogue."""

from __future__ import annotations

import argparse
import re
import sys

from saltus import catalogue_arguments
from saltus.arguments import positive
from saltus.errors import DONE
from saltus.files import STANDARD_OUTPUT, check_writable, write_data

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("--label", metavar="LABEL", help="those with such a label: S13O00+, U83, or with wildcards 'U8*'")
    parser.add_argument("--energy", metavar="H", type=positive, help="those that cross this energy")
    parser.add_argument("--stable", action="store_true", help="those that are stable somewhere (with --label and --energy: there)")
    parser.add_argument("--ends", metavar="ENDS", help="those between such ends: origin-origin, origin-stop, rest-stop+, periodic")
    parser.add_argument("--impacts", metavar="N|LO:HI", type=_impacts, help="those with so many impacts in half a period")
    catalogue_arguments.add_json(parser)
    catalogue_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    from saltus.catalogue_records import SCHEMA, family_record, json_text, range_text
    from saltus.listing import listing, width_of

    if arguments.json is not None:
        check_writable(arguments.json)
    filters = {name: getattr(arguments, name) for name in ("label", "energy", "stable", "ends", "impacts")}
    with catalogue_arguments.from_arguments(arguments) as catalogue:
        families = catalogue.families(**filters)
        total = len(catalogue)
    if arguments.json != STANDARD_OUTPUT:
        rows = []
        for row in families:
            others = [label for label in row.label_names if label != row.label]
            rows.append(
                (
                    row.label or "-", row.id, f"{row.impacts:g}", range_text(row.h), range_text(row.alpha),
                    f"{100.0 * row.stable_fraction:.0f}%", str(row.points), str(row.events), " ".join(others),
                )
            )  # fmt: skip
        head = ("label", "id", "impacts", "energy h", "quarter alpha", "stable", "points", "events", "other labels")
        for line in listing(head, rows, width=width_of(sys.stdout), right="llrllrrrl"):
            print(line)
        print(f"{len(families)} of {total} families")
    if arguments.json is not None:
        given = {name: value for name, value in filters.items() if value not in (None, False)}
        record = {"schema": SCHEMA, "filters": given, "families": [family_record(row) for row in families]}
        write_data(arguments.json, json_text(record))
        if arguments.json != STANDARD_OUTPUT:
            print(f"wrote  {arguments.json}")
    return DONE


def _impacts(text: str) -> tuple[float, float]:
    """Read a number or a range of impacts.

    Examples
    --------
    >>> _impacts("3"), _impacts("0:2.5")
    ((3.0, 3.0), (0.0, 2.5))
    >>> _impacts("5:1")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received '5:1', expected a number of impacts N, or LO:HI with 0 <= LO <= HI
    """
    found = re.fullmatch(r"(\d+(?:\.5|\.0)?)(?::(\d+(?:\.5|\.0)?))?", text)
    low, high = (float(found[1]), float(found[2] or found[1])) if found else (1.0, 0.0)
    if low > high:
        raise argparse.ArgumentTypeError(f"received {text!r}, expected a number of impacts N, or LO:HI with 0 <= LO <= HI")
    return low, high
