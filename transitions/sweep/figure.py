"""The brute-force bifurcation diagram: a measure of the motion over the parameter, and the largest Lyapunov exponent below it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures import style
from bvp.texts import listed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from transitions.sweep.runs import SweepRun
    from transitions.sweep.sweep import Sweep

__all__ = ["Curve", "default_measure", "known_column", "measures_of", "motion_columns", "sweep_figure"]

_BELOW: dict[str, Any] = {"markersize": 2.4, "alpha": 0.55}
_ALONE: dict[str, Any] = {"markersize": 1.6}
_ABOVE: dict[str, Any] = {"markersize": 1.1}
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markeredgewidth": 0, "rasterized": True}


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve that is drawn on top, solid where it is stable and dashed where it is not: x, y and stable (k,)."""

    x: np.ndarray
    y: np.ndarray
    stable: np.ndarray


Columns = dict[str, tuple[str, str]]
"""Words and mathematical symbol of what can be drawn, by its name: speed, max:u1, ..."""


def motion_columns(coordinates: Sequence[str], parts: Sequence[str]) -> Columns:
    """What both a sweep and a response have of motions, with these coordinates, dampers and stops."""
    found = {"speed": ("impact speed", "v_-"), "phase": ("phase at impact", r"\omega t"), "work": ("work of the loads in a period", "")}
    for name in coordinates:
        symbol = style.symbol_of(name)
        found[f"max:{name}"] = "largest displacement", rf"\max|{symbol}|"
        found[f"strobe:{name}"] = "displacement at phase 0", symbol
        found[f"strobe:{name}'"] = "velocity at phase 0", style.symbol_of(name, velocity=True)
    return found | {f"dissipated:{part}": (f"energy dissipated in a period, {part}", "") for part in parts}


def measures_of(coordinates: Sequence[str], parts: Sequence[str]) -> Columns:
    """The measures of a sweep."""
    return motion_columns(coordinates, parts) | {
        "impacts": ("impacts in a period", ""),
        "period": ("period, in periods of the load", "p"),
        "sticking": ("part of the time with a sticking stop", ""),
    }


def known_column(name: str, known: Columns, what: str = "column") -> tuple[str, str]:
    """The words and the symbol of one; a ValueError names the nearest if there is none."""
    if name not in known:
        near = get_close_matches(name, known, 1, 0.5)
        raise ValueError(f"unknown {what} {name!r}; " + (f"nearest: {near[0]}" if near else f"known: {listed(list(known), len(known))}"))
    return known[name]


def default_measure(coordinates: Sequence[str], contacts: Sequence[str]) -> str:
    """The measure that is shown if none is chosen: the impact speed, or without stops the first displacement at phase 0."""
    return "speed" if contacts else f"strobe:{coordinates[0]}"


