"""Free room in a panel, and the placement of family names there by textalloc.

All lengths are points (1/72 inch), places are counted from the lower left corner of the figure, and boxes are (left, bottom, right, top).
Nothing is random, so a figure is the same each time.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stdout
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures.style import BLACK, GREY, SMALL, short_ids

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

    from branches.figures.atlas_data import AtlasCurve

__all__ = ["Named", "Room", "even_points", "names_of", "one_in_cell", "overlapping", "short_name", "write_names"]

_CELL, _COARSE = 1.0, 3.0  # two points of curves in one cell count once; names need coarser cells
_GRID = 3.0  # a box is kept free by points that are so far apart, less than any text is high
_EDGE = 3.0  # names keep off the ticks inside the frame
_MARGIN = 1.0  # least distance of a name from anything
_GAPS = (2.0, 20.0, 40.0)  # least distances of names from their points; leaders may cross at the larger ones
_LONGEST = 100.0  # nothing further away from the place of a name than this hinders it
_ROUNDS = 3  # how often a name is placed again if its leader would cross another name
_CANDIDATES = 500  # places that are tried for a name


def overlapping(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which of `boxes` (a, 4) overlap which of `others` (b, 4): bool (a, b). Touching edges do not overlap."""
    a, b = boxes[:, None, :], others[None, :, :]
    return (a[..., 0] < b[..., 2]) & (b[..., 0] < a[..., 2]) & (a[..., 1] < b[..., 3]) & (b[..., 1] < a[..., 3])


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
        cells = [self._cells(curve) for curve in curves]
        self._each = np.concatenate([*cells, np.empty((0, 2))])
        self.ink = np.unique(self._each, axis=0)
        """Points (k, 2) of curves, about one in each square point that a curve crosses."""
        self._taken = np.empty((0, 2))
        self._names = np.empty((0, 4))

    def _cells(self, curve: np.ndarray) -> np.ndarray:
        path = self.to_page(curve)
        path = np.concatenate([even_points(path, _CELL), path[np.isfinite(path).all(axis=1)]])
        inside = ((path >= self.frame[:2]) & (path <= self.frame[2:])).all(axis=1)
        return one_in_cell(path[inside], _CELL)

    def to_page(self, data: np.ndarray) -> np.ndarray:
        """Points of the page (n, 2) for data coordinates (n, 2)."""
        return np.asarray(self.axes.transData.transform(data)) * 72 / self.axes.figure.dpi

    def take(self, boxes: np.ndarray) -> None:
        """Keep boxes (a, 4) free from names and markers from now on."""
        filled = [np.empty((0, 2))]
        for left, bottom, right, top in np.asarray(boxes, dtype=float).reshape(-1, 4):
            x = np.linspace(left, right, 2 + int((right - left) / _GRID))
            y = np.linspace(bottom, top, 2 + int((top - bottom) / _GRID))
            filled.append(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
        self._taken = np.concatenate([self._taken, *filled])

    def take_around(self, data: np.ndarray, radii: np.ndarray | float) -> None:
        """Keep markers at data coordinates (n, 2) free; radii (n,), or one for all."""
        at, reach = self.to_page(data), np.broadcast_to(radii, len(data))[:, None]
        self.take(np.concatenate([at - reach, at + reach], axis=1))

    def take_path(self, data: np.ndarray) -> None:
        """Keep a polyline (n, 2) in data coordinates free."""
        self._taken = np.concatenate([self._taken, self._cells(data)])

    def taken(self, boxes: np.ndarray) -> np.ndarray:
        """Whether something is in each of the boxes (a, 4) that is to be kept free: bool (a,)."""
        return _count(boxes, self._taken) > 0

    def ink_in(self, boxes: np.ndarray) -> np.ndarray:
        """Number of points of `ink` in each of the boxes (a, 4)."""
        return _count(boxes, self.ink)

    def ink_around(self, spots: np.ndarray, half: float, *, each: bool = False) -> np.ndarray:
        """Number of points of `ink` within squares of this half width around spots (a, 2); `each` counts the curves one by one."""
        if not len(self.ink) or not len(spots):
            return np.zeros(len(spots))
        return np.asarray(self._trees[each].query_ball_point(spots, half, p=np.inf, return_length=True))

    @cached_property
    def _trees(self) -> dict[bool, Any]:
        from scipy.spatial import cKDTree

        return {False: cKDTree(self.ink), True: cKDTree(self._each)}

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
        from scipy.spatial import cKDTree

        radii = np.broadcast_to(radii, len(texts))
        frame = self.frame + np.array([_EDGE, _EDGE, -_EDGE, -_EDGE])
        curves = np.empty((0, 2)) if over_curves else one_in_cell(self.ink, _COARSE)
        scale, to_data = self.axes.figure.dpi / 72, self.axes.transData.inverted()
        written: list[Text | None] = [None] * len(texts)
        waiting = list(range(len(texts)))
        for _ in range(_ROUNDS if len(texts) else 0):
            obstacles = np.concatenate([curves, self._taken])
            if len(obstacles):
                obstacles = obstacles[cKDTree(at).query(obstacles, p=np.inf)[0] <= radii.max() + far + _LONGEST]
            corners: dict[int, np.ndarray] = {}
            # textalloc places each name as near as it can. Near names surround a crowd, so that those behind find no way out.
            for gap in _GAPS if most is None else _GAPS[:1]:
                found = _allocate([texts[i] for i in waiting], at[waiting], radii[waiting], obstacles, frame, gap, far, font)
                corners = found if len(found) > len(corners) else corners
                if len(corners) == len(waiting):
                    break
            tried, waiting = [(waiting[k], corner) for k, corner in sorted(corners.items())], []
            for i, corner in tried:
                if most is not None and len(texts) - written.count(None) >= most:
                    return written
                x, y = to_data.transform(corner * scale)
                name = self.axes.text(x, y, texts[i], fontsize=font, color=BLACK, ha="left", va="bottom", zorder=6)
                box = np.array(name.get_window_extent().extents) / scale
                leader = np.array([np.clip(at[i], box[:2], box[2:]), at[i]])
                # textalloc keeps leaders off the names of the same call only. Next time this place is not free.
                if _count(self._names, even_points(leader, _CELL)).any():
                    name.remove()
                    curves = np.concatenate([curves, [corner + 1.0 + font / 2]])
                    waiting.append(i)
                    continue
                if np.hypot(*np.diff(leader, axis=0)[0]) > radii[i] + beside:
                    ends = to_data.transform(leader * scale)
                    self.axes.plot(*ends.T, color=GREY, linewidth=0.4, zorder=3, gid="leader")
                    self.take_path(ends)
                self.take(box)
                self._names = np.concatenate([self._names, box[None]])
                written[i] = name
            if not waiting:
                break
        return written


def _allocate(
    texts: Sequence[str], at: np.ndarray, radii: np.ndarray, obstacles: np.ndarray, frame: np.ndarray, gap: float, far: float, font: float
) -> dict[int, np.ndarray]:
    """The lower left corners of the texts that have room, by their index, as textalloc places them, in points of the page.

    Its distances are parts of a figure's sides. In a figure of the frame's size, whose coordinates are points, they are the same in all
    directions.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from textalloc import allocate

    width, height = frame[2:] - frame[:2]
    figure = Figure(figsize=(width / 72, height / 72), dpi=72)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(0.0, height))
    (x, y), (x_taken, y_taken) = (at - frame[:2]).T, (obstacles - frame[:2]).T
    with redirect_stdout(io.StringIO()):  # it prints a line if no text has room
        corners, *_ = allocate(
            axes, x, y, list(texts), x_scatter=x_taken, y_scatter=y_taken, text_scatter_sizes=radii.tolist(), textsize=font, draw_all=False,
            nbr_candidates=_CANDIDATES, margin=_MARGIN / width, min_distance=gap / width, max_distance=far / width,
            avoid_label_lines_overlap=True, avoid_crossing_label_lines=gap == _GAPS[0], auto_ha=False, va="bottom",
        )  # fmt: skip
    return {k: frame[:2] + np.array(corner[:2]) for k, corner in enumerate(corners) if corner is not None}


def one_in_cell(points: np.ndarray, cell: float) -> np.ndarray:
    """The first of the points (k, 2) in each square cell, in their order."""
    _, first = np.unique(np.floor(points / cell), axis=0, return_index=True)
    return points[np.sort(first)]


def _count(boxes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Number of points (k, 2) in each of the boxes (a, 4)."""
    if not len(points):
        return np.zeros(len(boxes))
    order = np.argsort(points[:, 0])
    x, y = points[order].T
    first, last = np.searchsorted(x, boxes[:, 0]), np.searchsorted(x, boxes[:, 2])
    spans = zip(first, last, boxes[:, 1], boxes[:, 3], strict=True)
    return np.array([np.count_nonzero((y[i:j] > low) & (y[i:j] < high)) for i, j, low, high in spans])


_SPACING = 7.0  # points between the places on a curve that a name may belong to
_CROWD = 13.0  # half the width of the surroundings that count as crowded
_SHARED = 40.0  # names that belong to one place push each other away: worth so much ink
_POOL = 4  # names that are tried, for each that may be written
FAR = 48.0
"""Largest distance of a name from its curve, in points. A leader across the figure is hard to follow."""


class Named:
    """A curve of a panel with its family.

    x, y : (N,) float. breaks : (N - 1,) bool, where the curve is not joined. text : its name. cited : whether the scene cites this name.
    short_id : written behind the name, or instead of it.
    """

    def __init__(
        self, curve: AtlasCurve | None, x: np.ndarray, y: np.ndarray, breaks: np.ndarray | None = None, text: str = "", cited: bool = False
    ):
        self.curve = curve
        self.x = np.asarray(x, dtype=float)
        self.y = np.asarray(y, dtype=float)
        self.breaks = np.zeros(max(len(self.x) - 1, 0), dtype=bool) if breaks is None else breaks
        self.text = text or ("" if curve is None else curve.label)
        self.cited = cited
        self.short_id = ""

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
        """Sort key: cited names first, then families with a label, then those with the longest range of energy."""
        if self.curve is None:
            return (False, False, 0.0, self.text)
        return (not self.cited, not self.text, -float(np.log(self.curve.h.max() / self.curve.h.min())), self.curve.family)

    def path(self) -> np.ndarray:
        """The curve (n, 2), with rows of NaN at breaks."""
        return np.insert(np.stack([self.x, self.y], axis=1), np.flatnonzero(self.breaks) + 1, np.nan, axis=0)

    def names(self) -> list[Named]:
        """The same curve with each of its cited names; itself if it has none."""
        if self.curve is None or not self.curve.cited.any():
            return [self]
        texts = dict.fromkeys(self.curve.names[self.curve.cited].tolist())
        return [Named(self.curve, self.x, self.y, self.breaks, text, True) for text in texts]

    def spots(self, room: Room) -> np.ndarray:
        """Places (k, 2) on the page inside the frame, along the part of the curve that has this name."""
        points = np.stack([self.x, self.y], axis=1)
        if self.curve is not None:
            mine = self.curve.cited & (self.curve.names == self.text) if self.cited else self.curve.labels == self.text
            if mine.any():
                points[~mine] = np.nan
        path = room.to_page(points)
        broken = np.insert(path, np.flatnonzero(self.breaks) + 1, np.nan, axis=0)
        spots = np.concatenate([even_points(broken, _SPACING), path[np.isfinite(path).all(axis=1)][:1]]) if len(path) > 1 else path
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
        if (name.key, name.text) in chosen or (name.key in families and not name.cited):
            continue
        if room is None or len(name.spots(room)):
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
    if len(name.x) > 1:  # a curve has other places; one point stays
        spots = spots[~room.taken(np.concatenate([spots - 1.0, spots + 1.0], axis=1))]
    if not len(spots):
        return None
    crowd = room.ink_around(spots, _CROWD)
    for other in places:
        crowd = crowd + _SHARED * (np.hypot(*(spots - other).T) < 2.0 * _CROWD)
    places.append(spots[int(np.argmin(crowd))])
    return places[-1]


def short_name(label: str) -> str:
    """The label as it is written in a figure: short, in mathematics; L1, L2, ... of the modes of any system upright.

    Examples
    --------
    >>> print(short_name("S13O00+"), short_name("L3"))
    $\\mathrm{S13}^{+}$ $\\mathrm{L3}$
    """
    from branches.naming.labels import latex, parse

    if label.startswith("L") and label[1:].isdecimal() and label[1:] != "11":
        return rf"$\mathrm{{{label}}}$"
    return latex(parse(label), short=True)
