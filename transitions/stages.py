"""Stages of a motion: intervals where one ridge of its spectrum dominates, and the families that it follows there."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from transitions.families import Families, Meeting
from transitions.following import EQUAL_SHARE, Around, Match, best_of, family_intervals, lasting, lines_of, partner, steady, unlike
from transitions.record import SampledMotion
from transitions.ridges import LEAST_PERIODS, SHARE, Ridge, RidgeInterval, amplitude_of_motion, beside, periods, ridge_intervals, ridges
from transitions.spectrum import Spectrum, morlet_spectrum
from transitions.stage import Companion, Follows, Stage, StartFamily, why_another

__all__ = ["spectrum_of", "stages_of"]

_PLACES = 4.0  # number of places in a period at which a ridge is compared with families
_MOST_PLACES = 4000
_NOTHING = 1e-300  # in place of an energy or amplitude of 0, so that its logarithm and quotients exist


def spectrum_of(record: SampledMotion, gap: Sequence[float], **options: Any) -> Spectrum:
    """The wavelet spectrum of a gap coordinate of a record; the options are those of `transitions.spectrum.morlet_spectrum`."""
    w, rate = record.along(gap)
    return morlet_spectrum(record.times, w, rate, **options)


def stages_of(
    record: SampledMotion,
    gap: Sequence[float],
    families: Families | None = None,
    *,
    start: StartFamily | None = None,
    spectrum: Spectrum | None = None,
    on_progress: Callable[[float], object] | None = None,
) -> list[Stage]:
    """The stages of a motion.

    A stage is an interval in which one ridge of the spectrum of the gap coordinate is the largest and has a fifth of the amplitude, for
    three of its periods or more. It follows a family by its frequency and the energy, both averaged over three periods. The frequency lies
    within 0.05 octave of a harmonic of the family's orbit at this energy, and the harmonic has a fifth of the orbit's amplitude. A family
    with impacts needs an impact within one of its periods. A linear mode needs one of its periods without impact.

    Parameters
    ----------
    record : SampledMotion
    gap : (n,) float
        (1, -1) for u1 - u2.
    families : Families, optional
        The result of `transitions.families.families_of` for the same gap coordinate.
    start : StartFamily, optional
        The family that the motion starts on. Stages have its name, or say why they do not follow it.
    spectrum : Spectrum, optional
        Spectrum of the gap coordinate. By default it is computed with the default wavelet, one row at a time.
    on_progress : callable, optional
        Called with the time up to which the stages are known.

    Returns
    -------
    list of Stage
        In order of time.

    Raises
    ------
    ValueError
        For families of another gap coordinate.
    transitions.spectrum.TooCoarse
        For a record with too few samples.
    """
    w, rate = record.along(gap)
    if families is not None and not np.allclose(families.gap, gap, rtol=1e-12, atol=0.0):
        raise ValueError(f"the families have the gap coordinate {families.gap}; the stages are asked for {tuple(gap)}")
    spectrum = spectrum or morlet_spectrum(record.times, w, rate)
    if not np.ptp(w) > 0.0:
        return []
    found = ridges(spectrum, record.times, w)
    out: list[Stage] = []
    for interval in ridge_intervals(spectrum, found):
        for part in _parts(record, w, spectrum, found, interval, families):
            stage = _stage(record, spectrum, found, part)
            out.append(stage if start is None or families is None else _beside_start(stage, start, families, record, spectrum, part))
        if on_progress is not None:
            on_progress(float(spectrum.times[interval.last]))
    return out


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of an interval of a ridge: the families that fit it, the best first; the places `first` to `last` at which it is compared with
    families; the harmonics of the best family that the motion shows; and all comparisons of the interval."""

    interval: RidgeInterval
    meetings: Sequence[Meeting] = ()
    first: int = 0
    last: int = 0
    harmonics: tuple[int, ...] = ()
    matches: Sequence[Match] = ()

    def unlike(self, family: str) -> float | None:
        """Mean difference of the lines of a family with this id, at the harmonic with the least difference; None if the family was not
        compared here."""
        part = slice(self.first, self.last + 1)
        own = [match for match in self.matches if match.meeting.family.id == family]
        rows = [match.unlike[part][np.isfinite(match.meeting.deviation[part])] for match in own]
        return min((float(np.mean(row)) for row in rows if len(row)), default=None)


