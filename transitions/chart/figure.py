"""The figure of a chart: curves over light patches of colour for the attractors between them."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.curves.figure import draw_curves
from branches.figures import style
from transitions.chart.chart import Chart
from transitions.chart.plan import ChartPlan
from transitions.chart.regions import MotionKind, Regions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["COLOURED", "chart_figure"]

COLOURED = 9
"""Sets of attractors with a colour of their own; the others share one."""

_COLOURS = (
    style.SKY, style.ORANGE, style.GREY, style.GREEN, style.YELLOW, style.PURPLE, style.VERMILION, style.BLUE, "#999933",
)  # fmt: skip
_REST = "#F2F2F2"
_LONG, _MANY = 4, 8
"""Largest period, and number of impacts in it, of attractors that are told apart in the figure."""

_LIGHT = 0.4
"""Part of a colour that is left beside white, with which it is mixed."""


def chart_figure(chart: Chart, *, title: str = "") -> Figure:
    """Draw a chart: its curves with their points of codimension two, and the regions of the plane.

    Parameters
    ----------
    chart : Chart
        With one curve at least.
    title : str
    """
    plan = chart.plan
    with style.figure_settings():
        figure = style.new_figure(6.4)
        if title:
            figure.suptitle(title)
        axes = figure.subplots()
        patches = [] if chart.regions is None else _draw_regions(axes, chart.regions, plan)
        logs = plan.by_ratios(0), plan.by_ratios(1)
        draw_curves(figure, axes, chart.curves, window=plan.window, more=patches, logs=logs)
    return figure


def _draw_regions(axes: Axes, regions: Regions, plan: ChartPlan) -> list[Any]:
    """Draw the cells; return the entries of the legend."""
    from matplotlib.colors import ListedColormap, to_rgb
    from matplotlib.patches import Patch

    texts = [[" or ".join(sorted({_pooled(kind) for kind in kinds})) for kinds in row] for row in regions.found]
    counts = Counter(text for row in texts for text in row if text)
    ordered = sorted(counts, key=lambda text: (-counts[text], text))
    shown = ordered[:COLOURED]
    shades: list[Any] = [*(tuple(1.0 - _LIGHT * (1.0 - part) for part in to_rgb(colour)) for colour in _COLOURS[: len(shown)]), _REST]
    index = {"": math.nan, **dict.fromkeys(ordered, float(len(shown))), **{text: float(k) for k, text in enumerate(shown)}}
    image = np.array([[index[text] for text in row] for row in texts])
    axes.pcolormesh(
        plan.edges(0, len(regions.x)), plan.edges(1, len(regions.y)), image, cmap=ListedColormap(shades), vmin=-0.5,
        vmax=len(shown) + 0.5, zorder=0.5, gid="regions", edgecolors="none", linewidth=0.0,
    )  # fmt: skip
    rest = ordered[COLOURED:]
    labels = [(shades[k], text, counts[text]) for k, text in enumerate(shown)]
    labels += [(_REST, f"other: {len(rest)} sets of attractors", sum(counts[text] for text in rest))] if rest else []
    missing = len(regions) - sum(counts.values())
    labels += [("white", "no attractor found", missing)] if missing else []
    return [
        Patch(facecolor=colour, edgecolor=style.GREY, linewidth=0.4, label=f"{text}, {_percent(count / len(regions))}")
        for colour, text, count in labels
    ]


def _pooled(kind: MotionKind) -> str:
    """A kind of attractor in a few words. Long periods, and many impacts, are one kind in the figure."""
    if kind.period > _LONG:
        return f"periods above {_LONG}"
    if kind.impacts > _MANY:
        return f"period {kind.period}, above {_MANY} impacts"
    return kind.text.replace("symmetric", "sym.").replace("permanent ", "")


def _percent(part: float) -> str:
    return f"{100.0 * part:.0f} %" if part >= 0.005 else "below 1 %"
