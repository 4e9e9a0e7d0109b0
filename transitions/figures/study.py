"""Figures of a study: a result over two parameters, against each parameter, and around the best run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures.style import (
    BLACK,
    BLUE,
    GREY,
    LINES,
    PALE,
    VERMILION,
    figure_settings,
    legend_below,
    limits_of,
    new_figure,
    set_axis,
    symbol_of,
)
from transitions.study.plan import Axis
from transitions.study.study import along, numeric_axes, over

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from transitions.study.study import Best, Study

__all__ = ["best_figure", "lines_figure", "map_figure"]

_WORDS = {
    "nes_share": ("share dissipated by the NES", ""), "lo_share": ("share dissipated by the LO", ""), "left_share": ("share left", ""),
    "impacts": ("impacts", ""), "last_impact": ("last impact", "t"), "sticking_time": ("time with a stop held", ""),
    "duration": ("duration", "t"), "balance_error": ("error of the balance", ""), "h": ("energy", "h"), "energy": ("energy", "E"),
    "impulse": ("impulse", "V"), "clearance": ("clearance", "d"), "mu": ("mass ratio", r"\mu"), "sigma": ("coupling", r"\sigma"),
    "rho": ("restitution", r"\rho"), "lam": ("damping", r"\lambda"), "ended": ("ending (code)", ""),
}  # fmt: skip


def words_of(name: str, natural: bool = False) -> tuple[str, str]:
    """Words and symbol of a result or parameter; in natural units an energy that is given is h."""
    if name == "energy" and natural:
        return _WORDS["h"]
    if name.startswith("time_"):
        return f"time to {name[5:]} %", "t"
    if name.startswith("peak_"):
        return "peak", rf"|{symbol_of(name[5:])}|"
    return _WORDS[name]


def map_figure(study: Study, value: str = "nes_share", best: str = "nes_share", axes: tuple[str, str] | None = None) -> Figure:
    """A result over two parameters, in colours: the median over all others; a star where the best run is.

    Parameters
    ----------
    study : Study
    value : str
        The result in colours.
    best : str
        The result whose largest is starred.
    axes : tuple of str, optional
        The two parameters; by default the first two that are numbers.

    Raises
    ------
    ValueError
        Where the study does not vary two such parameters, or no run has the result.
    """
    from matplotlib.colors import Normalize

    numeric = {axis.name: axis for axis in numeric_axes(study)}
    x, y = axes if axes is not None else tuple(numeric)[:2] if len(numeric) >= 2 else _refuse_map(study)
    found = over(study, numeric[x], numeric[y], _values(study, value))
    top = study.best(best)
    with figure_settings():
        figure = new_figure(5.2)
        panel = figure.subplots()
        figure.suptitle(_title(study))
        panel.set_facecolor(PALE)
        low, high = limits_of(found.medians, 0.0)
        mesh = panel.pcolormesh(found.x.edges, found.y.edges, found.medians.T, cmap="viridis", norm=Normalize(low, high), rasterized=True)
        mesh.set_gid("map")
        for which, name, edges in (("x", x, found.x.edges), ("y", y, found.y.edges)):
            _axis(panel, which, numeric[name], (float(edges[0]), float(edges[-1])), study)
        bar = figure.colorbar(mesh, ax=panel, pad=0.02)
        median = "median of " if len(numeric) > 2 or len(study.plan.axes) > len(numeric) or study.plan.design == "hypercube" else ""
        bar.set_label(f"{median}{_text(value)}")
        _star(panel, [top.given[x]], [top.given[y]], f"largest {_text(best)}: {top.value:.4g}")
        if np.any(found.counts == 0):
            panel.scatter([], [], marker="s", s=40, color=PALE, edgecolor=GREY, linewidth=0.4, label="no run")
        legend_below(figure, panel.get_legend_handles_labels()[0], 2)
    return figure


def lines_figure(study: Study, value: str = "nes_share", best: str = "nes_share") -> Figure:
    """A result against each parameter: the median over all others, and the quartiles.

    Parameters
    ----------
    study, value, best
        As for `map_figure`.
    """
    values = _values(study, value)
    top = study.best(best)
    names = next((axis.values for axis in study.plan.axes if axis.is_family), ())
    with figure_settings():
        figure, panels = _panels(study, len(study.plan.axes))
        alone = len(study.plan.axes) == 1
        shown: list[np.ndarray] = []
        for panel, axis in zip(panels, study.plan.axes, strict=True):
            if axis.is_family:
                shown += _against_families(panel, study, axis, values)
            else:
                groups = [(str(name), study.given["family"] == name) for name in names] or [("", np.ones(len(study), dtype=bool))]
                for (name, some), colour in zip(groups, LINES * (1 + len(groups) // len(LINES)), strict=False):
                    places, quartiles = along(study, axis, values, some)
                    shown.append(quartiles)
                    plain = "runs" if alone and study.plan.design == "grid" else "median"
                    _line(panel, places, quartiles, colour, name or plain, len(groups) == 1)
                _axis(panel, "x", axis, _range(axis), study)
                if value == best:
                    _star(panel, [top.given[axis.name]], [top.value], f"largest: {top.value:.4g}")
                    shown.append(np.array([top.value]))
        _common_axis(panels, np.concatenate([part.ravel() for part in shown]), value)
        _one_legend(figure, panels)
    return figure


def best_figure(study: Study, best: str = "nes_share", value: str | None = None) -> Figure:
    """The best run and those about it, against each parameter.

    In a grid, the runs along each axis through the best one; in a hypercube all runs, those nearest to the best one in colour.

    Parameters
    ----------
    study : Study
    best : str
        The result whose largest is sought.
    value : str, optional
        The result that is drawn; by default the same.
    """
    name = best if value is None else value
    values, top = _values(study, name), study.best(best)
    at = int(np.searchsorted(study.runs, top.run))
    near = np.searchsorted(study.runs, top.neighbours)
    with figure_settings():
        figure, panels = _panels(study, len(study.plan.axes), _given(study, top))
        shown: list[np.ndarray] = []
        for panel, axis in zip(panels, study.plan.axes, strict=True):
            given = study.numbers(axis.name)
            if study.plan.design == "grid":
                some = _through(study, at, axis.name)
                order = some[np.argsort(given[some])]
                style: dict[str, Any] = {"linestyle": "none"} if axis.is_family else {}
                others = "the other parameters as at the best"
                panel.plot(given[order], values[order], marker="o", markersize=3, color=BLUE, label=others, **style)
                shown.append(values[order])
            else:
                panel.scatter(given, values, s=2, color=GREY, linewidths=0, alpha=0.5, label="all runs", rasterized=len(given) > 2000)
                shown.append(values)
            ring: dict[str, Any] = {"facecolor": "none", "edgecolor": VERMILION, "linewidth": 0.9}
            panel.scatter(given[near], values[near], s=16, label="next to the best", zorder=3, **ring)
            _star(panel, [given[at]], [values[at]], f"largest {_text(best)}: {top.value:.4g}")
            if axis.is_family:
                _family_axis(panel, axis)
            else:
                _axis(panel, "x", axis, _range(axis), study)
        _common_axis(panels, np.concatenate([*shown, values[near]]), name)
        _one_legend(figure, panels)
    return figure


def _refuse_map(study: Study) -> tuple[str, str]:
    names = ", ".join(study.plan.names)
    raise ValueError(f"a map needs two parameters that are numbers; {study.path} varies {names}: expected --view lines")


def _values(study: Study, name: str) -> np.ndarray:
    values = study[name].astype(float)
    if not np.isfinite(values).any():
        raise ValueError(f"no finished run of {study.path} has {name}")
    return values


def _panels(study: Study, count: int, more: str = "") -> tuple[Figure, list[Axes]]:
    """A figure with a title and so many panels, two in a row."""
    columns = min(2, count)
    rows = -(-count // columns)
    figure = new_figure(1.0 + (2.6 if columns > 1 else 3.6) * rows)
    figure.suptitle(_title(study) + (f"\n{more}" if more else ""))
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel in grid[count:]:
        panel.set_axis_off()
    return figure, list(grid[:count])


def _title(study: Study) -> str:
    plan = study.plan
    done = f"{len(study)} runs" if study.complete else f"{len(study)} of {plan.count} runs"
    fixed = {**{k: v for k, v in plan.system.items() if k not in plan.names and isinstance(v, float)}, **plan.fixed}
    parts = [f"${words_of(name, plan.units == 'natural')[1]} = {value:.4g}$" for name, value in fixed.items() if isinstance(value, float)]
    parts += [_family_text(str(value)) for value in fixed.values() if isinstance(value, str) and value in plan.families]
    return (plan.title + "\n" if plan.title else "") + ", ".join([*parts, done])


def _given(study: Study, top: Best) -> str:
    natural = study.plan.units == "natural"
    parts = [
        _family_text(value) if isinstance(value, str) else f"${words_of(name, natural)[1]} = {value:.4g}$"
        for name, value in top.given.items()
    ]
    return f"the best run, {top.run}: " + ", ".join(parts)


def _family_text(name: str) -> str:
    """A family's name as a title has it."""
    from branches.naming.labels import latex, parse_name

    if name == "impulsive":
        return name
    label = parse_name(name).label
    return name if label is None else latex(label)


