"""A chart of forced motion: curves from the events of responses and through their meeting points, and what attracts between them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from branches.curves.record import BifurcationCurve
from branches.forced.record import event_name
from bvp.texts import brief
from transitions.chart.cells import find_regions
from transitions.chart.curves import CurveSearch, Stage
from transitions.chart.levels import follow_level
from transitions.chart.plan import ChartPlan
from transitions.chart.regions import Regions

__all__ = ["Chart", "MeetingPoint", "find_chart"]

_ONE = 1e-6
"""Distance of two points of codimension two, in parts of the ranges, within which they are one."""


class MeetingPoint(NamedTuple):
    """A point of codimension two.

    types: of its events. place: the two parameters. curves: numbers of the curves through it, from 1. events: names of its events. note:
    what it is.
    """

    types: tuple[str, ...]
    place: tuple[float, float]
    curves: tuple[int, ...]
    events: tuple[str, ...]
    note: str


@brief
@dataclass(frozen=True, eq=False)
class Chart:
    """A chart of forced motion in the plane of two parameters.

    Attributes
    ----------
    plan : ChartPlan
    curves : tuple of BifurcationCurve
        Each once, in the order in which they were found.
    points : tuple of MeetingPoint
        The points of codimension two, each once.
    stages : tuple of Stage
        What each stage of the search has found.
    notes : tuple of str
        Where no curve was found, and no branch on a level.
    regions : Regions or None
        None where none were asked for, or before they were simulated.
    """

    plan: ChartPlan
    curves: tuple[BifurcationCurve, ...]
    points: tuple[MeetingPoint, ...]
    stages: tuple[Stage, ...]
    notes: tuple[str, ...]
    regions: Regions | None

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        first, second = self.plan.names[:2]
        title = f"Chart of {len(self.curves)} curves over {first} and {second}, {len(self.points)} points of codimension two"
        return title, [(", ".join(point.types), f"({point.place[0]:.12g}, {point.place[1]:.12g})") for point in self.points]

    @cached_property
    def stage_of(self) -> list[str]:
        """The stage in which each curve was found."""
        return [stage.name for stage in self.stages for _ in range(stage.curves)]


def _meeting_points(search: CurveSearch) -> list[MeetingPoint]:
    """The points of codimension two of all curves, merged: each with all curves through it."""
    low, high = np.array(search.plan.window).T
    names = list(search.plan.names[:2])
    found: list[MeetingPoint] = []
    for k, curve in enumerate(search.curves):
        order = [curve.names.index(name) for name in names]
        for event in curve.events:
            if event.type == "EP":
                continue
            place = curve.parameters[event.point, order]
            numbers = [k + 1, *(other + 1 for other in search.passing.get((k, event.id), ()))]
            made = MeetingPoint(
                (event.type,), (float(place[0]), float(place[1])), tuple(numbers), (event_name(k + 1, event.id),), event.note or ""
            )
            at = next((n for n, one in enumerate(found) if np.all(np.abs(np.array(one.place) - place) < _ONE * (high - low))), None)
            if at is None:
                found.append(made)
            else:
                found[at] = _merged(found[at], made)
    return [point._replace(curves=tuple(sorted(point.curves))) for point in found]


def _merged(one: MeetingPoint, other: MeetingPoint) -> MeetingPoint:
    new = not set(other.types) <= set(one.types)
    return one._replace(
        types=tuple(dict.fromkeys(one.types + other.types)), curves=tuple(dict.fromkeys(one.curves + other.curves)),
        events=one.events + other.events, note=f"{one.note}; {other.note}" if new else one.note,
    )  # fmt: skip


def find_chart(
    plan: ChartPlan,
    executor: Executor | None = None,
    *,
    on_curve: Callable[[int, BifurcationCurve], object] | None = None,
    on_point: Callable[[int], object] | None = None,
    on_stage: Callable[[Stage], object] | None = None,
    on_motion: Callable[[int], object] | None = None,
) -> tuple[Chart, bool]:
    """The chart of a plan.

    A curve starts at each event of the plan's branches. At points of codimension two the other curves through them are followed. On levels
    of the second parameter responses are followed from simulations between the curves, and their events start further curves. The
    attractors are simulated on a grid.

    Parameters
    ----------
    plan : ChartPlan
    executor : Executor, optional
        Of processes that simulate; by default everything runs here.
    on_curve, on_point, on_stage, on_motion : callable, optional
        Called with the number of a new curve from 1 and the curve; with the number of points of a curve or branch on the way; with a stage
        that is finished; with the number of motions that were simulated for the regions.

    Returns
    -------
    Chart, bool
        And whether Ctrl-C came: the chart has what was found until then.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C came before the first curve.

    Examples
    --------
    The grazing and the doubling of an oscillator lead to a fold, at w = sqrt(1 - c^2/4).

    >>> import saltus
    >>> oscillator = saltus.load_scene("damped_impact_oscillator").parametric
    >>> branches = saltus.trace_response(oscillator, "w", (0.95, 1.05), values={"A": 0.12})
    >>> plan = saltus.ChartPlan(branches, ("w", "A"), ((0.95, 1.05), (0.08, 0.2)), levels=0, grid=(0, 0))
    >>> chart, interrupted = find_chart(plan)
    >>> [curve.code for curve in chart.curves]
    ['GR', 'PD', 'SN']
    >>> [(point.types, [round(value, 9) for value in point.place]) for point in chart.points]
    [(('SN-GR', 'PD-GR'), [0.998749218, 0.099906206])]
    """
    search = CurveSearch(plan, on_curve or (lambda number, curve: None), on_point)
    regions, interrupted = None, False

    def done() -> None:
        if on_stage is not None:
            on_stage(search.stages[-1])

    try:
        search.from_events("events of the branches", [(f"of branch {k}", branch) for k, branch in enumerate(plan.branches, 1)])
        done()
        search.through_points()
        done()
        for level in plan.level_values:
            where = f"{plan.names[1]} = {level:.6g}"
            branches, notes = follow_level(plan, level, search.curves, on_point)
            search.notes += notes
            named = [(f"of branch {k} at {where}", branch) for k, branch in enumerate(branches, 1)]
            search.from_events(f"{len(named)} branches at {where}", named)
            done()
        if plan.levels:
            search.through_points()
            done()
        if plan.grid[0]:
            regions, interrupted = find_regions(plan, executor, on_motion)
    except KeyboardInterrupt:
        interrupted = True
    chart = Chart(plan, tuple(search.curves), tuple(_meeting_points(search)), tuple(search.stages), tuple(search.notes), regions)
    if interrupted and not search.curves:
        raise KeyboardInterrupt
    return chart, interrupted
