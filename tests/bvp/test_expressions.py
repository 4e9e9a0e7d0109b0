"""Limits for expressions: what is too large is refused in one line, and what a system needs is not."""

import re
import time

import pytest
import sympy

from bvp import expressions
from bvp.expressions import MOST_TERMS, Size, TooLarge, limited, size_of_text
from bvp.lagrangian import LagrangianError
from bvp.system import ImpactSystem

X, Y, P = sympy.symbols("x y p")


def system(potential, **parameters):
    """A system of two coordinates with a potential energy."""
    return ImpactSystem.from_lagrangian("x_dot**2 + y_dot**2", potential, ["x", "y"], gaps=[("x", None, 1)], parameters=parameters)


@pytest.mark.parametrize(
    ("potential", "expected"),
    [
        ("((((2**20)**20)**20)**20)*x**2", "numbers could have more than 4096 bits"),
        ("((1.5**20)**20)*(((3/2)**20)**20)**20*x**2", "numbers could have more than 4096 bits"),
        ("((x+y+1)**20)**20", "multiplied out it could have more than 20000 terms"),
        ("(x+y+1)**20*(x-y+1)**20", "multiplied out it could have more than 20000 terms"),
        ("sin(exp(exp(20)))*x**2", "exp(exp(20)) is beyond all floats"),
        ("exp(exp(20))*x**2", "exp(exp(20)) is beyond all floats"),
        ("sin(exp(exp(p)))*x**2", "exp(exp(p)) is beyond all floats"),
        ("(10**20)**20*x**2", "is beyond all floats"),
        ("(x + y)**q", "multiplied out it could have more than 20000 terms"),
        ("x**2*1.00001**q", "numbers could have more than 4096 bits"),
        (X**2 * sympy.sin(sympy.exp(sympy.exp(20))), "exp(exp(20)) is beyond all floats"),
        (X**2 * (X + Y + P) ** 400, "multiplied out it could have more than 20000 terms"),
        (X**2 * sympy.Pow(7, 2000), "is beyond all floats"),
        (X**2 * sympy.Pow(sympy.Rational(1001, 1000), 1000), "numbers could have more than 4096 bits"),
    ],
)
def test_an_expression_without_measure_is_refused(potential, expected):
    """Oracle: by hand: bits of the powers, binomial coefficients, e^(e^20) = 10^(2.1e8)."""
    with pytest.raises(LagrangianError, match="the potential energy") as caught:
        system(potential, p=20, q=10**6)
    assert expected in str(caught.value) and "\n" not in str(caught.value)


def test_a_value_beyond_floats_is_one_line():
    """Oracle: 10^400 is beyond 1.8e308."""
    with pytest.raises(LagrangianError, match=re.escape("the potential energy is too large: p is beyond all floats")):
        system("p*x**2", p=10**400)


@pytest.mark.parametrize("text", ["x", "x + y", "(x + y)**2", "(x + y + 1)**20", "(x - 2*y)*(x + y + 3)", "x*(x + y)**3/7"])
def test_the_size_bounds_the_terms(text):
    """Oracle: sympy's own expansion."""
    import ast

    terms = len(sympy.Add.make_args(sympy.expand(sympy.sympify(text))))
    assert terms <= size_of_text(ast.parse(text, mode="eval")).terms <= MOST_TERMS


def test_bits_bound_the_numbers():
    """Oracle: Python's own numbers."""
    assert (3**20) ** 5 < 2 ** Size(1, (3).bit_length()).power(20).power(5).bits


def test_a_chain_with_all_couplings_is_read():
    """Oracle: the stiffness of springs between all pairs of 12 masses."""
    names = [f"q{k}" for k in range(12)]
    springs = " + ".join(f"({a} - {b})**2/2" for k, a in enumerate(names) for b in names[:k])
    found = ImpactSystem.from_lagrangian(" + ".join(f"{name}_dot**2/2" for name in names), springs, names, gaps=[("q0 - q1", -1, 1)])
    assert found.stiffness.diagonal().tolist() == [11.0] * 12 and found.stiffness[0, 1] == -1.0


def test_time_is_limited(monkeypatch):
    """Oracle: a block without an end."""
    import sys

    monkeypatch.setattr(expressions, "SECONDS", 0.05)
    with pytest.raises(TooLarge, match=r"^it: sympy has not read it within 0\.05 seconds$"), limited("it"):
        while True:
            time.monotonic()
    assert sys.getprofile() is None
    with pytest.raises(TooLarge, match="^it is too large to be read$"), limited("it"):
        raise OverflowError("too large to convert")
