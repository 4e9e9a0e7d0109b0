"""The frequency-energy plot of many families."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.diagram.atlas_labels import Named, label_curves, names_of
from branches.diagram.atlas_parts import (
    FINE,
    STAR,
    draw_bounds,
    draw_manifold,
    draw_modes,
    energy_axis,
    frequency_axis,
    frequency_of,
    mark_boxes,
    other_entries,
    refuse_empty,
    runs_of,
    tell_named,
    title,
)
from branches.diagram.files import draw
from branches.diagram.insets import Inset, draw_insets
from branches.diagram.marks import draw_curve, legend_entries, seen
from branches.diagram.scales import logarithmic_limits
from branches.diagram.style import new_figure, picture_settings, settle_layout

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from branches.diagram.atlas_data import Atlas

__all__ = ["MOST_NAMES", "atlas_figure", "draw_atlas"]

FREQUENCIES = ("index", "fundamental")
MOST_NAMES = 60
"""Families named in one picture, at most."""

_INSET_NAMES, _INSET_FAR = 12, 26.0


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
        Parts of the plane shown larger, where they cover least.
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
        raise ValueError(f"unknown frequency {frequency!r}: expected index or fundamental")
    curves = [Named(curve, curve.h, *frequency_of(curve, frequency)) for curve in atlas.curves]
    stars = None if atlas.impulsive is None else (atlas.impulsive.h, frequency_of(atlas.impulsive, frequency)[0])
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
        entries = legend_entries(seen([(axes, runs)]), [])
        entries += other_entries(atlas, modes, stars is not None)
        named = names_of(curves) if curves else _star_names(atlas, stars)
        figure.legend(handles=entries, loc="outside lower center", ncols=min(3, len(entries)), frameon=False)
        settle_layout(figure)
        everything = [curve.path() for curve in curves]

        def content(panel: Axes, name: str) -> None:
            draw_curve(panel, runs, name, FINE)
            draw_modes(panel, modes, name)
            draw_manifold(panel, atlas, name)
            if stars is not None:
                (marks,) = panel.plot(*stars, zorder=4, **STAR)
                marks.set_gid(f"{name}-impulsive")

        content(axes, "frequency")
        keep_off = draw_bounds(axes, atlas) + mark_boxes(axes, modes, stars)
        everything += [np.array([[axes.get_xlim()[0], mode.frequency], [mode.h, mode.frequency]]) for mode in modes]
        everything.append(np.stack([atlas.manifold_h, atlas.manifold_frequency], axis=1))
        drawn = draw_insets(axes, insets, everything, content, keep_off)
        keep_off += [box for detail in drawn for box in (detail.box, detail.letter_box)]
        of_modes = _mode_names(axes, modes)
        frame = axes.get_ylim()
        lines = [*everything, *(detail.frame for detail in drawn), *(np.array([[b.h, frame[0]], [b.h, frame[1]]]) for b in atlas.bounds)]
        written = label_curves(axes, named, lines, keep_off, most=names, always=of_modes)
        known = {name.key for name in named}
        for detail in drawn:
            spots = [*mark_boxes(detail.axes, modes, stars), detail.inner_letter_box]
            inside = names_of(curves, detail.axes)
            new = [name for name in inside if name.key not in written][max(0, names - len(written & known)) :]
            inside = [name for name in inside if name not in new]
            written |= label_curves(detail.axes, inside, everything, spots, most=_INSET_NAMES, far=_INSET_FAR, detail=True)
        tell_named(axes, written, curves or named)
    return figure


def _star_names(atlas: Atlas, stars: tuple[np.ndarray, np.ndarray] | None) -> list[Named]:
    """The names of the periodic impulsive orbits, for a picture without families."""
    if atlas.impulsive is None or stars is None:
        return []
    return [Named.point(str(label), float(x), float(y)) for label, x, y in zip(atlas.impulsive.labels, *stars, strict=True) if label]


def _mode_names(axes: Axes, modes: Sequence[Any]) -> list[Named]:
    """The names of the linear modes, which may point to any place of their lines."""
    left = axes.get_xlim()[0]
    out = []
    for mode in modes:
        if mode.h > left:
            energies = np.geomspace(left, mode.h, 20)
            out.append(Named(None, energies, np.full(20, mode.frequency), np.zeros(19, dtype=bool), mode.label))
    return out
