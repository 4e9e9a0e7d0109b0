"""Panels of the harmonic content of a family: the amplitude of each harmonic of a coordinate over the energy or a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["COLUMNS", "draw_harmonics", "harmonic_layout"]

_DECADES = 8
"""Shown below the largest amplitude. What is smaller is near rounding."""

_DASHES = ("-", "--", ":", "-.")
"""Of the harmonics beyond the colours."""

COLUMNS = 6
"""Columns of a layout with these panels: one, two or three panels in a row have equal parts of it."""

_IN_LEGEND = 12
"""Harmonics in a column of the legend."""


def harmonic_layout(coordinates: Sequence[str]) -> list[list[str]]:
    """Rows of panels (`matplotlib.figure.Figure.subplot_mosaic`) for the harmonics of coordinates, at most three in each.

    Examples
    --------
    >>> harmonic_layout(["x", "y"])
    [['harmonics-x', 'harmonics-x', 'harmonics-x', 'harmonics-y', 'harmonics-y', 'harmonics-y']]
    """
    beside = _beside(coordinates)
    parts = [f"harmonics-{name}" for name in coordinates for _ in range(COLUMNS // beside)]
    parts += ["."] * (-len(parts) % COLUMNS)
    return [parts[k : k + COLUMNS] for k in range(0, len(parts), COLUMNS)]


def _beside(coordinates: Sequence[str]) -> int:
    """How many panels are in a row: four make two rows of two."""
    return 2 if len(coordinates) == 4 else min(len(coordinates), 3)


def draw_harmonics(
    mosaic: Mapping[Any, Axes],
    coordinates: Sequence[str],
    curves: Sequence[tuple[np.ndarray, np.ndarray]],
    limits: tuple[float, float],
    axis: tuple[str, str],
    *,
    log: bool,
) -> None:
    """Draw the amplitudes of the harmonics of coordinates, with one legend at the right of the first row.

    Parameters
    ----------
    mosaic : mapping of str to Axes
        The panels of `harmonic_layout`.
    coordinates : sequence of n str
    curves : sequence of ((N,), (N, K + 1, n)) ndarray
        Abscissas and amplitudes of each branch.
    limits, axis
        Of the abscissas: their limits, text and symbol.
    log : bool
        Whether the axis of abscissas is logarithmic.
    """
    from matplotlib.lines import Line2D

    drawn: set[int] = set()
    beside = _beside(coordinates)
    for c, name in enumerate(coordinates):
        axes = mosaic[f"harmonics-{name}"]
        drawn |= _draw_coordinate(axes, [(x, amplitudes[:, :, c]) for x, amplitudes in curves], name)
        style.set_axis(axes, "x", limits, 14 // beside if log else 10 // beside, *axis, log=log)
    handles = [Line2D([], [], linewidth=1.0, label=str(k) if k else "mean", **_look(k)) for k in sorted(drawn)]
    if handles:
        place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0}
        last = mosaic[f"harmonics-{coordinates[beside - 1]}"]
        last.legend(handles=handles, frameon=False, title="harmonic", handlelength=1.4, ncols=-(-len(handles) // _IN_LEGEND), **place)


def _look(k: int) -> dict[str, Any]:
    return {"color": style.LINES[k % len(style.LINES)], "linestyle": _DASHES[k // len(style.LINES) % len(_DASHES)]}


def _draw_coordinate(axes: Axes, curves: Sequence[tuple[np.ndarray, np.ndarray]], name: str) -> set[int]:
    """Draw those of one coordinate, amplitudes (N, K + 1) of each branch, and set the ordinate. Returns the harmonics that are drawn."""
    sizes = np.abs(np.concatenate([amplitudes for _, amplitudes in curves]))
    largest = float(np.nanmax(sizes, initial=0.0))
    floor = largest * 10.0**-_DECADES
    # The mean of a symmetric motion and its even harmonics are zero.
    shown = {k for k in range(sizes.shape[1]) if np.nanmax(sizes[:, k], initial=0.0) > floor}
    for k in sorted(shown):
        for number, (x, amplitudes) in enumerate(curves, 1):
            y = np.abs(amplitudes[:, k])
            axes.plot(x, np.where(y > floor, y, np.nan), gid=f"harmonic-{name}-{k}-{number}", linewidth=1.0, **_look(k))
    lowest = float(np.min(sizes[sizes > floor], initial=largest))
    limits = style.limits_of(np.array([lowest, largest]) if shown else np.ones(1), 0.08, log=True)
    style.set_axis(axes, "y", limits, 5, "amplitude of harmonics of", style.symbol_of(name), log=True)
    if not shown:
        axes.set_yticks([])
        axes.text(0.5, 0.5, "all are zero", transform=axes.transAxes, ha="center", va="center")
    return shown