def _parts(
    record: SampledMotion, w: np.ndarray, spectrum: Spectrum, found: Sequence[Ridge], interval: RidgeInterval, families: Families | None
) -> list[_Part]:
    """The interval, cut at each change of the family that it follows, or of the family's harmonics that it shows."""
    if families is None:
        return [_Part(interval)]
    step = float(spectrum.times[1] - spectrum.times[0])
    pitch = interval.frequencies
    cycles = np.concatenate([[0.0], np.cumsum(0.5 * (pitch[1:] + pitch[:-1]))]) * step / (2.0 * math.pi)
    times = spectrum.times[interval.first : interval.last + 1]
    energy = np.interp(times, record.times, record.energy)
    even = np.linspace(0.0, cycles[-1], min(_MOST_PLACES, int(_PLACES * cycles[-1]) + 2))
    places = np.unique(np.searchsorted(cycles, even).clip(0, len(cycles) - 1))
    around = Around(cycles, places)
    mean_pitch = np.exp(around.mean(np.log(pitch)))
    mean_energy = np.exp(around.mean(np.log(np.maximum(energy, _NOTHING))))
    at = cycles[places]
    lines = lines_of(found, interval, around)
    met = [_where_it_can(item, record, times[places], mean_pitch) for item in families.meet(mean_energy, mean_pitch)]
    met = [item for item in met if lasting(item, at)]
    shares, counts = {}, {}
    for k in {item.harmonic for item in met}:
        # An orbit of k periods of the ridge shows its full range within half of them on each side.
        size = amplitude_of_motion(record.times, w, times[places], 2.0 * mean_pitch / k)
        shares[k] = lines.amplitudes / np.maximum(size, _NOTHING)
        counts[k] = _impacts_around(record, times, around, k * math.ceil(LEAST_PERIODS / k))
    matches = []
    for item in met:
        k = item.harmonic
        own = item.family.shares_at(item.point, families.gap)
        miscount = counts[k] - k * math.ceil(LEAST_PERIODS / k) * item.family.impacts / k
        matches.append(Match(item, unlike(own, k, lines.ratios, shares[k]), miscount))
    cut: list[_Part] = []
    for piece in family_intervals(matches, at):
        if piece.match is None:
            cut.append(_Part(interval, (), piece.first, piece.last, (), matches))
            continue
        first, last = int(places[piece.first]), int(places[piece.last])
        impacts = _impacts(record, times[first], times[last])
        best = best_of(piece, matches, impacts, cycles[last] - cycles[first])
        part = slice(piece.first, piece.last + 1)
        own, k = best[0].family.shares_at(best[0].point[part], families.gap).T, best[0].harmonic
        seen = partner(len(own), k, lines.ratios[:, part], shares[k][:, part])
        shown = (own >= SHARE) & (seen >= SHARE - EQUAL_SHARE)
        shown[k - 1] = True  # the ridge itself
        for begin, end, indices in steady(shown, at[part]):
            cut.append(_Part(interval, best, piece.first + begin, piece.first + end, tuple(i + 1 for i in indices), matches))
    return _joined(cut, places, cycles)


def _impacts_around(record: SampledMotion, times: np.ndarray, around: Around, length: float) -> np.ndarray:
    """Number of impacts (j,) in windows of `length` periods around the places.

    The count is interpolated between impacts, so that it does not jump if an impact passes the edge of a window. At the ends of the ridge
    the windows are shorter, and the count is scaled."""
    low, high = around.window(length)
    first, last = (np.interp(edge, around.cycles, times) for edge in (low, high))
    counts = np.arange(1.0, len(record.impacts) + 1.0)
    if not len(counts):
        return np.zeros(len(low))
    impacts = np.interp(last, record.impacts, counts) - np.interp(first, record.impacts, counts)
    return impacts / (high - low) * length


