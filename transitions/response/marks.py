"""Values of any column that are marked along a followed response (UZ)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from branches.events import numbered
from branches.forced.branch import ForcedBranch, ForcedEvent, largest_multiplier
from bvp.multipoint import Solution
from continuation.bracketing import StepRefused, bracketed_root
from transitions.response.measures import column_of

__all__ = ["mark_values", "missed_values"]

_TOLERANCE = 1e-12
"""Width of the bracket of a mark, in arclength."""

_SAME = 1e-6
"""Arclength within which two marks of one value are one."""

_WIDTH = 1e-8
"""Arclength to which an extremum is located: its value is then exact to rounding."""

_TOUCH = 1e-12
"""Distance of an extremum or a point from a value, beside its size, that counts as none."""

_TRUST = 1.0
"""Error of a parabola through three points, beside what it goes below the middle one."""

_JUMP = 3.0
"""A phase that changes by more radians between two points has jumped from 2 pi to 0."""


_Mark = tuple[int, ForcedEvent, np.ndarray, np.ndarray]
"""The index behind which a mark comes, its event, its unknowns and its tangent."""


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
    A value is found between two points of the branch on different sides of it. Where a curve turns back beside a value, its extremum is
    computed: it passes the value twice, or touches it, or turns before it.
    """
    table = column_of(branch, column)
    found: list[_Mark] = []
    for value in values:
        for k, curve in enumerate(table.T):
            off = curve - value
            for i in np.flatnonzero(np.isfinite(off[:-1]) & np.isfinite(off[1:]) & (off[:-1] * off[1:] < 0.0)).tolist():
                if not (column.startswith("phase") and abs(off[i + 1] - off[i]) > _JUMP):
                    length = float(branch.arclength[i + 1] - branch.arclength[i])
                    found += _between(_Curve(branch, column, k, value, i), (0.0, length), (float(off[i]), float(off[i + 1])))
            for i in _turns(off, np.asarray(branch.arclength)):
                found += _beside_turn(_Curve(branch, column, k, value, i), off)
            found += [_at_point(branch, column, value, i) for i in np.flatnonzero(off == 0.0).tolist()]
    return _with(branch, found)


def missed_values(branches: Sequence[ForcedBranch], wanted: Sequence[tuple[str, float]]) -> list[str]:
    """The values of columns that no event UZ of some branches marks, each in a line with what the column has there."""
    notes = {event.note for branch in branches for event in branch.events if event.type == "UZ"}
    lines = []
    for column, value in dict.fromkeys(wanted):
        if f"{column} = {value:g}" in notes:
            continue
        curves = [curve for branch in branches for curve in _finite(branch, column)]
        if any(np.abs(curve - value).min() <= _TOUCH * np.abs(curve).max() for curve in curves):
            continue  # an end of the range has an event of its own
        spans: list[tuple[float, float]] = []
        for low, high in sorted((float(curve.min()), float(curve.max())) for curve in curves):
            if spans and low <= spans[-1][1]:
                low, high = spans[-1][0], max(high, spans.pop()[1])
            spans.append((low, high))
        inside = any(low <= value <= high for low, high in spans)
        missed = "was not found" if inside else "is not"
        texts = [f"{low:.8g} to {high:.8g}" for low, high in spans] or ["no value"]
        lines.append(f"{column} = {value:g} of --uz {missed} on the families followed: {column} = {', '.join(texts)}")
    return lines


def _finite(branch: ForcedBranch, column: str) -> list[np.ndarray]:
    """The curves of a column, each without the points that have no value."""
    finite = [curve[np.isfinite(curve)] for curve in column_of(branch, column).T]
    return [curve for curve in finite if len(curve)]


def _event(
    branch: ForcedBranch, column: str, value: float, y: np.ndarray, arclength: float, bracket: tuple[float, float], residual: float
) -> ForcedEvent:
    problem = branch.problem
    largest = largest_multiplier(problem, problem.period_multipliers(y))
    return ForcedEvent(
        "UZ", "UZ", 0, problem.known_values(y), arclength, "located", bracket, residual, None, None, f"{column} = {value:g}",
        largest if np.isfinite(largest) else None,
    )  # fmt: skip


