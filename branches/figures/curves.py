"""Drawing of family curves with their stability and special points, and of insets that enlarge a part of a figure."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures.room import Room, even_points, thinned
from branches.figures.style import BLACK, BLUE, EVENT_LOOKS, GREY, VERMILION, limits_of
from bvp.texts import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

__all__ = [
    "FREQUENCIES", "HOLLOW", "Inset", "MANY_FOLD", "PARTS", "curve_runs", "draw_curve", "draw_events", "draw_inset", "frequency_rows",
    "inset_ranges", "legend_entries", "parse_inset", "smooth",
]  # fmt: skip

FREQUENCIES = {"index": ("frequency index", r"m\,2\pi/T"), "fundamental": ("frequency", r"2\pi/T")}
"""Text and symbol of the axis, by what a frequency-energy plot shows."""

HOLLOW = "#FFFFFF"
"""Face of the markers of subcritical events."""

MANY_FOLD = 20.0
"""Frequencies that rise by more than this get a logarithmic axis: the low ones would be one line."""

_LINES: dict[int, dict[str, Any]] = {
    1: {"label": "stable", "color": BLUE, "linewidth": 1.5, "linestyle": "-"},
    0: {"label": "unstable", "color": VERMILION, "linewidth": 0.6, "linestyle": "-"},
    -1: {"label": "undecided", "color": GREY, "linewidth": 1.0, "linestyle": ":"},
}
_DOTS = {1: ("o", 2.5), 0: ("x", 3.2), -1: (".", 2.5)}
_CROSS: dict[str, Any] = {"marker": "x", "markersize": 3.2, "markeredgewidth": 0.7}
_CROSS_SPACING = 9.0  # points (1/72 inch)
_BELOW = {"EP": 3.9, "LB": 3.92, "RT": 3.94}  # common types are drawn below the others
_SMALL = 0.25  # part of the axes that the frame of an inset covers
_BESIDE = 5.0  # points from the corner of a frame to its letter
PARTS = 16
"""Pieces of a smooth curve between two points."""


def frequency_rows(frequency: str, half_waves: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The curve of a family in a frequency-energy plot. That of the index m 2 pi/T is broken where m changes.

    Parameters
    ----------
    frequency : "index" or "fundamental"
    half_waves, values : (N,) m and 2 pi/T at the points of the family

    Returns
    -------
    rows : (k,) int
        The point at each row of the curve. They do not fall. Each piece begins with the last point of the piece before it.
    values : (k,) float
        The frequency; NaN in a row between two pieces.

    Raises
    ------
    ValueError
        For another frequency.
    """
    if frequency not in FREQUENCIES:
        raise ValueError(f"unknown frequency {shown(frequency)}: expected {' or '.join(FREQUENCIES)}")
    own = rows = np.arange(len(values))
    if frequency == "fundamental":
        return rows, values
    at = np.flatnonzero(np.diff(half_waves))
    rows, own = np.insert(rows, np.repeat(at + 1, 2), np.repeat(at, 2)), np.insert(own, np.repeat(at + 1, 2), np.repeat(at + 1, 2))
    index = half_waves[own] * values[rows]
    index[at + 1 + 2 * np.arange(len(at))] = np.nan
    return rows, index


