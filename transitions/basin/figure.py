"""The picture of basins: a colour for each attractor, with the places of attractors and saddles at the phase of the starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures import style
from transitions.basin.record import IMPOSSIBLE, UNDECIDED, AttractorKind

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from transitions.basin.record import Basin

__all__ = ["basin_figure"]

_COLOURS = (
    style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.SKY, style.VERMILION, style.YELLOW,
    "#332288", "#882255", "#117733", "#999933", "#AA4499", "#661100", "#6699CC",
)  # fmt: skip
_UNDECIDED_COLOUR = style.BLACK
_SHOWN = 12
"""Attractors in the legend; those with fewer starts share an entry."""
_ROUNDING = 1e-9
"""Distance from the border, as a part of the range, at which a mark counts as on it."""


def basin_figure(basin: Basin, *, title: str = "") -> Figure:
    """Draw basins over the two coordinates that vary.

    Each attractor has a colour, and a dot at each of its states at the phase of the starts. Saddles are crosses. With more than two
    coordinates in the state, both are projected onto the plane. Starts beyond a stop are hatched, and undecided ones black.

    Parameters
    ----------
    basin : Basin
    title : str
    """
    from matplotlib.colors import ListedColormap

    grid = basin.grid
    image = grid.image(basin.attractor)
    count = len(basin.attractors)
    colours = [_COLOURS[k % len(_COLOURS)] for k in range(count)]
    with style.figure_settings():
        figure = style.new_figure(5.4)
        if title:
            figure.suptitle(title)
        axes = figure.subplots()
        shades = ListedColormap([style.PALE, _UNDECIDED_COLOUR, *colours])
        extent = (grid.x.low, grid.x.high, grid.y.low, grid.y.high)
        axes.imshow(
            image, origin="lower", extent=extent, aspect="auto", cmap=shades, vmin=IMPOSSIBLE - 0.5, vmax=count - 0.5,
            interpolation="nearest", gid="basins",
        )  # fmt: skip
        entries = _patches(basin, colours)
        if np.any(basin.attractor == IMPOSSIBLE):
            _hatch(axes, basin, image == IMPOSSIBLE)
        entries += _marks(axes, basin, colours)
        for which, axis in (("x", grid.x), ("y", grid.y)):
            velocity = axis.name.endswith("'")
            words = "velocity" if velocity else "displacement"
            symbol = style.symbol_of(axis.name.removesuffix("'"), velocity=velocity)
            style.set_axis(axes, which, (axis.low, axis.high), 8, words, symbol)
        axes.set_title(_others(basin), fontsize=style.SMALL)
        style.legend_below(figure, entries, 3, height=5.4)
    return figure


def _others(basin: Basin) -> str:
    """What the starts share: the values of the other coordinates, and the phase."""
    grid = basin.grid
    names = [*((name, False) for name in grid.coordinates), *((name, True) for name in grid.coordinates)]
    parts = [
        f"${style.symbol_of(name, velocity=velocity)} = {value:.5g}$"
        for k, ((name, velocity), value) in enumerate(zip(names, grid.base.tolist(), strict=True))
        if k not in grid.axes
    ]
    phase = rf"$\omega t = {grid.phase:.4g}$"
    return "starts at " + ", ".join([phase, *parts])


def _patches(basin: Basin, colours: Sequence[str]) -> list[Any]:
    """The legend entries of areas."""
    from matplotlib.patches import Patch

    entries: list[Any] = []
    shares = basin.shares
    for k, found in enumerate(basin.attractors[:_SHOWN]):
        text = found.family if not found.branch else f"branch {found.branch}, {found.family}"
        if found.kind is AttractorKind.PERIODIC and not found.sequence:
            text += " (no impacts)"
        if 0 <= found.mirror < k:
            text += f", mirror image of A{found.mirror + 1}"
        entries.append(Patch(facecolor=colours[k], edgecolor=style.BLACK, linewidth=0.4, label=f"A{k + 1} {text}, {_percent(shares[k])}"))
    if len(basin.attractors) > _SHOWN:
        rest = float(shares[_SHOWN:].sum())
        entries.append(Patch(facecolor="none", edgecolor="none", label=f"and {len(basin.attractors) - _SHOWN} more, {_percent(rest)}"))
    if np.any(basin.attractor == UNDECIDED):
        part = float(np.sum(basin.attractor == UNDECIDED)) / max(1, basin.possible)
        entries.append(Patch(facecolor=_UNDECIDED_COLOUR, label=f"undecided, {_percent(part)}"))
    if np.any(basin.attractor == IMPOSSIBLE):
        entries.append(Patch(facecolor=style.PALE, edgecolor=style.GREY, hatch="////", linewidth=0.4, label="beyond a stop"))
    return entries


def _percent(part: float) -> str:
    """A share in words: never 0 % of what is there, nor 100 % of what is not all."""
    percent = 100.0 * part
    digits = 1 if 0.1 <= percent <= 99.9 or percent == 100.0 else 3
    return f"{percent:.{digits}f} %"


def _hatch(axes: Axes, basin: Basin, beyond: np.ndarray) -> None:
    """Hatch the cells that are beyond a stop."""
    grid = basin.grid
    x, y = grid.x.values, grid.y.values
    padded = np.pad(beyond.astype(float), 1, mode="edge")
    dx, dy = x[1] - x[0], y[1] - y[0]
    wide = np.concatenate([[x[0] - dx], x, [x[-1] + dx]]), np.concatenate([[y[0] - dy], y, [y[-1] + dy]])
    hatching = axes.contourf(*wide, padded, levels=[0.5, 1.5], colors="none", hatches=["////"])
    hatching.set_edgecolor(style.GREY)
    hatching.set_linewidth(0.0)
    axes.set(xlim=(grid.x.low, grid.x.high), ylim=(grid.y.low, grid.y.high))


def _marks(axes: Axes, basin: Basin, colours: Sequence[str]) -> list[Any]:
    """Draw the places of attractors and saddles that are in the picture; return the legend entries."""
    i, j = basin.grid.axes
    projected = len(basin.grid.coordinates) > 1
    where = ", projected" if projected else ""
    halo: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 8.0, "markeredgewidth": 0.0, "color": "#FFFFFF"}
    dot: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 6.0, "markeredgecolor": style.BLACK, "markeredgewidth": 0.8}
    cross: dict[str, Any] = {"linestyle": "none", "marker": "X", "markersize": 7.0, "markeredgecolor": style.BLACK, "markeredgewidth": 0.8}
    whole: dict[str, Any] = {"clip_on": False, "zorder": 3.0}  # a mark on the border is not cut, and is in front of the frame
    entries: list[Any] = []
    placed = [(k, basin.positions[k]) for k, found in enumerate(basin.attractors) if found.period]
    for k, states in placed:
        shown = states[_inside(basin, states)]
        axes.plot(shown[:, i], shown[:, j], **whole, **halo)
        axes.plot(shown[:, i], shown[:, j], gid=f"A{k + 1}", **whole, **dot | {"markerfacecolor": colours[k]})
    if placed:
        text = f"attractor at this phase{where}{_left_out(basin, [states for _, states in placed])}"
        entries.append(_handle(dot | {"markerfacecolor": "#FFFFFF"}, text))
    if basin.saddles:
        for k, saddle in enumerate(basin.saddles):
            shown = saddle.states[_inside(basin, saddle.states)]
            axes.plot(shown[:, i], shown[:, j], gid=f"S{k + 1}", **whole, **cross | {"markerfacecolor": "#FFFFFF"})
        text = f"saddle at this phase{where}{_left_out(basin, [saddle.states for saddle in basin.saddles])}"
        entries.append(_handle(cross | {"markerfacecolor": "#FFFFFF"}, text))
    return entries


def _left_out(basin: Basin, places: Sequence[np.ndarray]) -> str:
    """How many orbits are out of the picture, in words."""
    outside = sum(not _inside(basin, states).any() for states in places)
    return f" ({outside} of {len(places)} out of the picture)" if outside else ""


def _inside(basin: Basin, states: np.ndarray) -> np.ndarray:
    """Which of some states (p, 2n) are in the picture, (p,); those on its border are, within rounding."""
    found = np.ones(len(states), dtype=bool)
    for k, axis in zip(basin.grid.axes, (basin.grid.x, basin.grid.y), strict=True):
        slack = _ROUNDING * (axis.high - axis.low)
        found &= (states[:, k] >= axis.low - slack) & (states[:, k] <= axis.high + slack)
    return found


def _handle(look: dict[str, Any], label: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **look)
