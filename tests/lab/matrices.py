"""Products of numbers, the elimination of a multipoint Jacobian, and modes."""

import numpy as np

from bvp.kernels import newton, undamped
from bvp.kernels.stroboscopic import bounded_product as _bounded_product

__all__ = ["Elimination", "bounded_product", "modes"]


def bounded_product(factors):
    """Return a number in [-1, 1] with the sign and the zeros of the product of real numbers and conjugate pairs."""
    return _bounded_product(np.array(factors, dtype=complex), np.empty(5, dtype=complex))


def modes(mass, stiffness):
    """Return the squared frequencies and the shapes of K phi = w^2 M phi, or None for a mass that is not positive definite."""
    work = undamped.make_mode_work(len(mass))
    return (work.squares.copy(), work.shapes.copy()) if undamped.modes_of_matrices(mass, stiffness, work) > 0.0 else None


class Elimination:
    """J^T = Q [R; 0] of the Jacobian (u - 1, u) of a multipoint problem with flights of `rows` equations each.

    flights, rows, start : number of flights, equations of each, size of the first block of unknowns
    window, closing : the rows of each flight in the columns of two nodes, and the closing rows in all columns
    closing_first : first flight whose unknowns the closing equations touch
    """

    def __init__(self, flights, rows, start, window, closing, closing_first):
        self._shape = flights, rows, start
        self._window, self._closing = window.copy(), closing.copy()
        count = closing.shape[1] - 1
        self.diagonal, self._factor = np.zeros(count), np.zeros(count)
        self.reflections = newton.eliminate(flights, rows, start, closing_first, self._window, self._closing, self.diagonal, self._factor)

    def times_q(self, x):
        """Return Q x."""
        out = np.array(x, float)
        newton.apply_reflectors(*self._shape, self._window, self._closing, self._factor, out)
        return out

    @property
    def q(self):
        """Q, column by column."""
        return np.column_stack([self.times_q(column) for column in np.eye(self._closing.shape[1])])

    @property
    def r(self):
        """R (u, u - 1): what stands above the pivots in the factored arrays, and the diagonal."""
        flights, rows, _ = self._shape
        unknowns = self._closing.shape[1]
        r = np.zeros((unknowns, unknowns - 1))
        for j in range(unknowns - 1):
            if j < flights * rows:
                base = max(0, (j // rows - 1) * rows)
                r[base:j, j] = self._window[j, : j - base]
            else:
                r[:j, j] = self._closing[j - flights * rows, :j]
            r[j, j] = self.diagonal[j]
        return r

    def least_norm(self, right):
        """Return the least-norm solution of J x = right."""
        flights, rows, _ = self._shape
        solution = np.zeros(self._closing.shape[1])
        solution[:-1] = right
        newton.forward(flights, rows, self._window, self._closing, self.diagonal, solution[:-1])
        return self.times_q(solution)
