"""The matrices that are singular at bifurcations of orbits, with their exact derivatives.

The multipoint problem is linearised with its closing block multiplied by lambda, the parameters being fixed:

    SN  lambda = 1        PD  lambda = -1        NS  lambda = exp(+-i theta)

Of half a period the closing block belongs to N = -(map over T/2). There SN is 1 of N, and SB is -1 of N.

The matrices of free orbits have rows of other conditions at their ends, too: see `branches.curves.free`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from branches.curves.kernels import OTHER, OWN, free_energy
from branches.curves.plane import ParameterPlane, closing_block
from bvp.forced import ForcedProblem
from continuation.curves import Linearised, SingularCondition

__all__ = ["MULTIPLIERS", "NONE_FREED", "MatrixRows", "RowsCondition", "forced_condition", "whole_rows"]

MULTIPLIERS = {"SN": 1.0, "PD": -1.0, "SB": -1.0, "NS": None}
"""lambda of each kind of bifurcation; None: a pair on the unit circle."""


NONE_FREED = np.full((4, 2), -1)
"""Of a matrix in which the energy is not freed."""


class MatrixRows(NamedTuple):
    """Of which rows a singular matrix consists. The closing block, multiplied by lambda - 1, is added.

    source : (u, 2) int64 for each row OWN, OTHER or CONSTANT, and which row there
    constant : (u, u) the constant rows, else zeros
    shifted : (u, u) the closing block
    other : the problem with the other conditions, linearised at the same unknowns; None: there is none
    freed : (4, 2) int64: see `branches.curves.kernels.free_energy`
    """

    source: np.ndarray
    constant: np.ndarray
    shifted: np.ndarray
    other: ForcedProblem | None = None
    freed: np.ndarray = NONE_FREED

    def matrix(self, problem: ForcedProblem, at: Linearised, other: np.ndarray | None) -> np.ndarray:
        """The matrix with lambda = 1, from the derivatives of the equations and of the two parameters, and the other ones."""
        found = self._filled(self.constant.copy(), at.extra, other)
        if self.other is not None:
            free_energy(self.freed, problem.segment, at.y, self.other._factor.before, found)
        return found

    def slopes(self, own: np.ndarray, other: np.ndarray | None) -> np.ndarray:
        """The derivatives of the matrix times a vector, from those of its parts."""
        return self._filled(np.zeros_like(self.constant), own, other)

    def _filled(self, found: np.ndarray, own: np.ndarray, other: np.ndarray | None) -> np.ndarray:
        kinds, places = self.source.T
        for kind, part in ((OWN, own), (OTHER, other)):
            if part is not None:
                taken = kinds == kind
                found[taken] = part[places[taken]]
        return found


def whole_rows(plane: ParameterPlane, shifted: np.ndarray) -> MatrixRows:
    """All rows of the equations, and of the two parameters."""
    rows = np.arange(plane.size)
    return MatrixRows(np.column_stack([np.full_like(rows, OWN), rows]), np.zeros((plane.size, plane.size)), shifted)


class RowsCondition(SingularCondition):
    """A matrix of such rows that is singular at a multiplier (None: at a pair). refined: whether test functions take its derivatives, which
    are exact then."""

    def __init__(self, plane: ParameterPlane, rows: MatrixRows, multiplier: float | None, refined: bool = True):
        self.plane, self.rows = plane, rows
        exact = not refined or plane.problem.curvature.is_compiled
        super().__init__(self._parts, self._quick_slopes, multiplier, None if exact else self.slopes)

    def _parts(self, at: Linearised) -> tuple[np.ndarray, np.ndarray]:
        rows = self.rows
        other = None if rows.other is None else rows.other.jacobian(at.y)
        return rows.matrix(self.plane.problem, at, other) - rows.shifted, rows.shifted

    def slopes(self, y: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The derivatives of the matrix times a direction, (u, u)."""
        return self._from_parts(lambda problem: problem.curvature.second_along(y, direction))

    def _quick_slopes(self, at: Linearised, direction: np.ndarray) -> np.ndarray:
        return self._from_parts(lambda problem: problem.curvature.slopes_along(at.y, direction))

    def _from_parts(self, along: Callable[[ForcedProblem], np.ndarray]) -> np.ndarray:
        own, second, other = np.zeros((self.plane.size, self.plane.size)), along(self.plane.problem), self.rows.other
        own[:-2], own[-1] = second[:-1], second[-1]
        return self.rows.slopes(own, None if other is None else along(other))


def forced_condition(plane: ParameterPlane, code: str) -> RowsCondition:
    """The condition of a bifurcation of orbits that close after a period, or half of it."""
    return RowsCondition(plane, whole_rows(plane, closing_block(plane)), MULTIPLIERS[code])
