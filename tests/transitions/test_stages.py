"""Stages: signals whose stages are known, motions on families that are known, and the search for the best cut against all cuts."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import saltus
from benchmarks import backbone
from branches.catalogue import Catalogue
from tests.branches.traced import traced
from tests.lab.functions import link
from tests.transitions.motions import of_run, synthetic
from transitions.families import NEAR, FamilyHarmonics, Meeting, families_of, harmonics
from transitions.following import Around, Match, family_intervals, partner, steady, unlike
from transitions.frequencies import LEAST_PERIODS, SHARE, amplitude_of_motion, ridge_intervals, ridges
from transitions.spectrum import Wavelet, morlet_spectrum
from transitions.stage import Follows, Stage, StartFamily, _impacts_from, changes, leaving, stages_as_data
from transitions.stages import stages_of, why_another

GAP = (1.0, -1.0)
STEP = 0.02


def joined(*pieces):
    """Times, signal and rate of tones one after the other: (frequency, amplitude, periods), phases without a jump of the signal at zero."""
    signal, rate = [], []
    for frequency, amplitude, count in pieces:
        t = STEP * np.arange(round(2.0 * math.pi * count / frequency / STEP))
        signal.append(amplitude * np.sin(frequency * t))
        rate.append(amplitude * frequency * np.cos(frequency * t))
    signal, rate = np.concatenate(signal), np.concatenate(rate)
    return STEP * np.arange(len(signal)), signal, rate


@pytest.mark.parametrize("reverse", [False])
@pytest.mark.parametrize("offset", [0.0, 0.4])
@pytest.mark.parametrize("decades", [3, 7, 12])
def test_a_faint_end_goes_on_as_far_as_the_record_goes(decades, offset, reverse):
    """Oracle: see `require_a_faint_end_goes_on_as_far_as_the_record_goes`."""
    require_a_faint_end_goes_on_as_far_as_the_record_goes(decades, offset, reverse)


def require_a_faint_end_goes_on_as_far_as_the_record_goes(decades, offset, reverse):
    """Oracle: the signal: a tone that falls by so many decades until time 300, with a rest position that falls as it does, and a slower one
    of that amplitude, to the end of the record; forwards and backwards."""
    times = np.linspace(0.0, 600.0, 30_001)
    falling = 10.0 ** (-decades * times / 300.0)
    signal = falling * (np.cos(3.0 * times) + offset) + 10.0**-decades * np.cos(0.9 * times)
    signal = signal[::-1] if reverse else signal
    spectrum = morlet_spectrum(times, signal, frequencies=(0.45, 6.0))
    found = ridge_intervals(spectrum, ridges(spectrum, times, signal))
    one, other = found[::-1] if reverse else found
    assert np.abs(np.log2(one.frequencies / 3.0)).max() < 0.06 and np.abs(np.log2(other.frequencies / 0.9)).max() < 0.02
    ends = [(spectrum.times[part.first], spectrum.times[part.last]) for part in found]
    assert ends[0][0] == 0.0 and ends[1][1] == spectrum.times[-1]
    assert ends[0][1] == pytest.approx(300.0, abs=1.0) and ends[1][0] == pytest.approx(300.0, abs=1.0)


def test_a_tone_of_twenty_periods_and_a_jump_are_two_stages():
    """Oracle: the signal: frequencies, where it jumps, energies and what is lost of a given exponential decay."""
    times, signal, rate = joined((1.0, 1.0, 20), (2.6, 0.8, 40))
    energy = 3.0 * np.exp(-times / 50.0)
    first, second = stages_of(synthetic(times, signal, rate, energy, impacts=[10.0, 20.0, 150.0]), GAP)
    jump = 40.0 * math.pi
    assert first.start == 0.0 and second.end == pytest.approx(times[-1], abs=0.1)
    assert first.end == pytest.approx(jump, abs=2.0 * math.pi) and second.start == pytest.approx(jump, abs=2.0 * math.pi)
    assert first.periods == pytest.approx(20, abs=1) and second.periods == pytest.approx(40, abs=1)
    for stage, frequency in ((first, 1.0), (second, 2.6)):
        assert stage.frequency == pytest.approx(frequency, rel=0.005)
        assert stage.share == pytest.approx(1.0, abs=0.05)
        high, low = (3.0 * math.exp(-t / 50.0) for t in (stage.start, stage.end))
        assert stage.energies == pytest.approx((low, high), rel=1e-3)
        assert (stage.dissipated_nes, stage.dissipated_lo) == pytest.approx((0.75 * (high - low), 0.25 * (high - low)), rel=1e-3)
        assert stage.follows is None and stage.text == "follows no family"
    assert (first.impacts, second.impacts) == (2, 1)
    assert changes([first, second]) == []


def test_what_lasts_less_than_three_periods_is_no_stage():
    """Oracle: two periods of a tone do not interrupt the slower one before and after them; four are a stage."""
    for count, expected in ((2, [1.0]), (4, [1.0, 3.0, 1.0])):
        found = stages_of(synthetic(*joined((1.0, 1.0, 20), (3.0, 1.0, count), (1.0, 1.0, 20))), GAP)
        assert [stage.frequency for stage in found] == pytest.approx(expected, rel=0.05)


def test_a_chirp_is_one_stage():
    """Oracle: the derivative of the phase at both ends."""
    times = STEP * np.arange(20_000)
    frequency = np.exp(times / 200.0)
    (stage,) = stages_of(synthetic(times, np.sin(200.0 * (frequency - 1.0)), frequency * np.cos(200.0 * (frequency - 1.0))), GAP)
    assert (stage.start, stage.end) == pytest.approx((0.0, times[-1]), abs=0.1)
    assert stage.frequencies == pytest.approx((frequency[0], frequency[-1]), rel=0.05)
    assert stage.periods == pytest.approx(200.0 * (frequency[-1] - 1.0) / (2.0 * math.pi), rel=0.01)


def test_two_tones_are_a_stage_with_a_companion_until_the_weaker_is_left():
    """Oracle: the signal, exp(-t/60) cos t + 0.3 cos 3t: the ridges cross at 60 log(1/0.3)."""
    times = STEP * np.arange(20_000)
    decay = np.exp(-times / 60.0)
    signal = decay * np.cos(times) + 0.3 * np.cos(3.0 * times)
    rate = -decay * (np.cos(times) / 60.0 + np.sin(times)) - 0.9 * np.sin(3.0 * times)
    first, second = stages_of(synthetic(times, signal, rate), GAP)
    assert (first.frequency, second.frequency) == pytest.approx((1.0, 3.0), rel=0.01)
    assert first.end == pytest.approx(60.0 * math.log(1.0 / 0.3), abs=3.0)
    (companion,) = first.companions
    assert companion.ratio == pytest.approx(3.0, rel=0.01)
    mean = 60.0 * (1.0 - math.exp(-first.end / 60.0)) / first.end
    assert companion.amplitude == pytest.approx(0.3 / mean, rel=0.05)


def test_a_tone_that_dies_away_is_one_stage():
    """Oracle: the signal, exp(-t/30) cos 2t: a stage to 1e-5 of its first amplitude, and its ridge goes on down to 1e-13."""
    times = 0.05 * np.arange(30_000)
    decay = np.exp(-times / 30.0)
    record = synthetic(times, decay * np.cos(2.0 * times), -decay * (np.cos(2.0 * times) / 30.0 + 2.0 * np.sin(2.0 * times)))
    found = stages_of(record, GAP)
    assert found[0].start == 0.0 and found[0].end > 345.0 and found[0].frequency == pytest.approx(2.0, rel=0.005)
    spectrum = morlet_spectrum(times, *record.along(GAP))
    last = int(np.searchsorted(spectrum.times, 900.0))
    (tone,) = [ridge for ridge in ridges(spectrum, times, decay * np.cos(2.0 * times)) if ridge.first == 0 and len(ridge) > last]
    assert tone.frequencies == pytest.approx(2.0, rel=0.02) and 0.8 < tone.shares.min() < tone.shares.max() < 1.1


@pytest.mark.filterwarnings("error")
def test_nothing_and_a_tone_that_dies_away_to_nothing_have_no_stage():
    """Oracle: a constant; exp(-5t) cos 2t, below any number from t = 150 on: it does not hold for three periods, and nothing overflows."""
    times = STEP * np.arange(8000)
    decay = np.exp(-5.0 * times)
    rate = -decay * (5.0 * np.cos(2.0 * times) + 2.0 * np.sin(2.0 * times))
    for signal, change in ((decay * np.cos(2.0 * times), rate), (np.full(8000, 0.3), np.zeros(8000))):
        assert stages_of(synthetic(times, signal, change), GAP) == []


def noise(times, low, high, seed):
    """Noise of unit variance of many tones between two frequencies, and its rate."""
    random = np.random.default_rng(seed)
    tones, phases = random.uniform(low, high, 300), random.uniform(0.0, 2.0 * math.pi, 300)
    angles = np.multiply.outer(times, tones) + phases
    scale = math.sqrt(2.0 / 300)
    return scale * np.cos(angles).sum(axis=1), -scale * (tones * np.sin(angles)).sum(axis=1)


def test_a_tone_in_noise_is_one_stage():
    """Oracle: the tone."""
    times = STEP * np.arange(10_000)
    hiss, rate = noise(times, 4.0, 25.0, 1)
    (stage,) = stages_of(synthetic(times, np.cos(1.3 * times) + 0.3 * hiss, -1.3 * np.sin(1.3 * times) + 0.3 * rate), GAP)
    assert stage.frequency == pytest.approx(1.3, rel=0.01) and stage.periods > 40


def test_many_equal_tones_have_no_ridge_that_counts():
    """Oracle: fourteen tones, each at 1.5 times the frequency of the last, carry a fourteenth of the amplitude each."""
    times = 0.002 * np.arange(60_000)
    tones = 1.5 ** np.arange(14)
    slow = np.sum([np.cos(w * times) for w in tones[:4]], axis=0)
    fast = [stage.frequency for stage in stages_of(synthetic(times, 5.0 * slow, np.gradient(5.0 * slow, times)), GAP)]
    assert fast and max(fast) < 1.1 * tones[3]


def test_the_amplitude_of_a_motion_is_half_of_its_range_around():
    """Oracle: minimum and maximum over each window by brute force."""
    random = np.random.default_rng(3)
    times, signal = 0.1 * np.arange(400), random.standard_normal(400)
    at, frequencies = times[::7], random.uniform(0.5, 8.0, len(times[::7]))
    found = amplitude_of_motion(times, signal, at, frequencies)
    for t, w, value in zip(at, frequencies, found, strict=True):
        first, last = (int(np.clip(round((t + side * 2.0 * math.pi / w) / 0.1), 0, 399)) for side in (-1, 1))
        assert value == 0.5 * np.ptp(signal[first : last + 1])


# -- families ------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def light(small_scene):
    """The small reference scene, open, and its families."""
    with Catalogue(small_scene[0]) as catalogue:
        yield catalogue, families_of(catalogue)


@pytest.mark.parametrize("alpha", [1.66, 1.7, 1.8, 0.3, 0.9])
def test_harmonics_of_a_backbone_are_those_of_its_impulses(alpha):
    """Oracle: each mode's steady response to impulses P of alternating side each half period, 4 P/T sum b_k^2/(w_k^2 - (2 pi j/T)^2) at the
    odd harmonics j, with P = 2/G, G = sum b_k^2 tan(w_k alpha)/w_k; the amplitude is 1, where it hits the stops."""
    system = saltus.vibro_impact_nes(mu=0.1, sigma=0.1)
    w, _, b = backbone.participation(system)
    branch = saltus.trace("S13O00+" if alpha > 1.4 else "S11O00-", system, energy=(0.06, 20.0))
    orbit = branch.orbit_at(alpha=alpha)
    impulse = 2.0 / backbone.half_period_sum(system, alpha)
    odd = np.arange(1, 32, 2)
    turning = 2.0 * np.pi * odd / (4.0 * alpha)
    expected = np.abs(4.0 * impulse / (4.0 * alpha) * np.sum(b[:, None] ** 2 / (w[:, None] ** 2 - turning**2), axis=0))
    found = harmonics(orbit, np.array(GAP))
    np.testing.assert_allclose(found[odd - 1], expected, atol=2e-3)
    np.testing.assert_allclose(found[odd], 0.0, atol=1e-9)


def test_harmonics_between_the_orbits_that_are_read_are_interpolated(light):
    """Oracle: the harmonics of the orbits themselves at points between."""
    catalogue, families = light
    off = []
    for family in [family for family in families.members if family.load is not None][::6]:
        branch = catalogue.branch(family.id)
        for i in range(3, len(branch), max(1, len(branch) // 3)):
            off.append(np.abs(harmonics(branch.orbit(i), np.array(GAP)) - family.shares_at(float(i), GAP)).max())
    assert len(off) > 30 and np.median(off) < 0.01 and np.max(off) < 0.08


def check_own_families(catalogue, families, every):
    """A motion of each of some families: how many are reported, and how many named."""
    impacts = {family.id: family.impacts for family in families.members}
    reported = named = 0
    for row in catalogue.families()[::every]:
        points = catalogue.points(row.id)
        stable = np.flatnonzero(points["stable"] == 1)
        if not len(stable) or row.impacts > 4:
            continue
        orbit = catalogue.branch(row.id).orbit(int(stable[len(stable) // 2]))
        strong = np.flatnonzero(harmonics(orbit, np.array(GAP)) > 0.14) + 1
        if np.any(strong[1:] < 1.4 * strong[:-1]):
            continue
        u, v = orbit.sample(np.array([0.3]))
        record = of_run(orbit.system, u[0], v[0], max(60.0, 6.0 * orbit.period))
        (stage,) = stages_of(record, GAP, families)
        follows = stage.follows
        assert follows is not None and row.id in (follows.family, *follows.others), (row.id, stage)
        assert follows.impacts <= impacts[row.id]
        period = 2.0 * np.pi / stage.frequency
        assert stage.start < period and stage.end > record.times[-1] - period
        reported, named = reported + 1, named + (follows.family == row.id)
        (beside,) = stages_of(record, GAP, families, start=StartFamily(row.id, row.id, "", 0.0, 0))
        assert beside.why == ("" if follows.family == row.id else f"{row.id} fits as well, this one is simpler")
        if follows.family == row.id:
            harmonic = follows.harmonic * 2.0 * np.pi / orbit.period
            assert abs(math.log2(stage.frequency / harmonic)) < 0.02 and follows.deviation < 0.02
            assert follows.share > SHARE and not changes([stage])[1:]
    return reported, named


def test_closely_spaced_harmonics_need_a_sharper_wavelet():
    """Oracle: U8353- at h = 1.9458, alpha = 4.9065 (Lee et al. 2009): its harmonics 8, 9 and 10 carry a third to a half of
    the amplitude, and a wavelet parts neighbours of ratio 1.1 where its sharpness is some thirty."""
    branch = saltus.trace("U8353-", saltus.vibro_impact_nes(mu=0.1, sigma=0.1), energy=(1.8, 2.1))
    orbit = min(branch.orbits_at(energy=1.9458), key=lambda orbit: abs(orbit.alpha - 4.9065))
    assert orbit.alpha == pytest.approx(4.9065, abs=1e-3)
    count = 12 * int(orbit.period / STEP)
    u, v = orbit.sample(STEP * np.arange(count))
    record = replace(synthetic(STEP * np.arange(count), u @ GAP, v @ GAP, np.full(count, orbit.h)), impacts=_impacts(orbit, STEP * count))
    families = families_of([branch])
    sharp = morlet_spectrum(record.times, *record.along(GAP), wavelet=Wavelet(2.0, 6.0))
    (stage,) = stages_of(record, GAP, families, spectrum=sharp)
    assert stage.follows.family == branch.id and stage.follows.label == "U8353-"
    parts = harmonics(orbit, np.array(GAP))
    assert stage.follows.harmonic == np.argmax(parts) + 1


def _impacts(orbit, duration):
    periods = range(int(duration / orbit.period) + 1)
    return sorted(t for k in periods for t in (impact.time + k * orbit.period for impact in orbit.impacts) if t < duration)


def test_free_motion_is_on_a_linear_mode(light):
    """Oracle: the modes in closed form; with both, the one that moves u1 - u2 more, and the other beside it."""
    catalogue, families = light
    w, _, b = backbone.participation(catalogue.system)
    shapes = catalogue.system.modes.shapes
    for first, second in ((0.5, 0.0), (0.0, 0.5), (0.3, 0.15), (0.1, 0.3)):
        u = 0.6 * (first * shapes[:, 0] / abs(b[0]) + second * shapes[:, 1] / abs(b[1]))
        record = of_run(catalogue.system, u, [0.0, 0.0], 300.0)
        assert not len(record.impacts)
        (stage,) = stages_of(record, GAP, families)
        k = int(second > first)
        assert (stage.follows.label, stage.follows.harmonic, stage.follows.impacts) == (("L11+", "L11-")[k], 1, 0)
        assert abs(math.log2(stage.frequency / w[k])) < 0.01 and stage.follows.others == ()
        if first and second:
            assert stage.companions[0].ratio == pytest.approx(w[1 - k] / w[k], rel=0.02)
            leak = math.exp(-0.5 * (Wavelet().sharpness * (w[k] / w[1 - k] - 1.0)) ** 2)  # of the one at the frequency of the other
            # Near the edges, where the two are not parted, it counts as zero.
            edges = 2.0 * Wavelet().reach * 2.0 * math.pi / min(w) / 300.0
            ratio = min(first, second) / max(first, second)
            assert (1.0 - edges) * ratio - leak < stage.companions[0].amplitude < ratio + leak


def test_a_linear_mode_is_not_followed_while_there_are_impacts(light):
    """Oracle: the same free motion, with impacts added."""
    catalogue, families = light
    shapes = catalogue.system.modes.shapes
    record = of_run(catalogue.system, 0.2 * shapes[:, 0], [0.0, 0.0], 200.0)
    (stage,) = stages_of(replace(record, impacts=np.arange(1.0, 199.0, 2.0)), GAP, families)
    assert stage.follows is None or stage.follows.impacts > 0


def test_weakly_damped_motion_leaves_a_backbone_for_a_linear_mode(light):
    """Oracle: the backbone that it starts on, which is stable there; free motion, which is on modes; the balance of what was lost."""
    catalogue, families = light
    row = catalogue.find("S13O00+")
    orbit = catalogue.branch(row.id).orbits_at(energy=2.0)[0]
    u, v = orbit.sample(np.zeros(1))
    record = of_run(saltus.vibro_impact_nes(mu=0.1, sigma=0.1, lam=0.02, rho=0.95), u[0], v[0], 500.0)
    found = stages_of(record, GAP, families)
    assert found[0].follows.label == "S13O00+" and found[0].start == 0.0
    assert found[-1].follows.label == "L11+" and found[-1].end == pytest.approx(500.0, abs=0.1)
    for stage, following in itertools.pairwise(found):
        assert stage.end <= following.start and stage.energies[0] >= following.energies[0]
    assert found[-1].start >= record.impacts[-1] and found[-1].impacts == 0
    assert sum(stage.dissipated_nes for stage in found) <= record.dissipated_nes[-1] * (1.0 + 1e-9)
    changed = changes(found)
    assert (changed[0].kind, changed[0].label, changed[0].time) == ("capture", "S13O00+", 0.0)
    assert (changed[1].kind, changed[1].label) == ("escape", "S13O00+") and (changed[-1].kind, changed[-1].label) == ("capture", "L11+")
    data = stages_as_data(found)
    assert data[0]["follows"]["label"] == "S13O00+" and data[0]["energies"] == list(found[0].energies)


def test_families_of_another_gap_coordinate_or_system_are_refused(light):
    """Oracle: the words, one line."""
    catalogue, families = light
    times, signal, rate = joined((1.0, 1.0, 20))
    with pytest.raises(ValueError, match="have the gap coordinate"):
        stages_of(synthetic(times, signal, rate), (1.0, 0.0), families)
    with pytest.raises(ValueError, match="3 entries"):
        families_of(catalogue, (1.0, -1.0, 0.0))
    with pytest.raises(ValueError, match="no family to follow"):
        families_of([])
    heavy = saltus.trace("S11O00-", saltus.vibro_impact_nes(mu=0.2, sigma=0.1), energy=(1.0, 2.0))
    with pytest.raises(ValueError, match="another system"):
        families_of([catalogue.branch(catalogue.families()[0].id), heavy])


# -- cutting -------------------------------------------------------------------------------------------------------------------


def meeting(name, deviation):
    """A meeting of a family without orbits."""
    family = FamilyHarmonics(name, np.ones(2), np.ones(2), np.array(["", ""]), 2)
    deviation = np.array(deviation)
    return Meeting(family, 1, deviation, np.ones(len(deviation)), np.zeros(len(deviation)))


def test_the_cut_is_the_cheapest_of_all():
    """Oracle: all ways to give each place one of two families or none, tried one by one."""
    random = np.random.default_rng(5)
    periods = 1.5 * np.arange(9)
    for _ in range(12):
        rows = [np.where(random.random(9) < 0.75, random.uniform(-NEAR, NEAR, 9), np.nan) for _ in range(2)]
        off, more = random.uniform(0.0, 1.5 * SHARE, (2, 2, 9)) / np.array([1.0, SHARE]).reshape(2, 1, 1)
        met = [Match(meeting(name, row), *pair) for name, row, pair in zip("ab", rows, zip(off, more, strict=True), strict=True)]

        doubt = np.minimum(1.0, (off / SHARE) ** 2 + more**2)
        each = [[1.5 * 2.0] * 9, *(1.5 * ((np.array(rows) / NEAR) ** 2 + doubt)).tolist()]  # cost of a state at a place

        def cost(states, each=each):
            total = each[states[0]][0]
            for j in range(1, 9):
                total += each[states[j]][j]
                if states[j] != states[j - 1]:
                    total += 0.5 * LEAST_PERIODS * (1 if 0 in (states[j], states[j - 1]) else 2)
            return total

        costs = {states: cost(states) for states in itertools.product(range(3), repeat=9)}
        best = min((states for states in costs if not math.isnan(costs[states])), key=costs.__getitem__)
        expected = []
        for state, group in itertools.groupby(range(9), key=lambda j: best[j]):
            places = list(group)
            state = state if periods[places[-1]] - periods[places[0]] >= LEAST_PERIODS else 0
            if expected and expected[-1][0] == 0 and state == 0:
                expected[-1][1].extend(places)
            else:
                expected.append([state, places])
        found = family_intervals(met, periods)
        names = [["", "a", "b"][state] for state, _ in expected]
        assert [(s.match.meeting.family.id if s.match else "", s.first, s.last) for s in found] == [
            (name, places[0], places[-1]) for name, (_, places) in zip(names, expected, strict=True)
        ]


def test_lines_without_a_partner_count_in_full():
    """Oracle: by hand."""
    orbit = np.array([[0.7, 0.0, 0.3, 0.0]])
    for harmonic, lines, expected in (
        (1, [(1.0, 0.7), (3.0, 0.3)], 0.0),
        (1, [(1.0, 0.7), (3.0, 0.2), (0.0, 0.0)], 0.1),
        (1, [(1.0, 0.7)], 0.3),
        (1, [(1.0, 0.7), (3.0, 0.3), (2.5, 0.4)], 0.4),
        (1, [(1.0, 0.7), (3.0, 0.3), (40.0, 0.2)], 0.2),
        (3, [(1.0, 0.3), (1.0 / 3.0, 0.7)], 0.0),
    ):
        ratios, parts = np.array(lines).T[:, :, None]
        assert unlike(orbit, harmonic, ratios, parts) == pytest.approx([expected])
    ratios, parts = np.array([[1.0, 1.0], [1.0 / 3.0, 0.0]]), np.array([[0.3, 0.4], [0.7, 0.0]])
    np.testing.assert_array_equal(partner(3, 3, ratios, parts), [[0.7, 0.0], [0.0, 0.0], [0.3, 0.4]])


# -- one ridge, several families -----------------------------------------------------------------------------------------------


def one_after_the_other(*pieces):
    """A record of orbits one after the other, (orbit, periods), and when they change; the phase of the fundamental goes on."""
    signal, rate, energy, impacts, ends, phase = [], [], [], [], [0.0], None
    for orbit, count in pieces:
        even = orbit.period * np.arange(512) / 512
        turn = float(np.angle(np.sum(orbit.sample(even)[0] @ GAP * np.exp(-2j * math.pi * np.arange(512) / 512))))
        phase = turn if phase is None else phase
        ahead = (phase - turn) * orbit.period / (2.0 * math.pi)
        steps = round(count * orbit.period / STEP)
        u, v = orbit.sample(ahead + STEP * np.arange(steps))
        signal.append(u @ GAP)
        rate.append(v @ GAP)
        energy.append(np.full(steps, orbit.h))
        # An impact at the begin is there, whatever the rounding of its time.
        begins = [(impact.time - ahead + 1e-9) % orbit.period - 1e-9 for impact in orbit.impacts]
        times = [begin + k * orbit.period for k in range(count + 1) for begin in begins]
        impacts += sorted(ends[-1] + t for t in times if t < STEP * steps)
        ends.append(ends[-1] + STEP * steps)
    signal, rate, energy = (np.concatenate(values) for values in (signal, rate, energy))
    return synthetic(STEP * np.arange(len(signal)), signal, rate, energy, impacts), ends


def check_a_cut(catalogue, families):
    backbone = catalogue.branch(catalogue.find("S13O00+").id)
    single = next(catalogue.branch(row.id) for row in catalogue.families() if row.id.startswith("rest-stop+::"))
    other = single.orbit(len(single) // 2)
    pitch = other.period / 4.0
    orbit = min((backbone.orbit(i) for i in range(0, len(backbone), 3)), key=lambda orbit: abs(orbit.alpha - pitch))
    assert abs(math.log2(orbit.period / other.period)) < 0.5 * NEAR
    record, ends = one_after_the_other((orbit, 20), (other, 20))
    first, second = stages_of(record, GAP, families)
    assert (first.follows.family, first.follows.harmonic) == (backbone.id, 1)
    assert (second.follows.family, second.follows.harmonic) == (single.id, 1)
    assert first.end == pytest.approx(ends[1], abs=2.0 * orbit.period) and second.start == first.end
    assert [(change.kind, change.family) for change in changes([first, second])] == [
        ("capture", backbone.id),
        ("escape", backbone.id),
        ("capture", single.id),
    ]


def test_a_ridge_is_cut_where_the_family_that_it_follows_changes(light):
    """Oracle: the signal, made of an orbit with two impacts in a period and one of the same frequency with one: the ridge goes on."""
    check_a_cut(*light)


def check_third_harmonics(catalogue, families):
    for name, strong, weak in (("S13O00+", 1, 3), ("S33O11-", 3, 1)):
        branch = catalogue.branch(catalogue.find(name).id)
        pair = []
        for least, most in ((1.2 * SHARE, 1.5 * SHARE), (0.6 * SHARE, 0.8 * SHARE)):
            for i in range(len(branch)):
                parts = harmonics(branch.orbit(i), np.array(GAP))
                if least <= parts[weak - 1] <= most and parts[strong - 1] > 2.0 * SHARE:
                    pair.append(branch.orbit(i))
                    break
        record, ends = one_after_the_other(*((orbit, 12) for orbit in pair))
        with_it, alone = stages_of(record, GAP, families)
        assert with_it.follows.family == alone.follows.family == branch.id
        assert (with_it.follows.harmonic, with_it.follows.harmonics) == (strong, (1, 3))
        assert (alone.follows.harmonic, alone.follows.harmonics) == (strong, (strong,))
        assert f" with harmonic {weak}" in with_it.text and "with" not in alone.text
        assert with_it.end == pytest.approx(ends[1], abs=2.0 * pair[0].period)
        assert [change.kind for change in changes([with_it, alone])] == ["capture"]


def test_a_capture_with_a_third_harmonic_is_distinguished_from_one_without(light):
    """Oracle: the orbits' own harmonics: on the backbone the first is the stronger, on the tongue the third; the weaker one carries a
    fifth of the amplitude in the first orbit of each pair, and not in the second."""
    check_third_harmonics(*light)


def check_other_amplitudes(catalogue, families, name, other):
    row = catalogue.find(name)
    stable = np.flatnonzero(catalogue.points(row.id)["stable"] == 1)
    orbit = catalogue.branch(row.id).orbit(int(stable[len(stable) // 2]))
    own = harmonics(orbit, np.array(GAP))
    apart = [np.abs(harmonics(item, np.array(GAP)) - own).max() for item in catalogue.branch(other).orbits_at(energy=orbit.h)]
    assert apart and min(apart) > SHARE
    u, v = orbit.sample(np.array([0.3]))
    record = of_run(orbit.system, u[0], v[0], max(60.0, 6.0 * orbit.period))
    for start, why in ((other, f"its harmonics have other amplitudes than those of {other}"), (row.id, "")):
        (stage,) = stages_of(record, GAP, families, start=StartFamily(start, start, "", 0.0, 0))
        assert stage.follows.family == row.id and stage.why == why


def test_other_amplitudes_are_a_reason_where_they_are_other(light):
    """Oracle: the harmonics of the orbits at that energy; those of the family itself are no reason."""
    check_other_amplitudes(*light, "rest-stop+:-:945a920e", "periodic:++-:75e487f0")


def test_why_a_stage_does_not_follow_the_family_of_the_start():
    """Oracle: what was changed: a record at the energy and the frequency of an orbit, with other impacts, frequency or energy; the part of
    the amplitude that its second harmonic carries is zero, as the orbit is symmetric."""
    branch = traced("S13O00+")
    orbit = branch.orbit_at(energy=1.0)
    families = families_of([branch], GAP)
    start = StartFamily(branch.id, "S13O00+", orbit.label, 0.0, 0)
    times, own = np.linspace(0.0, 30.0, 301), 2.0 * math.pi / orbit.period
    periods = 30.0 / orbit.period
    plain = Stage(0.0, 30.0, periods, own, (own, own), (1.0, 1.0), 1.0, 0.0, 0.0, 0, (), None)

    def why(factor=1.0, impacts=2.0, energy=1.0, unlike=0.3, others=None):
        record = replace(synthetic(times, np.sin(times), np.cos(times)), energy=np.full(len(times), energy))
        follows = None if others is None else Follows("a:b:c", "", 1, 0.0, 0.5, 1, (1,), others)
        stage = replace(plain, periods=factor * periods, impacts=round(impacts * periods), follows=follows)
        return why_another(start, families, record, stage, times, np.full(len(times), factor * own), unlike)

    assert why(impacts=0.0) == "it has no impact, S13O00+ has 2 in a period"
    assert why(impacts=4.0).startswith("it has 4") and why(impacts=4.0).endswith("impacts in a period of S13O00+, not 2")
    assert why(factor=2.0**0.2) == "its frequency is 0.2 octaves from harmonic 1 of S13O00+, 0.05 is allowed"
    assert why(factor=2.0) == "harmonic 2 of S13O00+ carries 0% of the orbit's amplitude, 20% is required"
    assert why(energy=1e5).startswith("S13O00+ has no orbit at these energies")
    assert why() == why(others=()) == "its harmonics have other amplitudes than those of S13O00+"
    assert why(unlike=0.1) == why(unlike=None) == "it fits S13O00+ too poorly, or for less than three periods"
    assert why(unlike=0.1, others=()) == "this one fits better than S13O00+"
    assert why(others=(branch.id,)) == "S13O00+ fits as well, this one is simpler"
    assert why_another(replace(start, family="a:b:c"), families, None, plain, times, times, 0.3) == ""


@pytest.mark.parametrize("late", [0.0, 1e-15, -1e-15])
def test_an_impact_at_the_start_of_a_motion_is_the_last_of_its_orbit(late):
    """Oracle: by hand: a motion that begins with the second impact of an orbit, half a period after its start."""
    impacts = [SimpleNamespace(time=time, stop=stop) for time, stop in ((1.0, "a"), (2.0 + late, "b"), (3.5, "c"))]
    states = np.array([[0.0], [1.0]])
    system = SimpleNamespace(has_odd_symmetry=False)
    orbit = SimpleNamespace(system=system, period=4.0, impacts=impacts, sample=lambda times: (states, states))
    found = _impacts_from(orbit, states[1], states[1])
    assert [stop for _, stop in found] == ["c", "a", "b"] and leaving(found, [(1.5, "c"), (3.0, "a"), (4.0, "b"), (5.5, "c")]) is None


def test_maxima_are_linked_to_their_nearest():
    """Oracle: by hand: two that go on, one that is nobody's nearest, and one that is lost for a column."""
    columns, bounds = np.array([0, 0, 1, 1, 1, 2, 3, 3]), np.array([0, 2, 5, 6, 8])
    level = np.array([0.0, 1.0, 0.01, 0.5, 0.98, 1.0, 0.02, 1.01])
    following = link(columns, level, bounds, reach=np.full(8, 0.05), spacing=0.05, drift=0.25, step=1.0)
    assert following.tolist() == [2, 4, 6, -1, 5, 7, -1, -1]


