"""Pictures of the rows: error against time a point, and how the cost grows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from branches.diagram.style import BLACK, BLUE, GREEN, GREY, LINES, VERMILION, new_figure, picture_settings
from saltus.bench.methods import OWN
from saltus.bench.report import worst
from saltus.bench.tasks import Task

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_growth", "draw_work_precision"]

Row = dict[str, Any]

_MARKERS = ("o", "s", "^", "v", "D", "P", "X", "<", ">", "h", "*", "d")
_OTHERS = (*(colour for colour in LINES if colour != BLUE), GREY)
_LEAST = 1e-17
"""Errors are drawn no smaller."""


def draw_work_precision(path: Path, rows: Sequence[Row], tasks: Sequence[Task]) -> None:
    """One panel a task: error against time a point, log-log; the multipliers' errors as open markers.

    Parameters
    ----------
    path : pathlib.Path
    rows : sequence of dict
        As `saltus.bench.rows.rows_of` gives them; rows of growth are left out.
    tasks : sequence of Task
        In the order of the panels; those without rows get none.
    """
    drawn = [task for task in tasks if any(row.get("task") == task.name and row["seconds"] for row in rows)]
    names = list(dict.fromkeys(row["method"] for row in rows if "method" in row and row["seconds"]))
    columns = min(2, max(1, len(drawn)))
    lines = -(-len(drawn) // columns)
    with picture_settings():
        figure = new_figure(0.8 + 2.5 * max(1, lines))
        panels = figure.subplots(max(1, lines), columns, squeeze=False).ravel()
        for panel, task in zip(panels, drawn, strict=False):
            _panel(panel, [row for row in rows if row.get("task") == task.name and row["seconds"]], task, names)
        for panel in panels[len(drawn) :]:
            panel.set_axis_off()
        handles: dict[str, Any] = {}
        for panel in panels[: len(drawn)]:
            for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
                handles.setdefault(label, handle)
        known = [name for name in names if name in handles]
        figure.legend([handles[name] for name in known], known, loc="outside lower center", ncols=3, frameon=False)
        figure.savefig(path)


def _panel(panel: Axes, rows: Sequence[Row], task: Task, names: Sequence[str]) -> None:
    from matplotlib.ticker import NullFormatter

    panel.set_xscale("log")
    panel.set_yscale("log")
    for name in dict.fromkeys(row["method"] for row in rows):
        at = names.index(name)
        # The routes of saltus share a colour.
        others = [other for other in names if not other.startswith(OWN)]
        colour = BLUE if name.startswith(OWN) else _OTHERS[others.index(name) % len(_OTHERS)]
        style: dict[str, Any] = {"color": colour, "marker": _MARKERS[at % len(_MARKERS)], "markersize": 4.0}
        own = [row for row in rows if row["method"] == name]
        with_orbit = [(1e6 * row["seconds"], max(_LEAST, error)) for row in own if (error := worst(row)) is not None]
        if with_orbit:
            panel.plot(*zip(*with_orbit, strict=True), linestyle="-", linewidth=0.8, label=name, **style)
        with_them = [(1e6 * row["seconds"], max(_LEAST, error)) for row in own if (error := row["errors"]["multipliers"]) is not None]
        if with_them:
            panel.plot(*zip(*with_them, strict=True), linestyle=":", linewidth=0.6, markerfacecolor="none", **style)
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_minor_formatter(NullFormatter())
    panel.set_title(task.title)
    panel.set_xlabel(f"microseconds a{'n' * (task.point[0] in 'aeio')} {task.point}")
    panel.set_ylabel("relative error")
    panel.grid(True, which="major", color=GREY, alpha=0.25, linewidth=0.4)


def draw_growth(path: Path, rows: Sequence[Row]) -> None:
    """Three panels: a point against impacts, a point against degrees of freedom, a discovery against its period bound.

    Parameters
    ----------
    path : pathlib.Path
    rows : sequence of dict
        Those with `growth` are drawn.
    """
    with picture_settings():
        from matplotlib.ticker import NullFormatter

        figure = new_figure(2.6)
        panels = figure.subplots(1, 3)
        for panel, against in zip(panels, ("impacts", "degrees of freedom"), strict=False):
            own = [row for row in rows if row.get("growth") == against]
            values = [row["value"] for row in own]
            for key, colour, marker, label in (
                ("seconds", BLUE, "o", "all on"),
                ("orbit_only", GREEN, "s", "orbit only"),
                ("saddle_point", VERMILION, "^", "saddle-point multipliers"),
            ):
                panel.loglog(values, [1e6 * row[key] for row in own], color=colour, marker=marker, markersize=3.5, label=label)
            if own and against == "impacts":
                # A guide of slope one through the last point.
                last = own[-1]
                panel.loglog(
                    values, [1e6 * last["seconds"] * value / last["value"] for value in values], color=BLACK, linestyle=":", linewidth=0.7,
                    label="linear",
                )  # fmt: skip
            panel.xaxis.set_minor_formatter(NullFormatter())
            panel.set_xticks(*2 * [[value for value in (1, 2, 5, 10, 20, 50, 100, 1000) if values and values[0] <= value <= values[-1]]])
            panel.set_xlabel(f"{'inner ' * (against == 'impacts')}{against}")
            panel.set_ylabel("microseconds a point")
        own = [row for row in rows if row.get("growth") == "quarter period"]
        panels[2].semilogy([row["value"] for row in own], [row["seconds"] for row in own], color=BLUE, marker="o", markersize=3.5)
        for row in own:
            panels[2].annotate(
                f"{row['orbits']}", (row["value"], row["seconds"]), xytext=(0, 5), textcoords="offset points", fontsize=6.5, ha="center"
            )
        panels[2].set_xlabel("longest quarter period")
        panels[2].set_ylabel("seconds of a discovery (orbits found)")
        panels[2].margins(y=0.2)
        panels[0].legend(frameon=False)
        figure.savefig(path)
