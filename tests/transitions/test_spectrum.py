"""The wavelet spectrum: tones, chirps, edges, and records that are too coarse, each with its closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import erf

from transitions.spectrum import TooCoarse, Wavelet, morlet_spectrum


def ridge(spectrum):
    """Frequency and amplitude (m,) of the largest amplitude at each time, from a parabola through the logarithms at three frequencies."""
    best = np.argmax(spectrum.amplitudes, axis=0)
    best = np.clip(best, 1, len(spectrum.frequencies) - 2)
    columns = np.arange(len(spectrum.times))
    a, b, c = (np.log(spectrum.amplitudes[best + k, columns]) for k in (-1, 0, 1))
    shift = 0.5 * (a - c) / (a - 2.0 * b + c)
    return spectrum.frequencies[best] * 2.0 ** (shift * spectrum.octaves), np.exp(b - 0.25 * (a - c) * shift)


@pytest.mark.parametrize("wavelet", [Wavelet(), Wavelet(2.0, 1.0), Wavelet(6.0, 1.5)])
@pytest.mark.parametrize("samples", [6.0, 17.3, 100.0, 1000.0, 6000.0])
def test_a_tone_shows_its_amplitude_at_its_frequency(samples, wavelet):
    """Oracle: the tone's own amplitude and frequency, over three decades of the same step, to 1e-3."""
    frequency = 2.0 * math.pi / (0.01 * samples)
    times = 0.01 * np.arange(int(30 * samples))
    spectrum = morlet_spectrum(
        times, 0.7 * np.cos(frequency * times + 0.3) + 5.0, frequencies=(frequency / 1.3, frequency * 1.4), wavelet=wavelet
    )
    clear = spectrum.inside(spectrum.times, np.full(len(spectrum.times), frequency)) > 1.0 - 1e-6
    at, amplitude = (values[clear] for values in ridge(spectrum))
    assert clear.any()
    assert np.abs(amplitude / 0.7 - 1.0).max() < 1e-3
    assert np.abs(at / frequency - 1.0).max() < 1e-3


