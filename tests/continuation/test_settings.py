"""Settings are checked when made, and say which field is wrong."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from continuation import Settings, SettingsError

FIELDS = [field.name for field in dataclasses.fields(Settings)]


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("value", [0, -1.0, math.nan, math.inf, "0.1", None, True])
def test_refuses_values_that_are_no_positive_finite_numbers_and_names_the_field(name, value):
    with pytest.raises(SettingsError, match=rf"^{name} = ") as error:
        Settings(**{name: value})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ({"minimum_step": 0.1}, ("minimum_step", "initial_step")),
        ({"initial_step": 0.5}, ("initial_step", "maximum_step")),
        ({"target_turn": 0.5}, ("target_turn", "maximum_turn")),
        ({"target_contraction": 0.6}, ("target_contraction", "maximum_contraction")),
        ({"location_tolerance": 1e-3}, ("location_tolerance", "coincidence_tolerance")),
        ({"maximum_turn": 1.6}, ("maximum_turn",)),
        ({"maximum_contraction": 1.0}, ("maximum_contraction",)),
        ({"maximum_growth": 1.0}, ("maximum_growth",)),
        ({"maximum_points": 10.5}, ("maximum_points",)),
    ],
)
def test_refuses_contradictions_and_names_all_fields_of_it(values, names):
    with pytest.raises(SettingsError) as error:
        Settings(**values)
    assert all(name in str(error.value) for name in names)


def test_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().initial_step = 1.0


@given(st.floats(1e-6, 1.0), st.floats(1.0, 10.0), st.floats(1.0, 10.0))
def test_accepts_steps_in_order(minimum, first, second):
    settings = Settings(minimum_step=minimum, initial_step=minimum * first, maximum_step=minimum * first * second)
    assert settings.minimum_step <= settings.initial_step <= settings.maximum_step
