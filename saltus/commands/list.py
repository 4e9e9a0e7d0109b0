"""`saltus list`: the families of a catalogue."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from saltus import catalogues, options, outputs
from saltus.terminal import counted, range_text, table_lines, terminal_width

if TYPE_CHECKING:
    from branches.tables import Table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    options.add_filters(parser)
    outputs.add_arguments(parser, "json", "csv", "npz", "mat")
    catalogues.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)

    from branches.naming.matching import spelled

    filters = options.filters_of(arguments)
    with catalogues.open_catalogue(arguments) as catalogue:
        families = catalogue.families(**filters)
        total, names = len(catalogue), list(catalogue.scene.reference_points)

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
    lines = table_lines(head, rows, width=terminal_width(sys.stdout), columns="lirllrrrt")
    records = [catalogues.family_record(row) for row in families]
    return files.finish(
        [*lines, f"{len(families)} of {counted(total, 'family')}"],
        lambda: {"schema": catalogues.SCHEMA, "filters": filters, "families": records},
        table=lambda: family_table(records),
    )


def family_table(records: list[dict[str, Any]]) -> Table:
    """A row for each family: its record without its labels and its ends' reasons."""
    import numpy as np

    texts = ("id", "label", "ends", "sequence")
    numbers = ("impacts", "h", "alpha", "points", "events", "stable_fraction")
    table: Table = {name: np.array([record[name] for record in records], dtype=str) for name in texts}
    return table | {name: np.array([record[name] for record in records]) for name in numbers}
