"""Closed forms of orbits with one impact a half period, and of one impact a period on a one-sided stop.

The linear undamped system has modes w_k with mass-normalised shapes and b_k = c . phi_k. An orbit with one impact a half period moves under
impulses of alternating sign along the gap coordinate w = c . u, half a period 2 alpha apart. The antiperiodic train of impulses is summed
mode by mode:

    G(alpha) = sum b_k^2 tan(w_k alpha)/w_k,    h = sum b_k^2 sec^2(w_k alpha) / (2 G^2)

The functions use double precision and take any system. `Backbone` uses forty digits and takes the reference system. Neither uses the
solvers of saltus.
"""

import mpmath as mp
import numpy as np
from scipy.optimize import brentq

DIGITS = 40
"""Decimal digits of `Backbone`."""


def modes_of(system):
    """Return the frequencies (n,), ascending, and the mass-normalised shapes (n, n), by numpy alone."""
    lower = np.linalg.cholesky(system.mass)
    inverse = np.linalg.inv(lower)
    squares, vectors = np.linalg.eigh(inverse @ system.stiffness @ inverse.T)
    shapes = inverse.T @ vectors
    squares[np.abs(squares) < 1e-13 * np.max(squares)] = 0.0
    return np.sqrt(squares), shapes


def _tan_over(w, t):
    """tan(w t)/w, with its limit t at w = 0."""
    return np.where(w > 0.0, np.tan(w * t) / np.where(w > 0.0, w, 1.0), t)


def participation(system, stop=0):
    """Return frequencies, shapes and b_k = c . phi_k of a stop."""
    frequencies, shapes = modes_of(system)
    return frequencies, shapes, shapes.T @ np.array(system.stops[stop].gap)


def half_period_sum(system, alpha):
    """G(alpha) = sum b_k^2 tan(w_k alpha)/w_k, for one alpha or an array (...,) of them."""
    w, _, b = participation(system)
    return np.sum(b * b * _tan_over(w, np.asarray(alpha)[..., None]), axis=-1)


def energy(system, alpha):
    """h (...,) = sum b_k^2 sec^2(w_k alpha) / (2 G^2), for a gap in [-1, 1]."""
    w, _, b = participation(system)
    squares = (b / np.cos(w * np.asarray(alpha)[..., None])) ** 2
    return np.sum(squares, axis=-1) / (2.0 * half_period_sum(system, alpha) ** 2)


def origin_velocity(system, alpha):
    """Velocities u' (..., n) at u = 0, a quarter period before the impact on the upper side."""
    w, shapes, b = participation(system)
    alpha = np.asarray(alpha)[..., None]
    return b / (half_period_sum(system, alpha[..., 0])[..., None] * np.cos(w * alpha)) @ shapes.T


def motion(system, alpha, t):
    """Displacements (m, n) and velocities (m, n) at times t (m,) with u = 0 at t = 0. The impacts are at odd multiples of alpha."""
    w, shapes, b = participation(system)
    t = np.asarray(t)[:, None]
    turns = np.round(t / (2.0 * alpha))
    t, b = t - 2.0 * alpha * turns, b * (-1.0) ** turns
    amplitude = b / (half_period_sum(system, alpha) * np.cos(w * alpha))
    sine = np.where(w > 0.0, np.sin(w * t) / np.where(w > 0.0, w, 1.0), t)
    return (amplitude * sine) @ shapes.T, (amplitude * np.cos(w * t)) @ shapes.T


def is_physical(system, alpha, samples=4000):
    """Return whether the closed form is an orbit: G > 0, and |w| <= 1 on a dense grid."""
    if half_period_sum(system, alpha) <= 0.0:
        return False
    u, _ = motion(system, alpha, np.linspace(-alpha, alpha, samples)[1:-1])
    return bool(np.max(np.abs(u @ np.array(system.stops[0].gap))) <= 1.0)


def orbits_at(system, h, longest):
    """Quarter periods up to `longest` of all orbits of energy h."""
    grid = np.linspace(1e-3, longest, 6001)
    above = energy(system, grid) > h
    roots = [
        brentq(lambda alpha: energy(system, alpha) - h, grid[i], grid[i + 1], xtol=1e-15)
        for i in np.flatnonzero(above[:-1] != above[1:])
    ]
    return [alpha for alpha in roots if is_physical(system, alpha)]


