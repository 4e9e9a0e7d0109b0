"""Free room in a panel, and the placement of names there by textalloc.

All lengths are points (1/72 inch), places are counted from the lower left corner of the figure. Nothing is random, so a figure is the same
each time.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures.style import BLACK, GREY, SMALL, short_ids

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

    from branches.figures.atlas_data import AtlasCurve

__all__ = ["Named", "Room", "even_points", "names_of", "short_name", "thinned", "write_names"]

_CELL, _COARSE = 1.0, 3.0  # points of a curve in one cell count once; names need coarser cells only
_EDGE = 3.0  # names keep off the ticks inside the frame
_GAPS = (2.0, 20.0, 40.0, 30.0, 10.0, 24.0)  # least distances of names from their points, as tried; leaders may cross but at the first


def even_points(curve: np.ndarray, spacing: float) -> np.ndarray:
    """Points (k, 2) every `spacing` along a polyline (n, 2), from half a spacing on; rows that are not finite break it."""
    finite = np.isfinite(curve).all(axis=1)
    joined = finite[:-1] & finite[1:]
    steps = np.where(joined, np.hypot(*np.where(joined[:, None], np.diff(curve, axis=0), 0.0).T), 0.0)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    if reached[-1] == 0.0:
        return np.empty((0, 2))
    spots = np.arange(min(spacing, reached[-1]) / 2, reached[-1], spacing)
    segment = np.clip(np.searchsorted(reached, spots, side="right") - 1, 0, len(steps) - 1)
    part = (spots - reached[segment]) / steps[segment]
    return curve[segment] + part[:, None] * (curve[segment + 1] - curve[segment])


def thinned(points: np.ndarray, spacing: float) -> np.ndarray:
    """Which of the points (k, 2), in order, are at least `spacing` from each one kept before: bool (k,)."""
    from scipy.spatial import cKDTree

    kept = np.ones(len(points), dtype=bool)
    if not len(points):
        return kept
    pairs = cKDTree(points).query_pairs(spacing, output_type="ndarray")
    first, last = pairs[np.argsort(pairs[:, 0])].T
    ends = np.searchsorted(first, np.arange(len(points) + 1))
    for i, (begin, end) in enumerate(pairwise(ends.tolist())):
        if kept[i]:
            kept[last[begin:end]] = False
    return kept


def _count(points: np.ndarray, spots: np.ndarray, half: float) -> np.ndarray:
    """Number of points (k, 2) within squares of this half width around each of the spots (a, 2)."""
    from scipy.spatial import cKDTree

    if not len(points) or not len(spots):
        return np.zeros(len(spots), dtype=int)
    return np.asarray(cKDTree(points).query_ball_point(spots, half, p=np.inf, return_length=True))


class Room:
    """The free room of a panel that has its final limits and its place in the figure.

    Parameters
    ----------
    axes : Axes
    curves : sequence of (n, 2) array
        Everything drawn as a line, in data coordinates. Rows that are not finite break a line.
    """

    def __init__(self, axes: Axes, curves: Sequence[np.ndarray]) -> None:
        self.axes = axes
        self.frame = np.array(axes.bbox.extents) * 72 / axes.figure.dpi
        paths = [self.to_page(curve) for curve in curves]
        paths = [np.concatenate([even_points(path, _CELL), path[np.isfinite(path).all(axis=1)]]) for path in paths]
        paths = [path[((path >= self.frame[:2]) & (path <= self.frame[2:])).all(axis=1)] for path in paths]
        self._ink = np.concatenate([*(np.unique(path // _CELL, axis=0) * _CELL for path in paths), np.empty((0, 2))])
        self._taken = np.empty((0, 2))
        self._names = np.empty((0, 4))

    def to_page(self, data: np.ndarray) -> np.ndarray:
        """Points of the page (n, 2) for data coordinates (n, 2)."""
        return np.asarray(self.axes.transData.transform(data)) * 72 / self.axes.figure.dpi

    def take(self, at: np.ndarray, half: np.ndarray | float = 0.0) -> None:
        """Keep names and markers off boxes around places (n, 2) of the page from now on; `half` of the width and height of each."""
        half = np.broadcast_to(half, (len(at), 2))
        for place, size in zip(at, half, strict=True):
            sides = [np.linspace(-side, side, 2 + int(2 * side / _COARSE)) for side in size]
            self._taken = np.concatenate([self._taken, place + np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)])

    def take_path(self, path: np.ndarray) -> None:
        """Keep names and markers off a polyline (n, 2) on the page."""
        self._taken = np.concatenate([self._taken, even_points(path, _CELL)])

    def free(self, spots: np.ndarray, half: float) -> np.ndarray:
        """Which squares of this half width around spots (a, 2) of the page lie in the frame and contain nothing that is taken."""
        inside = ((spots > self.frame[:2] + half) & (spots < self.frame[2:] - half)).all(axis=1)
        return np.asarray(inside & (_count(self._taken, spots, half) == 0))

    def crowd(self, spots: np.ndarray, half: float) -> np.ndarray:
        """The length of all curves, in points, within squares of this half width around spots (a, 2) of the page."""
        return _count(self._ink, spots, half)

    def write(
        self,
        texts: Sequence[str],
        at: np.ndarray,
        radii: np.ndarray | float = 0.0,
        *,
        most: int | None = None,
        far: float = 48.0,
        beside: float = 0.0,
        over_curves: bool = False,
        font: float = SMALL,
    ) -> list[Text | None]:
        """Write names beside their points, each with a leader line, in order of importance.

        Parameters
        ----------
        texts : sequence of str
        at : (n, 2) points of the page that the names belong to
        radii : (n,) or one for all: radii of the markers at these points
        most : largest number of names; all by default
        far : largest distance of a name from its point
        beside : a name no further than this from its marker has no leader line
        over_curves : whether names may cover curves
        font : size of the names

        Returns
        -------
        list of Text or None
            None for a name without room. Names cover neither each other nor their leaders nor anything that is taken.
        """
        from matplotlib.figure import Figure
        from textalloc import allocate

        radii = np.broadcast_to(radii, len(texts))
        scale, to_data = self.axes.figure.dpi / 72, self.axes.transData.inverted()
        obstacles = np.concatenate([np.empty((0, 2)) if over_curves else np.unique(self._ink // _COARSE, axis=0) * _COARSE, self._taken])
        # Distances are parts of a figure's sides. In a figure of the frame's size, whose coordinates are points, they are the same in
        # all directions.
        low = self.frame[:2] + _EDGE
        (x, y), (x_taken, y_taken) = (at - low).T, (obstacles - low).T
        width, height = self.frame[2:] - self.frame[:2] - 2 * _EDGE
        page = Figure(figsize=(width / 72, height / 72), dpi=72).add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(0.0, height))
        page.set_axis_off()  # textalloc draws the page to measure it
        corners: dict[int, np.ndarray] = {}
        # textalloc places each name as near as it can. Near names surround a crowd, so that those behind find no way out.
        for gap in _GAPS if most is None else _GAPS[:1]:
            if len(corners) == len(texts):
                break
            with redirect_stdout(io.StringIO()):  # it prints a line if no text has room
                found, *_ = allocate(
                    page, x, y, list(texts), x_scatter=x_taken, y_scatter=y_taken, text_scatter_sizes=radii.tolist(), textsize=font,
                    draw_all=False, nbr_candidates=500, margin=1.0 / width, min_distance=gap / width, max_distance=far / width,
                    avoid_label_lines_overlap=True, avoid_crossing_label_lines=gap == _GAPS[0], auto_ha=False, va="bottom",
                )  # fmt: skip
            placed = {k: low + np.array(corner[:2]) for k, corner in enumerate(found) if corner is not None}
            corners = placed if len(placed) > len(corners) else corners
        written: list[Text | None] = [None] * len(texts)
        for i, corner in sorted(corners.items()):
            if most is not None and len(texts) - written.count(None) >= most:
                break
            x, y = to_data.transform(corner * scale)
            name = self.axes.text(x, y, texts[i], fontsize=font, color=BLACK, ha="left", va="bottom", zorder=6)
            box = np.array(name.get_window_extent().extents) / scale
            leader = np.array([np.clip(at[i], box[:2], box[2:]), at[i]])
            # textalloc keeps leaders off the names of the same call only. In the next call this place is not free.
            path = even_points(leader, _CELL)[:, None]
            if ((path > self._names[:, :2]) & (path < self._names[:, 2:])).all(axis=2).any():
                name.remove()
                self._taken = np.concatenate([self._taken, [corner + 1.0 + font / 2]])
                continue
            if np.hypot(*np.diff(leader, axis=0)[0]) > radii[i] + beside:
                self.axes.plot(*to_data.transform(leader * scale).T, color=GREY, linewidth=0.4, zorder=3, gid="leader")
                self.take_path(leader)
            self.take((box[None, :2] + box[None, 2:]) / 2, (box[None, 2:] - box[None, :2]) / 2)
            self._names = np.concatenate([self._names, box[None]])
            written[i] = name
        return written


_SPACING = 7.0  # points between the places on a curve that a name may belong to
_CROWD = 13.0  # half the width of the surroundings that count as crowded
_SHARED = 40.0  # names that belong to one place push each other away: worth so much ink
_POOL = 4  # names that are tried, for each that may be written
FAR = 48.0
"""Largest distance of a name from its curve, in points. A leader across the figure is hard to follow."""


@dataclass(eq=False)
class Named:
    """A curve of a panel with its name.

    path : (n, 2) float, rows of NaN break it. curve, rows : the family, and the point of it at each row. text : its name. cited : whether
    the scene cites this name. short_id : written behind the name, or instead of it.
    """

    path: np.ndarray
    curve: AtlasCurve | None = None
    rows: Any = ...
    text: str = ""
    cited: bool = False
    short_id: str = ""

    def __post_init__(self) -> None:
        self.text = self.text or ("" if self.curve is None else self.curve.label)

    @property
    def shown(self) -> str:
        """The name as it is written."""
        return " ".join(part for part in (self.text and short_name(self.text), self.short_id) if part)

    @property
    def key(self) -> str:
        """The family's id, or the text."""
        return self.text if self.curve is None else self.curve.family

    @property
    def importance(self) -> tuple[bool, bool, float, str]:
        """Sort key: cited names first, then families with a label, then those with the longest range of energy; of ranges equal but
        for rounding, by id."""
        if self.curve is None:
            return (False, False, 0.0, self.text)
        length = round(float(np.log(self.curve.h.max() / self.curve.h.min())), 9)
        return (not self.cited, not self.text, -length, self.curve.family)

    def names(self) -> list[Named]:
        """The same curve with each of its cited names; itself if it has none."""
        if self.curve is None or not self.curve.cited.any():
            return [self]
        texts = dict.fromkeys(self.curve.names[self.curve.cited].tolist())
        return [Named(self.path, self.curve, self.rows, text, True) for text in texts]

    def spots(self, room: Room) -> np.ndarray:
        """Places (k, 2) on the page inside the frame, along the part of the curve that has this name."""
        points = self.path
        if self.curve is not None:
            mine = self.curve.cited & (self.curve.names == self.text) if self.cited else self.curve.labels == self.text
            if mine.any():
                shown = mine[self.rows]
                begins = np.append(False, np.isnan(points[:-1, 1]))  # a piece begins with the last point of the piece before it
                points = np.where((shown | begins & np.append(shown[1:], False))[:, None], points, np.nan)
        path = room.to_page(points)
        spots = np.concatenate([even_points(path, _SPACING), path[np.isfinite(path).all(axis=1)][:1]])
        return spots[((spots > room.frame[:2] + 2.0) & (spots < room.frame[2:] - 2.0)).all(axis=1)]