def smooth(points: np.ndarray, arclength: np.ndarray) -> np.ndarray:
    """A curve with `PARTS` - 1 places between its points, on a cubic of the arclength that passes through every point and stays between
    neighbours (Fritsch & Carlson, SIAM J. Numer. Anal. 17 (1980) 238), so it has no bend that the points do not have.

    Parameters
    ----------
    points : (N, 2) x, which is positive and interpolated by its logarithm, and y; rows that are not finite break the curve
    arclength : (N,) not falling; the curve is broken where it does not rise

    Returns
    -------
    (PARTS (N - 1) + 1, 2) array
        NaN where the curve is broken.
    """
    from scipy.interpolate import PchipInterpolator

    finite = np.isfinite(points).all(axis=1)
    joined = finite[:-1] & finite[1:] & (np.diff(arclength) > 0.0)
    out = np.full((PARTS * (len(points) - 1) + 1, 2), np.nan)
    for piece in np.split(np.arange(len(points)), np.flatnonzero(~joined) + 1):
        if len(piece) > 1:
            first, last = piece[0], piece[-1]
            places = np.interp(np.arange(PARTS * first, PARTS * last + 1) / PARTS, piece, arclength[piece])
            columns = np.stack([np.log(points[piece, 0]), points[piece, 1]], axis=1)
            x, y = PchipInterpolator(arclength[piece], columns)(places).T
            out[PARTS * first : PARTS * last + 1] = np.stack([np.exp(x), y], axis=1)
    out[::PARTS] = points
    return out


def curve_runs(points: np.ndarray, stable: np.ndarray) -> dict[int, np.ndarray]:
    """Split a curve by stability.

    Parameters
    ----------
    points : (N, 2) the curve, or with further places from `smooth`; rows that are not finite break it
    stable : (N,) 1 stable, 0 unstable, -1 undecided

    Returns
    -------
    dict of code to (k, 2) polylines, joined by rows of NaN
        A piece is stable only where both its ends are; a single undecided point between decided ones (an event, where the
        multiplier sits on the limit) takes the side of each neighbour. A point joined to nothing is a run of its own.
    """
    stable = np.asarray(stable).astype(int)
    parts = PARTS if len(points) > len(stable) else 1
    padded = np.concatenate([[0], stable, [0]])
    lone = (stable == -1) & (padded[:-2] != -1) & (padded[2:] != -1)
    a, b = stable[:-1], stable[1:]
    mixed = np.where((a == -1) | (b == -1), -1, 0)
    kinds = np.repeat(np.where(a == b, a, np.where(lone[:-1], b, np.where(lone[1:], a, mixed))), parts)
    finite = np.isfinite(points).all(axis=1)
    joined = finite[:-1] & finite[1:]
    alone = finite & ~np.append(joined, False) & ~np.insert(joined, 0, False)
    runs: dict[int, np.ndarray] = {}
    for code in _LINES:
        mine = joined & (kinds == code)
        there = np.append(mine, False) | np.insert(mine, 0, False) | (alone & (np.repeat(stable, parts)[: len(points)] == code))
        run = np.insert(np.where(there[:, None], points, np.nan), np.flatnonzero(~mine) + 1, np.nan, axis=0)
        there = np.isfinite(run[:, 0])
        if there.any():
            run = run[there | np.insert(there[:-1], 0, False)]  # one row of NaN between two pieces
            runs[code] = run[: np.flatnonzero(np.isfinite(run[:, 0]))[-1] + 1]
    return runs


def draw_curve(axes: Axes, runs: Mapping[int, np.ndarray], panel: str, fine: float = 1.0) -> None:
    """Draw runs from `curve_runs`: stable solid, unstable thin with crosses, undecided dotted grey.

    `fine` below 1 draws thinner, for many curves in one figure."""
    to_points = 72 / axes.figure.dpi
    for code, run in runs.items():
        look = {**_LINES[code], "linewidth": fine * _LINES[code]["linewidth"]}
        name = look.pop("label")
        axes.plot(run[:, 0], run[:, 1], zorder=2 + (code == 1) * 0.1, gid=f"{panel}-{name}", **look)
        there = np.isfinite(run[:, 0])
        single = run[there & ~np.append(there[1:], False) & ~np.insert(there[:-1], 0, False)]
        if len(single):
            marker, size = _DOTS[code]
            axes.plot(*single.T, marker, markersize=fine * size, color=look["color"], zorder=2.5, gid=f"{panel}-{name}-single")
        if code == 0:
            even = even_points(axes.transData.transform(run) * to_points, _CROSS_SPACING)
            even = even[thinned(even, 0.6 * _CROSS_SPACING)]
            crosses = axes.transData.inverted().transform(even / to_points)
            cross = {**_CROSS, "markersize": fine * _CROSS["markersize"], "markeredgewidth": fine * _CROSS["markeredgewidth"]}
            axes.plot(*crosses.T, linestyle="none", color=VERMILION, zorder=2.4, gid=f"{panel}-unstable-crosses", **cross)


