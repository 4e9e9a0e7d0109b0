"""Which curves are known already: an orbit that lies on one of them starts no second one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from branches.curves.grazing import Grazing
from branches.curves.plane import ParameterPlane
from branches.curves.record import BifurcationCurve
from branches.curves.starting import CurveStart, curve_problem
from branches.forced.identity import invariants
from branches.forced.primitive import kind_of

__all__ = ["KnownCurves", "curve_kind", "orbit_numbers"]

_SAME = 1e-6
"""Largest relative difference of two orbits that are one."""

_NEAR = 0.5
"""Largest distance of an orbit from a chord of a curve on which it is looked for, in lengths of the chord."""

_TRIED = 3
"""Chords on which an orbit is looked for."""

_SLOW = 1e-2
"""Speed, in units of arclength, that is the least one for comparisons."""

_CORRECTIONS = 12


def curve_kind(code: str, plane: ParameterPlane, grazing: Grazing | None) -> str:
    """What the orbits of a curve have in common: its type, the period, the symmetry, and the impacts up to images.

    A response without impacts that touches a stop is one orbit, in how many periods of the loads it may have its impact then.
    """
    if _only_touches(plane, grazing):
        return "GR without impacts"
    return f"{code} {grazing.kind if grazing else ''} {kind_of(plane.problem)}"


def _only_touches(plane: ParameterPlane, grazing: Grazing | None) -> bool:
    """Whether the impact that grazes is the only one."""
    return grazing is not None and grazing.kind == "speed" and len(plane.problem.sequence) == 1


def orbit_numbers(plane: ParameterPlane, y: np.ndarray) -> np.ndarray:
    """Numbers of an orbit on a curve that no image changes: both parameters, the period of the loads, sums over the phases of the impacts,
    the root mean square of their speeds, and the cosine of the angle of a pair."""
    u = plane.size
    parameters = plane.parameters_at(y[:u])
    found = invariants(plane.problem, y[:u])[1:]
    found[0] /= plane.problem.load_periods
    return np.concatenate([parameters, found, y[u:]])


class _Row(NamedTuple):
    kind: str
    curve: BifurcationCurve
    numbers: np.ndarray
    sizes: np.ndarray


@dataclass
class KnownCurves:
    """Curves that were followed, in their order."""

    _rows: list[_Row] = field(default_factory=list)

    def add(self, curve: BifurcationCurve) -> None:
        """Know one more curve."""
        numbers = np.array([orbit_numbers(curve.plane, y) for y in curve.unknowns])
        problem = curve.plane.problem
        sizes = np.maximum(np.abs(numbers).max(axis=0), 1e-300)
        sizes[3:5] = 1.0
        # An impact that grazes has a speed of rounding.
        sizes[5] = max(sizes[5], _SLOW * problem.units[problem.degrees_of_freedom])
        sizes[6:] = 1.0
        self._rows.append(_Row(curve_kind(curve.code, curve.plane, curve.grazing), curve, numbers / sizes, sizes))

    def number_at(self, start: CurveStart, y: np.ndarray) -> int | None:
        """Number of the curve that passes through a start, whose corrected unknowns are y; None if there is none."""
        kind, numbers = curve_kind(start.code, start.plane, start.grazing), orbit_numbers(start.plane, y)
        return next((k for k, row in enumerate(self._rows) if row.kind == kind and _lies_on(row, numbers)), None)


def _lies_on(row: _Row, wanted: np.ndarray) -> bool:
    """Whether a curve passes through an orbit."""
    at = wanted / row.sizes
    if np.any(np.abs(row.numbers - at).max(axis=1) < _SAME):
        return True
    return any(_refined(row, index, at) for index in _nearest(row, at))


def _nearest(row: _Row, at: np.ndarray) -> Iterator[int]:
    """Points from which an orbit can be reached: the nearer ends of the chords that are nearest to it."""
    begin, chords = row.numbers[:-1], np.diff(row.numbers, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    parts = np.clip(np.sum((at - begin) * chords, axis=1) / np.maximum(lengths**2, 1e-300), 0.0, 1.0)
    away = np.linalg.norm(begin + parts[:, None] * chords - at, axis=1)
    for k in np.argsort(away, kind="stable")[:_TRIED].tolist():
        if away[k] <= _NEAR * lengths[max(0, k - 1) : k + 2].max() + _SAME:
            yield k + int(parts[k] > 0.5)


def _refined(row: _Row, index: int, at: np.ndarray) -> bool:
    """Whether the orbit of a curve near one of its points that has the same parameter is the wanted one."""
    curve = row.curve
    problem = curve_problem(curve.plane, curve.code, curve.grazing, curve.unknowns[0], ((-math.inf, math.inf), (-math.inf, math.inf)))
    first = problem.begin(curve.unknowns[index])
    if not first.converged:
        return False
    ahead = problem.step(first.y, first.tangent, 1e-5)
    if not ahead.converged:
        return False
    here, there = (orbit_numbers(curve.plane, step.y) / row.sizes for step in (first, ahead))
    k = int(np.argmax(np.abs(there[:2] - here[:2])))
    slope = (there[k] - here[k]) / 1e-5
    ds = 0.0
    for _ in range(_CORRECTIONS):
        if slope == 0.0 or not math.isfinite(slope):
            return False
        change = (at[k] - here[k]) / slope
        step = problem.step(first.y, first.tangent, ds + change)
        if not step.converged:
            return False
        found = orbit_numbers(curve.plane, step.y) / row.sizes
        slope, ds, here = (found[k] - here[k]) / change if change else slope, ds + change, found
        if np.abs(here - at).max() < _SAME:
            return True
        if abs(here[k] - at[k]) < 1e-3 * _SAME:
            return False
    return False
