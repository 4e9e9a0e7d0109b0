"""Figures of many families: the frequency-energy plot, and the start velocities against energy."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.figures.atlas_data import EVENTS
from branches.figures.curves import (
    Inset,
    curve_runs,
    draw_curve,
    draw_events_with_room,
    draw_inset,
    legend_entries,
    place_insets,
    visible_codes,
)
from branches.figures.room import Named, Room, names_of, write_names
from branches.figures.style import (
    BLACK,
    GREEN,
    NORMAL,
    ORANGE,
    SMALL,
    YELLOW,
    figure_settings,
    legend_below,
    limits_of,
    new_figure,
    set_axis,
    settle_layout,
    symbol_of,
    system_text,
    write_figure,
)
from bvp.texts import shown as in_message
from bvp.texts import takes_options_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

    from branches.figures.atlas_data import Atlas, AtlasCurve

__all__ = [
    "MOST_NAMES", "atlas_figure", "draw_atlas", "draw_modes", "frequency_curve", "mode_names", "runs_of",
    "velocities_figure",
]  # fmt: skip

FREQUENCIES = ("index", "fundamental")
MOST_NAMES, MOST_VELOCITY_NAMES = 60, 30
"""Largest number of families named in the frequency-energy plot, and in a panel of start velocities."""

_INSET_NAMES, _INSET_FAR = 12, 26.0
_COLUMNS = 4  # of the legend, at most
_FINE = 0.6  # size of lines and crosses in a figure of many families, relative to a figure of one
_MANY_FOLD = 20.0  # frequencies that rise by more than this get a logarithmic axis
_RADIUS = 3.0  # of bullets and stars, in points
_MANIFOLD: dict[str, Any] = {"color": GREEN, "marker": ".", "markersize": 1.8, "markeredgewidth": 0.0, "linewidth": 0.35}
_MODE: dict[str, Any] = {"color": BLACK, "linewidth": 0.9, "linestyle": "-"}
_BULLET: dict[str, Any] = {"color": BLACK, "marker": "o", "markersize": 4.5, "linestyle": "none"}
_STAR: dict[str, Any] = {
    "marker": "*", "markersize": 5.5, "markerfacecolor": YELLOW, "markeredgecolor": BLACK, "markeredgewidth": 0.4, "linestyle": "none",
}  # fmt: skip
_BOUND: dict[str, Any] = {"color": ORANGE, "linewidth": 0.8, "linestyle": (0, (5, 2.5))}


def atlas_figure(atlas: Atlas, *, frequency: str = "index", insets: Sequence[Inset] = (), names: int = MOST_NAMES) -> Figure:
    """The frequency-energy plot.

    Parameters
    ----------
    atlas : Atlas
    frequency : "index" (m 2 pi/T, curves are broken where m changes) or "fundamental" (2 pi/T)
    insets : sequence of Inset
        Parts of the plane shown larger: within the axes where they cover no curve, else beside them.
    names : int
        Most families named.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        For another frequency, nothing to draw, or an inset outside the figure.
    """
    if frequency not in FREQUENCIES:
        raise ValueError(f"unknown frequency {in_message(frequency)}: expected index or fundamental")
    curves = [frequency_curve(curve, frequency) for curve in atlas.curves]
    manifold = np.stack([atlas.manifold_h, atlas.manifold_frequency], axis=1)
    stars = _stars(atlas, "frequency" if frequency == "fundamental" else "frequency_index")
    points = np.concatenate([*(np.stack([curve.x, curve.y], axis=1) for curve in curves), manifold, stars])
    _require_energies(points[:, 0])
    modes = atlas.thresholds
    x_limits = limits_of(np.append(points[:, 0], [mode.h for mode in modes if mode.h < points[:, 0].max()]), 0.04, log=True)
    frequencies = np.append(points[:, 1], [mode.frequency for mode in modes if mode.h > x_limits[0]])
    with figure_settings():
        figure = new_figure(5.6)
        figure.suptitle(_title(atlas, "Families of periodic orbits" if curves else "Impulsive motions"))
        axes = figure.subplots()
        axes.set_label("frequency")
        _energy_axis(axes, atlas, x_limits)
        _frequency_axis(axes, atlas, frequency, frequencies)
        runs = runs_of(curves)
        codes, others = visible_codes([(axes, runs)]), _other_entries(atlas, modes, len(stars) > 0)
        # The room for markers is known when the panels have their places: the layout leaves space for all types.
        _legend(figure, codes, _event_types(curves), others)
        settle_layout(figure)
        of_modes = mode_names(axes, modes)
        everything = [*(curve.path() for curve in (*curves, *of_modes)), manifold]
        bullets = np.array([[mode.h, mode.frequency] for mode in modes]).reshape(-1, 2)

        def room_of(panel: Axes) -> Room:
            bounds = [np.array([[bound.h] * 2, axes.get_ylim()]).T for bound in atlas.bounds] if panel is axes else []
            room = Room(panel, [*everything, *bounds])
            room.take_around(np.concatenate([bullets, stars]), _RADIUS)
            if panel is axes:
                room.take(_numeral_boxes(room, atlas))
            return room

        def content(panel: Axes, name: str) -> None:
            draw_curve(panel, runs, name, _FINE)
            draw_modes(panel, modes, name)
            _draw_manifold(panel, manifold, atlas.manifold_joined, name)
            _draw_stars(panel, stars, name)

        places = place_insets(axes, insets, everything, lambda: room_of(axes))
        content(axes, "frequency")
        _draw_bounds(axes, atlas)
        room = room_of(axes)
        panels = [draw_inset(room, place, f"inset-{'abcdefghijklmnopqrstuvwxyz'[k % 26]}") for k, place in enumerate(places)]
        _draw_events(room, curves)
        named = names_of(curves) if curves else _star_names(atlas, stars)
        known = {name.key for name in named}
        written = write_names(room, named, most=names, always=of_modes, radius=0.0 if curves else _RADIUS)
        for panel in panels:
            content(panel, str(panel.get_label()))
            inside = room_of(panel)
            _draw_events(inside, curves)
            local = names_of(curves, inside)
            new = [name for name in local if name.key not in written][max(0, names - len(written & known)) :]
            local = [name for name in local if name not in new]
            written |= write_names(inside, local, most=_INSET_NAMES, far=_INSET_FAR, over_curves=False)
        legend = _legend(figure, codes, _drawn_types([axes, *panels]), others)
        _note_named(legend, [axes, *panels], written, curves or named)
    return figure


@takes_options_of(atlas_figure)
def draw_atlas(atlas: Atlas, path_or_file: str | os.PathLike[str] | IO[bytes], *, format: str | None = None, **options: Any) -> None:
    """Write the frequency-energy plot of many families to a png, pdf or svg file.

    Parameters
    ----------
    atlas : Atlas
    path_or_file : path, or binary file open for writing
    format : "png", "pdf" or "svg"; by default what the file's name ends with
    **options
        As for `atlas_figure`.
    """
    write_figure(atlas_figure, path_or_file, atlas, format=format, **options)


def velocities_figure(atlas: Atlas, *, names: int = MOST_VELOCITY_NAMES) -> Figure:
    """The start velocities of absorber and primary, at zero displacement, against energy. In impulsive motions only the primary moves.

    Parameters
    ----------
    atlas : Atlas
    names : int
        Most families named in each panel.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If no family starts at zero displacement.
    """
    system = atlas.system
    chosen = [k for k in (system.absorber, system.primary) if k is not None] or list(range(min(2, len(system.coordinates))))
    curves = [curve for curve in atlas.curves if np.isfinite(curve.velocities).any()]
    energies = np.concatenate([*(curve.h for curve in curves), atlas.manifold_h, [] if atlas.impulsive is None else atlas.impulsive.h])
    if atlas.curves and not len(energies):
        raise ValueError("there is nothing to draw: velocities are those at zero displacement, where no orbit of these families starts")
    _require_energies(energies)
    left_out = len({curve.family for curve in atlas.curves}) - len({curve.family for curve in curves})
    with figure_settings():
        figure = new_figure(7.2)
        figure.suptitle(_title(atlas, "Families of periodic orbits"))
        panels = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        drawn = []
        for axes, k in zip(panels, chosen, strict=True):
            named = [Named(curve, curve.h, curve.velocities[:, k]) for curve in curves]
            manifold, stars = _manifold_velocity(atlas, k), _stars(atlas, "velocities", k)
            axes.set_label(f"velocity{k}")
            _energy_axis(axes, atlas, limits_of(energies, 0.04, log=True))
            values = np.concatenate([*(curve.y for curve in named), manifold[:, 1], stars[:, 1]])
            symbol = f"{symbol_of(system.coordinates[k], velocity=True)}(0)"
            set_axis(axes, "y", limits_of(values, 0.05), 6, "start velocity", symbol)
            drawn.append((axes, named, runs_of(named), manifold, stars))
        for axes in panels[:-1]:
            axes.set_xlabel("")
        codes = visible_codes((axes, runs) for axes, _, runs, _, _ in drawn)
        others = [_entry("impulsive motions", _MANIFOLD, markersize=3.5)] if len(atlas.manifold_h) else []
        others += [_entry("periodic impulsive orbits", _STAR)] if atlas.impulsive is not None else []
        # The room for markers is known when the panels have their places: the layout leaves space for all types.
        _legend(figure, codes, _event_types(drawn[0][1]), others)
        settle_layout(figure)
        written: set[str] = set()
        for axes, named, runs, manifold, stars in drawn:
            name = str(axes.get_label())
            draw_curve(axes, runs, name, _FINE)
            _draw_manifold(axes, manifold, np.ones(len(manifold), dtype=bool), name)
            _draw_stars(axes, stars, name)
            room = Room(axes, [*(curve.path() for curve in named), manifold])
            room.take_around(stars, _RADIUS)
            _draw_events(room, named)
            written |= write_names(room, names_of(named), most=names)
        legend = _legend(figure, codes, _drawn_types(panels), others)
        note = f"; {left_out} that do not start at the origin left out" if left_out else ""
        _note_named(legend, panels, written, drawn[0][1], note)
    return figure


def _require_energies(found: np.ndarray) -> None:
    if not len(found):
        raise ValueError("there is nothing to draw: no family, no impulsive orbit has a point in the range asked for")
    if not found.min() > 0.0:
        raise ValueError(f"the logarithmic energy axis needs positive energies: the lowest is {found.min():.6g}")


def _title(atlas: Atlas, what: str) -> str:
    text = f"{what}   ({system_text(atlas.system)}"
    if atlas.clearance != 1.0:
        text += f", clearance {atlas.clearance:.6g}"
    if atlas.natural_frequency != 1.0:
        text += f", natural frequency {atlas.natural_frequency:.6g} rad/s"
    return text + ")"


def _energy_axis(axes: Axes, atlas: Atlas, limits: tuple[float, float]) -> None:
    set_axis(axes, "x", limits, 14, "energy", "h" if atlas.energy_unit == 1.0 else r"\hat{H}", log=True)


def _frequency_axis(axes: Axes, atlas: Atlas, frequency: str, values: np.ndarray) -> None:
    symbol = r"2\pi/T" if frequency == "fundamental" else r"m\,2\pi/T"
    name = "frequency" if frequency == "fundamental" else "frequency index"
    if atlas.natural_frequency != 1.0:
        name += " (rad/s)"
    log = bool(np.nanmax(values) > _MANY_FOLD * np.nanmin(values) > 0)
    set_axis(axes, "y", limits_of(values, 0.04, log=log), 7, name, symbol, log=log)


def frequency_curve(curve: AtlasCurve, frequency: str) -> Named:
    """The curve of a family over its frequency, "index" or "fundamental"; the former is broken where m changes."""
    if frequency == "fundamental":
        return Named(curve, curve.h, curve.frequency)
    curve = _with_both_ends(curve)
    return Named(curve, curve.h, curve.frequency_index, np.diff(curve.half_waves) != 0)


def _with_both_ends(curve: AtlasCurve) -> AtlasCurve:
    """The curve where each piece of one m begins with the last point of the piece before it, so that no piece is a point alone.

    A first piece of one point ends with the point behind it.
    """
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
        **{name: getattr(curve, name)[of_piece] for name in ("names", "cited", "labels", "half_waves")},
        frequency_index=np.where(own, curve.frequency_index[point], turned),
        events=np.where(own, curve.events[point], ""),
    )


def runs_of(curves: Sequence[Named]) -> dict[int, np.ndarray]:
    """The polylines of all curves by stability, as `curve_runs` gives them for one."""
    pieces: dict[int, list[np.ndarray]] = {}
    gap = np.full((1, 2), np.nan)
    for curve in curves:
        if curve.curve is not None:
            for code, run in curve_runs(curve.curve.stable, curve.x, curve.y, curve.breaks).items():
                pieces.setdefault(code, []).extend([run, gap])
    return {code: np.concatenate(parts[:-1]) for code, parts in sorted(pieces.items(), reverse=True)}


def draw_modes(axes: Axes, modes: Sequence[Any], name: str) -> None:
    """Draw the linear modes up to the energies at which they graze."""
    left = axes.get_xlim()[0]
    for mode in modes:
        if mode.h > left:
            axes.plot([left, mode.h], [mode.frequency] * 2, zorder=2.2, gid=f"{name}-{mode.label}", **_MODE)
            axes.plot([mode.h], [mode.frequency], zorder=4.2, gid=f"{name}-{mode.label}-grazing", **_BULLET)


def mode_names(axes: Axes, modes: Sequence[Any]) -> list[Named]:
    """The names of the linear modes in view, which may belong to any place of their lines."""
    left = axes.get_xlim()[0]
    lines = [(mode, np.geomspace(left, mode.h, 20)) for mode in modes if mode.h > left]
    return [Named(None, energies, np.full(20, mode.frequency), text=mode.label) for mode, energies in lines]


def _draw_manifold(axes: Axes, points: np.ndarray, joined: np.ndarray, name: str) -> None:
    """Draw the impulsive motions: points (N, 2), each with whether it is joined to the next."""
    if len(points):
        x, y = np.insert(points, np.flatnonzero(~joined) + 1, np.nan, axis=0).T
        axes.plot(x, y, zorder=3.5, gid=f"{name}-manifold", **_MANIFOLD)


def _manifold_velocity(atlas: Atlas, k: int) -> np.ndarray:
    """The start velocity of coordinate k of the impulsive motions against energy (N, 2).

    The mirror images, which families can start with too, follow after a row of NaN.
    """
    path = np.stack([atlas.manifold_h, atlas.manifold_velocities[:, k]], axis=1)
    if not (atlas.system.has_odd_symmetry and path[:, 1].any()):
        return path
    return np.concatenate([path, np.full((1, 2), np.nan), path * (1.0, -1.0)])


def _stars(atlas: Atlas, column: str, k: int | None = None) -> np.ndarray:
    """The periodic impulsive orbits (N, 2): energy, and a column or part k of it."""
    if atlas.impulsive is None:
        return np.zeros((0, 2))
    values = getattr(atlas.impulsive, column)
    return np.stack([atlas.impulsive.h, values if k is None else values[:, k]], axis=1)


def _draw_stars(axes: Axes, stars: np.ndarray, name: str) -> None:
    if len(stars):
        axes.plot(*stars.T, zorder=4, gid=f"{name}-impulsive", **_STAR)


def _star_names(atlas: Atlas, stars: np.ndarray) -> list[Named]:
    """The names of the periodic impulsive orbits, for a figure without families."""
    if atlas.impulsive is None:
        return []
    labels = atlas.impulsive.labels.tolist()
    out = [Named(None, stars[k : k + 1, 0], stars[k : k + 1, 1], text=label) for k, label in enumerate(labels) if label]
    for name in out:
        name.short_id = f"at {name.x[0]:.3g}" if labels.count(name.text) > 1 else ""
    return out


def _draw_events(room: Room, curves: Sequence[Named]) -> None:
    """Draw the special points that have room, important families first. Within a family the order is that of `EVENTS`."""
    kinds: list[str] = []
    places = [np.empty((0, 2))]
    for curve in sorted((curve for curve in curves if curve.curve is not None), key=lambda curve: curve.importance):
        assert curve.curve is not None
        for kind in EVENTS:
            mine = (curve.curve.events == kind) & np.isfinite(curve.y)
            kinds += [kind] * int(mine.sum())
            places.append(np.stack([curve.x[mine], curve.y[mine]], axis=1))
    draw_events_with_room(room, kinds, np.concatenate(places), str(room.axes.get_label()))


def _event_types(curves: Sequence[Named]) -> list[str]:
    found = {kind for curve in curves if curve.curve is not None for kind in set(curve.curve.events.tolist())}
    return [kind for kind in EVENTS if kind in found]


def _drawn_types(panels: Iterable[Axes]) -> list[str]:
    names = {str(line.get_gid()) for axes in panels for line in axes.lines}
    return [kind for kind in EVENTS if any(name.endswith(f"-events-{kind}") for name in names)]


def _regimes(axes: Axes, atlas: Atlas) -> list[tuple[str, float]]:
    """The numerals of the regimes in view, and the energies in their middles."""
    if not atlas.bounds:
        return []
    low, high = axes.get_xlim()
    edges = [low, *(bound.h for bound in atlas.bounds), high]
    names = [atlas.bounds[0].below, *(bound.above for bound in atlas.bounds)]
    spans = zip(names, edges, edges[1:], strict=False)
    return [(name, math.sqrt(left * right)) for name, left, right in spans if low <= left < right <= high]


def _draw_bounds(axes: Axes, atlas: Atlas) -> None:
    """Draw the vertical lines, and the regimes' numerals under the upper edge of the frame."""
    for bound in atlas.bounds:
        axes.axvline(bound.h, zorder=1.5, gid=f"bound-{bound.below}-{bound.above}", **_BOUND)
    for name, middle in _regimes(axes, atlas):
        style: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": "top", "fontsize": NORMAL + 1.0, "zorder": 6}
        axes.annotate(name, (middle, 1.0), (0, -4), xycoords=("data", "axes fraction"), **style)


