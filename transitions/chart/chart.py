"""A chart of forced motion: curves from the events of responses and through their meeting points, and what attracts between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from branches.curves.record import BifurcationCurve
from branches.forced.branch import ForcedBranch
from branches.forced.identity import invariants
from branches.forced.onwards import Onwards, ResponseStart, follow_onwards, trace_start
from branches.forced.primitive import kind_of, primitive_orbit
from branches.forced.record import event_name
from bvp.texts import brief
from transitions.basin.identity import orbits_at
from transitions.chart.cells import find_regions
from transitions.chart.curves import CurveSearch, Stage
from transitions.chart.plan import ChartPlan
from transitions.chart.regions import Regions
from transitions.response.starting import Periodic
from transitions.response.tracing import simulated_start

__all__ = ["Chart", "MeetingPoint", "find_chart", "follow_level", "places_between"]

PLACES = 3
"""Values of the first parameter at which motions are simulated on a level."""

MOST_BRANCHES = 6
"""Most families that are followed from one simulated motion."""

THROUGH = ("LB", "GR", "SB", "PD")
"""Events behind which they are followed."""

_SAME = 1e-6
"""Largest relative difference of the numbers of two orbits that are one."""

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


def places_between(curves: Sequence[BifurcationCurve], level: float, interval: tuple[float, float]) -> list[float]:
    """The middles of the widest intervals between curves on a level of the second parameter, the widest first."""
    crossings = [*interval]
    for curve in curves:
        x, off = curve.parameters[:, 0], curve.parameters[:, 1] - level
        k = np.flatnonzero(off[:-1] * off[1:] < 0.0)
        crossings += (x[k] + off[k] / (off[k] - off[k + 1]) * (x[k + 1] - x[k])).tolist()
    ends = np.unique(np.clip(crossings, *interval))
    widths = np.diff(ends)
    return [0.5 * float(ends[k] + ends[k + 1]) for k in np.argsort(-widths, kind="stable")[:PLACES].tolist()]


def follow_level(
    plan: ChartPlan, level: float, curves: Sequence[BifurcationCurve], on_point: Callable[[int], object] | None = None
) -> tuple[list[ForcedBranch], list[str]]:
    """Follow responses along the first parameter on a level of the second one.

    Parameters
    ----------
    plan : ChartPlan
    level : float
    curves : sequence of BifurcationCurve
        Motions are simulated between these.
    on_point : callable, optional
        Called with the number of points of a branch.

    Returns
    -------
    list of ForcedBranch, list of str
        And why a simulated motion has no branch, or not all of them.
    """
    branches: list[ForcedBranch] = []
    notes: list[str] = []
    interval = plan.window[0]
    for place in places_between(curves, level, interval):
        families = Onwards()
        try:
            found = _settled(plan, place, level)
            if not _is_known(branches, found):
                start = ResponseStart(found.problem, found.y)
                follow_onwards(
                    [start], lambda one: trace_start(one, interval, on_point=on_point), through=THROUGH, most=MOST_BRANCHES, found=families
                )
        except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            notes.append(f"the motion from rest at {plan.names[0]} = {place:.6g}, {plan.names[1]} = {level:.6g}: {error}")
        branches += families.branches
    return branches, notes


def _settled(plan: ChartPlan, place: float, level: float) -> Periodic:
    """The orbit on which the motion from rest settles; a ValueError or a RuntimeError where there is none that can be followed."""
    _, found = simulated_start(plan.path({**plan.start, plan.names[0]: place, plan.names[1]: level}), most=plan.periods)
    problem, y = primitive_orbit(found.problem, found.y)
    return Periodic(problem, y, found.distance)


def _is_known(branches: Sequence[ForcedBranch], found: Periodic) -> bool:
    """Whether an orbit, or an image of it, is on a branch."""
    kind, numbers = kind_of(found.problem), invariants(found.problem, found.y)
    same = [branch for branch in branches if kind_of(branch.problem) == kind]
    try:
        orbits = orbits_at(same, found.problem.parameters(found.y))
    except ValueError:
        return False
    scale = np.maximum(1.0, np.abs(numbers))
    return any(np.abs((invariants(one.problem, one.unknowns) - numbers) / scale).max() < _SAME for one in orbits)
