"""Where the texts of special points go: beside their markers where there is room, else further off with a leader line.

Everything here is plane geometry in points (1/72 inch) with boxes (left, bottom, right, top); nothing is random, so a
picture is the same each time. A text is given a place that keeps it off all markers, all other texts and the frame; among
these the place is taken that is near, off the curves, and whose leader crosses least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_PAD = 1.0  # room kept around a text
_BESIDE = 4.0  # a text no further than this from its marker needs no leader
_LED = 5.0  # cost of needing a leader
_PART, _WEIGHED = 48, 240  # free places that are weighed at once, and at most
_SWEEPS, _PLACINGS = 6, 240  # times that each text is placed anew among the others, fewer for more texts than this in all
_COVERS_CURVE = 2.5  # cost of each point length of curve under a text, as a distance
_LEADER_HITS_TEXT, _LEADER_HITS_LEADER, _LEADER_HITS_MARKER = 90.0, 60.0, 12.0
_AMBIGUOUS = 25.0  # cost of a text without leader that is nearer to another point than to its own
_RINGS = (2.5, 5.0, 9.0, 14.0, 20.0, 27.0, 35.0, 44.0, 54.0)


@dataclass(frozen=True)
class Place:
    """Lower left corner of a text, and the end of its leader line at the text (None: no leader needed)."""

    left: float
    bottom: float
    leader: tuple[float, float] | None


def overlapping(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which of `boxes` (a, 4) overlap which of `others` (b, 4): bool (a, b); touching edges do not overlap."""
    a, b = boxes[:, None, :], others[None, :, :]
    return (a[..., 0] < b[..., 2]) & (b[..., 0] < a[..., 2]) & (a[..., 1] < b[..., 3]) & (b[..., 1] < a[..., 3])