def names_of(curves: Sequence[Named], room: Room | None = None) -> list[Named]:
    """The names that may be written, the most important first: all cited ones, and one for each other family.

    Families without a label get a short id. So do all but the most important one of those with equal names. A `room` leaves out what is not
    inside its frame.
    """
    ordered = sorted((name for curve in curves for name in curve.names()), key=lambda name: name.importance)
    known = short_ids(dict.fromkeys(curve.key for curve in curves))
    first: dict[str, str] = {}
    for name in ordered:
        if not name.text or first.setdefault(name.text, name.key) != name.key:
            name.short_id = known[name.key]
    chosen: dict[tuple[str, str], Named] = {}
    families: set[str] = set()
    for name in ordered:
        if (name.key, name.text) not in chosen and (name.cited or name.key not in families) and (room is None or len(name.spots(room))):
            chosen[name.key, name.text] = name
            families.add(name.key)
    return list(chosen.values())


def write_names(
    room: Room,
    names: Sequence[Named],
    *,
    most: int,
    always: Sequence[Named] = (),
    far: float = FAR,
    over_curves: bool = True,
    radius: float = 0.0,
    font: float = SMALL,
) -> set[str]:
    """Write names beside their curves, each at the least crowded place.

    Parameters
    ----------
    room : Room
    names : the most important first
    most : largest number of names
    always : names that are written before all others, and do not count
    far : largest distance of a name from its curve; cited names may be three times as far
    over_curves : whether `always` and cited names may cover curves if there is no other room
    radius : radius of the markers of names that belong to one point
    font : size of the names

    Returns
    -------
    set of str
        Keys of the names that are written.
    """
    written: set[str] = set()
    places: list[np.ndarray] = []

    def write(some: Sequence[Named], far: float, over_curves: bool = False, most: int | None = None) -> list[Named]:
        found = [(name, place) for name in some if (place := _place(room, name, places)) is not None]
        at = np.array([place for _, place in found]).reshape(-1, 2)
        done = room.write([name.shown for name, _ in found], at, radius, most=most, far=far, over_curves=over_curves, font=font)
        written.update(name.key for (name, _), text in zip(found, done, strict=True) if text is not None)
        return [name for (name, _), text in zip(found, done, strict=True) if text is None]

    for some, reach in ((always, far), ([name for name in names if name.cited][:most], 3.0 * far)):
        without = write(some, reach)
        if over_curves:
            write(without, reach, over_curves=True)
    room_for = most - len(written & {name.key for name in names})
    write([name for name in names if not name.cited][: _POOL * most], far, most=room_for)
    return written


