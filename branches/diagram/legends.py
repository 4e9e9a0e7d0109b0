"""The legend below the panels of a picture: in as many rows as its entries need."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

__all__ = ["legend_below"]


def legend_below(figure: Figure, entries: Sequence[Any], most: int, **look: Any) -> Legend:
    """Draw a legend below the panels, in the place of the one that is there.

    Parameters
    ----------
    figure : Figure
    entries : sequence of artists
    most : int
        Columns at most; there are fewer where so many are wider than the figure.
    **look
        As for `matplotlib.figure.Figure.legend`.
    """
    for columns in range(max(1, min(most, len(entries))), 0, -1):
        for old in list(figure.legends):
            old.remove()
        legend = figure.legend(handles=list(entries), loc="outside lower center", ncols=columns, frameon=False, **look)
        if legend.get_window_extent().width <= figure.bbox.width:
            break
    return legend
