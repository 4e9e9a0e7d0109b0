"""Which points of a section and which marks of orbits are drawn, and the range of colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from transitions.section.plane import SectionPlane
    from transitions.section.view import Mark

__all__ = ["ROOM", "has_images", "robust_limits", "with_ink_left", "with_room"]

ROOM = 6.5
"""Points (of type) from the middle of a mark to the next: one and a half times the width of a mark, so that what is below stays visible."""

_CELL, _BLOCK = 0.5, 10  # points of type that a dot inks; cells on each side of a block
_INK = 0.25  # part of a block that is inked at most before motions are left out
_FENCE = 1.5


def has_images(plane: SectionPlane) -> bool:
    """Whether (-x, y) are points of the section where (x, y) are.

    The mirror u to -u and the reversal of time together keep u_p = 0 and u_p' > 0, change the sign of x and keep y. So they map each motion
    of an elastic undamped system with odd symmetry to the motion from the mirrored start.
    """
    return bool(plane.system.is_conservative and plane.system.has_odd_symmetry)


def with_ink_left(axes: Axes, motions: list[np.ndarray]) -> list[int]:
    """The motions that are drawn.

    Parameters
    ----------
    axes : with its final limits and place in the figure
    motions : points (k, 2) of each

    Returns
    -------
    list of int
        Each motion, in their order, unless half of its points or more fall where the motions before it leave little white.
    """
    per_cell = 72.0 / axes.figure.dpi / _CELL
    low, high = np.array(axes.bbox.extents).reshape(2, 2) * per_cell
    shape = np.ceil(high - low).astype(int) + 1
    inked = np.zeros(shape, dtype=bool)
    ink = np.zeros(shape // _BLOCK + 1, dtype=int)
    out = []
    for k, points in enumerate(motions):
        cells = np.floor(axes.transData.transform(points) * per_cell - low).astype(int)
        cells = np.unique(cells[((cells >= 0) & (cells < shape)).all(axis=1)], axis=0)
        blocks = cells // _BLOCK
        if len(cells) and np.mean(ink[blocks[:, 0], blocks[:, 1]] >= _INK * _BLOCK**2) >= 0.5:
            continue
        out.append(k)
        new = ~inked[cells[:, 0], cells[:, 1]]
        inked[cells[:, 0], cells[:, 1]] = True
        np.add.at(ink, (blocks[new, 0], blocks[new, 1]), 1)
    return out


def robust_limits(values: np.ndarray) -> tuple[float, float]:
    """The least and the largest of some values (N,), N > 0, without those that lie further than 1.5 interquartile ranges outside of the
    quartiles (Tukey, Exploratory Data Analysis, 1977).

    Examples
    --------
    >>> robust_limits(np.array([0.1, 0.12, 0.13, 0.15, 0.16, 0.97]))
    (0.1, 0.16)
    """
    first, third = np.quantile(values, [0.25, 0.75])
    reach = _FENCE * (third - first)
    kept = values[(values >= first - reach) & (values <= third + reach)]
    return float(kept.min()), float(kept.max())


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
