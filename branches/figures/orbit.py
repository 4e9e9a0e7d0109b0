"""The picture of one orbit: displacements and gaps over a period, and the path in the configuration plane with its walls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures.style import (
    BLACK,
    BLUE,
    GREY,
    LINES,
    PALE,
    SMALL,
    VERMILION,
    limits_of,
    new_figure,
    picture_settings,
    set_axis,
    settle_layout,
)
from branches.figures.titles import family_text, gap_symbol, symbol_of, system_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_EVEN, _IN_FLIGHT = 2400, 48  # samples over the period, and at least these in each flight
_FAR = 1.0  # a wall further than this many widths of the motion from it is named, not shown
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
    with picture_settings():
        figure = new_figure(1.3 + 1.3 * max(rows, 2))
        figure.suptitle(_title(orbit))
        layout: list[Any] = [["displacement", "plane"], *([f"stop{k}", "plane"] for k in range(len(system.stops)))]
        axes = figure.subplot_mosaic(layout, width_ratios=[1.35, 1.0])
        draw_displacements(axes["displacement"], system, times, u, at, u_at)
        for k, stop in enumerate(system.stops):
            mine = np.array([_of_stop(impact, stop, system) for impact in orbit.impacts], dtype=bool)
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


def _of_stop(impact: Any, stop: Any, system: Any) -> bool:
    letter = impact.stop.rstrip("+-")
    return len(system.stops) == 1 or letter == stop.name


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
    near = [b for b in bounds if low - _FAR * width <= b <= high + _FAR * width]
    limits = limits_of(np.array([low, high, *near]), 0.14)
    name = f"gap-{stop.name}"
    for bound in near:
        away = limits[1] if bound == stop.upper else limits[0]
        axes.axhspan(bound, away, facecolor=PALE, edgecolor="none", zorder=1)
        axes.axhline(bound, color=BLACK, linewidth=1.2, zorder=2).set_gid(f"{name}-wall")
    (line,) = axes.plot(times, gap, color=BLUE, linewidth=1.1, zorder=3)
    line.set_gid(name)
    _mark_impacts(axes, at, gap_at, name)
    words = "relative displacement\n" if np.count_nonzero(stop.gap) > 1 else "displacement\n"
    set_axis(axes, "y", limits, 4, words, gap_symbol(stop.gap, system.coordinates))
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
