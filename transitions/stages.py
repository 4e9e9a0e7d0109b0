"""Stages of a motion: intervals in which one ridge of its spectrum holds, and the family of the undamped system that it follows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from transitions.families import Families, Meeting
from transitions.following import EQUAL_SHARE, Match, best_of, lasting, steady, stretches
from transitions.lines import Around, lines_of, partner, unlike
from transitions.record import Record
from transitions.ridges import HOLDS, SHARE, Held, Ridge, amplitude_of_motion, beside, held, periods, ridges
from transitions.spectrum import Spectrum, SpectrumRows, morlet_rows, morlet_spectrum
from transitions.stage import Companion, Follows, Stage
from transitions.start_family import StartFamily, why_another

__all__ = ["spectrum_of", "stages_of"]

_PLACES = 4.0  # in a period of the ridge, at which it is compared with families
_MOST_PLACES = 4000
_NOTHING = 1e-300  # an energy of which there is a logarithm


def spectrum_of(record: Record, gap: Sequence[float], **options: Any) -> Spectrum:
    """The wavelet spectrum of a gap coordinate of a record.

    Parameters
    ----------
    record : Record
    gap : (n,) float
        (1, -1) for u1 - u2.
    **options
        As for `transitions.spectrum.morlet_spectrum`.
    """
    w, rate = record.along(gap)
    return morlet_spectrum(record.times, w, rate, **options)


def stages_of(
    record: Record,
    gap: Sequence[float],
    families: Families | None = None,
    *,
    start: StartFamily | None = None,
    spectrum: SpectrumRows | None = None,
    on_progress: Callable[[float], object] | None = None,
) -> list[Stage]:
    """The stages of a motion.

    A stage is an interval in which one ridge of the spectrum of the gap coordinate is the largest, and carries a fifth of the amplitude,
    for three of its periods or more. What it follows is told by its frequency and the energy, both averaged over three periods: within
    0.05 octave of a harmonic of a family's orbit at that energy that carries a fifth of that orbit's amplitude. A family with impacts is
    followed only where there is an impact within one of its periods, and a linear mode only where there is none.

    Parameters
    ----------
    record : Record
    gap : (n,) float
        (1, -1) for u1 - u2.
    families : Families, optional
        As `transitions.families.families_of` gives them, for the same gap coordinate.
    start : StartFamily, optional
        The family that the motion starts on: stages have its name, and say why they do not follow it.
    spectrum : SpectrumRows, optional
        Of the gap coordinate; by default that of the default wavelet, of which a row at a time is kept.
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
        raise ValueError(f"the families are told by the gap coordinate {families.gap}; the stages are asked for that of {tuple(gap)}")
    spectrum = spectrum or morlet_rows(record.times, w, rate)
    if not np.ptp(w) > 0.0:
        return []
    found = ridges(spectrum, record.times, w)
    out: list[Stage] = []
    for interval in held(spectrum, found):
        for part in _parts(record, w, spectrum, found, interval, families):
            stage = _stage(record, spectrum, found, part)
            out.append(stage if start is None or families is None else _beside_start(stage, start, families, record, spectrum, part))
        if on_progress is not None:
            on_progress(float(spectrum.times[interval.last]))
    return out


_Cut = tuple[Sequence[Meeting], int, int, tuple[int, ...]]
"""What a `_Part` has besides its interval."""


@dataclass(frozen=True, eq=False)
class _Part:
    """Part of an interval, and the families that fit it, the best first, at the places `first` to `last` where they are compared, with the
    harmonics of the first that are shown; `matches` are all that the interval was compared with."""

    held: Held
    meetings: Sequence[Meeting] = ()
    first: int = 0
    last: int = 0
    harmonics: tuple[int, ...] = ()
    matches: Sequence[Match] = ()

    def unlike(self, family: str) -> float | None:
        """Mean difference of the lines of a family with this id, at that of its harmonics where it is least; None where it was not
        compared here."""
        part = slice(self.first, self.last + 1)
        own = [match for match in self.matches if match.meeting.family.id == family]
        rows = [match.unlike[part][np.isfinite(match.meeting.deviation[part])] for match in own]
        return min((float(np.mean(row)) for row in rows if len(row)), default=None)


