"""Elementary functions of the core, for doubles.

Oracle: mpmath in sixty digits and more, where not said otherwise. The limit is one unit in the last place, which is what the core promises.
"""

import hashlib
import math
import re
from fractions import Fraction
from math import copysign, inf, isnan, nan, pi
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
import saltus_core
from hypothesis import example, given
from hypothesis import strategies as st

from bvp import functions
from tests.core.coefficients import CONSTANTS, POLYNOMIALS, TWO_OVER_PI, parts, polynomial
from tests.core.digits import LARGEST, errors_in_ulps, random_numbers

TINY = 5e-324

RANGES = {
    "sin": [(1e-300, 10.0), (1.0, 1e6)], "cos": [(1e-300, 10.0), (1.0, 1e6)], "tan": [(1e-300, 10.0), (1.0, 1e6)],
    "exp": [(1e-300, 1.0), (1.0, 746.0)], "expm1": [(1e-300, 1.0), (1.0, 746.0)],
    "sinh": [(1e-300, 1.0), (1.0, 712.0)], "cosh": [(1e-300, 1.0), (1.0, 712.0)], "tanh": [(1e-300, 1.0), (1.0, 30.0)],
    "asinh": [(1e-300, 10.0), (10.0, LARGEST)], "atan": [(1e-300, 10.0), (10.0, LARGEST)],
    "asin": [(1e-300, 1.0), (0.1, 1.0)], "acos": [(1e-300, 1.0), (0.1, 1.0)],
}  # fmt: skip


def evaluate(name, *arguments):
    """Values of a function of the core."""
    return getattr(saltus_core, name)(*(np.ascontiguousarray(x, dtype=float) for x in arguments))


def require_below_one_ulp(name, *arguments, precision=200):
    errors = errors_in_ulps(name, evaluate(name, *arguments), *arguments, precision=precision)
    worst = int(np.argmax(errors))
    assert errors[worst] < 1.0, (name, [float(x[worst]).hex() for x in arguments], errors[worst])


@pytest.mark.parametrize("name", RANGES)
def test_all_magnitudes(name):
    """Random arguments of all magnitudes, and others spread evenly."""
    for seed, (low, high) in enumerate(RANGES[name]):
        require_below_one_ulp(name, random_numbers(seed, 1500, low, high))
        if high < 1e10:
            require_below_one_ulp(name, np.random.default_rng(seed).uniform(-high, high, 1500))


def test_logarithms():
    """All magnitudes with subnormal numbers, and next to 1."""
    source = np.random.default_rng(1)
    require_below_one_ulp("log", random_numbers(2, 2000, TINY, LARGEST, signs=False))
    require_below_one_ulp("log", source.uniform(0.5, 2.0, 2000))
    require_below_one_ulp("log", 1.0 + random_numbers(3, 1000, 1e-16, 1e-3))
    require_below_one_ulp("log1p", random_numbers(4, 2000, 1e-300, 0.999))
    require_below_one_ulp("log1p", random_numbers(5, 1000, 0.5, LARGEST, signs=False))
    require_below_one_ulp("log1p", np.nextafter(-1.0, 0.0) * (1.0 - np.geomspace(1e-16, 0.5, 200)))


def test_powers():
    """Moderate powers, bases next to 1 with huge exponents, results near the limits of doubles."""
    source = np.random.default_rng(1)
    require_below_one_ulp("pow", random_numbers(2, 1500, 1e-3, 1e3, signs=False), source.uniform(-100.0, 100.0, 1500))
    require_below_one_ulp("pow", random_numbers(3, 1500, TINY, LARGEST, signs=False), source.uniform(-1.1, 1.1, 1500))
    require_below_one_ulp("pow", 1.0 + random_numbers(4, 1500, 1e-15, 1e-3), random_numbers(5, 1500, 1.0, 1e5))
    bases = random_numbers(6, 1500, 1e-10, 1e10, signs=False)
    limits = source.choice([np.log(LARGEST), np.log(1e-307), -744.0], 1500) * source.uniform(0.999, 1.0, 1500)
    require_below_one_ulp("pow", bases, limits / np.log(bases))