def one_sided(system, period):
    """Impact of the orbit with one impact a period on the one-sided stop w <= d.

    Returns displacements u (n,) at the impact, velocities (n,) just before it, and the impulse P.

    q_k = A_k cos(w_k (t - T/2)) with w = d at the impact and the impulse P along c: A_k = P b_k / (2 w_k sin(w_k T/2)).
    """
    w, shapes, b = participation(system)
    d = system.stops[0].upper
    cot = b * b / np.tan(w * period / 2.0) / w
    impulse = 2.0 * d / np.sum(cot)
    amplitude = impulse * b / (2.0 * w * np.sin(w * period / 2.0))
    return shapes @ (amplitude * np.cos(w * period / 2.0)), shapes @ (-amplitude * w * np.sin(w * period / 2.0)), impulse


class Backbone:
    """Orbits with one impact a half period of the linear oscillator with a vibro-impact energy sink, in forty digits; alpha is T/4."""

    def __init__(self, mu=0.1, sigma=0.1, ground=None):
        with mp.workdps(DIGITS):
            mu, sigma = mp.mpf(mu), mp.mpf(sigma)
            first, mixed, last = sigma / mu, -sigma / mp.sqrt(mu), 1 + sigma if ground is None else mp.mpf(ground)
            middle, root = (first + last) / 2, mp.sqrt(((first - last) / 2) ** 2 + mixed**2)
            self.modes = []
            for square in (middle - root, middle + root):
                shape = mp.matrix([mixed, square - first])
                shape /= mp.norm(shape)
                absorber, primary = shape[0] / mp.sqrt(mu), shape[1]
                self.modes.append((mp.sqrt(square), (absorber, primary), absorber - primary))

    @classmethod
    def of(cls, system):
        """The closed form of a system, with its stiffness 1 + sigma as the double-precision number that the system holds."""
        return cls(float(system.mass[0, 0]), float(system.stiffness[0, 0]), float(system.stiffness[1, 1]))

    def half_period_sum(self, alpha):
        """G(alpha)."""
        return sum(b * b * mp.tan(w * alpha) / w for w, _, b in self.modes)

    def energy(self, alpha):
        """h(alpha)."""
        with mp.workdps(DIGITS):
            alpha = mp.mpf(alpha)
            return sum((b / mp.cos(w * alpha)) ** 2 for w, _, b in self.modes) / (2 * self.half_period_sum(alpha) ** 2)

    def velocities(self, alpha):
        """Velocities (u1', u2') at zero displacement, a quarter period before an impact on the upper side."""
        with mp.workdps(DIGITS):
            alpha = mp.mpf(alpha)
            g = self.half_period_sum(alpha)
            return [sum(shape[i] * b / (g * mp.cos(w * alpha)) for w, shape, b in self.modes) for i in (0, 1)]

    def impact_speed(self, alpha):
        """Speed of the relative motion at the impact, sum b_k^2 / G."""
        with mp.workdps(DIGITS):
            return sum(b * b for _, _, b in self.modes) / self.half_period_sum(mp.mpf(alpha))

    def tau_half(self, alpha):
        """Trace of the reduced half-period map composed with u -> -u.

        The map is one exact flight over 2 alpha and one saltation. Its two trivial multipliers are 1, so its trace less 2 is tau_half.
        """
        with mp.workdps(DIGITS):
            alpha = mp.mpf(alpha)
            g = self.half_period_sum(alpha)
            total = sum(b * b for _, _, b in self.modes)
            q = [b * mp.tan(w * alpha) / (w * g) for w, _, b in self.modes]
            p = [b / g for _, _, b in self.modes]
            speed = sum(mode[2] * velocity for mode, velocity in zip(self.modes, p, strict=True))
            after = [velocity - 2 * mode[2] * speed / total for mode, velocity in zip(self.modes, p, strict=True)]
            force = [-(mode[0] ** 2) * x for mode, x in zip(self.modes, q, strict=True)]
            jump, flight = mp.eye(4), mp.zeros(4)
            for i in (0, 1):
                for j in (0, 1):
                    jump[2 + i, 2 + j] -= 2 * self.modes[i][2] * self.modes[j][2] / total
                w = self.modes[i][0]
                c, s = mp.cos(2 * w * alpha), mp.sin(2 * w * alpha)
                flight[i, i], flight[i, i + 2], flight[i + 2, i], flight[i + 2, i + 2] = c, s / w, -w * s, c
            row = mp.matrix([[self.modes[0][2], self.modes[1][2], 0, 0]])
            coming, going = mp.matrix(p + force), mp.matrix(after + force)
            saltation = jump + (going - jump * coming) * row / speed
            turned = -saltation * flight
            return sum(turned[i, i] for i in range(4)) - 2

    def stable(self, alpha, apart=0.0):
        """Whether |tau_half| < 2 at alpha and at relative distances `apart` on both sides; None if the answers differ."""
        answers = set()
        for side in (-1, 0, 1) if apart else (0,):
            tau_half = self.tau_half(mp.mpf(alpha) * (1 + side * mp.mpf(apart)))
            answers.add(abs(tau_half) < 2)
            answers.add(abs(tau_half) < 2 if abs(tau_half) > apart else None)
        return answers.pop() if len(answers) == 1 else None

    def where_tau_half_is(self, value, low, high):
        """Return alpha and h between low and high at which tau_half has this value."""
        alpha, h = self.root(lambda x: self.tau_half(x) - value, low, high)
        return float(alpha), float(h)

    def fold(self, low, high):
        """Return alpha and h, in all digits, at the extremum of h between low and high.

        With G' = sum b^2 sec^2, h = G'/(2 G^2), so h' = 0 is G G'' = 2 G'^2.
        """

        def slope(alpha):
            first = sum((b / mp.cos(w * alpha)) ** 2 for w, _, b in self.modes)
            second = sum(2 * w * mp.tan(w * alpha) * (b / mp.cos(w * alpha)) ** 2 for w, _, b in self.modes)
            return self.half_period_sum(alpha) * second - 2 * first**2

        return self.root(slope, low, high)

    def symmetry_breaking(self, low, high):
        """Return alpha and h, in all digits, between low and high at which tau_half is -2."""
        return self.root(lambda x: self.tau_half(x) + 2, low, high)

    def root(self, function, low, high):
        """Return alpha and h, in all digits, at a zero of a function of alpha between low and high."""
        with mp.workdps(DIGITS + 10):
            alpha = mp.findroot(function, (mp.mpf(low), mp.mpf(high)), solver="anderson", tol=mp.mpf(10) ** (-2 * DIGITS + 10))
            return alpha, self.energy(alpha)


