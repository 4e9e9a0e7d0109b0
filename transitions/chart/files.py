"""Files of charts: JSON that is also a file of curves, and a table of the points of all curves and of the cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from branches.curves.files import CHART, curves_record, curves_table
from branches.forced.record import SCHEMA
from branches.tables import Table, plain
from transitions.chart.chart import Chart
from transitions.chart.regions import Regions

__all__ = ["chart_record", "chart_table"]


def chart_record(chart: Chart) -> dict[str, Any]:
    """A chart as plain data: the curves as in a file of `saltus curve`, the points of codimension two, the regions and the stages."""
    plan = chart.plan
    if chart.curves:
        base = curves_record(chart.curves)
    else:
        problem = plan.branches[0].problem
        base = {
            "schema": SCHEMA,
            "coordinates": list(problem.system.coordinates),
            "system": plain(problem.parametric.describe()),
            "curves": [],
        }
    curves = base.pop("curves")
    return {
        **base,
        "kind": CHART,
        "names": list(plan.names),
        "keep": list(plan.keep),
        "window": plain(np.array(plan.window)),
        "found_in": chart.stage_of,
        "codimension_two": [plain(point._asdict()) for point in chart.points],
        "stages": [stage._asdict() for stage in chart.stages],
        "notes": list(chart.notes),
        "regions": None if chart.regions is None else _regions(chart.regions),
        "curves": curves,
    }  # fmt: skip


def _regions(regions: Regions) -> dict[str, Any]:
    kinds = {kind: f"K{k}" for k, kind in enumerate(dict.fromkeys(kind for found in regions.counts for kind in found), 1)}
    return {
        "x": regions.x.tolist(),
        "y": regions.y.tolist(),
        "kinds": [{"id": name, **kind._asdict(), "text": kind.text} for kind, name in kinds.items()],
        "sets": [
            {"kinds": [kinds[kind] for kind in found], "cells": count, "share": count / len(regions)}
            for found, count in regions.counts.items()
        ],
        "cells": regions.image.tolist(),
        "simulated": regions.simulated,
        "unsettled": regions.unsettled,
        "without": dict(regions.reasons),
    }  # fmt: skip


def chart_table(chart: Chart) -> Table:
    """The points of the curves as in the table of `saltus curve`, then a row for each cell, with curve 0 and type "cell". attractors: the
    kinds of attractors in a cell."""
    first, second = chart.plan.names[:2]
    table: Table = curves_table(chart.curves) if chart.curves else {}
    rows = len(table["curve"]) if table else 0
    if chart.regions is None:
        return {**table, "attractors": np.full(rows, "", dtype="<U1")}
    regions = chart.regions
    x, y = (values.ravel() for values in np.meshgrid(regions.x, regions.y))
    count = len(x)
    texts = np.array([" | ".join(kind.text for kind in sorted(kinds)) for row in regions.found for kinds in row])
    cells: dict[str, Any] = {
        "curve": np.zeros(count, dtype=np.int64),
        "type": np.full(count, "cell"),
        "point": np.arange(count),
        first: x,
        second: y,
    }
    if not table:
        return {**cells, "attractors": texts}
    merged: Table = {}
    for name, values in table.items():
        assert isinstance(values, np.ndarray)
        blank = "" if values.dtype.kind == "U" else np.nan
        more = cells[name] if name in cells else np.full((count, *values.shape[1:]), blank, dtype=values.dtype)
        merged[name] = np.concatenate([values, more])
    merged["attractors"] = np.concatenate([np.full(rows, "", dtype=texts.dtype), texts])
    return merged