def _text(name: str) -> str:
    words, symbol = words_of(name)
    return f"{words} ${symbol}$" if symbol else words


def _spoken(name: str) -> tuple[str, str]:
    """Words and symbol for an axis: what has no symbol has one that takes no room."""
    words, symbol = words_of(name)
    return words, symbol or "{}"


def _common_axis(panels: list[Axes], values: np.ndarray, name: str) -> None:
    """The same limits for the result in all panels."""
    limits = limits_of(values)
    for panel in panels:
        set_axis(panel, "y", limits, 5, *_spoken(name))


def _range(axis: Axis) -> tuple[float, float]:
    values = np.array(axis.values, dtype=float) if axis.values else np.array([axis.low, axis.high])
    return limits_of(values, 0.04, log=axis.scale == "log")


def _axis(panel: Axes, which: str, axis: Axis, limits: tuple[float, float], study: Study) -> None:
    words, symbol = words_of(axis.name, study.plan.units == "natural")
    set_axis(panel, which, limits, 6, words, symbol, log=axis.scale == "log")


def _family_axis(panel: Axes, axis: Axis) -> None:
    panel.set_xticks(range(len(axis.values)), [_family_text(str(name)) for name in axis.values], rotation=30 if len(axis.values) > 4 else 0)
    panel.set_xlim(-0.5, len(axis.values) - 0.5)
    panel.set_xlabel("starting family")


