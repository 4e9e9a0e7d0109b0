"""Where test functions are sampled inside a step, and what is expected between two steps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from continuation.between import cubic_between, goes_aside
from continuation.control import may_hide
from continuation.resolution import Sampled, longest_division, nodes_around, scan, second_differences

NUMBERS = st.floats(-3.0, 3.0)


@given(st.lists(NUMBERS, min_size=4, max_size=4), st.floats(0.1, 2.0), st.floats(0.0, 1.0))
def test_a_cubic_is_found_again(coefficients, width, part):
    """Oracle: the cubic itself."""
    polynomial = np.polynomial.Polynomial(coefficients)
    slope = polynomial.deriv()
    low, high, out = 0.5, 0.5 + width, [0.0]
    s = low + part * width
    cubic_between([polynomial(low)], [slope(low)], [polynomial(high)], [slope(high)], low, high, s, out)
    assert out[0] == pytest.approx(polynomial(s), abs=1e-12 * (1.0 + np.abs(coefficients).sum() * high**3))


def test_a_step_of_another_direction_is_seen():
    """Oracle: by hand. The direction between two equal ones is theirs; one at right angles is far from it."""
    assert not goes_aside([1.0, 0.0], [1.0, 0.0], 0.5, [1.0, 0.1])
    assert goes_aside([1.0, 0.0], [1.0, 0.0], 0.5, [0.0, 1.0])
    assert not goes_aside([1.0, 0.0], [0.0, 1.0], 0.5, [0.2, 0.8])


PLACES = st.lists(st.floats(0.0, 1.0), min_size=2, max_size=12, unique=True).map(sorted)


@given(PLACES, st.data())
def test_nodes_are_the_nearest_places_that_are_not_too_near(places, data):
    """Oracle: a choice by brute force, and the second differences of a parabola, which are its leading coefficient."""
    j = data.draw(st.integers(0, len(places) - 2))
    least = 0.05 * (places[j + 1] - places[j])
    chosen = [0] * 4
    size = nodes_around(places, len(places), j, chosen)
    apart = [places[a] - places[b] for a, b in zip(chosen[1:size], chosen[: size - 1], strict=True)]
    assert min(apart) >= least and {j, j + 1} <= set(chosen[:size])
    before = [i for i in range(j) if places[j] - places[i] >= least]
    after = [i for i in range(j + 2, len(places)) if places[i] - places[j + 1] >= least]
    assert (not before or before[-1] in chosen[:size]) and (not after or after[0] in chosen[:size])
    if size == 4 and min(apart) > 1e-3:
        values = [3.0 + 2.0 * s - 5.0 * s * s for s in places]
        assert second_differences(places, values, chosen) == pytest.approx((-5.0, -5.0), abs=1e-6)


def plain_scan(places, rows, tests, zones=(), hidden=(), limit=math.inf, guard=False, floor=1e-9):
    size = len(places)
    settled = [[[0.0] * 4 for _ in range(8)] for _ in rows[0]], [0 for _ in rows[0]]
    sampled = Sampled(places, rows, zones, hidden, *settled, [0.0] * size, [0.0] * size, [0.0] * size, [0] * 4)
    functions = longest_division, may_hide, nodes_around, second_differences
    found = scan(*functions, sampled, tests, 0, limit, guard, floor)
    assert scan(*functions, sampled, tests, 0, limit, guard, floor) == found  # as it is settled
    return found


def test_what_needs_no_look_is_passed_over():
    """Oracle: by hand. A straight line has no second zero; a parabola that dips below zero has two. nan parts an interval."""
    places = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    line, near, change = [[2.0 + s, (s - 0.25) ** 2 - 1e-4, s - 0.33] for s in places], 1, 2
    assert plain_scan(places, line, [0])[0] == 1
    number, low, high, part = plain_scan(places, line, [0, near])
    assert (number, low, high) == (1, 0.2, pytest.approx(0.3)) and low + part * (high - low) == pytest.approx(0.25)
    number, low, high, _ = plain_scan(places, line, [0, change])
    assert number == 1 and not high > low
    assert plain_scan(places, line, [change], limit=0.3)[0] == 1
    assert plain_scan(places, line, [change], guard=True)[0] == 1
    unknown = [[math.nan if s == 0.2 else 2.0 + s] for s in places]
    number, low, high, part = plain_scan(places, unknown, [0])
    assert number == 0 and (low, high, part) == (0.1, 0.2, 0.5)
    number, low, high, _ = plain_scan(places, line, [change], zones=[(0.25, 0.45)], hidden=[[0.0, 0.0, 1.0]])
    assert number == 0 and not high > low
