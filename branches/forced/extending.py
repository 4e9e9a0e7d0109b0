"""A followed family of forced orbits goes on beyond its ends: the pieces become one branch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from branches.events import Ended, event_ids
from branches.forced.branch import ForcedBranch, ForcedEvent
from continuation.problem import EndReason

__all__ = ["can_go_on", "joined", "outward", "with_ids"]

_OPEN = {
    reason.name
    for reason in (
        EndReason.POINTS, EndReason.NOT_ASKED, EndReason.STOP_AT, EndReason.STOP_WHEN, EndReason.INTERRUPTED, EndReason.MINIMUM_STEP
    )
}  # fmt: skip
"""Ends from which a family can go on."""


def can_go_on(branch: ForcedBranch, last: bool, interval: tuple[float, float]) -> bool:
    """Whether a branch can go on beyond its first or last point in a range of its parameter."""
    place = len(branch) - 1 if last else 0
    if branch.ended[last].reason == EndReason.EVENT.name:
        value = branch.parameter[place]
        bounds = any(np.isclose(value, bound, rtol=1e-9, atol=0.0) for bound in branch.interval)
        event = next((event for event in branch.events if event.point == place), None)
        return event is not None and event.type == "EP" and bounds and interval[0] < value < interval[1]
    return branch.ended[last].reason in _OPEN


def outward(branch: ForcedBranch, last: bool) -> np.ndarray:
    """The tangent (u,) at the first or last point that points out of the branch."""
    return branch.tangents[-1] if last else -branch.tangents[0]


def joined(branch: ForcedBranch, further: ForcedBranch, last: bool) -> ForcedBranch:
    """A branch, and the piece that was followed outwards from its first or last point, as one branch."""
    place = len(branch) - 1 if last else 0
    # An end of the old range is no event any more.
    kept = [event for event in branch.events if not (event.type == "EP" and event.point == place)]
    if last:
        length = float(branch.arclength[-1])
        events = [*kept, *(_moved(event, place, length) for event in further.events if event.point)]
        return with_ids(
            replace(
                branch, unknowns=np.concatenate([branch.unknowns, further.unknowns[1:]]),
                tangents=np.concatenate([branch.tangents, further.tangents[1:]]),
                arclength=np.concatenate([branch.arclength, length + further.arclength[1:]]),
                residual=np.concatenate([branch.residual, further.residual[1:]]),
                events=tuple(events), ended=(branch.ended[0], further.ended[1]), interval=further.interval,
            )
        )  # fmt: skip
    return with_ids(_reversed(joined(_reversed(branch), further, True)))


def _reversed(branch: ForcedBranch) -> ForcedBranch:
    """The same branch in the other order."""
    length, place = float(branch.arclength[-1]), len(branch) - 1
    ended: tuple[Ended, Ended] = branch.ended[1], branch.ended[0]
    return replace(
        branch, unknowns=branch.unknowns[::-1], tangents=-branch.tangents[::-1], arclength=length - branch.arclength[::-1],
        residual=branch.residual[::-1], events=tuple(_moved(event, place, length, -1) for event in branch.events[::-1]),
        ended=ended, start=place - branch.start,
    )  # fmt: skip


def _moved(event: ForcedEvent, place: int, length: float, sign: int = 1) -> ForcedEvent:
    """An event of a piece whose first point has this place and arclength in another branch, along it or against it (sign -1)."""
    low, high = sorted(length + sign * end for end in event.bracket)
    return event._replace(point=place + sign * event.point, arclength=length + sign * event.arclength, bracket=(low, high))


def with_ids(branch: ForcedBranch) -> ForcedBranch:
    """The branch with its events counted anew."""
    ids = event_ids(event.type for event in branch.events)
    return replace(branch, events=tuple(event._replace(id=id) for event, id in zip(branch.events, ids, strict=True)))
