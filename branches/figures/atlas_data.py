"""The data of figures of many families, as plain columns: collected from branches, or read from an exported file.

A figure is drawn from these columns alone, so it can be drawn again from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.naming.labels import Label, parse, parse_name
from branches.naming.matching import ReferencePoint, fits_otherwise, matches, nearest_crossing, reaches, spelled
from bvp.checks import checked_energy_range, require_branch
from bvp.texts import brief, shown

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.orbit import Orbit
    from branches.search.impulsive_motions import Manifold
    from branches.search.impulsive_orbits import ImpulsiveOrbits
    from bvp.system import ImpactSystem

__all__ = ["EVENTS", "Atlas", "Bound", "AtlasCurve", "Threshold", "atlas_of", "regime_bounds", "rescaled"]

_NO_POINTS: Mapping[str, ReferencePoint] = MappingProxyType({})

COLUMNS = ("h", "alpha", "frequency", "frequency_index", "half_waves", "stable")
"""Columns of numbers of a family, besides `velocities` and `label`; named as in the files of a branch."""

EVENTS = ("SN", "SB", "PD", "GR")
"""Types of special points that are marked in figures of many families; the first of those at one point counts."""


@brief
@dataclass(frozen=True, eq=False)
class AtlasCurve:
    """A family: its id, and columns of length N.

    names : (N,) str, what the family is called at each point: its label, or a name that a scene cites. cited : (N,) bool, where it is
    that. h, alpha, frequency, frequency_index : (N,) float. half_waves : (N,) int. stable : (N,) int, 1, 0, or -1 where it is undecided.
    velocities : (N, n), NaN where the start is not at the origin. labels : (N,) str. events : (N,) str, the type of the special point
    there, one of `EVENTS`, or "".
    """

    family: str
    names: np.ndarray
    cited: np.ndarray
    h: np.ndarray
    alpha: np.ndarray
    frequency: np.ndarray
    frequency_index: np.ndarray
    half_waves: np.ndarray
    stable: np.ndarray
    velocities: np.ndarray
    labels: np.ndarray
    events: np.ndarray

    @property
    def label(self) -> str:
        """What it is called where no name is cited; "" where one is everywhere."""
        return str(self.names[np.argmin(self.cited)]) if len(self.names) and not self.cited.all() else ""


@dataclass(frozen=True)
class Threshold:
    """A linear mode: label, angular frequency, and the energy at which it grazes the stops."""

    label: str
    frequency: float
    h: float


@dataclass(frozen=True)
class Bound:
    """An energy that separates two regimes, and the reason: ("I", "II", h, "L11- grazes")."""

    below: str
    above: str
    h: float
    what: str


@brief
@dataclass(frozen=True, eq=False)
class Atlas:
    """All that is drawn, in the units of the scale.

    manifold : (h, frequency, joined) of the impulsive motions, joined (N,) bool says whether a point is joined to the next.
    impulsive : columns h, alpha, frequency, frequency_index, velocities of the periodic impulsive orbits, and their labels.
    clearance, natural_frequency : lengths and angular frequencies are these times the dimensionless ones.
    energy : the range that was asked for, if one was; linear modes that graze below it are not shown.
    """

    system: ImpactSystem
    curves: tuple[AtlasCurve, ...] = ()
    manifold_h: np.ndarray = field(default_factory=lambda: np.zeros(0))
    manifold_frequency: np.ndarray = field(default_factory=lambda: np.zeros(0))
    manifold_joined: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    manifold_window: str = ""
    manifold_periods: int = 0
    impulsive: AtlasCurve | None = None
    bounds: tuple[Bound, ...] = ()
    clearance: float = 1.0
    natural_frequency: float = 1.0
    energy: tuple[float, float] | None = None

    @property
    def energy_unit(self) -> float:
        """The dimensionless energy 1 in the units of the scale."""
        return (self.clearance * self.natural_frequency) ** 2

    @property
    def manifold_velocities(self) -> np.ndarray:
        """(N, n) start velocities of the impulsive motions: only the primary moves, in the positive direction, with all of the energy."""
        from branches.search.impulsive_motions import impulsive_state

        if not len(self.manifold_h):
            return np.zeros((0, len(self.system.coordinates)))
        # Energies are scaled by the square of what velocities are scaled by.
        return np.sqrt(self.manifold_h)[:, None] * impulsive_state(self.system, 1.0)[1]

    @property
    def thresholds(self) -> list[Threshold]:
        """The linear modes that are shown, in the units of the scale."""
        from branches.linear_modes import linear_modes

        found = [
            Threshold(mode.name, mode.frequency * self.natural_frequency, mode.energies[1] * self.energy_unit)
            for mode in linear_modes(self.system)
        ]
        return [mode for mode in found if self.energy is None or mode.h >= self.energy[0]]


def atlas_of(
    system: ImpactSystem,
    branches: Iterable[Branch],
    *,
    reference_points: Mapping[str, ReferencePoint] = _NO_POINTS,
    manifold: Manifold | None = None,
    impulsive: ImpulsiveOrbits | None = None,
    bounds: Sequence[Bound] = (),
    energy: tuple[float, float] | None = None,
) -> Atlas:
    """Collect families, impulsive orbits and bounds in one `Atlas`, which `saltus.draw_atlas` draws and `saltus.write_atlas` writes.

    Parameters
    ----------
    system : ImpactSystem
    branches : iterable of Branch
        Of this system.
    reference_points : mapping of names to {"h", "alpha"}
        Names that are written first where there is no room for all; see `cited_names`.
    manifold, impulsive : as `branches.search.impulsive_orbits` and `impulsive_motions` make them, optional
    bounds : sequence of Bound
        Bounds of regimes, as from `regime_bounds`.
    energy : (float, float), optional
        What lies outside is left out; where a family passes a bound, its orbit there is the last.

    Raises
    ------
    ValueError
        For a branch of another system, and for energies that are no range.
    """
    branches = list(branches)
    for branch in branches:
        require_branch(branch)
    energy = None if energy is None else checked_energy_range(energy)
    named = cited_names(branches, reference_points)
    curves = []
    for branch in branches:
        if branch.system is not system and branch.system.describe() != system.describe():
            raise ValueError(f"the family {branch.label or branch.id} belongs to another system than the figure")
        for piece in _pieces(branch, *(energy or (-math.inf, math.inf))):
            labels = piece["label"]
            label = branch.label if branch.label in labels else str(labels[len(labels) // 2])
            columns = {name: piece[name] for name in COLUMNS}
            names, marked = np.full(len(labels), spelled(label, reference_points), dtype=object), np.zeros(len(labels), dtype=bool)
            for name in named.get(branch.id, ()):
                mine = name.points(columns["h"], columns["alpha"], labels.tolist())
                names[mine], marked[mine] = name.text, True
            columns |= {"names": names.astype(str), "cited": marked, "labels": labels.astype(str), "events": _events(branch, piece)}
            curves.append(AtlasCurve(branch.id, velocities=piece["velocities"], **columns))
    atlas = Atlas(system, tuple(curves), bounds=tuple(bounds), energy=energy)
    if manifold is not None:
        kept = np.isfinite(manifold.frequency)
        index = np.flatnonzero(kept)
        joined = np.zeros(len(index), dtype=bool)
        joined[:-1] = (np.diff(index) == 1) & ~manifold.breaks[index[:-1]]
        atlas = replace(
            atlas,
            manifold_h=manifold.h[kept],
            manifold_frequency=manifold.frequency[kept],
            manifold_joined=joined,
            manifold_window=manifold.window,
            manifold_periods=manifold.periods,
        )
    if impulsive is not None and impulsive.orbits:
        atlas = replace(atlas, impulsive=_impulsive_curve(impulsive))
    return atlas


def _pieces(branch: Branch, low: float, high: float) -> list[dict[str, np.ndarray]]:
    """The columns of the pieces of a branch within low <= h <= high, in order of arclength.

    Without the orbits at the bounds a family that has no point within a narrow range would be left out, and every other one would end
    before the bound, at its last point within. A bound where the corrector fails is left out.
    """
    h = branch.points["h"]
    places: dict[float, Orbit | None] = dict.fromkeys(np.flatnonzero((h >= low) & (h <= high)).astype(float).tolist())
    for bound in (low, high):
        for i in np.flatnonzero((h[:-1] - bound) * (h[1:] - bound) < 0.0).tolist():
            orbit = _between(branch, i, bound)
            if orbit is not None:
                places[i + (bound - h[i]) / (h[i + 1] - h[i])] = orbit
    order = np.array(sorted(places))
    # All points within are there: any point between two successive places is outside.
    ends = np.flatnonzero(np.ceil(order[1:]) - np.floor(order[:-1]) > 1.0) + 1
    pieces = [[(int(place), places[place]) for place in piece] for piece in np.split(order, ends)]
    names = (*COLUMNS, "label", "velocities", "arclength")
    return [{name: _column(branch, piece, name) for name in names} for piece in pieces if piece]


def _between(branch: Branch, i: int, energy: float) -> Orbit | None:
    """The orbit of an energy between points i and i + 1; None where the corrector fails, or ends on another orbit."""
    h, alpha = branch.points["h"], branch.points["alpha"]
    part = (energy - h[i]) / (h[i + 1] - h[i])
    orbit = branch.orbit_between(i, part, energy=energy)
    if orbit is None:
        return None
    off = abs(orbit.alpha - (1.0 - part) * alpha[i] - part * alpha[i + 1])
    return orbit if off <= abs(alpha[i + 1] - alpha[i]) + 1e-3 * alpha[i] else None


def _column(branch: Branch, piece: Sequence[tuple[int, Orbit | None]], name: str) -> np.ndarray:
    column: Any = branch.points[name]
    values = [column[i] if orbit is None else orbit.columns[name][0] for i, orbit in piece]
    return np.array(values, dtype=None if column.dtype.kind == "U" else column.dtype)  # a label may be longer than all that are kept


def _events(branch: Branch, piece: Mapping[str, np.ndarray]) -> np.ndarray:
    """The types (N,) of the special points of a piece: events are located at points of the branch."""
    at = branch.points["arclength"].tolist(), branch.points["h"].tolist()
    known = {(at[0][e.point], at[1][e.point]): e.type for kind in reversed(EVENTS) for e in branch.events if e.type == kind}
    places = zip(piece["arclength"].tolist(), piece["h"].tolist(), strict=True)
    return np.array([known.get(place, "") for place in places], dtype="<U2")


class CitedName(NamedTuple):
    """A name that a family goes by: at the points whose label it is, or, where the half-waves are counted otherwise, at the energy and
    quarter period of the reference point."""

    text: str
    label: Label
    h: float | None = None
    alpha: float | None = None

    def points(self, h: np.ndarray, alpha: np.ndarray, labels: Sequence[str]) -> np.ndarray:
        """Which of some successive points (N,) of the family go by the name."""
        if self.h is None or self.alpha is None:
            return np.array([_test(matches, self.label)(label) for label in labels], dtype=bool)
        mine = np.zeros(len(h), dtype=bool)
        if h.min() <= self.h <= h.max():
            mine[np.argmin(np.hypot(np.log(h / self.h), np.log(alpha / self.alpha)))] = True
        return mine


def cited_names(branches: Iterable[Branch], points: Mapping[str, ReferencePoint]) -> dict[str, list[CitedName]]:
    """The names that a scene cites for families, by their ids.

    `points` are the reference points {"h", "alpha"} by name, with both, one or none of the values. One with both is for the single family
    that has the orbit: of those with the label, or else of those that have its impacts. Another one is for every family with the label.
    """
    families = [(branch, set(branch.points["label"].tolist())) for branch in branches]
    out: dict[str, list[CitedName]] = {}
    for text, point in points.items():
        label, h = parse_name(text).label, point.get("h")
        if label is not None:
            near = [some for some in families if h is None or reaches((some[0].points["h"].min(), some[0].points["h"].max()), h)]
            for id, name in _named(near, text, label, h, point.get("alpha")):
                out.setdefault(id, []).append(name)
    return out


def _named(
    families: Sequence[tuple[Branch, set[str]]], text: str, label: Label, h: float | None, alpha: float | None
) -> Iterator[tuple[str, CitedName]]:
    for same in (matches, fits_otherwise):
        fits = _test(same, label)
        distances = {}
        for branch in (branch for branch, labels in families if any(map(fits, labels))):
            track = list(zip(*(branch.points[name].tolist() for name in ("h", "alpha", "label")), strict=True))
            crossing = (0.0,) if h is None and alpha is None else nearest_crossing(track, h, alpha, fits)
            if crossing is not None:
                distances[branch.id] = crossing[0]
        if h is None or alpha is None:
            yield from ((id, CitedName(text, label)) for id in distances)
            return
        if distances:
            yield min(distances, key=lambda id: distances[id]), CitedName(text, label, *(() if same is matches else (h, alpha)))
            return


@cache
def _test(same: Callable[[Label, Label], bool], label: Label) -> Callable[[str], bool]:
    return cache(lambda text: bool(text) and same(label, parse(text)))


def _impulsive_curve(found: ImpulsiveOrbits) -> AtlasCurve:
    """The impulsive orbits as one curve without a name: unconnected points of the figure."""
    labels = [orbit.label for orbit in found.orbits]
    waves = np.array([parse(label).m if label else 1 for label in labels])
    h, alpha = np.array([(orbit.h, orbit.alpha) for orbit in found.orbits]).T
    frequency = 0.5 * math.pi / alpha
    return AtlasCurve(
        "",
        names=np.full(len(labels), ""),
        cited=np.zeros(len(labels), dtype=bool),
        h=h,
        alpha=alpha,
        frequency=frequency,
        frequency_index=waves * frequency,
        half_waves=waves,
        stable=np.array([-1 if orbit.orbit.stable is None else int(orbit.orbit.stable) for orbit in found.orbits], dtype=np.int8),
        velocities=np.array([orbit.orbit.velocities for orbit in found.orbits]),
        labels=np.array(labels),
        events=np.full(len(labels), "", dtype="<U2"),
    )


def regime_bounds(system: ImpactSystem, branches: Iterable[Branch]) -> tuple[tuple[Bound, ...], list[str]]:
    """The energies that separate the regimes I to IV, as far as the given families show them.

    The paper (Lee et al., Physica D 238 (2009) 1868, Fig. 6) gives no numbers; these are ours: I/II where L11- grazes; II/III at the
    symmetry breaking of S13+ of lowest energy; III/IV at the impulsive orbit on the family of S31O11.

    Returns
    -------
    bounds : tuple of Bound
    missing : list of str
        What could not be found, as messages.
    """
    bounds, missing = [], []
    mode = next((mode for mode in Atlas(system).thresholds if mode.label == "L11-"), None)
    if mode is not None:
        bounds.append(Bound("I", "II", mode.h, "L11- grazes"))
    else:
        missing.append("I/II: the system has no mode L11-")
    branches = list(branches)
    for below, above, pattern, kind, what in (
        ("II", "III", "S13O00+", "SB", "SB of S13+"),
        ("III", "IV", "S31O11", "IO", "IO of S31O11"),
    ):
        found = [
            event.h
            for branch in branches
            if any(alias["label"].startswith(pattern) for alias in branch.aliases)
            for event in branch.events
            if event.type == kind
        ]
        if found:
            bounds.append(Bound(below, above, min(found), what))
        else:
            missing.append(f"{below}/{above}: no family given has {pattern} with an event {kind}")
    return tuple(bounds), missing


def rescaled(atlas: Atlas, clearance: float = 1.0, natural_frequency: float = 1.0) -> Atlas:
    """The same in units: lengths times the clearance, angular frequencies times the oscillator's natural one (radians a second).

    Energies are then those of an oscillator of unit mass, (clearance x natural frequency)^2 h.

    Raises
    ------
    ValueError
        For a factor that is not above 0, and for an atlas that is scaled already.
    """
    for name, value in (("clearance", clearance), ("natural_frequency", natural_frequency)):
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} = {shown(value)}: expected a number above 0")
    if (atlas.clearance, atlas.natural_frequency) != (1.0, 1.0):
        raise ValueError(f"the data have a clearance of {atlas.clearance:g} already; scale dimensionless data")
    speed = clearance * natural_frequency

    def scale(curve: AtlasCurve) -> AtlasCurve:
        changed: dict[str, Any] = {
            "h": curve.h * speed**2,
            "alpha": curve.alpha / natural_frequency,
            "frequency": curve.frequency * natural_frequency,
            "frequency_index": curve.frequency_index * natural_frequency,
            "velocities": curve.velocities * speed,
        }
        return replace(curve, **changed)

    return replace(
        atlas,
        curves=tuple(scale(curve) for curve in atlas.curves),
        manifold_h=atlas.manifold_h * speed**2,
        manifold_frequency=atlas.manifold_frequency * natural_frequency,
        impulsive=None if atlas.impulsive is None else scale(atlas.impulsive),
        bounds=tuple(replace(bound, h=bound.h * speed**2) for bound in atlas.bounds),
        clearance=clearance,
        natural_frequency=natural_frequency,
        energy=None if atlas.energy is None else (atlas.energy[0] * speed**2, atlas.energy[1] * speed**2),
    )
