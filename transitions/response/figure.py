"""The figure of forced responses: a measure over the parameter, with stability and events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures import style
from branches.figures.curves import curve_runs, draw_events, legend_entries
from branches.figures.harmonics import COLUMNS, draw_harmonics, harmonic_layout
from branches.harmonics import amplitudes_along
from branches.released.branch import ReleasedBranch
from branches.released.impact_limit import ImpactLimit, impact_limits
from transitions.response.measures import column_names, column_of
from transitions.response.released import limit_values
from transitions.sweep.figure import Curve, known_column

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from branches.forced.branch import ForcedBranch
    from bvp.forced import ForcedProblem
    from bvp.parameters import ParametricSystem

__all__ = ["curves_over", "default_column", "require_column", "response_figure"]

_LINES: dict[int, dict[str, Any]] = {
    1: {"label": "stable", "color": style.BLUE, "linewidth": 1.5, "linestyle": "-"},
    0: {"label": "unstable", "color": style.VERMILION, "linewidth": 1.1, "linestyle": (0, (3, 1.6))},
    -1: {"label": "undecided", "color": style.GREY, "linewidth": 1.1, "linestyle": ":"},
}
_BACKBONE: dict[str, Any] = {"label": "backbone", "color": style.BLACK, "linewidth": 0.9, "linestyle": (0, (6, 1.5, 1, 1.5))}
_LIMIT: dict[str, Any] = {
    "label": "with impacts", "marker": "*", "markersize": 10.0, "markerfacecolor": style.YELLOW, "markeredgecolor": style.BLACK,
    "markeredgewidth": 0.6, "linestyle": "none",
}  # fmt: skip


def default_column(problem: ForcedProblem) -> str:
    """What is drawn unless something else is asked for: the largest displacement of the first coordinate; of free orbits, the energy or
    the quarter period, whichever no equation keeps."""
    if problem.ends is not None:
        return "h" if any("quarter_period" in text for text in problem.keep) else "alpha"
    return f"max:{problem.system.coordinates[0]}"


def require_column(name: str, parametric: ParametricSystem, impacts: int, free: bool = False) -> tuple[str, str]:
    """The words and the symbol of a column of orbits with so many impacts; a ValueError names the nearest if there is none. free: of free
    orbits."""
    return known_column(name, column_names(parametric, impacts, free))


def response_figure(
    branches: Sequence[ForcedBranch],
    *,
    y: str | None = None,
    x: str | None = None,
    title: str = "",
    interval: tuple[float, float] | None = None,
    harmonics: int | None = None,
    backbones: Sequence[Curve] = (),
) -> Figure:
    """The response curves of some branches.

    Parameters
    ----------
    branches : sequence of ForcedBranch
        Of one system and parameter.
    y : str, optional
        A name of `column_names`; by default the largest displacement of the first coordinate. A column of several numbers draws as many
        curves.
    x : str, optional
        Another one, of one curve; by default the parameter.
    title : str
    interval : (float, float), optional
        Range of the parameter that is shown.
    harmonics : int, optional
        Highest harmonic in panels of their own, one for each coordinate.
    backbones : sequence of Curve
        Conservative families over their own frequency, as of `transitions.response.backbone.backbone`.

    Raises
    ------
    ValueError
        For an unknown column.
    """
    from matplotlib.lines import Line2D

    first = branches[0]
    name = y or default_column(first.problem)
    impacts, free = max(branch.speeds.shape[1] for branch in branches), first.problem.ends is not None
    words, symbol = require_column(name, first.problem.parametric, impacts, free)
    across = x or first.name
    x_words, x_symbol = require_column(across, first.problem.parametric, impacts, free)
    abscissas = [column_of(branch, across) for branch in branches]
    if any(abscissa.shape[1] != 1 for abscissa in abscissas):
        raise ValueError(f"{across} is more than one curve, or none; expected one for the horizontal axis, such as speed:1 or max:..")
    columns = []
    for branch in branches:
        column = np.array(column_of(branch, name), dtype=float)
        column[_retraced(branch, column)] = math.nan
        if interval is not None:
            column[(branch.parameter < interval[0]) | (branch.parameter > interval[1])] = math.nan
        columns.append(column)
    with style.figure_settings():
        shown = list(first.problem.system.coordinates) if harmonics else []
        content: list[Any] = harmonic_layout(shown)
        figure = style.new_figure(4.4 + 2.4 * len(content))
        if title:
            figure.suptitle(title)
        mosaic = figure.subplot_mosaic([["response"] * COLUMNS, *content], height_ratios=[1.6, *[1.0] * len(content)])
        panel = mosaic["response"]
        codes: set[int] = set()
        kinds: list[str] = []
        hollow: list[bool] = []
        places = []
        for number, (branch, column, (along,)) in enumerate(zip(branches, columns, (one.T for one in abscissas), strict=True), 1):
            for curve in column.T:
                curve = with_gaps(curve, name)
                runs = curve_runs(np.stack([along, curve], axis=1), branch.stable)
                codes |= set(runs)
                for code, run in runs.items():
                    look = {key: value for key, value in _LINES[code].items() if key != "label"}
                    panel.plot(run[:, 0], run[:, 1], gid=f"response-{number}-{_LINES[code]['label']}", zorder=2.0 + 0.1 * code, **look)
                for event in branch.events:
                    if event.type != "EP" and math.isfinite(curve[event.point]) and math.isfinite(along[event.point]):
                        kinds.append(event.type)
                        hollow.append(event.criticality == "subcritical")
                        places.append((along[event.point], curve[event.point]))
        for number, curve_of in enumerate(backbones, 1):
            panel.plot(curve_of.x, curve_of.y, gid=f"backbone-{number}", zorder=1.9, **_BACKBONE)
        if places:
            draw_events(panel, kinds, np.array(places), "response", hollow)
        values = np.concatenate([abscissa[:, 0] for abscissa in abscissas]) if interval is None or x else np.array(interval)
        limits = _draw_limits(panel, branches, name) if across == first.name else np.zeros(0)
        if limits.size:
            values = np.append(values, 0.0)
        heights = np.concatenate([limits, *(column.ravel() for column in columns), *(one.y for one in backbones)])
        style.set_axis(panel, "y", style.limits_of(heights), 6, words, symbol)
        style.set_axis(panel, "x", style.limits_of(values, 0.02), 8, x_words, x_symbol)
        if harmonics:
            curves = [(along[:, 0], amplitudes_along(branch, harmonics)) for branch, along in zip(branches, abscissas, strict=True)]
            draw_harmonics(mosaic, shown, curves, style.limits_of(values, 0.02), (x_words, x_symbol), log=False)
        handles = [Line2D([], [], **_LINES[code]) for code in _LINES if code in codes] + [Line2D([], [], **_BACKBONE)] * bool(backbones)
        handles += legend_entries((), kinds, any(hollow))
        for handle in handles:  # the events of conservative families have other names
            handle.set_label(str(handle.get_label()).replace("Krein collision", "Neimark-Sacker"))
        if limits.size:
            handles.append(Line2D([], [], **_LIMIT))
        style.legend_below(figure, handles, 6)
    return figure


def _draw_limits(panel: Axes, branches: Sequence[ForcedBranch], name: str) -> np.ndarray:
    """Draw what the impacting orbits have of a column to which branches lead, at the parameter's limit 0; the values."""
    found = [
        limit_values(limit.orbit, name)
        for branch in branches
        if isinstance(branch, ReleasedBranch)
        for limit in impact_limits(branch)
        if isinstance(limit, ImpactLimit)
    ]
    values: np.ndarray = np.concatenate([np.zeros(0), *found])
    if values.size:
        panel.plot(np.zeros_like(values), values, gid="response-limits", zorder=4.5, clip_on=False, **_LIMIT)
    return values


