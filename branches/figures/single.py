"""The figures of one branch and of one orbit.

The figure of a branch has its frequency-energy plot, and two start velocities (or displacements) against energy. That of an orbit has its
displacements and gaps over a period, and its path in the configuration plane with the walls.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.figures.curves import DrawnCurve, curve_runs, draw_curve, draw_events, legend_entries, smooth, visible_codes
from branches.figures.room import Room
from branches.figures.style import (
    BLACK,
    BLUE,
    GREY,
    LINES,
    PALE,
    SMALL,
    VERMILION,
    event_look,
    family_text,
    figure_settings,
    gap_symbol,
    legend_below,
    limits_of,
    new_figure,
    set_axis,
    settle_layout,
    symbol_of,
    system_text,
)
from bvp.texts import shown as in_message

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FREQUENCIES = ("index", "fundamental")
_WIDE, _NARROW = (470.0, 170.0), (210.0, 130.0)  # panels in points (1/72 inch), nearly
_MANY_FOLD = 20.0  # frequencies that rise by more than this get a logarithmic axis too: the low ones would be one line
_FAR, _BESIDE = 150.0, 4.5  # distances of names from their markers, in points: largest, and without a leader
_CROWD, _CROWD_STEP = 5, 2.5  # this many points, each this near to the one before (points), share one text
_LETTERS = 24  # in a line of a text for several points


class _Panel(NamedTuple):
    """One panel's data: values (N,) over the points and (E,) over the events, where the curve breaks, and the axis text."""

    name: str
    values: np.ndarray
    event_values: np.ndarray
    breaks: np.ndarray
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
        against energy - the start displacement where no start of the branch has zero displacement.

    Raises
    ------
    ValueError
        For another frequency, a branch without points, and energies that a logarithmic axis cannot show.
    """
    if frequency not in FREQUENCIES:
        raise ValueError(f"unknown frequency {in_message(frequency)}: expected index or fundamental")
    energies = np.asarray(branch.points["h"], dtype=float)
    if not len(energies):
        raise ValueError("the branch has no points to draw")
    if not energies.min() > 0:
        raise ValueError(f"the logarithmic energy axis needs positive energies: the lowest is {energies.min():.6g}")
    panels = [frequency_panel(branch, frequency), *_start_panels(branch)]
    event_energies = np.array([event.h for event in branch.events], dtype=float)
    names, kinds = [event.id for event in branch.events], [event.type for event in branch.events]
    with figure_settings():
        figure = new_figure(5.4)
        figure.suptitle(f"{family_text(branch.label, branch.ends, branch.sequence)}   ({system_text(branch.system)})")
        layout: list[Any] = [["frequency"] * (len(panels) - 1), [panel.name for panel in panels[1:]]]
        axes = figure.subplot_mosaic(layout, height_ratios=[1.25, 1.0])
        drawn = []
        for panel in panels:
            wide = panel.name == "frequency" or len(panels) == 2
            set_axis(axes[panel.name], "x", limits_of(energies, log=True), 14 if wide else 7, "energy", "h", log=True)
            margin = (0.18 if wide else 0.22) if kinds else 0.08  # room for a name above and below
            shown = np.concatenate([panel.values, panel.event_values])
            log = bool(panel.name == "frequency" and np.nanmax(shown) > _MANY_FOLD * np.nanmin(shown) > 0)
            set_axis(axes[panel.name], "y", limits_of(shown, margin, log=log), 5, panel.axis, panel.symbol, log=log)
            if panel.note:
                axes[panel.name].set_ylabel(axes[panel.name].get_ylabel() + panel.note)
            curve = panel_curve(branch, panel, wide=wide)
            drawn.append((axes[panel.name], panel, curve, curve_runs(curve.stable, curve.x, curve.y, curve.breaks)))
        entries = legend_entries(visible_codes((axes, runs) for axes, _, _, runs in drawn), kinds)
        columns = -(-len(entries) // -(-len(entries) // 6))
        legend = legend_below(figure, entries, columns, title=" " if kinds else None)  # space for the texts below
        settle_layout(figure)
        left_out = names_in_all = 0
        for panel_axes, panel, curve, runs in drawn:
            draw_curve(panel_axes, runs, panel.name)
            places = np.stack([event_energies, panel.event_values], axis=1)
            draw_events(panel_axes, kinds, places, panel.name, clip_on=False)
            path = np.insert(np.stack([curve.x, curve.y], axis=1), np.flatnonzero(curve.breaks) + 1, np.nan, axis=0)
            missing, count = write_events(Room(panel_axes, [path]), names, kinds, places)
            left_out, names_in_all = left_out + missing, names_in_all + count
        if left_out:
            legend.set_title(f"{left_out} of {names_in_all} names have no room")
    return figure


def write_events(room: Room, names: Sequence[str], kinds: Sequence[str], places: np.ndarray) -> tuple[int, int]:
    """Write the names of special points at places (E, 2); those that are not finite are left out. Returns how many names have no room, and
    how many there are."""
    shown = np.flatnonzero(np.isfinite(places).all(axis=1)).tolist()
    radii = np.array([0.5 * event_look(kinds[i])["markersize"] + 0.5 for i in shown])
    room.take_around(places[shown], radii)
    texts = crowds([names[i] for i in shown], [kinds[i] for i in shown], room.to_page(places[shown]))
    rows = [row for row, _ in texts]
    at, radii = room.to_page(places[shown])[rows], radii[rows]
    waiting = list(range(len(texts)))
    for over_curves in (False, True):
        some = [texts[i][1] for i in waiting]
        done = room.write(some, at[waiting], radii[waiting], far=_FAR, beside=_BESIDE, over_curves=over_curves)
        waiting = [i for i, text in zip(waiting, done, strict=True) if text is None]
    return len(waiting), len(texts)


def crowds(names: Sequence[str], kinds: Sequence[str], at: np.ndarray) -> list[tuple[int, str]]:
    """The texts to write: (row of the point that it belongs to, text), for points at places (E, 2) of the page.

    Each point has its own name. But `_CROWD` or more successive points of one type, each within `_CROWD_STEP` points of the one before,
    share one text such as GR1-12. So do points of several types in one place, whose markers hide each other.
    """
    places: list[tuple[int, list[str]]] = []
    for kind in dict.fromkeys(kinds):
        rows = np.array([row for row, k in enumerate(kinds) if k == kind])
        far = np.flatnonzero(np.hypot(*np.diff(at[rows], axis=0).T) > _CROWD_STEP) + 1
        for crowd in np.split(rows, far):
            texts = [(int(row), names[row]) for row in crowd]
            if len(crowd) >= _CROWD:
                texts = [(int(crowd[len(crowd) // 2]), f"{names[crowd[0]]}\N{EN DASH}{names[crowd[-1]].removeprefix(kind)}")]
            for row, text in texts:
                same = next((found for other, found in places if np.hypot(*(at[other] - at[row])) <= _CROWD_STEP), None)
                if same is None:
                    places.append((row, [text]))
                else:
                    same.append(text)
    return [(row, textwrap.fill(", ".join(found), _LETTERS)) for row, found in places]


def panel_curve(branch: Any, panel: _Panel, *, wide: bool) -> DrawnCurve:
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
    return smooth(DrawnCurve(x, y, stable, breaks), arclength, _WIDE if wide else _NARROW)


def _at_events(branch: Any, values: np.ndarray) -> np.ndarray:
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


def frequency_panel(branch: Any, frequency: str) -> _Panel:
    """The data of the frequency-energy plot."""
    half_waves = np.asarray(branch.points["half_waves"])
    values = np.asarray(branch.points["frequency"], dtype=float)
    at_events = _at_events(branch, values)
    if frequency == "fundamental":
        return _Panel("frequency", values, at_events, np.zeros(len(half_waves) - 1, dtype=bool), "frequency", r"2\pi/T")
    index = np.asarray(branch.points["frequency_index"], dtype=float)
    at_events = half_waves[np.array([event.point for event in branch.events], dtype=int)] * at_events
    return _Panel("frequency", index, at_events, np.diff(half_waves) != 0, "frequency index", r"m\,2\pi/T")


def _start_panels(branch: Any) -> list[_Panel]:
    """The data of the start velocities of absorber and primary; of their start displacements if no start is at u = 0."""
    points, system = branch.points, branch.system
    chosen = [system.absorber, system.primary]
    if None in chosen:
        chosen = list(range(min(2, len(system.coordinates))))
    values, axis, note = np.asarray(points["velocities"], dtype=float), "start velocity", ""
    moving = bool(np.isfinite(values).any())
    if not moving:
        values, axis, note = np.asarray(points["start_u"], dtype=float), "start displacement", "\n(no start has zero displacement)"
    panels = []
    for k in chosen:
        symbol = f"{symbol_of(system.coordinates[k], velocity=moving)}(0)"
        unbroken = np.zeros(len(values) - 1, dtype=bool)
        panels.append(_Panel(f"start{k}", values[:, k], _at_events(branch, values[:, k]), unbroken, axis, symbol, note))
    return panels


_EVEN, _IN_FLIGHT = 2400, 48  # samples over the period, and at least these in each flight
_FAR_WALL = 1.0  # a wall further than this many widths of the motion from it is named, not shown
_WIDEN = 3.0  # both axes of the plane get one scale if that widens neither more than so
_IMPACT: dict[str, Any] = {"marker": "o", "markersize": 3.6, "mfc": "white", "mec": BLACK, "mew": 0.6}
_ABOVE: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "frameon": False, "borderaxespad": 0.2}


def orbit_figure(orbit: Any) -> Figure:
    """The figure of an orbit (Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Figs. 7 and 9).

    Parameters
    ----------
    orbit : Orbit

    Returns
    -------
    matplotlib.figure.Figure
        Left: all displacements over one period, and below them the gap coordinate of each stop between its walls. Right: the
        configuration plane of absorber and primary (else of the first two coordinates) with the walls that depend on these
        two alone; for one degree of freedom the phase plane.
    """
    system = orbit.system
    times, u, v = sampled_orbit(orbit)
    at = np.array([impact.time for impact in orbit.impacts], dtype=float)
    u_at = orbit.sample(at)[0] if len(at) else np.empty((0, u.shape[1]))
    rows = 1 + len(system.stops)
    with figure_settings():
        figure = new_figure(1.3 + 1.3 * max(rows, 2))
        figure.suptitle(_title(orbit))
        layout: list[Any] = [["displacement", "plane"], *([f"stop{k}", "plane"] for k in range(len(system.stops)))]
        axes = figure.subplot_mosaic(layout, width_ratios=[1.35, 1.0])
        draw_displacements(axes["displacement"], system, times, u, at, u_at)
        for k, stop in enumerate(system.stops):
            mine = np.array([len(system.stops) == 1 or impact.stop.rstrip("+-") == stop.name for impact in orbit.impacts], dtype=bool)
            gap = np.asarray(stop.gap, dtype=float)
            _draw_gap(axes[f"stop{k}"], stop, system, times, u @ gap, at[mine], u_at[mine] @ gap)
        left = ["displacement", *(f"stop{k}" for k in range(len(system.stops)))]
        for name in left:
            set_axis(axes[name], "x", (0.0, float(orbit.period)), 6, "time", "t")
        for name in left[:-1]:
            axes[name].set_xlabel("")
            axes[name].tick_params(labelbottom=False)
        _draw_plane(figure, axes["plane"], system, u, v, u_at)
        settle_layout(figure)
    return figure


def sampled_orbit(orbit: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (k,), displacements and velocities (k, n) over one period, with both sides of each impact, so kinks are sharp."""
    period = float(orbit.period)
    at = np.array([impact.time for impact in orbit.impacts], dtype=float)
    ends = np.unique(np.concatenate([[0.0], at, [period]]))
    just = 1e-12 * period
    parts = [np.linspace(0.0, period, _EVEN), ends, ends[1:] - just]
    parts += [np.linspace(a, b, _IN_FLIGHT) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    times = np.unique(np.concatenate(parts))
    u, v = orbit.sample(times)
    return times, np.asarray(u, dtype=float), np.asarray(v, dtype=float)


def _title(orbit: Any) -> str:
    stable = {1: "stable", 0: "unstable"}.get(orbit.stable, "stability undecided")
    if not orbit.quality.get("reliable", True):
        stable += " (multipliers not reliable)"
    family = family_text(orbit.label, orbit.ends, orbit.sequence)
    return rf"{family}:  $h = {orbit.h:.8g}$,  $\alpha = {orbit.alpha:.8g}$,  {stable}   ({system_text(orbit.system)})"


def _mark_impacts(axes: Axes, x: np.ndarray, y: np.ndarray, name: str) -> None:
    if not len(x):
        return  # an empty line that is not clipped would count as ink at the figure's corner
    look = _IMPACT if len(x) <= 40 else {**_IMPACT, "markersize": 2.0}
    (marks,) = axes.plot(x, y, linestyle="none", zorder=4, clip_on=False, **look)
    marks.set_gid(f"{name}-impacts")


def draw_displacements(axes: Axes, system: Any, times: np.ndarray, u: np.ndarray, at: np.ndarray, u_at: np.ndarray) -> None:
    from matplotlib.lines import Line2D

    for k, name in enumerate(system.coordinates):
        dashes = "-" if k < len(LINES) else "--"
        (line,) = axes.plot(times, u[:, k], dashes, color=LINES[k % len(LINES)], label=f"${symbol_of(name)}$", linewidth=1.1)
        line.set_gid(f"displacement-{k}")
        _mark_impacts(axes, at, u_at[:, k], f"displacement-{k}")
    axes.axhline(0.0, color=GREY, linewidth=0.4, zorder=1)
    set_axis(axes, "y", limits_of(u, 0.1), 5, "displacement", "u")
    handles = axes.get_legend_handles_labels()[0]
    if len(at):
        handles.append(Line2D([], [], label="impact", linestyle="none", **_IMPACT))
    axes.legend(handles=handles, ncols=min(len(handles), 9), **_ABOVE)


def _draw_gap(axes: Axes, stop: Any, system: Any, times: np.ndarray, gap: np.ndarray, at: np.ndarray, gap_at: np.ndarray) -> None:
    low, high = float(gap.min()), float(gap.max())
    width = max(high - low, 1e-9 * max(abs(low), abs(high)), 1e-300)
    bounds = [bound for bound in (stop.lower, stop.upper) if np.isfinite(bound)]
    near = [b for b in bounds if low - _FAR_WALL * width <= b <= high + _FAR_WALL * width]
    limits = limits_of(np.array([low, high, *near]), 0.14)
    name = f"gap-{stop.name}"
    for bound in near:
        away = limits[1] if bound == stop.upper else limits[0]
        axes.axhspan(bound, away, facecolor=PALE, edgecolor="none", zorder=1)
        axes.axhline(bound, color=BLACK, linewidth=1.2, zorder=2).set_gid(f"{name}-wall")
    (line,) = axes.plot(times, gap, color=BLUE, linewidth=1.1, zorder=3)
    line.set_gid(name)
    _mark_impacts(axes, at, gap_at, name)
    axis = "relative displacement\n" if np.count_nonzero(stop.gap) > 1 else "displacement\n"
    set_axis(axes, "y", limits, 4, axis, gap_symbol(stop.gap, system.coordinates))
    far = [b for b in bounds if b not in near]
    if far:
        walls = " and ".join(f"{b:.6g}".replace("-", "\N{MINUS SIGN}") for b in far)
        axes.set_title(f"wall at {walls} is out of view", fontsize=SMALL, loc="right", pad=2)


def _draw_plane(figure: Figure, axes: Axes, system: Any, u: np.ndarray, v: np.ndarray, u_at: np.ndarray) -> None:
    n = len(system.coordinates)
    pair = (system.absorber, system.primary)
    i, j = (0, 0) if n == 1 else (0, 1) if None in pair else pair
    x, y = u[:, i], (v[:, 0] if n == 1 else u[:, j])
    (line,) = axes.plot(x, y, color=BLUE, linewidth=0.9, zorder=3)
    line.set_gid("plane-orbit")
    if n > 1:
        _mark_impacts(axes, u_at[:, i], u_at[:, j], "plane")
    (start,) = axes.plot(x[:1], y[:1], "D", markersize=4.2, color=VERMILION, zorder=5, label="start", linestyle="none")
    start.set_gid("plane-start")
    axes.legend(**_ABOVE)
    names = symbol_of(system.coordinates[i]), symbol_of(system.coordinates[j], velocity=n == 1)
    limits = [limits_of(x, 0.12), limits_of(y, 0.12)]
    for _ in range(2):  # the frame's size depends on its tick texts, and the limits for one scale on the frame's size
        set_axis(axes, "x", limits[0], 5, "", names[0])
        set_axis(axes, "y", limits[1], 5, "", names[1])
        figure.draw_without_rendering()
        if n > 1:
            limits = _one_scale(limits, np.asarray(axes.get_window_extent().size))
    for stop in system.stops:
        gap = np.asarray(stop.gap, dtype=float)
        if not np.any(np.delete(gap, [i, j])):  # a stop that depends on other coordinates is no line in this plane
            normal = np.array([gap[i], 0.0 if n == 1 else gap[j]])
            _draw_wall(axes, normal, stop.upper, 1.0, limits, stop.name)
            _draw_wall(axes, normal, stop.lower, -1.0, limits, stop.name)
    set_axis(axes, "x", limits[0], 5, "", names[0])
    set_axis(axes, "y", limits[1], 5, "", names[1])
    for _ in range(2 if n > 1 else 0):  # the frame's size depends on whether there is this text
        lengths = np.array([high - low for low, high in limits]) / np.asarray(axes.get_window_extent().size)
        ratio = float(lengths.max() / lengths.min())
        if ratio > 1.05:
            large, small = names if lengths[0] < lengths[1] else names[::-1]
            axes.set_xlabel(f"${names[0]}$\nscales differ: ${large}$ is drawn {ratio:.3g} times as large as ${small}$")
            figure.draw_without_rendering()


def _draw_wall(axes: Axes, normal: np.ndarray, bound: float, side: float, limits: list[tuple[float, float]], name: str) -> None:
    """Draw the line normal . x = bound, and shade what lies behind it; the frame cuts both off."""
    if not np.isfinite(bound) or not normal.any():
        return
    foot = normal * bound / (normal @ normal)
    unit = normal / np.hypot(*normal)
    reach = 3.0 * np.hypot(*np.abs(limits).max(axis=1)) + 2.0 * np.hypot(*foot)
    wall = foot + reach * np.outer((-1.0, 1.0), (-unit[1], unit[0]))
    behind = np.concatenate([wall, wall[::-1] + side * reach * unit])
    axes.fill(*behind.T, facecolor=PALE, edgecolor="none", zorder=1)
    axes.plot(*wall.T, color=BLACK, linewidth=1.2, zorder=2, gid=f"plane-wall-{name}")


def _one_scale(limits: list[tuple[float, float]], size: np.ndarray) -> list[tuple[float, float]]:
    """Limits widened so that a frame of this `size` has one scale on both axes; as they are if that takes too much."""
    width = np.array([high - low for low, high in limits])
    wanted = (width / size).max() * size
    if (wanted / width).max() > _WIDEN:
        return limits
    return [((low + high - w) / 2, (low + high + w) / 2) for (low, high), w in zip(limits, wanted, strict=True)]