def _numeral_boxes(room: Room, atlas: Atlas) -> np.ndarray:
    """The boxes (a, 4) of the regimes' numerals on the page."""
    bottom, top = room.axes.get_ylim()[0], room.frame[3]
    places = room.to_page(np.array([(middle, bottom) for _, middle in _regimes(room.axes, atlas)]).reshape(-1, 2))[:, 0]
    return np.array([(x - 9.0, top - 16.0, x + 9.0, top) for x in places])


def _entry(label: str, look: dict[str, Any], **more: Any) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **{**look, **more})


def _other_entries(atlas: Atlas, modes: Sequence[Any], stars: bool) -> list[Any]:
    entries = []
    if modes:
        entries.append(_entry("linear modes, to where they graze", _MODE, marker="o", markersize=5.0))
    if len(atlas.manifold_h):
        text = f"impulsive motions ({atlas.manifold_window} window, {atlas.manifold_periods} periods)"
        entries.append(_entry(text, _MANIFOLD, markersize=3.5))
    if stars:
        entries.append(_entry("periodic impulsive orbits", _STAR))
    if atlas.bounds:
        text = "regimes (bounds are ours, not the paper's):\n" + "\n".join(f"{b.below}/{b.above}: {b.what}" for b in atlas.bounds)
        entries.append(_entry(text, _BOUND))
    return entries


def _legend(figure: Figure, codes: set[int], kinds: Sequence[str], others: Sequence[Any]) -> Legend:
    # The title keeps space for the note of `_note_named`.
    return legend_below(figure, [*legend_entries(codes, kinds), *others], _COLUMNS, title=" ", title_fontsize=SMALL)


def _note_named(legend: Legend, axes: Iterable[Axes], written: set[str], curves: Sequence[Named], note: str = "") -> None:
    """Write above the legend how many families are named in the figure, and what a short id is."""
    keys = {curve.key for curve in curves}
    what = "families" if curves and curves[0].curve is not None else "orbits"
    if any("#" in text.get_text() for panel in axes for text in panel.texts):
        note += "; # and the first digits of the hash in an id: families without a label, or with the label of another one"
    legend.set_title(f"{len(written & keys)} of {len(keys)} {what} named{note}" if keys else "")
