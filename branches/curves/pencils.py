"""The matrices that are singular at bifurcations of orbits, with their exact derivatives.

The multipoint problem is linearised with its closing block multiplied by lambda, the parameters being fixed:

    SN  lambda = 1        PD  lambda = -1        NS  lambda = exp(+-i theta)

Of half a period the closing block belongs to N = -(map over T/2). There SN is 1 of N, and SB is -1 of N.

The closing block multiplies the first node where it ends the orbit: its state, and its time. The derivative by the time depends on the
orbit. A matrix times V is the derivative of the equations of an open orbit, whose end is at a time of its own, along V with the time lambda
times that of the begin.

The matrices of free orbits have rows of other conditions at their ends, too: see `branches.curves.free`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from branches.curves.plane import ParameterPlane, closing_block
from bvp.forced import ForcedProblem
from continuation.curves import Linearised, SingularCondition

__all__ = [
    "CONSTANT", "MULTIPLIERS", "NONE_FREED", "OTHER", "OWN", "Freed", "MatrixRows", "RowsCondition", "forced_condition", "whole_rows",
]  # fmt: skip

MULTIPLIERS = {"SN": 1.0, "PD": -1.0, "SB": -1.0, "NS": None}
"""lambda of each kind of bifurcation; None: a pair on the unit circle."""

OWN, OTHER, CONSTANT = range(3)
"""Where a row of a singular matrix is from: the derivatives of the equations of the orbit, those of the other conditions, a constant."""


class Freed(NamedTuple):
    """How a perturbation that is antisymmetric about both ends can change its energy, and what excludes a shift in time.

    column: the unknown that is used for it, which is no part of the perturbation; -1: there is none. ends: of each end its first row, and
    the part of the state that is not zero there, or -1 at a stop; None: its energy is not changed. shift: the row that excludes a shift,
    that part of the start, and the part that is zero there; None: a constant row does."""

    column: int
    ends: tuple[tuple[int, int] | None, tuple[int, int] | None]
    shift: tuple[int, int, int] | None

    def write(self, problem: ForcedProblem, y: np.ndarray, matrix: np.ndarray) -> None:
        """Write this into a matrix (u, u) of an orbit."""
        if self.column < 0:
            return
        n, start = problem.degrees_of_freedom, problem.states(y)[0]
        matrix[:, self.column] = 0.0
        for end, place in enumerate(self.ends):
            if place is None:
                continue
            (row, part), state = place, start if end == 0 else problem.end_states(y)[-1]
            if part >= 0:
                matrix[row : row + n, self.column] = state[part : part + n]
            else:
                speed = float(problem.gap[problem.inner + 1 - end, :n] @ state[n:])
                matrix[row, self.column] = speed if end == 0 else -speed
        if self.shift is not None:
            row, part, turned = self.shift
            mass = problem.parametric.entries(problem.parameters(y))[problem.parametric.layout.mass].reshape(n, n)
            matrix[row] = 0.0
            matrix[row, 1 + turned : 1 + turned + n] = mass @ start[part : part + n]


NONE_FREED = Freed(-1, (None, None), None)
"""Of a matrix in which the energy is not freed."""


class MatrixRows(NamedTuple):
    """Of which rows a singular matrix consists. The closing block, multiplied by lambda - 1, is added.

    source : (u, 2) int64 for each row OWN, OTHER or CONSTANT, and which row there
    constant : (u, u) the constant rows, else zeros
    closes : whether there is a closing block
    other : the problem with the other conditions, linearised at the same unknowns; None: there is none
    freed : what the column and the row are that free the energy
    """

    source: np.ndarray
    constant: np.ndarray
    closes: bool
    other: ForcedProblem | None = None
    freed: Freed = NONE_FREED

    def matrix(self, problem: ForcedProblem, at: Linearised, other: np.ndarray | None) -> np.ndarray:
        """The matrix with lambda = 1, from the derivatives of the equations and of the two parameters, and the other ones."""
        found = self._filled(self.constant.copy(), at.extra, other)
        self.freed.write(problem, at.y, found)
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


def whole_rows(plane: ParameterPlane, closes: bool) -> MatrixRows:
    """All rows of the equations, and of the two parameters."""
    rows = np.arange(plane.size)
    return MatrixRows(np.column_stack([np.full_like(rows, OWN), rows]), np.zeros((plane.size, plane.size)), closes)


class RowsCondition(SingularCondition):
    """A matrix of such rows that is singular at a multiplier (None: at a pair)."""

    def __init__(self, plane: ParameterPlane, rows: MatrixRows, multiplier: float | None):
        self.plane, self.rows = plane, rows
        super().__init__(self._parts, self._slopes, multiplier)

    def _parts(self, at: Linearised) -> tuple[np.ndarray, np.ndarray]:
        rows, plane = self.rows, self.plane
        other = None if rows.other is None else rows.other.jacobian(at.y)
        shifted = closing_block(plane, at.y) if rows.closes else np.zeros((plane.size, plane.size))
        return rows.matrix(plane.problem, at, other) - shifted, shifted

    def _slopes(self, at: Linearised, parts: np.ndarray, own: np.ndarray) -> np.ndarray:
        """See `continuation.curves.SingularCondition`."""
        if self.multiplier is not None:
            return self._along(at.y, parts[0], self.multiplier * parts[0, 0])
        first, second = parts
        return np.vstack([self._along(at.y, first, second[0]), self._along(at.y, second, 2.0 * own[0] * second[0] - first[0])])

    def _along(self, y: np.ndarray, direction: np.ndarray, at_end: float) -> np.ndarray:
        """The derivatives of a row of blocks times a direction, (u, u). at_end: what the time at the end of the orbit changes by."""
        plane, rows = self.plane, self.rows
        if rows.freed.column >= 0:
            direction = direction.copy()
            direction[rows.freed.column] = 0.0
        own, size = np.zeros((plane.size, plane.size)), plane.size
        curvature = plane.problem.curvature
        if rows.closes and plane.problem.has_clock:
            second = curvature.open_second(y, np.append(direction, at_end))[:-1]
            second[:, 0] += second[:, -1]
            second = second[:, :size]
        else:
            second = curvature.second_along(y, direction)
        own[:-2], own[-1] = second[:-1], second[-1]
        return rows.slopes(own, None if rows.other is None else rows.other.curvature.second_along(y, direction))


def forced_condition(plane: ParameterPlane, code: str) -> RowsCondition:
    """The condition of a bifurcation of orbits that close after a period, or half of it."""
    return RowsCondition(plane, whole_rows(plane, True), MULTIPLIERS[code])
