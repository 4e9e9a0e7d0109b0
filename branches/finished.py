"""A finished run as a branch: its events and ends in the words of the record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.between_events import Barrier, decide_between
from branches.branch import Branch, BranchEvent, Ended
from branches.stability import describe
from branches.steps import solutions_of
from continuation.problem import EndReason, Event

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem
    from continuation.run import Run

__all__ = ["branch_of", "event_of"]

UNDECIDED_AT = ("SN", "BP", "SB", "PD")
"""Events at which a multiplier is at its bound: stability there is decided by the location error alone, so it is not given."""


def _along(event: Event, backward: bool) -> tuple[str, int, str | None]:
    """Label and half-waves just below an event in arclength, and its note, read in the order of arclength.

    Events found `backward`, against the arclength of the finished branch, have their sides in the other order.
    """
    details = event.details
    label, half_waves, note = details["label"], details["half_waves"], details.get("note")
    if "sides" in details:
        (label, half_waves), (above, _) = details["sides"][::-1] if backward else details["sides"]
        becomes = f"{label or 'no label'} becomes {above or 'no label'}"
        if event.code == "LB":
            note = becomes
        elif label != above:
            note = f"{note}: {becomes}"
    if event.status == "bracketed":
        low, high = event.bracket
        note = f"{note}; only bracketed, in {high - low:.1e} of arclength: {_why_bracketed(details)}"
    return label, half_waves, note


def _why_bracketed(details: Mapping[str, Any]) -> str:
    """Why an event could not be brought nearer than its bracket."""
    if details.get("kind") == "pole":
        return "its test function grows without bound there"
    if details.get("kind") == "jump":
        return "its test function changes sign without passing zero, as far as steps can be told apart"
    return f"nearer steps fail, as where two families nearly touch ({details.get('reason') or 'no reason given'})"


def event_of(
    event: Event, name: str, point: int, number: int, columns: Mapping[str, np.ndarray], index: int, *, backward: bool
) -> BranchEvent:
    """An event in the words of the record.

    Parameters
    ----------
    event : continuation.Event
    name : str
        Its id on the branch.
    point, number : int
        Its place among the branch's points, and counted from the start.
    columns : mapping of str to array
        Of orbits as `branches.orbit.Orbit.described` has them; the event's own is at `index`.
    backward : bool
        Whether it was found against the arclength of the branch.
    """
    details = event.details
    label, _, note = _along(event, backward)
    stable = -1 if event.code in UNDECIDED_AT else int(columns["stable"][index])
    largest = float(np.max(np.abs(columns["multipliers"][index]))) if columns["multipliers"].shape[1] else math.nan
    return BranchEvent(
        name,
        event.code,
        point,
        number,
        float(columns["h"][index]),
        float(columns["alpha"][index]),
        event.arclength,
        event.status,
        (float(event.bracket[0]), float(event.bracket[1])),
        event.residual,
        label,
        details.get("stop"),
        details.get("p_q"),
        details.get("breaks"),
        note,
        None if stable < 0 else bool(stable),
        largest if math.isfinite(largest) else None,
    )


def branch_of(problem: MultipointProblem, run: Run, energy: tuple[float, float]) -> Branch:
    """The branch of a run that ended, in the order of its points.

    Parameters
    ----------
    problem : MultipointProblem
    run : continuation.Run
        With one point at least.
    energy : (float, float)
        The range in which it was followed.
    """
    solutions = solutions_of(run.points)
    columns = describe(problem, solutions, run.points.arclengths()).columns

    def backward(event: Event) -> bool:
        """Whether it was found against the arclength; what lies on the seam of a closed family is read along it."""
        return event.index < run.start and not (run.closed and event.index == 0)

    # At an event a velocity can be zero to rounding, so its counts are those of the branch just before it.
    labels = columns["label"].astype(object)
    for event in run.events:
        if event.code in UNDECIDED_AT:
            columns["stable"][event.index] = -1
        labels[event.index], half_waves, _ = _along(event, backward(event))
        columns["half_waves"][event.index] = max(1, half_waves)
    columns["label"] = labels.astype(str)
    columns["frequency_index"] = columns["half_waves"] * columns["frequency"]
    barriers = [Barrier(event.code, event.index, (float(event.bracket[0]), float(event.bracket[1]))) for event in run.events]
    columns["stable"], work = decide_between(problem, lambda i: solutions[i].y, columns, barriers)
    counts: dict[str, int] = {}
    events = []
    for event in run.events:
        counts[event.code] = counts.get(event.code, 0) + 1
        name, number = f"{event.code}{counts[event.code]}", event.index - run.start
        events.append(event_of(event, name, event.index, number, columns, event.index, backward=backward(event)))
    ended = []
    for k, end in enumerate(run.ends):
        place = run.points[0] if k == 0 else run.points[-1]
        if end.reason is EndReason.EVENT and place.event is not None:
            orbit = f"h = {place.parameter:.12g}, alpha = {place.step.extra['quarter_period']:.12g}"
            ended.append(Ended(end.reason.name, f"{place.event.code} at {orbit}: {place.event.details.get('note')}"))
        else:
            ended.append(Ended(end.reason.name, end.text))
    return Branch(problem, columns, tuple(events), (ended[0], ended[1]), run.start, energy, digit_work=work)
