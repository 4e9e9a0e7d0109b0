"""Periodic orbits in fifty digits from the multipoint equations. They decide what double precision cannot, and serve as references.

The modes are computed anew from the system's matrices. The equations are those of `bvp.kernels.multipoint`, with the full start state
as an unknown and the start's end as equations of their own. They are evaluated in fifty digits and corrected with the pseudo-inverse of
their Jacobian in double precision: near the orbit each round gains about as many digits as double precision has. The residual that is
left bounds the error of the orbit.
"""

from __future__ import annotations

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
    """Modes of an undamped system in many digits; a modal state is a list of n displacements and n velocities.

    Parameters
    ----------
    system : ImpactSystem
        Conservative; its numbers are taken as the binary fractions that they are.

    Attributes
    ----------
    squares : list of n mpf
        Of the frequencies, ascending; exactly 0 for a rigid-body mode, negative where the stiffness is.
    shapes : (n, n) mp.matrix
        Mass-normalised, one a column.
    gaps : list of (list of n mpf)
        c . phi_k for each stop.
    lengths : list of mpf
        Squares of the lengths of these rows.
    """

    def __init__(self, system: ImpactSystem) -> None:
        reason = system.why_not_conservative()
        if reason is not None:
            raise ValueError(f"periodic orbits in many digits need a conservative system: {reason}")
        with mp.workdps(DIGITS):
            self.mass = mp.matrix(system.mass.tolist())
            lower = mp.cholesky(self.mass)
            inverse = lower**-1
            squares, vectors = mp.eigsy(inverse * mp.matrix(system.stiffness.tolist()) * inverse.T)
            self.size = len(squares)
            # Of a rigid-body mode the rounded matrices leave a trace of stiffness, which counts for nothing in double precision either.
            self.squares = [mp.mpf(0) if double == 0.0 else square for square, double in zip(squares, system.modes.squares, strict=True)]
            self.shapes = inverse.T * vectors
            self.gaps = [
                [mp.fsum(mp.mpf(float(c)) * self.shapes[i, k] for i, c in enumerate(stop.gap)) for k in range(self.size)]
                for stop in system.stops
            ]
            self.lengths = [_dot(row, row) for row in self.gaps]

    def state(self, displacements: Any, velocities: Any) -> list[Any]:
        """Modal state with displacements and velocities (n,)."""
        moments = [self.shapes.T * (self.mass * mp.matrix([mp.mpf(float(x)) for x in part])) for part in (displacements, velocities)]
        return [*moments[0], *moments[1]]

    def velocities(self, z: list[Any]) -> list[Any]:
        """Velocities u' (n,) of a modal state."""
        return list(self.shapes * mp.matrix(z[self.size :]))

    def energy(self, z: list[Any]) -> Any:
        """h."""
        n = self.size
        return sum((z[n + k] ** 2 + square * z[k] ** 2 for k, square in enumerate(self.squares)), mp.mpf(0)) / 2

    def flight(self, time: Any) -> list[tuple[Any, Any, Any]]:
        """cos(w t), sin(w t)/w and w sin(w t) of each mode, for `flow`."""
        out = []
        for square in self.squares:
            w = mp.sqrt(abs(square))
            c, s = mp.cos_sin(w * time) if square >= 0 else (mp.cosh(w * time), mp.sinh(w * time))
            over = s / w if w else time
            out.append((c, over, square * over))
        return out

    def flow(self, z: list[Any], flight: list[tuple[Any, Any, Any]]) -> list[Any]:
        """The state after a free flight."""
        n = self.size
        places = [c * z[k] + over * z[n + k] for k, (c, over, _) in enumerate(flight)]
        return places + [c * z[n + k] - times * z[k] for k, (c, _, times) in enumerate(flight)]

    def rate(self, z: list[Any]) -> list[Any]:
        """Velocities and accelerations of the modes."""
        n = self.size
        return z[n:] + [-square * z[k] for k, square in enumerate(self.squares)]

    def gap(self, stop: int, z: list[Any]) -> Any:
        """The gap coordinate."""
        return _dot(self.gaps[stop], z)

    def speed(self, stop: int, z: list[Any]) -> Any:
        """The rate of the gap coordinate."""
        return _dot(self.gaps[stop], z[self.size :])

    def impact(self, stop: int, z: list[Any]) -> list[Any]:
        """The state after an elastic impact."""
        n, b = self.size, self.gaps[stop]
        push = 2 * self.speed(stop, z) / self.lengths[stop]
        return z[:n] + [p - push * x for p, x in zip(z[n:], b, strict=True)]


