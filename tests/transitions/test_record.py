"""A record says what does not fit it."""

from __future__ import annotations

import numpy as np
import pytest

import saltus
from transitions.record import SampledMotion


def columns(**changed):
    """Columns of a record of four samples of two coordinates."""
    plain = {
        "times": [0.0, 0.5, 1.0, 1.5],
        "displacements": np.zeros((4, 2)),
        "velocities": np.zeros((4, 2)),
        **{name: np.zeros(4) for name in ("energy", "nes_energy", "lo_energy", "dissipated_nes", "dissipated_lo")},
        "impacts": [],
    }
    return {**plain, **changed}


def test_columns_are_kept_and_cannot_be_changed():
    """Oracle: the columns given."""
    u = np.arange(8.0).reshape(4, 2)
    record = SampledMotion(**columns(displacements=u, velocities=2.0 * u))
    w, rate = record.along((1.0, -1.0))
    assert record.step == 0.5 and record.degrees_of_freedom == 2
    np.testing.assert_array_equal(w, [-1.0] * 4)
    np.testing.assert_array_equal(rate, [-2.0] * 4)
    u[:] = 0.0
    assert record.displacements[1, 0] == 2.0
    with pytest.raises(ValueError, match="read-only"):
        record.energy[0] = 1.0
    with pytest.raises(ValueError, match="cannot set WRITEABLE flag"):
        record.energy.setflags(write=True)


@pytest.mark.parametrize(("start", "rest"), [(0.0, True), (1e-16, True), (1e-9, False), (0.5, False)])
@pytest.mark.parametrize("name", ["displacements", "velocities"])
def test_rest_is_a_state_that_is_rounding_of_the_motion(name, start, rest):
    """Oracle: by hand, beside a motion of size 1: 1e-16 is rounding, 1e-9 is not."""
    moving = {key: np.full((4, 2), 1.0) for key in ("displacements", "velocities")}
    for values in moving.values():
        values[0] = 0.0
    moving[name][0, 1] = start
    assert SampledMotion(**columns(**moving, energy=[1e-33, 1.0, 1.0, 1.0])).from_rest is rest


def test_a_translation_without_energy_is_rest():
    """Oracle: by definition; there is no energy to refer to."""
    rising = columns(displacements=np.ones((4, 2)), velocities=[[0, 0], [1, 1], [1, 1], [1, 1]], energy=[0, 1, 1, 1])
    assert SampledMotion(**rising).from_rest


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"times": [0.0, 0.5, 1.0, 1.6]}, "equal steps; received"),
        ({"times": [1.5, 1.0, 0.5, 0.0]}, "rise"),
        ({"times": [0.0]}, "two or more"),
        ({"displacements": np.zeros((3, 2))}, r"shape \(4, n\)"),
        ({"velocities": np.zeros((4, 3))}, r"shape \(4, 2\)"),
        ({"energy": np.zeros(3)}, r"energy .* shape \(4,\)"),
        ({"lo_energy": [0.0, np.nan, 0.0, 0.0]}, "lo_energy .* number 2 is not"),
        ({"impacts": [1.0, 0.5]}, "in order"),
        ({"nes_energy": "none"}, "numbers"),
        ({"times": ["0", "0.5", "1", "1.5"]}, "times of a record are numbers"),
        ({"energy": np.array([False, True, True, True])}, "energy of a record are numbers"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(changed, said):
    """Oracle: the words."""
    with pytest.raises(ValueError, match=said) as caught:
        SampledMotion(**columns(**changed))
    assert "\n" not in str(caught.value)


def test_a_gap_coordinate_of_another_system_is_refused():
    """Oracle: the number of entries."""
    with pytest.raises(ValueError, match="3 entries; the record has 2"):
        SampledMotion(**columns()).along((1.0, -1.0, 0.0))


RECORD, MOTION = SampledMotion(**columns()), saltus.simulate(saltus.vibro_impact_nes(), [0, 0], [0, 1], 1.0)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: saltus.stages_of("a.csv", (1, -1)), "the record: received 'a.csv', expected a SampledMotion such as saltus.sampled"),
        (lambda: saltus.stages_of(RECORD, (1, -1), ["S13+"]), "the families: received ['S13+'], expected a Families"),
        (lambda: saltus.stages_of(RECORD, (1, -1), start="S13+"), "the start: received 'S13+', expected a StartFamily"),
        (lambda: saltus.write_transition(RECORD, "a.csv"), "expected a Transition such as saltus.Transition("),
        (lambda: saltus.sampled(MOTION, None), "the sharing: received None, expected a Sharing such as saltus.sharing_of(system)"),
    ],
)
def test_objects_of_another_kind_are_named(call, said):
    """Oracle: the words, one line."""
    with pytest.raises(TypeError) as caught:
        call()
    assert said in str(caught.value) and "\n" not in str(caught.value)
