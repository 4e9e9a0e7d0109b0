"""Periodic orbits in fifty digits from the multipoint equations. They decide what double precision cannot, and serve as references.

The modes are computed anew from the system's matrices. The equations are those of `bvp.kernels.multipoint`, with the full start state
as an unknown and the start's end as equations of their own. They are evaluated in fifty digits and corrected with the pseudo-inverse of
their Jacobian in double precision: near the orbit each round gains about as many digits as double precision has. The residual that is
left bounds the error of the orbit.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import mpmath as mp
import numpy as np

from bvp.kernels.multipoint import ORIGIN, PERIODIC, REST, STOP
from bvp.multipoint import MultipointProblem
from bvp.stability import DECISION, balance, verdict

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["DIGITS", "DigitModes", "DigitOrbit", "digit_modes", "orbit_in_digits"]

DIGITS = 50
"""Decimal digits of the arithmetic."""

_ROUNDS = 60
_NEAR = mp.mpf(10) ** -8
"""Residual below which the Jacobian no longer changes in double precision, so it is kept for further corrections."""

_GOOD = mp.mpf(10) ** (10 - DIGITS)
"""Largest residual of an orbit, relative to its state."""

_ENTRY = mp.mpf(10) ** (15 - DIGITS)
"""Error of an entry of the half map, relative to the largest: of a solution to `_GOOD` with a pivot of 1e-5 at least."""


class DigitModes:
    """Modes of an undamped system in many digits. A modal state is an array (2 n,) of mpf, displacements before velocities; an array
    (m, 2 n) holds m of them.

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
    kicks : (S, n) ndarray of mpf
        Change of the velocities at an impact of rate -1.
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
            self.kicks = np.array([2 * b / (b @ b) for b in self.gaps])
            self.weights = self.shapes.T @ _array(mass)

    @cached_property
    def in_double(self) -> DigitModes:
        """The same modes in double precision, for derivatives. Its flights start from those in many digits."""
        double = copy(self)
        double.squares, double.gaps, double.kicks = (part.astype(float) for part in (self.squares, self.gaps, self.kicks))
        return double

    def state(self, physical: np.ndarray) -> np.ndarray:
        """Modal state with displacements and velocities (2 n,)."""
        return np.concatenate([self.weights @ _exact(part) for part in np.split(physical, 2)])

    def velocities(self, z: np.ndarray) -> list[Any]:
        """Velocities u' (n,) of a modal state."""
        return list(self.shapes @ z[self.size :])

    def energy(self, z: np.ndarray) -> Any:
        """h."""
        places, speeds = np.split(z, 2)
        return (speeds @ speeds + self.squares @ places**2) / 2

    def flight(self, time: Any) -> np.ndarray:
        """cos(w t), sin(w t)/w and w sin(w t) of each mode, for `flow`: (3, n)."""
        out = []
        for w, square in zip(self.rates, self.squares, strict=True):
            c, s = mp.cos_sin(w * time) if square >= 0 else (mp.cosh(w * time), mp.sinh(w * time))
            over = s / w if w else time
            out.append((c, over, square * over))
        return np.array(out).T

    def flow(self, z: np.ndarray, flight: np.ndarray) -> np.ndarray:
        """States after a free flight."""
        c, over, times = flight
        places, speeds = z[..., : self.size], z[..., self.size :]
        return np.concatenate([c * places + over * speeds, c * speeds - times * places], axis=-1)

    def rate(self, z: np.ndarray) -> np.ndarray:
        """Velocities and accelerations of the modes."""
        return np.concatenate([z[..., self.size :], -self.squares * z[..., : self.size]], axis=-1)

    def gap(self, stop: int, z: np.ndarray) -> Any:
        """The gap coordinate."""
        return z[..., : self.size] @ self.gaps[stop]

    def speed(self, stop: int, z: np.ndarray) -> Any:
        """The rate of the gap coordinate."""
        return z[..., self.size :] @ self.gaps[stop]

    def impact(self, stop: int, z: np.ndarray) -> np.ndarray:
        """States after an elastic impact."""
        kick = np.multiply.outer(self.speed(stop, z), self.kicks[stop])
        return np.concatenate([z[..., : self.size], z[..., self.size :] - kick], axis=-1)


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
    states : (k + 1, 2 n) ndarray of mpf
        Modal states at the start of each flight.
    times : (k + 1,) ndarray of mpf
        Flight times.
    residual : mpf
        What is left of the equations.
    moved : float
        How far the start is from the given one: its state relative to sqrt(2 h), its quarter period relative to itself.
    """

    problem: MultipointProblem
    states: np.ndarray
    times: np.ndarray
    residual: Any
    moved: float

    @property
    def modes(self) -> DigitModes:
        """Those of the system."""
        return digit_modes(self.problem.system)

    @property
    def energy(self) -> Any:
        """h."""
        return self.modes.energy(self.states[0])

    @cached_property
    def half_map(self) -> Any:
        """phi (2 m, 2 m) between the ends: see `bvp.kernels.stability`. A periodic closure has none: ValueError."""
        if self.problem.periodic:
            raise ValueError("a periodic closure has no half map; its trace decides its stability")
        with mp.workdps(DIGITS):
            problem, modes = self.problem, self.modes
            n, stops = modes.size, problem.modes.contact_stop
            (start, end), (closing, opening) = problem.kinds, problem.contacts[-2:]
            z = self.states[0]
            zero = _exact(np.zeros((problem.pairs, n)))
            held = self._held()

            def basis(kind: int, contact: int, at: np.ndarray) -> np.ndarray:
                x = at[n:] if kind == ORIGIN else -modes.rate(at)[n:] if kind == REST else modes.gaps[stops[contact]]
                return _across(held @ x) @ held

            first = basis(start, opening, z)
            kept, turned = (np.hstack([first, zero]), np.hstack([zero, first]))
            if start == ORIGIN:
                kept, turned = turned, -kept
            if start == STOP:
                stop = int(stops[opening])
                slopes = first @ modes.rate(z)[n:] / modes.speed(stop, z)
                kept[:, n:] = np.multiply.outer(slopes, modes.gaps[stop])
            carried, final = self._carried(np.vstack([kept, turned]))
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
        left = [np.where(np.isin(np.arange(modes.size), rigid), gap, mp.mpf(0)) for gap in modes.gaps]
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
                return np.trace(self._carried(_exact(np.eye(self.problem.size)))[0]) - 2
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
                displacement = np.abs(self.states[:, : problem.half]).max()
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
        flow. Then the state at the far end, before an impact there."""
        problem, modes = self.problem, self.modes
        for i, (z, time) in enumerate(zip(self.states, self.times, strict=True)):
            flight = modes.flight(time)
            columns, before = modes.flow(columns, flight), modes.flow(z, flight)
            contact = problem.contacts[i]
            if contact < 0:
                continue
            stop = int(problem.modes.contact_stop[contact])
            late = modes.gap(stop, columns) / modes.speed(stop, before)
            shift = -modes.rate(before)
            if i < problem.inner or problem.periodic:
                shift = modes.rate(modes.impact(stop, before)) + modes.impact(stop, shift)
                columns = modes.impact(stop, columns)
            columns = columns + np.multiply.outer(late, shift)
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
    """The equations of a segment; row i of x holds z_i and t_i, the states modal."""

    def __init__(self, problem: MultipointProblem, y: np.ndarray, quarter_period: float | None) -> None:
        self.problem = problem
        self.modes = modes = digit_modes(problem.system)
        self.n = n = modes.size
        self.quarter_period = None if quarter_period is None else mp.mpf(float(quarter_period))
        double = problem.modes
        self.stops = [int(double.contact_stop[contact]) if contact >= 0 else -1 for contact in problem.contacts]
        self.bounds = [mp.mpf(float(double.contacts.bound[contact])) if contact >= 0 else None for contact in problem.contacts]
        starts = np.vstack([problem.start(y), problem.nodes(y)]) @ double.to_state.T
        times = _exact(problem.flight_times(y))
        self.x = np.array([[*modes.state(state), time] for state, time in zip(starts, times, strict=True)])
        z = self.x[0, :-1]
        self.speed = mp.sqrt(2 * modes.energy(z)) or mp.mpf(1)
        self.sizes = np.tile([1.0] * n + [float(self.speed)] * n + [1.0], problem.inner + 1)
        self.first = self._conditions(problem.kinds[0], problem.inner + 1)
        self.last = self._conditions(problem.kinds[1], problem.inner)
        # Energy is conserved, so one of the closure equations follows from the others: leave out the one that changes the energy most.
        slopes = np.abs(np.concatenate([modes.rate(z)[n:], z[n:] * self.speed]))
        self.kept = np.delete(np.arange(2 * n), np.argmax(slopes))

    def _conditions(self, kind: int, node: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows L and values l of the conditions L z = l at an end."""
        n, unit = self.n, _exact(np.eye(2 * self.n))
        if kind in (ORIGIN, REST):
            return unit[:n] if kind == ORIGIN else unit[n:], _exact(np.zeros(n))
        if kind == PERIODIC and node <= self.problem.inner:
            return unit[:0], unit[0, :0]
        b = self.modes.gaps[self.stops[node]]
        rows, values = [b @ unit[:n]], [self.bounds[node]]
        if kind == STOP:
            pivot = int(np.argmax(np.abs(b)))
            rows += [b[pivot] * unit[n + k] - b[k] * unit[n + pivot] for k in range(n) if k != pivot]
        return np.array(rows), np.array(values + [mp.mpf(0)] * (len(rows) - 1))

    def residual(self) -> np.ndarray:
        """The start's end holds, each flight ends on the next node, each node is on its stop, the far end holds."""
        modes, inner = self.modes, self.problem.inner
        states, times = self.x[:, :-1], self.x[:, -1]
        out = [self.first[0] @ states[0] - self.first[1]]
        for i, stop in enumerate(self.stops[: inner + 1]):
            end = modes.flow(states[i], modes.flight(times[i]))
            if i < inner:
                out += [modes.impact(stop, end) - states[i + 1], [modes.gap(stop, states[i + 1]) - self.bounds[i]]]
            elif self.problem.periodic:
                out.append((modes.impact(stop, end) - states[0])[self.kept])
        out.append(self.last[0] @ end - self.last[1])
        if self.quarter_period is not None:
            out.append([mp.fsum(times) - self.problem.quarters * self.quarter_period])
        return np.concatenate(out)

    def jacobian(self) -> np.ndarray:
        """Derivative of the residual in double precision."""
        modes, inner, size = self.modes.in_double, self.problem.inner, 2 * self.n
        unit, count = np.eye(size), len(self.x)
        out: list[np.ndarray] = []

        def rows(height: int, *blocks: tuple[int, Any]) -> None:
            out.append(np.zeros((height, count, size + 1)))
            for node, values in blocks:
                part = np.atleast_2d(np.asarray(values, dtype=float))
                out[-1][:, node, : part.shape[1]] += part

        rows(len(self.first[0]), (0, self.first[0]))
        for i, stop in enumerate(self.stops[: inner + 1]):
            flight = self.modes.flight(self.x[i, -1]).astype(float)
            arrival = modes.flow(self.x[i, :-1].astype(float), flight)
            landing = np.vstack([modes.flow(unit, flight), modes.rate(arrival)])
            if i < inner:
                rows(size, (i, modes.impact(stop, landing).T), (i + 1, -unit))
                rows(1, (i + 1, modes.gaps[stop]))
            elif self.problem.periodic:
                rows(size - 1, (i, modes.impact(stop, landing).T[self.kept]), (0, -unit[self.kept]))
        rows(len(self.last[0]), (inner, self.last[0].astype(float) @ landing.T))
        if self.quarter_period is not None:
            rows(1)
            out[-1][:, :, -1] = 1.0
        return np.concatenate(out).reshape(-1, count * (size + 1))

    def solve(self) -> DigitOrbit:
        """Correct until nothing is gained any more."""
        given = self.x
        inverse = np.empty((0, 0))
        worst = mp.inf
        for _ in range(_ROUNDS):
            residual = self.residual()
            size = np.abs(residual).max()
            if not size < worst:
                break
            worst, kept = size, self.x
            if size == 0:
                break
            if size > _NEAR * self.speed or not inverse.size:
                # The least correction, in units of the sizes: J' = Q R, J^+ = Q R'^-1.
                q, r = np.linalg.qr((self.jacobian() * self.sizes).T)
                inverse = self.sizes[:, None] * np.linalg.solve(r, q.T).T
            update = inverse @ (residual / size).astype(float)
            self.x = self.x - _exact(update.reshape(self.x.shape)) * size
        if not worst < _GOOD * max(1, self.speed):
            raise ArithmeticError(f"the orbit did not settle in {DIGITS} digits (residual {mp.nstr(worst, 3)})")
        period = mp.fsum(kept[:, -1])
        change = abs(period - mp.fsum(given[:, -1])) / period
        apart = np.abs(kept[0, :-1] - given[0, :-1]).max() / self.speed
        return DigitOrbit(self.problem, kept[:, :-1], kept[:, -1], worst, float(max(apart, change)))


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
