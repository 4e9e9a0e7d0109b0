"""Families of forced orbits and those that begin at their events, each followed once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.known import has_orbit
from branches.forced.tracing import SWITCHES, follow_response, go_on, switch_response
from bvp.forced import ForcedProblem
from continuation.problem import Step

__all__ = ["MOST_BRANCHES", "Onwards", "ResponseStart", "follow_onwards", "trace_start"]

MOST_BRANCHES = 50


class ResponseStart(NamedTuple):
    """Where a family is followed from.

    Attributes
    ----------
    problem : ForcedProblem
    orbit : (u,) ndarray or Step
        Near the first orbit, or that with its tangent.
    direction : str
        As for `branches.forced.tracing.follow_response`.
    origin : str or None
        Where the family begins, in words, if it is followed along the tangent.
    known : ForcedBranch or None
        The branch that goes on beyond its ends.
    begins : (ForcedBranch, ForcedEvent) or None
        The event at which the family begins, with its branch.
    """

    problem: ForcedProblem
    orbit: np.ndarray | Step
    direction: str = "both"
    origin: str | None = None
    known: ForcedBranch | None = None
    begins: tuple[ForcedBranch, ForcedEvent] | None = None


@dataclass
class Onwards:
    """Families that are linked by events.

    Attributes
    ----------
    branches : list of ForcedBranch
        In the order in which they were followed.
    links : list of (int, str, int)
        Number of a branch, id of its event, and number of the branch that begins there.
    notes : list of str
        Where no family was found, or one could not be followed.
    left : int
        Starts that were not followed: there are more families than asked for.
    """

    branches: list[ForcedBranch] = field(default_factory=list)
    links: list[tuple[int, str, int]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left: int = 0


class _Waiting(NamedTuple):
    start: ResponseStart
    source: int
    event: ForcedEvent | None


def trace_start(start: ResponseStart, interval: tuple[float, float], **options: Any) -> tuple[ForcedBranch, list[int]]:
    """The family of a start within an interval of its parameter, and its ends that are new: points. options: of `follow_response`."""
    if start.known is not None:
        return go_on(start.known, interval, direction=start.direction, **options)
    branch = follow_response(start.problem, start.orbit, interval, direction=start.direction, origin=start.origin, **options)
    return branch, [0, len(branch) - 1]


def follow_onwards(
    starts: Sequence[ResponseStart],
    trace: Callable[[ResponseStart], tuple[ForcedBranch, list[int]]],
    *,
    through: Collection[str] = ("LB",),
    most: int = MOST_BRANCHES,
    found: Onwards | None = None,
) -> Onwards:
    """Follow families, then those that begin at their events, and so on.

    Each is followed once, and one of two mirror images (`branches.forced.known`).

    Parameters
    ----------
    starts : sequence of ResponseStart
    trace : callable
        Follows the family of a start: `trace_start` with its options.
    through : collection of str
        Types of the events behind which it goes on: of GR, SB, PD, BP and LB.
    most : int
        Most families.
    found : Onwards, optional
        Filled and returned; after an interrupt it has the families that were finished.

    Raises
    ------
    ValueError, RuntimeError
        As `trace`, for one of the starts.
    """
    assert set(through) <= set(SWITCHES)
    found = Onwards() if found is None else found
    waiting = deque(_Waiting(start, -1, None) for start in starts)
    while waiting and len(found.branches) < most:
        start, source, event = one = waiting.popleft()
        known = _followed(found.branches, one)
        if known is not None:
            if event is not None:
                found.links.append((source, event.id, known))
            continue
        try:
            branch, ends = trace(start)
        except (ValueError, RuntimeError) as error:
            if event is None:
                raise
            found.notes.append(f"the family from {start.origin} was not followed: {error}")
            continue
        number = len(found.branches)
        found.branches.append(branch)
        if start.problem.ends is not None:
            continue
        if event is not None:
            found.links.append((source, event.id, number))
        for at in branch.events:
            # At an exchange of impacts the family goes on, from an end that is new.
            if at.type in through and (at.type != "LB" or at.point in ends):
                waiting.extend(_Waiting(onward, number, at) for onward in _behind(found, number, at))
    found.left = sum(_followed(found.branches, one) is None for one in waiting)
    return found


def _behind(found: Onwards, number: int, event: ForcedEvent) -> list[ResponseStart]:
    """The starts of the families that begin at an event."""
    branch = found.branches[number]
    origin = f"{event.id} of branch {number + 1}, {branch.name} = {event.values[branch.name]:.12g}"
    try:
        return [ResponseStart(*onward, "along", origin) for onward in switch_response(branch, event)]
    except RuntimeError as error:
        found.notes.append(f"branch {number + 1}: {error}")
        return []


def _followed(branches: Sequence[ForcedBranch], one: _Waiting) -> int | None:
    """Number of the branch that is the family of a start; None if it was not followed yet."""
    if one.event is None:
        return next((number for number, branch in enumerate(branches) if one.start.known is None and _covers(branch, one.start)), None)
    y = one.start.orbit.y if isinstance(one.start.orbit, Step) else one.start.orbit
    return next((number for number, branch in enumerate(branches) if has_orbit(branch, one.start.problem, y)), None)


def _covers(branch: ForcedBranch, start: ResponseStart) -> bool:
    """Whether a branch of the response without impacts has the value of a start: there is one such response at a value."""
    if branch.problem.ends or branch.problem.sequence or start.problem.sequence or not isinstance(start.orbit, np.ndarray):
        return False
    value = start.problem.parameters(start.orbit)[branch.name]
    low, high = branch.parameter.min(), branch.parameter.max()
    slack = 1e-9 * (high - low)  # an end is located to rounding
    return bool(low - slack <= value <= high + slack)
