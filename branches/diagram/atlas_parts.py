"""What the pictures of many families are put together from: lines by stability, linear modes, impulsive motions, regimes, legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.diagram.atlas_labels import Named
from branches.diagram.marks import curve_runs
from branches.diagram.scales import linear_axis, linear_limits, logarithmic_axis, logarithmic_limits
from branches.diagram.style import BLACK, GREEN, NORMAL, ORANGE, SMALL, YELLOW
from branches.diagram.titles import system_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.legend import Legend

    from branches.diagram.atlas_data import Atlas, Curve

Box = tuple[float, float, float, float]

FINE = 0.6
"""Lines and crosses of many families, beside those of one."""
_MANY_FOLD = 20.0  # frequencies that rise by more than this get a logarithmic axis
_MANIFOLD: dict[str, Any] = {"color": GREEN, "marker": ".", "markersize": 1.8, "markeredgewidth": 0.0, "linewidth": 0.35}
_MODE: dict[str, Any] = {"color": BLACK, "linewidth": 0.9, "linestyle": "-"}
_BULLET: dict[str, Any] = {"color": BLACK, "marker": "o", "markersize": 4.5, "linestyle": "none"}
STAR: dict[str, Any] = {
    "marker": "*", "markersize": 5.5, "markerfacecolor": YELLOW, "markeredgecolor": BLACK, "markeredgewidth": 0.4, "linestyle": "none",
}  # fmt: skip
_BOUND: dict[str, Any] = {"color": ORANGE, "linewidth": 0.8, "linestyle": (0, (5, 2.5))}


def runs_of(curves: Sequence[Named]) -> dict[int, np.ndarray]:
    """The polylines of all curves by stability, as `branches.diagram.marks.curve_runs` gives them for one."""
    pieces: dict[int, list[np.ndarray]] = {}
    gap = np.full((1, 2), np.nan)
    for curve in curves:
        if curve.curve is None:
            continue
        for code, run in curve_runs(curve.curve.stable, curve.x, curve.y, curve.breaks).items():
            pieces.setdefault(code, []).extend([run, gap])
    return {code: np.concatenate(parts[:-1]) for code, parts in sorted(pieces.items(), reverse=True)}


def refuse_empty(energies: Sequence[np.ndarray]) -> None:
    found = np.concatenate(energies) if energies else np.zeros(0)
    if not len(found):
        raise ValueError("there is nothing to draw: no family, no impulsive orbit has a point in the range asked for")
    if not found.min() > 0.0:
        raise ValueError(f"the logarithmic energy axis needs positive energies: the lowest is {found.min():.6g}")


def title(atlas: Atlas, what: str) -> str:
    text = f"{what}   ({system_text(atlas.system)}"
    if atlas.clearance != 1.0:
        text += f", clearance {atlas.clearance:.6g}"
    if atlas.natural_frequency != 1.0:
        text += f", natural frequency {atlas.natural_frequency:.6g} rad/s"
    return text + ")"


def energy_axis(axes: Axes, atlas: Atlas, limits: tuple[float, float]) -> None:
    logarithmic_axis(axes, "x", limits, 14, "energy", "h" if atlas.energy_unit == 1.0 else r"\hat{H}")


def frequency_curve(curve: Curve, frequency: str) -> Named:
    """The curve of a family over its frequency, "index" or "fundamental"; the former is broken where m changes."""
    if frequency == "fundamental":
        return Named(curve, curve.h, curve.frequency, np.zeros(max(len(curve.h) - 1, 0), dtype=bool))
    curve = _with_both_ends(curve)
    return Named(curve, curve.h, curve.frequency_index, np.diff(curve.half_waves) != 0)


def _with_both_ends(curve: Curve) -> Curve:
    """The curve where each piece of one m begins with the last point of the piece before it, so that no piece is a point alone; a first
    piece of one point ends with the point behind it."""
    pieces = np.split(np.arange(len(curve.h)), np.flatnonzero(np.diff(curve.half_waves)) + 1)
    if len(pieces) == 1:
        return curve
    shown = [np.insert(piece, 0, piece[0] - 1) if k else piece for k, piece in enumerate(pieces)]
    if len(pieces[0]) == 1:
        shown[0] = np.array([0, 1])
    point = np.concatenate(shown)
    of_piece = np.concatenate([np.clip(some, piece[0], piece[-1]) for some, piece in zip(shown, pieces, strict=True)])
    own = point == of_piece
    turned = curve.half_waves[of_piece] * curve.frequency[point]
    return replace(
        curve,
        **{name: getattr(curve, name)[point] for name in ("h", "alpha", "frequency", "stable", "velocities")},
        **{name: getattr(curve, name)[of_piece] for name in ("names", "pinned", "labels", "half_waves")},
        frequency_index=np.where(own, curve.frequency_index[point], turned),
        events=np.where(own, curve.events[point], ""),
    )


def frequency_axis(axes: Axes, atlas: Atlas, frequency: str, shown: np.ndarray) -> None:
    """Give the y axis frequencies, "index" or "fundamental", around the finite ones that are shown (any shape)."""
    symbol = r"2\pi/T" if frequency == "fundamental" else r"m\,2\pi/T"
    words = "frequency" if frequency == "fundamental" else "frequency index"
    if atlas.natural_frequency != 1.0:
        words += " (rad/s)"
    wide = shown[np.isfinite(shown)]
    if wide.max() > _MANY_FOLD * wide.min() > 0:
        logarithmic_axis(axes, "y", logarithmic_limits(wide, 0.04), 6, words, symbol)
    else:
        linear_axis(axes, "y", linear_limits(wide, 0.04), 7, words, symbol)


def draw_modes(axes: Axes, modes: Sequence[Any], name: str) -> None:
    left = axes.get_xlim()[0]
    for mode in modes:
        if mode.h > left:
            (line,) = axes.plot([left, mode.h], [mode.frequency] * 2, zorder=2.2, **_MODE)
            line.set_gid(f"{name}-{mode.label}")
            (bullet,) = axes.plot([mode.h], [mode.frequency], zorder=4.2, **_BULLET)
            bullet.set_gid(f"{name}-{mode.label}-grazing")


def draw_manifold(axes: Axes, atlas: Atlas, name: str) -> None:
    if not len(atlas.manifold_h):
        return
    cut = np.flatnonzero(~atlas.manifold_joined) + 1
    x, y = np.insert(atlas.manifold_h, cut, np.nan), np.insert(atlas.manifold_frequency, cut, np.nan)
    (dots,) = axes.plot(x, y, zorder=3.5, **_MANIFOLD)
    dots.set_gid(f"{name}-manifold")


def manifold_paths(atlas: Atlas, k: int) -> list[np.ndarray]:
    """The start velocity of one coordinate of the impulsive motions against energy (N, 2), and of their mirror images, which families can
    start with, too."""
    if not len(atlas.manifold_h):
        return []
    path = np.stack([atlas.manifold_h, atlas.manifold_velocities[:, k]], axis=1)
    return [path, path * (1.0, -1.0)] if atlas.system.has_odd_symmetry and path[:, 1].any() else [path]


def draw_manifold_velocity(axes: Axes, atlas: Atlas, k: int, name: str) -> None:
    gap = np.full((1, 2), np.nan)
    parts = [part for path in manifold_paths(atlas, k) for part in (path, gap)][:-1]
    if parts:
        (dots,) = axes.plot(*np.concatenate(parts).T, zorder=3.5, **_MANIFOLD)
        dots.set_gid(f"{name}-manifold")


def _regimes(axes: Axes, atlas: Atlas) -> list[tuple[str, float]]:
    """The numerals of the regimes in sight, and the energies in their middles."""
    if not atlas.bounds:
        return []
    low, high = axes.get_xlim()
    edges = [low, *(bound.h for bound in atlas.bounds), high]
    names = [atlas.bounds[0].below, *(bound.above for bound in atlas.bounds)]
    spans = zip(names, edges, edges[1:], strict=False)
    return [(name, math.sqrt(left * right)) for name, left, right in spans if low <= left < right <= high]


def draw_bounds(axes: Axes, atlas: Atlas) -> None:
    """The vertical lines, and the regimes' numerals under the upper edge of the frame."""
    for bound in atlas.bounds:
        line = axes.axvline(bound.h, zorder=1.5, **_BOUND)
        line.set_gid(f"bound-{bound.below}-{bound.above}")
    for name, middle in _regimes(axes, atlas):
        style: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": "top", "fontsize": NORMAL + 1.0, "zorder": 6}
        axes.annotate(name, (middle, 1.0), (0, -4), xycoords=("data", "axes fraction"), **style)


