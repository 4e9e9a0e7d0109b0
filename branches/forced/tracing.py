"""Following a family of forced orbits, and switching to the families that meet it at its events."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from branches.admissible import unphysical
from branches.events import Ended
from branches.family import SETTINGS
from branches.forced.branch import ForcedBranch, ForcedEvent, largest_multiplier
from branches.forced.family import ForcedFamily
from branches.forced.identity import closure_name, primitive_orbit
from branches.forced.switching import GrazingNeighbour, beside_grazing, leaving
from bvp.forced import ForcedProblem
from bvp.multipoint import NotConverged
from continuation.problem import EndReason, Event, Point, Step
from continuation.run import Run, follow_both_ways

__all__ = ["SWITCHES", "follow_response", "point_inside", "primitive_branch", "switch_response"]

SWITCHES = ("PD", "SB", "BP", "GR", "LB")
"""Events at which other families begin."""

_LARGE = 100.0
"""Size of a state, in units of the metric, from which on a resonance is looked for, and at which a motion without a clock is unbounded."""

_UNDAMPED, _NEAR = 1e-10, 0.3
"""Distance of a multiplier from the unit circle, and from 1, at the resonance of an undamped mode."""


def follow_response(
    problem: ForcedProblem,
    start: np.ndarray | Step,
    interval: tuple[float, float] = (-math.inf, math.inf),
    *,
    values: tuple[float, ...] = (),
    points: int | None = None,
    both: bool = True,
    on_event: Callable[[Event], object] | None = None,
    on_point: Callable[[int], object] | None = None,
) -> ForcedBranch:
    """Follow the family of a forced orbit in both directions.

    Parameters
    ----------
    problem : ForcedProblem
    start : (u,) float, or Step
        Unknowns near an orbit, or an orbit with its tangent.
    interval : (float, float)
        The family ends at these values of the released parameter.
    values : sequence of float
        Values of the parameter that are marked (UZ).
    points : int, optional
        Points in total.
    both : bool
        False: only along the tangent of the start.
    on_event, on_point : callable, optional
        Called with each event as it is found, and with the number of points so far.

    Raises
    ------
    ValueError
        For a start that solves the equations but is no orbit.
    RuntimeError
        Where the family cannot be followed.
    """
    family = ForcedFamily(problem, interval, values)
    if isinstance(start, Step):  # it has the test functions of another family
        begin = family.step(start.y, start.tangent, 0.0)
    else:
        begin = family.begin(problem.solve(np.asarray(start, dtype=float)).y)
    beyond = unphysical(problem, begin.extra) if begin.converged else None
    if beyond is not None:
        raise ValueError(f"the start solves the equations but is no orbit: {beyond}; expected motion between the stops")
    settings = SETTINGS if points is None else replace(SETTINGS, maximum_points=points)
    count = 0

    def counted(found: Any) -> None:
        nonlocal count
        count += len(found)
        assert on_point is not None
        on_point(count)

    run = follow_both_ways(
        family, begin, settings, both=both, direction=1 if both else 0, stop_when=_unbounded(problem),
        on_points=None if on_point is None else counted, on_event=on_event,
    )  # fmt: skip
    if not run.points:
        raise RuntimeError(f"the family could not be followed: {run.ends[0].text}")
    return _branch_of(problem, run, interval)


def _unbounded(problem: ForcedProblem) -> Callable[[Point], str | bool] | None:
    """The condition that the motion grows without bound, in words: without impacts towards the resonance of an undamped mode, and without
    a clock where the stops lose no more than the motion gains."""
    place = 2 * problem.degrees_of_freedom

    def gains(point: Point) -> str | bool:
        return max(map(abs, point.step.position[:place])) > _LARGE and "the motion grows without bound"

    def grows(point: Point) -> str | bool:
        if max(map(abs, point.step.position[:place])) < _LARGE:
            return False
        free = problem.multipliers(point.step.y)
        near = free[np.argmin(np.abs(free - 1.0))]
        undamped = abs(abs(near) - 1.0) < _UNDAMPED and abs(near - 1.0) < _NEAR
        return "the response grows without bound: an undamped mode is near its resonance" if undamped else False

    if not problem.has_clock:
        return gains
    return None if problem.sequence else grows


def _branch_of(problem: ForcedProblem, run: Run, interval: tuple[float, float]) -> ForcedBranch:
    steps = [point.step for point in run.points]
    unknowns = np.array([step.y for step in steps])
    counts = Counter[str]()
    events = []
    for event in run.events:
        counts[event.code] += 1
        details, at = event.details, event.point
        largest = largest_multiplier(problem, problem.multipliers(at.y))
        found = ForcedEvent(
            f"{event.code}{counts[event.code]}", event.code, event.index, problem.parameters(at.y), event.arclength, event.status,
            (float(event.bracket[0]), float(event.bracket[1])), event.residual, details.get("stop"), details.get("angle"),
            details.get("note"), largest if math.isfinite(largest) else None,
        )  # fmt: skip
        events.append(found)
    ended = []
    for end, point in zip(run.ends, (run.points[0], run.points[-1]), strict=True):
        text = end.text
        if end.reason is EndReason.EVENT and point.event is not None:
            text = f"{point.event.code} at {problem.released[0]} = {point.step.parameter:.12g}: {point.event.details.get('note')}"
        ended.append(Ended(end.reason.name, text))
    branch = ForcedBranch(
        problem, unknowns, np.array([step.tangent[: problem.unknowns] for step in steps]), run.points.arclengths(),
        np.array([step.residual for step in steps]), tuple(events), (ended[0], ended[1]), run.start, interval,
    )  # fmt: skip
    return replace(branch, events=tuple(_with_neighbours(branch, event) for event in events))


def _with_neighbours(branch: ForcedBranch, event: ForcedEvent) -> ForcedEvent:
    if event.type != "GR":
        return event
    found = _at_grazing(branch, event)
    return event._replace(neighbours=tuple(("".join(one.problem.sequence), one.persists) for one in found))


def _at_grazing(branch: ForcedBranch, event: ForcedEvent) -> list[GrazingNeighbour]:
    problem, k = branch.problem, event.point
    inside = k + 1 if k + 1 < len(branch) else k - 1
    solution = problem.step(branch.unknowns[k], _with_curvature(branch.tangents[k]), 0.0)
    if solution is None or inside < 0:
        return []
    return beside_grazing(problem, solution, branch.unknowns[inside] - branch.unknowns[k])


def _with_curvature(tangent: np.ndarray) -> np.ndarray:
    """A tangent (2 u,) whose curvature is not known."""
    return np.concatenate([tangent, np.zeros(len(tangent))])


def switch_response(branch: ForcedBranch, event: ForcedEvent) -> list[tuple[ForcedProblem, Step]]:
    """The first orbits of the families that begin at an event, with tangents that point away from it.

    At PD it is the family of twice the period; at SB both mirror images; at BP both sides of the other family; at GR those with an impact
    more or less; at LB the one with the other order of impacts.

    Raises
    ------
    ValueError
        For an event where no other family begins.
    RuntimeError
        Where none was found.
    """
    if event.type not in SWITCHES:
        raise ValueError(f"no other family begins at {event.id}; expected an event of type {', '.join(SWITCHES)}")
    if event.type in ("GR", "LB"):
        found = [(one.problem, one.step) for one in _at_grazing(branch, event)]
    else:
        try:
            found = leaving(branch.problem, branch.unknowns[event.point], branch.tangents[event.point], event.type)
        except (NotConverged, np.linalg.LinAlgError) as error:
            raise RuntimeError(f"no family was found at {event.id}: {error}") from error
    if not found:
        raise RuntimeError(f"no family was found at {event.id}")
    return found


def primitive_branch(branch: ForcedBranch) -> ForcedBranch:
    """The family of the primitive orbits of a branch, in the same range: the branch itself, unless its orbits repeat themselves, or are
    symmetric and solved over their full period.

    Raises
    ------
    RuntimeError
        Where that family cannot be followed.
    """
    i = point_inside(branch, (-math.inf, math.inf))
    problem, y = primitive_orbit(branch.problem, branch.unknowns[i])
    if problem is branch.problem or closure_name(problem) != branch.full_family.ids[0].partition(":")[0]:
        return branch
    return follow_response(problem, y, branch.interval)


def point_inside(branch: ForcedBranch, interval: tuple[float, float]) -> int:
    """Index of a point from which the branch can be followed in another range of its parameter: the one inside that is nearest to its
    start, at no event.

    Raises
    ------
    ValueError
        If the branch has no point in the range.
    """
    low, high = interval
    inside = np.flatnonzero((branch.parameter >= low) & (branch.parameter <= high))
    plain = np.setdiff1d(inside, [event.point for event in branch.events])
    usable = plain if len(plain) else inside
    if not len(usable):
        reached = f"{branch.parameter.min():.8g} to {branch.parameter.max():.8g}"
        raise ValueError(f"the range {low:g}:{high:g} has no point of the branch, which has {branch.name} = {reached}")
    return int(usable[np.argmin(np.abs(usable - branch.start))])
