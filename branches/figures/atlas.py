"""Figures of many families: the frequency-energy plot, and the start velocities against energy."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping, Sequence
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.figures import style
from branches.figures.atlas_data import EVENTS, Atlas, AtlasCurve, atlas_of
from branches.figures.curves import (
    FREQUENCIES,
    MANY_FOLD,
    Inset,
    curve_runs,
    draw_curve,
    draw_events,
    draw_inset,
    frequency_rows,
    inset_ranges,
    legend_entries,
)
from branches.figures.room import Named, Room, names_of, thinned, write_names
from branches.figures.single import energy_axes
from bvp.texts import takes_options_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

    from branches.catalogue import Catalogue

__all__ = [
    "MOST_NAMES", "atlas_figure", "draw_atlas", "draw_modes", "frequency_curve", "mode_names", "plot_catalogue", "runs_of",
    "velocities_figure",
]  # fmt: skip

MOST_NAMES, MOST_VELOCITY_NAMES = 60, 30
"""Largest number of families named in the frequency-energy plot, and in a panel of start velocities."""

_INSET_NAMES, _INSET_FAR = 12, 26.0
_INSET_WIDTH, _INSET_HEIGHT, _LARGER = 0.5, 1.8, 1.2  # of the plot's width, at least; in inches, at least; than what it shows
_COLUMNS = 4  # of the legend, at most
_FINE = 0.6  # size of lines and crosses in a figure of many families, relative to a figure of one
_SMALLER = 0.7  # markers of special points, likewise
_APART = 7.0  # points from the middle of a marker to the next
_ABOUT, _ALONE = 5.0, 2.6  # half the width of a marker's surroundings, and how many times that width of curves they may hold
_RADIUS = 3.0  # of bullets and stars, in points
_NOTHING = "there is nothing to draw: no family, no impulsive orbit has a point in the range asked for"
_MANIFOLD: dict[str, Any] = {"color": style.GREEN, "marker": ".", "markersize": 1.8, "markeredgewidth": 0.0, "linewidth": 0.35}
_MODE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": "-"}
_BULLET: dict[str, Any] = {"color": style.BLACK, "marker": "o", "markersize": 4.5, "linestyle": "none"}
_STARS_APART = 9.0  # points, least
_STARS = "periodic impulsive orbits (of those that\noverlap, the one with the shortest period)"
_STAR: dict[str, Any] = {
    "marker": "*", "markersize": 5.5, "markerfacecolor": style.YELLOW, "markeredgecolor": style.BLACK, "markeredgewidth": 0.4,
    "linestyle": "none",
}  # fmt: skip
_BOUND: dict[str, Any] = {"color": style.ORANGE, "linewidth": 0.8, "linestyle": (0, (5, 2.5))}


def atlas_figure(atlas: Atlas, *, frequency: str = "index", insets: Sequence[Inset] = (), names: int = MOST_NAMES) -> Figure:
    """The frequency-energy plot.

    Parameters
    ----------
    atlas : Atlas
    frequency : "index" (m 2 pi/T, curves are broken where m changes) or "fundamental" (2 pi/T)
    insets : sequence of Inset
        Parts of the plane, shown larger beside the axes.
    names : int
        Most families named.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        For another frequency, nothing to draw, or an inset where no family has a point.
    """
    curves = [frequency_curve(curve, frequency) for curve in atlas.curves]
    name, symbol = FREQUENCIES[frequency]
    manifold = np.stack([atlas.manifold_h, atlas.manifold_frequency], axis=1)
    stars = _stars(atlas, "frequency" if frequency == "fundamental" else "frequency_index")
    # A chaotic impulsive motion may have its frequency far below those of all families.
    framing = [*(curve.path for curve in curves), stars, *([] if curves else [manifold])]
    points = np.concatenate(framing)
    if not len(points):
        raise ValueError(_NOTHING)
    reached = np.append(points[:, 0], manifold[:, 0])
    modes = atlas.thresholds
    x_limits = style.limits_of(np.append(reached, [mode.h for mode in modes if mode.h < reached.max()]), 0.04, log=True)
    values = np.append(points[:, 1], [mode.frequency for mode in modes if mode.h > x_limits[0]])
    log = bool(np.nanmax(values) > MANY_FOLD * np.nanmin(values) > 0.0)
    y_limits = style.limits_of(values, 0.04, log=log)
    outside = int(np.count_nonzero((manifold[:, 1] < y_limits[0]) | (manifold[:, 1] > y_limits[1])))
    of_modes = mode_names(x_limits[0], modes)
    ranges = [inset_ranges(inset, [*framing, *(mode.path for mode in of_modes)], log=log) for inset in insets]
    drawn = curves, runs_of(curves), manifold, atlas.manifold_joined, stars, modes
    with style.figure_settings():
        figure = style.new_figure(max(5.6, 1.5 + _INSET_HEIGHT * len(insets)))
        figure.suptitle(_title(atlas, "Families of periodic orbits" if curves else "Impulsive motions"))
        labels = [f"inset-{chr(97 + k)}" for k in range(len(insets))]
        shown = max((math.log(right / left) / math.log(x_limits[1] / x_limits[0]) for (left, right), _ in ranges), default=0.0)
        wide = [1.0, max(_INSET_WIDTH, _LARGER * shown)] if insets else None
        panels = figure.subplot_mosaic([["frequency", label] for label in labels] or [["frequency"]], width_ratios=wide)
        axes = panels["frequency"]
        _energy_axis(axes, atlas, x_limits)
        unit = "" if atlas.natural_frequency == 1.0 else " (rad/s)"
        style.set_axis(axes, "y", y_limits, 7, name + unit, symbol, log=log)
        for label, (energies, frequencies) in zip(labels, ranges, strict=True):
            panels[label].set_title(f"({label[-1]})", loc="left", pad=3)
            panels[label].tick_params(axis="x", pad=6.0)  # below the text of a tick of the other axis in the corner
            style.set_axis(panels[label], "x", energies, 4, "", _energy_symbol(atlas), log=True)
            style.set_axis(panels[label], "y", frequencies, 4, "", symbol, log=log)
        legend = _legend(figure, drawn[1], curves, _other_entries(atlas, modes, len(stars) > 0, outside))
        room = _draw(axes, *drawn)
        _draw_bounds(room, atlas)
        small = [ranges[k] for k, label in enumerate(labels) if draw_inset(room, panels[label], label[-1])]
        written: set[str] = set()
        for label in labels:
            inside = _draw(panels[label], *drawn)
            local = names_of(curves, inside)
            written |= write_names(inside, _at_most(names, local, written), most=_INSET_NAMES, far=_INSET_FAR, over_curves=False)
        named = names_of(curves) if curves else _star_names(atlas, stars, room)
        # What is named in an inset needs no name in its frame, where curves are crowded.
        named = [name for name in named if name.key not in written or not _is_within(name.spots(room), room, small)]
        named = _at_most(names, named, written) if written else named
        written |= write_names(room, named, most=names, always=of_modes, radius=0.0 if curves else _RADIUS)
        legend.set_title(_count_of_names(figure, written, curves or named))
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
    style.write_figure(atlas_figure, path_or_file, atlas, format=format, **options)


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
    if not len(energies):
        nowhere = "there is nothing to draw: velocities are those at zero displacement, where no orbit of these families starts"
        raise ValueError(nowhere if atlas.curves else _NOTHING)
    left_out = len({curve.family for curve in atlas.curves}) - len({curve.family for curve in curves})
    with style.figure_settings():
        figure = style.new_figure(7.2)
        figure.suptitle(_title(atlas, "Families of periodic orbits"))
        panels = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        drawn = []
        for axes, k in zip(panels, chosen, strict=True):
            named = [Named(np.stack([curve.h, curve.velocities[:, k]], axis=1), curve) for curve in curves]
            manifold, stars = _manifold_velocity(atlas, k), _stars(atlas, "velocities", k)
            axes.set_label(f"velocity{k}")
            _energy_axis(axes, atlas, style.limits_of(energies, 0.04, log=True))
            values = np.concatenate([*(curve.path[:, 1] for curve in named), manifold[:, 1], stars[:, 1]])
            symbol = f"{style.symbol_of(system.coordinates[k], velocity=True)}(0)"
            style.set_axis(axes, "y", style.limits_of(values, 0.05), 6, "start velocity", symbol)
            drawn.append((axes, named, runs_of(named), manifold, np.ones(len(manifold), dtype=bool), stars))
        for axes in panels[:-1]:
            axes.set_xlabel("")
        others = [_entry("impulsive motions", _MANIFOLD, markersize=3.5)] if len(atlas.manifold_h) else []
        others += [_entry(_STARS, _STAR)] if atlas.impulsive is not None else []
        legend = _legend(figure, {code for panel in drawn for code in panel[2]}, drawn[0][1], others)
        written: set[str] = set()
        for panel in drawn:
            written |= write_names(_draw(*panel), names_of(panel[1]), most=names)
        note = f"; {left_out} that do not start at the origin left out" if left_out else ""
        legend.set_title(_count_of_names(figure, written, drawn[0][1], note))
    return figure


def plot_catalogue(catalogue: Catalogue, ax: Axes | None = None, *, frequency: str = "index", **filters: Any) -> Axes:
    """Draw the frequency-energy curves of the families of a catalogue.

    Parameters
    ----------
    catalogue : Catalogue
    ax : matplotlib Axes, optional
        By default the axes of a new pyplot figure.
    frequency : {"index", "fundamental"}
        m 2 pi/T, broken where m changes, or 2 pi/T; in radians a unit of time.
    **filters
        ``label``, ``energy``, ``stable``, ``ends`` and ``impacts`` choose families, as in `Catalogue.families`. By default all are drawn.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    ValueError
        For another frequency, or if no family fits.
    """
    rows = catalogue.families(**filters)
    if not rows:
        raise ValueError(f"{catalogue.path} has no family that fits: nothing to plot")
    atlas = atlas_of(catalogue.system, [catalogue.branch(row.id) for row in rows])
    curves = [frequency_curve(curve, frequency) for curve in atlas.curves]
    ax = energy_axes(ax, np.concatenate([curve.path for curve in curves]), *FREQUENCIES[frequency])
    draw_curve(ax, runs_of(curves), "frequency", _FINE)
    return ax


def _title(atlas: Atlas, what: str) -> str:
    text = f"{what}   ({style.system_text(atlas.system)}"
    if atlas.clearance != 1.0:
        text += f", clearance {atlas.clearance:.6g}"
    if atlas.natural_frequency != 1.0:
        text += f", natural frequency {atlas.natural_frequency:.6g} rad/s"
    return text + ")"


def _energy_symbol(atlas: Atlas) -> str:
    return "h" if atlas.energy_unit == 1.0 else r"\hat{H}"


def _energy_axis(axes: Axes, atlas: Atlas, limits: tuple[float, float]) -> None:
    style.set_axis(axes, "x", limits, 14, "energy", _energy_symbol(atlas), log=True)


def frequency_curve(curve: AtlasCurve, frequency: str) -> Named:
    """The curve of a family over its frequency, "index" or "fundamental"; the former is broken where m changes."""
    rows, values = frequency_rows(frequency, curve.half_waves, curve.frequency)
    return Named(np.stack([curve.h[rows], values], axis=1), curve, rows)


def runs_of(curves: Sequence[Named]) -> dict[int, np.ndarray]:
    """The polylines of all curves by stability, as `curve_runs` gives them for one."""
    drawn = [(curve.path, curve.curve.stable[curve.rows]) for curve in curves if curve.curve is not None]
    gap = np.full((1, 2), np.nan), np.zeros(1, dtype=int)
    parts = [part for pair in drawn for part in (pair, gap)]
    return curve_runs(np.concatenate([points for points, _ in parts]), np.concatenate([stable for _, stable in parts])) if parts else {}


def draw_modes(axes: Axes, modes: Sequence[Any]) -> None:
    """Draw the linear modes up to the energies at which they graze."""
    left, name = axes.get_xlim()[0], axes.get_label()
    for mode in modes:
        if mode.h > left:
            axes.plot([left, mode.h], [mode.frequency] * 2, zorder=2.2, gid=f"{name}-{mode.label}", **_MODE)
            axes.plot([mode.h], [mode.frequency], zorder=4.2, gid=f"{name}-{mode.label}-grazing", **_BULLET)


def mode_names(left: float, modes: Sequence[Any]) -> list[Named]:
    """The names of the linear modes that graze above the energy `left`, which may belong to any place of their lines."""
    lines = [(mode, np.geomspace(left, mode.h, 20)) for mode in modes if mode.h > left]
    return [Named(np.stack([energies, np.full(20, mode.frequency)], axis=1), text=mode.label) for mode, energies in lines]


def _draw(
    axes: Axes,
    curves: Sequence[Named],
    runs: Mapping[int, np.ndarray],
    manifold: np.ndarray,
    joined: np.ndarray,
    stars: np.ndarray,
    modes: Sequence[Any] = (),
) -> Room:
    """Draw all curves and markers of a panel.

    Parameters
    ----------
    axes : Axes
    curves, runs : the families, and their polylines
    manifold, joined : (N, 2) and (N,) bool, the impulsive motions, and whether each is joined to the next
    stars : (M, 2), the periodic impulsive orbits
    modes : the linear modes

    Returns
    -------
    Room
        What is left.
    """
    name = str(axes.get_label())
    draw_curve(axes, runs, name, _FINE)
    draw_modes(axes, modes)
    if len(manifold):
        x, y = np.insert(manifold, np.flatnonzero(~joined) + 1, np.nan, axis=0).T
        axes.plot(x, y, zorder=3.5, gid=f"{name}-manifold", **_MANIFOLD)
    room = Room(axes, [*(curve.path for curve in (*curves, *mode_names(axes.get_xlim()[0], modes))), manifold])
    stars = stars[_drawn_stars(room, stars)]
    if len(stars):
        axes.plot(*stars.T, zorder=4, gid=f"{name}-impulsive", **_STAR)
    room.take(room.to_page(np.array([*((mode.h, mode.frequency) for mode in modes), *stars]).reshape(-1, 2)), _RADIUS)
    _draw_events(room, curves)
    return room


def _manifold_velocity(atlas: Atlas, k: int) -> np.ndarray:
    """The start velocity of coordinate k of the impulsive motions against energy (N, 2).

    The mirror images, which families can start with too, follow after a row of NaN.
    """
    path = np.stack([atlas.manifold_h, atlas.manifold_velocities[:, k]], axis=1)
    if not (atlas.system.has_odd_symmetry and path[:, 1].any()):
        return path
    return np.concatenate([path, np.full((1, 2), np.nan), path * (1.0, -1.0)])


def _stars(atlas: Atlas, column: str, k: int | None = None) -> np.ndarray:
    """The periodic impulsive orbits (N, 2): energy, and a column or part k of it. The shortest periods come first."""
    if atlas.impulsive is None:
        return np.zeros((0, 2))
    values = getattr(atlas.impulsive, column)
    points = np.stack([atlas.impulsive.h, values if k is None else values[:, k]], axis=1)
    return points[np.argsort(atlas.impulsive.alpha, kind="stable")]


def _drawn_stars(room: Room, stars: np.ndarray) -> np.ndarray:
    """Which of the periodic impulsive orbits have a star: bool (N,). Of those that would overlap it is the one with the shortest period."""
    return thinned(room.to_page(stars), _STARS_APART)


def _star_names(atlas: Atlas, stars: np.ndarray, room: Room) -> list[Named]:
    """The names of the periodic impulsive orbits that are drawn, for a figure without families."""
    shown = _drawn_stars(room, stars)
    found: list[str] = []
    if atlas.impulsive is not None:
        found = atlas.impulsive.labels[np.argsort(atlas.impulsive.alpha, kind="stable")].tolist()
    labels = [label if on else "" for label, on in zip(found, shown, strict=True)]
    return [
        Named(stars[k : k + 1], text=label, short_id=f"at {stars[k, 0]:.3g}" if labels.count(label) > 1 else "")
        for k, label in enumerate(labels)
        if label
    ]


def _draw_events(room: Room, curves: Sequence[Named]) -> None:
    """Draw the special points that have room, smaller than for one family. Important families come first, then the order of `EVENTS`.

    An event has room if its surroundings contain no earlier marker, and at most one other curve, which crosses its own. The folds of a
    family that the scene names are marked among many curves, too.
    """
    kinds: list[str] = []
    important: list[bool] = []
    places = [np.empty((0, 2))]
    for curve in sorted((curve for curve in curves if curve.curve is not None), key=lambda curve: curve.importance):
        assert curve.curve is not None
        rows = np.arange(len(curve.path))[curve.rows]
        for kind in EVENTS:
            mine = np.searchsorted(rows, np.flatnonzero(curve.curve.events == kind))
            mine = mine[np.isfinite(curve.path[mine, 1])]
            kinds += [kind] * len(mine)
            important += [bool(curve.curve.cited.any()) and kind == "SN"] * len(mine)
            places.append(curve.path[mine])
    points = np.concatenate(places)
    at = room.to_page(points)
    alone = room.free(at, 3.0) & (room.crowd(at, _ABOUT) <= _ALONE * 2.0 * _ABOUT)
    chosen = np.flatnonzero(alone | (np.array(important, dtype=bool) & room.free(at, 1.0)))
    chosen = chosen[thinned(at[chosen], _APART)]
    for kind in dict.fromkeys(kinds):
        drawn = [i for i in chosen if kinds[i] == kind]
        if drawn:
            size = _SMALLER * style.EVENT_LOOKS[kind]["markersize"]
            draw_events(room.axes, [kind] * len(drawn), points[drawn], str(room.axes.get_label()), zorder=3.8, markersize=size)
            room.take(at[drawn], 0.5 * size + 0.5)


def _at_most(count: int, names: Sequence[Named], written: Collection[str]) -> list[Named]:
    """The first of some names with which no more than `count` families are named; those that are named elsewhere stay."""
    left_out = [name for name in names if name.key not in written][max(0, count - len(written)) :]
    return [name for name in names if name not in left_out]


def _is_within(spots: np.ndarray, room: Room, ranges: Sequence[tuple[tuple[float, float], tuple[float, float]]]) -> bool:
    """Whether all spots (k, 2) of the page lie in the frames of insets."""
    corners = [room.to_page(np.array(pair).T) for pair in ranges]
    inside = [((spots >= low) & (spots <= high)).all(axis=1) for low, high in corners]
    return len(spots) > 0 and len(inside) > 0 and bool(np.any(inside, axis=0).all())


def _draw_bounds(room: Room, atlas: Atlas) -> None:
    """Draw the vertical lines, and the regimes' numerals under the upper edge of the frame. Names keep off both."""
    if not atlas.bounds:
        return
    axes = room.axes
    low, high = axes.get_xlim()
    for bound in atlas.bounds:
        axes.axvline(bound.h, zorder=1.5, gid=f"bound-{bound.below}-{bound.above}", **_BOUND)
        room.take_path(room.to_page(np.array([[bound.h] * 2, axes.get_ylim()]).T))
    edges = [low, *(bound.h for bound in atlas.bounds), high]
    names = [atlas.bounds[0].below, *(bound.above for bound in atlas.bounds)]
    for name, left, right in zip(names, edges[:-1], edges[1:], strict=True):
        if low <= left < right <= high:
            look: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "ha": "center", "va": "top"}
            axes.annotate(name, (math.sqrt(left * right), 1.0), (0, -4), fontsize=style.NORMAL + 1.0, zorder=6, **look)
            x = room.to_page(np.array([[math.sqrt(left * right), axes.get_ylim()[0]]]))[0, 0]
            room.take(np.array([[x, room.frame[3] - 8.0]]), np.array([9.0, 8.0]))


