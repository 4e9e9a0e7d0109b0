"""The curve of impulsive motions: dominant frequency against energy.

Oracles: tones of known frequency; the closed form of the linear motion below the first impact; periodic impulsive orbits, whose
spectrum has lines at the multiples of 2 pi/T alone.
"""

import json
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from branches.search import impulsive_motions as module
from branches.search.impulsive_motions import dominant_frequency, impulsive_manifold, peak_at
from branches.search.impulsive_orbits import impulsive_orbits
from bvp.motion import MotionStatus
from bvp.system import vibro_impact_nes

SYSTEM = vibro_impact_nes()


@given(
    frequency=st.floats(0.2, 3.0),
    phase=st.floats(0.0, 6.3),
    size=st.floats(1e-6, 1e6),
    mean=st.floats(-1.0, 1.0),
    count=st.integers(2000, 6000),
)
def test_a_tone(frequency, phase, size, mean, count):
    """Oracle: its own frequency, to a millionth, whatever its size, phase and mean; at least 30 periods."""
    times = np.arange(count) * 0.5
    assert abs(dominant_frequency(size * (np.sin(frequency * times + phase) + mean), 0.5) / frequency - 1.0) < 1e-6


def test_the_larger_of_two_tones():
    """Oracle: the frequency of the larger, with the other one eight lines away; and of the other one once it is larger."""
    duration, count = 1000.0, 20000
    times = np.arange(count) * (duration / count)
    first, second = 1.0, 1.0 + 8.3 * 2.0 * np.pi / duration
    for a, b, expected in ((1.0, 0.9, first), (0.9, 1.0, second)):
        signal = a * np.cos(first * times) + b * np.sin(second * times)
        assert abs(dominant_frequency(signal, duration / count) - expected) < 0.02 * 2.0 * np.pi / duration


def test_what_does_not_vary():
    """Oracle: 0 for a constant."""
    assert dominant_frequency(np.full(100, 3.7), 0.1) == 0.0


@pytest.mark.parametrize("energy", [(0.0, 1.0), (1.0, math.inf), (2.0, 1.0)])
def test_a_range_that_cannot_be_followed(energy):
    """Oracle: the message has the range."""
    with pytest.raises(ValueError, match="energy range {:g}:{:g}.*expected 0 < LO < HI < inf".format(*energy)):
        impulsive_manifold(SYSTEM, energy)


@pytest.mark.parametrize(("mu", "sigma"), [(0.1, 0.1), (0.4, 0.9)])
def test_without_impacts_it_is_the_linear_spectrum(mu, sigma):
    """Oracle: w = sum b_k phi_k v sin(w_k t)/w_k: the mode with the larger amplitude, below h = sigma/2 where nothing hits."""
    system = vibro_impact_nes(mu=mu, sigma=sigma)
    curve = impulsive_manifold(system, (0.005 * sigma, 0.499 * sigma), density=3)
    modes = system.modes
    amplitudes = np.abs(np.array([1.0, -1.0]) @ modes.shapes * modes.shapes[1] / modes.frequencies)
    expected = modes.frequencies[int(np.argmax(amplitudes))]
    assert np.max(np.abs(curve.frequency / expected - 1.0)) < 1e-6
    assert np.ptp(curve.frequency) < 1e-12 and not curve.breaks.any() and not curve.failed


def test_at_a_periodic_orbit_it_is_a_multiple_of_its_frequency():
    """Oracle: 2 pi/T of stable periodic impulsive orbits; on the tongues of high energy the multiple is m/2 or m, as the gap closes."""
    found = [orbit for orbit in impulsive_orbits(SYSTEM, (0.1, 9.0), quarter_period=3.4).orbits if orbit.orbit.stable]
    assert len(found) > 4
    for orbit in found:
        ratio = peak_at(SYSTEM, orbit.h)[0] / (0.5 * math.pi / orbit.alpha)
        assert abs(ratio - round(ratio)) < 1e-4 * ratio and round(ratio) > 0, orbit.label


def test_jumps_are_kept():
    """Oracle: the values themselves: between S31O11, where the curve stays at three times 2 pi/T, and what follows it is a jump, and
    no two joined neighbours are further apart than a power law of exponent one and a line of the spectrum."""
    curve = impulsive_manifold(SYSTEM, (1.5, 2.8), density=60)
    assert 0 < curve.breaks.sum() < len(curve.h) // 2 and np.all(np.diff(curve.h) > 0.0)
    plateau = curve.h < 1.9
    assert np.ptp(curve.frequency[plateau]) < 0.01 and not curve.breaks[plateau[1:]].any()
    steps = np.abs(np.diff(curve.frequency))
    allowed = np.maximum(curve.frequency[1:], curve.frequency[:-1]) * np.diff(np.log(curve.h)) + 1.0 / 200.0
    assert np.all(steps[~curve.breaks] <= allowed[~curve.breaks] + 1e-15) and np.all(steps[curve.breaks] > allowed[curve.breaks])


def test_a_motion_that_fails_is_reported(monkeypatch):
    """Oracle: null in the record, the reason beside it, a break around it, for a run that is made to give up at some energies."""
    real = module.simulate

    def giving_up(system, u, v, duration, max_impacts):
        motion = real(system, u, v, duration, max_impacts=max_impacts)
        if 1.0 < 0.5 * v[1] ** 2 < 2.0:
            object.__setattr__(motion, "status", MotionStatus.EXHAUSTED)
        return motion

    monkeypatch.setattr(module, "simulate", giving_up)
    curve = impulsive_manifold(SYSTEM, (0.5, 4.0), density=10, periods=20)
    inside = (curve.h > 1.0) & (curve.h < 2.0)
    assert np.isnan(curve.frequency[inside]).all() and np.isfinite(curve.frequency[~inside]).all()
    assert len(curve.failed) == inside.sum() and re.match("the motion ends at .* of .*gave up", curve.failed[0][1])
    record = json.loads(json.dumps(curve.record(), allow_nan=False))
    assert [value is None for value in record["frequency"]] == inside.tolist()
    edges = np.flatnonzero(np.isnan(curve.frequency[1:]) | np.isnan(curve.frequency[:-1]))
    assert set(edges) <= set(record["breaks"]) and record["window"] == "Hann" and record["periods"] == 20
