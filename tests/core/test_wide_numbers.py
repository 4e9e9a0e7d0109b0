"""Numbers wider than a double: sums of two and of four doubles.

Oracle: mpmath in 120 digits and more. The limits of operations on double-doubles are proven bounds (Joldes, Muller and Popescu 2017). The
others are what the core promises in `bvp/core/double_double.hpp` and `bvp/core/quad_double.hpp`.
"""

from typing import Any, NamedTuple

import mpmath as mp
import numpy as np
import pytest
import saltus_core
from hypothesis import given
from hypothesis import strategies as st

from tests.core.digits import random_numbers, relative_errors

U = 2.0**-53


class Kind(NamedTuple):
    """A type of number: its functions, how many doubles it has, and the limits of relative errors."""

    core: Any
    parts: int
    operations: dict[str, float]
    functions: float
    powers: float


KINDS = {
    "double_double": Kind(saltus_core.double_double, 2, {"add": 3 * U**2, "multiply": 7 * U**2, "divide": 15 * U**2}, 2.0**-100, 2.0**-94),
    "quad_double": Kind(saltus_core.quad_double, 4, dict.fromkeys(("add", "multiply", "divide"), 2.0**-205), 2.0**-196, 2.0**-190),
}

RANGES = {
    "sin": (1e-100, 1e6), "cos": (1e-100, 1e6), "tan": (1e-100, 1e6), "exp": (1e-100, 600.0), "expm1": (1e-100, 600.0),
    "sinh": (1e-100, 600.0), "cosh": (1e-100, 600.0), "tanh": (1e-100, 100.0), "asinh": (1e-100, 1e100), "atan": (1e-100, 1e100),
    "asin": (1e-100, 1.0), "acos": (1e-100, 1.0), "log": (1e-200, 1e250), "log1p": (1e-100, 1e250), "sqrt": (1e-200, 1e250),
}  # fmt: skip


@pytest.fixture(params=KINDS)
def kind(request):
    return KINDS[request.param]


def wide_numbers(kind, seed, count, low, high, signs=True):
    """Random numbers (parts, N) whose sizes are spread evenly over all magnitudes."""
    parts = [random_numbers(seed, count, low, high * (1.0 - 1e-15), signs)]
    while len(parts) < kind.parts:
        parts.append(parts[-1] * np.random.default_rng(seed + 1000 * len(parts)).uniform(-0.5, 0.5, count) * U)
    return np.array(parts)


def column(kind, *numbers):
    """Doubles as numbers (parts, N) of a kind."""
    return np.vstack([numbers, np.zeros((kind.parts - 1, len(numbers)))])


def require_below(limit, kind, name, *arguments, **options):
    values = getattr(kind.core, name)(*(np.ascontiguousarray(x) for x in arguments))
    sizes = np.abs(values)
    assert np.all(sizes[1:] <= np.spacing(sizes[:-1]))
    errors = relative_errors(name, values, *arguments, **options)
    worst = int(np.argmax(errors))
    assert errors[worst] < limit, (name, [x[:, worst].tolist() for x in arguments], errors[worst])


@pytest.mark.parametrize("name", ["add", "multiply", "divide"])
def test_operations(kind, name):
    """All magnitudes; sums of numbers that nearly cancel."""
    limit = kind.operations[name]
    x, y = wide_numbers(kind, 1, 2000, 1e-100, 1e100), wide_numbers(kind, 2, 2000, 1e-100, 1e100)
    require_below(limit, kind, name, x, y)
    require_below(limit, kind, name, x, -2.0 * x)
    require_below(limit, kind, name, x, np.vstack([-x[:1] * (1.0 + 2.0**-40), x[1:]]))


PART = st.floats(min_value=1e-60, max_value=1e60)


