"""Synthetic records. Oracles: the filters' transfer functions, the envelope, the shipped file."""

from importlib import resources

import numpy as np
import pytest

from bvp.forcing import Ground, filtered, record_text, synthetic_record
from saltus.scene.reading import read_record


@pytest.mark.parametrize("frequency", [0.3, 1.5, 9.0, 15.0, 25.0])
def test_a_tone_goes_through_the_filters_as_their_transfer_functions_say(frequency):
    """H = (w_g^2 + 2 i z_g w_g w)/(w_g^2 - w^2 + 2 i z_g w_g w) * -w^2/(w_f^2 - w^2 + 2 i z_f w_f w), after the transient; steps that are
    constant are half a step late, lose (w step)^2/24, and have overtones w step/(pi k) at 2 pi k/step +- w."""
    ground = Ground(15.0, 0.6, 1.5, 0.7)
    step = 0.003 / frequency
    times = step * np.arange(int(60.0 / step) if frequency < 5.0 else int(16.0 / step))
    found = filtered(np.cos(frequency * (times + 0.5 * step)), step, ground)
    w = frequency
    k = np.arange(1, 2000)

    def transfer(w):
        return (15.0**2 + 18.0j * w) / (15.0**2 - w**2 + 18.0j * w) * -(w**2) / (1.5**2 - w**2 + 2.1j * w)

    h = transfer(w)
    late = slice(int(0.9 * len(times)), None)
    overtones = float(np.sum(w * step / (np.pi * k) * np.abs(transfer(2.0 * np.pi * k / step - w))))
    np.testing.assert_allclose(found[late], (h * np.exp(1j * w * times)).real[late], rtol=0.0, atol=1e-6 * abs(h) + overtones)


def test_the_shipped_record_is_what_the_model_makes(tmp_path):
    """Oracle: the same seed; to the digits that are written. It begins and ends still, and its velocity does not drift."""
    times, values = synthetic_record(1)
    shipped = resources.files("catalogues").joinpath("three_storey_building_ground.csv")
    read = read_record(shipped, "acceleration", "here")
    np.testing.assert_allclose(read[0], times, atol=1e-12)
    np.testing.assert_allclose(read[1], values, atol=1e-6)
    assert values[0] == 0.0 and np.abs(values).max() == 3.0 and np.abs(values[-50:]).max() < 0.15
    velocity = np.cumsum(values) * 0.02
    assert abs(velocity[-1]) < 0.03 * np.abs(velocity).max()
    (tmp_path / "again.csv").write_text(record_text(times, values, "remark"))
    assert np.array_equal(read_record(tmp_path / "again.csv", "acceleration", "here"), read)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"peak": 0.0}, "peak"), ({"step": -1.0}, "step"), ({"duration": 0.001}, "one sample"), ({"rise": np.nan}, "rise")],
)
def test_values_that_cannot_be_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        synthetic_record(1, **options)
    with pytest.raises(ValueError, match="damping of the ground"):
        Ground(damping=0.0)
