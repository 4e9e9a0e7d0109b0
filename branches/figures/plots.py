"""Plots of branches, orbits and motions on the axes of a user's own figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures.atlas import frequency_curve, runs_of
from branches.figures.atlas_data import atlas_of
from branches.figures.curves import curve_runs, draw_curve, draw_events
from branches.figures.single import FREQUENCIES, draw_displacements, frequency_panel, panel_curve, sampled_orbit
from branches.figures.style import limits_of, set_axis
from bvp.texts import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.orbit import Orbit
    from bvp.motion import Motion

__all__ = ["plot_branch", "plot_catalogue", "plot_motion", "plot_orbit"]

_SAMPLES = 4000


def plot_branch(branch: Branch, ax: Axes | None = None, *, frequency: str = "index", events: bool = True) -> Axes:
    """Draw the frequency-energy curve of a branch: stable parts solid, unstable ones thin with crosses, undecided ones dotted.

    Parameters
    ----------
    branch : Branch
    ax : matplotlib Axes, optional
        By default the axes of a new pyplot figure.
    frequency : {"index", "fundamental"}
        m 2 pi/T, broken where m changes, or 2 pi/T; in radians a unit of time.
    events : bool
        Whether the events have markers; by default they do.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    ValueError
        For another frequency.
    """
    _check(frequency)
    panel = frequency_panel(branch, frequency)
    ax = _energy_axes(ax, branch.points["h"], panel.values, panel.axis, panel.symbol)
    curve = panel_curve(branch, panel, wide=True)
    draw_curve(ax, curve_runs(curve.stable, curve.x, curve.y, curve.breaks), "frequency")
    if events and branch.events:
        places = np.stack([[event.h for event in branch.events], panel.event_values], axis=1)
        draw_events(ax, [event.type for event in branch.events], places, "frequency")
    return ax


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
    _check(frequency)
    rows = catalogue.families(**filters)
    if not rows:
        raise ValueError(f"{catalogue.path} has no family that fits: nothing to plot")
    atlas = atlas_of(catalogue.system, [catalogue.branch(row.id) for row in rows])
    curves = [frequency_curve(curve, frequency) for curve in atlas.curves]
    name, symbol = ("frequency index", r"m\,2\pi/T") if frequency == "index" else ("frequency", r"2\pi/T")
    ax = _energy_axes(ax, np.concatenate([curve.x for curve in curves]), np.concatenate([curve.y for curve in curves]), name, symbol)
    draw_curve(ax, runs_of(curves), "frequency", 0.6)
    return ax


def plot_orbit(orbit: Orbit, ax: Axes | None = None) -> Axes:
    """Draw the displacements of an orbit over one period, with its impacts.

    Parameters
    ----------
    orbit : Orbit
    ax : matplotlib Axes, optional
        By default the axes of a new pyplot figure.

    Returns
    -------
    matplotlib Axes
    """
    times, u, _ = sampled_orbit(orbit)
    return _displacements(ax, orbit, times, u, np.array([impact.time for impact in orbit.impacts]))


def plot_motion(motion: Motion, ax: Axes | None = None) -> Axes:
    """Draw the displacements of a motion over time, with its impacts.

    Parameters
    ----------
    motion : Motion
    ax : matplotlib Axes, optional
        By default the axes of a new pyplot figure.

    Returns
    -------
    matplotlib Axes
    """
    times = np.unique(np.concatenate([np.linspace(0.0, motion.duration, _SAMPLES), motion.times]))
    return _displacements(ax, motion, times, motion.sample(times)[0], motion.stop_events.times)


def _displacements(ax: Axes | None, source: Orbit | Motion, times: np.ndarray, u: np.ndarray, impacts: np.ndarray) -> Axes:
    at = source.sample(impacts)[0] if len(impacts) else np.empty((0, u.shape[1]))
    ax = _axes_or_new(ax)
    draw_displacements(ax, source.system, times, u, impacts, at)
    set_axis(ax, "x", (0.0, float(times[-1])), 8, "time", "t")
    return ax


def _energy_axes(ax: Axes | None, h: np.ndarray, values: np.ndarray, name: str, symbol: str) -> Axes:
    """Axes with energies on a logarithmic axis. Their limits grow where something is drawn already."""
    wide = [limits_of(h, log=True), limits_of(values)]
    ax = _axes_or_new(ax)
    if ax.has_data():
        wide = [(min(a, b), max(c, d)) for (a, c), (b, d) in zip(wide, (ax.get_xlim(), ax.get_ylim()), strict=True)]
    set_axis(ax, "x", wide[0], 8, "energy", "h", log=True)
    set_axis(ax, "y", wide[1], 6, name, symbol)
    return ax


def _axes_or_new(ax: Axes | None) -> Axes:
    if ax is not None:
        if not hasattr(ax, "plot"):
            raise TypeError(f"ax is {shown(ax)}, expected matplotlib axes")
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def _check(frequency: str) -> None:
    if frequency not in FREQUENCIES:
        raise ValueError(f"unknown frequency {shown(frequency)}: expected {' or '.join(FREQUENCIES)}")
