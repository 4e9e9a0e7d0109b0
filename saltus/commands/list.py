"""`saltus list`: the families of a catalogue."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from saltus import catalogues, options, outputs
from saltus.tables import counted

if TYPE_CHECKING:
    from branches.catalogue import FamilyRow
    from branches.export.tables import Table

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    options.add_filters(parser)
    outputs.add_arguments(parser, "json", "csv", "npz", "mat")
    catalogues.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    from branches.naming.matching import spelled
    from saltus.catalogues import family_record
    from saltus.tables import range_text, table_lines, terminal_width

    files = outputs.outputs_of(arguments)
    filters = options.filters_of(arguments)
    with catalogues.open_catalogue(arguments) as catalogue:
        families = catalogue.families(**filters)
        total, names = len(catalogue), list(catalogue.scene.reference_points)

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
        yield from table_lines(head, rows, width=terminal_width(sys.stdout), columns="lirllrrrt")
        yield f"{len(families)} of {counted(total, 'family')}"

    record = {"schema": catalogues.SCHEMA, "filters": options.given_filters(filters)}
    return files.finish(
        lines(), lambda: {**record, "families": [family_record(row) for row in families]}, table=lambda: family_table(families)
    )


def family_table(families: Sequence[FamilyRow]) -> Table:
    """A row for each family: what `saltus.catalogues.family_record` has of it, without its labels and its ends' reasons."""
    import numpy as np

    from saltus.catalogues import family_record

    records = [family_record(row) for row in families]
    texts = ("id", "label", "ends", "sequence")
    numbers = ("impacts", "h", "alpha", "points", "events", "stable_fraction")
    table: Table = {name: np.array([record[name] for record in records], dtype=str) for name in texts}
    return table | {name: np.array([record[name] for record in records]) for name in numbers}
