"""Families of the undamped system as a motion's spectrum meets them: the harmonics of the gap coordinate that their orbits carry.

An orbit of period T shows a ridge at each harmonic k 2 pi/T that carries a part of the amplitude that counts. The frequency is that of the
family's points; the part is read from a handful of orbits along the family, when it is first asked for, and interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from transitions.ridges import SHARE

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.orbit import Orbit
    from bvp.system import ImpactSystem

__all__ = ["NEAR", "Families", "Family", "Meeting", "families_of", "harmonics", "modes_of"]

NEAR = 0.05
"""Octaves within which a ridge is at a harmonic."""

_HARMONICS = 32  # a harmonic beyond does not carry a fifth of an orbit in any family that a catalogue's bounds allow
_SAMPLES = 8 * _HARMONICS
_READ = 9  # orbits that are read of a family


class Meeting(NamedTuple):
    """Where a ridge is at a harmonic k of a family: for each place of the ridge (j,) the deviation in octaves (positive where the ridge is
    above; NaN where it is not there), the part of the orbit's amplitude that the harmonic carries, and where on the family the orbit is."""

    family: Family
    harmonic: int
    deviation: np.ndarray
    share: np.ndarray
    point: np.ndarray


def harmonics(orbit: Orbit, gap: np.ndarray) -> np.ndarray:
    """Parts of an orbit's amplitude that its harmonics carry, (32,): that of k 2 pi/T at index k - 1.

    The amplitude of a harmonic is that of its tone; that of the orbit is half the range of the gap coordinate, turning points at impacts
    included. The part of a tone is 1, of a triangular wave 8/pi^2 in its fundamental.

    Parameters
    ----------
    orbit : Orbit
    gap : (n,) float
    """
    cycle = orbit.cycle
    even = np.arange(_SAMPLES) * (cycle.period / _SAMPLES)
    w = cycle.sample(np.concatenate([even, cycle.times]))[0] @ gap
    tones = 2.0 * np.abs(np.fft.rfft(w[:_SAMPLES])[1 : _HARMONICS + 1]) / _SAMPLES
    half = 0.5 * float(np.ptp(w))
    return tones / half if half > 0.0 else np.zeros(_HARMONICS)