@pytest.mark.parametrize("name", ["hypot", "atan2"])
def test_two_arguments(name):
    """Equal and unequal magnitudes, squares that overflow or vanish, subnormal numbers."""
    for seed, (low, high) in enumerate([(1e-3, 1e3), (TINY, LARGEST), (1e-320, 1e-300), (1e290, LARGEST)]):
        x = random_numbers(seed, 1000, low, high)
        require_below_one_ulp(name, x, random_numbers(seed + 10, 1000, low, high))
        require_below_one_ulp(name, x, np.clip(x, -LARGEST / 10, LARGEST / 10) * random_numbers(seed + 20, 1000, 0.1, 10.0))


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_huge_angles(name):
    """Up to the largest double."""
    require_below_one_ulp(name, random_numbers(1, 2000, 1e5, LARGEST), precision=1500)


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_next_to_multiples_of_a_quarter_turn(name):
    """The doubles beside k pi/2, where the reduced angle keeps the fewest digits, and beside k pi/4, where the interval ends."""
    source = np.random.default_rng(3)
    with mp.workdps(60):
        counts = [*range(1, 200), *source.integers(200, 10**6, 300).tolist(), *source.integers(10**6, 2**52, 300).tolist()]
        at = np.array([float(mp.pi / 4 * k) for k in counts])
    require_below_one_ulp(name, np.concatenate([at, np.nextafter(at, 0.0), np.nextafter(at, np.inf), -at]), precision=400)