def _dot(a: list[Any], b: list[Any]) -> Any:
    """Sum of products, as far as the shorter list goes."""
    return sum((x * y for x, y in zip(a, b, strict=False)), mp.mpf(0))


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
    states : list of (list of 2 n mpf)
        Modal states at the start of each flight.
    times : list of mpf
        Flight times.
    residual : mpf
        What is left of the equations.
    moved : float
        How far the start is from the given one: its state relative to sqrt(2 h), its quarter period relative to itself.
    """

    problem: MultipointProblem
    states: list[list[Any]]
    times: list[Any]
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
    def arrivals(self) -> list[list[Any]]:
        """Modal states at the end of each flight, before the impact there."""
        with mp.workdps(DIGITS):
            flights = (self.modes.flight(time) for time in self.times)
            return [self.modes.flow(z, flight) for z, flight in zip(self.states, flights, strict=True)]

    @cached_property
    def half_map(self) -> Any:
        """phi (2 (n - 1), 2 (n - 1)) between the ends: see `bvp.kernels.stability`.

        Raises
        ------
        ValueError
            For a periodic closure: it has no ends.
        """
        if self.problem.periodic:
            raise ValueError("a periodic closure has no half map; its trace decides its stability")
        with mp.workdps(DIGITS):
            return self._half_map()

    @cached_property
    def trace(self) -> Any:
        """tau of the full period, for two degrees of freedom."""
        with mp.workdps(DIGITS):
            if self.problem.periodic:
                size = self.problem.size
                unit = [[mp.mpf(i == j) for i in range(size)] for j in range(size)]
                final = self._carried(unit)
                return mp.fsum(final[i][i] for i in range(size)) - 2
            half = 2 + 4 * self.half_map[0, 1] * self.half_map[1, 0]
            return half * half - 2 if self.problem.quarters == 1 else half

    @cached_property
    def stable(self) -> bool | None:
        """Whether the orbit is linearly stable. None at a limit of stability, and for an orbit without reversal in more than two modes."""
        problem, m = self.problem, self.problem.half - 1
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
                displacement = max(abs(q) for z in self.states for q in z[: m + 1])
                factors = balance(problem, mp.sqrt(2 * self.energy) / displacement if displacement else mp.mpf(1))
                places = (0, 0), (0, m), (m, 0), (m, m)
                a, b, c, d = (f * phi[i : i + m, j : j + m] for f, (i, j) in zip(factors, places, strict=True))
                size = max(abs(x) for block in (a, b, c, d) for x in block)
                numbers = (*_eigenvalues(b, c, size), *_eigenvalues(d, a, size))
        # Each of the four is far from 0 beside its own rounding to a double.
        nu, error, rest, rest_error = (np.array(row, dtype=complex) for row in numbers)
        return DECISION[int(verdict(nu, error.real, rest, rest_error.real))]

    def _half_map(self) -> Any:
        problem, modes = self.problem, self.modes
        n, stops = modes.size, problem.modes.contact_stop
        start, end = problem.kinds
        z, final = self.states[0], self.arrivals[-1]
        zero = [mp.mpf(0)] * n

        def basis(kind: int, contact: int, at: list[Any]) -> list[list[Any]]:
            if kind == ORIGIN:
                return _across(at[n:])
            return _across([-force for force in modes.rate(at)[n:]] if kind == REST else modes.gaps[stops[contact]])

        first, last = basis(start, problem.contacts[-1], z), basis(end, problem.contacts[-2], final)
        if start == ORIGIN:
            columns = [zero + x for x in first] + [[-q for q in x] + zero for x in first]
        else:
            columns = [x + zero for x in first] + [zero + x for x in first]
        if start == STOP:
            stop = int(stops[problem.contacts[-1]])
            speed = modes.speed(stop, z)
            for column, x in zip(columns, first, strict=False):
                column[n:] = [_dot(modes.rate(z)[n:], x) / speed * b for b in modes.gaps[stop]]
        phi = mp.zeros(2 * (n - 1))
        for j, x in enumerate(self._carried(columns)):
            for i, row in enumerate(last):
                displacement, velocity = _dot(row, x), _dot(row, x[n:])
                phi[i, j], phi[n - 1 + i, j] = (velocity, -displacement) if end == ORIGIN else (displacement, velocity)
        return phi

    def _carried(self, columns: list[list[Any]]) -> list[list[Any]]:
        """Perturbations at the start, carried to the far end: through saltation matrices; at a stop there onto the stop along the flow."""
        problem, modes = self.problem, self.modes
        for i, (before, time) in enumerate(zip(self.arrivals, self.times, strict=True)):
            flight = modes.flight(time)
            columns = [modes.flow(x, flight) for x in columns]
            contact = problem.contacts[i]
            if contact < 0:
                continue
            stop = int(problem.modes.contact_stop[contact])
            speed, cut = modes.speed(stop, before), i == problem.inner and not problem.periodic
            flow = modes.rate(before)
            coming = flow if cut else modes.impact(stop, flow)
            going = [mp.mpf(0)] * len(flow) if cut else modes.rate(modes.impact(stop, before))
            for j, x in enumerate(columns):
                late = modes.gap(stop, x) / speed
                there = x if cut else modes.impact(stop, x)
                columns[j] = [p + late * (q - r) for p, q, r in zip(there, going, coming, strict=True)]
        return columns


def orbit_in_digits(problem: MultipointProblem, y: np.ndarray, quarter_period: float | None = None) -> DigitOrbit:
    """The orbit next to a solution in double precision.

    Parameters
    ----------
    problem : MultipointProblem
    y : (u,) float
        Unknowns near the orbit.
    quarter_period : float, optional
        The orbit at this quarter period, taken as the binary fraction that it is; without it, the nearest one of the family.

    Raises
    ------
    ArithmeticError
        Where the corrections do not settle.
    """
    with mp.workdps(DIGITS):
        return _Equations(problem, y, quarter_period).solve()


class _Equations:
    """The equations of a segment; x holds z_0, t_0, z_1, t_1, ..., the states modal."""

    def __init__(self, problem: MultipointProblem, y: np.ndarray, quarter_period: float | None) -> None:
        self.problem = problem
        self.modes = modes = digit_modes(problem.system)
        self.n = modes.size
        self.quarter_period = None if quarter_period is None else mp.mpf(float(quarter_period))
        double = problem.modes
        self.stops = [int(double.contact_stop[contact]) if contact >= 0 else -1 for contact in problem.contacts]
        self.bounds = [mp.mpf(float(double.contact_bound[contact])) if contact >= 0 else None for contact in problem.contacts]
        starts = np.vstack([problem.start(y), problem.nodes(y)]) @ double.to_state.T
        self.x: list[Any] = []
        for state, time in zip(starts, problem.flight_times(y), strict=True):
            self.x += [*modes.state(state[: self.n], state[self.n :]), mp.mpf(float(time))]
        self.speed = mp.sqrt(2 * modes.energy(self.x[: 2 * self.n])) or mp.mpf(1)
        sizes = [1.0] * self.n + [float(self.speed)] * self.n
        self.sizes = np.array((sizes + [1.0]) * (problem.inner + 1))
        self.first = self._conditions(problem.kinds[0], problem.inner + 1)
        self.last = self._conditions(problem.kinds[1], problem.inner)
        # Energy is conserved, so one of the closure equations follows from the others: leave out the one that changes the energy most.
        z = self.x[: 2 * self.n]
        slopes = modes.rate(z)[self.n :] + [p * self.speed for p in z[self.n :]]
        self.left_out = max(range(2 * self.n), key=lambda k: abs(slopes[k]))

    def _conditions(self, kind: int, node: int) -> list[tuple[list[Any], Any]]:
        """Rows L and values l of the conditions L z = l at an end."""
        n = self.n
        rows = [[mp.mpf(j == k) for j in range(2 * n)] for k in range(2 * n)]
        if kind == ORIGIN:
            return [(row, mp.mpf(0)) for row in rows[:n]]
        if kind == REST:
            return [(row, mp.mpf(0)) for row in rows[n:]]
        b = self.modes.gaps[self.stops[node]]
        on_stop = (b + [mp.mpf(0)] * n, self.bounds[node])
        if kind == PERIODIC:
            return [on_stop] if node > self.problem.inner else []
        pivot = max(range(n), key=lambda k: abs(b[k]))
        along = [([b[pivot] * x - b[k] * y for x, y in zip(rows[n + k], rows[n + pivot], strict=True)], mp.mpf(0)) for k in range(n)]
        return [on_stop, *(along[k] for k in range(n) if k != pivot)]

    def parts(self) -> tuple[list[list[Any]], list[Any]]:
        """States at the start of each flight, and flight times."""
        row = 2 * self.n + 1
        pieces = [self.x[i : i + row] for i in range(0, len(self.x), row)]
        return [piece[:-1] for piece in pieces], [piece[-1] for piece in pieces]

    def residual(self) -> list[Any]:
        """The start's end holds, each flight ends on the next node, each node is on its stop, the far end holds."""
        modes, inner = self.modes, self.problem.inner
        states, times = self.parts()
        out = [_dot(row, states[0]) - value for row, value in self.first]
        for i in range(inner):
            landed = modes.impact(self.stops[i], modes.flow(states[i], modes.flight(times[i])))
            out += [a - b for a, b in zip(landed, states[i + 1], strict=True)]
            out.append(modes.gap(self.stops[i], states[i + 1]) - self.bounds[i])
        end = modes.flow(states[-1], modes.flight(times[-1]))
        if self.problem.periodic:
            landed = modes.impact(self.stops[inner], end)
            out += [a - b for k, (a, b) in enumerate(zip(landed, states[0], strict=True)) if k != self.left_out]
        out += [_dot(row, end) - value for row, value in self.last]
        if self.quarter_period is not None:
            out.append(mp.fsum(times) - self.problem.quarters * self.quarter_period)
        return out

    def jacobian(self) -> np.ndarray:
        """Derivative of the residual in double precision."""
        n, modes, inner = self.n, self.modes, self.problem.inner
        squares = np.array([float(x) for x in modes.squares])
        states, times = self.parts()
        row, size, periodic = 2 * n + 1, 2 * n, self.problem.periodic
        out: list[np.ndarray] = []

        def rows(*blocks: tuple[int, np.ndarray]) -> None:
            height = np.atleast_2d(blocks[0][1]).shape[0]
            block = np.zeros((height, len(self.x)))
            for at, values in blocks:
                part = np.atleast_2d(values)
                block[:, at : at + part.shape[1]] += part
            out.append(block)

        rows((0, _floats(self.first)))
        for i, time in enumerate(times):
            c, over, times_w = np.array([[float(x) for x in mode] for mode in modes.flight(time)]).T
            flow = np.block([[np.diag(c), np.diag(over)], [np.diag(-times_w), np.diag(c)]])
            arrival = flow @ np.array([float(x) for x in states[i]])
            rate = np.concatenate([arrival[n:], -squares * arrival[:n]])
            at, node = i * row, (i + 1) * row
            if i < inner or periodic:
                b = np.array([float(x) for x in modes.gaps[self.stops[i]]])
                push = np.eye(size)
                push[n:, n:] -= 2.0 * np.outer(b, b) / (b @ b)
                landing = np.column_stack([push @ flow, push @ rate])
                if i < inner:
                    rows((at, landing), (node, -np.eye(size)))
                    rows((node, b))
                else:
                    kept = [k for k in range(size) if k != self.left_out]
                    rows((at, landing[kept]), (0, -np.eye(size)[kept]))
            else:
                rows((at, _floats(self.last) @ np.column_stack([flow, rate])))
        if self.quarter_period is not None:
            last = np.zeros(len(self.x))
            last[size::row] = 1.0
            rows((0, last))
        return np.vstack(out)

    def solve(self) -> DigitOrbit:
        """Correct until nothing is gained any more."""
        given = list(self.x)
        inverse = np.empty((0, 0))
        worst = mp.inf
        for _ in range(_ROUNDS):
            residual = self.residual()
            size = max(abs(r) for r in residual)
            if not size < worst:
                break
            worst, kept = size, list(self.x)
            if size == 0:
                break
            if size > _NEAR * self.speed or not inverse.size:
                jacobian = self.jacobian() * self.sizes
                # The least correction, in units of the sizes: J' = Q R, J^+ = Q R'^-1.
                q, r = np.linalg.qr(jacobian.T)
                inverse = self.sizes[:, None] * np.linalg.solve(r, q.T).T
            update = inverse @ np.array([float(r / size) for r in residual])
            self.x = [x - mp.mpf(float(d)) * size for x, d in zip(self.x, update, strict=True)]
        if not worst < _GOOD * max(1, self.speed):
            raise ArithmeticError(f"the orbit did not settle in {DIGITS} digits (residual {mp.nstr(worst, 3)})")
        self.x = kept
        states, times = self.parts()
        period, change = mp.fsum(times), mp.fsum(times) - mp.fsum(given[2 * self.n :: 2 * self.n + 1])
        apart = [abs(a - b) / self.speed for a, b in zip(states[0], given, strict=False)]
        return DigitOrbit(self.problem, states, times, worst, float(max(*apart, abs(change / period))))


