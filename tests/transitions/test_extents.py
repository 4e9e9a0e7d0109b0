"""Peaks and root mean squares of motions. Oracles: closed forms of free vibration, decay and bouncing; dense samples."""

import math

import numpy as np
import pytest

from bvp.forcing import Constant, Harmonic, Record
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from transitions.record import extents


def oscillator(c, upper=100.0):
    return ImpactSystem([[1.0]], [[c]], [[1.0]], (Stop((1.0,), -upper, upper, 0.5),))


def test_free_vibration_and_its_decay():
    """u = sin t: peak 1 at pi/2, rms over a period 1/sqrt 2; damped: the first turning point, and integral of u^2 of the closed form."""
    found = extents(simulate(oscillator(0.0), [0.0], [1.0], 2.0 * math.pi))
    assert found.peaks[0] == pytest.approx(1.0, rel=1e-14) and found.times[0] == pytest.approx(math.pi / 2, rel=1e-7)
    assert found.rms[0] == pytest.approx(math.sqrt(0.5), rel=1e-14)
    c = 0.4
    a, w = c / 2, math.sqrt(1.0 - c * c / 4)
    turn = math.atan2(w, a) / w
    found = extents(simulate(oscillator(c), [0.0], [1.0], 60.0))
    assert found.times[0] == pytest.approx(turn, rel=1e-7)
    assert found.peaks[0] == pytest.approx(math.exp(-a * turn) * math.sin(w * turn) / w, rel=1e-14)
    # integral of exp(-2 a t) sin(w t)^2/w^2 over 0 <= t < infinity: 1/(4 a (a^2 + w^2))
    assert found.rms[0] == pytest.approx(math.sqrt(1.0 / (4.0 * a) / 60.0), rel=1e-9)


def test_a_bouncing_ball_is_highest_at_its_start():
    """Peak h at time 0; the integral of u^2 over one fall from 1/2, u = 1/2 - t^2/2: 2/15."""
    ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], (Stop((1.0,), lower=0.0, restitution=0.5),))
    found = extents(simulate(ball, [0.5], [0.0], 1.0, forces=Constant([-1.0])))
    assert found.peaks[0] == 0.5 and found.times[0] == 0.0
    assert found.rms[0] == pytest.approx(math.sqrt(2.0 / 15.0), rel=1e-14)


@pytest.mark.parametrize("rho", [1.0, 0.7, 0.0])
@pytest.mark.parametrize("forced", ["free", "harmonic", "record"])
def test_no_sample_lies_beyond_a_peak(rho, forced):
    """Dense samples come within their own spacing of the peaks, and never beyond; their mean squares converge to the exact ones."""
    rng = np.random.default_rng(5)
    forces = {
        "free": None,
        "harmonic": Harmonic(0.9, cosine=[0.0, 0.3]),
        "record": Record([0.1, 1.0], np.linspace(0.0, 30.0, 61), rng.normal(size=61)),
    }[forced]
    motion = simulate(vibro_impact_nes(lam=0.02, rho=rho), [0.1, 0.0], [0.3, 2.0], 40.0, forces=forces)
    rows = [[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]]
    found = extents(motion, rows)
    times = np.linspace(0.0, 40.0, 160_001)
    u, _ = motion.sample(times)
    values = u @ np.transpose(rows)
    sampled = np.abs(values).max(axis=0)
    assert np.all(sampled <= found.peaks * (1.0 + 1e-13)) and np.all(sampled >= found.peaks - 2e-3)
    np.testing.assert_allclose(found.peaks[:2], motion.peaks, rtol=1e-15)
    at, _ = motion.sample(found.times)
    np.testing.assert_allclose(np.abs(np.einsum("rn,rn->r", at, rows)), found.peaks, rtol=1e-12)
    np.testing.assert_allclose(found.rms, np.sqrt(np.trapezoid(values**2, times, axis=0) / 40.0), rtol=1e-6)
    if rho > 0.0:
        assert found.peaks[2] == pytest.approx(1.0, abs=1e-13)


def test_rows_of_another_length_are_refused():
    with pytest.raises(ValueError, match="2 coordinates"):
        extents(simulate(vibro_impact_nes(), [0.0, 0.0], [0.0, 1.0], 1.0), [[1.0, 0.0, 0.0]])


@pytest.mark.parametrize("w", [1.2, 1.03])
def test_peaks_beside_a_resonance(w):
    """A ring of five oscillators under a wave, at rest at first: near the resonance of the wave, loads and modes are large and cancel.
    Oracle: dense samples, between which a peak exceeds them by no more than the bend of the motion allows."""
    ring = 1.1 * np.eye(5) - 0.05 * (np.roll(np.eye(5), 1, axis=0) + np.roll(np.eye(5), -1, axis=0))
    system = ImpactSystem(0.98 * np.eye(5), 0.002 * np.eye(5), ring, (Stop(tuple(np.eye(5)[0]), upper=500.0, restitution=0.8),))
    phases = 2.0 * math.pi * np.arange(5) / 5
    forces = [Harmonic(w, math.cos(p) * row, -math.sin(p) * row) for p, row in zip(phases, np.eye(5), strict=True)]
    motion = simulate(system, np.zeros(5), np.zeros(5), 7.0, forces=forces)
    found = extents(motion)
    times = np.linspace(0.0, 7.0, 7001)
    sampled = np.abs(motion.sample(times)[0])
    assert np.all(sampled.max(axis=0) <= found.peaks * (1.0 + 1e-14)) and np.all(found.peaks - sampled.max(axis=0) < 1e-6 * found.peaks)
    assert np.abs(found.times - times[np.argmax(sampled, axis=0)]).max() <= 1e-3
    np.testing.assert_allclose(found.peaks, motion.peaks, rtol=1e-15)
    assert motion.balance_error < 1e-14


def test_of_equal_peaks_the_first_has_the_time():
    """Oracle: |sin t| is 1 at pi/2, 3 pi/2, ..."""
    found = extents(simulate(oscillator(0.0), [0.0], [1.0], 40.0))
    assert found.times[0] == pytest.approx(math.pi / 2, rel=1e-7)


def test_a_wave_that_has_not_come_yet_is_rounding():
    """A chain of 18 masses at rest, with a load and a stop at its end: the far ones hardly move at first. Oracle: dense samples."""
    n = 18
    stiffness = 1e4 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    system = ImpactSystem(0.1 * np.eye(n), 1e-5 * stiffness, stiffness, (Stop(tuple(np.eye(n)[-1]), upper=1e-4, restitution=0.7),))
    motion = simulate(system, np.zeros(n), np.zeros(n), 0.03, forces=Harmonic(50.0, 10.0 * np.eye(n)[-1]))
    found = extents(motion)
    u = np.abs(motion.sample(np.linspace(0.0, 0.03, 20001))[0]).max(axis=0)
    assert motion.impacts > 5 and np.all(found.peaks >= (1.0 - 1e-12) * u)
    np.testing.assert_allclose(found.peaks, u, rtol=1e-6)