def nearest_to_quarter_turns():
    """Of each power of two the doubles nearest to multiples of pi/2, by the continued fraction of 2^e 2/pi (Kahan 1983)."""
    with mp.workprec(3000):
        ratio = 2 / mp.pi
        numerator = int(mp.floor(mp.ldexp(ratio, 2900)))
    out = []
    for exponent in range(-52, 972):
        rest = Fraction(numerator, 2**2900) * Fraction(2) ** exponent
        before, denominator = 0, 1
        while rest.denominator != 1:
            rest = 1 / (rest - rest.numerator // rest.denominator)
            before, denominator = denominator, rest.numerator // rest.denominator * denominator + before
            if denominator >= 2**53:
                break
            if denominator >= 2**47:
                out.append(float(mp.ldexp(denominator, exponent)))
    return np.array(out)


def test_the_hardest_angles():
    """Each double that comes closest to a multiple of pi/2 beside those of its magnitude."""
    angles = nearest_to_quarter_turns()
    assert len(angles) > 2000 and float(6381956970095103 * 2.0**797) in angles
    for name in ("sin", "cos"):
        require_below_one_ulp(name, angles, precision=1500)


FINITE = st.floats(allow_nan=False, allow_infinity=False)


@given(FINITE)
@example(TINY)
@example(LARGEST)
def test_any_number(x):
    """Any double, where the function is defined."""
    for name in ("sin", "cos", "tan", "exp", "expm1", "sinh", "cosh", "tanh", "asinh", "atan"):
        if name != "exp" and name != "cosh" and name != "sinh" and name != "expm1" or abs(x) < 1e5:
            require_below_one_ulp(name, [x], precision=1500 if abs(x) > 1e10 else 200)
    if x > 0.0:
        require_below_one_ulp("log", [x])
    if x > -1.0:
        require_below_one_ulp("log1p", [x], precision=1500)
    if abs(x) <= 1.0:
        require_below_one_ulp("asin", [x])
        require_below_one_ulp("acos", [x])


@given(FINITE, FINITE)
def test_any_two_numbers(x, y):
    """Any two doubles."""
    require_below_one_ulp("hypot", [x], [y], precision=4500)
    if x or y > 0.0:
        require_below_one_ulp("atan2", [x], [y], precision=4500)
    if x > 0.0 and abs(y) < 1e5 / max(abs(np.log(x)), 1e-300):
        require_below_one_ulp("pow", [x], [y])


@given(FINITE)
def test_symmetry(x):
    """Oracle: odd and even functions are so bit for bit."""
    for name in ("sin", "tan", "tanh", "asinh", "atan", "sinh"):
        assert evaluate(name, [-x])[0] == -evaluate(name, [x])[0]
    for name in ("cos", "cosh"):
        assert evaluate(name, [-x])[0] == evaluate(name, [x])[0]


SPECIAL = [
    *[(name, (x,), x) for name in ("sin", "tan", "expm1", "log1p", "sinh", "tanh", "asinh", "atan", "asin", "sqrt") for x in (0.0, -0.0)],
    *[(name, (x,), 1.0) for name in ("cos", "exp", "cosh") for x in (0.0, -0.0)],
    *[(name, (x,), nan) for name in ("sin", "cos", "tan") for x in (inf, -inf, nan)],
    *[(name, (nan,), nan) for name in (*RANGES, "log", "log1p", "sqrt")],
    ("exp", (inf,), inf), ("exp", (-inf,), 0.0), ("exp", (709.782712893384,), 1.7976931348622732e+308), ("exp", (709.7827128933841,), inf),
    ("exp", (-745.2,), 0.0), ("exp", (-745.1,), TINY), ("expm1", (inf,), inf), ("expm1", (-inf,), -1.0), ("expm1", (710.0,), inf),
    ("log", (0.0,), -inf), ("log", (-0.0,), -inf), ("log", (inf,), inf), ("log", (-1.0,), nan), ("log", (-inf,), nan), ("log", (1.0,), 0.0),
    ("log1p", (-1.0,), -inf), ("log1p", (-2.0,), nan), ("log1p", (inf,), inf),
    ("sinh", (inf,), inf), ("sinh", (-inf,), -inf), ("cosh", (-inf,), inf), ("sinh", (-711.0,), -inf), ("cosh", (711.0,), inf),
    ("tanh", (inf,), 1.0), ("tanh", (-inf,), -1.0), ("asinh", (inf,), inf), ("asinh", (-inf,), -inf),
    ("atan", (inf,), pi / 2), ("atan", (-inf,), -pi / 2), ("asin", (1.0,), pi / 2), ("asin", (-1.0,), -pi / 2), ("asin", (1.0000001,), nan),
    ("acos", (1.0,), 0.0), ("acos", (-1.0,), pi), ("acos", (-1.0000001,), nan), ("sqrt", (-1.0,), nan),
    ("atan2", (0.0, 0.0), 0.0), ("atan2", (-0.0, 0.0), -0.0), ("atan2", (0.0, -0.0), pi), ("atan2", (-0.0, -0.0), -pi),
    ("atan2", (0.0, -1.0), pi), ("atan2", (-0.0, -1.0), -pi), ("atan2", (1.0, 0.0), pi / 2), ("atan2", (-1.0, -0.0), -pi / 2),
    ("atan2", (inf, inf), pi / 4), ("atan2", (-inf, -inf), -3 * pi / 4), ("atan2", (1.0, inf), 0.0), ("atan2", (1.0, -inf), pi),
    ("atan2", (nan, 1.0), nan), ("atan2", (1.0, nan), nan),
    ("hypot", (inf, nan), inf), ("hypot", (nan, -inf), inf), ("hypot", (nan, 1.0), nan), ("hypot", (0.0, -0.0), 0.0),
    ("hypot", (3 * TINY, 4 * TINY), 5 * TINY),
    ("pow", (nan, 0.0), 1.0), ("pow", (1.0, nan), 1.0), ("pow", (2.0, nan), nan), ("pow", (0.0, 3.0), 0.0), ("pow", (-0.0, 3.0), -0.0),
    ("pow", (-0.0, 2.0), 0.0), ("pow", (0.0, -1.0), inf), ("pow", (-0.0, -1.0), -inf), ("pow", (-0.0, -2.0), inf),
    ("pow", (-2.0, 3.0), -8.0),
    ("pow", (-2.0, 0.5), nan), ("pow", (-1.0, inf), 1.0), ("pow", (0.5, inf), 0.0), ("pow", (2.0, inf), inf), ("pow", (0.5, -inf), inf),
    ("pow", (inf, -1.0), 0.0),
    ("pow", (-inf, 3.0), -inf), ("pow", (-inf, -3.0), -0.0), ("pow", (-inf, 2.0), inf), ("pow", (2.0, 1024.0), inf),
    ("pow", (2.0, -1075.0), 0.0), ("pow", (2.0, -1074.0), TINY), ("pow", (-1.0, 2.0**53), 1.0), ("pow", (10.0, 22.0), 1e22),
]  # fmt: skip


@pytest.mark.parametrize(("name", "arguments", "expected"), SPECIAL)
def test_special_values(name, arguments, expected):
    """Oracle: the C standard, annex F: zeros with their signs, infinities, nan, the first results beyond the range."""
    value = float(evaluate(name, *([x] for x in arguments))[0])
    if isnan(expected):
        assert isnan(value)
    else:
        assert value == expected and copysign(1.0, value) == copysign(1.0, expected)


def test_exact_powers():
    """Oracle: integers and powers of two, which are doubles."""
    exponents = np.arange(-1074.0, 1024.0)
    assert np.array_equal(evaluate("pow", np.full(exponents.size, 2.0), exponents), np.ldexp(1.0, exponents.astype(int)))
    for base in range(3, 20):
        counts = [n for n in range(1, 53) if base**n < 2**53]
        assert evaluate("pow", [float(base)] * len(counts), [float(n) for n in counts]).tolist() == [float(base**n) for n in counts]


def test_whole_lengths():
    """Oracle: Pythagorean triples, in all magnitudes."""
    triples = [(m * m - n * n, 2 * m * n, m * m + n * n) for m in range(2, 30) for n in range(1, m)]
    for power in (-1060, -600, 0, 600, 1000):
        x, y, z = np.ldexp(np.array(triples, dtype=float).T, power)
        assert np.array_equal(evaluate("hypot", x, -y), z)


def test_numbers_in_the_source():
    """Oracle: the coefficients, computed anew; the parts of pi/2 and log 2; the digits of 2/pi."""
    folder = Path(__file__).parents[2] / "bvp" / "core"
    sources = "".join((folder / name).read_text(encoding="utf-8") for name in ("functions.hpp", "functions.cpp"))
    written = {float.fromhex(text) for text in re.findall(r"-?0x1\.[0-9a-f]+p[+-]\d+", sources)}
    for name in POLYNOMIALS:
        assert set(polynomial(name)[0]) <= written, name
    with mp.workdps(60):
        for _, value, bits in CONSTANTS:
            assert set(parts(value(), *bits)) <= written
    words = [int(text, 16) for text in re.findall(r"0x[0-9a-f]{8}(?=[,}])", sources)]
    assert words == TWO_OVER_PI


def test_the_same_bits_everywhere():
    """Oracle: a digest of many results, computed on another processor. It changes with the functions only."""
    bits = np.random.default_rng(5).integers(0, 2**64, 20000, dtype=np.uint64, endpoint=False).view(float)
    x = np.where(np.isfinite(bits), bits, 0.5)
    x[1::2] = np.ldexp(np.rint(np.ldexp(np.abs(np.frexp(x[1::2])[0]), 40)), -37) - 6.0
    digest = hashlib.sha256()
    for name in ("sin", "cos", "tan", "exp", "expm1", "sinh", "cosh", "tanh", "asinh", "atan", "log", "log1p", "asin", "acos"):
        values = evaluate(name, x)
        digest.update(values[~np.isnan(values)].tobytes())
    for name in ("pow", "hypot", "atan2"):
        values = evaluate(name, np.abs(x), x[::-1])
        digest.update(values[~np.isnan(values)].tobytes())
    assert digest.hexdigest()[:16] == "0100aa7299833191"


@pytest.mark.parametrize("shape", [(), (1,), (0,), (2, 3)])
def test_numbers_and_arrays_of_any_shape(shape):
    """Oracle: the same functions of lists, and that of numbers gives numbers."""
    x = 0.25 + 0.125 * np.arange(math.prod(shape)).reshape(shape)
    for name in ("asin", "asinh", "cos", "exp", "log", "sin"):
        found = getattr(functions, name)(x if shape else float(x))
        assert np.shape(found) == shape and isinstance(found, np.ndarray if shape else float)
        assert np.array_equal(np.ravel(found), evaluate(name, x.ravel()))
    assert np.array_equal(functions.hypot(x, 0.75), np.reshape(evaluate("hypot", x.ravel(), np.full(x.size, 0.75)), shape))


def test_lengths_are_checked():
    """Two arrays of different lengths are refused."""
    with pytest.raises(ValueError, match="2 and 3 numbers"):
        saltus_core.hypot(np.ones(2), np.ones(3))