def _at_point(branch: ForcedBranch, column: str, value: float, i: int) -> _Mark:
    y, arclength = branch.unknowns[i], float(branch.arclength[i])
    return i, _event(branch, column, value, y, arclength, (arclength, arclength), 0.0), y, branch.tangents[i]


@dataclass(frozen=True)
class _Curve:
    """A curve of a column near point i of a branch, as a function of the arclength from there."""

    branch: ForcedBranch
    column: str
    k: int
    value: float
    i: int

    def solved(self, ds: float) -> Solution:
        """The orbit at a distance."""
        problem = self.branch.problem
        tangent = np.concatenate([self.branch.tangents[self.i], np.zeros(problem.unknowns)])
        solution = problem.step(self.branch.unknowns[self.i], tangent, ds)
        if solution is None:
            raise StepRefused
        return solution

    def missing(self, ds: float) -> float:
        """The column there less the value."""
        # The first row keeps the order of the impacts.
        begin = self.branch.unknowns[self.branch.start]
        pair = replace(self.branch, unknowns=np.stack([begin, self.solved(ds).y]), start=0, events=())
        return float(column_of(pair, self.column)[1, self.k]) - self.value

    def mark(self, ds: float, low: float, high: float) -> _Mark:
        """The mark at a distance that is known between two others."""
        begin, solution = float(self.branch.arclength[self.i]), self.solved(ds)
        bracket, residual = (begin + low, begin + high), abs(self.missing(ds))
        event = _event(self.branch, self.column, self.value, solution.y, begin + ds, bracket, residual)
        return self.i, event, solution.y, solution.tangent[: self.branch.problem.unknowns]


def _between(curve: _Curve, ends: tuple[float, float], off: tuple[float, float]) -> list[_Mark]:
    """The mark between two distances at which the curve is on different sides of the value."""
    try:
        root = bracketed_root(curve.missing, ends[0], off[0], ends[1], off[1], _TOLERANCE)
        return [curve.mark(root.root, root.low, root.high)]
    except StepRefused:
        return []


def _turns(off: np.ndarray, arclength: np.ndarray) -> list[int]:
    """Points where a curve, less a value, is nearest to zero among their neighbours, and the parabola through the three comes so near to
    zero that the curve can reach it."""
    found = []
    for i in range(1, len(off) - 1):
        near, (before, here, after) = np.sign(off[i]) * off[i - 1 : i + 2], arclength[i - 1 : i + 2]
        if not (0.0 < near[1] <= min(near[0], near[2]) and before < here < after):
            continue
        slopes = (near[1] - near[0]) / (here - before), (near[2] - near[1]) / (after - here)
        bend = (slopes[1] - slopes[0]) / (after - before)
        slope = slopes[0] + bend * (here - before)
        least = near[1] - (slope**2 / (4.0 * bend) if bend > 0.0 else 0.0)
        # The parabola can be wrong by as much as it goes below the point.
        if least - _TRUST * (near[1] - least) <= _TOUCH * np.abs(near).max():
            found.append(i)
    return found


def _beside_turn(curve: _Curve, off: np.ndarray) -> list[_Mark]:
    """The marks around a point where a curve turns back: two, one where it touches the value, none where it turns before it."""
    from scipy.optimize import minimize_scalar

    i, sign = curve.i, float(np.sign(off[curve.i]))
    low, high = (float(curve.branch.arclength[place] - curve.branch.arclength[i]) for place in (i - 1, i + 1))
    try:
        found = minimize_scalar(lambda ds: sign * curve.missing(ds), bounds=(low, high), method="bounded", options={"xatol": _WIDTH})
        inner, least = float(found.x), float(found.fun)
        if abs(least) <= _TOUCH * max(abs(curve.value), abs(off[i])):
            return [curve.mark(inner, inner - _WIDTH, inner + _WIDTH)]
        if least > 0.0:
            return []
        sides = ((low, inner), (float(off[i - 1]), sign * least)), ((inner, high), (sign * least, float(off[i + 1])))
        return [mark for ends, values in sides for mark in _between(curve, ends, values)]
    except StepRefused:
        return []


def _with(branch: ForcedBranch, found: list[_Mark]) -> ForcedBranch:
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
    return replace(branch, events=numbered(branch.events))
