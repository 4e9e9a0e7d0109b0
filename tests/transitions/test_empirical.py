"""Empirical mode decomposition: tones that are known, what sums to what, and the package that may be missing."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from transitions.frequencies import NotInstalled, decompose

TIMES = 0.02 * np.arange(10_000)


def test_two_tones_are_two_modes_with_their_frequencies_and_amplitudes():
    """Oracle: the tones; the index by its double sum."""
    modes = decompose(TIMES, np.cos(4.0 * TIMES) + 1.5 * np.cos(0.9 * TIMES + 0.4))
    assert modes.mean_frequencies[:2] == pytest.approx([4.0, 0.9], rel=0.01)
    middle = slice(2000, 8000)
    for k, (tone, frequency, amplitude) in enumerate(((np.cos(4.0 * TIMES), 4.0, 1.0), (1.5 * np.cos(0.9 * TIMES + 0.4), 0.9, 1.5))):
        assert np.abs(modes.functions[k] - tone)[middle].max() < 0.05
        assert np.median(modes.frequencies[k][middle]) == pytest.approx(frequency, rel=0.01)
        assert np.median(modes.amplitudes[k][middle]) == pytest.approx(amplitude, rel=0.02)
    parts = [*modes.functions, modes.residue]
    pairs = sum(float(parts[i] @ parts[j]) for i in range(len(parts)) for j in range(len(parts)) if i != j)
    whole = sum(parts)
    assert modes.orthogonality == pytest.approx(pairs / float(whole @ whole), rel=1e-9)


def test_the_frequency_of_a_chirp_is_the_rate_of_its_phase():
    """Oracle: the derivative of the phase, to 2 % away from the ends."""
    frequency = np.exp(TIMES / 150.0)
    modes = decompose(TIMES, np.sin(150.0 * (frequency - 1.0)))
    middle = slice(1000, 9000)
    assert np.abs(modes.frequencies[0] / frequency - 1.0)[middle].max() < 0.02


def test_the_parts_sum_to_the_signal():
    """Oracle: the signal, to rounding."""
    random = np.random.default_rng(2)
    times = TIMES[:3000]
    signal = np.cumsum(random.standard_normal(len(times))) + 0.1 * times
    for most in (None, 1, 3):
        modes = decompose(times, signal, most=most)
        np.testing.assert_allclose(modes.functions.sum(axis=0) + modes.residue, signal, rtol=0.0, atol=1e-9 * np.abs(signal).max())
        assert modes.frequencies.shape == modes.amplitudes.shape == modes.functions.shape
        if most is not None:
            assert len(modes.functions) <= most + 1


@pytest.mark.parametrize("factor", [2.0**-40, 1e-4, 1e6])
def test_no_length_is_built_in(factor):
    """Oracle: the decomposition is homogeneous: a signal in other units has the same modes in those, and the same frequencies."""
    signal = np.cos(4.0 * TIMES) + 1.5 * np.cos(0.9 * TIMES + 0.4)
    one, other = decompose(TIMES, signal), decompose(TIMES, factor * signal)
    assert other.functions.shape == one.functions.shape
    np.testing.assert_allclose(other.functions / factor, one.functions, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(other.mean_frequencies, one.mean_frequencies, rtol=1e-9)
    assert other.orthogonality == pytest.approx(one.orthogonality, rel=1e-9)


def test_a_missing_package_is_reported_in_one_line(monkeypatch):
    """Oracle: the words."""
    monkeypatch.setitem(sys.modules, "PyEMD", None)
    with pytest.raises(NotInstalled, match=r'pip install "saltus\[emd\]"') as caught:
        decompose(TIMES, np.cos(TIMES))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("times", "signal", "most", "said"),
    [
        (TIMES**2, TIMES, None, "equal steps"),
        (TIMES[:5], TIMES[:5], None, "8 times or more"),
        (TIMES, np.exp(1j * TIMES), None, "real numbers; received complex128"),
        (TIMES, np.cos(TIMES), 0, "most is an integer"),
    ],
)
def test_bad_input_is_refused_in_one_line(times, signal, most, said):
    """Oracle: the words."""
    with pytest.raises(ValueError, match=said) as caught:
        decompose(times, signal, most=most)
    assert "\n" not in str(caught.value)