class OneImpact:
    """Orbits with one impact a half period between two stops w = -d and w = d, or one a period on the stop w = d, of any undamped system.

    In forty digits, from the matrices of the system alone. The period is T = 4 alpha in both cases.
    """

    def __init__(self, system, stop=0):
        self.gap = mp.mpf(system.stops[stop].upper)
        with mp.workdps(DIGITS):
            inverse = mp.inverse(mp.cholesky(mp.matrix(system.mass.tolist())))
            squares, vectors = mp.eigsy(inverse * mp.matrix(system.stiffness.tolist()) * inverse.T)
            self.shapes = inverse.T * vectors
            # A free translation has a square of rounding, and an infinite period.
            size = max(abs(square) for square in squares)
            self.frequencies = [mp.sqrt(square) if square > size * mp.mpf(10) ** (-DIGITS // 2) else mp.mpf(0) for square in squares]
            self.b = list(self.shapes.T * mp.matrix([list(system.stops[stop].gap)]).T)

    def two_sided(self, alpha):
        """Energy, displacements and velocities a quarter period before an impact on the upper side."""
        with mp.workdps(DIGITS):
            alpha = mp.mpf(alpha)
            g = sum(b * b * (mp.tan(w * alpha) / w if w else alpha) for w, b in zip(self.frequencies, self.b, strict=True)) / self.gap
            rates = [b / (g * mp.cos(w * alpha)) for w, b in zip(self.frequencies, self.b, strict=True)]
            return sum(rate * rate for rate in rates) / 2, [mp.mpf(0)] * len(rates), list(self.shapes * mp.matrix(rates))

    def one_sided(self, alpha, phase=1):
        """Energy, displacements and velocities at a part of half a period after the impact; by default all of it, where it is at rest.

        There must be no rigid-body modes."""
        with mp.workdps(DIGITS):
            half = 2 * mp.mpf(alpha)
            modes = list(zip(self.frequencies, self.b, strict=True))
            impulse = 2 * self.gap / sum(b * b * mp.cot(w * half) / w for w, b in modes)
            amplitudes = [impulse * b / (2 * w * mp.sin(w * half)) for w, b in modes]
            energy = sum((w * a) ** 2 for (w, _), a in zip(modes, amplitudes, strict=True)) / 2
            angles = [w * half * (phase - 1) for w, _ in modes]
            u = [a * mp.cos(angle) for a, angle in zip(amplitudes, angles, strict=True)]
            v = [-w * a * mp.sin(angle) for (w, _), a, angle in zip(modes, amplitudes, angles, strict=True)]
            return energy, list(self.shapes * mp.matrix(u)), list(self.shapes * mp.matrix(v))
