"""Conservative orbits of a system with one odd spring k w^p in thirty digits: an oracle for events that shares nothing with the program.

A flight is Taylor's series of motion and variation in integers. The events of a family are zeros of determinants of the derivative of a
quarter period, and of the characteristic function of half a period, along four orbits beside the event.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from itertools import zip_longest

import mpmath as mp
import numpy as np

BITS = 130
ONE = 1 << BITS
ORDER = 32
DEFECT = ONE >> 100
"""Largest change of a state that the error of a step's series makes: 8e-31."""

APART = {"BP": 1e-6}
"""How far the orbits beside an event are apart, 1e-9 by default: relative. At a branch point double precision knows the orbit to 1e-8."""

NODES = (-2, -1, 1, 2)

BESIDE = 1e-3
"""The tangent at an event is that of a parabola through orbits at least as far from it, in arclength."""

fixed = np.frompyfunc(lambda x: int(Fraction(x) * ONE), 1, 1)
exact = np.frompyfunc(lambda x: mp.mpf(x) / ONE, 1, 1)


def in_fixed(matrix: mp.matrix) -> np.ndarray:
    """A matrix in fixed point."""
    return np.array([[int(mp.nint(x * ONE)) for x in row] for row in matrix.tolist()], dtype=object)


class SpringDigits:
    """M u'' + K u + c k (c . u)^p = 0 with p odd, of an undamped system with one such spring.

    Parameters
    ----------
    system : ImpactSystem
        With stops or without: if there are, the spring is between them.
    end : str
        The far end of a quarter: rest, stop+ or stop-.
    """

    def __init__(self, system, end: str = "rest"):
        (spring,) = system.describe()["springs"]
        assert spring["power"] % 2 == 1 and not np.any(system.damping)
        self.n = system.degrees_of_freedom
        self.gap = system.stops[0].upper if system.stops else np.inf
        self.wall = {"-": -self.gap, "+": self.gap}.get(end[-1], 0.0)
        self.power = int(spring["power"])
        with mp.workdps(60):
            self.mass, self.stiffness = mp.matrix(system.mass.tolist()), mp.matrix(system.stiffness.tolist())
            self.row, self.coefficient = mp.matrix(spring["c"]), mp.mpf(spring["stiffness"])
            inverse = self.mass**-1
            self._pull = -in_fixed(inverse * self.stiffness)
            self._push = -in_fixed(inverse * self.row * self.coefficient)[:, 0]
            self._row = in_fixed(self.row)[:, 0]
        # w^(p - 1) by products: of which two series each one is.
        self._products, accumulated, square, rest = [], None, 0, self.power - 1
        while rest:
            if rest % 2:
                if accumulated is None:
                    accumulated = square
                else:
                    self._products.append((accumulated, square))
                    accumulated = len(self._products)
            rest //= 2
            if rest:
                self._products.append((square, square))
                square = len(self._products)
        self._steep = accumulated

    def _rates(self, u: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations, and their derivatives along columns (n, m)."""
        w = int(self._row @ u) >> BITS
        steep = (w ** (self.power - 1)) >> (BITS * (self.power - 2))
        bent = (self.power * steep * ((self._row @ columns) >> BITS)) >> BITS
        return (self._pull @ u + self._push * (steep * w >> BITS)) >> BITS, (self._pull @ columns + np.outer(self._push, bent)) >> BITS

    def _series(self, z: np.ndarray, unit: int) -> np.ndarray:
        """Taylor coefficients (ORDER + 1, 2 n, 1 + m) of the motion and of the variation for a unit of time."""
        n = self.n
        out = np.zeros((ORDER + 1, *z.shape), dtype=object)
        out[0] = z
        powers = np.zeros((len(self._products) + 1, ORDER + 1), dtype=object)
        opened = np.zeros((ORDER + 1, z.shape[1]), dtype=object)
        for k in range(ORDER):
            opened[k] = (self._row @ out[k, :n]) >> BITS
            powers[0, k] = opened[k, 0]
            for i, (a, b) in enumerate(self._products):
                powers[i + 1, k] = (powers[a, : k + 1] @ powers[b, k::-1]) >> BITS
            force = (powers[self._steep, k::-1] @ opened[: k + 1]) >> BITS
            force[1:] *= self.power
            out[k + 1, :n] = ((unit * out[k, n:]) >> BITS) // (k + 1)
            rate = (self._pull @ out[k, :n] + np.outer(self._push, force)) >> BITS
            out[k + 1, n:] = ((unit * rate) >> BITS) // (k + 1)
        return out

    def flown(self, z: np.ndarray, time: int) -> np.ndarray:
        """State (first column) and derivatives along the other columns after a time, all in fixed point."""
        n, unit = self.n, min(time, ONE >> 4)
        while time:
            series = self._series(z, unit)
            highest = max(abs(x) for x in series[-1].flat)
            part = min(ONE, (time * ONE) // unit)
            if highest > DEFECT:
                part = min(part, int(ONE * 2.0 ** ((DEFECT.bit_length() - highest.bit_length()) / ORDER)))
            while True:
                value, slope = series[-1], ORDER * series[-1]
                for k in range(ORDER - 1, -1, -1):
                    value = series[k] + ((part * value) >> BITS)
                    if k:
                        slope = k * series[k] + ((part * slope) >> BITS)
                motion, variation = self._rates(value[:n, 0], value[:n, 1:])
                wrong = slope[n:] - ((unit * np.column_stack([motion, variation])) >> BITS)
                if max(abs(x) for x in wrong.flat) < DEFECT:
                    break
                part = part * 4 // 5
            z, spent = value, (part * unit) >> BITS
            time = 0 if part == (time * ONE) // unit else time - spent
            unit = min(spent + spent // 3, time) if time else 0
        return z

    def quarter(self, y: np.ndarray) -> QuarterDigits:
        """The quarter of start velocities and duration y (n + 1,), in fixed point."""
        n = self.n
        z = np.zeros((2 * n, 1 + 2 * n), dtype=object)
        z[n:, 0] = y[:n]
        z[range(2 * n), range(1, 2 * n + 1)] = ONE
        return QuarterDigits(self, y, self.flown(z, int(y[n])))


class QuarterDigits:
    """A motion from the origin for some time, with its derivative. Of an orbit the far end is at rest, or at a stop that turns it round.

    Attributes, of mpf
    ------------------
    flow : (2 n, 2 n) matrix
        Derivative of the end by the start.
    residual, jacobian : (n, 1), (n, n + 1) matrix
        Of the far end, by start velocities and duration.
    """

    def __init__(self, spring: SpringDigits, y: np.ndarray, end: np.ndarray):
        n = spring.n
        self.spring = spring
        self.velocity = mp.matrix(list(exact(y[:n])))
        self.momentum = spring.mass * self.velocity
        self.energy = (self.velocity.T * self.momentum)[0] / 2
        self.end, self.flow = mp.matrix(list(exact(end[:, 0]))), mp.matrix(exact(end[:, 1:]).tolist())
        self.force = self._force(self.end)
        self.rate = self._rate(self.end)
        if spring.wall:
            # The stop is reached, and the momentum is along the direction of its impulse.
            across = mp.matrix([[-spring.row[1], spring.row[0]]]) * spring.mass
            rows = mp.matrix([[*spring.row, 0, 0], [0, 0, *across]])
        else:
            rows = mp.zeros(n, 2 * n)
            rows[:, n:] = mp.eye(n)
        self.residual = rows * self.end
        self.residual[0] -= spring.wall
        self.jacobian = mp.zeros(n, n + 1)
        self.jacobian[:, :n], self.jacobian[:, n] = rows * self.flow[:, n:], rows * self.rate

    def _force(self, z: mp.matrix) -> mp.matrix:
        spring = self.spring
        u = z[: spring.n, 0]
        return spring.stiffness * u + spring.row * (spring.coefficient * (spring.row.T * u)[0] ** spring.power)

    def _rate(self, z: mp.matrix) -> mp.matrix:
        return mp.matrix([*z[self.spring.n :, 0], *-(self.spring.mass**-1 * self._force(z))])

    @cached_property
    def half(self) -> mp.matrix:
        """Derivative of the flow over half a period composed with u -> -u; the second quarter is the first one backwards."""
        n = self.spring.n
        turn, middle = mp.eye(2 * n), mp.eye(2 * n)
        turn[n:, n:] *= -1
        if self.spring.wall:
            push = self.spring.mass**-1 * self.spring.row
            gap = mp.matrix([[*self.spring.row, 0, 0]])
            middle[n:, n:] -= push * self.spring.row.T * (2 / (self.spring.row.T * push)[0])
            late = self._rate(middle * self.end) - middle * self.rate
            middle += late * gap / (gap * self.rate)[0]
        return -turn * self.flow**-1 * turn * middle * self.flow

    def characteristic(self, c: mp.mpf) -> mp.mpf:
        """The product of c - x - 1/x over the n pairs x, 1/x of multipliers of half a period, |c| < 2."""
        turn = mp.expj(mp.acos(c / 2))
        return mp.re(mp.det(self.half - turn * mp.eye(2 * self.spring.n)) / turn**self.spring.n)

    def collision(self) -> mp.mpf:
        """(x + 1/x - y - 1/y)^2 of the two pairs of multipliers of half a period that are nearest to each other."""
        sums = sorted((x + 1 / x for x in mp.eig(self.half, left=False, right=False)), key=lambda c: (c.real, c.imag))
        # Each sum is there twice.
        near = min((sums[i : i + 4] for i in range(0, len(sums) - 3, 2)), key=lambda four: abs(four[3] - four[0]))
        twin = min(near[1:], key=lambda c: abs(c - near[0]))
        others = mp.fsum(c for c in near[1:] if c is not twin)
        return mp.re((near[0] + twin - others) ** 2) / 4

    def value(self, kind: str | float, held: int) -> mp.mpf:
        """What vanishes at an event: at a fold the slope of the energy by the unknown that is held; the determinant of perturbations with
        one symmetry by those with one at the far end, within the energy and but for the motion itself; for a number the characteristic
        function of half a period at this angle."""
        n, flow = self.spring.n, self.flow
        if not isinstance(kind, str):
            return self.characteristic(2 * mp.cos(kind))
        if kind == "NS":
            return self.collision()
        if kind == "GR":
            gap = (self.spring.row.T * self.end[:n, 0])[0]
            return (self.spring.row.T * self.end[n:, 0])[0] if self.spring.wall else abs(gap) - self.spring.gap
        if kind == "SN":
            free = [j for j in range(n + 1) if j != held]
            others = mp.lu_solve(mp.matrix([[self.jacobian[i, j] for j in free] for i in range(n)]), -self.jacobian[:, held])
            tangent = list(others)[:held] + [mp.mpf(1)] + list(others)[held:]
            return mp.fsum(a * b for a, b in zip(self.momentum, tangent, strict=False))
        block, below, beside = {
            "BP": (self.jacobian[:, :n], self.momentum, self.jacobian[:, n]),
            "reversal": (flow[:n, :n], self.velocity, self.force),
            "start": (flow[:n, n:], self.momentum, self.force),
            "far end": (flow[n:, :n], self.velocity, self.rate[n:, 0]),
        }[kind]
        bordered = mp.zeros(n + 1)
        bordered[:n, :n], bordered[:n, n], bordered[n, :n] = block, beside, below.T
        return mp.det(bordered)


def kinds_of(event) -> tuple[str | float, ...]:
    """What can vanish at an event of a family between the origin and the other end. The multipliers of a period are the squares of those
    of half a period."""
    if event.type in ("SN", "BP", "GR", "NS"):
        return (event.type,)
    if event.type == "SB":
        return ("reversal" if event.breaks == "reversal" else "start" if "start" in event.note else "far end",)
    if event.type == "PD":
        return (mp.pi / 2,)
    angle = mp.pi * event.p_q[0] / event.p_q[1]
    return angle, mp.pi - angle


def energy_of_event(spring: SpringDigits, branch, event) -> tuple[float, float]:
    """Energy of an event, and how far it is from the event of the program: of the velocity or the duration that changes most, relative."""
    with mp.workdps(40):
        n, s = spring.n, branch.points["arclength"] - event.arclength
        sides = np.flatnonzero(s < -BESIDE)[::-1], np.flatnonzero(s > BESIDE)
        beside = [event.point, *([i for pair in zip_longest(*sides) for i in pair if i is not None][:2])]
        (_, before, after), unknowns = s[beside], [np.append(orbit.velocities, orbit.alpha) for orbit in map(branch.orbit, beside)]
        tangent = ((unknowns[2] - unknowns[0]) * before / after - (unknowns[1] - unknowns[0]) * after / before) / (before - after)
        sizes = np.append(np.full(n, np.abs(unknowns[0][:n]).max()), unknowns[0][n])
        held = int(np.argmax(np.abs(tangent / sizes)))
        apart = APART.get(event.type, 1e-9)
        step = tangent * (apart * sizes[held] / tangent[held])
        found = []
        for k in NODES:
            y = fixed(unknowns[0] + k * step)
            while True:
                quarter = spring.quarter(y)
                if max(abs(x) for x in quarter.residual) < mp.mpf(10) ** -18:
                    break
                free = [j for j in range(n + 1) if j != held]
                matrix = mp.matrix([[quarter.jacobian[i, j] for j in free] for i in range(n)])
                y[free] -= in_fixed(mp.lu_solve(matrix, quarter.residual))[:, 0]
            found.append(quarter)
        results = []
        for kind in kinds_of(event):
            values = [quarter.value(kind, held) for quarter in found]
            weights = [mp.fprod(b / (b - a) for b in values if b is not a) for a in values]
            energies = [quarter.energy for quarter in found]
            results.append((float(mp.fdot(weights, energies)), float(apart * mp.fdot(weights, NODES))))
        return min(results, key=lambda result: abs(result[1]))
