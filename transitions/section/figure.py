"""The figure of Poincare sections: one, or panels of several energies (Lee et al., Physica D 238 (2009) 1868, Fig. 10)."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures import style
from branches.figures.room import Named, Room, write_names
from bvp.texts import shown
from transitions.section.plane import SectionPlane
from transitions.section.view import COLOURS, OrbitMark, SectionView

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    from transitions.section.view import OrbitMark

__all__ = ["ROOM", "has_images", "robust_limits", "section_figure", "with_ink_left", "with_room"]

ROOM = 6.5
"""Points (of type) from the middle of a mark to the next: one and a half times the width of a mark, so that what is below stays visible."""

_CELL, _BLOCK = 0.5, 10  # points of type that a dot inks; cells on each side of a block
_INK = 0.25  # part of a block that is inked at most before motions are left out
_FENCE = 1.5


def has_images(plane: SectionPlane) -> bool:
    """Whether (-x, y) are points of the section where (x, y) are.

    The mirror u to -u and the reversal of time together keep u_p = 0 and u_p' > 0, change the sign of x and keep y. So they map each motion
    of an elastic undamped system with odd symmetry to the motion from the mirrored start.
    """
    return bool(plane.system.is_conservative and plane.system.has_odd_symmetry)


def with_ink_left(axes: Axes, motions: list[np.ndarray]) -> list[int]:
    """The indices of the motions (points (k, 2) of each) that are drawn in axes with their final limits and place in the figure.

    A motion is left out if half of its points or more fall where the motions before it leave little white.
    """
    per_cell = 72.0 / axes.figure.dpi / _CELL
    low, high = np.array(axes.bbox.extents).reshape(2, 2) * per_cell
    inked = np.zeros(np.ceil((high - low) / _BLOCK).astype(int) * _BLOCK + _BLOCK, dtype=bool)
    blocks = inked.reshape(inked.shape[0] // _BLOCK, _BLOCK, -1, _BLOCK)  # the cells again, by blocks
    out = []
    for k, points in enumerate(motions):
        cells = np.floor(axes.transData.transform(points) * per_cell - low).astype(int)
        x, y = np.unique(cells[((cells >= 0) & (cells < inked.shape)).all(axis=1)], axis=0).T
        if not len(x) or np.mean(blocks.mean(axis=(1, 3))[x // _BLOCK, y // _BLOCK] >= _INK) < 0.5:
            out.append(k)
            inked[x, y] = True
    return out


def robust_limits(values: np.ndarray) -> tuple[float, float]:
    """The least and the largest of some values (N,), N > 0, without those that lie further than 1.5 interquartile ranges outside of the
    quartiles (Tukey, Exploratory Data Analysis, 1977).

    Examples
    --------
    >>> robust_limits(np.array([0.1, 0.12, 0.13, 0.15, 0.16, 0.97]))
    (0.1, 0.16)
    """
    first, third = np.quantile(values, [0.25, 0.75])
    reach = _FENCE * (third - first)
    kept = values[(values >= first - reach) & (values <= third + reach)]
    return float(kept.min()), float(kept.max())


def with_room(axes: Axes, marks: Sequence[OrbitMark]) -> list[OrbitMark]:
    """The marks that are drawn in axes with their final limits and place in the figure.

    Elliptic orbits come first, and those with the fewest impacts, then with the fewest crossings: each that has room at all of its
    crossings beside those before it.
    """
    to_points = 72.0 / axes.figure.dpi
    taken = np.empty((0, 2))
    out = []
    for mark in sorted(marks, key=lambda mark: (mark.stable != 1, mark.impacts, len(mark.points))):
        places = axes.transData.transform(mark.points) * to_points
        if np.all(np.hypot(*(places[:, None] - taken[None]).T) >= ROOM):
            out.append(mark)
            taken = np.concatenate([taken, places])
    return out


MOST_NAMES = 25
"""Periodic orbits named in a figure of one section, at most."""

_COLUMNS, _PANEL = 2, 2.35
_SINGLE = 5.6
_WIDE = 140  # letters in a line of the notes
_RADIUS = 3.0  # of the marks of orbits, in points
_DOT = 0.55
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": _DOT, "markeredgewidth": 0, "rasterized": True}
_MAP = "viridis"
_MARKS: dict[int, dict[str, Any]] = {
    1: {"marker": "o", "markersize": 4.2, "markerfacecolor": "none", "markeredgecolor": style.ORANGE, "markeredgewidth": 1.1},
    0: {"marker": "x", "markersize": 4.0, "markeredgecolor": style.VERMILION, "markeredgewidth": 1.0},
    -1: {"marker": "D", "markersize": 3.2, "markerfacecolor": "none", "markeredgecolor": style.BLUE, "markeredgewidth": 0.8},
}
_KINDS = {1: "elliptic orbit", 0: "hyperbolic orbit", -1: "orbit of undecided stability"}
_CENTRE: dict[str, Any] = {"marker": "+", "markersize": 5.0, "markeredgecolor": style.VERMILION, "markeredgewidth": 1.0}
_EDGE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.7}
_WALL: dict[str, Any] = {"color": style.BLACK, "linewidth": 1.8, "solid_capstyle": "butt"}


def section_figure(views: Sequence[SectionView], *, colour: str = "none", caption: str = "", names: int = MOST_NAMES) -> Figure:
    """The figure of sections.

    Parameters
    ----------
    views : sequence of SectionView
        Of one system. The points are drawn as an image in pdf and svg too: as shapes they would make files of many megabytes.
    colour : "none", "energy", "lyapunov" or "rotation"
        The range of colours leaves out what lies far outside of the quartiles.
    caption : str
        A line under the panels.
    names : int
        Most periodic orbits named, in a figure of one section; several panels have no room for names.

    Returns
    -------
    matplotlib.figure.Figure
        Of an elastic undamped system with odd symmetry each motion is drawn with that from the mirrored start. Motions that would fall
        where those before them leave little white are left out.

    Raises
    ------
    ValueError
        For another colour, or nothing to draw.
    """
    if colour not in COLOURS:
        raise ValueError(f"unknown colour {shown(colour)}: expected {', '.join(COLOURS)}")
    if not views:
        raise ValueError("there is nothing to draw: no section")
    several = len(views) > 1
    rows = math.ceil(len(views) / _COLUMNS) if several else 1
    with style.figure_settings():
        figure = style.new_figure(0.9 + _PANEL * rows if several else _SINGLE)
        figure.suptitle(_title(views, several))
        grid = figure.subplots(rows, _COLUMNS if several else 1, squeeze=False).ravel()
        for axes in grid[len(views) :]:
            axes.remove()
        norm = _norm(views, colour)
        for k, (axes, view) in enumerate(zip(grid, views, strict=False)):
            axes.set_label(f"section{k}")
            _frame(axes, view, colour, f"section{k}")
            if several:
                axes.set_title(f"({chr(97 + k)})  $h = {view.section.plane.energy:.6g}$", fontsize=style.SMALL + 1.0, pad=3)
                if k < len(views) - _COLUMNS:
                    axes.set_xlabel("")
        if norm is not None:
            _colour_bar(figure, list(grid[: len(views)]), norm, colour, views)
        entries = _legend(views)
        notes = [caption] * bool(caption)
        if has_images(views[0].section.plane):
            notes.append("each motion with that from its mirrored start")
        legend = style.legend_below(figure, entries, 5, title=_lines(notes) or " ", title_fontsize=style.SMALL)
        for k, (axes, view) in enumerate(zip(grid, views, strict=False)):
            motions = _draw(axes, view, colour, norm, f"section{k}")
            drawn = with_room(axes, view.marks)
            for stable, look in _MARKS.items():
                spots = [mark.points for mark in drawn if mark.stable == stable]
                if spots:
                    axes.plot(*np.concatenate(spots).T, linestyle="none", zorder=4 + stable, gid=f"section{k}-{_KINDS[stable]}", **look)
            own = [f"{motions} of {len(view.section.counts)} motions drawn"] * (motions < len(view.section.counts))
            own += [f"{len(drawn)} of {len(view.marks)} orbits marked"] * (len(drawn) < len(view.marks))
            if several:
                axes.set_title(axes.get_title() + f"   ({', '.join(own)})" * bool(own), fontsize=style.SMALL + 1.0, pad=3)
                continue
            if view.marks:
                own += _name(axes, view, drawn, names)
            legend.set_title(_lines([*notes, *own]))
    return figure


def _lines(notes: Sequence[str]) -> str:
    """Notes on one line, or, where they are longer, on a line each."""
    text = "; ".join(notes)
    return text if len(text) <= _WIDE else "\n".join(textwrap.fill(note, _WIDE) for note in notes)


def _title(views: Sequence[SectionView], several: bool) -> str:
    plane = views[0].section.plane
    name = plane.system.coordinates[plane.primary]
    energy = "" if several else rf"$h = {plane.energy:.8g}$,  "
    symbols = style.symbol_of(name), style.symbol_of(name, velocity=True)
    return rf"{energy}section ${symbols[0]} = 0$, ${symbols[1]} > 0$   ({style.system_text(plane.system)})"


def _norm(views: Sequence[SectionView], colour: str) -> Normalize | None:
    """One colour scale for all panels: square root for Lyapunov exponents, whose sizes differ much, and logarithm for energies."""
    if colour == "none":
        return None
    from matplotlib.colors import LogNorm, Normalize, PowerNorm

    found = [values for view in views if (values := view.values(colour)) is not None]
    values = np.concatenate([value[np.isfinite(value)] for value in found])
    if colour == "energy":
        values = values[values > 0.0]
        low, high = np.exp(robust_limits(np.log(values))) if len(values) else (0.1, 1.0)
        return LogNorm(low, high if high > low * (1.0 + 1e-9) else 1.1 * low, clip=True)
    if colour == "lyapunov":
        top = robust_limits(np.sqrt(np.maximum(values, 0.0)))[1] ** 2 if len(values) else 0.0
        return PowerNorm(0.5, 0.0, max(top, 1e-6), clip=True)
    return Normalize(*style.limits_of(np.array(robust_limits(values)), 0.0) if len(values) else (0.0, 1.0))


def _draw(axes: Axes, view: SectionView, colour: str, norm: Normalize | None, name: str) -> int:
    """Draw the points; how many motions are drawn."""
    section = view.section
    shown = ~np.isnan(section.times)
    count = len(section.counts)
    images = has_images(section.plane)
    motions = [section.points[m, shown[m]] for m in range(count)]
    if images:
        motions = [np.concatenate([points, points * (-1.0, 1.0)]) for points in motions]
    # Motions that lose energy all end in one place.
    chosen = with_ink_left(axes, motions) if section.plane.system.is_conservative else list(range(count))
    points = np.concatenate([motions[m] for m in chosen])
    if norm is None:
        axes.plot(points[:, 0], points[:, 1], color=style.BLACK, gid=f"{name}-points", **_DOTS)
        return len(chosen)
    at = np.concatenate([np.tile(_colours(view, colour)[m, shown[m]], 2 if images else 1) for m in chosen])
    known = np.isfinite(at)
    axes.plot(points[~known, 0], points[~known, 1], color=style.GREY, gid=f"{name}-unknown", **_DOTS)
    size = (1.3 * _DOT) ** 2
    x, y = points[known].T
    axes.scatter(x, y, size, at[known], cmap=_MAP, norm=norm, linewidths=0, rasterized=True, gid=f"{name}-points")
    return len(chosen)


def _colours(view: SectionView, colour: str) -> np.ndarray:
    """The values (motions, points) that determine the colours of the points."""
    values, shape = view.values(colour), view.section.times.shape
    assert values is not None
    return np.broadcast_to(values if values.ndim == 2 else values[:, None], shape)


def _frame(axes: Axes, view: SectionView, colour: str, name: str) -> None:
    """The bounding curve, walls and centres, and the axes around all points."""
    section, plane = view.section, view.section.plane
    shown = ~np.isnan(section.times)
    edge = plane.boundary()
    axes.plot(edge[:, 0], edge[:, 1], zorder=3, gid=f"{name}-boundary", **_EDGE)
    for wall in set(plane.walls) & set(plane.reach):
        top = plane.height(wall)
        if top > 0.0:
            axes.plot([wall, wall], [-top, top], zorder=3, gid=f"{name}-wall", **_WALL)
    if view.rotations is not None and colour == "rotation":
        for k in np.unique(view.rotations.about[np.isfinite(view.rotations.numbers)]):
            centre = view.rotations.centres[k]
            axes.plot(centre.x, centre.y, linestyle="none", zorder=5, gid=f"{name}-centre{k}", **_CENTRE)
    everything = np.concatenate([edge, section.points[shown]])
    if has_images(plane):
        everything = np.concatenate([everything, everything * (-1.0, 1.0)])
    other = plane.system.coordinates[plane.other]
    style.set_axis(axes, "x", style.limits_of(everything[:, 0], 0.05), 6, "", style.symbol_of(other))
    velocity = rf"p_{{{style.symbol_of(other)}}}/m" if plane.momentum else style.symbol_of(other, velocity=True)
    style.set_axis(axes, "y", style.limits_of(everything[:, 1], 0.05), 6, "", velocity)


_MEANING = {"lyapunov": ("largest Lyapunov exponent", r"\Lambda"), "rotation": ("rotation number", "r"), "energy": ("energy", "h")}


def _colour_bar(figure: Figure, axes: list[Axes], norm: Normalize, colour: str, views: Sequence[SectionView]) -> None:
    """The colour bar; it ends in a tip where values lie beyond its range."""
    from matplotlib.cm import ScalarMappable

    low, high = float(norm.vmin or 0.0), float(norm.vmax or 1.0)
    values = np.concatenate([_colours(view, colour)[~np.isnan(view.section.times)] for view in views])
    below, above = np.nanmin(values, initial=low) < low * (1.0 - 1e-9) and colour != "lyapunov", np.nanmax(values, initial=high) > high
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get((bool(below), bool(above)), "neither")
    bar = figure.colorbar(ScalarMappable(norm, _MAP), ax=axes, fraction=0.04, pad=0.015, aspect=45, extend=extend, extendfrac=0.02)
    what, symbol = _MEANING[colour]
    bar.set_label(f"{what}{' (grey: none)' * bool(np.isnan(values).any())} ${symbol}$")


def _legend(views: Sequence[SectionView]) -> list[Any]:
    from matplotlib.lines import Line2D

    plane = views[0].section.plane
    conservative = plane.system.is_conservative
    symbol = style.symbol_of(plane.system.coordinates[plane.primary], velocity=True)
    entries = [Line2D([], [], label=rf"bounding curve, ${symbol} = 0$" + ("" if conservative else ", of the starts"), **_EDGE)]
    if any(set(view.section.plane.walls) & set(view.section.plane.reach) for view in views):
        entries.append(Line2D([], [], label="stop", **_WALL))
    present = {mark.stable for view in views for mark in view.marks}
    entries += [Line2D([], [], label=_KINDS[k], linestyle="none", **look) for k, look in _MARKS.items() if k in present]
    if any(view.rotations is not None for view in views):
        entries.append(Line2D([], [], label="fixed point that orbits go round", linestyle="none", **_CENTRE))
    return entries


def _name(axes: Axes, view: SectionView, marks: Sequence[OrbitMark], names: int) -> list[str]:
    """Name the periodic orbits that are drawn, those first that found room first, each once; what there is to say about the number."""
    room = Room(axes, [view.section.plane.boundary()])
    chosen: dict[str, Named] = {}
    for mark in marks:
        room.take(room.to_page(mark.points), _RADIUS)
        if mark.label:
            chosen.setdefault(mark.label, Named(mark.points[:1], text=mark.label))
    # The names are larger than elsewhere and on white ground, so that the raised sign of a label is readable among the dots.
    written = write_names(room, list(chosen.values()), most=names, radius=_RADIUS, font=style.NORMAL + 1.0)
    for text in axes.texts:
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.95, "pad": 0.8})
    return [f"{len(written)} of {len(chosen)} labels written"] * bool(chosen)
