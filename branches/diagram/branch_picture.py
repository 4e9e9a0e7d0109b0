"""The picture of a branch: its frequency-energy plot, and two start velocities (or displacements) against energy."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from branches.diagram.files import draw
from branches.diagram.legends import legend_below
from branches.diagram.marks import curve_runs, draw_curve, draw_events, label_events, legend_entries, seen
from branches.diagram.scales import linear_axis, linear_limits, logarithmic_axis, logarithmic_limits
from branches.diagram.smooth import Curve, smooth
from branches.diagram.style import new_figure, picture_settings, settle_layout
from branches.diagram.titles import family_text, symbol_of, system_text, velocity_symbol
from bvp.shown import shown as in_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FREQUENCIES = ("index", "fundamental")
_WIDE, _NARROW = (470.0, 170.0), (210.0, 130.0)  # panels in points (1/72 inch), nearly
_MANY_FOLD = 20.0  # frequencies that rise by more than this get a logarithmic axis too: the low ones would be one line


@dataclass(frozen=True, eq=False)
class _Panel:
    """One panel's data: values (N,) over the points and (E,) over the events, where the curve breaks, and the axis text."""

    name: str
    values: np.ndarray
    event_values: np.ndarray
    breaks: np.ndarray
    words: str
    symbol: str
    note: str = ""


def draw_branch(
    branch: Any, path_or_file: str | os.PathLike[str] | IO[bytes], *, frequency: str = "index", format: str | None = None
) -> None:
    """Write the picture of a branch to a png, pdf or svg file.

    Parameters
    ----------
    branch : Branch
    path_or_file : path, or binary file open for writing
    frequency : "index" (m 2 pi/T, the paper's axis, broken where m changes) or "fundamental" (2 pi/T)
    format : "png", "pdf" or "svg"; by default what the file's name ends with

    Raises
    ------
    ValueError
        For another format or frequency, and for energies that a logarithmic axis cannot show.
    OSError
        When the file cannot be written.

    Notes
    -----
    The frequency-energy plot and its index are those of Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009)
    1868, Figs. 6 and 8.
    """
    draw(lambda: branch_figure(branch, frequency=frequency), path_or_file, format)