_RETRACED = 2e-3
"""Largest distance of two curves, beside their size, that look like one."""


def _retraced(branch: ForcedBranch, column: np.ndarray) -> np.ndarray:
    """Points (N,) at which a family shows what it has shown already: behind a branch point its orbits can be images of those before it.

    Two dashed curves on each other would look solid."""
    hidden = np.zeros(len(branch), dtype=bool)
    curve = np.column_stack([branch.parameter, np.sort(column, axis=1)])
    size = np.ptp(curve, axis=0)
    curve = curve[:, size > 0.0] / size[size > 0.0]
    for event in branch.events if np.isfinite(curve).all() else ():
        k = event.point
        if event.type != "BP" or not 0 < k < len(branch) - 1:
            continue
        parts = slice(0, k + 1), slice(k, len(branch))
        if (_distances(curve[parts[1]], curve[parts[0]]) <= _RETRACED).all():
            hidden[k + 1 :] = True
        elif (_distances(curve[parts[0]], curve[parts[1]]) <= _RETRACED).all():
            hidden[:k] = True
    return hidden


def _distances(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Distance of points (N, d) from a polyline (M, d)."""
    chords = np.diff(curve, axis=0)
    away = points[:, None] - curve[None, :-1]
    squares = np.maximum(np.sum(chords**2, axis=1), 1e-300)
    along = np.clip(np.sum(away * chords, axis=2) / squares, 0.0, 1.0)
    found: np.ndarray = np.linalg.norm(away - along[:, :, None] * chords, axis=2).min(axis=1)
    return found


def with_gaps(curve: np.ndarray, name: str) -> np.ndarray:
    """A curve of a column; one of phases has a gap where it jumps by a turn."""
    if not name.startswith("phase") or len(curve) < 2:
        return curve
    jumps = np.flatnonzero(np.abs(np.diff(curve)) > math.pi)
    found = curve.copy()
    found[jumps] = math.nan
    return found


def curves_over(branches: Sequence[ForcedBranch], y: str) -> list[Curve]:
    """The branches as curves that are drawn on top of a sweep.

    Parameters
    ----------
    branches : sequence of ForcedBranch
    y : str
        The measure of the sweep.

    Raises
    ------
    ValueError
        For a measure that a branch does not have.
    """
    kind = y.partition(":")[0]
    if kind not in ("speed", "phase", "work", "max", "strobe", "dissipated"):
        raise ValueError(f"a response has no {y} as a sweep has it; expected speed, phase, work, max:.., strobe:.. or dissipated:..")
    curves = []
    for branch in branches:
        column = column_of(branch, y)
        if kind == "phase" and branch.problem.half:
            column = np.concatenate([column, (column + math.pi) % (2.0 * math.pi)], axis=1)
        # At an event stability is undecided; there the curve is as it is behind it.
        known = np.flatnonzero(branch.stable >= 0)
        stable = branch.stable == 1
        if len(known):
            stable = stable[known[np.minimum(np.searchsorted(known, np.arange(len(branch))), len(known) - 1)]]
        curves += [Curve(branch.parameter, with_gaps(curve, y), stable) for curve in column.T]
    return curves
