"""Figures of a study: a result over two parameters, against each parameter, and around the best run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures import style
from transitions.study.plan import Axis
from transitions.study.study import along, numeric_axes, over

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from transitions.study.study import Study

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
        return "peak", rf"|{style.symbol_of(name[5:])}|"
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
        If no finished run has the result.
    """
    from matplotlib.colors import Normalize

    numeric = {axis.name: axis for axis in numeric_axes(study)}
    x, y = axes if axes is not None else tuple(numeric)[:2]
    found = over(study, numeric[x], numeric[y], _values(study, value))
    top = study.best(best)
    with style.figure_settings():
        figure = style.new_figure(5.2)
        panel = figure.subplots()
        figure.suptitle(_title(study))
        panel.set_facecolor(style.PALE)
        low, high = style.limits_of(found.medians, 0.0)
        look: dict[str, Any] = {"cmap": "viridis", "norm": Normalize(low, high), "rasterized": True, "gid": "map"}
        mesh = panel.pcolormesh(found.x.edges, found.y.edges, found.medians.T, **look)
        for which, name, edges in (("x", x, found.x.edges), ("y", y, found.y.edges)):
            _axis(panel, which, numeric[name], (float(edges[0]), float(edges[-1])), study)
        bar = figure.colorbar(mesh, ax=panel, pad=0.02)
        median = "median of " if len(numeric) > 2 or len(study.plan.axes) > len(numeric) or study.plan.design == "hypercube" else ""
        bar.set_label(f"{median}{_text(value)}")
        _star(panel, top.given[x], top.given[y], f"largest {_text(best)}: {top.value:.4g}")
        if np.any(found.counts == 0):
            panel.scatter([], [], marker="s", s=40, color=style.PALE, edgecolor=style.GREY, linewidth=0.4, label="no run")
        style.legend_below(figure, panel.get_legend_handles_labels()[0], 2)
    return figure


def lines_figure(study: Study, value: str = "nes_share", best: str = "nes_share", beside: Sequence[Study] = ()) -> Figure:
    """A result against each parameter: the median over all others, and the quartiles.

    Parameters
    ----------
    study, value, best
        As for `map_figure`.
    beside : sequence of Study
        Other studies that vary the same parameters and no family; each study has a colour, and its title names it.

    Raises
    ------
    ValueError
        If no finished run has the result, or a study varies other parameters.
    """
    studies = [study, *beside]
    for one in beside:
        if set(one.plan.names) != set(study.plan.names) or "family" in one.plan.names:
            raise ValueError(f"{one.path} varies {', '.join(one.plan.names)}; beside it are studies of the same numbers, without families")
    top = study.best(best)
    names = next((axis.values for axis in study.plan.axes if axis.is_family), ())
    groups = [(study, _family_text(str(name)), study.given["family"] == name) for name in names]
    plain = "runs" if len(study.plan.axes) == 1 and study.plan.design == "grid" else "median"
    labels = [one.plan.title or one.path.name for one in studies] if beside else [plain]
    groups = groups or [(one, label, np.ones(len(one), dtype=bool)) for one, label in zip(studies, labels, strict=True)]

    def draw(panel: Axes, axis: Axis) -> list[np.ndarray]:
        shown = []
        for k, (one, label, some) in enumerate(groups):
            values = _values(one, value)
            name = names[k] if names else label
            look: dict[str, Any] = {"color": style.LINES[k % len(style.LINES)], "markersize": 2.5, "gid": f"median-{name}"}
            if axis.is_family:
                here = values[some & np.isfinite(values)]
                shown.append(np.quantile(here, [[0.25, 0.5, 0.75]], axis=0) if len(here) else np.full((1, 3), np.nan))
                low, middle, high = shown[-1].T
                panel.errorbar([k], middle, yerr=[middle - low, high - middle], fmt="o", capsize=3, **look)
                continue
            places, quartiles = along(one, _same(one, axis), values, some)
            shown.append(quartiles)
            there = np.isfinite(quartiles[:, 1])
            panel.plot(places, quartiles[:, 1], marker="o" if there.sum() < 30 else "", label=label, **look)
            if np.any(quartiles[there, 0] < quartiles[there, 2]):
                band: dict[str, Any] = {"color": look["color"], "alpha": 0.18, "linewidth": 0}
                named = "quartiles" if len(groups) == 1 else None
                panel.fill_between(places[there], quartiles[there, 0], quartiles[there, 2], label=named, **band)
        if value == best and not axis.is_family and not beside:
            _star(panel, top.given[axis.name], top.value, f"largest: {top.value:.4g}")
            shown.append(np.array([top.value]))
        return shown

    return _against_each(studies, value, draw)


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
    ring: dict[str, Any] = {"facecolor": "none", "edgecolor": style.VERMILION, "linewidth": 0.9}

    def draw(panel: Axes, axis: Axis) -> list[np.ndarray]:
        given, shown = study.numbers(axis.name), values
        if study.plan.design == "grid":
            others = [study.numbers(other.name) for other in study.plan.axes if other.name != axis.name]
            # The runs that share all other parameters with the best one. With one axis alone these are all runs.
            some = np.flatnonzero(np.all([column == column[at] for column in others], axis=0) & np.ones(len(study), dtype=bool))
            order = some[np.argsort(given[some], kind="stable")]
            look: dict[str, Any] = {"marker": "o", "markersize": 3, "color": style.BLUE, "linestyle": "none" if axis.is_family else "-"}
            panel.plot(given[order], values[order], label="the other parameters as at the best", **look)
            shown = values[order]
        else:
            panel.scatter(given, values, s=2, color=style.GREY, linewidths=0, alpha=0.5, label="all runs", rasterized=len(given) > 2000)
        panel.scatter(given[near], values[near], s=16, label="next to the best", zorder=3, **ring)
        _star(panel, given[at], values[at], f"largest {_text(best)}: {top.value:.4g}")
        return [shown, values[near]]

    natural = study.plan.units == "natural"
    given = ", ".join(
        _family_text(at) if isinstance(at, str) else f"${words_of(name, natural)[1]} = {at:.4g}$" for name, at in top.given.items()
    )
    return _against_each([study], name, draw, f"\nthe best run, {top.run}: {given}")


