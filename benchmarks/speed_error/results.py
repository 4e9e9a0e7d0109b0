"""Results of the speed-error benchmark: the rows as tables, and as the two figures of the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.measure import BELOW, Difference
from benchmarks.report import Table, number
from benchmarks.speed_error.methods import OWN, OWN_SHORT, Task
from branches.figures.style import BLACK, BLUE, GREEN, GREY, LINES, VERMILION, figure_settings, new_figure, set_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["ERRORS", "best_rows", "draw_growth", "draw_work_precision", "page_text", "tables", "worst"]

Row = dict[str, Any]

ERRORS = ("orbit", "energy", "multipliers", "located")
"""The kinds of error."""

DIGITS = (1e-3, 1e-6, 1e-9, 1e-12)
"""Errors for which the fastest setting is listed."""

PEER, ENOUGH = "AUTO-07p", 1e-12
"""The continuation program to compare with, and the error at which it is compared."""


def worst(row: Row) -> float | None:
    """The largest error of orbit, energy and located points. Rows are compared by it; multipliers have their own column."""
    known = [row["errors"][kind] for kind in ("orbit", "energy", "located") if row["errors"][kind] is not None]
    return max(known) if known else None


def best_rows(rows: Sequence[Row], task: str) -> list[Row]:
    """The row of least error of each method of a task, or its last row if it has no error."""
    out: dict[str, Row] = {}
    for row in rows:
        if row.get("task") != task:
            continue
        old, new = out.get(row["method"]), worst(row)
        if old is None or (new is not None and (worst(old) is None or new < worst(old))):  # type: ignore[operator]
            out[row["method"]] = row
    return list(out.values())


def tables(rows: Sequence[Row], tasks: Sequence[Task], setting_names: dict[str, str]) -> list[Table]:
    """A table for each task, then the cost of each digit, the layers, and the growth."""
    out = [_task(rows, task, setting_names) for task in tasks if any(row.get("task") == task.name for row in rows)]
    if out:
        out.append(_digits(rows, tasks))
        beside = _beside(rows, tasks)
        if beside.rows:
            out.append(beside)
    layers = [row for row in rows if row.get("layers")]
    if layers:
        out.append(_layers(layers))
    for against in dict.fromkeys(row["growth"] for row in rows if "growth" in row):
        out.append(_growth([row for row in rows if row.get("growth") == against], against))
    return out


def page_text(record: dict[str, Any], found: Sequence[Table]) -> str:
    """The machine, the skipped methods, and the tables, as Markdown."""
    skipped = [f"Skipped: {name}: {why}." for name, why in record["skipped"].items()]
    return "\n".join([*record["machine"], *skipped, "", *(table.markdown() for table in found)])


def _task(rows: Sequence[Row], task: Task, setting_names: dict[str, str]) -> Table:
    best = best_rows(rows, task.name)
    own = next((row["seconds"] for row in best if row["method"] == OWN), None)
    cells = []
    for row in best:
        setting = "" if row["setting"] is None else f"{setting_names.get(row['method'], '')} {row['setting']:.0e}"
        if row["failed"]:
            cells.append((row["method"], setting, row["failed"], *["-"] * 7))
            continue
        same = [other for other in rows if other.get("task") == task.name and other["method"] == row["method"]]
        starts = [other["first"] for other in same if other["first"]]
        errors = [_error(row["errors"][kind]) for kind in ERRORS]
        ratio = number(row["seconds"] / own) if own else "-"
        first = number(starts[0], 2) if starts else "-"
        memory = "-" if row["memory"] is None else number(row["memory"] / 2**20)
        cells.append((row["method"], setting, number(1e6 * row["seconds"]), *errors, ratio, first, memory))
    return Table(
        task.title,
        (
            "method", "setting", f"us a{'n' * (task.point[0] in 'aeio')} {task.point}", *ERRORS, f"to {OWN}", "first, s", "MB",
        ),
        cells,
        (
            f"Each method at the setting of its least error. Relative errors of orbit, energy, multipliers, located points against: "
            f"{task.reference}.",
        ),
    )  # fmt: skip


def _digits(rows: Sequence[Row], tasks: Sequence[Task]) -> Table:
    """Microseconds a point of the fastest setting of each method that reaches an error."""
    cells = []
    for task in tasks:
        own = [row for row in rows if row.get("task") == task.name and row["seconds"] is not None and worst(row) is not None]
        for method in dict.fromkeys(row["method"] for row in own):
            times = []
            for error in DIGITS:
                good = [row["seconds"] for row in own if row["method"] == method and worst(row) <= error]  # type: ignore[operator]
                times.append(number(1e6 * min(good)) if good else "-")
            cells.append((task.name, method, *times))
    return Table(
        "Cost of each digit: microseconds a point for an error of",
        ("task", "method", *(f"{error:.0e}" for error in DIGITS)),
        cells,
        ("The fastest setting whose errors of orbit, energy and located points are all smaller; - if there is none.",),
    )


def _beside(rows: Sequence[Row], tasks: Sequence[Task]) -> Table:
    """Time a point of the other continuation program beside that of saltus with all test functions, at a small error of both."""
    cells = []
    for task in tasks:
        if task.point != "orbit":
            continue
        fastest = {}
        for method in (OWN, OWN_SHORT, PEER):
            own = [row for row in rows if row.get("task") == task.name and row["method"] == method and row["seconds"] is not None]
            good = [row for row in own if (error := worst(row)) is not None and error <= ENOUGH]
            fastest[method] = min(good, key=lambda row: row["seconds"], default=None)
        theirs = fastest[PEER]
        if theirs is None:
            continue
        for method in (OWN, OWN_SHORT):
            ours = fastest[method]
            if ours is None:
                continue
            cells.append(
                (
                    task.title, method, number(1e6 * ours["seconds"]), _error(worst(ours)), number(1e6 * theirs["seconds"]),
                    _error(worst(theirs)), f"{theirs['setting']:g}", number(theirs["seconds"] / ours["seconds"]),
                )
            )  # fmt: skip
    return Table(
        f"Beside {PEER}, at an error below {ENOUGH:.0e}",
        ("task", "method", "us an orbit", "its error", f"{PEER}, us an orbit", "its error", "NTST", "ratio"),
        cells,
        (
            f"saltus with multipliers and admissibility, including Python between the steps; {PEER} without them, at its fastest setting",
            f"and short steps. {OWN}: at its own, long steps; {OWN_SHORT}: at short steps as well.",
        ),
    )


def _error(value: float | None) -> str:
    return "-" if value is None else number(value, 2)


def _layers(rows: Sequence[Row]) -> Table:
    cells = []
    for row in rows:
        layers = {name: Difference(*seconds) for name, seconds in row["layers"].items()}
        outside = 100.0 * (layers["total"].value - layers["compiled"].value) / layers["total"].value
        cells.append((row["task"], *(seconds.per(1e-6).text for seconds in layers.values()), f"{outside:.0f} %"))
    return Table(
        "Where the microseconds of a point go",
        ("task", *rows[0]["layers"], "not compiled"),
        cells,
        (
            "Compiled: arithmetic. Entering: the call into compiled code and back. Family, engine: Python between the steps.",
            "The total is that of points without an event before them; the inner layers are those of all blocks.",
            BELOW,
        ),
    )


def _growth(rows: Sequence[Row], against: str) -> Table:
    if against == "quarter period":
        found = [
            (f"{row['value']:g}", number(row["seconds"]), str(row["orbits"]), "yes" if row["complete"] else "no") for row in rows
        ]
        return Table("Discovery at h = 1 against its period bound", ("longest quarter period", "s", "orbits", "complete"), found)
    columns = (against, "us a point, all on", "an added one", "orbit only", "multipliers by the saddle-point matrix", "residual")
    before: Row | None = None
    cells = []
    for row in rows:
        added = "-"
        if before is not None:
            scatter = row.get("scatter", 0.0) + before.get("scatter", 0.0)
            added = Difference(row["seconds"] - before["seconds"], scatter).per(1e-6 * (row["value"] - before["value"])).text
        cells.append(
            (
                str(row["value"]), number(1e6 * row["seconds"]), added, number(1e6 * row["orbit_only"]),
                number(1e6 * row["saddle_point"]), _error(row["residual"]),
            )
        )  # fmt: skip
        before = row
    return Table(f"A point against {'inner ' * (against == 'impacts')}{against}", columns, cells, (BELOW,))


_MARKERS = ("o", "s", "^", "v", "D", "P", "X", "<", ">", "h", "*", "d")
_OTHERS = (*(colour for colour in LINES if colour != BLUE), GREY)
_LEAST = 1e-17
"""Least error drawn."""


def draw_work_precision(path: Path, rows: Sequence[Row], tasks: Sequence[Task]) -> None:
    """One panel a task with rows: error against time a point, log-log, with open markers for the errors of the multipliers."""
    drawn = [task for task in tasks if any(row.get("task") == task.name and row["seconds"] for row in rows)]
    names = list(dict.fromkeys(row["method"] for row in rows if "method" in row and row["seconds"]))
    columns = min(2, max(1, len(drawn)))
    lines = -(-len(drawn) // columns)
    with figure_settings():
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
        # All methods of saltus have the same colour.
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
    """Three panels: a point against impacts, a point against degrees of freedom, a discovery against its period bound."""
    with figure_settings():
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
            set_axis(panel, "x", panel.get_xlim(), 7, f"{'inner ' * (against == 'impacts')}{against}", "", log=True)
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
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
        figure.savefig(path)
