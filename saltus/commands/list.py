"""`saltus list`: the families of a catalogue."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from saltus import catalogues, curves, options, outputs
from saltus.errors import FAILED, say
from saltus.terminal import counted, range_text, stability_word, table_lines, terminal_width

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

    with catalogues.open_catalogue(arguments) as catalogue:
        filters = catalogues.filters_for(catalogue, arguments)
        families = catalogue.families(**filters)
        total, names = len(catalogue), list(catalogue.scene.reference_points)
        axes, is_of_responses = catalogue.scene.axes, bool(catalogue.scene.parameters)
        kept = curves.rows_record(catalogue)
        damage = catalogue.damage()
        records = [catalogues.in_axes(catalogue, catalogues.family_record(catalogue, row)) for row in families]

    rows: list[tuple[str, ...]] = []
    for row in families:
        stable = f"{100.0 * row.stable_fraction:.0f}%" if any(part.value >= 0 for part in row.stability) else stability_word(-1)
        label, *others = dict.fromkeys(spelled(text, names) for text in (row.label, *row.label_names))
        rows.append(
            (
                label or "-", row.id, f"{row.impacts:g}", range_text(row.h), range_text(row.alpha),
                stable, str(row.points), str(row.events), " ".join(others),
            )
        )  # fmt: skip
    head: tuple[str, ...] = ("label", "id", "impacts", *axes.names, "stable", "points", "events", "other labels")
    columns = "lirllrrrt"
    if is_of_responses:
        rows, head, columns = [row[1:-1] for row in rows], head[1:-1], columns[1:-1]
    lines = table_lines(head, rows, width=terminal_width(sys.stdout), columns=columns)
    about = {"parameter": axes.symbols[0]} if is_of_responses else {}
    listed = {"curves": kept} if is_of_responses else {}
    if damage:
        say(f"{catalogue.path} is damaged: {damage}; saltus check names all that is")
    code = files.finish(
        [*lines, f"{len(families)} of {counted(total, 'family')}", *curves.list_lines(kept, terminal_width(sys.stdout))],
        lambda: {"schema": catalogues.SCHEMA, **about, "filters": filters, "families": records, **listed},
        table=lambda: family_table(records),
    )
    return max(code, FAILED) if damage else code


def family_table(records: list[dict[str, Any]]) -> Table:
    """A row for each family: its record without its labels and its ends' reasons."""
    import numpy as np

    texts = ("id", "label", "ends", "closure", "sequence")
    numbers = ("impacts", "h", "alpha", "parameter", "period", "points", "events", "stable_fraction")
    present = records[0] if records else dict.fromkeys((*texts, *numbers))
    table: Table = {name: np.array([record[name] for record in records], dtype=str) for name in texts if name in present}
    return table | {name: np.array([record[name] for record in records]) for name in numbers if name in present}
