"""Panels of the harmonic content of a family: the amplitude of each harmonic of a coordinate over the energy or a parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_harmonics"]

_DECADES = 8
"""Shown below the largest amplitude. What is smaller is near rounding."""

_DASHES = ("-", "--", ":", "-.")
"""Of the harmonics beyond the colours."""


def draw_harmonics(axes: Axes, curves: list[tuple[np.ndarray, np.ndarray]], name: str, *, legend: bool) -> None:
    """Draw the amplitudes of the harmonics of a coordinate, and set the ordinate.

    Parameters
    ----------
    axes : Axes
    curves : list of ((N,), (N, K + 1)) ndarray
        Abscissas and amplitudes of each branch.
    name : str
        Of the coordinate.
    legend : bool
        Whether the numbers of the harmonics are written.
    """
    sizes = np.abs(np.concatenate([amplitudes for _, amplitudes in curves]))
    largest = float(np.nanmax(sizes, initial=0.0)) or 1.0
    floor = largest * 10.0**-_DECADES
    # The mean of a symmetric motion and its even harmonics are zero.
    shown = [k for k in range(sizes.shape[1]) if np.nanmax(sizes[:, k], initial=0.0) > floor]
    for k in shown:
        for number, (x, amplitudes) in enumerate(curves, 1):
            y = np.abs(amplitudes[:, k])
            look: dict[str, Any] = {"color": style.LINES[k % len(style.LINES)], "linestyle": _DASHES[k // len(style.LINES) % len(_DASHES)]}
            look["label"] = ("mean" if k == 0 else str(k)) if number == 1 else None
            axes.plot(x, np.where(y > floor, y, np.nan), gid=f"harmonic-{name}-{k}-{number}", linewidth=1.0, **look)
    lowest = float(np.min(sizes[sizes > floor], initial=largest))
    limits = style.limits_of(np.array([lowest, largest]), 0.08, log=True)
    style.set_axis(axes, "y", limits, 5, "amplitude of harmonics of", style.symbol_of(name), log=True)
    if legend:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, title="harmonic", handlelength=1.4)
