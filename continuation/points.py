"""The points of a run, and the check whether the run has returned to one of them.

Points of a block of steps stay in its arrays; a `Point` is created on access.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from continuation.control import Settings, height
from continuation.location import Locator, StepRefused, bracketed_root
from continuation.problem import Point, Problem, Step

__all__ = ["PlainPoints", "Points", "landing"]

_PARALLEL = 0.999
"""Cosine between the tangents at one point of one curve, at least."""


@dataclass(slots=True, eq=False, repr=False)
class PlainPoints(Sequence[Point]):
    """A sequence of consecutive points without events. Each `Point` is created on access.

    Parameters
    ----------
    begin : int
        Index of the first point in the run.
    arclengths, strides : (N,) float
        Arclength of each, and the length of the step that led there.
    steps : sequence of N Step
    seen : callable, optional
        Converts a step to the orientation of the run; by default steps are unchanged.
    """

    begin: int
    arclengths: np.ndarray
    strides: np.ndarray
    steps: Sequence[Step]
    seen: Callable[[Step], Step] | None = None

    def __len__(self) -> int:
        return len(self.steps)

    @overload
    def __getitem__(self, place: int) -> Point: ...

    @overload
    def __getitem__(self, place: slice) -> PlainPoints: ...

    def __getitem__(self, place: int | slice) -> Point | PlainPoints:
        if isinstance(place, slice):
            first, _, stride = place.indices(len(self))
            if stride != 1:
                raise ValueError(f"points[{place}]: expected neighbours in their order")
            return PlainPoints(self.begin + first, self.arclengths[place], self.strides[place], self.steps[place], self.seen)
        if place < 0:
            place += len(self)
        step = self.steps[place]
        index = self.begin + place
        return Point(index, float(self.arclengths[place]), step if self.seen is None else self.seen(step), float(self.strides[place]))


Piece = list[Point] | PlainPoints


class Points(Sequence[Point]):
    """The points of a run, in pieces.

    Parameters
    ----------
    pieces : sequence of (list of Point, or PlainPoints)
        None of them empty.
    """

    def __init__(self, pieces: Sequence[Piece] = ()) -> None:
        self.pieces: list[Piece] = []
        self._begins: list[int] = []
        self._length = 0
        for piece in pieces:
            self.add(piece)

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[Point]:
        for piece in self.pieces:
            yield from piece

    @overload
    def __getitem__(self, place: int) -> Point: ...

    @overload
    def __getitem__(self, place: slice) -> Points: ...

    def __getitem__(self, place: int | slice) -> Point | Points:
        if isinstance(place, slice):
            first, last, stride = place.indices(self._length)
            if stride != 1:
                raise ValueError(f"points[{place}]: expected neighbours in their order")
            parts = (
                piece[max(0, first - begin) : max(0, last - begin)] for begin, piece in zip(self._begins, self.pieces, strict=True)
            )
            return Points([part for part in parts if len(part)])
        if not -self._length <= place < self._length:
            raise IndexError(f"point {place} of {self._length}")
        k = bisect_right(self._begins, place % self._length) - 1
        return self.pieces[k][place % self._length - self._begins[k]]

    def __setitem__(self, place: int, point: Point) -> None:
        k = bisect_right(self._begins, place % self._length) - 1
        piece = self.pieces[k]
        if not isinstance(piece, list):
            raise TypeError("a point of a block of steps stays as it is")
        piece[place % self._length - self._begins[k]] = point

    def add(self, piece: Piece) -> None:
        """Add some points; single ones are put to those before them."""
        if isinstance(piece, list) and self.pieces and isinstance(self.pieces[-1], list):
            self.pieces[-1] += piece
        else:
            self._begins.append(self._length)
            self.pieces.append(list(piece) if isinstance(piece, list) else piece)
        self._length += len(piece)

    def arclengths(self) -> np.ndarray:
        """Arclength of each, (N,)."""
        columns = [
            piece.arclengths if isinstance(piece, PlainPoints) else np.array([point.arclength for point in piece]) for piece in self.pieces
        ]
        return np.concatenate(columns) if columns else np.empty(0)


def landing(
    problem: Problem, settings: Settings, goal: Step, direction: Any, before: Point, after: Step, ds: float
) -> tuple[float, Step] | None:
    """Where a run comes back to a goal: its start, or the point where the run in the other direction ended.

    The goal is passed where the position goes through the plane on it with a normal along the curve. There the step
    is shortened to land on that plane; the family is closed if it then lands on the goal itself, in position and in the
    unknowns, with its tangent pointing the same way.

    Parameters
    ----------
    problem : Problem
        The problem.
    settings : Settings
        `location_tolerance` and `coincidence_tolerance` are used.
    goal : Step
        The point to come back to, its tangent pointing the way that the run goes.
    direction : ndarray
        Normal of the plane, roughly along the curve at the goal, the way that the run goes.
    before : Point
    after : Step
        The step from `before` of length
    ds : float

    Returns
    -------
    (float, Step) or None
        The step from `before` that lands on the goal, with its length; None if the step to `after` does not pass it.
    """
    origin = np.asarray(goal.position, dtype=float)
    low, high = (float(height(step.position, origin, direction)) for step in (before.step, after))
    if not low < 0.0 <= high:
        return None
    locator = Locator(problem, before, ds, after, settings)
    try:
        found = bracketed_root(
            lambda s: float(height(locator.step(s).position, origin, direction)), 0.0, low, ds, high, settings.location_tolerance
        )
        step = locator.step(found.root)
    except StepRefused:
        return None
    near = settings.coincidence_tolerance
    if found.interrupted or math.dist(step.position, goal.position) > near:
        return None
    if float(np.max(np.abs(step.y - goal.y))) > near * (1.0 + float(np.max(np.abs(goal.y)))):
        return None
    lengths = float(np.linalg.norm(step.tangent)) * float(np.linalg.norm(goal.tangent))
    if not float(step.tangent @ goal.tangent) > _PARALLEL * lengths:
        return None  # another branch through the same point
    return found.root, step