def test_means_are_over_three_periods():
    """Oracle: the integral of a parabola, which is zero outside of a part of the columns."""
    cycles = np.linspace(0.0, 12.0, 4001)
    around = Around(cycles, np.array([0, 1500, 2000, 4000]))
    low, high = np.clip(cycles[around.places] - 1.5, 0.0, 12.0), np.clip(cycles[around.places] + 1.5, 0.0, 12.0)
    for first, stop, accuracy in ((0, 4001, 5e-6), (1600, 2400, 1e-6)):
        a, b = (np.clip(edge, cycles[first], cycles[stop - 1]) for edge in (low, high))
        means = around.mean(cycles[first:stop] ** 2, first)
        np.testing.assert_allclose(means, (b**3 - a**3) / 3.0 / (high - low), rtol=accuracy, atol=1e-12)
    assert around.reached(1600, 2400) == slice(1, 3)


def test_a_harmonic_that_comes_for_less_than_three_periods_does_not_count():
    """Oracle: by hand."""
    cycles = 0.5 * np.arange(40)
    row = (cycles >= 10.0) | ((cycles >= 4.0) & (cycles < 5.0))
    assert steady(np.stack([row, np.ones(40, dtype=bool), np.zeros(40, dtype=bool)]), cycles) == [(0, 19, (1,)), (20, 39, (0, 1))]
