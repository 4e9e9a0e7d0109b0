"""Periodic orbits in fifty digits, from the multipoint equations: what the errors of symmetric orbits are measured against.

The modes are computed anew from the system's matrices in many digits. The unknowns are those of `bvp.kernels.multipoint`; the equations are
evaluated in many digits and corrected with the inverse of their Jacobian in double precision: near the orbit each round gains about as many
digits as double precision has. What is left of the residual says how good the answer is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np

from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem

__all__ = ["DIGITS", "DigitModes", "DigitOrbit", "orbit_in_digits"]

DIGITS = 50
"""Decimal digits of the arithmetic; answers are good to some fewer."""

_ROUNDS = 20
_NEAR = mp.mpf(10) ** -8
"""Residual below which the Jacobian is as good as that of the orbit, in double precision, and is kept."""

_GOOD = mp.mpf(10) ** (15 - DIGITS)


class DigitModes:
    """Modes of an undamped system in many digits; a modal state is a list of n displacements and n velocities.

    Parameters
    ----------
    system : ImpactSystem
        Conservative; its numbers are taken as the binary fractions that they are.

    Attributes
    ----------
    frequencies : list of n mpf
    shapes : (n, n) mp.matrix
        Mass-normalised, one a column.
    gaps : list of (list of n mpf)
        c . phi_k for each stop.
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
            if any(square <= mp.mpf(10) ** (10 - DIGITS) for square in squares):
                raise ValueError("periodic orbits in many digits need a system that cannot move as a whole")
            self.frequencies = [mp.sqrt(square) for square in squares]
            self.shapes = inverse.T * vectors
            self.gaps = [
                [mp.fsum(mp.mpf(float(c)) * self.shapes[i, k] for i, c in enumerate(stop.gap)) for k in range(self.size)]
                for stop in system.stops
            ]

    def from_velocities(self, velocities: Any) -> list[Any]:
        """Modal state at u = 0 with velocities (n,)."""
        moment = self.shapes.T * (self.mass * mp.matrix([mp.mpf(float(v)) for v in velocities]))
        return [mp.mpf(0)] * self.size + list(moment)

    def velocities(self, z: list[Any]) -> list[Any]:
        """Velocities u' (n,) of a modal state."""
        return list(self.shapes * mp.matrix(z[self.size :]))

    def energy(self, z: list[Any]) -> Any:
        """h."""
        n = self.size
        return mp.fsum(z[n + k] ** 2 + (w * z[k]) ** 2 for k, w in enumerate(self.frequencies)) / 2

    def flow(self, z: list[Any], time: Any) -> list[Any]:
        """The state after a free flight."""
        n = self.size
        turns = [mp.cos_sin(w * time) for w in self.frequencies]
        places = [c * z[k] + s / self.frequencies[k] * z[n + k] for k, (c, s) in enumerate(turns)]
        return places + [c * z[n + k] - self.frequencies[k] * s * z[k] for k, (c, s) in enumerate(turns)]

    def rate(self, z: list[Any]) -> list[Any]:
        """Velocities and accelerations of the modes."""
        n = self.size
        return z[n:] + [-w * w * z[k] for k, w in enumerate(self.frequencies)]

    def gap(self, stop: int, z: list[Any]) -> Any:
        """The gap coordinate."""
        return mp.fsum(b * q for b, q in zip(self.gaps[stop], z, strict=False))

    def speed(self, stop: int, z: list[Any]) -> Any:
        """The rate of the gap coordinate."""
        return mp.fsum(b * p for b, p in zip(self.gaps[stop], z[self.size :], strict=True))

    def impact(self, stop: int, z: list[Any]) -> list[Any]:
        """The state after an elastic impact."""
        n, b = self.size, self.gaps[stop]
        push = 2 * self.speed(stop, z) / mp.fsum(x * x for x in b)
        return z[:n] + [p - push * x for p, x in zip(z[n:], b, strict=True)]


@dataclass(frozen=True, eq=False)
class DigitOrbit:
    """An orbit in many digits.

    Attributes
    ----------
    alpha, h : mpf
    velocities : list of n mpf
        At the start, where u = 0.
    times : list of mpf
        Of the impacts of the solved segment after its start, without that at its end.
    multipliers : list of mpf or mpc
        The nontrivial ones by modulus descending, then by angle; for two degrees of freedom, else empty.
    residual : mpf
        What is left of the equations.
    """

    alpha: Any
    h: Any
    velocities: list[Any]
    times: list[Any]
    multipliers: list[Any]
    residual: Any


