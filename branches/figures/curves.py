"""How a curve of a family is drawn: smooth, with its stability, and with markers at its special points."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.figures.room import Room, even_points, one_in_cell
from branches.figures.style import BLUE, EVENT_STYLES, GREY, VERMILION, event_look

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

__all__ = [
    "DrawnCurve", "curve_runs", "draw_curve", "draw_events", "draw_events_with_room", "legend_entries", "smooth", "thinned",
    "visible_codes",
]  # fmt: skip

STABILITY = {1: "stable", 0: "unstable", -1: "undecided"}
_LINE: dict[int, dict[str, Any]] = {
    1: {"color": BLUE, "linewidth": 1.5, "linestyle": "-"},
    0: {"color": VERMILION, "linewidth": 0.6, "linestyle": "-"},
    -1: {"color": GREY, "linewidth": 1.0, "linestyle": ":"},
}
_DOT = {1: ("o", 2.5), 0: ("x", 3.2), -1: (".", 2.5)}
_CROSS: dict[str, Any] = {"markersize": 3.2, "markeredgewidth": 0.7}
_CROSS_SPACING = 9.0  # points (1/72 inch)
_BELOW = {"EP": 3.9, "LB": 3.92, "RT": 3.94}  # common types are drawn below the others
_SEEN = 5.0  # an undecided piece shorter than this (points) is hidden by the marker of its event
_SPACING = 3.0  # points between the places of a smooth curve
_MOST = 64  # places added between two points
_SMALLER = 0.7  # markers among many families, against those of one
_APART = 7.0  # points from the middle of a marker to the next
_ABOUT, _ALONE = 5.0, 2.6  # half the width of a marker's surroundings, and how many times that width of curves they may hold


class DrawnCurve(NamedTuple):
    """A curve as it is drawn: x, y (N,), stability codes (N,), and where it must not be joined (N-1,)."""

    x: np.ndarray
    y: np.ndarray
    stable: np.ndarray
    breaks: np.ndarray


def segment_kinds(stable: np.ndarray) -> np.ndarray:
    """Stability (N-1,) of the pieces between N points: stable only where both ends are; a single undecided point between
    decided ones (an event, where the multiplier sits on the limit) takes the side of each neighbour."""
    stable = np.asarray(stable).astype(int)
    padded = np.concatenate([[0], stable, [0]])
    lone = (stable == -1) & (padded[:-2] != -1) & (padded[2:] != -1)
    a, b = stable[:-1], stable[1:]
    mixed = np.where((a == -1) | (b == -1), -1, 0)
    return np.where(a == b, a, np.where(lone[:-1], b, np.where(lone[1:], a, mixed)))


def smooth(curve: DrawnCurve, arclength: np.ndarray, size: tuple[float, float]) -> DrawnCurve:
    """The curve with places between its points, on a cubic of the arclength that passes through every point and stays between
    neighbours (Fritsch & Carlson, SIAM J. Numer. Anal. 17 (1980) 238), so it has no bend that the points do not have.

    Parameters
    ----------
    curve : DrawnCurve
        x positive: it is interpolated by its logarithm.
    arclength : (N,) not falling
    size : (width, height) of the panel in points

    Returns
    -------
    DrawnCurve
        All points of `curve` in their order, with places between those that stand far apart; nothing before the first point of
        a piece and nothing behind its last.
    """
    from scipy.interpolate import PchipInterpolator

    kinds = segment_kinds(curve.stable)
    columns = np.stack([np.log(curve.x), curve.y], axis=1)
    finite = np.isfinite(columns).all(axis=1)
    joined = ~curve.breaks & finite[:-1] & finite[1:] & (np.diff(arclength) > 0.0)
    extent = np.array([np.ptp(column[finite]) if finite.any() else 0.0 for column in columns.T])
    scale = np.array(size) / np.where(extent > 0.0, extent, np.inf)
    steps = np.hypot(*(np.diff(columns, axis=0) * scale).T)
    added = np.where(joined, np.clip(np.ceil(np.where(joined, steps, 0.0) / _SPACING) - 1, 0, _MOST), 0).astype(int)
    # A straight line needs no places.
    added &= -(np.append(False, joined[:-1]) | np.append(joined[1:], False)).astype(int)
    if not added.any():
        return curve
    given = np.cumsum(np.append(0, 1 + added))
    # Places (i, part): after point i, this part of the way to the next.
    i = np.repeat(np.arange(len(curve.x)), np.append(1 + added, 1))
    part = (np.arange(len(i)) - given[i]) / np.append(1 + added, 1)[i]
    out = columns[i]
    for piece in np.split(np.arange(len(curve.x)), np.flatnonzero(~joined) + 1):
        new = np.flatnonzero((i >= piece[0]) & (i < piece[-1]) & (part > 0.0))
        if len(new):
            at = arclength[i[new]] + part[new] * (arclength[i[new] + 1] - arclength[i[new]])
            out[new] = PchipInterpolator(arclength[piece], columns[piece])(at)
    x, stable = np.exp(out[:, 0]), np.append(kinds, 0)[i]
    x[given], stable[given] = curve.x, curve.stable
    breaks = np.zeros(len(x) - 1, dtype=bool)
    breaks[given[1:][~joined] - 1] = True
    return DrawnCurve(x, out[:, 1], stable, breaks)


def curve_runs(stable: np.ndarray, x: np.ndarray, y: np.ndarray, breaks: np.ndarray) -> dict[int, np.ndarray]:
    """Split a curve by stability.

    Parameters
    ----------
    stable : (N,) 1 stable, 0 unstable, -1 undecided
    x, y : (N,) the curve
    breaks : (N-1,) True where it must not be joined

    Returns
    -------
    dict of code to (k, 2) polylines, joined by rows of NaN
        A piece is stable only where both its ends are; a single undecided point between decided ones (an event, where the
        multiplier sits on the limit) takes the side of each neighbour. A point joined to nothing is a run of its own.
    """
    stable = np.asarray(stable).astype(int)
    points = np.stack([np.asarray(x, dtype=float), np.asarray(y, dtype=float)], axis=1)
    kind = segment_kinds(stable)
    finite = np.isfinite(points).all(axis=1)
    joined = ~np.asarray(breaks, dtype=bool) & finite[:-1] & finite[1:]
    alone = finite & ~np.append(joined, False) & ~np.insert(joined, 0, False)
    gap = np.full((1, 2), np.nan)
    runs: dict[int, np.ndarray] = {}
    for code in STABILITY:
        pieces: list[np.ndarray] = []
        segments = np.flatnonzero(joined & (kind == code))
        for run in np.split(segments, np.flatnonzero(np.diff(segments) > 1) + 1):
            if len(run):
                pieces += [points[run[0] : run[-1] + 2], gap]
        for i in np.flatnonzero(alone & (stable == code)):
            pieces += [points[i : i + 1], gap]
        if pieces:
            runs[code] = np.concatenate(pieces[:-1])
    return runs


def draw_curve(axes: Axes, runs: Mapping[int, np.ndarray], panel: str, fine: float = 1.0) -> None:
    """Draw runs from `curve_runs`: stable solid, unstable thin with crosses, undecided dotted grey.

    `fine` below 1 draws thinner, for many curves in one figure."""
    to_points = 72 / axes.figure.dpi
    for code, run in runs.items():
        marker, size = _DOT[code]
        breaks = np.flatnonzero(np.isnan(run[:, 0]))
        pieces = [piece[np.isfinite(piece[:, 0])] for piece in np.split(run, breaks)]
        single = [piece for piece in pieces if len(piece) == 1]
        look = {**_LINE[code], "linewidth": fine * _LINE[code]["linewidth"]}
        (line,) = axes.plot(run[:, 0], run[:, 1], zorder=2 + (code == 1) * 0.1, **look)
        line.set_gid(f"{panel}-{STABILITY[code]}")
        if single:
            dots = np.concatenate(single)
            (spots,) = axes.plot(dots[:, 0], dots[:, 1], marker, markersize=fine * size, color=_LINE[code]["color"], zorder=2.5)
            spots.set_gid(f"{panel}-{STABILITY[code]}-single")
        if code == 0:
            spots_at = []
            for piece in pieces:
                if len(piece) > 1:
                    even = even_points(axes.transData.transform(piece) * to_points, _CROSS_SPACING)
                    spots_at.append(even if len(even) else axes.transData.transform(piece[:1]) * to_points)
            if spots_at:
                apart = one_in_cell(np.concatenate(spots_at), 1.0)
                apart = apart[thinned(apart, 0.6 * _CROSS_SPACING)]
                crosses = axes.transData.inverted().transform(apart / to_points)
                cross = {name: fine * value for name, value in _CROSS.items()}
                (marks,) = axes.plot(crosses[:, 0], crosses[:, 1], "x", color=VERMILION, zorder=2.4, **cross)
                marks.set_gid(f"{panel}-unstable-crosses")


def draw_events(axes: Axes, kinds: Sequence[str], places: np.ndarray, panel: str, **look: Any) -> None:
    """Draw a marker at the place (E, 2) of each event in data coordinates, with one line object for each type. `look` changes the usual
    markers."""
    for kind in dict.fromkeys(kinds):
        x, y = places[[k == kind for k in kinds]].T
        (marks,) = axes.plot(x, y, **{"zorder": _BELOW.get(kind, 4.0), **event_look(kind), **look})
        marks.set_gid(f"{panel}-events-{kind}")


def draw_events_with_room(room: Room, kinds: Sequence[str], places: np.ndarray, panel: str) -> None:
    """Draw the markers that have room, smaller than for one family, and keep their room. The most important event comes first.

    An event has room if its surroundings contain its own curve and at most one that crosses it, and no marker of an event before it.
    """
    at = room.to_page(places)
    free = ((at > room.frame[:2] + 3.0) & (at < room.frame[2:] - 3.0)).all(axis=1)
    free &= ~room.taken(np.concatenate([at - 3.0, at + 3.0], axis=1))
    free &= room.ink_around(at, _ABOUT, each=True) <= _ALONE * 2.0 * _ABOUT
    chosen = np.flatnonzero(free)
    chosen = chosen[thinned(at[chosen], _APART)]
    for kind in dict.fromkeys(kinds):
        mine = [i for i in chosen if kinds[i] == kind]
        if mine:
            size = _SMALLER * event_look(kind)["markersize"]
            draw_events(room.axes, [kind] * len(mine), places[mine], panel, zorder=3.8, markersize=size)
            room.take_around(places[mine], 0.5 * size + 0.5)


def thinned(points: np.ndarray, spacing: float) -> np.ndarray:
    """Which of the points (k, 2), in order, are at least `spacing` from each one kept before: bool (k,)."""
    from scipy.spatial import cKDTree

    kept = np.ones(len(points), dtype=bool)
    if len(points):
        for i, j in sorted(cKDTree(points).query_pairs(spacing)):
            kept[j] &= not kept[i]
    return kept


def visible_codes(panels: Iterable[tuple[Axes, Mapping[int, np.ndarray]]]) -> set[int]:
    """The stability codes that a legend needs: those of the runs that are visible in their panels.

    A short undecided run does not count: the marker of its event hides it."""
    codes = set()
    for axes, runs in panels:
        low, high = np.array(axes.bbox.extents).reshape(2, 2)
        for code, run in runs.items():
            points = axes.transData.transform(run)
            whole = np.isfinite(points).all(axis=1)
            # Segments from each point to the next. A point without a neighbour in its run is drawn as a dot.
            first = np.flatnonzero(whole & np.append(whole[1:], False))
            alone = np.flatnonzero(whole & ~np.append(whole[1:], False) & ~np.append(False, whole[:-1]))
            begin, end = points[np.append(first, alone)], points[np.append(first + 1, alone)]
            seen = ((np.maximum(begin, end) >= low) & (np.minimum(begin, end) <= high)).all(axis=1)
            lengths = np.hypot(*(np.clip(end, low, high) - np.clip(begin, low, high)).T) * 72 / axes.figure.dpi
            lengths[len(first) :] = np.inf
            of_pieces = np.bincount(np.cumsum(~whole)[np.append(first, alone)][seen], lengths[seen])
            if seen.any() and (code >= 0 or of_pieces.max() > _SEEN):
                codes.add(code)
    return codes


def legend_entries(codes: Collection[int], kinds: Sequence[str]) -> list[Line2D]:
    """Legend entries for the stabilities with these codes and for types of events, in the order of `EVENT_STYLES`."""
    from matplotlib.lines import Line2D

    cross = {"marker": "x", **_CROSS}
    looks = [{"label": name, **_LINE[code], **(cross if code == 0 else {})} for code, name in STABILITY.items() if code in codes]
    looks += [event_look(kind) for kind in dict.fromkeys([*EVENT_STYLES, *kinds]) if kind in kinds]
    return [Line2D([], [], **look) for look in looks]
