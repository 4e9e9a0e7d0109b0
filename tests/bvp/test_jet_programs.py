"""Programs for the jets of forces. Oracles: Taylor coefficients and derivatives by mpmath in many digits; counts of products."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from bvp.expressions import ExpressionError
from bvp.jet_programs import even_power, jet_program, plain_powers, signed_power
from bvp.programs import evaluate_program, program_of
from tests.lab.programs import DIVIDE, MULTIPLY, SQUARE
from tests.lab.programs import taylor as taylor_of_program

A, B, P, Q = sympy.symbols("a b p q", real=True)
ORDER, RADIUS = 7, 0.25
MOTIONS = ((0.7, -0.3, 0.2, 0.1, -0.05), (-0.4, 0.5, 0.1, -0.2, 0.03))
"""Polynomials in time of the two inputs."""
VALUES = (2.5, 0.7)
"""Of the parameters."""


def jets_of(program, motions=MOTIONS, order=ORDER):
    """The coefficients of all registers."""
    return taylor_of_program(program, motions, order)


def taylor(expression, parameters=(), values=(), motions=MOTIONS):
    """The coefficients of an expression along the motions, in thirty digits."""
    function = sympy.lambdify([A, B, *parameters], plain_powers(expression), "mpmath")

    def along(t):
        return function(*(sum(mpmath.mpf(c) * t**k for k, c in enumerate(motion)) for motion in motions), *map(mpmath.mpf, values))

    with mpmath.workdps(30):
        return [float(c) for c in mpmath.taylor(along, 0, ORDER)]


def require_close(jets, register, exact):
    """Within 100 roundings of the largest register, at a time inside the circle of convergence."""
    weights = RADIUS ** np.arange(ORDER + 1)
    scale = np.abs(jets * weights).max()
    assert np.abs((jets[register] - exact) * weights).max() <= 100 * 2.3e-16 * scale


FUNCTIONS = [
    lambda x, y: x + y,
    lambda x, y: x - y / 3,
    lambda x, y: x * y,
    lambda x, y: x * (y + 2),
    lambda x, y: x / (2 + y**2),
    lambda x, y: 1 / (3 + sympy.sin(x)) ** 2,
    lambda x, y: x**2 - y**3,
    lambda x, y: x**5 * 0.1 + 2 * y,
    lambda x, y: sympy.sin(x) + y,
    lambda x, y: sympy.cos(x + y) * P,
    lambda x, y: sympy.tan(sympy.sin(x) / 2),
    lambda x, y: sympy.exp(sympy.sin(y)) - P * x,
    lambda x, y: sympy.log(2 + x**2),
    lambda x, y: sympy.sqrt(1 + x**2) + y,
    lambda x, y: (1 + x**2) ** -P,
    lambda x, y: sympy.sinh(sympy.sin(x)) * y,
    lambda x, y: sympy.cosh(sympy.sin(x)) + y,
    lambda x, y: sympy.tanh(x) * Q,
    lambda x, y: 2 ** sympy.sin(y) + x,
]
EXPRESSIONS = st.recursive(
    st.sampled_from([A, B, A + 1, B / 2, sympy.Rational(3, 2), signed_power(A, P), even_power(B, P + 1), signed_power(B, 3.3)]),
    lambda inner: st.builds(lambda f, x, y: f(x, y), st.sampled_from(FUNCTIONS), inner, inner),
    max_leaves=5,
)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.lists(EXPRESSIONS, min_size=1, max_size=2))
def test_jets_of_random_compositions(forces):
    """Oracle: mpmath's Taylor coefficients of the forces, and of sympy's derivatives by inputs and parameters."""
    forces = [sympy.sympify(force) for force in forces]
    program, _ = jet_program(forces, [A, B], [P, Q], VALUES)
    jets = jets_of(program)
    for force, register in zip(forces, program.forces, strict=True):
        require_close(jets, register, taylor(force, [P, Q], VALUES))
    for rows, symbols in ((program.slopes, (A, B)), (program.changes, (P, Q))):
        for row, column, register in rows:
            require_close(jets, register, taylor(forces[row].diff(symbols[column]), [P, Q], VALUES))
        given_places = {(row, column) for row, column, _ in rows}
        for row, force in enumerate(forces):
            for column, symbol in enumerate(symbols):
                assert (row, column) in given_places or force.diff(symbol).equals(0)


@pytest.mark.parametrize("force", [signed_power(A, P), even_power(A, P) * B, Q * signed_power(A - B, 2 * P) + B**3])
def test_derivatives_of_real_powers(force):
    """Oracle: mpmath's numerical derivatives of the expression of moduli, by inputs and exponents, in forty digits."""
    program, _ = jet_program([force], [A, B], [P, Q], VALUES)
    jets = jets_of(program)
    function = sympy.lambdify([A, B, P, Q], plain_powers(force), "mpmath")
    point = (MOTIONS[0][0], MOTIONS[1][0], *VALUES)
    with mpmath.workdps(40):
        for rows, first in ((program.slopes, 0), (program.changes, 2)):
            for _, column, register in rows:
                order = [int(k == first + column) for k in range(4)]
                exact = float(mpmath.diff(function, tuple(map(mpmath.mpf, point)), tuple(order)))
                assert abs(jets[register, 0] - exact) <= 4e-15 * abs(exact)