def _same(study: Study, axis: Axis) -> Axis:
    """The axis of a study over the same parameter."""
    return next(own for own in study.plan.axes if own.name == axis.name)


def _against_each(studies: Sequence[Study], value: str, draw: Callable[[Axes, Axis], list[np.ndarray]], more: str = "") -> Figure:
    """A figure with a panel for each parameter, two in a row. `draw` fills a panel and returns the results that it shows."""
    study = studies[0]
    axes = study.plan.axes
    columns = min(2, len(axes))
    rows = -(-len(axes) // columns)
    with style.figure_settings():
        figure = style.new_figure(1.0 + (2.6 if columns > 1 else 3.6) * rows)
        figure.suptitle(_title(study) + more if len(studies) == 1 else "")
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for panel in grid[len(axes) :]:
            panel.set_axis_off()
        shown: list[np.ndarray] = []
        entries: dict[str, Any] = {}
        for panel, axis in zip(grid, axes, strict=False):
            shown += draw(panel, axis)
            if axis.is_family:
                texts = [_family_text(str(name)) for name in axis.values]
                panel.set_xticks(range(len(texts)), texts, rotation=30 if len(texts) > 4 else 0)
                panel.set(xlim=(-0.5, len(texts) - 0.5), xlabel="starting family")
            else:
                values = np.concatenate([own.values or (own.low, own.high) for own in (_same(one, axis) for one in studies)])
                _axis(panel, "x", axis, style.limits_of(values, 0.04, log=axis.scale == "log"), study)
            entries |= {label: handle for handle, label in zip(*panel.get_legend_handles_labels(), strict=True) if label not in entries}
        limits = style.limits_of(np.concatenate([part.ravel() for part in shown]))
        for panel in grid[: len(axes)]:
            style.set_axis(panel, "y", limits, 5, *words_of(value))
        style.legend_below(figure, list(entries.values()), 4)
    return figure


def _values(study: Study, name: str) -> np.ndarray:
    values = study[name].astype(float)
    if not np.isfinite(values).any():
        raise ValueError(f"no finished run of {study.path} has {name}")
    return values


def _title(study: Study) -> str:
    plan = study.plan
    done = f"{len(study)} runs" if study.complete else f"{len(study)} of {plan.count} runs"
    fixed = {**{k: v for k, v in plan.system.items() if k not in plan.names and isinstance(v, float)}, **plan.fixed}
    parts = [f"${words_of(name, plan.units == 'natural')[1]} = {value:.4g}$" for name, value in fixed.items() if isinstance(value, float)]
    parts += [_family_text(str(value)) for value in fixed.values() if isinstance(value, str) and value in plan.families]
    return (plan.title + "\n" if plan.title else "") + ", ".join([*parts, done])


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


def _axis(panel: Axes, which: str, axis: Axis, limits: tuple[float, float], study: Study) -> None:
    words, symbol = words_of(axis.name, study.plan.units == "natural")
    style.set_axis(panel, which, limits, 6, words, symbol, log=axis.scale == "log")


def _star(panel: Axes, x: float, y: float, label: str) -> None:
    # White in a black edge, with a white rim around that: one of the two stands out on any colour.
    from matplotlib.patheffects import Normal, withStroke

    look: dict[str, Any] = {"color": "white", "markeredgecolor": style.BLACK, "markeredgewidth": 0.9}
    look["path_effects"] = [withStroke(linewidth=3.0, foreground="white"), Normal()]
    panel.plot([x], [y], marker="*", markersize=12, linestyle="none", label=label, zorder=5, clip_on=False, gid="best", **look)