def bound_paths(axes: Axes, atlas: Atlas) -> list[np.ndarray]:
    """The vertical lines (2, 2)."""
    low, high = axes.get_ylim()
    return [np.array([[bound.h, low], [bound.h, high]]) for bound in atlas.bounds]


def bound_boxes(axes: Axes, atlas: Atlas) -> list[Box]:
    """Boxes in points of the regimes' numerals."""
    to_points = 72 / axes.figure.dpi
    top = float(axes.bbox.y1) * to_points
    places = [float(axes.transData.transform((middle, axes.get_ylim()[0]))[0]) * to_points for _, middle in _regimes(axes, atlas)]
    return [(x - 9.0, top - 16.0, x + 9.0, top) for x in places]


def other_entries(atlas: Atlas, modes: Sequence[Any], stars: bool) -> list[Any]:
    from matplotlib.lines import Line2D

    entries = []
    if modes:
        entries.append(Line2D([], [], label="linear modes, to where they graze", **{**_MODE, "marker": "o", "markersize": 5.0}))
    if len(atlas.manifold_h):
        entries += manifold_entry(f"impulsive motions ({atlas.manifold_window} window, {atlas.manifold_periods} periods)")
    if stars:
        entries += star_entry()
    if atlas.bounds:
        text = "regimes (bounds are ours, not the paper's):\n" + "\n".join(f"{b.below}/{b.above}: {b.what}" for b in atlas.bounds)
        entries.append(Line2D([], [], label=text, **_BOUND))
    return entries


