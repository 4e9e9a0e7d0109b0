"""The figure of curves in the plane of two parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.curves.record import WORDS, BifurcationCurve
from branches.figures import style
from branches.figures.room import Room

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "curve_figure", "draw_curves"]

COLOURS = {
    "SN": style.BLACK,
    "PD": style.BLUE,
    "SB": style.GREEN,
    "NS": style.PURPLE,
    "BP": style.GREY,
    "GR": style.VERMILION,
}
"""Colour of each kind of curve."""

_DASHED = (0, (4.0, 1.6))


def curve_figure(curves: Sequence[BifurcationCurve], *, title: str = "", window: Any = None) -> Figure:
    """The plane of two parameters with some curves, and their points of codimension two by name.

    Parameters
    ----------
    curves : sequence of BifurcationCurve
        In the same two parameters.
    title : str
    window : ((float, float), (float, float)), optional
        Ranges that are shown.
    """
    with style.figure_settings():
        figure = style.new_figure(4.6)
        if title:
            figure.suptitle(title)
        axes = figure.subplots()
        draw_curves(figure, axes, curves, window=window)
    return figure


def draw_curves(
    figure: Figure,
    axes: Axes,
    curves: Sequence[BifurcationCurve],
    *,
    window: Any = None,
    more: Sequence[Any] = (),
    logs: tuple[bool, bool] = (False, False),
) -> None:
    """Draw curves into a panel, with its axes and a legend. more: further handles of the legend. logs: which axes are logarithmic."""
    from matplotlib.lines import Line2D

    first = curves[0].shown[0]
    places = [curve.parameters[:, [curve.names.index(name) for name in first]] for curve in curves]
    together = np.concatenate(places)
    for k, (name, letter) in enumerate(zip(first, "xy", strict=True)):
        limits = style.limits_of(np.array(window[k]) if window is not None else together[:, k], 0.03, log=logs[k])
        style.set_axis(axes, letter, limits, 8, "", style.symbol_of(name), log=logs[k])
    shown: dict[tuple[str, bool], None] = {}
    for number, (curve, place) in enumerate(zip(curves, places, strict=True), 1):
        for begin, end, solid in _pieces(curve):
            look: dict[str, Any] = {"color": COLOURS[curve.code], "linestyle": "-" if solid else _DASHED, "linewidth": 1.2}
            axes.plot(*place[begin:end].T, gid=f"curve-{number}", zorder=2.0 + 0.1 * (curve.code != "GR"), **look)
            shown[curve.code, solid] = None
    marks: dict[tuple[float, float], str] = {}
    for curve, place in zip(curves, places, strict=True):
        for event in curve.events:
            if event.type != "EP":
                x, y = place[event.point].tolist()
                known = next((spot for spot in marks if np.allclose(spot, (x, y), rtol=1e-6)), (x, y))
                text = event.type.replace("R", "1:") if event.type in ("R1", "R2", "R3", "R4") else event.type
                if text not in marks.get(known, "").split(", "):
                    marks[known] = ", ".join(part for part in (marks.get(known, ""), text) if part)
    handles = [
        Line2D([], [], color=COLOURS[code], linewidth=1.2, linestyle="-" if solid else _DASHED, label=_label(code, solid, shown))
        for code in COLOURS
        for solid in (True, False)
        if (code, solid) in shown
    ]
    style.legend_below(figure, [*handles, *more], 4)
    if marks:
        spots = np.array(list(marks))
        axes.plot(*spots.T, "o", markersize=3.4, markerfacecolor="white", markeredgecolor=style.BLACK, markeredgewidth=0.7, zorder=5)
        figure.canvas.draw()
        room = Room(axes, places)
        inside = room.to_page(spots)
        room.take(inside, 2.0)
        room.write(list(marks.values()), inside, 2.5, beside=6.0)


def _pieces(curve: BifurcationCurve) -> list[tuple[int, int, bool]]:
    """Ranges of points that are drawn solid, or dashed where the bifurcation is subcritical. Unknown: as the point before."""
    kinds = curve.criticality
    for k in range(1, len(kinds)):
        kinds[k] = kinds[k] or kinds[k - 1]
    dashed = np.array([kind == "subcritical" for kind in kinds])
    changes = np.flatnonzero(np.diff(dashed)) + 1
    bounds = [0, *changes.tolist(), len(curve)]
    return [(begin, min(end + 1, len(curve)), not bool(dashed[begin])) for begin, end in zip(bounds, bounds[1:], strict=False)]


def _label(code: str, solid: bool, shown: dict[tuple[str, bool], None]) -> str:
    """The text of a kind of curve in the legend."""
    words = f"{code} {WORDS[code]}".replace("saddle-node (fold)", "saddle-node").replace(" bifurcation", "")
    if (code, False) not in shown:
        return words
    return f"{words}, {'super' if solid else 'sub'}critical"
