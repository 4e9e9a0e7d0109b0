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

__all__ = ["Curve", "Measure", "measure_of", "measures_of", "sweep_figure"]

_BELOW: dict[str, Any] = {"markersize": 2.4, "alpha": 0.55}
_ALONE: dict[str, Any] = {"markersize": 1.6}
_ABOVE: dict[str, Any] = {"markersize": 1.1}
_DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markeredgewidth": 0, "rasterized": True}


@dataclass(frozen=True)
class Measure:
    """What is drawn over the parameter: a quantity with a symbol."""

    name: str  # speed, max:u1, ...
    words: str
    symbol: str
    part: str = ""  # coordinate, damper or stop


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve that is drawn on top, solid where it is stable and dashed where it is not: x, y and stable (k,)."""

    x: np.ndarray
    y: np.ndarray
    stable: np.ndarray


def measures_of(coordinates: Sequence[str], parts: Sequence[str]) -> dict[str, Measure]:
    """The measures of a system with these coordinates, dampers and stops, by their names."""
    found = [
        Measure("speed", "impact speed", "v_-"),
        Measure("phase", "phase at impact", r"\omega t"),
        Measure("impacts", "impacts in a period", ""),
        Measure("period", "period, in periods of the load", "p"),
        Measure("sticking", "part of the time with a sticking stop", ""),
        Measure("work", "work of the loads in a period", ""),
    ]
    for name in coordinates:
        symbol, rate = style.symbol_of(name), style.symbol_of(name, velocity=True)
        found.append(Measure(f"max:{name}", "largest displacement", rf"\max|{symbol}|", name))
        found.append(Measure(f"strobe:{name}", "displacement at phase 0", symbol, name))
        found.append(Measure(f"strobe:{name}'", "velocity at phase 0", rate, name))
    found += [Measure(f"dissipated:{part}", f"energy dissipated in a period, {part}", "", part) for part in parts]
    return {measure.name: measure for measure in found}


def default_measure(coordinates: Sequence[str], contacts: Sequence[str]) -> str:
    """The measure that is shown if none is chosen: the impact speed, or without stops the first displacement at phase 0."""
    return "speed" if contacts else f"strobe:{coordinates[0]}"


def measure_of(sweep: Sweep, name: str) -> Measure:
    """The measure with a name; a ValueError names the nearest."""
    known = measures_of(sweep.coordinates, sweep.parts)
    if name not in known:
        near = get_close_matches(name, known, 1, 0.5)
        raise ValueError(f"unknown measure {name!r}; " + (f"nearest: {near[0]}" if near else f"known: {listed(list(known), len(known))}"))
    return known[name]


def sweep_points(sweep: Sweep, measure: Measure) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the points of a measure: each impact, each recorded period, or one for each value."""
    if measure.name in ("speed", "phase"):
        return sweep.at_impacts(sweep.values), sweep.impact_speeds if measure.name == "speed" else sweep.impact_phases
    if measure.name.startswith("strobe:"):
        k = sweep.coordinates.index(measure.part) + (len(sweep.coordinates) if measure.name.endswith("'") else 0)
        return np.repeat(sweep.values, sweep.states.shape[1]), sweep.states[:, :, k].ravel()
    if measure.name.startswith("max:"):
        return sweep.values, sweep.peaks[:, sweep.coordinates.index(measure.part)]
    if measure.name.startswith("dissipated:"):
        return sweep.values, sweep.dissipated[:, sweep.parts.index(measure.part)]
    single = {"impacts": sweep.impact_rates, "period": sweep.periods, "sticking": sweep.sticking, "work": sweep.work}
    return sweep.values, np.asarray(single[measure.name], dtype=float)


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
    measure = measure_of(first, y or default_measure(first.coordinates, first.contacts))
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
        style.set_axis(panels[0], "y", style.limits_of(np.concatenate(shown)), 6, measure.words, measure.symbol)
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