def draw_events(axes: Axes, kinds: Sequence[str], places: np.ndarray, panel: str, hollow: Sequence[bool] = (), **look: Any) -> None:
    """Draw a marker at the place (E, 2) of each event in data coordinates, with one line object for each type, and one for its hollow
    markers: those of subcritical events. `look` changes the usual markers."""
    empty = np.array(hollow, dtype=bool) if len(hollow) else np.zeros(len(kinds), dtype=bool)
    for kind in dict.fromkeys(kinds):
        for some, more in ((~empty, {}), (empty, {"markerfacecolor": HOLLOW, "zorder": 4.1})):
            there = some & np.array([k == kind for k in kinds])
            if there.any():
                gid = f"{panel}{'-hollow' * bool(more)}-events-{kind}"
                axes.plot(*places[there].T, gid=gid, **{"zorder": _BELOW.get(kind, 4.0), **EVENT_LOOKS[kind], **more, **look})


def legend_entries(codes: Collection[int], kinds: Collection[str], hollow: bool = False) -> list[Line2D]:
    """Legend entries for the stabilities with these codes, for types of events, in the order of `EVENT_LOOKS`, and for hollow markers."""
    from matplotlib.lines import Line2D

    looks = [{**_LINES[code], **(_CROSS if code == 0 else {})} for code in _LINES if code in codes]
    looks += [look for kind, look in EVENT_LOOKS.items() if kind in kinds]
    if hollow:
        looks.append({**EVENT_LOOKS["SB"], "markerfacecolor": HOLLOW, "marker": "h", "label": "hollow: subcritical"})
    return [Line2D([], [], **look) for look in looks]


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


def inset_ranges(inset: Inset, curves: Sequence[np.ndarray], *, log: bool) -> tuple[tuple[float, float], tuple[float, float]]:
    """The energies and frequencies that an inset shows of some curves (n, 2); `log` for a logarithmic axis of frequencies.

    Raises
    ------
    ValueError
        If no curve has a point there.
    """
    points = np.concatenate(curves)
    (left, right), (low, high) = inset.energy, inset.frequency or (-math.inf, math.inf)
    heights = points[(points[:, 0] >= left) & (points[:, 0] <= right) & (points[:, 1] >= low) & (points[:, 1] <= high), 1]
    if not len(heights):
        raise ValueError(f"{inset}: no family has a point there")
    return inset.energy, inset.frequency or limits_of(heights, log=log)


def draw_inset(room: Room, panel: Axes, letter: str) -> bool:
    """Draw a frame around what an inset shows of the axes of a room, with its letter; names keep off both, and off a small frame's inside.
    Return whether the frame is small: what lies in it is named in the inset."""
    (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
    frame = room.axes.indicate_inset((left, low, right - left, high - low), edgecolor=BLACK, linewidth=0.7, alpha=1.0, zorder=2.9)
    frame.rectangle.set_gid(f"{panel.get_label()}-frame")
    corners = room.to_page(np.array([(left, low), (left, high), (right, high), (right, low), (left, low)]))
    room.take_path(corners)
    size = np.ptp(corners, axis=0)
    small = bool(np.prod(size) < _SMALL * np.prod(room.frame[2:] - room.frame[:2]))
    if small:
        room.take(corners[[0, 2]].mean(axis=0, keepdims=True), size / 2)
    room.write([f"({letter})"], corners[1:2], beside=_BESIDE, over_curves=True)
    return small
