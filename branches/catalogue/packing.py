"""A branch as the rows of a catalogue: plain data that a worker makes and sends to the process that writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.catalogue.points import encode, queried_rows
from branches.catalogue.rows import FamilyRow, LabelInterval, StabilityInterval, compact_json, event_values
from branches.sequences import format_ends, impacts_per_period

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.events import BranchEvent

__all__ = ["PackedFamily", "label_intervals", "pack_family", "stability_intervals"]


@dataclass(frozen=True)
class PackedFamily:
    """The rows of one family.

    Attributes
    ----------
    system : dict
        The description of its system.
    row : FamilyRow
        With the number 0.
    points : list of tuple
        Columns `branches.catalogue.points.QUERIED`.
    arrays : bytes
        All other columns of its points, as an .npz file.
    events : list of tuple
    """

    system: dict[str, Any]
    row: FamilyRow
    points: list[tuple[Any, ...]]
    arrays: bytes
    events: list[tuple[Any, ...]]


def pack_family(branch: Branch) -> PackedFamily:
    """The rows of a branch.

    Raises
    ------
    ValueError
        For a column of its points that cannot be stored.
    """
    columns = branch.points
    arrays, layout = encode(columns, branch.problem)
    labels = label_intervals(columns, branch.events)
    stability = stability_intervals(columns, branch.events)
    ended = tuple((str(end.reason), end.text) for end in branch.ended)
    row = FamilyRow(
        0, branch.id, branch.label, format_ends(branch.ends), branch.sequence, 0.5 * impacts_per_period(branch.problem.word, branch.ends),
        *_range(columns["h"]), *_range(columns["alpha"]), len(branch), len(branch.events), int(branch.start), _stable_fraction(stability),
        " ".join(dict.fromkeys(part.label for part in labels if part.label)),
        compact_json({"labels": labels, "stability": stability, "ended": ended, "layout": layout}),
    )  # fmt: skip
    return PackedFamily(branch.system.describe(), row, queried_rows(columns), arrays, [event_values(event) for event in branch.events])


def label_intervals(columns: dict[str, np.ndarray], events: Sequence[BranchEvent]) -> tuple[LabelInterval, ...]:
    """The labels along a family. Each interval begins where the last one ends, at the event of the change if there is one, so that
    no energy falls between them."""
    runs = _runs([str(label) for label in columns["label"]])
    changes = {event.point for event in events if event.type == "LB"}
    borders = [first if first in changes else first - 1 for _, first, _ in runs[1:]]
    spans = zip([0, *borders], [*borders, len(columns["label"]) - 1], strict=True)
    return tuple(LabelInterval(label, *_ranges(columns, *span)) for (label, _, _), span in zip(runs, spans, strict=True))


def stability_intervals(columns: dict[str, np.ndarray], events: Sequence[BranchEvent]) -> tuple[StabilityInterval, ...]:
    """Stable, unstable and undecided intervals of a family.

    At a bifurcation a multiplier is at its bound and stability is undecided. Such a single point is the border of its neighbours, not an
    interval of its own.
    """
    codes = [int(code) for code in columns["stable"]]
    for point in {event.point for event in events}:
        if codes[point] == -1 and 0 < point < len(codes) - 1 and -1 not in (codes[point - 1], codes[point + 1]):
            codes[point] = codes[point - 1]
        elif codes[point] == -1 and len(codes) > 1 and point in (0, len(codes) - 1):
            codes[point] = codes[1] if point == 0 else codes[-2]
    runs = _runs(codes)
    return tuple(StabilityInterval(code, *_ranges(columns, max(first - 1, 0), last)) for code, first, last in runs)


def _stable_fraction(stability: Sequence[StabilityInterval]) -> float:
    """The stable fraction of the arclength."""
    total = stability[-1].arclength[1] - stability[0].arclength[0]
    stable = sum(part.arclength[1] - part.arclength[0] for part in stability if part.stable == 1)
    return stable / total if total > 0.0 else float(stability[0].stable == 1)


def _runs(values: Sequence) -> list[tuple]:
    """(value, first, last) of each run of equal values."""
    out: list[tuple] = []
    for i, value in enumerate(values):
        if out and out[-1][0] == value:
            out[-1] = (value, out[-1][1], i)
        else:
            out.append((value, i, i))
    return out


def _ranges(columns: dict[str, np.ndarray], first: int, last: int) -> list[tuple[float, float]]:
    """Ranges of arclength, energy and quarter period between two points."""
    part = slice(first, last + 1)
    ends = (float(columns["arclength"][first]), float(columns["arclength"][last]))
    return [ends, _range(columns["h"][part]), _range(columns["alpha"][part])]


def _range(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())
