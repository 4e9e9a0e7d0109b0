"""The picture of Poincare sections: one, or a plate of several energies (Lee et al., Physica D 238 (2009) 1868, Fig. 10)."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.diagram.atlas_labels import Named, label_curves
from branches.diagram.files import draw
from branches.diagram.scales import linear_axis, linear_limits, linear_ticks, mark_axis
from branches.diagram.style import BLACK, BLUE, GREY, ORANGE, SMALL, VERMILION, new_figure, picture_settings, settle_layout
from branches.diagram.titles import symbol_of, system_text, velocity_symbol
from transitions.diagram.mark_room import with_room
from transitions.section_marks import Mark
from transitions.section_plane import SectionPlane
from transitions.section_view import COLOURS, SectionView

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

__all__ = ["draw_sections", "section_figure"]

MOST_NAMES = 25
"""Periodic orbits named in a picture of one section, at most."""

_COLUMNS, _PANEL = 2, 2.35
_SINGLE = 5.6
_DOT = 0.55
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": _DOT, "markeredgewidth": 0, "rasterized": True}
_MAP = "viridis"
_MARKS: dict[int, dict[str, Any]] = {
    1: {"marker": "o", "markersize": 4.2, "markerfacecolor": "none", "markeredgecolor": ORANGE, "markeredgewidth": 1.1},
    0: {"marker": "x", "markersize": 4.0, "markeredgecolor": VERMILION, "markeredgewidth": 1.0},
    -1: {"marker": "D", "markersize": 3.2, "markerfacecolor": "none", "markeredgecolor": BLUE, "markeredgewidth": 0.8},
}
_KINDS = {1: "elliptic orbit", 0: "hyperbolic orbit", -1: "orbit of undecided stability"}
_CENTRE: dict[str, Any] = {"marker": "+", "markersize": 5.0, "markeredgecolor": VERMILION, "markeredgewidth": 1.0}
_EDGE: dict[str, Any] = {"color": BLACK, "linewidth": 0.7}
_WALL: dict[str, Any] = {"color": BLACK, "linewidth": 1.8, "solid_capstyle": "butt"}


def draw_sections(
    views: Sequence[SectionView], path_or_file: str | os.PathLike[str] | IO[bytes], *, format: str | None = None, **options: Any
) -> None:
    """Write the picture of sections to a png, pdf or svg file.

    Parameters
    ----------
    views : sequence of SectionView
        Several make a plate.
    path_or_file : path, or binary file open for writing
    format : "png", "pdf" or "svg"; by default what the file's name ends with
    **options
        As for `section_figure`.
    """
    draw(lambda: section_figure(views, **options), path_or_file, format)


def section_figure(views: Sequence[SectionView], *, colour: str = "none", caption: str = "", names: int = MOST_NAMES) -> Figure:
    """The picture of sections.

    Parameters
    ----------
    views : sequence of SectionView
        Of one system. The points are drawn as an image in pdf and svg too: as shapes they would make files of many megabytes.
    colour : "none", "lyapunov" or "rotation"
    caption : str
        A line under the panels.
    names : int
        Most periodic orbits named, in a picture of one section; a plate has no room for names.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        For another colour, or nothing to draw.
    """
    if colour not in COLOURS:
        raise ValueError(f"unknown colour {colour!r}: expected {', '.join(COLOURS)}")
    if not views:
        raise ValueError("there is nothing to draw: no section")
    plate = len(views) > 1
    rows = math.ceil(len(views) / _COLUMNS) if plate else 1
    with picture_settings():
        figure = new_figure(0.9 + _PANEL * rows if plate else _SINGLE)
        figure.suptitle(_title(views, plate))
        grid = figure.subplots(rows, _COLUMNS if plate else 1, squeeze=False).ravel()
        for axes in grid[len(views) :]:
            axes.remove()
        norm = _norm(views, colour)
        for k, (axes, view) in enumerate(zip(grid, views, strict=False)):
            axes.set_label(f"section{k}")
            _draw(axes, view, colour, norm, f"section{k}")
            if plate:
                axes.set_title(f"({chr(97 + k)})  $h = {view.section.plane.energy:.6g}$", fontsize=SMALL + 1.0, pad=3)
                if k < len(views) - _COLUMNS:
                    axes.set_xlabel("")
        if norm is not None:
            values = [view.values(colour) for view in views]
            grey = any(not np.isfinite(known).all() for known in values if known is not None)
            _colour_bar(figure, list(grid[: len(views)]), norm, colour, grey)
        entries = _legend(views)
        below: dict[str, Any] = {"title": caption, "title_fontsize": SMALL} if caption else {}
        figure.legend(handles=entries, loc="outside lower center", ncols=min(5, len(entries)), frameon=False, **below)
        settle_layout(figure)
        for k, (axes, view) in enumerate(zip(grid, views, strict=False)):
            drawn = with_room(axes, view.marks)
            _mark(axes, drawn, f"section{k}")
            told = f"{len(drawn)} of {len(view.marks)} orbits marked" if len(drawn) < len(view.marks) else ""
            if plate:
                axes.set_title(axes.get_title() + f"   ({told})" * bool(told), fontsize=SMALL + 1.0, pad=3)
            elif view.marks:
                _name(axes, view, drawn, names, told)
    return figure


def _title(views: Sequence[SectionView], plate: bool) -> str:
    plane = views[0].section.plane
    name = plane.system.coordinates[plane.primary]
    energy = "" if plate else rf"$h = {plane.energy:.8g}$,  "
    return rf"{energy}section ${symbol_of(name)} = 0$, ${velocity_symbol(name)} > 0$   ({system_text(plane.system)})"


def _norm(views: Sequence[SectionView], colour: str) -> Normalize | None:
    """One scale of colours for all panels; that of Lyapunov exponents goes by their square root from 0, as they differ much."""
    if colour == "none":
        return None
    from matplotlib.colors import Normalize, PowerNorm

    found = [view.values(colour) for view in views]
    values = np.concatenate([value[np.isfinite(value)] for value in found if value is not None])
    if colour == "lyapunov":
        return PowerNorm(0.5, 0.0, max(float(values.max(initial=0.0)), 1e-6), clip=True)
    return Normalize(*linear_limits(values, 0.0) if len(values) else (0.0, 1.0))


def _draw(axes: Axes, view: SectionView, colour: str, norm: Normalize | None, name: str) -> None:
    section, plane = view.section, view.section.plane
    shown = ~np.isnan(section.times)
    values = view.values(colour)
    if values is None or norm is None:
        points = section.points[shown]
        axes.plot(points[:, 0], points[:, 1], color=BLACK, **_DOTS)[0].set_gid(f"{name}-points")
    else:
        orbit = np.nonzero(shown)[0]
        told = np.isfinite(values[orbit])
        points, at = section.points[shown], values[orbit]
        axes.plot(points[~told, 0], points[~told, 1], color=GREY, **_DOTS)[0].set_gid(f"{name}-untold")
        size = (1.3 * _DOT) ** 2
        x, y = points[told].T
        axes.scatter(x, y, size, at[told], cmap=_MAP, norm=norm, linewidths=0, rasterized=True).set_gid(f"{name}-points")
    edge = plane.boundary()
    axes.plot(edge[:, 0], edge[:, 1], zorder=3, **_EDGE)[0].set_gid(f"{name}-boundary")
    for wall in set(plane.walls) & set(plane.reach):
        top = plane.height(wall)
        if top > 0.0:
            axes.plot([wall, wall], [-top, top], zorder=3, **_WALL)[0].set_gid(f"{name}-wall")
    if view.rotations is not None and colour == "rotation":
        for k in np.unique(view.rotations.about[np.isfinite(view.rotations.numbers)]):
            centre = view.rotations.centres[k]
            axes.plot(centre.x, centre.y, linestyle="none", zorder=5, **_CENTRE)[0].set_gid(f"{name}-centre{k}")
    everything = np.concatenate([edge, section.points[shown]])
    other = plane.system.coordinates[plane.other]
    linear_axis(axes, "x", linear_limits(everything[:, 0], 0.05), 6, "", symbol_of(other))
    linear_axis(axes, "y", linear_limits(everything[:, 1], 0.05), 6, "", _velocity(plane))


def _mark(axes: Axes, marks: Sequence[Mark], name: str) -> None:
    for stable, look in _MARKS.items():
        spots = [mark.points for mark in marks if mark.stable == stable]
        if spots:
            x, y = np.concatenate(spots).T
            axes.plot(x, y, linestyle="none", zorder=4 + stable, **look)[0].set_gid(f"{name}-{_KINDS[stable]}")


def _velocity(plane: SectionPlane) -> str:
    name = plane.system.coordinates[plane.other]
    return rf"p_{{{symbol_of(name)}}}/m" if plane.momentum else velocity_symbol(name)


def _colour_bar(figure: Figure, axes: list[Axes], norm: Normalize, colour: str, grey: bool) -> None:
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(norm, _MAP), ax=axes, fraction=0.04, pad=0.015, aspect=45)
    ticks = linear_ticks(float(norm.vmin or 0.0), float(norm.vmax or 1.0), 6)
    mark_axis(bar.ax.yaxis, ticks)
    what, symbol = ("largest Lyapunov exponent", r"\Lambda") if colour == "lyapunov" else ("rotation number", "r")
    bar.set_label(ticks.axis_text(what + " (grey: none)" * grey, symbol))


def _legend(views: Sequence[SectionView]) -> list[Any]:
    from matplotlib.lines import Line2D

    plane = views[0].section.plane
    conservative = plane.system.is_conservative
    symbol = velocity_symbol(plane.system.coordinates[plane.primary])
    entries = [Line2D([], [], label=rf"bounding curve, ${symbol} = 0$" + ("" if conservative else ", of the starts"), **_EDGE)]
    if any(set(view.section.plane.walls) & set(view.section.plane.reach) for view in views):
        entries.append(Line2D([], [], label="stop", **_WALL))
    present = {mark.stable for view in views for mark in view.marks}
    entries += [Line2D([], [], label=_KINDS[k], linestyle="none", **look) for k, look in _MARKS.items() if k in present]
    if any(view.rotations is not None for view in views):
        entries.append(Line2D([], [], label="fixed point that orbits go round", linestyle="none", **_CENTRE))
    return entries


def _name(axes: Axes, view: SectionView, marks: Sequence[Mark], names: int, told: str) -> None:
    """Name the periodic orbits that are drawn, those first that found room first, each once; `told` stands with the number of names."""
    to_points = 72 / axes.figure.dpi
    chosen: dict[str, Named] = {}
    spots = []
    for mark in marks:
        places = axes.transData.transform(mark.points) * to_points
        spots += [(x - 3.0, y - 3.0, x + 3.0, y + 3.0) for x, y in places]
        if mark.label and mark.label not in chosen:
            x, y = mark.points[0]
            chosen[mark.label] = Named.point(mark.label, float(x), float(y))
    written = label_curves(axes, list(chosen.values()), [view.section.plane.boundary()], spots, most=names)
    counts = [told] * bool(told) + [f"{len(written)} of {len(chosen)} labels written"] * bool(chosen)
    if counts:
        axes.set_xlabel(f"{axes.get_xlabel()}   ({', '.join(counts)})")
    for text in (text for text in axes.texts if text.get_text()):
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.3})
