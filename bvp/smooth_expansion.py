"""Flights with smooth forces in infinitesimals (`bvp.nilpotent`), and the energy of these forces.

The coefficients u[S] of a motion in infinitesimals obey one larger system of the same kind: linear forces mix those with S inside each
other, and a force f(w) of an input w = w[0] + e_1 w[1] + ... has the coefficients

    f[S] = sum over the partitions of S into sets B_1, ..., B_k of f^(k)(w[0]) w[B_1] ... w[B_k]

In the time tau = t'/t of the flight, u'' = t^2 M^-1 (g - K u - D' f) - t M^-1 C u', its end is at tau = 1, and t is a number in
infinitesimals. The states of the loads are oscillators beside it. So the Taylor steps of one flight (`bvp.kernels.taylor`) give the exact
derivatives along any directions.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product as every
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bvp.jet_programs import jet_program, plain_powers
from bvp.kernels.expressions import Program
from bvp.kernels.taylor import SmoothFlight, fly_smooth, make_smooth_flight
from bvp.nilpotent import composed, derivative_tables, inverse, partitions, parts, product
from bvp.programs import derivative, derivatives_of, evaluate_program, program_of
from bvp.released_forces import SINGLE

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem
    from bvp.smooth_forces import SmoothForces

__all__ = ["SmoothExpansion", "Terms"]


class Terms(NamedTuple):
    """What moves a flight, in infinitesimals, with q states of the loads."""

    inverse: np.ndarray  # (2^d, n, n) of the mass
    damping: np.ndarray  # (2^d, n, n)
    stiffness: np.ndarray  # (2^d, n, n)
    loads: np.ndarray  # (2^d, n, q) amplitudes
    turning: np.ndarray  # (2^d, q, q) rates of the states of the loads


class SmoothExpansion:
    """The smooth forces of a problem, of formulas, for d directions."""

    def __init__(self, problem: ForcedProblem, order: int):
        assert problem.smooth_forces is not None
        self.forces: SmoothForces = problem.smooth_forces
        self.order, self.count = order, 1 << order
        self.n = problem.degrees_of_freedom
        self._known: dict[bytes, np.ndarray] = {}

    # -- flights --------------------------------------------------------------------------------------------------------------

    def flight(self, start: np.ndarray, phases: np.ndarray, time: np.ndarray, parameters: np.ndarray, terms: Terms) -> np.ndarray:
        """The state at the end of a flight, (2^d, 2 n). start (2^d, 2 n); phases (2^d, q): the states of the loads there; time (2^d,);
        parameters (2^d, m): the released ones. NaN where the flight cannot be computed."""
        key = b"".join(array.tobytes() for array in (start, phases, time, parameters))
        if key not in self._known:
            if len(self._known) > _KEPT:
                self._known.clear()
            self._known[key] = self._flown(start, phases, time, parameters, terms)
        return self._known[key]

    def _flown(self, start: np.ndarray, phases: np.ndarray, time: np.ndarray, parameters: np.ndarray, terms: Terms) -> np.ndarray:
        n, count, size = self.n, self.count, self.n + phases.shape[1]
        flight, numbers = self._flight(size)
        square, late, turn = product(time, time), inverse(time[:, None, None])[:, 0, 0], _times(time, terms.turning)
        by_place, by_speed = np.zeros((count, size, size)), np.zeros((count, size, size))
        by_place[:, :n, :n] = -_times(square, product(terms.inverse, terms.stiffness, np.matmul))
        by_place[:, :n, n:] = _times(square, product(terms.inverse, terms.loads, np.matmul))
        by_place[:, n:, n:] = product(turn, turn, np.matmul)
        by_speed[:, :n, :n] = -_times(time, product(terms.inverse, terms.damping, np.matmul))
        begin = np.concatenate([start[:, :n], phases], axis=1)
        speed = np.concatenate([_times(time, start[:, n:]), product(turn, phases, np.matmul)], axis=1)
        push = -_times(square, terms.inverse @ self.forces.directions.T)
        whole = count * size
        flight.matrix[:whole, whole:] = np.eye(whole)
        flight.matrix[whole:, :whole], flight.matrix[whole:, whole:] = _nested(by_place), _nested(by_speed)
        of_force = np.zeros((count, size, push.shape[2]))
        of_force[:, :n] = push
        flight.push[:] = _nested(of_force)
        inputs = len(self.forces.symbols)
        rows = np.zeros((2, count, inputs, size))
        rows[0, 0, :, :n] = self.forces.inputs[:, :n]
        rows[1, :, :, :n] = late[:, None, None] * self.forces.inputs[:, n:]
        flight.rows[:] = np.hstack([_nested(part) for part in rows])
        flight.program.numbers[:] = evaluate_program(numbers, parameters.ravel().tolist())
        flight.paths.steps[:] = 0
        state = np.concatenate([begin.ravel(), speed.ravel()])
        if not (np.isfinite(state).all() and fly_smooth(flight, 0, state, 1.0, False)):
            return np.full((count, 2 * n), np.nan)
        places, speeds = flight.paths.ends[0].reshape(2, count, size)[:, :, :n]
        return np.concatenate([places, _times(late, speeds)], axis=1)

    def _flight(self, size: int) -> tuple[SmoothFlight, Program]:
        """The larger system with so many coordinates, without its numbers."""
        if self._made is None or self._made[0] != size:
            program, numbers = self._program
            whole, inputs, forces = (self.count * part for part in (size, len(self.forces.symbols), len(self.forces.forces)))
            flight: SmoothFlight = make_smooth_flight(
                np.zeros((2 * whole, 2 * whole)), np.zeros((inputs, 2 * whole)), np.zeros((whole, forces)), program, program_of([], []), 1,
                steps=SINGLE,
            )  # fmt: skip
            self._made = size, flight, numbers
        return self._made[1], self._made[2]

    _made: tuple[int, SmoothFlight, Program] | None = None

    @cached_property
    def _program(self) -> tuple[Any, Program]:
        """The forces in infinitesimals, of the inputs and the parameters in infinitesimals."""
        import sympy

        forces, count = self.forces, self.count
        variables = [*forces.symbols, *forces.parameters]
        moved = [[sympy.Symbol(f"_{k}_{part}", real=True) for k in range(len(variables))] for part in range(count)]
        at = dict(zip(variables, moved[0], strict=True))
        found = []
        for whole in range(count):
            for force in forces.forces:
                total = sympy.Integer(0)
                for blocks in partitions(whole):
                    for chosen in every(range(len(variables)), repeat=len(blocks)):
                        term = force
                        for k in chosen:
                            term = derivative(term, variables[k])
                        factors = [moved[block][k] for block, k in zip(blocks, chosen, strict=True)]
                        total += sympy.Mul(term.xreplace(at), *factors)
                found.append(total)
        inputs = len(forces.symbols)
        names = [symbol for part in moved for symbol in part[inputs:]]
        return jet_program(found, [symbol for part in moved for symbol in part[:inputs]], names, [1.0 for _ in names], changes=False)

    # -- energy ---------------------------------------------------------------------------------------------------------------

    def energy(self, place: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """The energy of the forces at displacements, (2^d,)."""
        at = np.concatenate([place @ self.forces.inputs[:, : self.n].T, parameters], axis=1)
        return composed(derivative_tables(self._energy_program, at[0].real.copy(), at.shape[1], self.order), at)[:, 0]

    @cached_property
    def _energy_program(self) -> Program:
        variables = [*self.forces.symbols, *self.forces.parameters]
        found = derivatives_of([self.forces.potential], variables, self.order)
        return program_of([plain_powers(one) for one in found], variables)


_KEPT = 64
"""Flights that are kept: those of the nodes along whose unknowns nothing changes."""


def _times(number: np.ndarray, arrays: np.ndarray) -> np.ndarray:
    """A number times an array, (2^d, ...)."""
    return product(number.reshape((len(number),) + (1,) * (arrays.ndim - 1)), arrays)


def _nested(matrices: np.ndarray) -> np.ndarray:
    """The matrix that multiplies the coefficients of a vector by a matrix (2^d, a, b) in infinitesimals, (2^d a, 2^d b)."""
    count, rows, columns = matrices.shape
    found = np.zeros((count, rows, count, columns))
    for whole in range(count):
        for part in parts(whole):
            found[whole, :, part] = matrices[whole ^ part]
    return found.reshape(count * rows, count * columns)
