"""The names of families in a picture of many: which are written, where each points to, and where it stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.diagram.placement import Cover, Place, crossing_boxes, even_points, overlapping, place_texts
from branches.diagram.style import BLACK, GREY, SMALL
from branches.diagram.titles import short_ids

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from branches.diagram.atlas_data import Curve

__all__ = ["Named", "label_curves", "names_of", "tell_apart"]

_SPACING = 7.0  # points between the places on a curve that a name may point to
_ROOM = 13.0  # half the width of the surroundings that count as crowded
_POOL, _ROUNDS = 4, 3  # names that wait for a place, for each that gets one; times that those without room give way
_HIDDEN, _HIDDEN_IN_DETAIL = 6.0, 1.0  # point lengths of curves that a name may hide
_COVERS = 8.0  # cost of each point length of curve under a name, as a distance
_OWN, _SPOTS = 1.5, 1.0  # points: what is so near to a curve is taken for it; between the points of curves that are looked at
_MODE_ALONE = 4.0  # points that another curve is further from the name of a linear mode than its own line
FAR = 48.0
"""Points: a name that would stand further off than this is left out, as leaders across the picture tell nothing."""


class Named:
    """A curve of a panel with its family: x, y (N,) and breaks (N - 1,) where it is not joined; the text of its name, and the short id
    that is written behind it, or in its place where there is none."""

    def __init__(
        self,
        curve: Curve | None,
        x: np.ndarray,
        y: np.ndarray,
        breaks: np.ndarray,
        text: str = "",
        pinned: bool = False,
        short_id: str = "",
    ):
        self.curve = curve
        self.x = np.asarray(x, dtype=float)
        self.y = np.asarray(y, dtype=float)
        self.breaks = np.asarray(breaks, dtype=bool)
        self.text = text or ("" if curve is None else curve.label)
        self.pinned = pinned
        self.short_id = short_id

    @classmethod
    def point(cls, text: str, x: float, y: float, more: str = "") -> Named:
        """A name for one point."""
        return cls(None, np.array([x]), np.array([y]), np.zeros(0), text, short_id=more)

    @property
    def shown(self) -> str:
        """The name as it is written in a picture."""
        return " ".join(part for part in (self.text and written(self.text), self.short_id) if part)

    @property
    def key(self) -> str:
        """What tells it apart: the family's id, or the text."""
        return self.text if self.curve is None else self.curve.family

    @property
    def importance(self) -> tuple[bool, bool, float, str]:
        """Sort key: pinned first, then those with a label, then the longest range of energy."""
        if self.curve is None:
            return (False, False, 0.0, self.text)
        return (not self.pinned, not self.text, -float(np.log(self.curve.h.max() / self.curve.h.min())), self.curve.family)

    def path(self) -> np.ndarray:
        """The curve (n, 2), with rows of NaN where it is broken."""
        return np.insert(np.stack([self.x, self.y], axis=1), np.flatnonzero(self.breaks) + 1, np.nan, axis=0)

    def owned(self) -> np.ndarray:
        """Points (N, 2) of the curve where its label is the one written; other rows are NaN."""
        points = np.stack([self.x, self.y], axis=1)
        if self.curve is not None:
            mine = self.curve.pinned & (self.curve.names == self.text) if self.pinned else self.curve.labels == self.text
            if mine.any():
                points[~mine] = np.nan
        return points

    def names(self) -> list[Named]:
        """The same curve with each of its pinned names; itself where it has none."""
        if self.curve is None or not self.curve.pinned.any():
            return [self]
        texts = dict.fromkeys(self.curve.names[self.curve.pinned].tolist())
        return [Named(self.curve, self.x, self.y, self.breaks, text, True) for text in texts]


def tell_apart(curves: Sequence[Named]) -> dict[tuple[str, str], str]:
    """The short ids that are written, by (family, text): of families without a label, and of all but the most important one of those that
    have the same name."""
    families = list(dict.fromkeys(curve.key for curve in curves))
    known = short_ids(families)
    first: dict[str, str] = {}
    out: dict[tuple[str, str], str] = {}
    for name in sorted((name for curve in curves for name in curve.names()), key=lambda name: name.importance):
        if not name.text or first.setdefault(name.text, name.key) != name.key:
            out[name.key, name.text] = known[name.key]
    return out


