"""The normal forms along a curve of SB or PD of free orbits: docs/theory.md, section 21."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.linalg.lapack import dgesv

from branches.curves.free import BOTH, Symmetry
from branches.curves.plane import ParameterPlane
from branches.released.criticality import CriticalEquations, critical_nu
from branches.released.segments import Segment, changed, segment_of
from branches.sequences import Ends, ImpactSequence
from bvp.released import ReleasedProblem
from continuation.curves import Held, Linearised

__all__ = ["CurveNormalForm"]

_STEP = 1e-5
"""Distance from an orbit, in units of the unknowns, over which the change of a multiplier is measured."""


class CurveNormalForm:
    """The reduced equations of the orbits that begin along a curve of SB or PD, at fixed energy and parameters.

    Parameters
    ----------
    plane : ParameterPlane
    symmetry : (bool, bool)
        Of the critical perturbation.
    doubled : bool
        Whether the orbits are quarters, solved as halves: then two families begin.

    Attributes
    ----------
    count : int
        How many families begin: the number of reduced equations.

    Notes
    -----
    The equations are r x^3 + (s - s_0) x = 0, s being a coordinate across the curve. r does not depend on the null vectors, and its sign is
    that of s, whose orientation the borders of the condition keep along the curve.
    """

    def __init__(self, plane: ParameterPlane, symmetry: Symmetry, doubled: bool):
        problem = plane.problem
        assert isinstance(problem, ReleasedProblem)
        self.problem = problem
        # The level of nu at which the pair is critical: see `bvp.stability`.
        self.level = 0 if symmetry == BOTH else -1
        self._windows: list[Callable[[Segment, Segment | None], Segment]] = [
            lambda segment, change: _window(symmetry, problem.quarters, segment if change is None else change)
        ]
        if doubled:
            self._windows.append(lambda half, change: _window((True, False), 1, half.half(problem, change)).twice())
        self.count = len(self._windows)
        self._wide: dict[tuple[Ends, ImpactSequence], ReleasedProblem] = {}

    def reduced(self, at: Linearised, held: Held, tangent: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r of each family, NaN where it is not known, and the direction across the curve, (u,). """
        problem = self.problem
        way = _across(at, held, tangent, scale)
        here, moved = segment_of(problem, at.y), changed(problem, at.y, way)
        found = np.full(self.count, math.nan)
        for k, (window, matrix) in enumerate(zip(self._windows, self._matrices(here), strict=True)):
            cubic = None if matrix is None else matrix.cubic()
            if matrix is None or cubic is None:
                continue
            slope, error = matrix.slope(window(here, moved).unknowns(matrix.problem))
            if abs(slope) > error and abs(cubic.coefficient) > cubic.error:  # else rounding decides the sign
                found[k] = cubic.coefficient / slope
        return found, way

    def emanating(self, y: np.ndarray) -> tuple[ReleasedProblem, np.ndarray]:
        """An orbit whose criticality changes, in the problem of the orbits that begin there with the degenerate equation."""
        problem, here = self.problem, segment_of(self.problem, y)
        cubics = [None if matrix is None else matrix.cubic() for matrix in self._matrices(here)]
        sizes = [math.inf if cubic is None else abs(cubic.coefficient) for cubic in cubics]
        found = self._windows[int(np.argmin(sizes))](here, None)
        made = found.problem(problem, y)
        return made, found.unknowns(made)

    def coefficient(self, y: np.ndarray, reduced: np.ndarray, way: np.ndarray) -> float:
        """The critical number of the orbits with more symmetry, where others with x = 1 exist to this order: positive if it is off the unit
        circle. That is supercritical. NaN where it is not known."""
        if self.count > 1:
            return math.copysign(float(np.min(np.abs(reduced))), float(np.prod(reduced)))
        if math.isnan(reduced[0]):
            return math.nan
        try:
            ahead, behind = (critical_nu(self.problem, y + change * way, self.level)[0] for change in (_STEP, -_STEP))
        except (ValueError, RuntimeError, np.linalg.LinAlgError):
            return math.nan
        off = (ahead - behind) / (2.0 * _STEP) * (1.0 if self.level == 0 else -1.0)
        return -float(reduced[0]) * off

    def _matrices(self, here: Segment) -> list[CriticalEquations | None]:
        """The singular equations of the orbits that begin; None where they are not known."""
        found: list[CriticalEquations | None] = []
        for window in self._windows:
            try:
                segment = window(here, None)
                matrix = CriticalEquations(wide := self._over(segment), segment.unknowns(wide))
            except (ValueError, RuntimeError, np.linalg.LinAlgError):
                found.append(None)
                continue
            found.append(matrix if matrix.is_singular else None)
        return found

    def _over(self, segment: Segment) -> ReleasedProblem:
        """The problem of the orbits that begin."""
        key = segment.ends, segment.sequence
        if key not in self._wide:
            problem = self.problem
            keep = [*(f"{name} = {problem.values[name]!r}" for name in problem.released[1:]), f"energy = {problem.energy!r}"]
            self._wide[key] = problem.sibling(segment.sequence, ends=segment.ends, keep=keep)
        return self._wide[key]


def _window(symmetry: Symmetry, quarters: int, segment: Segment) -> Segment:
    """The segment over which the orbits that begin are solved."""
    if symmetry == BOTH:
        return (segment if quarters == 2 else segment.twice()).twice().closed()
    return (segment.backwards() if symmetry == (True, False) else segment).twice()


def _across(at: Linearised, held: Held, tangent: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """The direction in the surface of orbits, across a curve, in which its condition rises. (u,), of length 1 in units of the unknowns."""
    u = len(at.y)
    matrix, right = np.empty((u, u)), np.zeros(u)
    matrix[:-2], matrix[-2], matrix[-1] = at.jacobian * scale, tangent[:u] / scale, held.gradient[0, :u] * scale
    right[-1] = 1.0
    found = dgesv(matrix, right)[2]
    return found / math.sqrt(float(found @ found)) * scale