def crossing_boxes(starts: np.ndarray, ends: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Which segments (a, 2)-(a, 2) pass through which `boxes` (b, 4): bool (a, b), by the slab method."""
    start, step = starts[:, None, :], (ends - starts)[:, None, :]
    step = np.where(np.abs(step) < 1e-12, 1e-12, step)
    near, far = (boxes[None, :, :2] - start) / step, (boxes[None, :, 2:] - start) / step
    enter = np.minimum(near, far).max(axis=-1)
    leave = np.maximum(near, far).min(axis=-1)
    return (enter < leave) & (leave > 0) & (enter < 1)


def crossing_segments(starts: np.ndarray, ends: np.ndarray, from_: np.ndarray, to: np.ndarray) -> np.ndarray:
    """Which segments (a, 2)-(a, 2) cross which segments (b, 2)-(b, 2): bool (a, b), by signs of areas."""

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    a, b, c, d = starts[:, None], ends[:, None], from_[None], to[None]
    return (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)


class Cover:
    """How much of the drawn curves lies in a box: a summed-area table over cells of one point. A cell that several curves cross counts
    once, or, `each`, once for each of them."""

    def __init__(self, bounds: Sequence[float], curves: Sequence[np.ndarray], *, each: bool = False) -> None:
        self._origin = np.array(bounds[:2])
        self._shape = tuple(int(n) for n in np.ceil(np.array(bounds[2:]) - self._origin) + 1)
        cells = np.zeros(self._shape)
        for curve in curves:
            along = np.concatenate([even_points(curve, 1.0), curve[np.isfinite(curve).all(axis=1)]])
            index = np.floor(along - self._origin).astype(int)
            index = index[((index >= 0) & (index < self._shape)).all(axis=1)]
            cells[index[:, 0], index[:, 1]] = cells[index[:, 0], index[:, 1]] + 1.0 if each else 1.0
        self._sums = np.zeros((self._shape[0] + 1, self._shape[1] + 1))
        self._sums[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)

    def within(self, boxes: np.ndarray) -> np.ndarray:
        """Occupied cells in each of `boxes` (a, 4)."""
        low = np.clip(np.floor(boxes[:, :2] - self._origin), 0, self._shape).astype(int)
        high = np.clip(np.ceil(boxes[:, 2:] - self._origin), 0, self._shape).astype(int)
        (i, j), (k, m) = low.T, high.T
        return self._sums[k, m] - self._sums[i, m] - self._sums[k, j] + self._sums[i, j]


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
    """Those of `points` (k, 2), in order, that are at least `spacing` from each one kept before: bool (k,)."""
    kept = np.zeros(len(points), dtype=bool)
    cells: dict[tuple[int, int], list[np.ndarray]] = {}
    for i, point in enumerate(points):
        x, y = (int(v) for v in np.floor(point / spacing))
        near = [q for dx in (-1, 0, 1) for dy in (-1, 0, 1) for q in cells.get((x + dx, y + dy), ())]
        if all(np.hypot(*(point - q)) >= spacing for q in near):
            kept[i] = True
            cells.setdefault((x, y), []).append(point)
    return kept


def _candidates(anchor: np.ndarray, size: np.ndarray, radius: float, bounds: np.ndarray) -> np.ndarray:
    """Lower left corners (k, 2): around the marker in growing rings, then every row and column of the whole frame."""
    around = []
    for ring, gap in enumerate((0.2 + _PAD, *_RINGS)):
        turns = 8 if ring == 0 else 24
        angle = np.arange(turns) * (2 * np.pi / turns) + np.pi / 4
        out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        reach = (radius + gap) / (np.abs(out).max(axis=1, keepdims=True) if ring == 0 else 1.0)
        around.append(anchor + out * reach + np.clip(out * 1.5, -1, 1) * size / 2 - size / 2)
    columns = np.arange(bounds[0] + _PAD, bounds[2] - size[0], max(size[0] / 3, 3.0))
    rows = np.arange(bounds[1] + _PAD, bounds[3] - size[1], size[1] + 2 * _PAD)
    return np.concatenate([*around, np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)])


def _nearest(anchor: np.ndarray, corners: np.ndarray, size: np.ndarray) -> np.ndarray:
    return np.clip(anchor, corners, corners + size)


@dataclass(frozen=True, eq=False)
class _Options:
    """Places of one text by rising cost: lower left corners, padded boxes, leader ends, reach, whether led, least cost."""

    corners: np.ndarray
    boxes: np.ndarray
    tips: np.ndarray
    reach: np.ndarray
    led: np.ndarray
    cost: np.ndarray


@dataclass(frozen=True, eq=False)
class _Scene:
    """All that a text keeps off: the texts' own points and sizes, the frame, the marker boxes, the curves."""

    anchors: np.ndarray
    sizes: np.ndarray
    radii: np.ndarray
    frame: np.ndarray
    markers: np.ndarray
    cover: Cover
    covering: float

    def nearer_to_another(self, i: int, boxes: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Which padded `boxes` (a, 4) of text `i`, `reach` (a,) from its point, are as near to another point: bool (a,)."""
        centres = (self.markers[:, :2] + self.markers[:, 2:]) / 2
        centres = centres[np.hypot(*(centres - self.anchors[i]).T) > 2.0]  # points in one spot are told apart by nothing
        low, high = boxes[:, None, :2] + _PAD, boxes[:, None, 2:] - _PAD
        away = np.hypot(*np.moveaxis(np.clip(centres[None], low, high) - centres[None], -1, 0))
        return away.min(axis=1, initial=np.inf) < reach + 0.5

    def options(self, i: int) -> _Options:
        """All places of text `i` inside the frame and off the markers."""
        corners = _candidates(self.anchors[i], self.sizes[i], self.radii[i], self.frame)
        boxes = np.concatenate([corners - _PAD, corners + self.sizes[i] + _PAD], axis=1)
        free = (boxes[:, :2] >= self.frame[:2]).all(axis=1) & (boxes[:, 2:] <= self.frame[2:]).all(axis=1)
        corners, boxes = corners[free], boxes[free]
        free = ~overlapping(boxes, self.markers).any(axis=1)
        corners, boxes = corners[free], boxes[free]
        tips = _nearest(self.anchors[i], corners, self.sizes[i])
        reach = np.hypot(*(tips - self.anchors[i]).T)
        led = reach > self.radii[i] + _BESIDE
        cost = reach + _LED * led + self.covering * self.cover.within(boxes)
        order = np.argsort(cost, kind="stable")
        return _Options(corners[order], boxes[order], tips[order], reach[order], led[order], cost[order])

    def best(self, i: int, options: _Options, corners: np.ndarray) -> np.ndarray | None:
        """The cheapest of text `i`'s `options` among the places `corners` (n, 2; NaN: none yet) of the others."""
        others = np.isfinite(corners[:, 0])
        others[i] = False
        low, size, anchors = corners[others], self.sizes[others], self.anchors[others]
        texts, ends = np.concatenate([low, low + size], axis=1), _nearest(anchors, low, size)
        chosen, lowest = None, np.inf
        free = np.flatnonzero(~overlapping(options.boxes, texts).any(axis=1))[:_WEIGHED]
        for part in np.split(free, range(_PART, len(free), _PART)):
            if not len(part) or options.cost[part[0]] >= lowest:  # what is added below is never negative
                break
            boxes, tips, led = options.boxes[part], options.tips[part], options.led[part]
            starts = np.broadcast_to(self.anchors[i], tips.shape)
            cost = options.cost[part] + _LEADER_HITS_TEXT * crossing_boxes(starts, tips, texts).sum(axis=1)
            cost += _LEADER_HITS_TEXT * crossing_boxes(anchors, ends, boxes).sum(axis=0)
            cost += _LEADER_HITS_LEADER * crossing_segments(starts, tips, anchors, ends).sum(axis=1)
            cost += _LEADER_HITS_MARKER * led * crossing_boxes(starts, tips, self.markers).sum(axis=1)
            cost += _AMBIGUOUS * (~led & self.nearer_to_another(i, boxes, options.reach[part]))
            if cost.min() < lowest:
                chosen, lowest = options.corners[part[int(np.argmin(cost))]], float(cost.min())
        return chosen


def place_texts(
    anchors: np.ndarray,
    sizes: np.ndarray,
    radii: np.ndarray,
    bounds: Sequence[float],
    markers: np.ndarray,
    curves: Sequence[np.ndarray] = (),
    covering: float = _COVERS_CURVE,
) -> list[Place | None]:
    """Places for texts that overlap neither each other nor the markers nor the frame.

    Parameters
    ----------
    anchors : (n, 2) the points that the texts belong to
    sizes : (n, 2) widths and heights of the texts
    radii : (n,) radii of the markers at those points
    bounds : left, bottom, right, top of the frame that all texts stay in
    markers : (k, 4) boxes to keep off
    curves : polylines (m, 2), rows that are not finite break them; kept off where possible
    covering : cost of each point length of curve under a text, as a distance

    Returns
    -------
    list of Place, None for a text that has no room.
    """
    scene = _Scene(anchors, sizes, radii, np.asarray(bounds, dtype=float), markers, Cover(bounds, curves), covering)
    options = [scene.options(i) for i in range(len(anchors))]
    corners = np.full((len(anchors), 2), np.nan)
    order = np.lexsort((anchors[:, 1], anchors[:, 0]))
    for _ in range(max(1, min(_SWEEPS, _PLACINGS // max(1, len(anchors))))):
        before = corners.copy()
        for i in order:
            place = scene.best(int(i), options[i], corners)
            if place is not None:
                corners[i] = place
        _untangle(anchors, sizes, corners)
        if np.array_equal(before, corners, equal_nan=True):
            break
        order = np.argsort(-np.hypot(*(_nearest(anchors, corners, sizes) - anchors).T), kind="stable")  # the farthest first
    tips = _nearest(anchors, corners, sizes)
    reach = np.hypot(*(tips - anchors).T)
    boxes = np.concatenate([corners - _PAD, corners + sizes + _PAD], axis=1)
    places: list[Place | None] = []
    for i, (corner, tip) in enumerate(zip(corners, tips, strict=True)):
        unclear = scene.nearer_to_another(i, boxes[i : i + 1], reach[i : i + 1])[0]
        leader = (float(tip[0]), float(tip[1])) if unclear or reach[i] > radii[i] + _BESIDE else None
        places.append(None if np.isnan(corner[0]) else Place(float(corner[0]), float(corner[1]), leader))
    return places


def _untangle(anchors: np.ndarray, sizes: np.ndarray, corners: np.ndarray) -> None:
    """Exchange the places of two texts of one size while that shortens their leaders (so leaders that cross do not stay)."""
    placed = np.flatnonzero(np.isfinite(corners[:, 0]))
    size = sizes[placed]
    tips = np.clip(anchors[placed][:, None], corners[placed][None], corners[placed][None] + size[:, None])
    reach = np.hypot(*np.moveaxis(tips - anchors[placed][:, None], -1, 0))  # of text i at place j
    like = np.abs(size[:, None] - size[None]).max(axis=-1) <= _PAD / 2
    place = list(range(len(placed)))
    for _ in range(len(placed)):
        kept = reach[np.arange(len(placed)), place]
        exchanged = reach[:, place]  # of text i at the place of text j
        gain = np.where(like, kept[:, None] + kept[None] - exchanged - exchanged.T, 0.0)
        i, j = divmod(int(np.argmax(gain)), len(placed))
        if gain[i, j] < 1e-6:
            break
        place[i], place[j] = place[j], place[i]
    corners[placed] = corners[placed[place]]
