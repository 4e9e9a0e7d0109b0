"""A record says what does not fit it."""

from __future__ import annotations

import numpy as np
import pytest

from bvp.damped import run
from bvp.system import vibro_impact_nes
from transitions.record import Record, record_of


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
    record = Record(**columns(displacements=u, velocities=2.0 * u))
    w, rate = record.along((1.0, -1.0))
    assert record.step == 0.5 and record.duration == 1.5 and record.degrees_of_freedom == 2
    np.testing.assert_array_equal(w, [-1.0] * 4)
    np.testing.assert_array_equal(rate, [-2.0] * 4)
    u[:] = 0.0
    assert record.displacements[1, 0] == 2.0
    with pytest.raises(ValueError, match="read-only"):
        record.energy[0] = 1.0


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"times": [0.0, 0.5, 1.0, 1.6]}, "uniform; received"),
        ({"times": [1.5, 1.0, 0.5, 0.0]}, "rise"),
        ({"times": [0.0]}, "two or more"),
        ({"displacements": np.zeros((3, 2))}, r"shape \(4, n\)"),
        ({"velocities": np.zeros((4, 3))}, r"shape \(4, 2\)"),
        ({"energy": np.zeros(3)}, r"energy .* shape \(4,\)"),
        ({"lo_energy": [0.0, np.nan, 0.0, 0.0]}, "lo_energy .* number 2 is not"),
        ({"impacts": [1.0, 0.5]}, "in order"),
        ({"nes_energy": "none"}, "numbers"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(changed, said):
    """Oracle: the words."""
    with pytest.raises(ValueError, match=said) as caught:
        Record(**columns(**changed))
    assert "\n" not in str(caught.value)


def test_a_gap_coordinate_of_another_system_is_refused():
    """Oracle: the number of entries."""
    with pytest.raises(ValueError, match="3 entries; the record has 2"):
        Record(**columns()).along((1.0, -1.0, 0.0))


def test_a_run_becomes_a_record_that_loses_nothing():
    """Oracle: the run's own samples, energies and balance; with a damper across the gap, that is the sink's."""
    motion = run(vibro_impact_nes(lam=0.02, rho=0.8), [0.0, 0.0], [0.3, 1.5], 60.0)
    record = record_of(motion, 0.04)
    u, v = motion.sample(record.times)
    np.testing.assert_array_equal(record.displacements, u)
    np.testing.assert_array_equal(record.velocities, v)
    np.testing.assert_allclose(record.energy, motion.system.energy(u, v), rtol=1e-13)
    np.testing.assert_allclose(record.nes_energy, 0.5 * (0.1 * v[:, 0] ** 2 + 0.1 * (u[:, 0] - u[:, 1]) ** 2), rtol=1e-12)
    np.testing.assert_allclose(record.energy + record.dissipated_nes + record.dissipated_lo, record.energy[0], rtol=1e-12)
    assert record.dissipated_nes[-1] == pytest.approx(motion.dissipated["stop a"], rel=1e-12)
    assert record.dissipated_lo[-1] == pytest.approx(motion.dissipated["rest"], rel=1e-12)
    assert len(record.impacts) == motion.impacts and record.impacts[-1] == motion.last_impact


def test_a_run_that_cannot_be_a_record_is_told_in_one_line():
    """Oracle: the words."""
    system = vibro_impact_nes(lam=0.02, rho=0.8)
    motion = run(system, [0.0, 0.0], [0.3, 1.5], 5.0)
    for step in (0.0, -1.0, 6.0):
        with pytest.raises(ValueError, match="step of a record"):
            record_of(motion, step)
    with pytest.raises(ValueError, match="named oil"):
        record_of(run(system, [0.0, 0.0], [0.3, 1.5], 5.0, dampers={"oil": system.damping}), 0.1)
