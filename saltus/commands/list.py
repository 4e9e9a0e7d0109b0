"""`saltus list`: the families of a catalogue."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

from saltus import catalogue_arguments, family_filters, outputs
from saltus.errors import DONE
from saltus.wording import counted

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    family_filters.add_arguments(parser)
    outputs.add_json(parser)
    catalogue_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    from branches.labels import spelled
    from saltus.catalogue_records import family_record, range_text, tell
    from saltus.listing import listing, width_of

    filters = family_filters.from_arguments(arguments)
    with catalogue_arguments.opened(arguments) as catalogue:
        families = catalogue.families(**filters)
        total, names = len(catalogue), list(catalogue.scene.pins)

    def lines() -> Iterator[str]:
        rows = []
        for row in families:
            label, *others = dict.fromkeys(spelled(text, names) for text in (row.label, *row.label_names))
            rows.append(
                (
                    label or "-", row.id, f"{row.impacts:g}", range_text(row.h), range_text(row.alpha),
                    f"{100.0 * row.stable_fraction:.0f}%", str(row.points), str(row.events), " ".join(others),
                )
            )  # fmt: skip
        head = ("label", "id", "impacts", "energy h", "quarter alpha", "stable", "points", "events", "other labels")
        yield from listing(head, rows, width=width_of(sys.stdout), columns="lirllrrrt")
        yield f"{len(families)} of {counted(total, 'family')}"

    tell(arguments.json, lines(), lambda: {"filters": family_filters.told(filters), "families": [family_record(row) for row in families]})
    return DONE