@given(PART, PART, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.booleans())
def test_any_operation(a, b, c, d, negative):
    """Any two numbers."""
    for kind in KINDS.values():
        x = np.array([[a * (c * U) ** k] for k in range(kind.parts)])
        y = np.array([[b * (d * U) ** k] for k in range(kind.parts)]) * (-1.0 if negative else 1.0)
        for name, limit in kind.operations.items():
            require_below(limit, kind, name, x, y, precision=1200)


@pytest.mark.parametrize("name", RANGES)
def test_functions(kind, name):
    """All magnitudes."""
    low, high = RANGES[name]
    signs = name not in ("log", "log1p", "sqrt")
    require_below(kind.functions, kind, name, wide_numbers(kind, 3, 400, low, high, signs), precision=900)
    require_below(kind.functions, kind, name, wide_numbers(kind, 4, 400, 1e-3, min(high, 10.0), signs), precision=900)


def test_next_to_one(kind):
    """Logarithms that nearly vanish."""
    offsets = random_numbers(5, 300, 1e-25, 0.3)
    near = column(kind, *(1.0 + offsets))
    near[1] = (1.0 - near[0]) + offsets
    require_below(kind.functions, kind, "log", near, precision=900)
    require_below(kind.functions, kind, "log1p", column(kind, *offsets), precision=900)


def test_angles(kind):
    """Beside multiples of pi/2, to the sine's own size. Double-doubles of any size, to the size of 1."""
    with mp.workdps(100):
        angles = [mp.pi / 2 * k * (1 + mp.mpf(10) ** -p) for k in (1, 2, 3, 1000, 99991) for p in (5, 15, 25)]
        near = np.zeros((kind.parts, len(angles)))
        for i, angle in enumerate(angles):
            for k in range(kind.parts):
                near[k, i] = float(angle)
                angle -= mp.mpf(float(near[k, i]))
    for name in ("sin", "cos", "tan"):
        require_below(kind.functions, kind, name, near, precision=900)
    for name in ("sin", "cos"):
        if kind.parts == 2:
            require_below(kind.functions, kind, name, wide_numbers(kind, 6, 300, 1e6, 1e300), precision=1500, least=1.0)
        else:
            assert np.all(np.isnan(getattr(kind.core, name)(column(kind, 2.0**50, 1e300))[0]))


def test_two_arguments(kind):
    """Points of all directions and sizes; powers lose the digits that the exponent of the result takes."""
    x, y = wide_numbers(kind, 7, 400, 1e-3, 1e3), wide_numbers(kind, 8, 400, 1e-3, 1e3)
    require_below(kind.functions, kind, "atan2", x, y, precision=900)
    require_below(kind.functions, kind, "hypot", x, y, precision=900)
    x, y = wide_numbers(kind, 9, 300, 1e-200, 1e300), wide_numbers(kind, 10, 300, 1e-200, 1e300)
    require_below(kind.functions, kind, "hypot", x, y, precision=4500)
    bases, exponents = wide_numbers(kind, 11, 300, 1e-3, 1e3, signs=False), wide_numbers(kind, 12, 300, 1e-3, 80.0)
    require_below(kind.powers, kind, "pow", bases, exponents, precision=900)


def test_special_values(kind):
    """Oracle: the functions of doubles."""
    limits = [("exp", np.inf, np.inf), ("exp", -np.inf, 0.0), ("log", 0.0, -np.inf)]
    for name, x, expected in [*limits, ("sqrt", 0.0, 0.0), ("sin", 0.0, 0.0), ("cosh", 0.0, 1.0)]:
        assert getattr(kind.core, name)(column(kind, x))[0, 0] == expected
    for name in ("sin", "exp", "log", "sqrt"):
        assert np.isnan(getattr(kind.core, name)(column(kind, np.nan))[0, 0])
    assert np.isnan(kind.core.log(column(kind, -1.0))[0, 0])
    assert kind.core.pow(column(kind, -2.0), column(kind, 3.0))[0, 0] == -8.0
    with pytest.raises(ValueError, match="one row for each part"):
        kind.core.sin(np.zeros((3, 1)))
