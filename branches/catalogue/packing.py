"""A branch as the rows that a catalogue keeps: plain data, which a worker makes and sends to the process that writes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from branches.catalogue.events import event_values
from branches.catalogue.intervals import label_intervals, stability_intervals
from branches.catalogue.points import layout_of, rows_of
from branches.catalogue.rows import FamilyRow
from branches.words import format_ends, impacts_per_period

if TYPE_CHECKING:
    import numpy as np

    from branches.branch import Branch

__all__ = ["PackedFamily", "pack"]


@dataclass(frozen=True)
class PackedFamily:
    """The rows of one family.

    Attributes
    ----------
    system : dict
        The description of its system.
    row : FamilyRow
        With the numbers of its rows still 0.
    points : list of tuple
        In the order of `POINT_COLUMNS`.
    blobs : tuple of bytes
        In the order of `BLOBS`.
    events : list of tuple
        In the order of `EVENT_COLUMNS`.
    """

    system: dict[str, Any]
    row: FamilyRow
    points: list[tuple[Any, ...]]
    blobs: tuple[bytes, ...]
    events: list[tuple[Any, ...]]


def pack(branch: Branch) -> PackedFamily:
    """The rows of a branch.

    Raises
    ------
    ValueError
        For a column of its points that cannot be kept.
    """
    columns = branch.points
    layout = layout_of(columns, branch.ends)
    packed = rows_of(columns, layout, branch.problem)
    row = FamilyRow.make(
        id=branch.id, label=branch.label, ends=format_ends(branch.ends), word=branch.word,
        impacts=0.5 * impacts_per_period(branch.problem.word, branch.ends), h=_range(columns["h"]), alpha=_range(columns["alpha"]),
        points=len(branch), events=len(branch.events), start=int(branch.start), labels=label_intervals(columns, branch.events),
        stability=stability_intervals(columns, branch.events), ended=tuple((str(end.reason), end.text) for end in branch.ended),
        layout=layout, first_point=0, columns_crc=packed.columns_crc, number=0,
    )  # fmt: skip
    return PackedFamily(branch.system.describe(), row, packed.rows, packed.blobs, [event_values(event) for event in branch.events])


def _range(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())
