"""Bracketing root finding. Oracles: roots in closed form; the bracket must hold the root; order of convergence."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from continuation.bracketing import StepRefused, bracketed_root

FUNCTIONS = [
    (lambda s: s**3 - 2, 2 ** (1 / 3), 0.0, 3.0),
    (lambda s: math.cos(s) - s, 0.7390851332151607, 0.0, 1.0),
    (lambda s: math.exp(s) - 5, math.log(5), 0.0, 4.0),
    (lambda s: math.tanh(50 * (s - 0.3)), 0.3, 0.0, 1.0),
    (lambda s: math.copysign(math.sqrt(abs(s - 0.4)), s - 0.4), 0.4, 0.0, 1.0),
]


@pytest.mark.parametrize(("function", "root", "low", "high"), FUNCTIONS)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8, 1e-12])
def test_brackets_the_root_to_the_tolerance(function, root, low, high, tolerance):
    found = bracketed_root(function, low, function(low), high, function(high), tolerance)
    assert found.high - found.low <= 1.001 * tolerance
    assert found.low - 1e-15 <= root <= found.high + 1e-15
    assert found.value == function(found.root)
    assert not found.interrupted


@pytest.mark.parametrize(("function", "root", "low", "high"), FUNCTIONS[:3])
def test_convergence_is_superlinear(function, root, low, high):
    """Oracle: the order: six more digits cost four calls at most; bisection needs 20."""
    calls = []
    for tolerance in (1e-6, 1e-12):
        asked = []
        bracketed_root(lambda s, asked=asked: asked.append(s) or function(s), low, function(low), high, function(high), tolerance)
        calls.append(len(asked))
    assert calls[1] <= 14 and calls[1] - calls[0] <= 4


@given(st.floats(0.01, 0.99), st.floats(0.1, 10), st.integers(0, 3), st.sampled_from([1.0, -1.0]))
def test_any_monotone_function_in_either_direction(root, steepness, power, sign):
    def function(s):
        return sign * ((s - root) * steepness + (s - root) ** (2 * power + 1))

    found = bracketed_root(function, 0.0, function(0.0), 1.0, function(1.0), 1e-12)
    assert abs(found.root - root) <= 1e-12
    assert found.low <= root + 1e-15 and root - 1e-15 <= found.high


def test_zero_at_an_end_is_exact():
    assert bracketed_root(lambda s: s, 0.0, 0.0, 1.0, 1.0, 1e-10).root == 0.0
    found = bracketed_root(lambda s: s - 1, 0.0, -1.0, 1.0, 0.0, 1e-10)
    assert (found.root, found.low, found.high) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("values", [(1.0, 2.0), (-1.0, -2.0), (math.nan, 1.0), (1.0, math.nan)])
def test_refuses_a_bracket_without_a_change_of_sign(values):
    with pytest.raises(ValueError, match="different sign"):
        bracketed_root(lambda s: s, 0.0, values[0], 1.0, values[1], 1e-10)


def test_tiny_values_of_different_sign_are_a_bracket():
    """The product of the ends underflows; the root is there all the same."""
    found = bracketed_root(lambda s: 1e-200 * (s - 0.25), 0.0, -0.25e-200, 1.0, 0.75e-200, 1e-10)
    assert abs(found.root - 0.25) <= 1e-10


def test_goes_round_a_place_where_the_function_is_refused():
    def function(s):
        if abs(s - 0.5) < 0.01:
            raise StepRefused("here")
        return s - 0.3

    found = bracketed_root(function, 0.0, -0.3, 1.0, 0.7, 1e-10)
    assert abs(found.root - 0.3) <= 1e-10 and not found.interrupted


def test_says_why_it_was_interrupted_and_keeps_its_bracket():
    def function(s):
        if 0.2 < s < 0.4:
            raise StepRefused("no curve there")
        return s - 0.3

    found = bracketed_root(function, 0.0, -0.3, 1.0, 0.7, 1e-10)
    assert found.interrupted == "no curve there"
    assert found.low <= 0.2 and found.high >= 0.4


def test_values_outside_the_bracket_save_calls():
    """Oracle: the root in closed form; inverse interpolation of fifth order needs two calls for 1e-10, and one for the other end."""
    root, asked = math.log(5), []
    known = [(s, math.exp(s) - 5) for s in (1.50, 1.55, 1.70, 1.75)]

    def function(s):
        asked.append(s)
        return math.exp(s) - 5

    found = bracketed_root(function, 1.60, math.exp(1.60) - 5, 1.65, math.exp(1.65) - 5, 1e-10, known=known)
    assert found.low <= root <= found.high and found.high - found.low <= 1e-10
    assert len(asked) == 3
    alone = len(asked)
    bracketed_root(function, 1.60, math.exp(1.60) - 5, 1.65, math.exp(1.65) - 5, 1e-10)
    assert len(asked) - alone > alone


def test_a_refused_place_is_not_tried_again():
    """Oracle: the places asked for, near a zero whose values are refused for being rounding."""
    refused = []

    def function(s):
        if abs(s - 0.3) < 3e-10:
            refused.append(s)
            raise StepRefused("rounding")
        return s - 0.3

    found = bracketed_root(function, 0.0, -0.3, 1.0, 0.7, 1e-10, coarse=1e-6)
    assert found.interrupted == "rounding" and found.low <= 0.3 <= found.high and found.high - found.low < 1e-8
    refused.sort()
    assert len(refused) > 1 and all(later - earlier >= 0.25e-10 for earlier, later in zip(refused, refused[1:], strict=False))
