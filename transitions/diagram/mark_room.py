"""Which periodic orbits of a section find room in its picture: marks that hide neither each other nor the points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from transitions.section_marks import Mark

__all__ = ["ROOM", "with_room"]

ROOM = 6.5
"""Points (of type) from the middle of a mark to the next: half as much again as a mark is wide, so that what it stands on is seen."""


def with_room(axes: Axes, marks: Sequence[Mark]) -> list[Mark]:
    """The marks that are drawn.

    Parameters
    ----------
    axes : with its final limits and place in the figure
    marks : of all orbits

    Returns
    -------
    list of Mark
        Elliptic orbits first, and those with the fewest impacts, then with the fewest crossings: each that has room at all of its crossings
        beside those before it.
    """
    to_points = 72.0 / axes.figure.dpi
    taken = np.empty((0, 2))
    out = []
    for mark in sorted(marks, key=lambda mark: (mark.stable != 1, mark.impacts, len(mark.points))):
        places = axes.transData.transform(mark.points) * to_points
        if np.all(np.hypot(*(places[:, None] - taken[None]).T) >= ROOM):
            out.append(mark)
            taken = np.concatenate([taken, places])
    return out