@pytest.mark.parametrize("louder", ["end", "beginning"])
@pytest.mark.parametrize("wavelet", [Wavelet(), Wavelet(2.0, 0.8), Wavelet(6.0, 1.5)])
def test_the_spectrum_is_the_convolution_with_the_wavelet(wavelet, louder):
    """Oracle: the sum over the samples, with the definition of the wavelet, of a signal of all frequencies; it rests about 0.3 at its
    louder end, on which it goes on as far as the wavelet reaches."""
    random = np.random.default_rng(5)
    times = 0.1 * np.arange(1500)
    signal = random.standard_normal(1500) * np.linspace(0.1, 1.0, 1500) + 0.3 * (times > 75.0)
    if louder == "beginning":
        signal = signal[::-1]
    spectrum = morlet_spectrum(times, signal, frequencies=(0.7, 12.0), per_octave=2, wavelet=wavelet)
    ends = [np.hanning(len(part) + 2)[1:-1] @ part / np.hanning(len(part) + 2).sum() for part in (signal[:270], signal[-270:])]
    faint, loud = ends if louder == "end" else ends[::-1]
    beyond = np.full(2000, loud - faint)
    whole = np.concatenate([signal - faint, beyond] if louder == "end" else [beyond, signal - faint])
    place = 0.1 * (np.arange(len(whole)) - (0 if louder == "end" else 2000))
    for row, frequency in enumerate(spectrum.frequencies):
        scale = 2.0 * math.pi * wavelet.centre / frequency
        for column in range(0, len(spectrum.times), len(spectrum.times) // 9):
            away = (place - spectrum.times[column]) / scale
            shape = np.exp(-(away**2) / wavelet.bandwidth - 2j * math.pi * wavelet.centre * away) / math.sqrt(math.pi * wavelet.bandwidth)
            assert spectrum.amplitudes[row, column] == pytest.approx(2.0 * abs(whole @ shape) * 0.1 / scale, abs=1e-6)


@pytest.mark.parametrize("count", [20_000, 160_000])
def test_the_memory_beside_the_amplitudes_is_a_few_numbers_for_each_sample(count):
    """Oracle: what is held at once, less the amplitudes: twenty numbers for each sample, whatever the number of frequencies."""
    import tracemalloc

    times = 0.05 * np.arange(count)
    signal, rate = np.cos(2.0 * times), -2.0 * np.sin(2.0 * times)
    assert morlet_spectrum(times[:1000], signal[:1000]).amplitudes.size  # what is imported is not counted
    tracemalloc.start()
    amplitudes = morlet_spectrum(times, signal, rate, frequencies=(0.5, 8.0)).amplitudes
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most - amplitudes.nbytes < 160 * count


def test_the_response_beside_a_tone_is_that_of_the_envelope():
    """Oracle: the wavelet's Fourier transform, exp(-(w/w0 - 1)^2 s^2/2) with s its sharpness."""
    times = 0.05 * np.arange(8000)
    spectrum = morlet_spectrum(times, np.cos(2.0 * times), frequencies=(1.0, 4.0))
    middle = spectrum.amplitudes[:, len(spectrum.times) // 2]
    expected = np.exp(-0.5 * (spectrum.wavelet.sharpness * (2.0 / spectrum.frequencies - 1.0)) ** 2)
    np.testing.assert_allclose(middle, expected, atol=2e-3)


def test_the_ridge_of_a_chirp_follows_its_frequency():
    """Oracle: the derivative w of the phase; what a Gaussian of standard deviation s leaves of a chirp, (1 + (s^2 w')^2)^(-1/4)."""
    times = 0.02 * np.arange(20_000)
    frequency = 1.0 * np.exp(times / 200.0)
    spectrum = morlet_spectrum(times, np.sin(200.0 * (frequency - 1.0)), frequencies=(0.5, 12.0))
    clear = spectrum.inside(spectrum.times, np.interp(spectrum.times, times, frequency)) > 1.0 - 1e-4
    at, amplitude = ridge(spectrum)
    here = np.interp(spectrum.times, times, frequency)
    assert np.abs(at / here - 1.0)[clear].max() < 0.01
    left = (1.0 + ((spectrum.wavelet.sharpness / here) ** 2 * here / 200.0) ** 2) ** -0.25
    assert np.abs(amplitude / left - 1.0)[clear].max() < 0.01


def test_near_an_edge_a_tone_loses_what_lies_outside():
    """Oracle: the integral of the Gaussian envelope over the record, (1 + erf(d/(sqrt(B) scale)))/2, d the distance to the edge."""
    times = 0.02 * np.arange(20_001)
    spectrum = morlet_spectrum(times, np.cos(3.0 * times), frequencies=(3.0, 3.3))
    near = spectrum.times < 6.0
    scale = 1.5 * 2.0 * math.pi / 3.0
    expected = 0.5 * (1.0 + erf(spectrum.times[near] / (math.sqrt(2.0) * scale)))
    np.testing.assert_allclose(spectrum.inside(spectrum.times[near], np.full(near.sum(), 3.0)), expected, rtol=1e-12)
    np.testing.assert_allclose(spectrum.amplitudes[0][near], expected, atol=0.06)
    assert spectrum.cone[0] == np.inf
    assert np.interp(math.sqrt(2.0) * scale, spectrum.times, spectrum.cone) == pytest.approx(3.0, rel=1e-3)


def test_a_tone_above_half_the_sampling_frequency_is_refused():
    """Oracle: sampled values of the tone and of its alias are equal, their rates are not."""
    step = 0.1
    times = step * np.arange(4000)
    hidden = 2.0 * math.pi / step - 2.0
    np.testing.assert_allclose(np.cos(hidden * times), np.cos(2.0 * times), atol=1e-9)
    morlet_spectrum(times, np.cos(2.0 * times), -2.0 * np.sin(2.0 * times), frequencies=(1.0, 4.0))
    with pytest.raises(TooCoarse, match="too coarse"):
        morlet_spectrum(times, np.cos(hidden * times), -hidden * np.sin(hidden * times), frequencies=(1.0, 4.0))
    with pytest.raises(TooCoarse, match="too coarse"):  # also as a hundredth of a tone that is seen, and late in the record
        late = 0.01 * (times > 300.0)
        morlet_spectrum(
            times,
            np.cos(2.0 * times) + late * np.cos(hidden * times),
            -2.0 * np.sin(2.0 * times) - late * hidden * np.sin(hidden * times),
            frequencies=(1.0, 4.0),
        )


@pytest.mark.parametrize("samples", [16.3, 60.7, 3.1])
def test_impacts_are_no_reason_to_refuse_a_record_that_is_fine_enough(samples):
    """Oracle: the fundamental of a triangular wave, 8/pi^2 of its amplitude; three samples in a period leave nothing of its shape."""
    times = 0.01 * np.arange(8000)
    phase = np.mod(times / (0.01 * samples), 1.0)
    wave, rate = np.where(phase < 0.5, 4.0 * phase - 1.0, 3.0 - 4.0 * phase), np.where(phase < 0.5, 4.0, -4.0) / (0.01 * samples)
    tone = 2.0 * math.pi / (0.01 * samples)
    if samples < 4.0:
        with pytest.raises(TooCoarse):
            morlet_spectrum(times, wave, rate, frequencies=(0.3 * tone, 0.9 * tone))
        return
    spectrum = morlet_spectrum(times, wave, rate, frequencies=(0.7 * tone, 1.5 * tone))
    assert ridge(spectrum)[1][len(spectrum.times) // 2] == pytest.approx(8.0 / math.pi**2, rel=0.01)


def test_frequencies_that_the_record_cannot_show_are_refused():
    """Oracle: the Nyquist frequency less four standard deviations of the wavelet; the period that leaves the cone one instant."""
    times = 0.1 * np.arange(1001)
    spectrum = morlet_spectrum(times, np.cos(2.0 * times))
    highest = math.pi / 0.1 / (1.0 + 4.0 / spectrum.wavelet.sharpness)
    lowest = 4.0 * math.pi * math.sqrt(2.0) * 1.5 / 100.0
    assert lowest <= spectrum.frequencies[0] <= 2.0 <= spectrum.frequencies[-1] <= highest
    with pytest.raises(TooCoarse, match="expected a step of at most"):
        morlet_spectrum(times, np.cos(2.0 * times), frequencies=(1.0, 1.01 * highest))
    with pytest.raises(ValueError, match="lasts 100"):
        morlet_spectrum(times, np.cos(2.0 * times), frequencies=(0.99 * lowest, 1.0))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: morlet_spectrum([0.0, 1.0], [0.0, 1.0]), "8 times or more"),
        (lambda: morlet_spectrum(np.arange(20.0) ** 2, np.ones(20)), "equal steps"),
        (lambda: morlet_spectrum(np.arange(20.0), np.full(20, np.nan)), "finite"),
        (lambda: morlet_spectrum(np.arange(200.0), np.ones(200), frequencies=(1.0, 0.5)), "higher"),
        (lambda: morlet_spectrum(np.arange(200.0), np.ones(200), per_octave=0), "per_octave"),
        (lambda: morlet_spectrum(np.arange(12.0), np.ones(12)), "more samples"),
        (lambda: morlet_spectrum(np.arange(200.0), np.ones(200), np.ones(3)), "for each of the 200"),
        (lambda: Wavelet(1.0, 0.5), "zero mean"),  # a transform of more than exp(-25/2) at frequency zero
        (lambda: Wavelet(2.0, 0.0), "centre"),
    ],
)
def test_bad_input_is_refused_in_one_line(call, said):
    """Oracle: the words."""
    with pytest.raises(ValueError, match=said) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_long_records_are_kept_within_bounds():
    """Oracle: the number of amplitudes; thinned times lose nothing, as the ridge shows."""
    times = 0.01 * np.arange(120_000)
    spectrum = morlet_spectrum(times, np.cos(0.9 * times), frequencies=(0.5, 2.0))
    assert spectrum.amplitudes.size <= 3_100_000 and len(spectrum.times) < len(times)
    clear = spectrum.inside(spectrum.times, np.full(len(spectrum.times), 0.9)) > 1.0 - 1e-6
    assert np.abs(ridge(spectrum)[1][clear] - 1.0).max() < 1e-3


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [2.0**-900, 2.0**900])
def test_the_unit_of_a_signal_is_of_no_account(size):
    """Oracle: the spectrum is linear: a power of two goes through it without rounding."""
    times = np.linspace(0.0, 100.0, 2001)
    signal, rate = np.cos(2.0 * times) + 0.2, -2.0 * np.sin(2.0 * times)
    one, other = morlet_spectrum(times, signal, rate), morlet_spectrum(times, size * signal, size * rate)
    assert np.array_equal(one.frequencies, other.frequencies) and np.array_equal(size * one.amplitudes, other.amplitudes)
    with pytest.raises(TooCoarse):
        morlet_spectrum(times[::40], size * np.cos(2.0 * times[::40]), -2.0 * size * np.sin(2.0 * times[::40]))
