"""The figure of the force of a spring at values of a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def spring_figure(forces: Mapping[str, np.ndarray], *, at: np.ndarray, name: str, place: str, walls: Sequence[float]) -> Figure:
    """Forces (m,) by the value of the parameter `name`, over displacements `at` (m,), and the walls that the spring becomes (Lee, Nucera,
    Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868, Fig. 5). The axis of the force covers what acts inside the walls."""
    inside = (at >= min(walls)) & (at <= max(walls)) if walls else np.ones(len(at), dtype=bool)
    limits = style.limits_of(np.array([*forces.values()])[:, inside if inside.any() else slice(None)], 0.25)
    with style.figure_settings():
        figure = style.new_figure(4.4)
        axes = figure.subplots()
        for k, (value, force) in enumerate(forces.items()):
            look: dict[str, Any] = {"color": style.LINES[k % len(style.LINES)], "linestyle": "-" if k < len(style.LINES) else "--"}
            axes.plot(at, force, label=f"${style.symbol_of(name)} = {value}$", gid=f"force-{k}", **look)
        for k, wall in enumerate(walls):
            label = rf"${style.symbol_of(name)} \to \infty$: impact" if k == 0 else None
            axes.plot([0.0, wall, wall], [0.0, 0.0, limits[wall > 0.0]], color=style.BLACK, linewidth=2.0, label=label, gid=f"wall-{k}")
        style.set_axis(axes, "x", (float(at[0]), float(at[-1])), 7, "displacement", "w")
        style.set_axis(axes, "y", limits, 6, "force", "f(w)")
        axes.set_title(f"Force of {place}")
        style.legend_below(figure, axes.get_legend_handles_labels()[0], 8)
    return figure
