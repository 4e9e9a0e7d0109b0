"""Periodic orbits in fifty digits from the multipoint equations. They decide what double precision cannot, and serve as references.

The modes are computed anew from the system's matrices. The equations are (30), with the full start state
as an unknown and the start's end as equations of their own. They are evaluated in fixed point and corrected with the pseudo-inverse of
their Jacobian in double precision: near the orbit each round gains about as many digits as double precision has. The residual that is
left bounds the error of the orbit.

A number in fixed point is an integer, in units of 2^-BITS. Arrays of them cost a fraction of arrays of mpf.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import mpmath as mp
import numpy as np
from mpmath.libmp import from_man_exp, mpf_cos_sin, mpf_cosh_sinh, to_fixed

from bvp.closures import ORIGIN, PERIODIC, REST, STOP
from bvp.dense import orthonormal, product, solve
from bvp.multipoint import MultipointProblem
from bvp.stability import DECISION, balance, verdict
from bvp.system import ImpactSystem

__all__ = ["BITS", "DIGITS", "DigitModes", "DigitOrbit", "digit_modes", "orbit_in_digits"]

DIGITS = 50
"""Decimal digits of the arithmetic."""

BITS = 200
"""Binary digits after the point in fixed point, which are 60 decimal ones."""

_ONE = 1 << BITS

_ROUNDS = 60
_NEAR = _ONE // 10**8
"""Residual in fixed point below which the Jacobian no longer changes in double precision, so it is kept for further corrections."""

_GOOD = _ONE // 10 ** (DIGITS - 10)
"""Largest residual of an orbit, relative to its state, in fixed point."""

_ENOUGH = _ONE // 10 ** (DIGITS - 8)
"""An orbit with such a residual is corrected once more, and then as good as rounding allows."""

_ENTRY = mp.mpf(10) ** (15 - DIGITS)
"""Error of an entry of the half map, relative to the largest: of a solution to `_GOOD` with a pivot of 1e-5 at least."""


class DigitModes:
    """Modes of an undamped system in many digits. A modal state is an array (2 n,), displacements before velocities; an array (m, 2 n)
    holds m of them. Those of flights and impacts are in fixed point.

    Parameters
    ----------
    system : ImpactSystem
        Conservative; its numbers are taken as the binary fractions that they are.

    Attributes
    ----------
    squares : (n,) ndarray of mpf
        Of the frequencies, ascending; exactly 0 for a rigid-body mode, negative where the stiffness is.
    rates : list of mpf
        Roots of their sizes.
    shapes : (n, n) ndarray of mpf
        Mass-normalised, one a column.
    gaps : (S, n) ndarray of mpf
        c . phi_k for each stop.
    in_fixed, in_double : _Motion
        Flights and impacts, in fixed point and in double precision.
    """

    def __init__(self, system: ImpactSystem) -> None:
        reason = system.why_not_conservative()
        if reason is not None:
            raise ValueError(f"periodic orbits in many digits need a conservative system: {reason}")
        with mp.workdps(DIGITS):
            mass = mp.matrix(system.mass.tolist())
            inverse = mp.cholesky(mass) ** -1
            squares, vectors = mp.eigsy(inverse * mp.matrix(system.stiffness.tolist()) * inverse.T)
            self.size = len(squares)
            # Of a rigid-body mode the rounded matrices leave a trace of stiffness, which counts for nothing in double precision either.
            self.squares = np.where(system.modes.squares == 0.0, mp.mpf(0), np.array(list(squares)))
            self.rates = [mp.sqrt(abs(square)) for square in self.squares]
            self.shapes = _array(inverse.T * vectors)
            self.gaps = _exact([stop.gap for stop in system.stops]) @ self.shapes
            self.weights = self.shapes.T @ _array(mass)
            squares, gaps, kicks = self.squares, self.gaps, np.array([2 * b / (b @ b) for b in self.gaps])
            self.in_fixed = _Motion(_fixed(squares), _fixed(gaps), _fixed(kicks), BITS)
            self.in_double = _Motion(squares.astype(float), gaps.astype(float), kicks.astype(float))

    def states(self, physical: np.ndarray) -> np.ndarray:
        """Modal states (m, 2 n) in fixed point of displacements and velocities (m, 2 n) in double precision."""
        weights = _fixed(self.weights.T)
        return np.concatenate([_whole(part) @ weights >> BITS for part in _halves(physical)], axis=1)

    def velocities(self, z: np.ndarray) -> list[Any]:
        """Velocities u' (n,) of a modal state."""
        return list(self.shapes @ z[self.size :])

    def energy(self, z: np.ndarray) -> Any:
        """h."""
        places, speeds = _halves(z)
        return (speeds @ speeds + self.squares @ places**2) / 2

    def flights(self, times: Sequence[int] | np.ndarray) -> np.ndarray:
        """cos(w t), sin(w t)/w and w sin(w t) of each mode, for `_Motion.flow`: (3, m, n) for times (m,), all in fixed point."""
        out = np.empty((3, len(times), self.size), dtype=object)
        for k, (rate, square) in enumerate(zip(self.rates, self.squares, strict=True)):
            functions = mpf_cos_sin if square >= 0 else mpf_cosh_sinh
            w, squared = to_fixed(rate._mpf_, BITS), self.in_fixed.squares[k]
            for i, time in enumerate(times):
                c, s = (to_fixed(x, BITS) for x in functions(from_man_exp(w * time, -2 * BITS), BITS))
                over = (s << BITS) // w if w else time
                out[:, i, k] = c, over, squared * over >> BITS
        return out