def _parts(
    record: Record, w: np.ndarray, spectrum: SpectrumRows, found: Sequence[Ridge], interval: Held, families: Families | None
) -> list[_Part]:
    """The interval, cut where another family is followed, or other harmonics of it are shown."""
    if families is None:
        return [_Part(interval)]
    step = float(spectrum.times[1] - spectrum.times[0])
    pitch = interval.frequencies
    turns = np.concatenate([[0.0], np.cumsum(0.5 * (pitch[1:] + pitch[:-1]))]) * step / (2.0 * math.pi)
    times = spectrum.times[interval.first : interval.last + 1]
    energy = np.interp(times, record.times, record.energy)
    even = np.linspace(0.0, turns[-1], min(_MOST_PLACES, int(_PLACES * turns[-1]) + 2))
    places = np.unique(np.searchsorted(turns, even).clip(0, len(turns) - 1))
    around = Around(turns, places)
    mean_pitch = np.exp(around.mean(np.log(pitch)))
    mean_energy = np.exp(around.mean(np.log(np.maximum(energy, _NOTHING))))
    at = turns[places]
    meetings = [_where_it_can(item, record, times[places], mean_pitch) for item in families.meet(mean_energy, mean_pitch)]
    lines = lines_of(found, interval, around)

    @cache
    def parts(count: int) -> np.ndarray:
        # An orbit of so many periods of the ridge shows its whole range within half of them on each side.
        size = amplitude_of_motion(record.times, w, times[places], 2.0 * mean_pitch / count)
        return lines.amplitudes / np.maximum(size, _NOTHING)

    @cache
    def rate(length: float) -> np.ndarray:
        # Counted between impacts as well, so that a window's edges do not fall on one side or the other of an impact.
        low, high = (np.interp(edge, turns, times) for edge in around.window(length))
        counts = np.arange(1.0, len(record.impacts) + 1.0)
        impacts = np.interp(high, record.impacts, counts) - np.interp(low, record.impacts, counts) if len(counts) else np.zeros(len(at))
        return np.asarray(impacts / np.subtract(*around.window(length)[::-1]) * length)

    def match(item: Meeting) -> Match:
        k = item.harmonic
        own = item.family.shares_at(item.point, families.gap)
        length = k * math.ceil(HOLDS / k)
        return Match(item, unlike(own, k, lines.ratios, parts(k)), rate(length) - length * item.family.impacts / k)

    matches = [match(item) for item in meetings if lasting(item, at)]
    cut: list[_Cut] = []
    for stretch in stretches(matches, at):
        if stretch.match is None:
            cut.append(((), stretch.first, stretch.last, ()))
            continue
        first, last = int(places[stretch.first]), int(places[stretch.last])
        impacts = _impacts(record, times[first], times[last])
        best = best_of(stretch, matches, impacts, turns[last] - turns[first])
        part = slice(stretch.first, stretch.last + 1)
        own, k = best[0].family.shares_at(best[0].point[part], families.gap).T, best[0].harmonic
        seen = partner(len(own), k, lines.ratios[:, part], parts(k)[:, part])
        shown = (own >= SHARE) & (seen >= SHARE - EQUAL_SHARE)
        shown[k - 1] = True  # the ridge itself
        for begin, end, harmonics in steady(shown, at[part]):
            begin, end = stretch.first + begin, stretch.first + end
            cut.append((best, begin, end, tuple(k + 1 for k in harmonics)))
    return _joined(cut, matches, interval, places, turns)


def _joined(cut: Sequence[_Cut], matches: Sequence[Match], interval: Held, places: np.ndarray, turns: np.ndarray) -> list[_Part]:
    """The parts, each up to where the next one begins; those of no family that last less than three periods are left out."""
    out = []
    for i, (meetings, begin, end, harmonics) in enumerate(cut):
        first = 0 if i == 0 else int(places[begin])
        last = len(turns) - 1 if i + 1 == len(cut) else int(places[cut[i + 1][1]])
        if meetings or turns[last] - turns[first] >= HOLDS:
            part = Held(interval.ridge, interval.first + first, interval.first + last)
            out.append(_Part(part, meetings, begin, end, harmonics, matches))
    return out


def _where_it_can(meeting: Meeting, record: Record, times: np.ndarray, pitch: np.ndarray) -> Meeting:
    """The meeting without the places where the motion has impacts and the family none, or the other way round."""
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


def _stage(record: Record, spectrum: SpectrumRows, found: Sequence[Ridge], part: _Part) -> Stage:
    ridge = part.held
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


def _beside_start(stage: Stage, start: StartFamily, families: Families, record: Record, spectrum: SpectrumRows, part: _Part) -> Stage:
    """The stage with the name of the family that the motion starts on, or with the reason why it does not follow that."""
    if stage.follows is not None and stage.follows.family == start.family:
        return replace(stage, follows=replace(stage.follows, name=start.name))
    ridge = part.held
    times = spectrum.times[ridge.first : ridge.last + 1]
    return replace(stage, why=why_another(start, families, record, stage, times, ridge.frequencies, part.unlike(start.family)))


def _impacts(record: Record, start: float, end: float) -> int:
    return int(np.searchsorted(record.impacts, end, "right") - np.searchsorted(record.impacts, start))


def _companions(found: Sequence[Ridge], part: Held, frequency: float) -> tuple[Companion, ...]:
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
