"""Second and third derivatives of the multipoint problem of forced orbits, and of free orbits in parameters, equations (38) to (43)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem

__all__ = ["Curvature"]

_SECOND, _THIRD = 1e-3, 5e-3
"""Largest steps of the differences of problems without exact derivatives, in units of the sizes of the unknowns."""


class Curvature:
    """The derivatives of one problem.

    Attributes
    ----------
    is_exact : bool
        Whether they are exact. Else they come from differences: with forces that are Python functions, and from the first orbit on that
        crosses a force without such derivatives, as that of |w|^2.5 by its exponent at w = 0.
    """

    def __init__(self, problem: ForcedProblem):
        self.problem = problem
        forces = problem.system.smooth_forces
        self.is_exact = forces is None or not forces.is_called

    def second_along(self, y: np.ndarray, a: np.ndarray) -> np.ndarray:
        """F''(y)[a, .], (u - 1, u): the derivative of `problem.jacobian` along a (u,), real or complex."""
        if np.iscomplexobj(a):
            return self.second_along(y, a.real) + 1j * self.second_along(y, a.imag)
        if self.is_exact:
            found: np.ndarray = self.problem.core.second_along(_numbers(y), _numbers(a))
            if np.isfinite(found).all() or not np.isfinite(self.problem.jacobian(y)).all():
                return found
            self.is_exact = False
        return differences_along(self.problem, y, a)

    def third(self, y: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """F'''(y)[a, b, c], (u - 1,), along real or complex directions."""
        if not self.is_exact:
            return third_differences(self.problem, y, a, b, c)
        directions = a, b, c
        for k, direction in enumerate(directions):
            if np.iscomplexobj(direction):
                one, other = ([*directions[:k], part, *directions[k + 1 :]] for part in (direction.real, direction.imag))
                return self.third(y, *one) + 1j * self.third(y, *other)
        found: np.ndarray = self.problem.core.derivative(_numbers(y), _numbers(directions))
        if np.isfinite(found).all() or not np.isfinite(self.problem.jacobian(y)).all():
            return found
        self.is_exact = False
        return third_differences(self.problem, y, a, b, c)


    # -- of an orbit that is open: the clock at its end is an unknown behind all others, and the last equation that of a closed one --------

    def opened(self, vector: np.ndarray, last: float) -> np.ndarray:
        """A vector (u,) with an entry for the clock at the end, where there is a clock."""
        return np.append(vector, last) if self.problem.has_clock else vector

    def open_jacobian(self, y: np.ndarray) -> np.ndarray:
        """F'(y) of the open orbit at a closed one y (u,): (u, u + 1); without a clock (u - 1, u)."""
        problem, plain = self.problem, self.problem.jacobian(y)
        if not problem.has_clock:
            return plain
        u = problem.unknowns
        found = np.zeros((u, u + 1))
        found[:-1, :-1] = plain
        found[:-1, -1] = self.by_end(y)
        found[:-1, 0] -= found[:-1, -1]
        found[-1, 0], found[-1, -1] = -1.0, 1.0
        return found

    def by_end(self, y: np.ndarray) -> np.ndarray:
        """The derivatives of the equations by the clock at the end alone, (u - 1,)."""
        last = np.zeros((1, len(y) + 1))
        last[0, -1] = 1.0
        found: np.ndarray = self.problem.core.open_derivative(self._open(y), last)
        return found

    def _open(self, y: np.ndarray) -> np.ndarray:
        return _numbers(self.opened(y, y[0] + self.problem.closing[1]))

    def open_second(self, y: np.ndarray, a: np.ndarray) -> np.ndarray:
        """F''(y)[a, .] of the open orbit along a (u + 1,), real or complex; its last row is zero."""
        if not self.problem.has_clock:
            return self.second_along(y, a)
        if np.iscomplexobj(a):
            return self.open_second(y, a.real) + 1j * self.open_second(y, a.imag)
        found = self.problem.core.second_along(self._open(y), _numbers(a))
        return np.vstack([found, np.zeros((1, found.shape[1]))])

    def open_third(self, y: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """F'''(y)[a, b, c] of the open orbit; its last entry is zero."""
        if not self.problem.has_clock:
            return self.third(y, a, b, c)
        directions = a, b, c
        for k, direction in enumerate(directions):
            if np.iscomplexobj(direction):
                one, other = ([*directions[:k], part, *directions[k + 1 :]] for part in (direction.real, direction.imag))
                return self.open_third(y, *one) + 1j * self.open_third(y, *other)
        return np.append(self.problem.core.open_derivative(self._open(y), _numbers(directions)), 0.0)


def _numbers(array: object) -> np.ndarray:
    """An array as compiled code takes it."""
    return np.ascontiguousarray(array, dtype=float)


def differences_along(problem: ForcedProblem, y: np.ndarray, a: np.ndarray) -> np.ndarray:
    """F''(y)[a, .], (u - 1, u), from differences of the exact Jacobian with steps h, h/2 and h/4, extrapolated to h = 0.

    For a real. The relative error is about 1e-9 where the orbit changes slowly with its unknowns, not with steep springs."""
    sizes = problem.scales(y)
    length = float(np.max(np.abs(a) / sizes))
    if length == 0.0:
        return np.zeros((problem.unknowns - 1, problem.unknowns))
    found = []
    for k in range(3):
        step = _SECOND * 0.5**k / length
        found.append((problem.jacobian(y + step * a) - problem.jacobian(y - step * a)) / (2.0 * step))
    return _extrapolated(found)


def third_differences(problem: ForcedProblem, y: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """F'''(y)[a, b, c], (u - 1,), in the same way; its relative error is about 1e-7."""
    if np.iscomplexobj(a):
        return third_differences(problem, y, a.real, b, c) + 1j * third_differences(problem, y, a.imag, b, c)
    if np.iscomplexobj(b):
        return third_differences(problem, y, a, b.real, c) + 1j * third_differences(problem, y, a, b.imag, c)
    sizes = problem.scales(y)
    lengths = [float(np.max(np.abs(vector) / sizes)) for vector in (a, b)]
    if 0.0 in lengths:
        return np.zeros(problem.unknowns - 1, dtype=np.asarray(c).dtype)
    found = []
    for k in range(3):
        first, other = (_THIRD * 0.5**k / length for length in lengths)
        total = np.zeros((problem.unknowns - 1, problem.unknowns))
        for sign in (1.0, -1.0):
            ahead, back = (problem.jacobian(y + sign * (first * a + turn * other * b)) for turn in (1.0, -1.0))
            total += ahead - back
        found.append(total @ c / (4.0 * first * other))
    return _extrapolated(found)


def _extrapolated(found: list[np.ndarray]) -> np.ndarray:
    """The limit of values with the steps h, h/2, h/4 and errors in even powers of h."""
    power = 4.0
    while len(found) > 1:
        found = [(power * finer - coarser) / (power - 1.0) for coarser, finer in zip(found, found[1:], strict=False)]
        power *= 4.0
    return found[0]
