"""Orbits with one impact a half period in fifty digits, for any number of degrees of freedom: oracles that share nothing with the program.

Modes by mpmath from the exact values of the floats in M, K and c; then the closed form, mode by mode: G = sum b_k^2 tan(w_k alpha)/w_k,
impulse 2/G, h = sum b_k^2 sec^2(w_k alpha)/(2 G^2), with tan(w alpha)/w = alpha for a mode without frequency. The map over half a
period composed with u -> -u is one exact flight and one saltation; the multipliers of a period are the squares of its eigenvalues.
"""

import mpmath as mp
import numpy as np

from tests.hard.cases import largest

DIGITS = 50


class Closed:
    """The orbit of quarter period alpha on the first stop, -1 <= c . u <= 1, of an undamped system; not asked whether it is physical.

    Attributes, all of them mpf: energy, speed (of the approach to the upper side), origin (n,) velocities at u = 0.
    """

    def __init__(self, system, alpha):
        with mp.workdps(DIGITS):
            self.alpha = alpha = mp.mpf(alpha)
            self.n = n = system.degrees_of_freedom
            lower = mp.cholesky(mp.matrix(system.mass.tolist()))
            inverse = lower**-1
            squares, vectors = mp.eigsy(inverse * mp.matrix(system.stiffness.tolist()) * inverse.T)
            stiffest = max(abs(x) for x in squares)
            squares = [mp.mpf(0) if abs(x) < mp.mpf(10) ** (12 - DIGITS) * stiffest else x for x in squares]
            self.shapes = inverse.T * vectors
            self.frequencies = [mp.sqrt(x) for x in squares]
            row = mp.matrix([list(map(mp.mpf, map(float, system.stops[0].gap)))])
            self.b = [(row * self.shapes)[k] for k in range(n)]
            self.sum = mp.fsum(b * b * self._tan_over(w) for w, b in zip(self.frequencies, self.b, strict=True))
            self.momenta = [b / (self.sum * mp.cos(w * alpha)) for w, b in zip(self.frequencies, self.b, strict=True)]
            self.energy = mp.fsum(p * p for p in self.momenta) / 2
            self.total = mp.fsum(b * b for b in self.b)
            self.speed = self.total / self.sum
            self.origin = [mp.fsum(self.shapes[i, k] * self.momenta[k] for k in range(n)) for i in range(n)]

    def _tan_over(self, w):
        return mp.tan(w * self.alpha) / w if w else self.alpha

    def gap(self, t):
        """c . u at a time from the passage of the origin, |t| <= alpha."""
        with mp.workdps(DIGITS):
            t = mp.mpf(t)
            sines = [mp.sin(w * t) / w if w else t for w in self.frequencies]
            return mp.fsum(b * p * s for b, p, s in zip(self.b, self.momenta, sines, strict=True))

    def rate(self, t):
        """The derivative of `gap` by time."""
        with mp.workdps(DIGITS):
            cosines = [mp.cos(w * mp.mpf(t)) for w in self.frequencies]
            return mp.fsum(b * p * c for b, p, c in zip(self.b, self.momenta, cosines, strict=True))

    def half_map(self):
        """The map of modal states (q, p) over half a period, composed with u -> -u; from just after one impact to just after the next."""
        with mp.workdps(DIGITS):
            n, w, b = self.n, self.frequencies, self.b
            flight, turn = mp.zeros(2 * n), mp.eye(2 * n)
            for k in range(n):
                t = 2 * self.alpha
                cosine, sine = (mp.cos(w[k] * t), mp.sin(w[k] * t) / w[k]) if w[k] else (mp.mpf(1), t)
                flight[k, k] = flight[n + k, n + k] = cosine
                flight[k, n + k], flight[n + k, k] = sine, -(w[k] ** 2) * sine
                for j in range(n):
                    turn[n + k, n + j] -= 2 * b[k] * b[j] / self.total
            q = [b[k] * self._tan_over(w[k]) / self.sum for k in range(n)]
            before = mp.matrix([x / self.sum for x in b] + [-(w[k] ** 2) * q[k] for k in range(n)])
            speeds = mp.matrix([before[k] for k in range(n)])
            after = turn * mp.matrix(q + list(speeds))
            coming = before
            going = mp.matrix([after[n + k] for k in range(n)] + [-(w[k] ** 2) * q[k] for k in range(n)])
            row = mp.matrix([[*b, *([0] * n)]])
            return -(turn + (going - turn * coming) * row / self.speed) * flight

    def tau_half(self):
        """Trace of the half map less its two trivial multipliers 1."""
        with mp.workdps(DIGITS):
            half = self.half_map()
            return mp.fsum(half[i, i] for i in range(2 * self.n)) - 2

    def multipliers(self):
        """The 2n - 2 nontrivial multipliers of a period, sorted as the program sorts them."""
        from bvp.multipliers import sort_multipliers

        with mp.workdps(DIGITS):
            values = list(mp.eig(self.half_map(), left=False, right=False))
            for _ in range(2):
                values.remove(min(values, key=lambda x: abs(x - 1)))
            return sort_multipliers(np.array([complex(x * x) for x in values]))


def root(function, low, high, digits=40):
    """Zero of a function of an mpf between two numbers, to `digits` digits."""
    with mp.workdps(DIGITS):
        return mp.findroot(function, (mp.mpf(low), mp.mpf(high)), solver="anderson", tol=mp.mpf(10) ** -digits)


def relative(values, expected):
    """Largest difference of some numbers from the expected ones, over the largest of those."""
    values, expected = list(values), list(expected)
    size = max(abs(x) for x in expected)
    return float(largest(*(abs(mp.mpf(float(a)) - b) for a, b in zip(values, expected, strict=True))) / size)