def manifold_entry(text: str) -> list[Any]:
    from matplotlib.lines import Line2D

    return [Line2D([], [], label=text, **{**_MANIFOLD, "markersize": 3.5})]


def star_entry() -> list[Any]:
    from matplotlib.lines import Line2D

    return [Line2D([], [], label="periodic impulsive orbits", **STAR)]


NOTE: dict[str, Any] = {"title": " ", "title_fontsize": SMALL}
"""Options of the legend that keep the room of its note free, which is known when the names are placed."""


def note_named(legend: Legend, axes: Sequence[Axes], written: set[str], curves: Sequence[Named], note: str = "") -> None:
    """Say above the legend how many of the families have their name in the picture, and what a short id is."""
    keys = {curve.key for curve in curves}
    what = "families" if curves and curves[0].curve is not None else "orbits"
    if any("#" in text.get_text() for panel in axes for text in panel.texts):
        note += "; # and the first digits of the hash in an id: families without a label, or with the label of another one"
    legend.set_title(f"{len(written & keys)} of {len(keys)} {what} named{note}" if keys else "")


def mark_boxes(axes: Axes, modes: Sequence[Any], stars: tuple[np.ndarray, np.ndarray] | None) -> list[Box]:
    """Boxes in points of the bullets and stars."""
    to_points = 72 / axes.figure.dpi
    spots = [(mode.h, mode.frequency, 3.0) for mode in modes]
    if stars is not None:
        spots += [(float(x), float(y), 3.0) for x, y in zip(*stars, strict=True)]
    boxes = []
    for x, y, radius in spots:
        left, bottom = axes.transData.transform((x, y)) * to_points
        boxes.append((left - radius, bottom - radius, left + radius, bottom + radius))
    return boxes
