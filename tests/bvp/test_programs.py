"""Programs of expressions. Oracles: sympy's own value of the expression in forty digits, and complex steps of numpy for derivatives."""

import math

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from bvp.expressions import ExpressionError, parsed
from bvp.programs import derivative, evaluate_program, program_of
from tests.lab.programs import run

NAMES = ("a", "b", "c")
TEXTS = [
    "a", "3", "-a - b - 2", "1 - a", "a + b + c", "(a + b)*c/3", "a*b/(c*(a + 1))", "0.3*a**2 - b**3 + c**-2", "(a + b)**7",
    "a**1.5 + b**-0.5 + a**0.3", "2**a*b**c", "sqrt(a**2 + b**2)", "1/(a + b)", "exp(-a*b)*log(c + 2)", "sin(a)*cos(b)*tan(c/3)",
    "sinh(a) + cosh(b) - tanh(c)", "abs(a - b)*abs(c)", "abs(sqrt(a) - log(b))", "a*(0.1 + 0.2)", "sqrt(2)*a",
]  # fmt: skip
POINTS = [(0.7, 1.3, 2.1), (0.05, 3.0, 0.4), (2.5, 0.6, 1e-3)]


def symbols():
    return [sympy.Symbol(name, real=True) for name in NAMES]


def read(text):
    """The expression of a text, in real symbols."""
    return parsed(text, "text", exact=True).xreplace({sympy.Symbol(name): symbol for name, symbol in zip(NAMES, symbols(), strict=True)})


def values(expressions, point):
    """What the compiled program writes."""
    out, known = run(program_of(expressions, symbols()), point)
    assert known
    return out


def many_digits(expression, point):
    """Sympy's value in forty digits, at exactly these floats."""
    return sympy.N(expression.subs(dict(zip(symbols(), map(sympy.Rational, point), strict=True))), 40)


@pytest.mark.parametrize("point", POINTS[:1])
def test_values_and_derivatives_are_those_of_sympy_in_forty_digits(point):
    """Oracle: see `require_values_and_derivatives_are_those_of_sympy_in_forty_digits`."""
    require_values_and_derivatives_are_those_of_sympy_in_forty_digits(point)


def require_values_and_derivatives_are_those_of_sympy_in_forty_digits(point):
    """All in one program, so that they share. A value has the errors of its sums: 8 roundings of the largest number inside."""
    expressions = [read(text) for text in TEXTS]
    slopes = [derivative(expression, symbol) for expression in expressions for symbol in symbols()]
    for expression, value in zip([*expressions, *slopes], values([*expressions, *slopes], point), strict=True):
        exact = many_digits(expression, point)
        inside = max([abs(float(many_digits(part, point))) for part in sympy.postorder_traversal(expression)])
        assert abs(float(exact - sympy.Rational(value))) <= 8.0 * 2.3e-16 * max(inside, abs(float(exact))), expression


@pytest.mark.parametrize("point", POINTS)
def test_the_same_without_compiled_code(point):
    """Oracle: the compiled program; the functions of both can differ in their last digit."""
    expressions = [read(text) for text in TEXTS]
    found = evaluate_program(program_of(expressions, symbols()), point)
    np.testing.assert_allclose(found, values(expressions, point), rtol=1e-15)


@pytest.mark.parametrize("text", [text for text in TEXTS if "abs" not in text])
def test_derivatives_are_those_of_a_complex_step(text):
    """Im f(x + ih)/h, with f by numpy from the text: no part of the program or of sympy's derivative is in it."""
    functions = {name: getattr(np, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh")}
    for point in POINTS:
        slopes = values([derivative(read(text), symbol) for symbol in symbols()], point)
        for k, slope in enumerate(slopes):
            moved = [complex(value, 1e-200 * (j == k)) for j, value in enumerate(point)]
            step = eval(text, functions, dict(zip(NAMES, moved, strict=True)))
            assert complex(step).imag / 1e-200 == pytest.approx(slope, rel=2e-14, abs=1e-15)


def test_the_derivative_of_a_modulus_is_the_sign():
    """Closed form, on both sides and at 0."""
    slope = derivative(read("abs(a - b)"), symbols()[0])
    assert [values([slope], (a, 1.0, 1.0))[0] for a in (0.5, 1.0, 3.0)] == [-1.0, 0.0, 1.0]


def test_what_expressions_share_is_computed_once():
    """Oracle: a + b, its square root, its square, and their quotient are four operations."""
    expressions = [read(text) for text in ("sqrt(a + b)/(a + b)**2", "a + b", "(a + b)**2", "2*(a + b)/2")]
    assert len(program_of(expressions, symbols()).code) <= 5
    assert values(expressions, (1.0, 3.0, 0.0)).tolist() == [0.125, 4.0, 16.0, 4.0]


BEYOND = [("log(a)", (-1.0, 0, 0)), ("1/b", (1.0, 0.0, 0)), ("exp(a)", (1e3, 0, 0)), ("sqrt(c)", (0, 0, -1.0))]


@pytest.mark.parametrize(("text", "point"), BEYOND)
def test_a_value_that_is_not_finite_is_reported(text, point):
    """Oracle: the domains of the functions and the largest float."""
    program = program_of([read("a"), read(text)], symbols())
    out, known = run(program, point)
    assert not known and not math.isfinite(out[1])
    assert not math.isfinite(evaluate_program(program, point)[1])


def test_what_cannot_be_computed_is_refused():
    """Oracle: gamma is none of the known functions."""
    with pytest.raises(ExpressionError, match=r"gamma\(a\) cannot be computed, expected sums"):
        program_of([sympy.gamma(symbols()[0])], symbols())


def test_decimals_are_exact_where_asked_for():
    """Oracle: 0.1 + 0.2 is 3/10, and not the sum of two floats."""
    assert parsed("0.1 + 0.2", "text", exact=True) == sympy.Rational(3, 10)
    assert float(parsed("0.1 + 0.2", "text")) == 0.1 + 0.2 != 0.3


LEAVES = st.sampled_from(["a", "b", "c", "2", "0.3", "7"])
TREES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*"]), inner).map(lambda parts: f"({' '.join(parts)})"),
        st.tuples(inner, inner).map(lambda parts: f"({parts[0]}/(({parts[1]})**2 + 1))"),
        st.tuples(inner, st.sampled_from([2, 3])).map(lambda parts: f"({parts[0]})**{parts[1]}"),
        st.tuples(st.sampled_from(["sin", "cos", "tanh", "abs"]), inner).map(lambda parts: f"{parts[0]}({parts[1]})"),
        inner.map(lambda part: f"sqrt(1 + ({part})**2)"),
    ),
    max_leaves=12,
)


@settings(max_examples=25, deadline=None)
@given(TREES, st.tuples(*[st.floats(0.1, 2.0)] * 3))
def test_random_expressions_are_those_of_python(text, point):
    """Oracle: Python's own arithmetic on the text, to the errors of the largest number inside."""
    expression = read(text)
    (value,) = values([expression], point)
    python = eval(text, {name: getattr(math, name) for name in ("sin", "cos", "tanh", "sqrt")}, dict(zip(NAMES, point, strict=True)))
    inside = max([abs(float(many_digits(part, point))) for part in sympy.postorder_traversal(sympy.expand(expression))])
    assert abs(value - python) <= 1e-13 * max(inside, 1.0)
