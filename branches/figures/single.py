"""The figures of one branch and of one orbit, and their plots on the axes of a user's own figure.

The figure of a branch has its frequency-energy plot, and two start velocities (or displacements) against energy. That of an orbit has its
displacements and gaps over a period, and its path in the configuration plane with the walls.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.figures import style
from branches.figures.curves import FREQUENCIES, MANY_FOLD, curve_runs, draw_curve, draw_events, frequency_rows, legend_entries, smooth
from branches.figures.harmonics import COLUMNS, draw_harmonics, harmonic_layout
from branches.figures.room import Room
from branches.harmonics import harmonics_in
from bvp.texts import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from branches.branch import Branch
    from branches.orbit import Orbit
    from bvp.motion import Motion

_FAR, _BESIDE = 150.0, 4.5  # distances of names from their markers, in points: largest, and without a leader
_NEAR = 2.5  # successive special points, each this near to the one before (points), share one text
_LETTERS = 24  # in a line of a text for several points


class _Panel(NamedTuple):
    """One panel: its curve (k, 2), the pieces of it by stability, the places (E, 2) of the events, and the text of its axis."""

    name: str
    curve: np.ndarray
    runs: dict[int, np.ndarray]
    events: np.ndarray
    axis: str
    symbol: str
    note: str = ""


def branch_figure(branch: Any, *, frequency: str = "index") -> Figure:
    """The figure of a branch (Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Figs. 6 and 8).

    Parameters
    ----------
    branch : Branch
    frequency : "index" (m 2 pi/T) or "fundamental" (2 pi/T)

    Returns
    -------
    matplotlib.figure.Figure
        With a frequency-energy plot (its frequency axis is logarithmic as well where frequencies rise more than
        twentyfold) and, for each of two coordinates (one, if the system has one), its start velocity
        against energy - the start displacement where no start of the branch has zero displacement. With the columns
        of `branches.harmonics` it has the harmonics of each coordinate, too.

    Raises
    ------
    ValueError
        For another frequency, a branch without points, and energies that a logarithmic axis cannot show.
    """
    energies = branch.points["h"]
    if not len(energies):
        raise ValueError("the branch has no points to draw")
    limits = style.limits_of(energies, log=True)
    panels = _panels(branch, frequency)
    names, kinds = [event.id for event in branch.events], [event.type for event in branch.events]
    hollow = _hollow(branch)
    with style.figure_settings():
        known = harmonics_in(branch)
        content: list[Any] = harmonic_layout(list(known))
        figure = style.new_figure(5.4 + 2.2 * len(content))
        figure.suptitle(f"{style.family_text(branch.label, branch.ends, branch.sequence)}   ({style.system_text(branch.system)})")
        starts: Any = [panel.name for panel in panels[1:] for _ in range(COLUMNS // (len(panels) - 1))]
        mosaic = figure.subplot_mosaic([["frequency"] * COLUMNS, starts, *content], height_ratios=[1.25, 1.0, *[1.0] * len(content)])
        if known:
            amplitudes = np.stack(list(known.values()), axis=2)
            draw_harmonics(mosaic, list(known), [(energies, amplitudes)], limits, ("energy", "h"), log=True)
        for panel in panels:
            axes, wide = mosaic[panel.name], panel.name == "frequency" or len(panels) == 2
            style.set_axis(axes, "x", limits, 14 if wide else 7, "energy", "h", log=True)
            margin = (0.18 if wide else 0.22) if kinds else 0.08  # room for a name above and below
            values = panel.curve[:, 1]
            log = panel.name == "frequency" and bool(np.nanmax(values) > MANY_FOLD * np.nanmin(values))
            style.set_axis(axes, "y", style.limits_of(values, margin, log=log), 5, panel.axis, panel.symbol, log=log)
            axes.set_ylabel(axes.get_ylabel() + panel.note)
        entries = legend_entries({code for panel in panels for code in panel.runs}, kinds, any(hollow))
        columns = -(-len(entries) // -(-len(entries) // 6))
        legend = style.legend_below(figure, entries, columns, title=" " if kinds else None)  # space for the text below
        left_out = in_all = 0
        for panel in panels:
            axes = mosaic[panel.name]
            draw_curve(axes, panel.runs, panel.name)
            draw_events(axes, kinds, panel.events, panel.name, hollow, clip_on=False)
            missing, count = write_events(Room(axes, [panel.curve]), names, kinds, panel.events)
            left_out, in_all = left_out + missing, in_all + count
        if left_out:
            legend.set_title(f"{left_out} of {in_all} names have no room")
    return figure


def _hollow(branch: Any) -> list[bool]:
    """Whether the marker of each event is hollow."""
    return [event.criticality == "subcritical" for event in branch.events]


def write_events(room: Room, names: Sequence[str], kinds: Sequence[str], places: np.ndarray) -> tuple[int, int]:
    """Write the names of special points at places (E, 2); those that are not finite are left out.

    Successive points that are nearly in one place share a text: their names, or GR1-12 for three or more of one type.

    Returns
    -------
    (int, int)
        How many texts have no room, and how many there are.
    """
    shown = np.flatnonzero(np.isfinite(places).all(axis=1)).tolist()
    at = room.to_page(places[shown])
    radii = np.array([0.5 * style.EVENT_LOOKS[kinds[i]]["markersize"] + 0.5 for i in shown])
    room.take(at, radii[:, None])
    texts, middles = [], []
    for crowd in np.split(np.arange(len(at)), np.flatnonzero(np.hypot(*np.diff(at, axis=0).T) > _NEAR) + 1):
        of_kinds: dict[str, list[str]] = {}
        for i in (shown[k] for k in crowd):
            of_kinds.setdefault(kinds[i], []).append(names[i])
        parts = [
            f"{some[0]}\N{EN DASH}{some[-1].removeprefix(kind)}" if len(some) > 2 else ", ".join(some) for kind, some in of_kinds.items()
        ]
        if parts:
            texts.append(textwrap.fill(", ".join(parts), _LETTERS))
            middles.append(crowd[len(crowd) // 2])
    waiting = np.arange(len(texts))
    for over_curves in (False, True):
        rows = np.array(middles, dtype=int)[waiting]
        done = room.write([texts[i] for i in waiting], at[rows], radii[rows], far=_FAR, beside=_BESIDE, over_curves=over_curves)
        waiting = waiting[[text is None for text in done]]
    return len(waiting), len(texts)


def _shown_coordinates(system: Any) -> list[int]:
    """Absorber and primary, or else the first coordinates: two, or the only one."""
    chosen = [system.absorber, system.primary]
    return list(range(min(2, len(system.coordinates)))) if None in chosen else chosen


def _panels(branch: Any, frequency: str) -> list[_Panel]:
    """The frequency-energy plot, and the start velocities of absorber and primary: their start displacements if no start is at u = 0."""
    system, points = branch.system, branch.points
    chosen = _shown_coordinates(system)
    moving = bool(np.isfinite(points["velocities"]).any())
    start = ("start velocity", "") if moving else ("start displacement", "\n(no start has zero displacement)")
    rows, values = frequency_rows(frequency, points["half_waves"], points["frequency"])
    drawn: list[tuple[Any, ...]] = [("frequency", rows, values, *FREQUENCIES[frequency], "")]
    for k in chosen:
        values = points["velocities" if moving else "start_u"][:, k]
        symbol = f"{style.symbol_of(system.coordinates[k], velocity=moving)}(0)"
        drawn.append((f"start{k}", np.arange(len(values)), values, start[0], symbol, start[1]))
    panels = []
    for name, rows, values, *texts in drawn:
        places = np.stack([points["h"][rows], values], axis=1)
        curve = smooth(places, points["arclength"][rows])
        events = places[np.searchsorted(rows, [event.point for event in branch.events])].reshape(-1, 2)
        panels.append(_Panel(name, curve, curve_runs(curve, points["stable"][rows]), events, *texts))
    return panels


_EVEN, _IN_FLIGHT = 2400, 48  # samples over the period, nearly, and at least these in each flight
_FAR_WALL = 1.0  # a wall further than this many widths of the motion from it is named, not shown
_WIDEN = 3.0  # both axes of the plane get one scale if that widens neither more than so
_IMPACT: dict[str, Any] = {"marker": "o", "markersize": 3.6, "mfc": "white", "mec": style.BLACK, "mew": 0.6}
_ABOVE: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "frameon": False, "borderaxespad": 0.2}


def orbit_figure(orbit: Any, *, name: str = "") -> Figure:
    """The figure of an orbit (Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Figs. 7 and 9).

    Parameters
    ----------
    orbit : Orbit
    name : str
        The label that its family is called by, if it is not that of the orbit.

    Returns
    -------
    matplotlib.figure.Figure
        Left: all displacements over one period, and below them the gap coordinate of each stop between its walls. Right: the
        configuration plane of absorber and primary (else of the first two coordinates) with the walls that depend on these
        two alone; for one degree of freedom the phase plane.
    """
    system = orbit.system
    times, u, v = _sampled_orbit(orbit)
    at = np.array([impact.time for impact in orbit.impacts])
    u_at = orbit.sample(at)[0]
    rows = 1 + len(system.stops)
    with style.figure_settings():
        figure = style.new_figure(1.3 + 1.3 * max(rows, 2))
        figure.suptitle(_title(orbit, name))
        layout: list[Any] = [["displacement", "plane"], *([f"stop{k}", "plane"] for k in range(len(system.stops)))]
        axes = figure.subplot_mosaic(layout, width_ratios=[1.35, 1.0])
        _draw_displacements(axes["displacement"], orbit, times, u, at)
        for k, stop in enumerate(system.stops):
            mine = np.array([len(system.stops) == 1 or impact.stop.rstrip("+-") == stop.name for impact in orbit.impacts], dtype=bool)
            gap = np.asarray(stop.gap, dtype=float)
            _draw_gap(axes[f"stop{k}"], stop, system, times, u @ gap, at[mine], u_at[mine] @ gap)
        left = ["displacement", *(f"stop{k}" for k in range(len(system.stops)))]
        for name in left:
            style.set_axis(axes[name], "x", (0.0, float(orbit.period)), 6, "time", "t")
        for name in left[:-1]:
            axes[name].set_xlabel("")
            axes[name].tick_params(labelbottom=False)
        _draw_plane(axes["plane"], system, u, v, u_at)
    return figure


def orbits_figure(orbits: Sequence[tuple[str, Any]]) -> Figure:
    """The figure of several orbits (Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Figs. 27 to 30).

    Parameters
    ----------
    orbits : sequence of (str, Orbit)
        Each with the name of its family, or "" for its label.

    Returns
    -------
    matplotlib.figure.Figure
        For each orbit its displacements over a period, and its path in the configuration plane with the walls.
    """
    rows = -(-len(orbits) // 2)
    with style.figure_settings():
        figure = style.new_figure(0.6 + 1.75 * rows)
        figure.suptitle(f"Periodic orbits   ({style.system_text(orbits[0][1].system)})")
        panels = figure.subplots(rows, 4, squeeze=False, width_ratios=[1.5, 1.0, 1.5, 1.0]).reshape(-1, 2)
        for k, (name, orbit) in enumerate(orbits):
            series, plane = panels[k]
            times, u, v = _sampled_orbit(orbit)
            at = np.array([impact.time for impact in orbit.impacts])
            _draw_displacements(series, orbit, times, u, at)
            _draw_plane(plane, orbit.system, u, v, orbit.sample(at)[0], "scales differ")
            handles = [handle for axes in (series, plane) for handle in axes.get_legend().legend_handles]
            for axes, kind in ((series, "series"), (plane, "plane")):
                axes.get_legend().remove()
                axes.set_label(f"{kind}-{k}")
                axes.tick_params(axis="x", pad=6.0)  # below the text of a tick of the other axis in the corner
            style.set_axis(series, "x", (0.0, float(orbit.period)), 4, "time", "t")
            called, place, stable = _parts(orbit, name)
            series.set_title(f"({chr(97 + k % 26)})  {called},  {place},  {stable}", loc="left", fontsize=style.SMALL, pad=6)
        for axes in panels[len(orbits) :].ravel():
            axes.remove()
        style.legend_below(figure, handles, 9)
    return figure


def _sampled_orbit(orbit: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (k,), displacements and velocities (k, n) over one period, with both sides of each impact, so kinks are sharp."""
    ends = np.unique([0.0, *(impact.time for impact in orbit.impacts), orbit.period])
    count = max(_IN_FLIGHT, _EVEN // (len(ends) - 1))
    flights = [np.linspace(a, b - 1e-12 * orbit.period, count) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    times = np.concatenate([*flights, ends[-1:]])
    return times, *orbit.sample(times)


def _title(orbit: Any, name: str = "") -> str:
    called, place, stable = _parts(orbit, name)
    return f"{called}:  {place},  {stable}   ({style.system_text(orbit.system)})"


def _parts(orbit: Any, name: str) -> tuple[str, str, str]:
    """What the orbit is called, where it is, and its stability."""
    stable = {1: "stable", 0: "unstable"}.get(orbit.stable, "stability undecided")
    if not orbit.quality.get("reliable", True):
        stable += " (multipliers not reliable)"
    family = style.family_text(orbit.label, orbit.ends, orbit.sequence)
    if name and name != orbit.label:
        from branches.naming.labels import parse
        from branches.naming.matching import matches

        counted = "" if orbit.label and matches(parse(name), parse(orbit.label)) else f" (counted {family})"
        family = style.family_text(name, orbit.ends, orbit.sequence) + counted
    return family, rf"$h = {orbit.h:.8g}$,  $\alpha = {orbit.alpha:.8g}$", stable


def _mark_impacts(axes: Axes, x: np.ndarray, y: np.ndarray, name: str) -> None:
    if not len(x):
        return  # an empty line that is not clipped would count as ink at the figure's corner
    look = _IMPACT if len(x) <= 40 else {**_IMPACT, "markersize": 2.0}
    axes.plot(x, y, linestyle="none", zorder=4, clip_on=False, gid=f"{name}-impacts", **look)


def _draw_displacements(axes: Axes, source: Any, times: np.ndarray, u: np.ndarray, at: np.ndarray) -> Axes:
    """Draw displacements (k, n) of an orbit or motion over time, with impacts at some times, and set the axes."""
    from matplotlib.lines import Line2D

    u_at = source.sample(at)[0]
    for k, name in enumerate(source.system.coordinates):
        dashes = "-" if k < len(style.LINES) else "--"
        look: dict[str, Any] = {"color": style.LINES[k % len(style.LINES)], "label": f"${style.symbol_of(name)}$", "linewidth": 1.1}
        axes.plot(times, u[:, k], dashes, gid=f"displacement-{k}", **look)
        _mark_impacts(axes, at, u_at[:, k], f"displacement-{k}")
    axes.axhline(0.0, color=style.GREY, linewidth=0.4, zorder=1)
    style.set_axis(axes, "y", style.limits_of(u, 0.1), 5, "displacement", "u")
    handles = axes.get_legend_handles_labels()[0]
    if len(at):
        handles.append(Line2D([], [], label="impact", linestyle="none", **_IMPACT))
    axes.legend(handles=handles, ncols=min(len(handles), 9), **_ABOVE)
    style.set_axis(axes, "x", (0.0, float(times[-1])), 8, "time", "t")
    return axes


def _draw_gap(axes: Axes, stop: Any, system: Any, times: np.ndarray, gap: np.ndarray, at: np.ndarray, gap_at: np.ndarray) -> None:
    low, high = float(gap.min()), float(gap.max())
    width = max(high - low, 1e-9 * max(abs(low), abs(high)), 1e-300)
    bounds = [bound for bound in (stop.lower, stop.upper) if np.isfinite(bound)]
    near = [b for b in bounds if low - _FAR_WALL * width <= b <= high + _FAR_WALL * width]
    limits = style.limits_of(np.array([low, high, *near]), 0.14)
    name = f"gap-{stop.name}"
    for bound in near:
        away = limits[1] if bound == stop.upper else limits[0]
        axes.axhspan(bound, away, facecolor=style.PALE, edgecolor="none", zorder=1)
        axes.axhline(bound, color=style.BLACK, linewidth=1.2, zorder=2).set_gid(f"{name}-wall")
    axes.plot(times, gap, color=style.BLUE, linewidth=1.1, zorder=3, gid=name)
    _mark_impacts(axes, at, gap_at, name)
    axis = "relative displacement\n" if np.count_nonzero(stop.gap) > 1 else "displacement\n"
    style.set_axis(axes, "y", limits, 4, axis, style.gap_symbol(stop.gap, system.coordinates))
    far = [b for b in bounds if b not in near]
    if far:
        walls = " and ".join(f"{b:.6g}".replace("-", "\N{MINUS SIGN}") for b in far)
        axes.set_title(f"wall at {walls} is out of view", fontsize=style.SMALL, loc="right", pad=2)


def _draw_plane(
    axes: Axes, system: Any, u: np.ndarray, v: np.ndarray, u_at: np.ndarray, differ: str = "the scales of both axes differ"
) -> None:
    n = len(system.coordinates)
    pair = (system.absorber, system.primary)
    i, j = (0, 0) if n == 1 else (0, 1) if None in pair else pair
    x, y = u[:, i], (v[:, 0] if n == 1 else u[:, j])
    axes.plot(x, y, color=style.BLUE, linewidth=0.9, zorder=3, gid="plane-orbit")
    if n > 1:
        _mark_impacts(axes, u_at[:, i], u_at[:, j], "plane")
    axes.plot(x[:1], y[:1], "D", markersize=4.2, color=style.VERMILION, zorder=5, label="start", linestyle="none", gid="plane-start")
    axes.legend(**_ABOVE)
    limits = style.limits_of(x, 0.12), style.limits_of(y, 0.12)
    style.set_axis(axes, "x", limits[0], 5, "", style.symbol_of(system.coordinates[i]))
    style.set_axis(axes, "y", limits[1], 5, "", style.symbol_of(system.coordinates[j], velocity=n == 1))
    for stop in system.stops:
        gap = np.asarray(stop.gap, dtype=float)
        if not np.any(np.delete(gap, [i, j])):  # a stop that depends on other coordinates is no line in this plane
            normal = np.array([gap[i], 0.0 if n == 1 else gap[j]])
            _draw_wall(axes, normal, stop.upper, 1.0, limits, stop.name)
            _draw_wall(axes, normal, stop.lower, -1.0, limits, stop.name)
    axes.set_xlim(*limits[0], auto=True)  # or matplotlib would report that one scale changes them
    axes.set_ylim(*limits[1], auto=True)
    if n > 1:
        wide, high = np.ptp(limits[0]), np.ptp(limits[1])
        if max(wide / high, high / wide) <= _WIDEN:
            axes.set_aspect("equal", adjustable="datalim")
        else:
            axes.set_xlabel(f"{axes.get_xlabel()}\n{differ}")


def _draw_wall(axes: Axes, normal: np.ndarray, bound: float, side: float, limits: Sequence[tuple[float, float]], name: str) -> None:
    """Draw the line normal . x = bound, and shade what lies behind it; the frame cuts both off."""
    if not np.isfinite(bound) or not normal.any():
        return
    foot = normal * bound / (normal @ normal)
    unit = normal / np.hypot(*normal)
    reach = 9.0 * np.hypot(*np.abs(limits).max(axis=1)) + 2.0 * np.hypot(*foot)
    wall = foot + reach * np.outer((-1.0, 1.0), (-unit[1], unit[0]))
    behind = np.concatenate([wall, wall[::-1] + side * reach * unit])
    axes.fill(*behind.T, facecolor=style.PALE, edgecolor="none", zorder=1)
    axes.plot(*wall.T, color=style.BLACK, linewidth=1.2, zorder=2, gid=f"plane-wall-{name}")


_SAMPLES = 4000  # of a motion


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
    panel = _panels(branch, frequency)[0]
    ax = energy_axes(ax, panel.curve, panel.axis, panel.symbol)
    draw_curve(ax, panel.runs, "frequency")
    if events:
        draw_events(ax, [event.type for event in branch.events], panel.events, "frequency", _hollow(branch))
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
    times, u, _ = _sampled_orbit(orbit)
    return _draw_displacements(_axes_or_new(ax), orbit, times, u, np.array([impact.time for impact in orbit.impacts]))


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
    return _draw_displacements(_axes_or_new(ax), motion, times, motion.sample(times)[0], motion.stop_events.times)


def energy_axes(ax: Axes | None, points: np.ndarray, name: str, symbol: str) -> Axes:
    """Axes for points (n, 2), with energies on a logarithmic axis. Their limits grow where something is drawn already."""
    wide = [style.limits_of(points[:, 0], log=True), style.limits_of(points[:, 1])]
    ax = _axes_or_new(ax)
    if ax.has_data():
        wide = [(min(a, b), max(c, d)) for (a, c), (b, d) in zip(wide, (ax.get_xlim(), ax.get_ylim()), strict=True)]
    style.set_axis(ax, "x", wide[0], 8, "energy", "h", log=True)
    style.set_axis(ax, "y", wide[1], 6, name, symbol)
    return ax


def _axes_or_new(ax: Axes | None) -> Axes:
    if ax is not None:
        if not hasattr(ax, "plot"):
            raise TypeError(f"ax is {shown(ax)}, expected matplotlib axes")
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]
