"""Second and third derivatives of the multipoint problem of forced orbits, and of free orbits in parameters, equations (38) to (43).

Each node carries its own copy of the released parameters. The equations of a flight and of the impact at its end depend on that of the node
where it begins, and the gap of a node on its own. This is how `ForcedProblem.jacobian` places its columns. All nodes have the parameters of
the first one, at which the problem is evaluated.
"""

from __future__ import annotations

import re
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bvp.expansion import expanded
from bvp.kernels.bent_orbit import Bending, BentOrbit, Work
from bvp.kernels.curvature import second_along as fill_second
from bvp.kernels.expressions import Program
from bvp.kernels.state_derivatives import third_of_states as fill_third
from bvp.nilpotent import derivative_tables
from bvp.programs import scratch_size

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem
    from bvp.smooth_expansion import SmoothExpansion

__all__ = ["Curvature"]

_SECOND, _THIRD = 1e-3, 5e-3
"""Largest steps of the differences of problems without exact derivatives, in units of the sizes of the unknowns."""

_ENOUGH = 1e-4
"""Relative error of a gradient with which Newton's method converges nearly as fast as with the exact one."""

_NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?"
"""A number as Python writes it, and as a user does."""


class Curvature:
    """The derivatives of one problem.

    Attributes
    ----------
    is_exact : bool
        Whether they are exact. Else they come from differences: where chatter is summed, with forces that are Python functions, and from
        the first orbit on that crosses a force without such derivatives, as that of |w|^2.5 by its exponent at w = 0.
    is_compiled : bool
        Whether second derivatives come from a kernel: without smooth forces.
    """

    def __init__(self, problem: ForcedProblem):
        self.problem = problem
        forces = problem.system.smooth_forces
        self.is_exact = not problem.contact_modes.sums_chatter and (forces is None or not forces.is_called)
        self.is_compiled = self.is_exact and forces is None
        self._smooth: dict[int, SmoothExpansion] = {}
        self._programs: dict[int, tuple[Program, Program]] = {}

    def second_along(self, y: np.ndarray, a: np.ndarray) -> np.ndarray:
        """F''(y)[a, .], (u - 1, u): the derivative of `problem.jacobian` along a (u,), real or complex."""
        if np.iscomplexobj(a):
            return self.second_along(y, a.real) + 1j * self.second_along(y, a.imag)
        if not self.is_exact:
            return differences_along(self.problem, y, a)
        if not self.is_compiled:
            return self._columns_along(np.array(y, dtype=float), np.array(a, dtype=float))
        found = np.empty((self.problem.unknowns - 1, self.problem.unknowns))
        fill_second(self.bending, np.array(y, dtype=float), np.array(a, dtype=float), found)
        return found

    def slopes_along(self, y: np.ndarray, a: np.ndarray) -> np.ndarray:
        """The same for Newton's method: with smooth forces from differences where these are known to `_ENOUGH`, which takes a fifth of the
        time."""
        if self.is_compiled:
            return self.second_along(y, a)
        found, error = estimated_differences(self.problem, y, a)
        return found if error <= _ENOUGH * np.abs(found).max() or not self.is_exact else self.second_along(y, a)

    def _columns_along(self, y: np.ndarray, a: np.ndarray) -> np.ndarray:
        """F''(y)[a, .], column by column. Nodes carry the parameters of the first one."""
        found = np.column_stack([expanded(self.problem, y, (a, column))[-1] for column in np.eye(len(y))])
        if np.isfinite(found).all():
            return found
        self.is_exact = False
        return differences_along(self.problem, y, a)

    def third(self, y: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """F'''(y)[a, b, c], (u - 1,)."""
        if not self.is_exact:
            return third_differences(self.problem, y, a, b, c)
        if self.is_compiled:
            return expanded(self.problem, y, (a, b, c))[-1]
        for k, direction in enumerate((a, b, c)):
            if np.iscomplexobj(direction):  # a flight with smooth forces has real directions
                one, other = ([*(a, b, c)[:k], part, *(a, b, c)[k + 1 :]] for part in (direction.real, direction.imag))
                return self.third(y, *one) + 1j * self.third(y, *other)
        found = expanded(self.problem, y, (a, b, c))[-1]
        if np.isfinite(found).all():
            return found
        self.is_exact = False
        return third_differences(self.problem, y, a, b, c)

    def smooth_expansion(self, order: int) -> SmoothExpansion:
        """The smooth forces for so many directions."""
        from bvp.smooth_expansion import SmoothExpansion

        if order not in self._smooth:
            self._smooth[order] = SmoothExpansion(self.problem, order)
        return self._smooth[order]

    def third_of_states(self, y: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """The same along states, phases and times: the parameters of the directions are zero."""
        problem = self.problem
        if not self.is_compiled or not self._keeps_numbers:
            return self.third(y, a, b, c)
        directions = np.array([a, b, c])
        out = np.empty(problem.unknowns - 1, dtype=directions.dtype)
        work = np.empty((4, self.bending.orbit.phase.shape[2]), dtype=directions.dtype)
        fill_third(self.bending, np.array(y, dtype=float), directions, work, out)
        return out

    @cached_property
    def _keeps_numbers(self) -> bool:
        """Whether each equation to keep is "NAME = number", if it can have the energy: that is quadratic in the states."""
        return not self.problem.conserved or all(re.fullmatch(rf"\s*\w+\s*=\s*{_NUMBER}\s*", text) for text in self.problem.keep)

    def tables(self, values: np.ndarray, order: int) -> list[np.ndarray]:
        """The entries that depend on the released parameters, and their derivatives up to an order: (D,), (D, m), (D, m, m), ..."""
        entries, _ = self._of_order(order)
        return derivative_tables(entries, values, len(self.problem.released), order)

    def kept_tables(self, values: np.ndarray, order: int) -> list[np.ndarray]:
        """The equations of the user and their derivatives, by all that they can name and that varies."""
        _, kept = self._of_order(order)
        problem = self.problem
        return derivative_tables(kept, values, len(problem.released) + len(values) - len(problem.parametric.names), order)

    @cached_property
    def bending(self) -> Bending:
        """The problem for the kernel."""
        problem, segment = self.problem, self.problem.segment
        released, modes, n = segment.released, problem.contact_modes, problem.degrees_of_freedom
        program, kept = self._of_order(2)
        count, harmonics = len(problem.released), segment.flight.loads.harmonics
        size = 2 * n + 2 * len(harmonics) - int(0.0 in harmonics)
        parts = 1 + count + count * (count + 1) // 2
        known = len(released.values) + len(problem.conserved)
        scratch = max(scratch_size(program, len(released.values)), scratch_size(kept, known))
        entries = np.zeros((parts, len(released.entries)))
        entries[0] = released.entries
        flights, square, whole = problem.inner + 1, (n, parts * n), (size, parts * size)
        bent = np.zeros((2 * n, problem.size + 1))
        work = Work(
            np.zeros(square), np.zeros(square), np.zeros((2, *square)), np.zeros(whole), np.zeros((n, parts * size)),
            np.zeros((n, parts * size)), np.zeros(whole), np.zeros(whole), np.zeros((5, *whole)), np.zeros(size), np.zeros((2, n, parts)),
            np.zeros((1, parts * n)), np.zeros((4, 1, parts)), np.zeros((1, parts * size)), np.zeros((4, max(size, count + 2))),
            bent, bent.copy(),
        )  # fmt: skip
        orbit = BentOrbit(
            np.full(problem.unknowns, np.nan), entries, np.zeros((flights, 4, size)), np.zeros((flights, 1 + count, 2 * n, size)),
            np.zeros((flights, 3, 2 * n, size)), np.zeros((flights, 2 * n)), np.zeros((flights, parts, 2 * n)),
            np.zeros((flights, 2 + count, 2 * n)), np.zeros((flights + 1, parts, n)), np.zeros((flights, 1 + count, size)),
            np.zeros((flights, parts)),
        )  # fmt: skip
        return Bending(
            segment.gap, segment.contact, segment.closing, segment.end_map, segment.shape,
            modes.arrays.mode, modes.arrays.release, modes.arrays.closed, modes.weights, modes.stops,
            harmonics, segment.flight.loads.load_periods, released.places, released.frequency,
            program, released.rows, released.values.copy(), released.columns, np.zeros(len(program.outputs)),
            kept, np.zeros(known), np.zeros(len(kept.outputs)), np.zeros(scratch), work, orbit,
        )  # fmt: skip

    def _of_order(self, order: int) -> tuple[Program, Program]:
        if order not in self._programs:
            problem = self.problem
            parametric, conserved = problem.parametric, problem.conserved
            entries = parametric.program(problem.released, order).program
            self._programs[order] = entries, parametric.equations(problem.keep, problem.released, conserved, order)
        return self._programs[order]


def differences_along(problem: ForcedProblem, y: np.ndarray, a: np.ndarray) -> np.ndarray:
    """F''(y)[a, .], (u - 1, u), from differences of the exact Jacobian with steps h, h/2 and h/4, extrapolated to h = 0.

    For a real. The relative error is about 1e-9 where the orbit changes slowly with its unknowns, not with steep springs."""
    return estimated_differences(problem, y, a)[0]


def estimated_differences(problem: ForcedProblem, y: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, float]:
    """The same, and the last change of the extrapolation; NaN where the Jacobian is."""
    sizes = problem.scales(y)
    length = float(np.max(np.abs(a) / sizes))
    if length == 0.0:
        return np.zeros((problem.unknowns - 1, problem.unknowns)), 0.0
    found = []
    for k in range(3):
        step = _SECOND * 0.5**k / length
        found.append((problem.jacobian(y + step * a) - problem.jacobian(y - step * a)) / (2.0 * step))
    limit = _extrapolated(found)
    return limit, float(np.abs(limit - _extrapolated(found[1:])).max())


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