def sweep_points(sweep: Sweep, measure: str) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the points of a measure: each impact, each recorded period, or one for each value."""
    kind, _, part = measure.partition(":")
    if kind in ("speed", "phase"):
        return np.repeat(sweep.values, np.diff(sweep.offsets)), sweep.impact_speeds if kind == "speed" else sweep.impact_phases
    if kind == "strobe":
        k = sweep.coordinates.index(part.rstrip("'")) + (len(sweep.coordinates) if part.endswith("'") else 0)
        return np.repeat(sweep.values, sweep.states.shape[1]), sweep.states[:, :, k].ravel()
    if kind == "max":
        return sweep.values, sweep.peaks[:, sweep.coordinates.index(part)]
    if kind == "dissipated":
        return sweep.values, sweep.dissipated[:, sweep.parts.index(part)]
    single = {"impacts": sweep.impact_rates, "period": sweep.periods, "sticking": sweep.sticking, "work": sweep.work}
    return sweep.values, np.asarray(single[measure], dtype=float)


def sweep_figure(
    runs: Sequence[SweepRun], parameter: str, *, y: str | None = None, title: str = "", curves: Sequence[Curve] = (), exponent: bool = True
) -> Figure:
    """The bifurcation diagram of some sweeps.

    Parameters
    ----------
    runs : sequence of SweepRun
        Each direction and start has a colour. Where sweeps agree, both colours can be seen.
    parameter : str
    y : str, optional
        The measure (`measures_of`); by default `default_measure`.
    title : str
    curves : sequence of Curve
        Branches of periodic motions, drawn on top.
    exponent : bool
        Whether the largest Lyapunov exponent is drawn below.

    Raises
    ------
    ValueError
        For an unknown measure.
    """
    first = runs[0].sweep
    measure = y or default_measure(first.coordinates, first.contacts)
    words, letter = known_column(measure, measures_of(first.coordinates, first.parts), "measure")
    symbol = style.symbol_of(parameter)
    exponents = np.concatenate([run.sweep.exponents for run in runs])
    lower = exponent and bool(np.any(np.isfinite(exponents) | np.isneginf(exponents)))
    values = np.concatenate([run.sweep.values for run in runs])
    with style.figure_settings():
        figure = style.new_figure(5.6 if lower else 4.4)
        if title:
            figure.suptitle(title)
        panels = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0)) if lower else [figure.subplots()]
        several = len({run.start for run in runs}) > 1
        shown = []
        handles: list[Any] = []
        # The sweep that is drawn first has the larger marks, and is seen around those of the others.
        for k, run in enumerate(reversed(runs)):
            size = _ABOVE if k else _BELOW if len(runs) > 1 else _ALONE
            look = _DOTS | size | {"color": style.LINES[(len(runs) - 1 - k) % len(style.LINES)]}
            x, found = sweep_points(run.sweep, measure)
            shown.append(found)
            panels[0].plot(x, found, gid=f"{run.direction}-{run.start}", **look)
            if lower:
                finite = np.isfinite(run.sweep.exponents)
                panels[1].plot(run.sweep.values[finite], run.sweep.exponents[finite], **look)
            label = f"{run.direction}, start {run.start}" if several else run.direction
            handles.append(_handle(label, look))
        handles.reverse()
        for curve in curves:
            shown.append(curve.y)
            handles += _draw_curve(panels[0], curve, {handle.get_label() for handle in handles})
        span = style.limits_of(values, 0.02)
        style.set_axis(panels[0], "y", style.limits_of(np.concatenate(shown)), 6, words, letter)
        if lower:
            handles += _exponent_axis(panels[1], runs, exponents)
        style.set_axis(panels[-1], "x", span, 8, "", symbol)
        style.legend_below(figure, handles, 6)
    return figure


def _handle(label: str, look: dict[str, Any]) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, linestyle="none", marker="o", markersize=4.0, markeredgewidth=0, color=look["color"])


def _draw_curve(panel: Axes, curve: Curve, taken: set[Any]) -> list[Any]:
    """Draw the parts of a curve; return what the legend does not have yet."""
    from matplotlib.lines import Line2D

    entries = []
    for wanted, label, dashes in ((True, "stable", "-"), (False, "unstable", (0, (3, 2)))):
        here = np.asarray(curve.stable, dtype=bool) == wanted
        # A piece reaches the next point, so that no gap is left between two pieces.
        reach = here | np.concatenate([[False], here[:-1]])
        if not here.any():
            continue
        look: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": dashes}
        panel.plot(curve.x, np.where(reach, curve.y, math.nan), zorder=3, **look)
        if label not in taken:
            entries.append(Line2D([], [], label=label, **look))
    return entries


def _exponent_axis(panel: Axes, runs: Sequence[SweepRun], exponents: np.ndarray) -> list[Any]:
    """The panel of the exponents: a line at 0, and marks below where there is no tangent vector left."""
    finite = exponents[np.isfinite(exponents)]
    low, high = style.limits_of(np.concatenate([finite, [0.0]]), 0.12)
    panel.axhline(0.0, color=style.BLACK, linewidth=0.6)
    style.set_axis(panel, "y", (low, high), 4, "Lyapunov exponent", r"\lambda_1")
    vanishing = [run.sweep.values[np.isneginf(run.sweep.exponents)] for run in runs]
    if not any(len(values) for values in vanishing):
        return []
    look: dict[str, Any] = {"linestyle": "none", "marker": "|", "markersize": 4.0, "color": style.GREY, "gid": "vanishing"}
    places = np.concatenate(vanishing)
    return panel.plot(places, np.full(len(places), low), label=r"$\lambda_1 = -\infty$", clip_on=False, **look)