def _joined(cut: Sequence[_Part], places: np.ndarray, cycles: np.ndarray) -> list[_Part]:
    """The parts with their columns: each lasts until the next one begins. Parts of no family that last less than three periods are left
    out."""
    out = []
    for i, part in enumerate(cut):
        first = 0 if i == 0 else int(places[part.first])
        last = len(cycles) - 1 if i + 1 == len(cut) else int(places[cut[i + 1].first])
        if part.meetings or cycles[last] - cycles[first] >= LEAST_PERIODS:
            begin = part.interval.first
            out.append(replace(part, interval=RidgeInterval(part.interval.ridge, begin + first, begin + last)))
    return out


def _where_it_can(meeting: Meeting, record: SampledMotion, times: np.ndarray, pitch: np.ndarray) -> Meeting:
    """The meeting, restricted to places where motion and family both have impacts or both have none."""
    period = 2.0 * math.pi * meeting.harmonic / pitch
    impacts = record.impacts
    if len(impacts):
        after = np.searchsorted(impacts, times)
        since = times - np.where(after > 0, impacts[np.maximum(after - 1, 0)], -np.inf)
        until = np.where(after < len(impacts), impacts[np.minimum(after, len(impacts) - 1)], np.inf) - times
        near = np.minimum(since, until) <= period
    else:
        near = np.zeros(len(times), dtype=bool)
    return meeting._replace(deviation=np.where(near == (meeting.family.impacts > 0), meeting.deviation, np.nan))


def _stage(record: SampledMotion, spectrum: Spectrum, found: Sequence[Ridge], part: _Part) -> Stage:
    ridge = part.interval
    start, end = float(spectrum.times[ridge.first]), float(spectrum.times[ridge.last])
    pitch = ridge.frequencies
    energy = record.energy[np.searchsorted(record.times, start) : np.searchsorted(record.times, end, "right")]
    frequency = float(np.exp(np.mean(np.log(pitch))))

    def within(values: np.ndarray) -> float:
        return float(np.interp(end, record.times, values) - np.interp(start, record.times, values))

    follows = None
    if part.meetings:
        meeting = part.meetings[0]
        places = slice(part.first, part.last + 1)
        follows = Follows(
            meeting.family.id,
            meeting.family.label_at(meeting.point[(part.first + part.last) // 2]),
            meeting.harmonic,
            float(np.mean(np.abs(meeting.deviation[places]))),
            float(np.mean(meeting.share[places])),
            meeting.family.impacts,
            part.harmonics,
            tuple(other.family.id for other in part.meetings[1:]),
        )
    return Stage(
        start,
        end,
        periods(pitch, float(spectrum.times[1] - spectrum.times[0])),
        frequency,
        (float(pitch.min()), float(pitch.max())),
        (float(energy.min()), float(energy.max())),
        float(np.mean(ridge.shares)),
        within(record.dissipated_nes),
        within(record.dissipated_lo),
        _impacts(record, start, end),
        _companions(found, ridge, frequency),
        follows,
    )


def _beside_start(stage: Stage, start: StartFamily, families: Families, record: SampledMotion, spectrum: Spectrum, part: _Part) -> Stage:
    """The stage with the name of the family that the motion starts on, or with the reason why it does not follow that family."""
    if stage.follows is not None and stage.follows.family == start.family:
        return replace(stage, follows=replace(stage.follows, name=start.name))
    ridge = part.interval
    times = spectrum.times[ridge.first : ridge.last + 1]
    return replace(stage, why=why_another(start, families, record, stage, times, ridge.frequencies, part.unlike(start.family)))


def _impacts(record: SampledMotion, start: float, end: float) -> int:
    return int(np.searchsorted(record.impacts, end, "right") - np.searchsorted(record.impacts, start))


def _companions(found: Sequence[Ridge], part: RidgeInterval, frequency: float) -> tuple[Companion, ...]:
    length = part.last + 1 - part.first
    amplitude = float(np.mean(part.amplitudes))
    out = []
    for ridge in beside(found, part):
        first, stop = max(part.first, ridge.first), min(part.last + 1, ridge.first + len(ridge))
        if 2 * (stop - first) < length:
            continue
        mine = slice(first - ridge.first, stop - ridge.first)
        ratio = float(np.exp(np.mean(np.log(ridge.frequencies[mine])))) / frequency
        out.append(Companion(ratio, float(np.sum(ridge.amplitudes[mine])) / length / amplitude))
    return tuple(sorted(out, key=lambda item: -item.amplitude))