def orbit_in_digits(problem: MultipointProblem, y: np.ndarray, alpha: float) -> DigitOrbit:
    """The orbit next to a solution in double precision, at a quarter period.

    Parameters
    ----------
    problem : MultipointProblem
        With an origin start and one stop.
    y : (u,) float
        Unknowns near the orbit.
    alpha : float
        The quarter period, taken as the binary fraction that it is.

    Raises
    ------
    ValueError
        For other ends or systems.
    ArithmeticError
        Where the corrections do not settle.
    """
    if problem.ends[0] != "origin" or len(problem.system.stops) != 1:
        raise ValueError(f"orbits in many digits start at the origin, with one stop; received {problem.ends[0]}")
    with mp.workdps(DIGITS):
        return _Segment(problem, y, alpha).solve()


class _Segment:
    """The equations of a segment from the origin; x holds the start's modal velocities, then t_0, z_1, t_1, ..."""

    def __init__(self, problem: MultipointProblem, y: np.ndarray, alpha: float) -> None:
        self.modes = DigitModes(problem.system)
        self.n = n = self.modes.size
        self.end = problem.ends[1]
        stop = problem.system.stops[0]
        self.bounds = [mp.mpf(float(stop.upper if letter.endswith("+") else stop.lower)) for letter in problem.word]
        self.last = mp.mpf(float(stop.upper if self.end.endswith("+") else stop.lower))
        self.quarters = problem.quarters
        self.alpha = mp.mpf(float(alpha))
        velocities = (problem.modes.to_state @ problem.start(y))[n:]
        self.x = self.modes.from_velocities(velocities)[n:]
        z = [mp.mpf(0)] * n + self.x
        for i, time in enumerate(problem.flight_times(y)):
            t = mp.mpf(float(time))
            self.x = [*self.x, t]
            if i < problem.inner:
                z = self.modes.impact(0, self.modes.flow(z, t))
                self.x = [*self.x, *z]
        self.scale = [mp.mpf(1)] * len(self.x)

    def parts(self) -> tuple[list[list[Any]], list[Any]]:
        """States at the start of each flight, and flight times."""
        n, row = self.n, 2 * self.n + 1
        states = [[mp.mpf(0)] * n + self.x[:n]]
        times = [self.x[n]]
        for i in range(len(self.bounds)):
            at = n + 1 + i * row
            states.append(self.x[at : at + 2 * n])
            times.append(self.x[at + 2 * n])
        return states, times

    def residual(self) -> list[Any]:
        """Each flight ends on the next node, each node is on its stop, the far end holds, the times sum to the segment."""
        modes, n = self.modes, self.n
        states, times = self.parts()
        out = []
        for i, bound in enumerate(self.bounds):
            landed = modes.impact(0, modes.flow(states[i], times[i]))
            out += [a - b for a, b in zip(landed, states[i + 1], strict=True)]
            out.append(modes.gap(0, states[i + 1]) - bound)
        end = modes.flow(states[-1], times[-1])
        if self.end == "origin":
            out += end[:n]
        elif self.end == "rest":
            out += end[n:]
        else:
            out.append(modes.gap(0, end) - self.last)
            b = modes.gaps[0]
            out += [end[n + k] * b[0] - end[n] * b[k] for k in range(1, n)]
        out.append(mp.fsum(times) - self.quarters * self.alpha)
        return out

    def jacobian(self) -> np.ndarray:
        """Derivative of the residual in double precision."""
        n, modes = self.n, self.modes
        w = np.array([float(x) for x in modes.frequencies])
        b = np.array([float(x) for x in modes.gaps[0]])
        push = np.eye(2 * n)
        push[n:, n:] -= 2.0 * np.outer(b, b) / (b @ b)
        states, times = self.parts()
        size, row = len(self.x), 2 * n + 1
        out = np.zeros((size, size))
        for i, time in enumerate(times):
            c, s = np.cos(w * float(time)), np.sin(w * float(time))
            flow = np.block([[np.diag(c), np.diag(s / w)], [np.diag(-w * s), np.diag(c)]])
            z = np.array([float(x) for x in states[i]])
            arrival = flow @ z
            rate = np.concatenate([arrival[n:], -w * w * arrival[:n]])
            columns = slice(0, n) if i == 0 else slice(n + 1 + (i - 1) * row, n + 1 + (i - 1) * row + 2 * n)
            at = n + i * row
            left = flow[:, n:] if i == 0 else flow
            if i < len(self.bounds):
                rows = slice(i * row, i * row + 2 * n)
                out[rows, columns], out[rows, at] = push @ left, push @ rate
                node = n + 1 + i * row
                out[rows, node : node + 2 * n] = -np.eye(2 * n)
                out[i * row + 2 * n, node : node + n] = b
                continue
            if self.end == "origin":
                condition = np.eye(n, 2 * n)
            elif self.end == "rest":
                condition = np.eye(n, 2 * n, n)
            else:
                condition = np.zeros((n, 2 * n))
                condition[0, :n] = b
                condition[1:, n:] = b[0] * np.eye(n)[1:]
                condition[1:, n] -= b[1:]
            rows = slice(size - n - 1, size - 1)
            out[rows, columns], out[rows, at] = condition @ left, condition @ rate
        out[-1, [n + i * row for i in range(len(times))]] = 1.0
        return out

    def solve(self) -> DigitOrbit:
        """Correct until nothing is gained any more."""
        inverse = np.empty((0, 0))
        worst = mp.inf
        for _ in range(_ROUNDS):
            residual = self.residual()
            size = max(abs(r) for r in residual)
            if size >= worst:
                break
            worst = size
            kept = list(self.x)
            if size == 0:
                break
            if size > _NEAR or not inverse.size:
                inverse = np.linalg.inv(self.jacobian())
            update = inverse @ np.array([float(r / size) for r in residual])
            self.x = [x - mp.mpf(float(d)) * size for x, d in zip(self.x, update, strict=True)]
        self.x = kept
        if not worst < _GOOD:
            raise ArithmeticError(f"the orbit did not settle in {DIGITS} digits (residual {mp.nstr(worst, 3)})")
        states, times = self.parts()
        moments = [mp.fsum(times[: i + 1]) for i in range(len(self.bounds))]
        multipliers = self.multipliers(states[0], moments) if self.n == 2 else []
        return DigitOrbit(self.alpha, self.modes.energy(states[0]), self.modes.velocities(states[0]), moments, multipliers, worst)

    def multipliers(self, start: list[Any], moments: list[Any]) -> list[Any]:
        """Nontrivial multipliers from the trace of the product of flights and saltation matrices over a period."""
        period = 4 * self.alpha
        half = list(zip(moments, self.bounds, strict=True))
        if self.quarters == 1:
            # Rest or a stop at the quarter: the segment is run through backwards after it; a stop there is one more impact.
            middle = [] if self.end == "rest" else [(self.alpha, self.last)]
            half = [*half, *middle, *[(2 * self.alpha - t, bound) for t, bound in reversed(half)]]
            whole = [*half, *[(2 * self.alpha + t, -bound) for t, bound in half]]
        else:
            # The motion is odd about each of its passages of the origin.
            whole = [*half, *[(period - t, -bound) for t, bound in reversed(half)]]
        modes, z, now = self.modes, start, mp.mpf(0)
        columns = [[mp.mpf(i == j) for i in range(4)] for j in range(4)]
        b = modes.gaps[0]
        for moment, _ in whole:
            before = modes.flow(z, moment - now)
            z = modes.impact(0, before)
            speed = modes.speed(0, before)
            coming, going = modes.impact(0, modes.rate(before)), modes.rate(z)
            for j, column in enumerate(columns):
                there = modes.flow(column, moment - now)
                late = (b[0] * there[0] + b[1] * there[1]) / speed
                columns[j] = [x + late * (g - c) for x, c, g in zip(modes.impact(0, there), coming, going, strict=True)]
            now = moment
        columns = [modes.flow(column, period - now) for column in columns]
        miss = max(abs(x - y) for x, y in zip(modes.flow(z, period - now), start, strict=True))
        if not miss < _GOOD * mp.mpf(10) ** 6:
            raise ArithmeticError(f"the orbit does not close in {DIGITS} digits (by {mp.nstr(miss, 3)})")
        half_trace = (mp.fsum(columns[i][i] for i in range(4)) - 2) / 2
        return pair(half_trace)


def pair(half_trace: Any) -> list[Any]:
    """Roots of x^2 - 2 half_trace x + 1, by modulus descending, then by angle."""
    square = half_trace**2 - 1
    if square < 0:
        turn = mp.sqrt(-square)
        return [mp.mpc(half_trace, -turn), mp.mpc(half_trace, turn)]
    larger = half_trace + mp.sign(half_trace) * mp.sqrt(square)
    return [larger, 1 / larger]
