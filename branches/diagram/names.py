"""Names of families in a figure of many: which are written, and which point of its curve each belongs to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from branches.diagram.room import Room, even_points
from branches.diagram.style import SMALL
from branches.diagram.titles import short_ids

if TYPE_CHECKING:
    from branches.diagram.atlas_data import Curve

__all__ = ["Named", "names_of", "short_name", "write_names"]

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
        self, curve: Curve | None, x: np.ndarray, y: np.ndarray, breaks: np.ndarray | None = None, text: str = "", cited: bool = False
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
        if self.curve is None or not self.curve.pinned.any():
            return [self]
        texts = dict.fromkeys(self.curve.names[self.curve.pinned].tolist())
        return [Named(self.curve, self.x, self.y, self.breaks, text, True) for text in texts]

    def spots(self, room: Room) -> np.ndarray:
        """Places (k, 2) on the page inside the frame, along the part of the curve that has this name."""
        points = np.stack([self.x, self.y], axis=1)
        if self.curve is not None:
            mine = self.curve.pinned & (self.curve.names == self.text) if self.cited else self.curve.labels == self.text
            if mine.any():
                points[~mine] = np.nan
        path = room.to_page(points)
        broken = np.insert(path, np.flatnonzero(self.breaks) + 1, np.nan, axis=0)
        spots = np.concatenate([even_points(broken, _SPACING), path[np.isfinite(path).all(axis=1)][:1]]) if len(path) > 1 else path
        return spots[((spots > room.frame[:2] + 2.0) & (spots < room.frame[2:] - 2.0)).all(axis=1)]


def names_of(curves: Sequence[Named], room: Room | None = None) -> list[Named]:
    """The names that may be written, the most important first: all cited ones, and one for each other family.

    Families without a label get a short id. So do all but the most important one of those with equal names.

    Parameters
    ----------
    curves : sequence of Named
    room : Room, optional
        Leaves out what is not inside its frame.
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
    """The place (2,) on the page that a name belongs to, None if there is none; it is added to `places`, those of other names."""
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
