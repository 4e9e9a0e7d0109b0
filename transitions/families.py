"""Families of the undamped system, for comparison with a motion's spectrum: the harmonics of the gap coordinate along each family.

An orbit of period T shows a ridge at each harmonic k 2 pi/T with a large enough share of its amplitude. The frequency is that of the
family's points. The shares are read from a few orbits along the family, when they are first needed, and interpolated.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bvp.checks import require_branch
from bvp.texts import brief
from transitions.frequencies import SHARE, runs

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.orbit import Orbit
    from bvp.system import ImpactSystem

__all__ = ["NEAR", "Families", "FamilyHarmonics", "Meeting", "families_of", "harmonics", "modes_of", "relative"]

NEAR = 0.05
"""Largest distance of a ridge from a harmonic, in octaves."""

_HARMONICS = 32  # higher harmonics have less than a fifth of the amplitude in any family that a catalogue's bounds allow
_SAMPLES = 8 * _HARMONICS
_READ = 9  # orbits that are read of a family
_ROUNDING = 1e-12  # of the logarithm of the highest energy of a family


class Meeting(NamedTuple):
    """A harmonic of a family that a ridge is at, at the places (j,) of the ridge."""

    family: FamilyHarmonics
    harmonic: int
    deviation: np.ndarray  # (j,) in octaves, positive if the ridge is above; NaN if the ridge is not there
    share: np.ndarray  # (j,) share of the orbit's amplitude that the harmonic has
    point: np.ndarray  # (j,) place of the orbit on the family


class _Nearest(NamedTuple):
    """The harmonics nearest to a ridge, in one interval of a family."""

    rows: np.ndarray  # (i,) places of the ridge whose energy occurs in the interval
    point: np.ndarray  # (i,) place of the orbit with this energy
    pitch: np.ndarray  # (i,) base-2 logarithm of its frequency
    harmonic: np.ndarray  # (i,) int
    away: np.ndarray  # (i,) octaves from the harmonic to the ridge


def harmonics(orbit: Orbit, gap: np.ndarray) -> np.ndarray:
    """Shares of an orbit's amplitude that its harmonics have, (32,): harmonic k 2 pi/T at index k - 1.

    The amplitude of the orbit is half the range of the gap coordinate, with its turning points at impacts. A tone has the share 1. The
    fundamental of a triangular wave has 8/pi^2.
    """
    cycle = orbit.cycle
    even = np.arange(_SAMPLES) * (cycle.period / _SAMPLES)
    w = cycle.sample(np.concatenate([even, cycle.times]))[0] @ gap
    tones = 2.0 * np.abs(np.fft.rfft(w[:_SAMPLES])[1 : _HARMONICS + 1]) / _SAMPLES
    half = 0.5 * float(np.ptp(w))
    return tones / half if half > 0.0 else np.zeros(_HARMONICS)


@brief
@dataclass(frozen=True, eq=False)
class FamilyHarmonics:
    """A family, or a linear mode."""

    id: str
    h: np.ndarray  # (N,) energy of its points, in order
    alpha: np.ndarray  # (N,) quarter period
    labels: np.ndarray  # (N,)
    impacts: int  # in a period; 0 of a linear mode
    # The branch, or a function that returns it. None for a linear mode, which has its first harmonic alone.
    load: Branch | Callable[[], Branch] | None = field(default=None, repr=False)

    @cached_property
    def _intervals(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Intervals in which the energy rises or falls: its logarithm, rising, and the index of the point."""
        level = np.log(np.maximum(self.h, 1e-300))
        signs = np.sign(np.diff(level))
        parts = [np.arange(first, stop + 1) for first, stop in runs(signs) if stop > first and signs[first]]
        rising = [part[:: int(signs[part[0]])] for part in parts]
        return [(level[part], part.astype(float)) for part in rising]

    @cached_property
    def _tables(self) -> dict[tuple[float, ...], tuple[np.ndarray, np.ndarray]]:
        return {}

    def _read(self, gap: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Harmonics of a few orbits: indices (r,) of their points, and the shares (r, 32). Orbits whose correction fails are left out.
        If all fail, the function raises `bvp.multipoint.NotConverged`."""
        if gap not in self._tables:
            from bvp.multipoint import NotConverged

            assert self.load is not None
            branch = self.load() if callable(self.load) else self.load
            rows: dict[int, np.ndarray] = {}
            for i in np.unique(np.linspace(0, len(self.h) - 1, _READ).round().astype(int)).tolist():
                with contextlib.suppress(NotConverged):
                    rows[i] = harmonics(branch.orbit(i), np.array(gap))
            if not rows:
                raise NotConverged(f"no orbit of the family {self.id} converges")
            self._tables[gap] = np.array(list(rows), dtype=float), np.array(list(rows.values()))
        return self._tables[gap]

    def shares_at(self, point: float | np.ndarray, gap: tuple[float, ...]) -> np.ndarray:
        """Share of each harmonic in the amplitude of the gap coordinate, (..., 32), at the points `point` (...) of the family.

        A fractional index interpolates between two points. Without `load` the first harmonic has the whole amplitude."""
        if self.load is None:
            return np.broadcast_to(np.eye(1, _HARMONICS)[0], (*np.shape(point), _HARMONICS))
        at, table = self._read(gap)
        return np.stack([np.interp(point, at, column) for column in table.T], axis=-1)

    def _share_of(self, harmonic: np.ndarray, point: np.ndarray, gap: tuple[float, ...]) -> np.ndarray:
        """Share (i,) of the amplitude that one harmonic has at each place."""
        return np.take_along_axis(self.shares_at(point, gap), harmonic[:, None] - 1, axis=1)[:, 0]

    def _nearest(self, energies: np.ndarray, frequencies: np.ndarray) -> Iterator[_Nearest]:
        """The harmonics nearest to energies and frequencies (j,), for each interval of the family in which some of the energies occur."""
        level, pitch = np.log(energies), np.log2(frequencies)
        pitches = np.log2(0.5 * math.pi / self.alpha)
        for rising, index in self._intervals:
            rows = np.flatnonzero((level >= rising[0]) & (level <= rising[-1] + _ROUNDING))
            if len(rows):
                point = np.interp(level[rows], rising, index)
                own = np.interp(point, np.arange(len(pitches)), pitches)
                ratio = pitch[rows] - own
                harmonic = np.clip(np.round(2.0 ** np.clip(ratio, -1.0, 10.0)), 1, _HARMONICS).astype(int)
                yield _Nearest(rows, point, own, harmonic, ratio - np.log2(harmonic))

    def closest(self, energies: np.ndarray, frequencies: np.ndarray, gap: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The closest harmonic at energies and frequencies (j,): base-2 logarithm of the frequency of the orbit, harmonic, and its share of
        the amplitude. NaN, 1 and any share if no orbit has the energy."""
        count = len(energies)
        own, harmonic, point, least = np.full(count, np.nan), np.ones(count, dtype=int), np.zeros(count), np.full(count, np.inf)
        for near in self._nearest(energies, frequencies):
            better = np.abs(near.away) < least[near.rows]
            rows = near.rows[better]
            own[rows], harmonic[rows], point[rows] = near.pitch[better], near.harmonic[better], near.point[better]
            least[rows] = np.abs(near.away[better])
        return own, harmonic, self._share_of(harmonic, point, gap)

    def meet(self, energies: np.ndarray, frequencies: np.ndarray, gap: tuple[float, ...]) -> list[Meeting]:
        """Its harmonics within 0.05 octave of energies and frequencies (j,) that have a fifth of the orbit's amplitude."""
        count = len(energies)
        found: dict[int, Meeting] = {}
        for near in self._nearest(energies, frequencies):
            fits = np.flatnonzero(np.abs(near.away) <= NEAR)
            if not len(fits):
                continue
            share = self._share_of(near.harmonic[fits], near.point[fits], gap)
            fits, share = fits[share >= SHARE], share[share >= SHARE]
            for k in np.unique(near.harmonic[fits]).tolist():
                meeting = found.setdefault(k, Meeting(self, k, np.full(count, np.nan), np.zeros(count), np.zeros(count)))
                here = near.harmonic[fits] == k
                # Of two intervals the nearer one counts.
                here &= ~(np.abs(meeting.deviation[near.rows[fits]]) <= np.abs(near.away[fits]))
                rows, own = near.rows[fits][here], fits[here]
                meeting.deviation[rows], meeting.share[rows], meeting.point[rows] = near.away[own], share[here], near.point[own]
        return [found[k] for k in sorted(found)]


@brief
@dataclass(frozen=True, eq=False)
class Families:
    """Families of one system, and the gap coordinate whose harmonics are compared."""

    members: Sequence[FamilyHarmonics]
    gap: tuple[float, ...]

    def meet(self, energies: np.ndarray, frequencies: np.ndarray) -> list[Meeting]:
        """All meetings at energies and angular frequencies (j,)."""
        low, high = float(np.min(energies)), float(np.max(energies))
        out: list[Meeting] = []
        for family in self.members:
            if family.h.min() <= high and family.h.max() >= low:
                out += family.meet(energies, frequencies, self.gap)
        return out


def families_of(source: Catalogue | Iterable[Branch], gap: Sequence[float] | None = None) -> Families:
    """The families of a catalogue, or branches of one system, with the linear modes.

    Parameters
    ----------
    source : Catalogue, or branches
        A catalogue must stay open while the families are in use: their orbits are read when they are first needed.
    gap : (n,) float, optional
        Gap coordinate; by default that of `relative`.

    Raises
    ------
    ValueError
        For no branch, branches of several systems, or a gap coordinate of another length.
    """
    from branches.catalogue import Catalogue

    members, system = (_of_catalogue(source), source.system) if isinstance(source, Catalogue) else _of_branches(source)
    if gap is None:
        gap = relative(system)
    if len(gap) != system.degrees_of_freedom:
        raise ValueError(f"the gap coordinate has {len(gap)} entries; the families have {system.degrees_of_freedom} coordinates")
    return Families((*_modes(system), *members), tuple(float(x) for x in gap))


def modes_of(system: ImpactSystem) -> Families:
    """The linear modes of a conservative system alone, with `relative` as gap coordinate."""
    return Families(_modes(system), relative(system))


def relative(system: ImpactSystem) -> tuple[float, ...]:
    """Absorber minus primary if the system has them, else the gap of its first stop, else what the first smooth force acts on."""
    if system.absorber is None or system.primary is None:
        if system.stops:
            return tuple(system.stops[0].gap)
        assert system.smooth_forces is not None
        return tuple(system.smooth_forces.directions[0].tolist())
    unit = np.eye(system.degrees_of_freedom)
    return tuple((unit[system.absorber] - unit[system.primary]).tolist())


def _of_catalogue(catalogue: Catalogue) -> list[FamilyHarmonics]:
    out = []
    for row in catalogue.families():
        h, alpha, labels = zip(*catalogue.track(row), strict=True)
        load = partial(catalogue.branch, row.id)
        out.append(FamilyHarmonics(row.id, np.array(h), np.array(alpha), np.array(labels), round(2.0 * row.impacts), load))
    return out


def _of_branches(branches: Iterable[Branch]) -> tuple[list[FamilyHarmonics], ImpactSystem]:
    from branches.sequences import impacts_per_period

    out: list[FamilyHarmonics] = []
    system = None
    for branch in branches:
        require_branch(branch)
        if system is not None and branch.system.describe() != system.describe():
            raise ValueError(f"the family {branch.label or branch.id} belongs to another system than those before it")
        system = branch.system
        points = branch.points
        impacts = round(impacts_per_period(branch.problem.sequence, branch.ends))
        labels = points["label"].astype(str)
        out.append(FamilyHarmonics(branch.id, points["h"], points["alpha"], labels, impacts, branch))
    if system is None:
        raise ValueError("there is no family to follow; expected one branch or more")
    return out, system


def _modes(system: ImpactSystem) -> list[FamilyHarmonics]:
    from branches.linear_modes import linear_modes

    return [
        FamilyHarmonics(mode.name, np.array(mode.energies), np.full(2, mode.alpha), np.array([mode.name] * 2), 0)
        for mode in linear_modes(system)
    ]