def _line(panel: Axes, places: np.ndarray, quartiles: np.ndarray, colour: str, name: str, band_named: bool) -> None:
    there = np.isfinite(quartiles[:, 1])
    shown = name if name in ("median", "runs") else _family_text(name)
    (line,) = panel.plot(places, quartiles[:, 1], color=colour, marker="o" if there.sum() < 30 else "", markersize=2.5, label=shown)
    line.set_gid(f"median-{name}")
    if np.any(quartiles[there, 0] < quartiles[there, 2]):
        panel.fill_between(
            places[there], quartiles[there, 0], quartiles[there, 2], color=colour, alpha=0.18, linewidth=0,
            label="quartiles" if band_named else None,
        )  # fmt: skip


def _against_families(panel: Axes, study: Study, axis: Axis, values: np.ndarray) -> list[np.ndarray]:
    """Median and quartiles of each family."""
    shown = []
    for k, name in enumerate(axis.values):
        here = values[(study.given["family"] == name) & np.isfinite(values)]
        if not len(here):
            continue
        low, middle, high = np.quantile(here, [0.25, 0.5, 0.75])
        bars = [[middle - low], [high - middle]]
        panel.errorbar([k], [middle], yerr=bars, fmt="o", markersize=3.5, color=LINES[k % len(LINES)], capsize=3)
        shown.append(np.array([low, middle, high]))
    _family_axis(panel, axis)
    return shown


def _through(study: Study, at: int, name: str) -> np.ndarray:
    """Runs of a grid that differ from one in one parameter alone, itself among them."""
    same = np.ones(len(study), dtype=bool)
    for axis in study.plan.axes:
        if axis.name != name:
            column = study.numbers(axis.name)
            same &= column == column[at]
    return np.flatnonzero(same)


def _star(panel: Axes, x: list[float], y: list[float], label: str) -> None:
    # White in a black edge, with a white rim around that: one of the two stands out on any colour.
    from matplotlib.patheffects import Normal, withStroke

    look: dict[str, Any] = {"color": "white", "markeredgecolor": BLACK, "markeredgewidth": 0.9}
    look["path_effects"] = [withStroke(linewidth=3.0, foreground="white"), Normal()]
    (star,) = panel.plot(x, y, marker="*", markersize=12, linestyle="none", label=label, zorder=5, clip_on=False, **look)
    star.set_gid("best")


def _one_legend(figure: Figure, panels: list[Axes]) -> None:
    entries: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    legend_below(figure, list(entries.values()), 4)