def test_a_power_and_its_slope_share_their_products():
    """Oracle: 21 = 20 + 1, 20 = 2 2 5, 5 = 4 + 1: six products, of which the slope needs no other."""
    program, _ = jet_program([A**21 / 3], [A])
    assert sum(program.code[:, 0] == MULTIPLY) == 2 and sum(program.code[:, 0] == SQUARE) == 4 and len(program.code) == 8


@pytest.mark.parametrize("p", [3, 4, 6, 7, 12, 15, 41, 201])
def test_a_power_needs_few_products(p):
    """Oracle: w^(p - 1) by squares and products needs at most two for each binary digit, and the power itself one more."""
    program, _ = jet_program([A**p], [A])
    assert sum(program.code[:, 0] != 5) <= 2 * (p - 1).bit_length()
    jets = jets_of(program)
    require_close(jets, program.forces[0], taylor(A**p))
    require_close(jets, program.slopes[0, 2], taylor(p * A ** (p - 1)))


def test_a_sine_and_its_slope_are_one_operation():
    program, _ = jet_program([sympy.sin(A)], [A])
    assert len(program.code) == 1 and program.forces[0] == 1 and program.slopes.tolist() == [[0, 0, 2]]


def test_linear_and_constant_forces():
    """Oracle: a line has a constant slope and no slope by the other input."""
    program, _ = jet_program([3 * A + 1, sympy.Integer(0), B], [A, B])
    jets = jets_of(program)
    assert jets[program.forces[0], 0] == 3 * 0.7 + 1 and not jets[program.forces[1]].any() and program.forces[2] == 1
    assert program.slopes[:, :2].tolist() == [[0, 0], [2, 1]] and not (program.code[:, 0] == DIVIDE).any()
    assert jets[program.slopes[0, 2]].tolist() == [3.0] + [0.0] * ORDER and jets[program.slopes[1, 2], 0] == 1.0


def test_a_real_power_and_its_changes_are_zero_where_the_input_is():
    """Oracle: |w|^p log |w| tends to 0. No coefficient is NaN there."""
    program, _ = jet_program([Q * signed_power(A, P)], [A], [P, Q], VALUES)
    jets = jets_of(program, ((0.0, 1.0, 0.3),))
    assert len(program.changes) == 2
    for register in [program.forces[0], *program.slopes[:, 2], *program.changes[:, 2]]:
        assert not jets[register].any()


def test_other_values_of_parameters_need_no_other_program():
    """Oracle: the program made at these values."""
    force = Q * signed_power(A, 2 * P + 1) + sympy.cos(P) * sympy.sin(A * Q)
    program, numbers = jet_program([force], [A], [P, Q], VALUES)
    other, _ = jet_program([force], [A], [P, Q], (3.1, 0.2))
    program.numbers[:] = evaluate_program(numbers, (3.1, 0.2))
    assert np.array_equal(program.code, other.code) and np.array_equal(program.numbers, other.numbers)
    assert np.array_equal(jets_of(program, MOTIONS[:1]), jets_of(other, MOTIONS[:1]))


def test_powers_of_moduli_that_are_smooth_are_products():
    """Oracle: sympy's powers."""
    assert signed_power(A, 3.0) == A**3 and even_power(A, 4) == A**4 and signed_power(A, 1) == A and even_power(A, 0) == 1
    assert signed_power(A, 2) != A**2 and even_power(A, 3) != A**3
    plain = [plain_powers(power) for power in (signed_power(A, 2), even_power(A, 3))]
    assert evaluate_program(program_of(plain, [A]), [-1.5]).tolist() == [-2.25, 3.375]


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (A + sympy.Symbol("z"), "force 1 has the symbol z, which is neither an input nor a parameter (a, p)"),
        (sympy.erf(A), "erf(a) has no Taylor series here, expected sums, products, powers and sqrt, exp, log"),
        (sympy.Abs(A) ** 3, "Abs(a) has no Taylor series here"),
        (sympy.sign(A), "sign(a) has no Taylor series here"),
    ],
)
def test_what_has_no_series_is_refused(force, message):
    with pytest.raises(ExpressionError) as error:
        jet_program([force], [A], [P], [1.0])
    assert message in str(error.value)


def test_forces_without_inputs_are_refused():
    with pytest.raises(ExpressionError, match="smooth forces have at least one input; received none"):
        jet_program([], [])