def names_of(curves: Sequence[Named], axes: Axes | None = None) -> list[Named]:
    """The curves with their names, which are all different: one for each family but all that are pinned, the most important first; those
    in sight of `axes` where it is given."""
    apart = tell_apart(curves)
    chosen: dict[tuple[str, str], Named] = {}
    families: set[str] = set()
    for curve in sorted((name for curve in curves for name in curve.names()), key=lambda curve: curve.importance):
        key = (curve.key, curve.text)
        if key in chosen or (curve.key in families and not curve.pinned):
            continue
        if axes is not None and not len(_in_sight(axes, curve)):
            continue
        curve.short_id = apart.get(key, "")
        chosen[key] = curve
        families.add(curve.key)
    return list(chosen.values())


def _in_sight(axes: Axes, named: Named) -> np.ndarray:
    """Places (k, 2) in points along the curve inside the frame."""
    to_points = 72 / axes.figure.dpi
    path = axes.transData.transform(named.owned()) * to_points
    broken = np.insert(path, np.flatnonzero(named.breaks) + 1, np.nan, axis=0)
    spots = np.concatenate([even_points(broken, _SPACING), path[np.isfinite(path).all(axis=1)][:1]]) if len(path) > 1 else path
    frame = np.array(axes.bbox.extents) * to_points
    inside = (spots > frame[:2] + 2.0).all(axis=1) & (spots < frame[2:] - 2.0).all(axis=1)
    return spots[inside]


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A name with the place (2,) in points that it points to, its size (2,), the radius of the marker there, and how far it may stand."""

    named: Named
    at: np.ndarray
    size: np.ndarray
    radius: float
    far: float
    font: float


def label_curves(
    axes: Axes,
    names: Sequence[Named],
    curves: Sequence[np.ndarray],
    keep_off: Sequence[Sequence[float]] = (),
    *,
    most: int,
    always: Sequence[Named] = (),
    far: float = FAR,
    detail: bool = False,
    font: float = SMALL,
) -> set[str]:
    """Write names beside their curves, each at the least crowded place, with a leader where it has to stand off. A name without room near
    its curve gives way to the next one.

    Parameters
    ----------
    axes : with its final limits and place in the figure
    names : the most important first
    curves : polylines (n, 2) in data coordinates, kept off where possible
    keep_off : boxes in points that no name covers
    most : names that are written at most
    always : names that are written before all others, and do not count
    far : points that a name stands off at most; three times that for a pinned one
    detail : whether the names stand elsewhere, too, so that none has to touch a curve
    font : size of the names

    Returns
    -------
    set of str
        Keys of the names that are written.
    """
    to_points = 72 / axes.figure.dpi
    frame = np.array(axes.bbox.extents) * to_points
    boxes = np.array(list(keep_off), dtype=float).reshape(-1, 4)
    paths = [axes.transData.transform(curve) * to_points for curve in curves]
    cover = Cover(frame.tolist(), paths)
    first = _candidates(axes, always, boxes, cover, far, font)
    waiting = _candidates(axes, names[: _POOL * most], boxes, cover, far, font, first)
    bounds = (frame + np.array([4.0, 4.0, -4.0, -4.0])).tolist()

    def placed(chosen: Sequence[_Candidate], slack: float = 1.0) -> list[tuple[_Candidate, Place]]:
        if not chosen:
            return []
        at, sizes = np.array([item.at for item in chosen]), np.array([item.size for item in chosen])
        places = place_texts(at, sizes, np.array([item.radius for item in chosen]), bounds, boxes, paths, _COVERS)
        pairs = zip(chosen, places, strict=True)
        return [(item, place) for item, place in pairs if place is not None and _reach(item, place) <= slack * item.far]

    chosen = first
    for _ in range(_ROUNDS):
        room = most - sum(item.named not in always for item in chosen)
        chosen, waiting = chosen + waiting[:room], waiting[room:]
        count = len(chosen)
        done = placed(chosen)
        chosen = [item for item, _ in done]
        if len(chosen) == count:
            break
    else:
        done = placed(chosen, 1.5)
    done = _led(_readable(done, cover, detail), axes, paths)
    for item, place in done:
        _write(axes, item, place, to_points)
    return {item.named.key for item, _ in done}


def _led(done: Sequence[tuple[_Candidate, Place]], axes: Axes, paths: Sequence[np.ndarray]) -> list[tuple[_Candidate, Place]]:
    """The names, with a leader also where a name stands beside its own curve but nearer to another one; that of a linear mode also where
    another curve is almost as near."""
    spots = np.concatenate([even_points(path, _SPOTS) for path in paths] or [np.empty((0, 2))])
    out: list[tuple[_Candidate, Place]] = []
    for item, place in done:
        corner = np.array([place.left, place.bottom])
        reach = _reach(item, place)
        if place.leader is None and len(item.named.x) > 1:
            slack = _MODE_ALONE if item.named.curve is None else -_SPOTS
            near = spots[np.hypot(*(np.clip(spots, corner, corner + item.size) - spots).T) < reach + slack]
            own = even_points(axes.transData.transform(item.named.path()) * 72 / axes.figure.dpi, _SPOTS)
            if len(near) and len(own) and any(np.hypot(*(own - spot).T).min() > _OWN for spot in near):
                tip = np.clip(item.at, corner, corner + item.size)
                place = Place(place.left, place.bottom, (float(tip[0]), float(tip[1])))
        out.append((item, place))
    return out


def _readable(done: Sequence[tuple[_Candidate, Place]], cover: Cover, detail: bool) -> list[tuple[_Candidate, Place]]:
    """Those of the names, the most important first, that no leader strikes out and that hide no curve; a pinned one may touch a curve, but
    not in a detail."""
    kept: list[tuple[_Candidate, Place]] = []
    boxes, starts, ends = np.empty((0, 4)), np.empty((0, 2)), np.empty((0, 2))
    for item, place in done:
        corner = np.array([place.left, place.bottom])
        box = np.concatenate([corner, corner + item.size])[None]
        touches = (item.named.curve is None or item.named.pinned) and not detail
        if not touches and cover.within(box)[0] > (_HIDDEN_IN_DETAIL if detail else _HIDDEN):
            continue
        start, end = item.at[None], np.array([place.leader or item.at])
        if crossing_boxes(starts, ends, box).any() or (place.leader and crossing_boxes(start, end, boxes).any()):
            continue
        kept.append((item, place))
        boxes, starts, ends = np.concatenate([boxes, box]), np.concatenate([starts, start]), np.concatenate([ends, end])
    return kept


def _candidates(
    axes: Axes, names: Sequence[Named], boxes: np.ndarray, cover: Cover, far: float, font: float, others: Sequence[_Candidate] = ()
) -> list[_Candidate]:
    to_points = 72 / axes.figure.dpi
    renderer = axes.figure.canvas.get_renderer()  # type: ignore[attr-defined]
    out: list[_Candidate] = []
    for named in names:
        spots = _in_sight(axes, named)
        if len(named.x) > 1:  # a name of one point stands beside its marker; a curve has other places
            spots = spots[~overlapping(np.concatenate([spots, spots], axis=1), boxes).any(axis=1)]
        if not len(spots):
            continue
        crowded = cover.within(np.concatenate([spots - _ROOM, spots + _ROOM], axis=1))
        for other in (*others, *out):  # names that point to one place would push each other away
            crowded = crowded + 40.0 * (np.hypot(*(spots - other.at).T) < 2.0 * _ROOM)
        trial = axes.text(0, 0, named.shown, fontsize=font)
        size = np.array(trial.get_window_extent(renderer).size) * to_points
        trial.remove()
        radius = 3.0 if len(named.x) == 1 else 0.8
        out.append(_Candidate(named, spots[int(np.argmin(crowded))], size, radius, 3.0 * far if named.pinned else far, font))
    return out


def _write(axes: Axes, item: _Candidate, place: Place, to_points: float) -> None:
    x, y = axes.transData.inverted().transform(item.at / to_points)
    here = (float(x), float(y))
    offset = (place.left - item.at[0], place.bottom - item.at[1])
    style: dict[str, Any] = {"fontsize": item.font, "color": BLACK, "ha": "left", "va": "bottom", "zorder": 6}
    axes.annotate(item.named.shown, here, offset, textcoords="offset points", **style)
    if place.leader:
        tip = (place.leader[0] - item.at[0], place.leader[1] - item.at[1])
        arrow = {"arrowstyle": "-", "linewidth": 0.4, "color": GREY, "shrinkA": 0.8, "shrinkB": 0}
        axes.annotate("", here, tip, textcoords="offset points", arrowprops=arrow, zorder=5)


def _reach(item: _Candidate, place: Place) -> float:
    corner = np.array([place.left, place.bottom])
    return float(np.hypot(*(np.clip(item.at, corner, corner + item.size) - item.at)))


def written(label: str) -> str:
    """The label as it is written in a picture: short, in mathematics; L1, L2, ... of the modes of any system upright.

    Examples
    --------
    >>> print(written("S13O00+"), written("L3"))
    $\\mathrm{S13}^{+}$ $\\mathrm{L3}$
    """
    from branches.labels import latex, parse

    if label.startswith("L") and label[1:].isdecimal() and label[1:] != "11":
        return rf"$\mathrm{{{label}}}$"
    return latex(parse(label), short=True)
