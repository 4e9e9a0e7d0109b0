"""What the rows say, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from saltus.bench.methods import OWN, OWN_SHORT
from saltus.bench.tables import Table, number
from saltus.bench.tasks import Task

__all__ = ["ERRORS", "best_rows", "page_text", "tables", "worst"]

Row = dict[str, Any]

ERRORS = ("orbit", "energy", "multipliers", "located")
"""The kinds of error."""

DIGITS = (1e-3, 1e-6, 1e-9, 1e-12)
"""Errors for which the fastest setting is looked for."""

PEER, ENOUGH = "AUTO-07p", 1e-12
"""The program of the field, and the error at which it is compared."""


def worst(row: Row) -> float | None:
    """The largest of the errors of orbit, energy and located points, by which rows are compared; multipliers are told apart."""
    known = [row["errors"][kind] for kind in ("orbit", "energy", "located") if row["errors"][kind] is not None]
    return max(known) if known else None


def best_rows(rows: Sequence[Row], task: str) -> list[Row]:
    """For each method of a task the row of least error, or its last row where it has none."""
    out: dict[str, Row] = {}
    for row in rows:
        if row.get("task") != task:
            continue
        old, new = out.get(row["method"]), worst(row)
        if old is None or (new is not None and (worst(old) is None or new < worst(old))):  # type: ignore[operator]
            out[row["method"]] = row
    return list(out.values())


def tables(rows: Sequence[Row], tasks: Sequence[Task], setting_names: dict[str, str]) -> list[Table]:
    """A table for each task, then what each digit costs, layers, and growth."""
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
    """The machine, what was skipped, and the tables, as Markdown."""
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
        cells.append(
            (
                row["method"],
                setting,
                number(1e6 * row["seconds"]),
                *(_error(row["errors"][kind]) for kind in ERRORS),
                number(row["seconds"] / own) if own else "-",
                number(starts[0], 2) if starts else "-",
                "-" if row["memory"] is None else number(row["memory"] / 2**20),
            )
        )
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
    """Microseconds a point of the fastest setting of each method that has an error, in orbit, energy and located points."""
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
        "What each digit costs: microseconds a point for an error of",
        ("task", "method", *(f"{error:.0e}" for error in DIGITS)),
        cells,
        ("The fastest setting whose errors of orbit, energy and located points are all below; - where no setting is.",),
    )


def _beside(rows: Sequence[Row], tasks: Sequence[Task]) -> Table:
    """Time a point of the program of the field to that of saltus with everything on, at an error that is small for both."""
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
            f"saltus with multipliers and admissibility, Python between the steps included; {PEER} without these, at its fastest setting,",
            f"at short steps. {OWN}: at the long steps that it takes by itself; {OWN_SHORT}: at short ones, too.",
        ),
    )


def _error(value: float | None) -> str:
    return "-" if value is None else number(value, 2)


def _layers(rows: Sequence[Row]) -> Table:
    cells = []
    for row in rows:
        layers = row["layers"]
        outside = 100.0 * (layers["total"] - layers["compiled"]) / layers["total"]
        cells.append((row["task"], *(number(1e6 * layers[name]) for name in layers), f"{outside:.0f} %"))
    return Table(
        "Where the microseconds of a point go",
        ("task", *rows[0]["layers"], "not compiled"),
        cells,
        (
            "Compiled: arithmetic. Entering: the way into compiled code and back. Family, engine: Python between the steps.",
            "The total is that of points without an event on their way, the inner layers are those of all blocks: where events are",
            "many, the engine comes out negative.",
        ),
    )


def _growth(rows: Sequence[Row], against: str) -> Table:
    if against == "quarter period":
        found = [
            (f"{row['value']:g}", number(row["seconds"]), str(row["orbits"]), "yes" if row["settled"] else "no") for row in rows
        ]
        return Table("Discovery at h = 1 against its period bound", ("longest quarter period", "s", "orbits", "settled"), found)
    columns = (against, "us a point, all on", "an added one", "orbit only", "multipliers by the saddle-point matrix", "residual")
    before: Row | None = None
    cells = []
    for row in rows:
        added = "-" if before is None else number(1e6 * (row["seconds"] - before["seconds"]) / (row["value"] - before["value"]))
        cells.append(
            (
                str(row["value"]), number(1e6 * row["seconds"]), added, number(1e6 * row["orbit_only"]),
                number(1e6 * row["saddle_point"]), _error(row["residual"]),
            )
        )  # fmt: skip
        before = row
    return Table(f"A point against {'inner ' * (against == 'impacts')}{against}", columns, cells)