def _eigenvalues(p: Any, q: Any, size: Any) -> tuple[list[Any], list[Any]]:
    """Eigenvalues of p' q, and a bound of their errors where the largest entry of the half map is `size`."""
    matrix, m = p.T * q, p.rows
    error = m * _ENTRY * size * (mp.mnorm(p) + mp.mnorm(q))
    if m == 1:
        return [matrix[0]], [error]
    return list(mp.eig(matrix, left=False, right=False)), [mp.sqrt(error * (error + mp.mnorm(matrix)))] * m


def _floats(conditions: list[tuple[list[Any], Any]]) -> np.ndarray:
    return np.array([[float(x) for x in row] for row, _ in conditions])


def _across(x: list[Any]) -> list[list[Any]]:
    """Orthonormal vectors perpendicular to x (n,); of two entries oriented with it."""
    if len(x) == 2:
        size = mp.hypot(x[0], x[1])
        return [[-x[1] / size, x[0] / size]]
    found = [[y / mp.norm(x) for y in x]]
    # The unit vector that is most along x gives nothing new.
    for k in sorted(range(len(x)), key=lambda k: abs(x[k]))[: len(x) - 1]:
        vector = [mp.mpf(j == k) for j in range(len(x))]
        for _ in range(2):
            for other in found:
                part = _dot(other, vector)
                vector = [a - part * b for a, b in zip(vector, other, strict=True)]
        size = mp.norm(vector)
        found.append([a / size for a in vector])
    return found[1:]