@dataclass(frozen=True, eq=False)
class Family:
    """A family, or a linear mode, with what is needed to meet it.

    Parameters
    ----------
    id : str
    h, alpha : (N,) float
        Energy and quarter period along it, in order.
    labels : (N,) str
    impacts : int
        In a period; 0 of a linear mode.
    load : callable, optional
        Returns the branch; None for a linear mode, whose only harmonic is the first.
    """

    id: str
    h: np.ndarray
    alpha: np.ndarray
    labels: np.ndarray
    impacts: int
    load: Callable[[], Branch] | None = field(default=None, repr=False)

    @cached_property
    def _strands(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Stretches along which the energy rises or falls: its logarithm, rising, and the index of the point."""
        level = np.log(np.maximum(self.h, 1e-300))
        turns = np.flatnonzero(np.diff(np.sign(np.diff(level))) != 0) + 1
        out = []
        for part in np.split(np.arange(len(level) - 1), turns):
            index = np.append(part, part[-1] + 1) if len(part) else part
            if len(index) > 1 and level[index[0]] != level[index[-1]]:
                index = index if level[index[0]] < level[index[-1]] else index[::-1]
                out.append((level[index], index.astype(float)))
        return out

    def read(self, gap: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Harmonics of a handful of orbits: indices (r,) of their points, and the parts (r, 32). An orbit that cannot be corrected at its
        point is passed over; `bvp.multipoint.NotConverged` where none can."""
        if gap not in self._tables:
            from bvp.multipoint import NotConverged

            branch = self.load() if self.load is not None else None
            rows: list[tuple[int, np.ndarray]] = []
            last: NotConverged | None = None
            for i in np.unique(np.linspace(0, len(self.h) - 1, _READ).round().astype(int)).tolist() if branch is not None else []:
                try:
                    rows.append((i, harmonics(branch.orbit(i), np.array(gap))))  # type: ignore[union-attr]
                except NotConverged as failure:
                    last = failure
            if not rows and last is not None:
                raise last
            table = np.array([values for _, values in rows]).reshape(-1, _HARMONICS)
            self._tables[gap] = np.array([i for i, _ in rows], dtype=float), table
        return self._tables[gap]

    @cached_property
    def _tables(self) -> dict[tuple[float, ...], tuple[np.ndarray, np.ndarray]]:
        return {}

    def shares_at(self, point: float | np.ndarray, gap: tuple[float, ...]) -> np.ndarray:
        """Parts (..., 32) of the amplitude that the harmonics carry at places of the family, indices (...) of its points or between two."""
        if self.load is None:
            return np.broadcast_to(np.eye(1, _HARMONICS)[0], (*np.shape(point), _HARMONICS))
        at, table = self.read(gap)
        return np.stack([np.interp(point, at, column) for column in table.T], axis=-1)

    def label_at(self, point: float) -> str:
        """The label at a place of the family, an index of its points or between two."""
        return str(self.labels[round(point)])

    def closest(
        self, energies: np.ndarray, frequencies: np.ndarray, gap: tuple[float, ...]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The closest harmonic at energies and frequencies (j,): base-2 logarithm of the frequency of the orbit, harmonic, and the part of
        the amplitude that it carries; NaN, 1 and 0 where no orbit has the energy."""
        level, pitch = np.log(energies), np.log2(frequencies)
        pitches = np.log2(0.5 * math.pi / self.alpha)
        own, harmonic, place = np.full(len(level), np.nan), np.ones(len(level)), np.zeros(len(level))
        least = np.full(len(level), np.inf)
        for rising, index in self._strands:
            at = np.interp(level, rising, index)
            mine = np.interp(at, np.arange(len(pitches)), pitches)
            near = np.clip(np.round(2.0 ** np.clip(pitch - mine, -1.0, 10.0)), 1.0, _HARMONICS)
            away = np.abs(pitch - mine - np.log2(near))
            better = (level >= rising[0]) & (level <= rising[-1]) & (away < least)
            own[better], harmonic[better], place[better], least[better] = mine[better], near[better], at[better], away[better]
        shares = self.shares_at(place, gap)[np.arange(len(level)), harmonic.astype(int) - 1]
        return own, harmonic, np.where(np.isfinite(own), shares, 0.0)

    def meet(self, energies: np.ndarray, frequencies: np.ndarray, gap: tuple[float, ...]) -> list[Meeting]:
        """Its harmonics that carry a fifth of the orbit's amplitude and are within 0.05 octave, at energies and frequencies (j,)."""
        level, pitch = np.log(energies), np.log2(frequencies)
        if self.load is None:
            there = energies <= self.h[-1] * (1.0 + 1e-12)
            away = pitch - math.log2(0.5 * math.pi / self.alpha[0])
            deviation = np.where(there & (np.abs(away) <= NEAR), away, np.nan)
            return [Meeting(self, 1, deviation, np.ones(len(away)), np.zeros(len(away)))] if np.isfinite(deviation).any() else []
        own = np.log2(0.5 * math.pi / self.alpha)
        found: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        for rising, index in self._strands:
            inside = (level >= rising[0]) & (level <= rising[-1])
            if not inside.any():
                continue
            place = np.interp(level[inside], rising, index)
            ratio = pitch[inside] - np.interp(place, np.arange(len(own)), own)
            near = np.clip(np.round(2.0 ** np.clip(ratio, -1.0, 10.0)), 1, None)
            away = ratio - np.log2(near)
            fits = (np.abs(away) <= NEAR) & (near <= _HARMONICS)
            if not fits.any():
                continue
            at, table = self.read(gap)
            for k in np.unique(near[fits]).astype(int).tolist():
                share = np.interp(place, at, table[:, k - 1])
                mine = fits & (near == k) & (share >= SHARE)
                if not mine.any():
                    continue
                deviation, shares, points = found.setdefault(k, (np.full(len(level), np.nan), np.zeros(len(level)), np.zeros(len(level))))
                rows = np.flatnonzero(inside)[mine]
                better = ~(np.abs(deviation[rows]) <= np.abs(away[mine]))
                rows = rows[better]
                deviation[rows], shares[rows], points[rows] = away[mine][better], share[mine][better], place[mine][better]
        return [Meeting(self, k, *found[k]) for k in sorted(found)]


@dataclass(frozen=True, eq=False)
class Families:
    """Families of one system, and the gap coordinate by whose harmonics they are told.

    Parameters
    ----------
    members : sequence of Family
    gap : tuple of n floats
    """

    members: Sequence[Family]
    gap: tuple[float, ...]

    def meet(self, energies: np.ndarray, frequencies: np.ndarray) -> list[Meeting]:
        """All meetings, at energies and angular frequencies (j,)."""
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
        A catalogue has to stay open while the families are met: their orbits are read when they are first asked for.
    gap : (n,) float, optional
        Gap coordinate; by default absorber minus primary, else that of the first stop.

    Raises
    ------
    ValueError
        For no branch, branches of several systems, or a gap coordinate of another length.
    """
    from branches.catalogue import Catalogue

    if isinstance(source, Catalogue):
        members, system = _of_catalogue(source), source.system
    else:
        members, system = _of_branches(source)
    if gap is None:
        gap = relative(system)
    if len(gap) != system.degrees_of_freedom:
        raise ValueError(f"the gap coordinate has {len(gap)} entries; the families have {system.degrees_of_freedom} coordinates")
    return Families((*_modes(system), *members), tuple(float(x) for x in gap))


def modes_of(system: ImpactSystem) -> Families:
    """The linear modes of a conservative system alone, told by `relative` of it."""
    return Families(_modes(system), relative(system))


def relative(system: ImpactSystem) -> tuple[float, ...]:
    """Absorber minus primary where the system has them, else the gap coordinate of its first stop."""
    if system.absorber is None or system.primary is None:
        return tuple(system.stops[0].gap)
    row = np.zeros(system.degrees_of_freedom)
    row[system.absorber], row[system.primary] = 1.0, -1.0
    return tuple(row.tolist())


def _of_catalogue(catalogue: Catalogue) -> list[Family]:
    out = []
    for row in catalogue.families():
        h, alpha, labels = zip(*catalogue.track(row), strict=True)
        impacts = round(2.0 * row.impacts)
        out.append(Family(row.id, np.array(h), np.array(alpha), np.array(labels), impacts, partial(catalogue.branch, row.id)))
    return out


def _of_branches(branches: Iterable[Branch]) -> tuple[list[Family], ImpactSystem]:
    from branches.words import impacts_per_period

    out: list[Family] = []
    system = None
    for branch in branches:
        if system is not None and branch.system.describe() != system.describe():
            raise ValueError(f"the family {branch.label or branch.id} belongs to another system than those before it")
        system = branch.system
        points = branch.points
        impacts = round(impacts_per_period(branch.problem.word, branch.ends))
        out.append(Family(branch.id, points["h"], points["alpha"], points["label"].astype(str), impacts, partial(_itself, branch)))
    if system is None:
        raise ValueError("there is no family to follow; expected one branch or more")
    return out, system


def _itself(branch: Branch) -> Branch:
    return branch


def _modes(system: ImpactSystem) -> list[Family]:
    from branches.linear_modes import linear_modes

    return [
        Family(mode.name, np.array(mode.energies), np.full(2, mode.alpha), np.array([mode.name] * 2), 0) for mode in linear_modes(system)
    ]