class _Motion(NamedTuple):
    """Flights and impacts of modal states, whose products are shifted by `bits`: in fixed point, and 0 in double precision."""

    squares: np.ndarray
    gaps: np.ndarray
    kicks: np.ndarray  # change of the velocities at an impact of rate -1
    bits: int = 0

    def scaled(self, products: Any) -> Any:
        """Products as numbers."""
        return products >> self.bits if self.bits else products

    def flow(self, z: np.ndarray, flight: np.ndarray) -> np.ndarray:
        """States after a free flight."""
        c, over, times = flight
        places, speeds = _halves(z)
        return self.scaled(np.concatenate([c * places + over * speeds, c * speeds - times * places], axis=-1))

    def rate(self, z: np.ndarray) -> np.ndarray:
        """Velocities and accelerations of the modes."""
        places, speeds = _halves(z)
        return np.concatenate([speeds, -self.scaled(self.squares * places)], axis=-1)

    def gap(self, stop: Any, z: np.ndarray) -> Any:
        """The gap coordinate."""
        return self.scaled((z[..., : len(self.squares)] * self.gaps[stop]).sum(axis=-1))

    def speed(self, stop: Any, z: np.ndarray) -> Any:
        """The rate of the gap coordinate."""
        return self.scaled((z[..., len(self.squares) :] * self.gaps[stop]).sum(axis=-1))

    def impact(self, stop: Any, z: np.ndarray) -> np.ndarray:
        """States after an elastic impact."""
        kick = self.scaled(np.asarray(self.speed(stop, z))[..., None] * self.kicks[stop])
        places, speeds = _halves(z)
        return np.concatenate([places, speeds - kick], axis=-1)


