"""Which special points find room in a picture of many families: markers that hide neither each other nor other curves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from branches.diagram.atlas_data import EVENTS
from branches.diagram.marks import marker_look
from branches.diagram.placement import Cover, overlapping
from branches.diagram.style import event_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from branches.diagram.atlas_labels import Named

__all__ = ["draw_some_events", "drawn_types", "event_types"]

_SMALLER = 0.7  # than in the picture of one family
_ROOM = 7.0  # points from the middle of a marker to the next
_ABOUT, _ALONE = 5.0, 2.6  # half the width of a marker's surroundings, and how many times that width of curves they may hold


def event_types(curves: Sequence[Named]) -> list[str]:
    """Types of the special points of these curves."""
    found = {kind for curve in curves if curve.curve is not None for kind in set(curve.curve.events.tolist())}
    return [kind for kind in EVENTS if kind in found]


def drawn_types(panels: Iterable[Axes]) -> list[str]:
    """Types of the special points that `draw_some_events` drew into panels."""
    names = {str(line.get_gid()) for axes in panels for line in axes.lines}
    return [kind for kind in EVENTS if any(name.endswith(f"-events-{kind}") for name in names)]


def draw_some_events(
    axes: Axes, curves: Sequence[Named], lines: Sequence[np.ndarray], keep_off: Sequence[Sequence[float]], panel: str
) -> list[tuple[float, float, float, float]]:
    """Draw a marker for each special point that has room.

    Parameters
    ----------
    axes : with its final limits and place in the figure
    curves : the families
    lines : polylines (n, 2) in data coordinates; all that is drawn as a line
    keep_off : boxes in points that no marker covers
    panel : name of the panel

    Returns
    -------
    list of boxes in points
        Of the markers. A special point has room where its surroundings hold its own curve alone, or that and one more that crosses it, and
        no marker of a more important family, or of an earlier type of one family, is near.
    """
    to_points = 72 / axes.figure.dpi
    frame = np.array(axes.bbox.extents) * to_points
    kinds, spots = _in_order(curves)
    if not kinds:
        return []
    at = axes.transData.transform(spots) * to_points
    cover = Cover(frame.tolist(), [axes.transData.transform(line) * to_points for line in lines], each=True)
    taken = np.array(list(keep_off), dtype=float).reshape(-1, 4)
    free = (at > frame[:2] + 3.0).all(axis=1) & (at < frame[2:] - 3.0).all(axis=1)
    free &= ~overlapping(np.concatenate([at - 3.0, at + 3.0], axis=1), taken).any(axis=1)
    free &= cover.within(np.concatenate([at - _ABOUT, at + _ABOUT], axis=1)) <= _ALONE * 2.0 * _ABOUT
    chosen: list[int] = []
    for i in np.flatnonzero(free):
        if not chosen or np.hypot(*(at[chosen] - at[i]).T).min() >= _ROOM:
            chosen.append(int(i))
    for kind in EVENTS:
        mine = [i for i in chosen if kinds[i] == kind]
        if mine:
            look = marker_look(event_style(kind), _SMALLER)
            axes.plot(*spots[mine].T, zorder=3.8, **look)[0].set_gid(f"{panel}-events-{kind}")
    radii = np.array([0.5 * _SMALLER * event_style(kinds[i]).size + 0.5 for i in chosen])[:, None]
    boxes = np.concatenate([at[chosen] - radii, at[chosen] + radii], axis=1) if chosen else np.empty((0, 4))
    return [(left, bottom, right, top) for left, bottom, right, top in boxes.tolist()]


def _in_order(curves: Sequence[Named]) -> tuple[list[str], np.ndarray]:
    """Types and places (k, 2) of the special points: those of important families first, each in the order of the types."""
    kinds: list[str] = []
    spots: list[np.ndarray] = []
    for curve in sorted((curve for curve in curves if curve.curve is not None), key=lambda curve: curve.importance):
        assert curve.curve is not None
        for kind in EVENTS:
            mine = (curve.curve.events == kind) & np.isfinite(curve.y)
            kinds += [kind] * int(mine.sum())
            spots.append(np.stack([curve.x[mine], curve.y[mine]], axis=1))
    return kinds, np.concatenate(spots) if spots else np.empty((0, 2))
