"""`saltus list`: the families of a catalogue."""

from __future__ import annotations

import argparse
import sys

from saltus import catalogue_arguments, family_filters
from saltus.errors import DONE
from saltus.files import STANDARD_OUTPUT, check_writable, write_data

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    family_filters.add_arguments(parser)
    catalogue_arguments.add_json(parser)
    catalogue_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    from saltus.catalogue_records import SCHEMA, family_record, json_text, range_text
    from saltus.listing import listing, width_of

    if arguments.json is not None:
        check_writable(arguments.json)
    filters = family_filters.from_arguments(arguments)
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
