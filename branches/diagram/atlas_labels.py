"""The names of families in a picture of many: which are written, where each points to, and where it stands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from branches.diagram.placement import Cover, Place, even_points, overlapping, place_texts
from branches.diagram.style import BLACK, GREY, SMALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from branches.diagram.atlas_data import Curve

__all__ = ["Named", "label_curves", "names_of"]

_SPACING = 7.0  # points between the places on a curve that a name may point to
_ROOM = 13.0  # half the width of the surroundings that count as crowded
_FAR = 48.0  # points: a name that would stand further off than this is left out, as leaders across the picture tell nothing


class Named:
    """A curve of a panel with its family: x, y (N,) and breaks (N - 1,) where it is not joined."""

    def __init__(self, curve: Curve | None, x: np.ndarray, y: np.ndarray, breaks: np.ndarray, text: str = ""):
        self.curve = curve
        self.x = np.asarray(x, dtype=float)
        self.y = np.asarray(y, dtype=float)
        self.breaks = np.asarray(breaks, dtype=bool)
        self.text = text or ("" if curve is None else curve.label)

    @classmethod
    def point(cls, text: str, x: float, y: float) -> Named:
        """A name for one point."""
        return cls(None, np.array([x]), np.array([y]), np.zeros(0), text)

    @property
    def key(self) -> str:
        """What tells it apart: the family's id, or the text."""
        return self.text if self.curve is None else self.curve.family

    @property
    def importance(self) -> tuple[bool, float, str]:
        """Sort key: pinned first, then the longest range of energy."""
        if self.curve is None:
            return (False, 0.0, self.text)
        return (not self.curve.pinned, -float(np.log(self.curve.h.max() / self.curve.h.min())), self.curve.family)

    def path(self) -> np.ndarray:
        """The curve (n, 2), with rows of NaN where it is broken."""
        return np.insert(np.stack([self.x, self.y], axis=1), np.flatnonzero(self.breaks) + 1, np.nan, axis=0)

    def owned(self) -> np.ndarray:
        """Points (N, 2) of the curve where its label is the one written; other rows are NaN."""
        points = np.stack([self.x, self.y], axis=1)
        if self.curve is not None:
            mine = self.curve.labels == self.text
            if mine.any():
                points[~mine] = np.nan
        return points


def names_of(curves: Sequence[Named], most: int, axes: Axes | None = None) -> list[Named]:
    """The most important of the curves that have a label, one for each family; those in sight of `axes` where it is given."""
    chosen: dict[str, Named] = {}
    for curve in sorted(curves, key=lambda curve: curve.importance):
        if not curve.text or curve.key in chosen:
            continue
        if axes is not None and not len(_in_sight(axes, curve)):
            continue
        chosen[curve.key] = curve
    return list(chosen.values())[:most]


def _in_sight(axes: Axes, named: Named) -> np.ndarray:
    """Places (k, 2) in points along the curve inside the frame."""
    to_points = 72 / axes.figure.dpi
    path = axes.transData.transform(named.owned()) * to_points
    broken = np.insert(path, np.flatnonzero(named.breaks) + 1, np.nan, axis=0)
    spots = np.concatenate([even_points(broken, _SPACING), path[np.isfinite(path).all(axis=1)][:1]]) if len(path) > 1 else path
    frame = np.array(axes.bbox.extents) * to_points
    inside = (spots > frame[:2] + 2.0).all(axis=1) & (spots < frame[2:] - 2.0).all(axis=1)
    return spots[inside]


def label_curves(
    axes: Axes, names: Sequence[Named], curves: Sequence[np.ndarray], keep_off: Sequence[Sequence[float]] = ()
) -> set[str]:
    """Write names beside their curves, each at the least crowded place, with a leader where it has to stand off.

    Parameters
    ----------
    axes : with its final limits and place in the figure
    names : the most important first
    curves : polylines (n, 2) in data coordinates, kept off where possible
    keep_off : boxes in points that no name covers

    Returns
    -------
    set of str
        Keys of the names that found room.
    """
    figure = axes.figure
    to_points = 72 / figure.dpi
    frame = np.array(axes.bbox.extents) * to_points
    boxes = np.array(list(keep_off), dtype=float).reshape(-1, 4)
    paths = [axes.transData.transform(curve) * to_points for curve in curves]
    cover = Cover(frame.tolist(), paths)
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    shown: list[Named] = []
    anchors: list[np.ndarray] = []
    sizes: list[np.ndarray] = []
    for named in names:
        spots = _in_sight(axes, named)
        if len(named.x) > 1:  # a name of one point stands beside its marker; a curve has other places
            spots = spots[~overlapping(np.concatenate([spots, spots], axis=1), boxes).any(axis=1)]
        if not len(spots):
            continue
        around = np.concatenate([spots - _ROOM, spots + _ROOM], axis=1)
        crowded = cover.within(around)
        for other in anchors:  # names that point to one place would push each other away
            crowded = crowded + 40.0 * (np.hypot(*(spots - other).T) < 2.0 * _ROOM)
        anchors.append(spots[int(np.argmin(crowded))])
        trial = axes.text(0, 0, written(named.text), fontsize=SMALL)
        sizes.append(np.array(trial.get_window_extent(renderer).size) * to_points)
        trial.remove()
        shown.append(named)
    if not shown:
        return set()
    bounds = (frame + np.array([4.0, 4.0, -4.0, -4.0])).tolist()
    at, size = np.array(anchors), np.array(sizes)
    radii = np.array([3.0 if len(named.x) == 1 else 0.8 for named in shown])
    places = place_texts(at, size, radii, bounds, boxes, paths)
    near = [k for k, place in enumerate(places) if place is not None and _reach(at[k], size[k], place) <= _FAR]
    if len(near) < len(places):
        shown, at, size, radii = [shown[k] for k in near], at[near], size[near], radii[near]
        places = place_texts(at, size, radii, bounds, boxes, paths) if near else []
    done = set()
    for named, anchor, extent, place in zip(shown, at, size, places, strict=True):
        if place is None or _reach(anchor, extent, place) > 1.5 * _FAR:
            continue
        done.add(named.key)
        x, y = axes.transData.inverted().transform(anchor / to_points)
        here = (float(x), float(y))
        offset = (place.left - anchor[0], place.bottom - anchor[1])
        axes.annotate(
            written(named.text), here, offset, fontsize=SMALL, color=BLACK, ha="left", va="bottom", textcoords="offset points", zorder=6
        )
        if place.leader:
            tip = (place.leader[0] - anchor[0], place.leader[1] - anchor[1])
            arrow = {"arrowstyle": "-", "linewidth": 0.4, "color": GREY, "shrinkA": 0.8, "shrinkB": 0}
            axes.annotate("", here, tip, textcoords="offset points", arrowprops=arrow, zorder=5)
    return done


def _reach(anchor: np.ndarray, size: np.ndarray, place: Place) -> float:
    corner = np.array([place.left, place.bottom])
    return float(np.hypot(*(np.clip(anchor, corner, corner + size) - anchor)))


def written(label: str) -> str:
    """The label as it is written in a picture: short, in mathematics."""
    from branches.labels import latex, parse

    return latex(parse(label), short=True)
