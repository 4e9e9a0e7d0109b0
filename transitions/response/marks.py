"""Values of any column that are marked along a followed response (UZ)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from branches.forced.branch import ForcedBranch, ForcedEvent, largest_multiplier
from branches.forced.extending import with_ids
from bvp.multipoint import Solution
from continuation.bracketing import StepRefused, bracketed_root
from transitions.response.measures import column_of

__all__ = ["mark_values"]

_TOLERANCE = 1e-12
"""Width of the bracket of a mark, in arclength."""

_SAME = 1e-6
"""Arclength within which two marks of one value are one."""

_JUMP = 3.0
"""A phase that changes by more radians between two points has jumped from 2 pi to 0."""


def mark_values(branch: ForcedBranch, column: str, values: Sequence[float]) -> ForcedBranch:
    """The branch with a point and an event UZ at each place where a column passes a value.

    Parameters
    ----------
    branch : ForcedBranch
    column : str
        As for `column_of`. Each of its curves counts.
    values : sequence of float

    Notes
    -----
    A value is found between two points of the branch on different sides of it. Where a curve touches a value between two points, and
    turns back, it is not found.
    """
    table = column_of(branch, column)
    found: list[tuple[int, ForcedEvent, np.ndarray, np.ndarray]] = []
    for value in values:
        for k, curve in enumerate(table.T):
            off = curve - value
            for i in np.flatnonzero(np.isfinite(off[:-1]) & np.isfinite(off[1:]) & (off[:-1] * off[1:] < 0.0)).tolist():
                if not (column.startswith("phase") and abs(off[i + 1] - off[i]) > _JUMP):
                    found += _between(branch, column, k, value, i, (float(off[i]), float(off[i + 1])))
            found += [_at_point(branch, column, value, i) for i in np.flatnonzero(off == 0.0).tolist()]
    return _with(branch, found)


def _event(
    branch: ForcedBranch, column: str, value: float, y: np.ndarray, arclength: float, bracket: tuple[float, float], residual: float
) -> ForcedEvent:
    problem = branch.problem
    largest = largest_multiplier(problem, problem.multipliers(y))
    return ForcedEvent(
        "UZ", "UZ", 0, problem.known_values(y), arclength, "located", bracket, residual, None, None, f"{column} = {value:g}",
        largest if np.isfinite(largest) else None,
    )  # fmt: skip


def _at_point(branch: ForcedBranch, column: str, value: float, i: int) -> tuple[int, ForcedEvent, np.ndarray, np.ndarray]:
    y, arclength = branch.unknowns[i], float(branch.arclength[i])
    return i, _event(branch, column, value, y, arclength, (arclength, arclength), 0.0), y, branch.tangents[i]


def _between(
    branch: ForcedBranch, column: str, k: int, value: float, i: int, off: tuple[float, float]
) -> list[tuple[int, ForcedEvent, np.ndarray, np.ndarray]]:
    """The mark between points i and i + 1: the index behind which it comes, its event, its unknowns and its tangent."""
    problem, begin = branch.problem, float(branch.arclength[i])
    tangent = np.concatenate([branch.tangents[i], np.zeros(problem.unknowns)])
    length = float(branch.arclength[i + 1]) - begin

    def solved(ds: float) -> Solution:
        solution = problem.step(branch.unknowns[i], tangent, ds)
        if solution is None:
            raise StepRefused
        return solution

    def missing(ds: float) -> float:
        # The first row keeps the order of the impacts.
        pair = replace(branch, unknowns=np.stack([branch.unknowns[branch.start], solved(ds).y]), start=0, events=())
        return float(column_of(pair, column)[1, k]) - value

    try:
        root = bracketed_root(missing, 0.0, off[0], length, off[1], _TOLERANCE)
        solution = solved(root.root)
    except StepRefused:
        return []
    bracket = (begin + root.low, begin + root.high)
    event = _event(branch, column, value, solution.y, begin + root.root, bracket, abs(missing(root.root)))
    return [(i, event, solution.y, solution.tangent[: problem.unknowns])]


def _with(branch: ForcedBranch, found: list[tuple[int, ForcedEvent, np.ndarray, np.ndarray]]) -> ForcedBranch:
    """The branch with more events. One at a point shares it; the others get points of their own."""
    for _, event, y, tangent in sorted(found, key=lambda item: item[1].arclength):
        if any(old.note == event.note and abs(old.arclength - event.arclength) < _SAME for old in branch.events):
            continue
        same = np.flatnonzero(branch.arclength == event.arclength)
        if len(same):
            place, events = int(same[0]), branch.events
        else:
            place = int(np.searchsorted(branch.arclength, event.arclength))
            events = tuple(old._replace(point=old.point + (old.point >= place)) for old in branch.events)
            residual = float(np.abs(branch.problem.residual(y) / branch.problem.scales(y)[: len(y) - 1]).max())
            branch = replace(
                branch, unknowns=np.insert(branch.unknowns, place, y, axis=0), tangents=np.insert(branch.tangents, place, tangent, axis=0),
                arclength=np.insert(branch.arclength, place, event.arclength), residual=np.insert(branch.residual, place, residual),
                start=branch.start + (branch.start >= place),
            )  # fmt: skip
        kept = [*(old for old in events if old.point <= place), event._replace(point=place), *(old for old in events if old.point > place)]
        branch = replace(branch, events=tuple(kept))
    return with_ids(branch)
