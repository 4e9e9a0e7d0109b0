"""The picture of many families' start velocities against energy."""

from __future__ import annotations

import os
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.diagram.atlas_labels import Named, label_curves, names_of
from branches.diagram.atlas_parts import (
    FINE,
    NOTE,
    STAR,
    Box,
    draw_manifold_velocity,
    energy_axis,
    manifold_entry,
    manifold_paths,
    mark_boxes,
    note_named,
    refuse_empty,
    runs_of,
    star_entry,
    title,
)
from branches.diagram.event_room import draw_some_events, drawn_types, event_types
from branches.diagram.files import draw
from branches.diagram.legends import legend_below
from branches.diagram.marks import draw_curve, legend_entries, seen
from branches.diagram.scales import linear_axis, linear_limits, logarithmic_limits
from branches.diagram.style import new_figure, picture_settings, settle_layout
from branches.diagram.titles import velocity_symbol

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from branches.diagram.atlas_data import Atlas

__all__ = ["draw_velocities", "velocities_figure"]

_COLUMNS = 5  # of the legend, at most
MOST_NAMES = 30
"""Families named in one panel, at most."""


def draw_velocities(atlas: Atlas, path_or_file: str | os.PathLike[str] | IO[bytes], *, format: str | None = None, **options: Any) -> None:
    """Write the start velocities of many families against energy to a png, pdf or svg file: as for `draw_atlas`."""
    draw(lambda: velocities_figure(atlas, **options), path_or_file, format)


def velocities_figure(atlas: Atlas, *, names: int = MOST_NAMES) -> Figure:
    """The start velocities, at zero displacement, of absorber and primary against energy; impulsive motions have that of the primary alone.

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
        Where no family starts at zero displacement.
    """
    system = atlas.system
    chosen = [k for k in (system.absorber, system.primary) if k is not None] or list(range(min(2, len(system.coordinates))))
    curves = [curve for curve in atlas.curves if np.isfinite(curve.velocities).any()]
    stars = atlas.impulsive
    energies = [curve.h for curve in curves] + [atlas.manifold_h] + ([] if stars is None else [stars.h])
    if atlas.curves and not any(map(len, energies)):
        raise ValueError("there is nothing to draw: velocities are those at zero displacement, where no orbit of these families starts")
    refuse_empty(energies)
    x_limits = logarithmic_limits(np.concatenate(energies), 0.04)
    left_out = len({curve.family for curve in atlas.curves}) - len({curve.family for curve in curves})
    with picture_settings():
        figure = new_figure(7.2)
        figure.suptitle(title(atlas, "Families of periodic orbits"))
        panels = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        drawn = []
        for axes, k in zip(panels, chosen, strict=True):
            of_panel = [Named(curve, curve.h, curve.velocities[:, k], np.zeros(len(curve.h) - 1, dtype=bool)) for curve in curves]
            values = [curve.y for curve in of_panel] + [path[:, 1] for path in manifold_paths(atlas, k)]
            values += [] if stars is None else [stars.velocities[:, k]]
            axes.set_label(f"velocity{k}")
            energy_axis(axes, atlas, x_limits)
            symbol = f"{velocity_symbol(system.coordinates[k])}(0)"
            linear_axis(axes, "y", linear_limits(np.concatenate(values), 0.05), 6, "start velocity", symbol)
            drawn.append((axes, k, of_panel, runs_of(of_panel)))
        for axes in panels[:-1]:
            axes.set_xlabel("")
        codes = seen((axes, runs) for axes, _, _, runs in drawn)
        others = manifold_entry("impulsive motions") if len(atlas.manifold_h) else []
        if stars is not None:
            others += star_entry()
        # Which special points have room is known when the panels have their places: the layout leaves room for all of them.
        legend_below(figure, legend_entries(codes, event_types(drawn[0][2])) + others, _COLUMNS, **NOTE)
        settle_layout(figure)
        written: set[str] = set()
        for axes, k, of_panel, runs in drawn:
            name = f"velocity{k}"
            draw_curve(axes, runs, name, FINE)
            draw_manifold_velocity(axes, atlas, k, name)
            spots: list[Box] = []
            if stars is not None:
                place = (stars.h, stars.velocities[:, k])
                (marks,) = axes.plot(*place, zorder=4, **STAR)
                marks.set_gid(f"{name}-impulsive")
                spots = mark_boxes(axes, [], place)
            everything = [curve.path() for curve in of_panel] + manifold_paths(atlas, k)
            spots += draw_some_events(axes, of_panel, everything, spots, name)
            written |= label_curves(axes, names_of(of_panel), everything, spots, most=names)
        legend = legend_below(figure, legend_entries(codes, drawn_types(figure.axes)) + others, _COLUMNS, **NOTE)
        note = f"; {left_out} that do not start at the origin left out" if left_out else ""
        note_named(legend, figure.axes, written, drawn[0][2], note)
    return figure
