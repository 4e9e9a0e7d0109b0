"""Where along a family a label holds, and where it is stable."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from branches.catalogue.rows import LabelInterval, StabilityInterval

if TYPE_CHECKING:
    from branches.events import BranchEvent

__all__ = ["label_intervals", "stability_intervals"]


def label_intervals(columns: dict[str, np.ndarray], events: Sequence[BranchEvent]) -> tuple[LabelInterval, ...]:
    """The labels along a family. Each interval begins where the last one ends, at the event of the change where there is one, so that
    no energy falls between them."""
    runs = _runs([str(label) for label in columns["label"]])
    changes = {event.point for event in events if event.type == "LB"}
    borders = [first if first in changes else first - 1 for _, first, _ in runs[1:]]
    spans = zip([0, *borders], [*borders, len(columns["label"]) - 1], strict=True)
    return tuple(LabelInterval(label, *_ranges(columns, *span)) for (label, _, _), span in zip(runs, spans, strict=True))


def stability_intervals(columns: dict[str, np.ndarray], events: Sequence[BranchEvent]) -> tuple[StabilityInterval, ...]:
    """Stable, unstable and undecided parts of a family.

    At a bifurcation itself a multiplier is at its bound and stability is undecided: such a single point is the border of its
    neighbours, no part of its own.
    """
    codes = [int(code) for code in columns["stable"]]
    for point in {event.point for event in events}:
        if codes[point] == -1 and 0 < point < len(codes) - 1 and -1 not in (codes[point - 1], codes[point + 1]):
            codes[point] = codes[point - 1]
        elif codes[point] == -1 and len(codes) > 1 and point in (0, len(codes) - 1):
            codes[point] = codes[1] if point == 0 else codes[-2]
    runs = _runs(codes)
    return tuple(StabilityInterval(code, *_ranges(columns, max(first - 1, 0), last)) for code, first, last in runs)


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
    part = slice(first, last + 1)
    ends = (float(columns["arclength"][first]), float(columns["arclength"][last]))
    return [ends, *((float(columns[name][part].min()), float(columns[name][part].max())) for name in ("h", "alpha"))]
