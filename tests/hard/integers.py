"""Free motion in integers of 500 bits, and the first contact in a short piece of it.

The state is Taylor's series of the exponential, from the exact values of the floats in M, C, K, u, v and t; the distance of a contact about
it is its Taylor polynomial of degree 12, whose remainder over the pieces that are looked at is below 1e-20. Its least value is at an end
where d' keeps its sign, and at the one zero of d' where d'' > 0, each by a bound of what the derivative can change over the piece; else the
piece is halved.
"""

from fractions import Fraction

import numpy as np

BITS = 500
DEGREE = 12


class Integers:
    """Free motion in integers of `BITS` bits behind the point, from the exact values of the floats."""

    def __init__(self, system):
        n = system.degrees_of_freedom
        one = 1 << BITS
        a = np.zeros((2 * n, 2 * n), dtype=object)
        for i in range(n):
            a[i, n + i] = one
            for j in range(n):
                m = Fraction(float(system.mass[i, i]))
                a[n + i, j] = int(-Fraction(float(system.stiffness[i, j])) / m * one)
                a[n + i, n + j] = int(-Fraction(float(system.damping[i, j])) / m * one)
        self.matrix, self.n = a, n

    @staticmethod
    def number(x):
        return int(Fraction(float(x)) * (1 << BITS))

    def state(self, u, v):
        return np.array([self.number(x) for x in (*u, *v)], dtype=object)

    def derivative(self, z):
        return self.matrix.dot(z) >> BITS

    def flow(self, z, t):
        """exp(A t) z by Taylor's series."""
        t, total, term, k = self.number(t), z, z, 0
        while True:
            k += 1
            term = ((self.derivative(term) * t) >> BITS) // k
            total = total + term
            if max(abs(x) for x in term) < 1 << (BITS - 260):
                return total

    def polynomial(self, z, row, bound):
        """d(s) = side bound - c . u(s) about a state, coefficients of s^0 ... s^DEGREE as integers."""
        row = np.array([self.number(x) for x in row], dtype=object)
        out, factorial = [], 1
        for k in range(DEGREE + 1):
            value = -(int(row.dot(z[: self.n])) >> BITS)
            out.append((value + (self.number(bound) if k == 0 else 0)) // factorial)
            factorial *= k + 1
            z = self.derivative(z)
        return out


def value(polynomial, s):
    """A polynomial at s, both in integers of `BITS` bits."""
    total = 0
    for coefficient in reversed(polynomial):
        total = ((total * s) >> BITS) + coefficient
    return total


def slopes(polynomial):
    return [k * coefficient for k, coefficient in enumerate(polynomial)][1:]


def as_float(x):
    return float(Fraction(x, 1 << BITS))


def zero(polynomial, low, high):
    """The zero of a polynomial that changes its sign once between low and high, by bisection and then Newton's steps that stay inside."""
    rate = slopes(polynomial)
    rising = value(polynomial, high) > 0
    s = (low + high) // 2
    for count in range(120):
        f = value(polynomial, s)
        if (f > 0) == rising:
            high = s
        else:
            low = s
        g = value(rate, s)
        step = s - (f << BITS) // g if g and count > 12 else (low + high) // 2
        step = step if low < step < high else (low + high) // 2
        if abs(step - s) < 1 << (BITS - 180):
            return step
        s = step
    return s


def turning(polynomial, low, high):
    """Where a polynomial is least between low and high: its derivative has one zero there, or none, by a bound of its changes; None where
    that is open."""
    rate = slopes(polynomial)
    width = as_float(high - low)
    at_low, at_high = as_float(value(rate, low)), as_float(value(rate, high))

    def change(of):
        return width * sum(abs(as_float(c)) * k * (2.0 * width) ** (k - 1) for k, c in enumerate(of) if k)

    if abs(at_low) > change(rate):
        return low if at_low > 0.0 else high
    bend = slopes(rate)
    if as_float(value(bend, low)) > change(bend):
        return low if at_low >= 0.0 else high if at_high <= 0.0 else zero(rate, low, high)
    return None


def first_event(polynomial, low, high, tolerance, depth=0):
    """The first hit or touch of a distance between low and high, both within twice their difference of 0.

    (kind, place): kind "none", "hit", "touch", or "either" where its least value is within a tenth of the tolerance of being a touch, on
    either side of that."""
    least = turning(polynomial, low, high)
    if least is None:
        assert depth < 40, "a distance without a sign of its derivatives"
        middle = (low + high) // 2
        first = first_event(polynomial, low, middle, tolerance, depth + 1)
        return first if first[0] in ("hit", "touch") else max(first, first_event(polynomial, middle, high, tolerance, depth + 1), key=_rank)
    deepest = as_float(value(polynomial, least))
    if deepest > 1.1 * tolerance:
        return "none", least
    if deepest < -1.1 * tolerance:
        return "hit", zero(polynomial, low, least) if value(polynomial, low) > 0 else low
    return ("touch" if abs(deepest) < 0.9 * tolerance and low < least < high else "either"), least


def _rank(event):
    return ("none", "either", "touch", "hit").index(event[0])
