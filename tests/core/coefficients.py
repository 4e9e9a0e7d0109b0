"""The numbers in `bvp/core/functions.hpp`, computed anew in many digits: `python -m tests.core.coefficients` prints them.

Each polynomial interpolates the rest of a series at Chebyshev points. Its degree is the least whose error is below 2^-58 of the function.
"""

from __future__ import annotations

import mpmath as mp

__all__ = ["CONSTANTS", "POLYNOMIALS", "TWO_OVER_PI", "parts", "polynomial"]


def _tail(terms, first, step=1):
    """Rest of a series: sum of terms(k) z^(k - first) over k = first, first + step, ..."""

    def function(z):
        return mp.fsum(terms(first + step * k) * z**k for k in range(70))

    return function


def _alternating(k):
    return mp.mpf(-1) ** (k // 2) / mp.factorial(k)


POLYNOMIALS = {
    # name: rest of the series in z, interval of z, weight of an absolute error
    "SIN": (_tail(_alternating, 5, 2), (0, 0.62), lambda z: z * z),
    "COS": (_tail(_alternating, 4, 2), (0, 0.62), lambda z: z * z / 0.7),
    "EXP": (_tail(lambda k: 1 / mp.factorial(k), 3), (-0.347, 0.347), lambda z: z**3 / 0.7),
    "LOG": (_tail(lambda k: mp.mpf(2) / k, 3, 2), (0, 0.0295), lambda z: z / 2),
    "ATAN": (_tail(lambda k: mp.mpf(-1) ** (k // 2) / k, 3, 2), (0, 0.1717), lambda z: z),
    "SINH": (_tail(lambda k: 1 / mp.factorial(k), 3, 2), (0, 0.25), lambda z: z),
}


def polynomial(name):
    """Coefficients of a polynomial as doubles, ascending, and its largest error with exact arithmetic."""
    function, (low, high), weight = POLYNOMIALS[name]
    with mp.workdps(60):
        low, high = mp.mpf(low), mp.mpf(high)
        samples = [low + (high - low) * i / 100 for i in range(101)]
        values = [function(z) for z in samples]
        for count in range(3, 20):
            points = [(low + high) / 2 + (high - low) / 2 * mp.cos(mp.pi * (2 * i + 1) / (2 * count)) for i in range(count)]
            rows = mp.matrix([[z**p for p in range(count)] for z in points])
            coefficients = list(mp.lu_solve(rows, mp.matrix([function(z) for z in points])))
            error = max(abs((mp.polyval(coefficients[::-1], z) - v) * weight(z)) for z, v in zip(samples, values, strict=True))
            if error < mp.mpf(2) ** -58:
                return [float(c) for c in coefficients], float(error)
    raise ArithmeticError(name)


def parts(value, *bits):
    """A number as a sum of doubles of so many bits each; the last one is rounded to 53."""
    out = []
    with mp.workdps(60):
        for count in bits:
            exponent = int(mp.floor(mp.log(abs(value), 2))) + 1 - count
            out.append(float(mp.ldexp(mp.floor(mp.ldexp(value, -exponent)), exponent)))
            value = value - mp.mpf(out[-1])
        out.append(float(value))
    return out


CONSTANTS = (
    ("pi/2", lambda: mp.pi / 2, (33, 33)),
    ("pi/2", lambda: mp.pi / 2, (53,)),
    ("log 2", lambda: +mp.ln2, (42,)),
    ("2/pi", lambda: 2 / mp.pi, ()),
)
"""Names, values and bits of the parts, but for the last one."""


def _two_over_pi(words):
    """The digits of 2/pi after the point, in words of 32 bits."""
    with mp.workprec(32 * words + 64):
        digits = int(mp.floor(mp.ldexp(2 / mp.pi, 32 * words)))
    return [digits >> 32 * (words - 1 - i) & 0xFFFFFFFF for i in range(words)]


TWO_OVER_PI = _two_over_pi(40)


def main():
    """Print all numbers as hexadecimal fractions."""
    for name in POLYNOMIALS:
        coefficients, error = polynomial(name)
        print(f"{name}, error 2^{float(mp.log(error, 2)):.1f}:", ", ".join(c.hex() for c in coefficients))
    with mp.workdps(60):
        for name, value, bits in CONSTANTS:
            value = value()
            print(f"{name}:", ", ".join(part.hex() for part in parts(value, *bits)))
    print("digits of 2/pi:", ", ".join(f"0x{word:08x}" for word in TWO_OVER_PI))


if __name__ == "__main__":
    main()
