"""What is drawn in a panel of a branch: the curve with its stability, the special points, and their texts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.diagram.placement import even_points, place_texts, thinned
from branches.diagram.smooth import segment_kinds
from branches.diagram.style import BLACK, BLUE, GREY, SMALL, VERMILION, EventStyle, event_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

STABILITY = {1: "stable", 0: "unstable", -1: "undecided"}
_LINE: dict[int, dict[str, Any]] = {
    1: {"color": BLUE, "linewidth": 1.5, "linestyle": "-"},
    0: {"color": VERMILION, "linewidth": 0.6, "linestyle": "-"},
    -1: {"color": GREY, "linewidth": 1.0, "linestyle": ":"},
}
_DOT = {1: ("o", 2.5), 0: ("x", 3.2), -1: (".", 2.5)}
_CROSS: dict[str, Any] = {"markersize": 3.2, "markeredgewidth": 0.7}
_CROSS_SPACING = 9.0  # points
_BELOW = {"EP": 3.9, "LB": 3.92, "RT": 3.94}  # what is common or plain to see leaves the point that it covers in sight
_SEEN = 5.0  # an undecided piece shorter than this (points) is hidden by the marker of its event
_CROWD, _CROWD_STEP = 5, 2.5  # this many points, each this near to the one before (points), share one text
_TICK_ROOM = 4.0  # texts keep off the ticks inside the frame


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


def _pieces(run: np.ndarray) -> list[np.ndarray]:
    return np.split(run, np.flatnonzero(np.isnan(run[:, 0])))


def draw_curve(axes: Axes, runs: Mapping[int, np.ndarray], panel: str, fine: float = 1.0) -> None:
    """Draw runs from `curve_runs`: stable solid; unstable thin with crosses apart from each other; undecided dotted grey. `fine` below 1
    draws thinner, for many curves in one picture."""
    to_points = 72 / axes.figure.dpi
    for code, run in runs.items():
        marker, size = _DOT[code]
        pieces = [piece[np.isfinite(piece[:, 0])] for piece in _pieces(run)]
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
                apart = np.concatenate(spots_at)
                apart = apart[thinned(apart, 0.6 * _CROSS_SPACING)]
                crosses = axes.transData.inverted().transform(apart / to_points)
                cross = {name: fine * value for name, value in _CROSS.items()}
                (marks,) = axes.plot(crosses[:, 0], crosses[:, 1], "x", color=VERMILION, zorder=2.4, **cross)
                marks.set_gid(f"{panel}-unstable-crosses")


def marker_look(style: EventStyle, smaller: float = 1.0) -> dict[str, Any]:
    """How matplotlib draws a marker, in full size or smaller."""
    return {
        "marker": style.marker,
        "markersize": smaller * style.size,
        "markerfacecolor": style.colour,
        "markeredgecolor": BLACK,
        "markeredgewidth": 0.6,
        "linestyle": "none",
    }


def draw_events(axes: Axes, kinds: Sequence[str], x: np.ndarray, y: np.ndarray, panel: str) -> None:
    """Draw one marker for each special point, one line object for each type."""
    for kind in dict.fromkeys(kinds):
        of_kind = np.array([k == kind for k in kinds])
        above = _BELOW.get(kind, 4.0)
        (marks,) = axes.plot(x[of_kind], y[of_kind], zorder=above, clip_on=False, **marker_look(event_style(kind)))
        marks.set_gid(f"{panel}-events-{kind}")


def label_events(
    axes: Axes,
    names: Sequence[str],
    kinds: Sequence[str],
    x: np.ndarray,
    y: np.ndarray,
    curve: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[int, int]:
    """Write the special points' names where they overlap nothing. Returns how many have no room, and how many there are.

    Parameters
    ----------
    axes : with its final limits and place in the figure
    names, kinds : (E,) names and types of the special points
    x, y : (E,) where they are; those that are not finite are left out
    curve : x (N,), y (N,), breaks (N-1,) of the drawn curve, kept off where possible
    """
    figure = axes.figure
    to_points = 72 / figure.dpi
    shown = [i for i in range(len(names)) if np.isfinite(x[i]) and np.isfinite(y[i])]
    if not shown:
        return 0, 0
    anchors = axes.transData.transform(np.stack([x[shown], y[shown]], axis=1)) * to_points
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    radii = np.array([event_style(kinds[i]).size for i in shown], dtype=float) / 2 + 0.5
    markers = np.concatenate([anchors - radii[:, None], anchors + radii[:, None]], axis=1)
    frame = (np.array(axes.get_window_extent(renderer).extents) * to_points + np.array([1, 1, -1, -1]) * _TICK_ROOM).tolist()
    texts = crowds([names[i] for i in shown], [kinds[i] for i in shown], anchors)
    rows = np.array([row for row, _ in texts])
    sizes = np.empty((len(texts), 2))
    for k, (_, text) in enumerate(texts):
        trial = axes.text(0, 0, text, fontsize=SMALL)
        sizes[k] = np.array(trial.get_window_extent(renderer).size) * to_points
        trial.remove()
    places = place_texts(anchors[rows], sizes, radii[rows], frame, markers, _drawn(axes, curve, to_points))
    for (row, text), place in zip(texts, places, strict=True):
        if place is None:
            continue
        at = (x[shown[row]], y[shown[row]])
        offset = (place.left - anchors[row, 0], place.bottom - anchors[row, 1])
        axes.annotate(text, at, offset, fontsize=SMALL, ha="left", va="bottom", textcoords="offset points", zorder=6)
        if place.leader:
            tip = (place.leader[0] - anchors[row, 0], place.leader[1] - anchors[row, 1])
            arrow = {"arrowstyle": "-", "linewidth": 0.4, "color": GREY, "shrinkA": 0.8, "shrinkB": 0}
            axes.annotate("", at, tip, textcoords="offset points", arrowprops=arrow, zorder=3)
    return sum(place is None for place in places), len(places)


def crowds(names: Sequence[str], kinds: Sequence[str], anchors: np.ndarray) -> list[tuple[int, str]]:
    """Which texts to write: (row of the point that it stands at, text).

    Each point's own name; but `_CROWD` or more successive points of one type, each within `_CROWD_STEP` points of the one
    before, are one blob to the eye and get one text for all, such as GR1-12.
    """
    texts: list[tuple[int, str]] = []
    for kind in dict.fromkeys(kinds):
        rows = [row for row, k in enumerate(kinds) if k == kind]
        far = [i + 1 for i in range(len(rows) - 1) if np.hypot(*(anchors[rows[i + 1]] - anchors[rows[i]])) > _CROWD_STEP]
        for start, stop in zip([0, *far], [*far, len(rows)], strict=True):
            crowd = rows[start:stop]
            if len(crowd) < _CROWD:
                texts += [(row, names[row]) for row in crowd]
            else:
                text = f"{names[crowd[0]]}\N{EN DASH}{names[crowd[-1]].removeprefix(kind)}"
                texts.append((crowd[len(crowd) // 2], text))
    return texts


def _drawn(axes: Axes, curve: tuple[np.ndarray, np.ndarray, np.ndarray], to_points: float) -> list[np.ndarray]:
    x, y, breaks = curve
    path = axes.transData.transform(np.stack([x, y], axis=1)) * to_points
    return np.split(path, np.flatnonzero(breaks) + 1)


def seen(panels: Iterable[tuple[Axes, Mapping[int, np.ndarray]]]) -> set[int]:
    """Codes of the runs from `curve_runs` of panels, with their limits, that a legend has to tell of: those that come into sight in any
    of them. An undecided one has to be long enough to be told apart, for a shorter piece lies beneath the marker of its event."""
    codes = set()
    for axes, runs in panels:
        corners = np.sort(axes.transAxes.transform([(0.0, 0.0), (1.0, 1.0)]), axis=0)
        codes |= {code for code, run in runs.items() if any(_in_sight(axes, corners, piece, code < 0) for piece in _pieces(run))}
    return codes


def _in_sight(axes: Axes, corners: np.ndarray, piece: np.ndarray, long: bool) -> bool:
    """Whether a piece of a run lies in a panel between two corners (2, 2) in pixels, at least in part; `long`: so that it can be told."""
    points = axes.transData.transform(piece[np.isfinite(piece).all(axis=1)])
    low, high = corners
    # Of one point, the dot that is drawn for it; else the lines from one to the next.
    begin, end = (points, points) if len(points) == 1 else (points[:-1], points[1:])
    inside = ((np.maximum(begin, end) >= low) & (np.minimum(begin, end) <= high)).all(axis=1)
    if not inside.any():
        return False
    shown = np.clip(np.concatenate([begin[inside], end[inside]]), low, high)
    return not long or len(points) == 1 or bool(np.max(np.ptp(shown, axis=0)) * 72 / axes.figure.dpi > _SEEN)


def legend_entries(codes: Collection[int], kinds: Sequence[str]) -> list[Line2D]:
    """Legend handles for the stabilities with these codes and for the types of special points, in the table's order."""
    from matplotlib.lines import Line2D

    from branches.diagram.style import EVENT_STYLES

    entries = []
    for code, name in STABILITY.items():
        if code in codes:
            cross = {"marker": "x", **_CROSS} if code == 0 else {}
            entries.append(Line2D([], [], label=name, **{**_LINE[code], **cross}))
    order = [k for k in EVENT_STYLES if k in kinds] + [k for k in dict.fromkeys(kinds) if k not in EVENT_STYLES]
    for kind in order:
        style = event_style(kind)
        entries.append(Line2D([], [], label=f"{kind} {style.name}" if style.name != kind else kind, **marker_look(style)))
    return entries