def branch_figure(branch: Any, *, frequency: str = "index") -> Figure:
    """The picture of a branch as a matplotlib figure.

    Parameters
    ----------
    branch : Branch
    frequency : "index" (m 2 pi/T) or "fundamental" (2 pi/T)

    Returns
    -------
    matplotlib.figure.Figure
        With a frequency-energy plot (its frequency axis is logarithmic as well where frequencies rise more than
        twentyfold) and, for each of two coordinates (one, if the system has one), its start velocity
        against energy - the start displacement where no start of the branch has zero displacement.

    Raises
    ------
    ValueError
        For another frequency, a branch without points, and energies that a logarithmic axis cannot show.
    """
    if frequency not in FREQUENCIES:
        raise ValueError(f"unknown frequency {in_words(frequency)}: expected index or fundamental")
    energies = np.asarray(branch.points["h"], dtype=float)
    if not len(energies):
        raise ValueError("the branch has no points to draw")
    if not energies.min() > 0:
        raise ValueError(f"the logarithmic energy axis needs positive energies: the lowest is {energies.min():.6g}")
    panels = [_frequency_panel(branch, frequency), *_start_panels(branch)]
    with picture_settings():
        figure = new_figure(5.4)
        figure.suptitle(f"{family_text(branch.label, branch.ends, branch.word)}   ({system_text(branch.system)})")
        layout: list[Any] = [["frequency"] * (len(panels) - 1), [panel.name for panel in panels[1:]]]
        axes = figure.subplot_mosaic(layout, height_ratios=[1.25, 1.0])
        event_energies = np.array([event.h for event in branch.events], dtype=float)
        kinds = [event.type for event in branch.events]
        curves = {panel.name: _curve(branch, panel, wide=k == 0 or len(panels) == 2) for k, panel in enumerate(panels)}
        runs = {name: curve_runs(curve.stable, curve.x, curve.y, curve.breaks) for name, curve in curves.items()}
        for panel in panels:
            wide = panel.name == "frequency" or len(panels) == 2
            logarithmic_axis(axes[panel.name], "x", logarithmic_limits(energies), 14 if wide else 7, "energy", "h")
            margin = (0.18 if wide else 0.22) if kinds else 0.08  # room for a name above and below
            shown = np.concatenate([panel.values, panel.event_values])
            if panel.name == "frequency" and np.nanmax(shown) > _MANY_FOLD * np.nanmin(shown) > 0:
                limits = logarithmic_limits(shown, margin)
                logarithmic_axis(axes[panel.name], "y", limits, 5, panel.words, panel.symbol)
            else:
                limits = linear_limits(shown, margin)
                linear_axis(axes[panel.name], "y", limits, 5, panel.words, panel.symbol)
            if panel.note:
                axes[panel.name].set_ylabel(axes[panel.name].get_ylabel() + panel.note)
        entries = legend_entries(seen((axes[panel.name], runs[panel.name]) for panel in panels), kinds)
        columns = -(-len(entries) // -(-len(entries) // 6))
        legend = legend_below(figure, entries, columns)
        if kinds:
            legend.set_title(" ")  # room for the words below
        settle_layout(figure)
        left_out = names_in_all = 0
        for panel in panels:
            draw_curve(axes[panel.name], runs[panel.name], panel.name)
            draw_events(axes[panel.name], kinds, event_energies, panel.event_values, panel.name)
            names = [event.id for event in branch.events]
            drawn = curves[panel.name]
            line = drawn.x, drawn.y, drawn.breaks
            missing, count = label_events(axes[panel.name], names, kinds, event_energies, panel.event_values, line)
            left_out, names_in_all = left_out + missing, names_in_all + count
        if left_out:
            legend.set_title(f"{left_out} of {names_in_all} names have no room")
    return figure


def _curve(branch: Any, panel: _Panel, *, wide: bool) -> Curve:
    """The curve of a panel as it is drawn: smooth, and after a break from where the piece before it ended."""
    points = branch.points
    x, arclength = np.asarray(points["h"], dtype=float), np.asarray(points["arclength"], dtype=float)
    stable, y, at = np.asarray(points["stable"]).astype(int), panel.values, np.flatnonzero(panel.breaks)
    breaks = panel.breaks
    if at.size:
        # The index jumps at the point before the break, whose frequency the next piece has with its own m.
        turned = y[at] * points["half_waves"][at + 1] / points["half_waves"][at]
        x, stable, arclength = (np.insert(column, at + 1, column[at]) for column in (x, stable, arclength))
        y = np.insert(y, at + 1, turned)
        breaks = np.insert(breaks, at + 1, False)
    return smooth(Curve(x, y, stable, breaks), arclength, _WIDE if wide else _NARROW)


def _along(branch: Any, values: np.ndarray) -> np.ndarray:
    """The values (N,) of a quantity at the branch's events: linear in arclength, so a marker is on the drawn curve."""
    arclength = np.asarray(branch.points["arclength"], dtype=float)
    at = np.array([event.arclength for event in branch.events], dtype=float)
    nearest = np.array([event.point for event in branch.events], dtype=int)
    finite = np.isfinite(values)
    if not len(at) or not finite.any():
        return np.full(len(at), np.nan)
    between = np.interp(at, arclength[finite], values[finite])
    exact = np.abs(arclength[nearest] - at) <= 1e-12 * np.maximum(1.0, np.abs(at))
    return np.where(exact & finite[nearest], values[nearest], between)


def _frequency_panel(branch: Any, frequency: str) -> _Panel:
    points = branch.points
    turns = np.asarray(points["half_waves"])
    fundamental = np.asarray(points["frequency"], dtype=float)
    nearest = np.array([event.point for event in branch.events], dtype=int)
    at_events = _along(branch, fundamental)
    if frequency == "fundamental":
        return _Panel("frequency", fundamental, at_events, np.zeros(len(turns) - 1, dtype=bool), "frequency", r"2\pi/T")
    index = np.asarray(points["frequency_index"], dtype=float)
    return _Panel("frequency", index, turns[nearest] * at_events, np.diff(turns) != 0, "frequency index", r"m\,2\pi/T")


def _start_panels(branch: Any) -> list[_Panel]:
    """Panels of the absorber's and the primary's start velocities; of the start displacements if no start is at u = 0."""
    system = branch.system
    chosen = [system.absorber, system.primary]
    if None in chosen:
        chosen = list(range(min(2, len(system.coordinates))))
    values, words, note = np.asarray(branch.points["velocities"], dtype=float), "start velocity", ""
    symbol = velocity_symbol
    if not np.isfinite(values).any():
        values, words = np.asarray(branch.points["start_u"], dtype=float), "start displacement"
        symbol = symbol_of
        note = "\n(no start has zero displacement)"
    unbroken = np.zeros(len(values) - 1, dtype=bool)
    return [
        _Panel(f"start{k}", values[:, k], _along(branch, values[:, k]), unbroken, words, f"{symbol(name)}(0)", note)
        for k, name in ((k, system.coordinates[k]) for k in chosen)
    ]
