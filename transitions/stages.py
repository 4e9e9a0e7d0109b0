"""Stages of a motion: intervals where one ridge of its spectrum dominates, and the families that it follows there."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from transitions.families import NEAR, Families, Meeting
from transitions.following import EQUAL_SHARE, Around, Match, best_of, family_intervals, lasting, lines_of, partner, steady, unlike
from transitions.frequencies import (
    LEAST_PERIODS,
    SHARE,
    Ridge,
    RidgeInterval,
    amplitude_of_motion,
    beside,
    periods,
    ridge_intervals,
    ridges,
)
from transitions.record import SampledMotion, require
from transitions.spectrum import Spectrum, morlet_spectrum
from transitions.stage import Companion, Follows, Stage, StartFamily

__all__ = ["stages_of", "why_another"]

_PLACES = 4.0  # number of places in a period at which a ridge is compared with families
_MOST_PLACES = 4000
_SOME = 64  # number of places in a stage at which it is compared with the family of the start
_NOTHING = 1e-300  # in place of an energy or amplitude of 0, so that its logarithm and quotients exist


def stages_of(
    record: SampledMotion,
    gap: Sequence[float],
    families: Families | None = None,
    *,
    start: StartFamily | None = None,
    spectrum: Spectrum | None = None,
    on_progress: Callable[[float], object] | None = None,
) -> list[Stage]:
    """Divide a motion into stages by the spectrum of its gap coordinate.

    A stage is an interval in which one ridge of the spectrum of the gap coordinate is the largest and has a fifth of the amplitude, for
    three of its periods or more. It follows a family by its frequency and the energy, both averaged over three periods. The frequency lies
    within 0.05 octave of a harmonic of the family's orbit at this energy, and the harmonic has a fifth of the orbit's amplitude. A family
    with impacts needs an impact within one of its periods. A family without, such as a linear mode, needs a period without.

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
    TypeError
        For a record, families, a start or a spectrum that is none.
    ValueError
        For families of another gap coordinate.
    transitions.spectrum.TooCoarse
        For a record with too few samples.
    """
    require(record, SampledMotion, "the record", "saltus.sampled(motion, saltus.sharing_of(system))")
    for value, kind, what, example in (
        (families, Families, "the families", "saltus.families_of(branches)"),
        (start, StartFamily, "the start", "saltus.Transition(...).start"),
        (spectrum, Spectrum, "the spectrum", "saltus.Transition(...).spectrum"),
    ):
        if value is not None:
            require(value, kind, what, example)
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
            if start is not None and stage.follows is not None and stage.follows.family == start.family:
                stage = replace(stage, follows=replace(stage.follows, name=start.name))
            elif start is not None and families is not None:
                ridge = part.interval
                times = spectrum.times[ridge.first : ridge.last + 1]
                why = why_another(start, families, record, stage, times, ridge.frequencies, part.unlike(start.family))
                stage = replace(stage, why=why)
            out.append(stage)
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
        differences = unlike(item.family.shares_at(item.point, families.gap), k, lines.ratios, shares[k])
        matches.append(Match(item, differences, counts[k] - k * math.ceil(LEAST_PERIODS / k) * item.family.impacts / k))
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
    if not len(record.impacts):
        return np.zeros(len(low))
    first, last = (
        np.interp(np.interp(edge, around.cycles, times), record.impacts, np.arange(1.0, len(record.impacts) + 1.0)) for edge in (low, high)
    )
    return (last - first) / (high - low) * length


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
    impacts = np.concatenate([[-np.inf], record.impacts, [np.inf]])
    after = np.searchsorted(impacts[1:-1], times) + 1
    near = np.minimum(times - impacts[after - 1], impacts[after] - times) <= 2.0 * math.pi * meeting.harmonic / pitch
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
            str(meeting.family.labels[round(meeting.point[(part.first + part.last) // 2])]),
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
        own = RidgeInterval(ridge, first, stop - 1)
        ratio = float(np.exp(np.mean(np.log(own.frequencies)))) / frequency
        out.append(Companion(ratio, float(np.sum(own.amplitudes)) / length / amplitude))
    return tuple(sorted(out, key=lambda item: -item.amplitude))


def why_another(
    start: StartFamily,
    families: Families,
    record: SampledMotion,
    stage: Stage,
    times: np.ndarray,
    pitch: np.ndarray,
    unlike: float | None,
) -> str:
    """Why a stage does not follow the family of the start, in words; "" if that is not among the families.

    `times` and `pitch` (j,) are times and angular frequencies of the stage's ridge. `unlike` is the mean difference of the lines of the
    motion and of the family (`transitions.following.unlike`), None if they were not compared.
    """
    family = next((family for family in families.members if family.id == start.family), None)
    if family is None:
        return ""
    name = start.called
    if stage.follows is not None and start.family in stage.follows.others:
        return f"{name} fits as well, this one is simpler"
    if family.impacts and not stage.impacts:
        return f"it has no impact, {name} has {family.impacts} in a period"
    some = np.unique(np.linspace(0, len(times) - 1, _SOME).round().astype(int))
    energies = np.interp(times[some], record.times, record.energy)
    own, harmonic, share = family.closest(np.maximum(energies, 1e-300), pitch[some], families.gap)
    there = np.isfinite(own)
    if 2 * there.sum() < len(some) and not (times[0] < start.end and there.any()):
        low, high = float(family.h.min()), float(family.h.max())
        return f"{name} has no orbit at these energies, only from h = {low:.4g} to {high:.4g}"
    if times[0] < start.end:
        change = _change(own[there], times[some][there], pitch[some][there])
        if change > 2.0 * NEAR:
            return f"the frequency of {name} changes by {change:.2g} octaves in three of its periods, too fast for the spectrum"
    away = np.log2(pitch[some]) - own - np.log2(harmonic)
    k = int(np.median(harmonic[there]))
    which = f"harmonic {k} of {name}"
    off = float(np.median(np.abs(away[there])))
    if off > NEAR:
        return f"its frequency is {off:.2g} octaves from {which}, {NEAR:g} is allowed"
    part = float(np.median(share[there]))
    if part < SHARE:
        return f"{which} carries {part:.0%} of the orbit's amplitude, {SHARE:.0%} is required"
    rate = stage.impacts / stage.periods * k
    if abs(rate - family.impacts) * LEAST_PERIODS / k >= 1.0:
        return f"it has {rate:.2g} impacts in a period of {name}, not {family.impacts}"
    if unlike is not None and unlike > SHARE:
        return f"its harmonics have other amplitudes than those of {name}"
    if stage.follows is not None:
        return f"this one fits better than {name}"
    return f"it fits {name} too poorly, or for less than three periods"


def _change(own: np.ndarray, times: np.ndarray, pitch: np.ndarray) -> float:
    """Largest change in octaves of the logarithm (j,) of a frequency within three periods of the ridge."""
    spans = LEAST_PERIODS * 2.0 * np.pi / pitch
    return max(
        (float(np.ptp(own[(times >= time) & (times <= time + span)])) for time, span in zip(times, spans, strict=True)), default=0.0
    )
