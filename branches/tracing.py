"""Tracing: from an orbit to the branch of its family, with events and ends in the terms of the file format."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from branches.admissible import unphysical
from branches.between_events import Barrier, decide_between, stable_at_event
from branches.branch import Branch
from branches.events import FREE_NORMAL_FORMS, BranchEvent, Ended, event_ids, moved, numbered
from branches.family import SETTINGS, Family
from branches.full_family import solutions_of
from branches.interrupted import with_branch, with_computed
from branches.normal_forms import normal_form_at, with_normal_forms
from branches.orbit import Orbit, orbit_columns
from branches.solved_family import begun_along
from bvp.checks import checked_energy_range, require_branch
from bvp.functions import hypot
from bvp.interrupts import defer_interrupts
from bvp.multipoint import MultipointProblem
from bvp.saddles import REACHED, Saddle, approached, farther_out
from bvp.texts import shown, takes_options_of
from continuation.control import Settings
from continuation.problem import End, EndReason, Event, PlainPoints, Point, Step
from continuation.run import Run, follow_both_ways

__all__ = ["SETTINGS", "cut_branch", "event_along", "extend", "follow_family", "record_of_event", "report"]

EVENT_TYPES = ("SN", "BP", "SB", "PD", "RT", "NS", "GR", "IO", "LB", "EP")
"""Types of events, see `branches.family`."""

HIGHEST = 1e12
"""Highest energy of a family if no range is given. Above it, rounding of the impact speeds hides the elastic forces."""

GROWTH_EVERY = 16
"""Points of a smooth family from one to the next of which the growth of perturbations is looked at."""

_SIGNS = {"up": 1, "both": 1, "down": -1, "along": 0}

Condition = Callable[[Orbit], "bool | str"]


def follow_family(
    problem: MultipointProblem,
    start: np.ndarray | Step,
    *,
    energy: tuple[float, float] = (0.0, HIGHEST),
    quarter_period: float = math.inf,
    points: int | None = None,
    direction: str = "both",
    stop_at: str | None = None,
    stop_when: Condition | None = None,
    on_event: Callable[[BranchEvent], object] | None = None,
    on_end: Callable[[Ended], object] | None = None,
    on_point: Callable[[int], object] | None = None,
    settings: Settings = SETTINGS,
    rising: bool = True,
    normal_forms: bool = False,
) -> Branch:
    """Follow the family of a solution.

    Parameters
    ----------
    problem : MultipointProblem
    start : (u,) float, or continuation.Step
        Unknowns near an orbit of the family, or an orbit with its tangent.
    energy : (float, float)
        The family ends at these energies; by default at most at `HIGHEST`.
    quarter_period : float
        The family ends where its quarter period grows beyond this one.
    points : int, optional
        Points in total; reaching it is a reason to end.
    direction : {"up", "down", "both", "along"}
        Whether the first step raises the energy, lowers it, both ways are followed, or the start's own tangent is.
    stop_at : str, optional
        Type of the events to end at.
    stop_when : callable, optional
        Called with each `Orbit`, the start's first (its attributes are computed when asked for); the family ends where it gives
        True or a text. A condition that holds at the start ends it there, with one point.
    on_event, on_end, on_point : callable, optional
        Called with each event as it is found (its `number` counts from the start), each end, and the number of points so far.
    settings : continuation.Settings
    rising : bool
        Whether a branch followed both ways is put in the order of energies rising at the start, or falling there.
    normal_forms : bool
        Whether SN, SB and PD get the coefficients of their normal forms.

    Raises
    ------
    ValueError
        For options that cannot be, and for a start that is no orbit, because it passes beyond a stop or an impact would have to pull.
    RuntimeError
        Where the family cannot be followed.
    """
    energy = checked_energy_range(energy)
    if direction not in _SIGNS:
        raise ValueError(f"direction {shown(direction)}: expected up, down or both")
    if stop_at is not None and stop_at not in EVENT_TYPES:
        raise ValueError(f"stop_at {shown(stop_at)}: expected one of {', '.join(EVENT_TYPES)}")
    if stop_when is not None and not callable(stop_when):
        raise ValueError(f"stop_when = {shown(stop_when)}: expected a function of an orbit")
    if points is not None:
        if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 1 <= points < 1 << 63:
            raise ValueError(f"points = {shown(points)}: expected an integer, at least 1")
        settings = replace(settings, maximum_points=points)
    problem.refuse_drift()
    if not isinstance(start, Step):
        start = np.array(start, dtype=float)
    sign = _SIGNS[direction] * (1 if rising or direction != "both" else -1)

    def follow(
        problem: MultipointProblem, start: np.ndarray | Step, known: tuple[int, int], saddle: Saddle | None
    ) -> tuple[Run, tuple[int, int]]:
        """A run, and the points and events that were reported; `known` were reported before. It ends where it reaches the saddle."""

        def stop(point: Point) -> bool | str:
            if saddle is not None and saddle.distance(problem, point.step.y) < REACHED:
                return str(saddle)
            return stop_when is not None and stop_when(Orbit(problem, point.step.extra))

        family = Family(problem, energy, quarter_period)
        begin = start if isinstance(start, Step) else family.begin(start)
        beyond = unphysical(problem, begin.extra) if begin.converged else None
        if beyond is not None:
            raise ValueError(f"the start solves the equations but is no orbit: {beyond}; expected motion between the stops")
        collector = _Collector(problem, energy, on_event, on_point, sign, known, forms)
        try:
            run = follow_both_ways(
                family,
                start,
                settings,
                both=direction == "both",
                direction=sign,
                stop_when=None if stop_when is None and saddle is None else stop,
                stop_at=frozenset() if stop_at is None else frozenset({stop_at}),
                on_points=collector.points,
                on_event=None if on_event is None else collector.event,
            )
        except (KeyboardInterrupt, RuntimeError) as error:
            raise with_computed(error, lambda run: _branch_of(problem, run, energy)) from None
        return run, (max(known[0], collector.count), max(known[1], sum(collector.types.values())))

    forms: list[BranchEvent] | None = [] if normal_forms else None
    known, saddle = (0, 0), None
    finer = problem.in_enough_pieces(start.y if isinstance(start, Step) else start)
    while True:
        if finer is not problem:
            problem, start = finer, _start_in(problem, finer, start)
        run, known = follow(problem, start, known, saddle)
        finer = _pieces_for(problem, run)
        if finer is problem:
            break
        saddle = saddle or approached(problem, run.points[-1].step.y) or approached(problem, run.points[0].step.y)
    if problem.is_smooth and run.points:
        run = replace(run, ends=(_with_saddle(problem, run, 0), _with_saddle(problem, run, -1)))
    if not run.points:
        raise RuntimeError(f"the family could not be followed: {run.ends[0].text}")
    with defer_interrupts() as interrupt:
        branch = _branch_of(problem, run, energy)
        if forms is not None:
            branch = with_normal_forms(branch, forms)
        if on_end is not None:
            for ended in dict.fromkeys(branch.ended):
                on_end(ended)
    if interrupt.came:  # it had to wait until the branch was finished
        raise with_branch(KeyboardInterrupt(), branch)
    return branch


def _pieces_for(problem: MultipointProblem, run: Run) -> MultipointProblem:
    """The problem in as many pieces as the orbits of a run need: perturbations can grow along a family."""
    if not problem.is_smooth or not run.points:
        return problem
    unknowns = [run.points[i].step.y for i in (*range(0, len(run.points), GROWTH_EVERY), len(run.points) - 1)]
    return problem.in_enough_pieces(max(unknowns, key=problem.growth))


def _with_saddle(problem: MultipointProblem, run: Run, k: int) -> End:
    """The end of a run at its first (0) or last (-1) point, with the saddle that the family approaches there."""
    end = run.ends[k]
    if end.reason not in (EndReason.MINIMUM_STEP, EndReason.STOP_WHEN, EndReason.POINTS):
        return end
    y = run.points[k].step.y
    saddle = approached(problem, y)
    if saddle is None:
        words = farther_out(problem, y) if end.reason is EndReason.MINIMUM_STEP else ""
        return end._replace(detail=f"{end.detail}; {words}") if words else end
    if saddle.distance(problem, y) < REACHED:
        return end._replace(reason=EndReason.SADDLE, detail=str(saddle))
    return end._replace(detail=f"{end.detail}; its orbits approach {saddle}".removeprefix("; "))


def _start_in(problem: MultipointProblem, other: MultipointProblem, start: np.ndarray | Step) -> np.ndarray | Step:
    """The start of a run in another number of pieces."""
    if not isinstance(start, Step):
        return problem.in_pieces_of(other, start)
    scale = problem.scales(start.y)[: problem.parameters + 1]
    return begun_along(Family(other), problem.in_pieces_of(other, start.y), start.tangent, scale)


def report(
    branch: Branch,
    *,
    on_event: Callable[[BranchEvent], object] | None = None,
    on_end: Callable[[Ended], object] | None = None,
    on_point: Callable[[int], object] | None = None,
    normal_forms: bool = False,
) -> Branch:
    """Call the callbacks of `follow_family` for a branch that was followed without them; return the branch, with the normal forms of its
    events if they are wanted."""
    try:
        if normal_forms:
            branch = with_normal_forms(branch)
        if on_point is not None:
            on_point(len(branch))
        if on_event is not None:
            for event in sorted(branch.events, key=lambda event: (event.number < 0, abs(event.number))):
                on_event(event)
        if on_end is not None:
            for ended in dict.fromkeys(branch.ended):
                on_end(ended)
    except KeyboardInterrupt as error:
        raise with_branch(error, branch) from None
    return branch


def cut_branch(branch: Branch, energy: tuple[float, float], *, outermost: bool = False) -> Branch | None:
    """The piece of a branch around its start that lies in a range of energies, without following the family again: the points and events
    inside, and the ends at the bounds. outermost: all from the first point inside to the last one. None where the start is outside, and
    where a closed family is inside the range at the point where it begins."""
    h = branch.points["h"]
    outside = np.flatnonzero((h < energy[0]) | (h > energy[1]))
    if branch.start in outside:
        return None
    k = int(np.searchsorted(outside, branch.start))
    first, last = int(outside[k - 1]) + 1 if k else 0, int(outside[k]) - 1 if k < len(outside) else len(h) - 1
    if outermost:
        first, last = np.setdiff1d(np.arange(len(h)), outside)[[0, -1]].tolist()
    crossed = {event.point for event in branch.events if event.type == "BP"}  # no tangent is known there: the next point begins
    first, last = first + (first in crossed and 0 < first < branch.start), last - (last in crossed and branch.start < last < len(h) - 1)
    if branch.is_closed and (outermost or first == 0 or last == len(h) - 1):
        return None
    before = _to_bound(branch, first, -1, energy) if first > 0 else None
    after = _to_bound(branch, last, 1, energy) if last < len(h) - 1 else None
    lead = 0 if before is None else len(before) - 1
    shift = (0.0 if before is None else before.points["arclength"][-1]) - branch.points["arclength"][first]
    points = {name: column[first : last + 1] for name, column in branch.points.items()}
    points["arclength"] = points["arclength"] + shift
    events = [moved(event, lead - first, shift) for event in branch.events if first <= event.point <= last]
    ended = list(branch.ended)
    if before is not None:
        total = float(before.points["arclength"][-1])
        outer = {name: column[:0:-1] for name, column in before.points.items()} | {"arclength": total - before.points["arclength"][:0:-1]}
        points = {name: np.concatenate([outer[name], column]) for name, column in points.items()}
        events = [*(moved(event, lead, total, -1) for event in before.events), *events]
        ended[0] = before.ended[1]
    if after is not None:
        place, length = len(points["h"]) - 1, float(points["arclength"][-1])
        outer = {name: column[1:] for name, column in after.points.items()} | {"arclength": length + after.points["arclength"][1:]}
        points = {name: np.concatenate([column, outer[name]]) for name, column in points.items()}
        events += [moved(event, place, length) for event in after.events]
        ended[1] = after.ended[1]
    start = branch.start - first + lead
    counted = numbered(event._replace(number=event.point - start) for event in events)
    cut = Branch(branch.problem, points, counted, (ended[0], ended[1]), start, energy, digit_work=branch.digit_work)
    return cut.known_within(branch)


def _to_bound(branch: Branch, i: int, way: int, energy: tuple[float, float]) -> Branch:
    """The few points from point i of a branch to the bound that lies before its next point in a direction."""
    y, family = branch.unknowns(i), Family(branch.problem, energy)
    step = family.begin(y)
    if step.tangent[: y.size] / branch.problem.scales(y) ** 2 @ (branch.unknowns(i + way) - y) < 0.0:
        step = family.step(step.y, -step.tangent, 0.0)
    return follow_family(branch.problem, step, energy=energy, direction="along")


@takes_options_of(follow_family)
def extend(branch: Branch, i: int, **options: Any) -> Branch:
    """Follow the family of a branch on from its point i.

    Parameters
    ----------
    branch : Branch
    i : int
        Index of a point; -1 is the last.
    **options
        As for `follow_family`.

    Raises
    ------
    IndexError, TypeError
        If the branch has no point i.
    """
    require_branch(branch)
    return follow_family(branch.problem, branch.unknowns(i), **options)


@dataclass(eq=False)
class _Collector:
    """Reports points and events as they are found, with their number from the start."""

    problem: MultipointProblem
    energy: tuple[float, float]
    on_event: Callable[[BranchEvent], object] | None
    on_point: Callable[[int], object] | None
    direction: int
    reported: tuple[int, int] = (0, 0)
    """Points and events that an earlier run along the same family reported."""
    forms: list[BranchEvent] | None = None
    """Receives the events with their normal forms, if these are wanted."""
    lasts: dict[int, int] = field(default_factory=lambda: {1: 0, -1: 0})
    """Index of the last point of each half."""
    sign: int = 1
    begin: Point | None = None
    count: int = 0
    types: Counter[str] = field(default_factory=Counter)

    def points(self, points: Sequence[Point]) -> None:
        """Count the points of a block, or one by one, in the half of the run that they continue."""
        for part in [points] if self.on_point is None and isinstance(points, PlainPoints) else [[point] for point in points]:
            self.count += len(part)
            point = part[0]
            if self.begin is None:
                self.begin = point
            else:
                if point.index == 1:
                    rises = self.direction == 0 or (point.step.parameter - self.begin.step.parameter) * self.direction >= 0.0
                    self.sign = 1 if rises and not self.lasts[1] else -1
                elif not self.lasts[self.sign] or self.lasts[self.sign] + 1 != point.index:
                    self.sign = -self.sign
                self.lasts[self.sign] = part[-1].index
            if self.on_point is not None and self.count > self.reported[0]:
                self.on_point(self.count)

    def event(self, event: Event) -> None:
        assert self.on_event is not None
        self.types[event.code] += 1
        if sum(self.types.values()) <= self.reported[1]:
            return
        number = self.sign * event.index
        orbit = Orbit(self.problem, event.point.extra)
        name = f"{event.code}{self.types[event.code]}"
        found = record_of_event(event, name, 0, number, orbit.columns, 0, backward=self.sign < 0)
        if self.forms is not None and found.type in FREE_NORMAL_FORMS:
            found = normal_form_at(orbit, found, len(self.forms) + 1)
            self.forms.append(found)
        self.on_event(found)


def event_along(event: Event, backward: bool) -> tuple[str, int, str | None]:
    """Label and half-waves just below an event in arclength, and its note, read in the order of arclength.

    Events found `backward`, against the arclength of the finished branch, have their sides in the other order.
    """
    details = event.details
    label, half_waves, note = details["label"], details["half_waves"], details.get("note")
    if "sides" in details:
        (label, half_waves), (above, waves_above) = details["sides"][::-1] if backward else details["sides"]
        becomes = f"{label or 'no label'} becomes {above or 'no label'}"
        if not label and not above:
            becomes = f"{half_waves} half-waves become {waves_above}"
        if event.code == "LB":
            note = becomes
        elif label != above:
            note = f"{note}: {becomes}"
    if event.status == "bracketed":
        low, high = event.bracket
        refused = f"nearer steps fail, as where two families nearly touch ({details.get('reason') or 'no reason given'})"
        why = {
            "pole": "its test function grows without bound there",
            "jump": "its test function changes sign without passing zero, as far as steps can resolve it",
        }.get(details.get("kind", ""), refused)
        note = f"{note}; only bracketed, in {high - low:.1e} of arclength: {why}"
    return label, half_waves, note


def record_of_event(
    event: Event, name: str, point: int, number: int, columns: Mapping[str, np.ndarray], index: int, *, backward: bool
) -> BranchEvent:
    """An event as a record. Its orbit is at `index` of the columns; `backward`: it was found against the arclength of the branch."""
    details = event.details
    label, _, note = event_along(event, backward)
    stable = stable_at_event(event.code, columns, index)
    multipliers = columns["multipliers"][index]
    largest = float(np.max(hypot(multipliers.real, multipliers.imag), initial=0.0)) or 1.0  # without nontrivial ones, the trivial ones
    return BranchEvent(
        name, event.code, point, number, float(columns["h"][index]), float(columns["alpha"][index]), event.arclength, event.status,
        (float(event.bracket[0]), float(event.bracket[1])), event.residual, label, details.get("stop"), details.get("p_q"),
        details.get("breaks"), note, None if stable < 0 else bool(stable), largest if math.isfinite(largest) else None,
    )  # fmt: skip


def _branch_of(problem: MultipointProblem, run: Run, energy: tuple[float, float]) -> Branch:
    """The branch of a run with one point at least."""
    solutions = solutions_of(run.points)
    columns = orbit_columns(problem, solutions, run.points.arclengths())

    # Whether each was found against the arclength; an event where a closed family begins is read along it.
    backward = [event.index < run.start and not (run.closed and event.index == 0) for event in run.events]
    # At an event a velocity can be zero to rounding, so its counts are those of the branch just before it.
    labels = columns["label"].astype(object)
    for event, against in zip(run.events, backward, strict=True):
        columns["stable"][event.index] = stable_at_event(event.code, columns, event.index)
        labels[event.index], half_waves, _ = event_along(event, against)
        columns["half_waves"][event.index] = half_waves
    columns["label"] = labels.astype(str)
    columns["frequency_index"] = columns["half_waves"] * columns["frequency"]
    barriers = [Barrier(event.code, event.index, (float(event.bracket[0]), float(event.bracket[1]))) for event in run.events]
    columns["stable"], work = decide_between(problem, lambda i: (problem, solutions.y[i]), columns, barriers)
    ids = event_ids(event.code for event in run.events)
    events = [
        record_of_event(event, id, event.index, event.index - run.start, columns, event.index, backward=against)
        for event, id, against in zip(run.events, ids, backward, strict=True)
    ]
    ended = []
    for k, end in enumerate(run.ends):
        place = run.points[0] if k == 0 else run.points[-1]
        if end.reason is EndReason.EVENT and place.event is not None:
            orbit = f"h = {place.step.parameter:.12g}, alpha = {place.step.extra['quarter_period']:.12g}"
            ended.append(Ended(end.reason.name, f"{place.event.code} at {orbit}: {place.event.details.get('note')}{end.unlocated}"))
        else:
            ended.append(Ended(end.reason.name, end.text))
    return Branch(problem, columns, tuple(events), (ended[0], ended[1]), run.start, energy, digit_work=work)