def _entry(label: str, look: dict[str, Any], **more: Any) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **{**look, **more})


def _other_entries(atlas: Atlas, modes: Sequence[Any], stars: bool, outside: int) -> list[Any]:
    """Legend entries besides families; `outside` is the number of impulsive motions with a frequency outside the axis."""
    entries = []
    if modes:
        entries.append(_entry("linear modes, to where they graze", _MODE, marker="o", markersize=5.0))
    if len(atlas.manifold_h):
        left_out = f"; {outside} of {len(atlas.manifold_h)} are outside" if outside else ""
        text = f"impulsive motions ({atlas.manifold_window} window, {atlas.manifold_periods} periods{left_out})"
        entries.append(_entry(text, _MANIFOLD, markersize=3.5))
    if stars:
        entries.append(_entry(_STARS, _STAR))
    if atlas.bounds:
        text = "regimes (bounds are ours, not the paper's):\n" + "\n".join(f"{b.below}/{b.above}: {b.what}" for b in atlas.bounds)
        entries.append(_entry(text, _BOUND))
    return entries


def _legend(figure: Figure, codes: Collection[int], curves: Sequence[Named], others: Sequence[Any]) -> Legend:
    kinds = {kind for curve in curves if curve.curve is not None for kind in curve.curve.events.tolist()}
    # The title keeps space for the number of names.
    return style.legend_below(figure, [*legend_entries(codes, kinds), *others], _COLUMNS, title=" ", title_fontsize=style.SMALL)


def _count_of_names(figure: Figure, written: set[str], curves: Sequence[Named], note: str = "") -> str:
    """How many families are named in the figure, and what a short id is."""
    keys = {curve.key for curve in curves}
    what = "families" if curves and curves[0].curve is not None else "orbits"
    if any("#" in text.get_text() for panel in figure.axes for text in panel.texts):
        note += "; # and the first digits of the hash in an id: families without a label, or with the label of another one"
    return f"{len(written & keys)} of {len(keys)} {what} named{note}" if keys else ""
