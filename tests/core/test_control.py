"""Step control of the core.

Oracle: the rules in plain Python (`tests.lab.control`), to the last bit but for the arcsine of `arclength_of`.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branches.kernels.brackets import may_hide
from continuation import Settings, control
from tests.lab import control as plain

numbers = st.floats(-1e3, 1e3)
values = st.one_of(numbers, st.just(math.nan), st.just(0.0))
lengths = st.floats(1e-6, 1.0)


@given(st.floats(-1.0, 1.0), st.one_of(st.floats(0.0, 2.0), st.just(math.nan)), st.floats(0.0, 1.0), lengths)
def test_steps_are_judged_and_chosen_alike(turn, contraction, chord, ds):
    chosen = control.control_of(Settings())
    assert control.refusal(turn, contraction, chord, ds, chosen) == plain.refusal(turn, contraction, chord, ds, chosen)
    if contraction == contraction:
        assert control.next_step(ds, turn, contraction, chosen) == plain.next_step(ds, turn, contraction, chosen)
    assert control.arclength_of(chord, turn) == pytest.approx(plain.arclength_of(chord, turn), rel=1e-15, abs=0.0)


@given(st.lists(numbers, min_size=1, max_size=9), st.randoms())
def test_distances_and_heights(position, random):
    goal, direction = ([random.uniform(-9.0, 9.0) for _ in position] for _ in range(2))
    assert control.distance(position, goal) == plain.distance(position, goal)
    assert control.height(position, goal, direction) == plain.height(position, goal, direction)


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans(), values, values, values, values), max_size=4), lengths, lengths, lengths)
def test_the_same_steps_are_searched(tests, first, before, last):
    kinds, singular = [test[0] for test in tests], [1e-5 * test[1] for test in tests]
    points = [[test[k] for test in tests] for k in range(2, 6)]
    for step in range(3):
        expected = plain.watch(kinds, singular, may_hide, *points, first, before, last, step)
        assert control.watch(kinds, singular, points, (first, before, last), step) == expected


@given(st.floats(1e-6, 1e3), st.floats(1e-6, 1e3), lengths, numbers, numbers, st.sampled_from([1.0, -1.0]))
def test_two_zeros_hide_in_the_same_intervals(a, b, length, bend, beside, sign):
    assert control.may_hide(sign * a, sign * b, length, bend, beside) == may_hide(sign * a, sign * b, length, bend, beside)
