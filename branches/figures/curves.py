"""Drawing of family curves with their stability and special points, and of insets that enlarge a part of a figure.

An inset is inside the axes where it covers no curve, else beside them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.figures.room import Room, even_points, one_in_cell, overlapping
from branches.figures.style import BLACK, BLUE, EVENT_STYLES, GREY, SMALL, VERMILION, event_look, limits_of, set_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

__all__ = [
    "DrawnCurve", "Inset", "Place", "curve_runs", "draw_curve", "draw_events", "draw_events_with_room", "draw_inset", "legend_entries",
    "parse_inset", "place_insets", "smooth", "thinned", "visible_codes",
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
        All points of `curve` in their order, with further places between points that are far apart; nothing before the first point of
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

    An event has room if its surroundings contain no earlier marker, and at most one other curve, which crosses its own.
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
            finite = np.isfinite(points).all(axis=1)
            # Segments from each point to the next. A point without a neighbour in its run is drawn as a dot.
            first = np.flatnonzero(finite & np.append(finite[1:], False))
            alone = np.flatnonzero(finite & ~np.append(finite[1:], False) & ~np.append(False, finite[:-1]))
            begin, end = points[np.append(first, alone)], points[np.append(first + 1, alone)]
            seen = ((np.maximum(begin, end) >= low) & (np.minimum(begin, end) <= high)).all(axis=1)
            lengths = np.hypot(*(np.clip(end, low, high) - np.clip(begin, low, high)).T) * 72 / axes.figure.dpi
            lengths[len(first) :] = np.inf
            of_pieces = np.bincount(np.cumsum(~finite)[np.append(first, alone)][seen], lengths[seen])
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


_SIZES = ((0.40, 0.36), (0.34, 0.32), (0.30, 0.28))  # parts of the frame; the largest that finds an empty place is taken
_STEPS = 24
_CLEAR = 3.0  # points between an inset and a curve: half a marker on the curve, and some air
_BESIDE, _MOST_BESIDE = 0.34, 0.5  # part of the width that insets beside the axes take, and the largest that they may take
_BESIDE_APART = 14.0  # points between the axes and the insets beside them
_LOWEST = 88.0  # least height of an inset beside the axes, in points
_TICK = np.array([38.0, 20.0])  # points for each tick
_MARGIN = np.array([31.0, 24.0, -6.0, -6.0])  # room for the ticks and labels of an inset: left, bottom, right, top, in points
_SPACE = _MARGIN[:2] - _MARGIN[2:]
_LARGER = 1.1  # an inset is larger than what it shows by this factor, in both directions where the frame has room
_WIDEST, _HIGHEST = 0.6, 0.8  # largest parts of the frame that an inset takes


@dataclass(frozen=True)
class Inset:
    """A part of the frequency-energy plane: energies, and frequencies (None: those of the curves there)."""

    energy: tuple[float, float]
    frequency: tuple[float, float] | None = None

    def __str__(self) -> str:
        """Its name in a message: what `parse_inset` reads, after `inset`."""
        ranges = [self.energy] if self.frequency is None else [self.energy, self.frequency]
        return "inset " + ",".join(f"{low:g}:{high:g}" for low, high in ranges)


def parse_inset(text: str) -> Inset:
    """Read ``LO:HI`` or ``LO:HI,FLO:FHI``.

    Raises
    ------
    ValueError
        In one line, with what was received and expected.

    Examples
    --------
    >>> parse_inset("1:3,2:5")
    Inset(energy=(1.0, 3.0), frequency=(2.0, 5.0))
    """
    try:
        ranges = [tuple(float(number) for number in part.split(":")) for part in text.split(",")]
    except ValueError:
        ranges = []
    if not 1 <= len(ranges) <= 2 or not all(len(pair) == 2 and 0.0 < pair[0] < pair[1] < math.inf for pair in ranges):
        raise ValueError(f"inset {text!r}: expected LO:HI in energy or LO:HI,FLO:FHI with the frequencies too, 0 < LO < HI")
    (low, high), *more = ranges
    return Inset((low, high), (more[0][0], more[0][1]) if more else None)


@dataclass(frozen=True, eq=False)
class Place:
    """An inset with the ranges of x and y that it shows, and the box (4,) that it takes with its ticks, in points of the page."""

    inset: Inset
    x: tuple[float, float]
    y: tuple[float, float]
    box: np.ndarray


def place_insets(axes: Axes, insets: Sequence[Inset], curves: Sequence[np.ndarray], room_now: Callable[[], Room]) -> list[Place]:
    """Find a place for each inset: in `axes` where it covers no curve, else beside `axes`, which become narrower for it.

    The axes must have their final limits and place in the figure. Anything that depends on the place is drawn later. The insets show parts
    of the curves (n, 2), in data coordinates. `room_now` returns the room of `axes` in its present place.

    Raises
    ------
    ValueError
        For an inset that shows nothing, and for one without a place.
    """
    if not insets:
        return []
    ranges = [(inset.energy, _frequencies(inset, curves, axes.get_yscale() == "log")) for inset in insets]
    room = room_now()
    outer = room.frame
    beside: list[int] = []
    while True:
        shown = [room.to_page(np.array(part).T).ravel() for part in ranges]
        for inset, box in zip(insets, shown, strict=True):
            if not room.ink_in(box[None])[0]:
                raise ValueError(f"{inset}: nothing is drawn there")
        boxes = dict(zip(beside, _column(insets, beside, shown, room.frame, outer), strict=True))
        for k in range(len(insets)):
            if k in boxes:
                continue
            found = _inside(room, np.array([*shown, *boxes.values()]), _LARGER * (shown[k][2:] - shown[k][:2]) + _SPACE)
            if found is None:
                break
            boxes[k] = found
        else:
            return [Place(insets[k], *ranges[k], boxes[k]) for k in range(len(insets))]
        # Narrower axes have other empty places: all insets inside are placed anew.
        beside = sorted([*beside, k])
        _narrow(axes, insets, beside, shown, outer)
        room = room_now()


def _frequencies(inset: Inset, curves: Sequence[np.ndarray], log: bool) -> tuple[float, float]:
    if inset.frequency is not None:
        return inset.frequency
    points = np.concatenate([*curves, np.empty((0, 2))])
    heights = points[(points[:, 0] >= inset.energy[0]) & (points[:, 0] <= inset.energy[1]), 1]
    if not np.isfinite(heights).any():
        raise ValueError(f"{inset}: no family has a point at these energies")
    return limits_of(heights, log=log)


def _inside(room: Room, taken: np.ndarray, least: np.ndarray) -> np.ndarray | None:
    """The largest box (4,) in the frame, at least of this size (2,), that covers neither a curve nor a taken box (a, 4)."""
    frame = room.frame
    outer = frame[2:] - frame[:2]
    if (least > np.array([_WIDEST, _HIGHEST]) * outer).any():
        return None
    for part in _SIZES:
        size = np.maximum(np.array(part) * outer, least)
        steps = [np.linspace(frame[i] + 3.0, frame[2 + i] - 3.0 - size[i], _STEPS) for i in range(2)]
        corners = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
        boxes = np.concatenate([corners, corners + size], axis=1)
        boxes = boxes[~overlapping(boxes, taken).any(axis=1) & ~room.taken(boxes)]
        boxes = boxes[room.ink_in(boxes + np.array([-_CLEAR, -_CLEAR, _CLEAR, _CLEAR])) == 0]
        if len(boxes):
            return np.asarray(boxes[0])
    return None


def _narrow(axes: Axes, insets: Sequence[Inset], beside: Sequence[int], shown: Sequence[np.ndarray], outer: np.ndarray) -> None:
    """Make room beside the axes, which were `outer` (4,) at first, for the widest of the insets."""
    width, full = axes.bbox.width * 72 / axes.figure.dpi, outer[2] - outer[0]
    share, widest = max(((shown[k][2] - shown[k][0]) / width, k) for k in beside)
    # The narrower axes leave room for the share of them that is shown, enlarged, and for the margins.
    part = max(_BESIDE, (_LARGER * share + (_SPACE[0] + _BESIDE_APART) / full) / (1.0 + _LARGER * share))
    if part > _MOST_BESIDE:
        raise ValueError(f"{insets[widest]}: there is no place beside what it shows; expected a smaller part, LO:HI,FLO:FHI")
    place = axes.get_position()
    axes.set_position((place.x0, place.y0, place.width * (1.0 - part) * full / width, place.height))


def _column(
    insets: Sequence[Inset], beside: Sequence[int], shown: Sequence[np.ndarray], frame: np.ndarray, outer: np.ndarray
) -> list[np.ndarray]:
    """The boxes of the insets beside the axes, one below the other."""
    if not beside:
        return []
    height = (frame[3] - frame[1]) / len(beside)
    if height < _LOWEST:
        raise ValueError(f"{insets[beside[-1]]}: there is no place beside the others; expected fewer insets or smaller parts")
    out = []
    for row, k in enumerate(beside):
        high = min(height, max(_LARGER * (shown[k][3] - shown[k][1]) + _SPACE[1], outer[2] - frame[2] - _BESIDE_APART))
        top = frame[3] - row * height
        out.append(np.array([frame[2] + _BESIDE_APART, top - high, outer[2], top]))
    return out


def draw_inset(room: Room, place: Place, name: str) -> Axes:
    """Make the axes of an inset. A frame and two lines indicate what it shows; names keep off all of them."""
    axes = room.axes
    left, bottom, right, top = (place.box + _MARGIN) / 72
    panel = axes.inset_axes((left, bottom, right - left, top - bottom), transform=axes.figure.dpi_scale_trans, zorder=7, label=name)
    across, up = np.maximum(2, 72 * np.array([right - left, top - bottom]) // _TICK).astype(int).tolist()
    set_axis(panel, "x", place.x, min(across, 4), "", _symbol(axes.get_xlabel()), log=True)
    set_axis(panel, "y", place.y, min(up, 4), "", _symbol(axes.get_ylabel()), log=axes.get_yscale() == "log")
    for axis in (panel.xaxis, panel.yaxis):
        axis.label.set_fontsize(SMALL)
        axis.labelpad = 0.0
    panel.tick_params(pad=1.5, labelsize=SMALL)
    panel.tick_params(axis="x", pad=5.5)  # below the text of a tick of the other axis in the corner
    indicated = axes.indicate_inset_zoom(panel, edgecolor=BLACK, linewidth=0.7, alpha=1.0, zorder=2.9)
    indicated.rectangle.set_gid(f"{name}-frame")
    lines = [line for line in indicated.connectors or () if line.get_visible()]
    for part in (indicated.rectangle, *lines):
        on_screen = part.get_transform().transform_path(part.get_path()).vertices
        room.take_path(axes.transData.inverted().transform(on_screen))
    for line in lines:
        line.set(linewidth=0.4, edgecolor=GREY)
    room.take(place.box)
    return panel


def _symbol(label: str) -> str:
    """The symbol at the end of the label of an axis, which has less room in an inset."""
    return label[label.index("$") + 1 : -1]
