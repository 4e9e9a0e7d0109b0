"""The frequency-energy plot of many families."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.diagram.atlas_labels import Named, label_curves, names_of
from branches.diagram.atlas_parts import (
    FINE,
    NOTE,
    STAR,
    bound_boxes,
    bound_paths,
    draw_bounds,
    draw_manifold,
    draw_modes,
    energy_axis,
    frequency_axis,
    frequency_curve,
    mark_boxes,
    note_named,
    other_entries,
    refuse_empty,
    runs_of,
    title,
)
from branches.diagram.event_room import draw_some_events, drawn_types, event_types
from branches.diagram.files import draw
from branches.diagram.insets import Inset, draw_insets, place_insets
from branches.diagram.legends import legend_below
from branches.diagram.marks import draw_curve, legend_entries, seen
from branches.diagram.scales import logarithmic_limits
from branches.diagram.style import new_figure, picture_settings, settle_layout
from bvp.shown import shown as in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from branches.diagram.atlas_data import Atlas

__all__ = ["MOST_NAMES", "atlas_figure", "draw_atlas"]

FREQUENCIES = ("index", "fundamental")
MOST_NAMES = 60
"""Families named in one picture, at most."""

_INSET_NAMES, _INSET_FAR = 12, 26.0
_COLUMNS = 4  # of the legend, at most


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
    draw(lambda: atlas_figure(atlas, **options), path_or_file, format)


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
        For another frequency, nothing to draw, or an inset outside the picture.
    """
    if frequency not in FREQUENCIES:
        raise ValueError(f"unknown frequency {in_words(frequency)}: expected index or fundamental")
    curves = [frequency_curve(curve, frequency) for curve in atlas.curves]
    impulsive = atlas.impulsive
    stars = None if impulsive is None else (impulsive.h, impulsive.frequency if frequency == "fundamental" else impulsive.frequency_index)
    energies = [curve.x for curve in curves] + [atlas.manifold_h] + ([] if stars is None else [stars[0]])
    heights = [curve.y for curve in curves] + [atlas.manifold_frequency] + ([] if stars is None else [stars[1]])
    refuse_empty(energies)
    low, high = float(min(e.min() for e in energies if len(e))), float(max(e.max() for e in energies if len(e)))
    modes = atlas.thresholds
    x_limits = logarithmic_limits(np.array([low, high, *(mode.h for mode in modes if mode.h < high)]), 0.04)
    shown = np.concatenate([*heights, [mode.frequency for mode in modes if mode.h > x_limits[0]]])
    with picture_settings():
        figure = new_figure(5.6)
        figure.suptitle(title(atlas, "Families of periodic orbits" if curves else "Impulsive motions"))
        axes = figure.subplots()
        axes.set_label("frequency")
        energy_axis(axes, atlas, x_limits)
        frequency_axis(axes, atlas, frequency, shown)
        runs = runs_of(curves)
        codes, others = seen([(axes, runs)]), other_entries(atlas, modes, stars is not None)
        named = names_of(curves) if curves else _star_names(atlas, stars)
        # Which special points have room is known when the panels have their places: the layout leaves room for all of them.
        legend_below(figure, legend_entries(codes, event_types(curves)) + others, _COLUMNS, **NOTE)
        settle_layout(figure)
        everything = [curve.path() for curve in curves]
        everything += [np.array([[axes.get_xlim()[0], mode.frequency], [mode.h, mode.frequency]]) for mode in modes]
        everything.append(np.stack([atlas.manifold_h, atlas.manifold_frequency], axis=1))
        lines = everything + bound_paths(axes, atlas)

        def taken() -> list[Any]:
            return bound_boxes(axes, atlas) + mark_boxes(axes, modes, stars)

        places = place_insets(axes, insets, lines, taken)

        def content(panel: Axes, name: str) -> None:
            draw_curve(panel, runs, name, FINE)
            draw_modes(panel, modes, name)
            draw_manifold(panel, atlas, name)
            if stars is not None:
                (marks,) = panel.plot(*stars, zorder=4, **STAR)
                marks.set_gid(f"{name}-impulsive")

        content(axes, "frequency")
        draw_bounds(axes, atlas)
        drawn = draw_insets(axes, places, everything, content)
        keep_off = taken() + [box for detail in drawn for box in (detail.box, detail.letter_box)]
        keep_off += draw_some_events(axes, curves, everything, keep_off, "frequency")
        of_modes = _mode_names(axes, modes)
        lines += [detail.frame for detail in drawn]
        edges = [edge for detail in drawn for edge in detail.edges]
        written = label_curves(axes, named, lines, keep_off + edges, most=names, always=of_modes)
        known = {name.key for name in named}
        for detail in drawn:
            spots = [*mark_boxes(detail.axes, modes, stars), detail.inner_letter_box]
            spots += draw_some_events(detail.axes, curves, everything, spots, str(detail.axes.get_label()))
            inside = names_of(curves, detail.axes)
            new = [name for name in inside if name.key not in written][max(0, names - len(written & known)) :]
            inside = [name for name in inside if name not in new]
            written |= label_curves(detail.axes, inside, everything, spots, most=_INSET_NAMES, far=_INSET_FAR, detail=True)
        legend = legend_below(figure, legend_entries(codes, drawn_types(figure.axes)) + others, _COLUMNS, **NOTE)
        note_named(legend, figure.axes, written, curves or named)
    return figure


def _star_names(atlas: Atlas, stars: tuple[np.ndarray, np.ndarray] | None) -> list[Named]:
    """The names of the periodic impulsive orbits, for a picture without families."""
    if atlas.impulsive is None or stars is None:
        return []
    labels = atlas.impulsive.labels.tolist()
    more = [f"at {h:.3g}" if labels.count(label) > 1 else "" for label, h in zip(labels, stars[0], strict=True)]
    return [Named.point(*place) for place in zip(labels, *(column.tolist() for column in stars), more, strict=True) if place[0]]


def _mode_names(axes: Axes, modes: Sequence[Any]) -> list[Named]:
    """The names of the linear modes, which may point to any place of their lines."""
    left = axes.get_xlim()[0]
    out = []
    for mode in modes:
        if mode.h > left:
            energies = np.geomspace(left, mode.h, 20)
            out.append(Named(None, energies, np.full(20, mode.frequency), np.zeros(19, dtype=bool), mode.label))
    return out