def _halves(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and velocities of states."""
    half = z.shape[-1] // 2
    return z[..., :half], z[..., half:]


def _fixed(values: Any) -> np.ndarray:
    """Numbers of type mpf in fixed point."""
    return np.frompyfunc(lambda x: to_fixed(x._mpf_, BITS), 1, 1)(np.asarray(values))


def _whole(values: Any) -> np.ndarray:
    """Doubles in fixed point, as the binary fractions that they are."""

    def fixed(x: float) -> int:
        numerator, denominator = float(x).as_integer_ratio()
        return (numerator << BITS) // denominator

    return np.frompyfunc(fixed, 1, 1)(np.asarray(values))


def _real(numbers: Any) -> Any:
    """Numbers in fixed point as mpf."""
    return np.frompyfunc(lambda x: mp.mpf((x, -BITS)), 1, 1)(numbers)


def _double(numbers: np.ndarray) -> np.ndarray:
    """Numbers in fixed point in double precision."""
    return (numbers / _ONE).astype(float)


def _exact(values: Any) -> np.ndarray:
    """Doubles as the binary fractions that they are."""
    return np.frompyfunc(lambda x: mp.mpf(float(x)), 1, 1)(np.asarray(values))


def _array(matrix: Any) -> np.ndarray:
    return np.array(matrix.tolist(), dtype=object).reshape(matrix.rows, matrix.cols)


@lru_cache(maxsize=4)
def digit_modes(system: ImpactSystem) -> DigitModes:
    """The modes of a system, computed once."""
    return DigitModes(system)


@dataclass(frozen=True, eq=False)
class DigitOrbit:
    """A solved segment in many digits.

    Attributes
    ----------
    problem : MultipointProblem
    x : (k + 1, 2 n + 1) ndarray of int
        The modal state at the start of each flight and the flight's time, in fixed point.
    residual : mpf
        What was left of the equations before the last correction.
    moved : float
        How far the start is from the given one: its state relative to sqrt(2 h), its quarter period relative to itself.
    """

    problem: MultipointProblem
    x: np.ndarray
    residual: Any
    moved: float

    @property
    def modes(self) -> DigitModes:
        """Those of the system."""
        return digit_modes(self.problem.system)

    @cached_property
    def states(self) -> np.ndarray:
        """Modal states at the start of each flight, (k + 1, 2 n) of mpf."""
        return _real(self.x[:, :-1])

    @cached_property
    def times(self) -> np.ndarray:
        """Flight times, (k + 1,) of mpf."""
        return _real(self.x[:, -1])

    @property
    def energy(self) -> Any:
        """h."""
        return self.modes.energy(_real(self.x[0, :-1]))

    @cached_property
    def half_map(self) -> Any:
        """phi (2 m, 2 m) between the ends, equation (13). A periodic closure has none: ValueError."""
        if self.problem.periodic:
            raise ValueError("a periodic closure has no half map; its trace decides its stability")
        with mp.workdps(DIGITS):
            problem, modes = self.problem, self.modes
            n, stops = modes.size, problem.modes.contact_stop
            (start, end), (closing, opening) = problem.kinds, problem.contacts[-2:]
            z, motion = self.x[0, :-1], modes.in_fixed
            zero = _exact(np.zeros((problem.pairs, n)))
            held = self._held()

            def basis(kind: int, contact: int, at: np.ndarray) -> np.ndarray:
                x = modes.gaps[stops[contact]] if kind == STOP else _real(at[n:] if kind == ORIGIN else -motion.rate(at)[n:])
                return _across(held @ x) @ held

            first = basis(start, opening, z)
            kept, turned = (np.hstack([first, zero]), np.hstack([zero, first]))
            if start == ORIGIN:
                kept, turned = turned, -kept
            if start == STOP:
                stop = int(stops[opening])
                slopes = first @ _real(motion.rate(z)[n:]) / _real(motion.speed(stop, z))
                kept[:, n:] = np.multiply.outer(slopes, modes.gaps[stop])
            carried, final = self._carried(_fixed(np.vstack([kept, turned])))
            carried = _real(carried)
            last = basis(end, closing, final)
            displacements, velocities = carried[:, :n] @ last.T, carried[:, n:] @ last.T
            phi = np.hstack([velocities, -displacements] if end == ORIGIN else [displacements, velocities])
            return mp.matrix(phi.T.tolist())

    def _held(self) -> np.ndarray:
        """`held` of the problem for the modes in many digits."""
        problem, modes = self.problem, self.modes
        rigid = [k for k, square in enumerate(modes.squares) if square == 0] if problem.pairs < problem.half - 1 else []
        unit = _exact(np.eye(modes.size))
        rows = [unit[k] for k in range(modes.size) if k not in rigid]
        left = [np.where(np.isin(np.arange(modes.size), rigid), modes.gaps[stop], mp.mpf(0)) for stop in sorted(problem.hit)]
        # The rigid-body motions that stops feel: Gram and Schmidt's process on their gaps, the longest first.
        while len(rows) <= problem.pairs:
            longest = max(left, key=lambda row: row @ row)
            rows.append(longest / mp.sqrt(longest @ longest))
            left = [row - (row @ rows[-1]) * rows[-1] for row in left]
        return np.array(rows)

    @cached_property
    def trace(self) -> Any:
        """tau of the full period, for two degrees of freedom."""
        with mp.workdps(DIGITS):
            if self.problem.periodic:
                return _real(np.trace(self._carried(_whole(np.eye(self.problem.size)))[0])) - 2
            half = 2 + 4 * self.half_map[0, 1] * self.half_map[1, 0]
            return half * half - 2 if self.problem.quarters == 1 else half

    @cached_property
    def stable(self) -> bool | None:
        """Whether the orbit is linearly stable. None at a limit of stability, and for an orbit without reversal in more than two modes."""
        problem, m = self.problem, self.problem.pairs
        if not m:
            return True
        if problem.periodic and m > 1:
            return None
        with mp.workdps(DIGITS):
            if problem.periodic:
                error = _ENTRY * (1 + abs(self.trace))
                numbers = [(self.trace - 2) / 4], [error / 4], [(self.trace + 2) / 4], [error / 4]
            else:
                phi = self.half_map
                displacement = _real(np.abs(self.x[:, : problem.half]).max())
                factors = balance(problem, mp.sqrt(2 * self.energy) / displacement if displacement else mp.mpf(1))
                places = (0, 0), (0, m), (m, 0), (m, m)
                a, b, c, d = (f * phi[i : i + m, j : j + m] for f, (i, j) in zip(factors, places, strict=True))
                size = max(abs(x) for block in (a, b, c, d) for x in block)
                numbers = (*_eigenvalues(b, c, size), *_eigenvalues(d, a, size))
        # Each of the four is far from 0 beside its own rounding to a double.
        nu, error, rest, rest_error = (np.array(row, dtype=complex) for row in numbers)
        return DECISION[int(verdict(nu, error.real, rest, rest_error.real))]

    def _carried(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Perturbations (m, 2 n) at the start, carried to the far end: through saltation matrices; at a stop there onto the stop along the
        flow. Then the state at the far end, before an impact there. All in fixed point."""
        problem, motion = self.problem, self.modes.in_fixed
        flights = self.modes.flights(self.x[:, -1])
        for i, before in enumerate(motion.flow(self.x[:, :-1], flights)):
            columns = motion.flow(columns, flights[:, i])
            contact = problem.contacts[i]
            if contact < 0:
                continue
            stop = int(problem.modes.contact_stop[contact])
            late = (motion.gap(stop, columns) << BITS) // motion.speed(stop, before)
            shift = -motion.rate(before)
            if i < problem.inner or problem.periodic:
                shift = motion.rate(motion.impact(stop, before)) + motion.impact(stop, shift)
                columns = motion.impact(stop, columns)
            columns = columns + motion.scaled(np.multiply.outer(late, shift))
        return columns, before


def orbit_in_digits(problem: MultipointProblem, y: np.ndarray, quarter_period: float | None = None) -> DigitOrbit:
    """The orbit next to a solution y (u,) in double precision.

    With a quarter period, taken as the binary fraction that it is, it is the orbit there; else the nearest one of the family.

    Raises
    ------
    ArithmeticError
        Where the corrections do not settle.
    """
    with mp.workdps(DIGITS):
        return _Equations(problem, y, quarter_period).solve()


class _Equations:
    """The equations of a segment, in fixed point; row i of x holds z_i and t_i, the states modal."""

    def __init__(self, problem: MultipointProblem, y: np.ndarray, quarter_period: float | None) -> None:
        self.problem = problem
        self.modes = modes = digit_modes(problem.system)
        self.n = n = modes.size
        self.quarter_period = None if quarter_period is None else int(_whole(quarter_period))
        double = problem.modes
        self.stops = np.array([int(double.contact_stop[contact]) if contact >= 0 else -1 for contact in problem.contacts])
        self.bounds = _whole([float(double.contacts.bound[contact]) if contact >= 0 else 0.0 for contact in problem.contacts])
        starts = np.vstack([problem.start(y), problem.nodes(y)])
        self.x = np.column_stack([modes.states(starts @ double.to_state.T), _whole(problem.flight_times(y))])
        self.speed = math.sqrt(2.0 * problem.energy(y)) or 1.0
        self.sizes = np.tile([1.0] * n + [self.speed] * n + [1.0], problem.inner + 1)
        self.first = self._conditions(problem.kinds[0], problem.inner + 1)
        self.last = self._conditions(problem.kinds[1], problem.inner)
        # Energy is conserved, so one of the closure equations follows from the others: leave out the one that changes the energy most.
        z = _double(self.x[0, :-1])
        slopes = np.abs(np.concatenate([modes.in_double.rate(z)[n:], z[n:] * self.speed]))
        self.kept = np.delete(np.arange(2 * n), np.argmax(slopes))
        self.flights = np.empty((3, 0, n))

    def _conditions(self, kind: int, node: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows L and values l of the conditions L z = l at an end."""
        n, unit = self.n, _whole(np.eye(2 * self.n))
        if kind in (ORIGIN, REST):
            return unit[:n] if kind == ORIGIN else unit[n:], _whole(np.zeros(n))
        if kind == PERIODIC and node <= self.problem.inner:
            return unit[:0], unit[0, :0]
        b = self.modes.in_fixed.gaps[self.stops[node]]
        rows, values = [b @ unit[:n] >> BITS], [self.bounds[node]]
        if kind == STOP:
            pivot = int(np.argmax(np.abs(b)))
            rows += [b[pivot] * unit[n + k] - b[k] * unit[n + pivot] >> BITS for k in range(n) if k != pivot]
        return np.array(rows), np.array(values + [0] * (len(rows) - 1), dtype=object)

    def residual(self) -> np.ndarray:
        """The start's end holds, each flight ends on the next node, each node is on its stop, the far end holds."""
        motion, inner = self.modes.in_fixed, self.problem.inner
        states, times, stops = self.x[:, :-1], self.x[:, -1], self.stops[: self.problem.inner]
        self.flights = self.modes.flights(times)
        ends = motion.flow(states, self.flights)
        landed = motion.impact(stops, ends[:inner]) - states[1:]
        above = motion.gap(stops, states[1:]) - self.bounds[:inner]
        out = [(self.first[0] @ states[0] >> BITS) - self.first[1], np.column_stack([landed, above]).ravel()]
        if self.problem.periodic:
            out.append((motion.impact(self.stops[inner], ends[inner]) - states[0])[self.kept])
        out.append((self.last[0] @ ends[inner] >> BITS) - self.last[1])
        if self.quarter_period is not None:
            out.append(np.array([times.sum() - self.problem.quarters * self.quarter_period]))
        return np.concatenate(out)

    def jacobian(self) -> np.ndarray:
        """Derivative of the residual in double precision."""
        motion, inner, size = self.modes.in_double, self.problem.inner, 2 * self.n
        unit, count = np.eye(size), len(self.x)
        out: list[np.ndarray] = []

        def rows(height: int, *blocks: tuple[int, Any]) -> None:
            out.append(np.zeros((height, count, size + 1)))
            for node, values in blocks:
                part = np.atleast_2d(np.asarray(values, dtype=float))
                out[-1][:, node, : part.shape[1]] += part

        flights = _double(self.flights)
        arrivals = motion.rate(motion.flow(_double(self.x[:, :-1]), flights))
        rows(len(self.first[0]), (0, _double(self.first[0])))
        for i, stop in enumerate(self.stops[: inner + 1]):
            landing = np.vstack([motion.flow(unit, flights[:, i]), arrivals[i]])
            if i < inner:
                rows(size, (i, motion.impact(stop, landing).T), (i + 1, -unit))
                rows(1, (i + 1, motion.gaps[stop]))
            elif self.problem.periodic:
                rows(size - 1, (i, motion.impact(stop, landing).T[self.kept]), (0, -unit[self.kept]))
        rows(len(self.last[0]), (inner, product(_double(self.last[0]), landing.T)))
        if self.quarter_period is not None:
            rows(1)
            out[-1][:, :, -1] = 1.0
        return np.concatenate(out).reshape(-1, count * (size + 1))

    def solve(self) -> DigitOrbit:
        """Correct until nothing is gained any more."""
        given = kept = self.x
        # In small units a residual is to be small beside the displacements and velocities.
        displacement = float(np.abs(given[:, : self.n]).max() / _ONE)
        least = min(1.0, displacement or 1.0, self.speed)
        inverse = np.empty((0, 0))
        worst: float = math.inf
        for _ in range(_ROUNDS):
            residual = self.residual()
            size = int(np.abs(residual).max())
            if not size < worst:
                break
            worst, kept = size, self.x
            if size > _NEAR * self.speed or not inverse.size:
                # The least correction, in units of the sizes: J' = Q R, J^+ = Q R'^-1.
                matrix = (self.jacobian() * self.sizes).T
                q = orthonormal(matrix)[:, : matrix.shape[1]]
                try:
                    inverse = self.sizes[:, None] * solve(product(q.T, matrix), q.T).T
                except np.linalg.LinAlgError:
                    break
            update = product(inverse, (residual / max(size, 1)).astype(float))
            if not np.isfinite(update).all():
                break
            self.x = self.x - (_whole(update.reshape(self.x.shape)) * size >> BITS)
            if size <= _ENOUGH * least:
                kept = self.x
                break
        if not worst < _GOOD * max(1.0, self.speed):
            raise ArithmeticError(f"the orbit did not settle in {DIGITS} digits (residual {mp.nstr(_real(int(worst)), 3)})")
        period, before = kept[:, -1].sum(), given[:, -1].sum()
        apart = np.abs(kept[0, :-1] - given[0, :-1]).max() / _ONE / self.speed
        return DigitOrbit(self.problem, kept, _real(int(worst)), max(apart, abs(period - before) / period))


def _eigenvalues(p: Any, q: Any, size: Any) -> tuple[list[Any], list[Any]]:
    """Eigenvalues of p' q, and a bound of their errors where the largest entry of the half map is `size`."""
    matrix, m = p.T * q, p.rows
    error = m * _ENTRY * size * (mp.mnorm(p) + mp.mnorm(q))
    if m == 1:
        return [matrix[0]], [error]
    return list(mp.eig(matrix, left=False, right=False)), [mp.sqrt(error * (error + mp.mnorm(matrix)))] * m


def _across(x: np.ndarray) -> np.ndarray:
    """Orthonormal vectors perpendicular to x (n,), one a row; of two entries oriented with it."""
    if len(x) == 2:
        return np.array([[-x[1], x[0]]]) / mp.sqrt(x @ x)
    found = [x / mp.sqrt(x @ x)]
    # The unit vector that is most along x gives nothing new.
    for k in np.argsort(np.abs(x.astype(float)))[:-1]:
        vector = _exact(np.eye(len(x))[k])
        for _ in range(2):
            for other in found:
                vector = vector - (other @ vector) * other
        found.append(vector / mp.sqrt(vector @ vector))
    return np.array(found[1:]).reshape(-1, len(x))