def _place(room: Room, name: Named, places: list[np.ndarray]) -> np.ndarray | None:
    """The place (2,) on the page that a name belongs to, None if there is none. It is also appended to `places`, which other names fill."""
    spots = name.spots(room)
    free = spots[room.free(spots, 1.0)]
    # A curve has other places. One point stays, and so does a name that the scene cites, at a marker if need be.
    if len(name.path) > 1 and (len(free) or not name.cited):
        spots = free
    if not len(spots):
        return None
    crowd = room.crowd(spots, _CROWD).astype(float)
    for other in places:
        crowd += _SHARED * (np.hypot(*(spots - other).T) < 2.0 * _CROWD)
    places.append(spots[int(np.argmin(crowd))])
    return places[-1]


def short_name(label: str) -> str:
    """The label as it is written in a figure: short, in mathematics; L1, L2, ... of the modes of any system upright.

    Examples
    --------
    >>> print(short_name("S13O00+"), short_name("L3"))
    $\\mathrm{S13}^{+}$ $\\mathrm{L3}$
    """
    from branches.naming.labels import latex, parse_printed

    if label.startswith("L") and label[1:].isdecimal() and label[1:] != "11":
        return rf"$\mathrm{{{label}}}$"
    return latex(parse_printed(label), short=True)
