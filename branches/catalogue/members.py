"""Identification of the family that an orbit belongs to, and the orbits that edges store for their events.

An orbit belongs to a family if it is a point of the family's curve. It must lie between two neighbouring points of the family, and, after
a correction on the hyperplane through the orbit, on the curve to within the error of both.
An edge stores the orbit of its event as each of the two families has it, so that `check` can verify that the families meet.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import saltus_core as core

from branches.catalogue.rows import Edge, EventOrbit
from branches.presentation import (
    Presentation,
    all_presentations,
    closed_presentations,
    embed,
    presentation_of,
    presentations,
    segment_images,
    solved,
)  # fmt: skip
from branches.search.known import Boxes, Kind, boxes_between
from branches.sequences import PERIODIC, Ends, ImpactSequence, format_ends, impacts_per_period
from bvp.checks import require_branch
from bvp.closures import cycle_of
from bvp.dense import inner, length, product
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.smooth_flights import flight_of, modal_energies, sample_path

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue.store import CatalogueStore
    from branches.events import BranchEvent
    from branches.orbit import Orbit
    from bvp.system import ImpactSystem

__all__ = [
    "COMPARED", "FamilyPlace", "KnownFamilies", "distances_from_orbit", "event_orbit", "family_of", "kept_orbit", "orbit_of_event",
    "presented", "seen_from", "switch_edge", "unknowns_of",
]  # fmt: skip

NEAR = 0.1
"""Distance from the chord between two points, relative to its length, within which the curve is tried. Steps turn by a twentieth, so the
curve stays within a hundredth of its chord."""

ON = 1e-7
"""Largest distance of an orbit from a family's curve, in the metric of the arclength, to belong to it. Orbits are located to 1e-10."""

COMPARED = ("h", "alpha", "arclength", "start_u", "start_v", "flight_times")
"""Columns of a branch's points by which its family is recognised."""

_STEPS = 3
"""Corrections on the hyperplane: it is flat in the unknowns, and nearly flat in the metric."""

_MARGIN = 1e-6
"""Largest relative distance of an orbit's energy from the range of a family that is tried."""


class FamilyPlace(NamedTuple):
    """A place on a known family: the family's id, and the arclength there."""

    id: str
    arclength: float


class _Curve:
    """A family's points in the metric of its arclength."""

    def __init__(self, branch: Branch) -> None:
        columns = branch.points
        modes = branch.system.modes
        states = product(np.hstack([columns["start_u"], columns["start_v"]]), modes.from_state.T)
        self.branch = branch
        self.positions = modes.position(states, columns["h"], columns["alpha"])
        self.chords = np.diff(self.positions, axis=0)
        self.lengths = np.maximum(np.linalg.norm(self.chords, axis=1), 1e-150)
        self.reach = NEAR * self.lengths + ON
        # What is near a chord is no further outside the ranges of the chord's energies and quarter periods than that.
        ends = self.positions[:, -2:]
        self.low = np.minimum(ends[:-1], ends[1:]) - self.reach[:, None]
        self.high = np.maximum(ends[:-1], ends[1:]) + self.reach[:, None]

    def arclength(self, position: np.ndarray, times: np.ndarray) -> float | None:
        """The arclength of an orbit; None if it is not on the curve."""
        branch = self.branch
        level = position[-2:]
        beside = np.flatnonzero(((self.low <= level) & (level <= self.high)).all(axis=1))
        if not beside.size:
            return None
        away, chords = position - self.positions[beside], self.chords[beside]
        parts = np.clip(np.einsum("ij,ij->i", away, chords) / self.lengths[beside] ** 2, 0.0, 1.0)
        distance = np.linalg.norm(away - parts[:, None] * chords, axis=1)
        for k in np.flatnonzero(distance <= self.reach[beside]):
            i, along = int(beside[k]), float(parts[k])
            # From the nearer of the two points: at an end that grazes, and at a bifurcation, there is nothing to correct.
            j = i + (along > 0.5)
            columns = branch.points
            longest = float(np.max(times))
            here = length(position - self.positions[j])
            if here <= ON:
                if (np.abs(columns["flight_times"][j] - times) <= 10.0 * ON * longest).all():
                    return float(columns["arclength"][j])
                # If the flight times change fast along the family, the correction distinguishes points this near.
            found = self._corrected(i, j, position)
            if found is not None and (np.abs(found - times) <= 10.0 * ON * longest).all():
                return float(columns["arclength"][i] + along * (columns["arclength"][i + 1] - columns["arclength"][i]))
        return None

    def _corrected(self, i: int, j: int, position: np.ndarray) -> np.ndarray | None:
        """Flight times of the family's orbit on the hyperplane through a position near the chord i, from its point j; None if that
        orbit is elsewhere."""
        problem = self.branch.problem
        ends = self.branch.unknowns(i), self.branch.unknowns(i + 1)
        found = problem.family_orbit_at(ends[j - i], ends[1] - ends[0], position, ON, _STEPS)
        return None if found is None else problem.whole_flight_times(found)


class KnownFamilies:
    """The families found so far, by their ends and impact sequence.

    Examples
    --------
    >>> import saltus
    >>> known = KnownFamilies()
    >>> branch = saltus.trace("S13O00+", energy=(0.2, 1.0))
    >>> known.add("one", branch)
    >>> orbit = branch.orbit_at(energy=0.55).solution
    >>> known.find(branch.problem, orbit.y).id
    'one'
    >>> other = saltus.trace("S13O00+", energy=(1.2, 1.5))
    >>> known.find(other.problem, other.unknowns(5)) is None
    True
    """

    def __init__(self) -> None:
        self._curves: dict[tuple[tuple[str, str], tuple[str, ...]], list[tuple[str, _Curve]]] = {}
        self._count = 0
        self._order: list[_Curve] = []
        self._energies: np.ndarray | None = None
        self._first = np.zeros(1, dtype=int)

    def __len__(self) -> int:
        return self._count

    def add(self, id: str, branch: Branch) -> None:
        """Remember a family by its id."""
        key = (branch.ends, tuple(branch.problem.sequence))
        curve = _Curve(branch)
        self._curves.setdefault(key, []).append((id, curve))
        self._count += 1
        if branch.ends != PERIODIC:
            self._order.append(curve)
            self._energies = None

    def boxes_at(self, energy: float) -> Boxes:
        """Boxes around the flight times of the families' orbits at an energy, see `branches.search.known`."""
        if self._energies is None:
            self._energies = np.concatenate([np.array([]), *(np.append(curve.branch.points["h"], np.nan) for curve in self._order)])
            self._first = np.cumsum([0, *(len(curve.branch) + 1 for curve in self._order)])
        # Two neighbouring points with the energy between them; a family ends at a number that is none.
        every, above = self._energies, self._energies > energy
        between = np.flatnonzero((above[1:] != above[:-1]) & ~np.isnan(every[1:]) & ~np.isnan(every[:-1]))
        curves = np.searchsorted(self._first, between, "right") - 1
        found: dict[Kind, list[np.ndarray]] = {}
        for curve, place in zip(curves.tolist(), (between - self._first[curves]).tolist(), strict=True):
            branch = self._order[curve].branch
            found.setdefault((branch.ends, branch.problem.sequence), []).append(branch.points["flight_times"][place : place + 2])
        return boxes_between(found)

    def find(self, problem: MultipointProblem, y: np.ndarray) -> FamilyPlace | None:
        """The known family that an orbit belongs to; None if it belongs to none."""
        return self.place(problem.system, all_presentations(problem, y))

    def count(self, images: Sequence[Presentation]) -> int:
        """The number of families with the ends and impact sequence of an orbit's images."""
        return len(self._curves.get((images[0].ends, images[0].sequence), []))

    def place(self, system: ImpactSystem, images: Sequence[Presentation], first: int = 0) -> FamilyPlace | None:
        """The known family that contains one of an orbit's images; None if there is none.

        The search skips the `first` families with these ends and this impact sequence, which the caller has already tested."""
        for image in images:
            curves = self._curves.get((image.ends, image.sequence), [])[first:]
            if not curves:
                continue
            energy = float(modal_energies(system, image.start))
            position = system.modes.position(image.start, energy, image.quarter_period)
            for id, curve in curves:
                at = curve.arclength(position, image.times)
                if at is not None:
                    return FamilyPlace(id, at)
        return None


def family_of(catalogue: CatalogueStore, orbit: Orbit) -> str | None:
    """Id of the family of a catalogue that an orbit of its system belongs to; None if it belongs to none."""
    images = all_presentations(orbit.problem, orbit.solution.y)
    keys = {(format_ends(image.ends), "".join(image.sequence)) for image in images}
    known = KnownFamilies()
    for row in catalogue.all_families():
        if (row.ends, row.sequence) in keys and row.h[0] * (1.0 - _MARGIN) <= orbit.h <= row.h[1] * (1.0 + _MARGIN):
            known.add(row.id, catalogue.branch(row.id))
    place = known.place(orbit.system, images)
    return None if place is None else place.id


_LONGEST = 20
"""Most segments of an orbit in one segment of an emanating family: half a period of a 5:1 resonance has ten quarter periods."""

_COVERS = 5
"""An orbit of an emanating family is at most a 5-fold cover of the orbit at which it starts."""

_SAMPLES = 48
"""States on each flight among which the nearest is searched before it is refined."""


def event_orbit(problem: MultipointProblem, y: np.ndarray) -> EventOrbit:
    """The orbit y of a problem, as an edge stores it."""
    return kept_orbit(problem.system, presentation_of(problem, y))


def kept_orbit(system: ImpactSystem, presentation: Presentation) -> EventOrbit:
    """One presentation of an orbit, as an edge stores it."""
    start = product(system.modes.to_state, presentation.start)
    return EventOrbit(presentation.ends, "".join(presentation.sequence), tuple(start.tolist()), tuple(map(float, presentation.times)))


def orbit_of_event(branch: Branch, event: BranchEvent) -> EventOrbit:
    """The orbit at an event of a branch, as plain numbers."""
    columns = branch.points
    start = np.concatenate([columns["start_u"][event.point], columns["start_v"][event.point]])
    times = columns["flight_times"][event.point]
    return EventOrbit(branch.ends, branch.sequence, tuple(start.tolist()), tuple(times.tolist()))


def seen_from(problem: MultipointProblem, y: np.ndarray, ends: Ends, sequence: ImpactSequence) -> EventOrbit | None:
    """The orbit y as an orbit of the problem with other ends and impact sequence: from another of its ends, over a longer segment or
    several periods, or mirrored. None if it is not such an orbit."""
    for window in _windows(problem, ends, sequence):
        presentation = embed(problem, y, window)
        for image in (presentation, presentation.mirrored()) if problem.system.has_odd_symmetry else (presentation,):
            if (image.ends, image.sequence) == (ends, sequence):
                return kept_orbit(problem.system, image)
    return None


def _windows(problem: MultipointProblem, ends: Ends, sequence: ImpactSequence) -> list[tuple[int, int] | int]:
    """The windows of `branches.presentation.embed` with ends of these kinds and as many impacts as a sequence."""
    inner, kinds = len(problem.sequence), [_kind(end) for end in problem.ends]
    if ends == PERIODIC:
        impacts = impacts_per_period(problem.sequence, problem.ends)
        return [k for k in range(1, _COVERS + 1) if k * impacts == len(sequence)]
    if problem.periodic:
        return []
    found: list[tuple[int, int] | int] = []
    for span in range(1, _LONGEST + 1):
        for first in range(4):
            at_stops = sum(kinds[place % 2] == "stop" for place in range(first + 1, first + span))
            same = (kinds[first % 2], kinds[(first + span) % 2]) == (_kind(ends[0]), _kind(ends[1]))
            if same and span * inner + at_stops == len(sequence):
                found.append((first, first + span))
    return found


def _kind(end: str) -> str:
    return "stop" if end.startswith("stop") else end


def presented(problem: MultipointProblem, y: np.ndarray, ends: Ends, sequence: ImpactSequence) -> EventOrbit | None:
    """The orbit y as an orbit of the problem with other ends and impact sequence, in any presentation: mirrored or run backwards, as
    `seen_from`, from another impact, or the primitive orbit that it covers. None if there is none."""
    sequence = tuple(sequence)
    for image in segment_images(problem, y, sequence):
        if (image.ends, tuple(image.sequence)) == (ends, sequence):
            return kept_orbit(problem.system, image)
    found = seen_from(problem, y, ends, sequence)
    if found is not None:
        return found
    closed = closed_presentations(cycle_of(problem, y), sequence) if ends == PERIODIC else []
    for presentation in (*closed, *presentations(problem, y)):
        if (presentation.ends, tuple(presentation.sequence)) == (ends, sequence):
            other = MultipointProblem(problem.system, ends, sequence)
            try:
                # A part of an orbit of singular equations has the square root of their accuracy.
                return event_orbit(other, solved(other, presentation.unknowns(other)).y)
            except NotConverged:
                return None
    return None


def switch_edge(source: Branch, event: BranchEvent, target: Branch, target_event: str = "") -> Edge:
    """The edge from a BP, SB or PD of one family to the family that emanates there.

    Parameters
    ----------
    source : Branch
        The family with the event.
    event : BranchEvent
        A BP, SB or PD of it.
    target : Branch
        The emanating family.
    target_event : str
        Id of the event on the emanating family; by default it has none.
    """
    require_branch(source)
    require_branch(target)
    y = source.unknowns(event.point)
    seen = seen_from(source.problem, y, target.ends, tuple(target.problem.sequence))
    return Edge(
        source.id, event.id, event.type, "switch", target.id, event.h, event.alpha, target_event, event.stop, event.note,
        orbit_of_event(source, event), seen,
    )  # fmt: skip


def unknowns_of(problem: MultipointProblem, orbit: EventOrbit) -> np.ndarray:
    """Unknowns of a problem from a stored orbit: its start and flight times, and nodes by exact flight."""
    start = product(problem.modes.from_state, np.array(orbit.start))
    return problem.pack(start, None, np.array(orbit.flight_times))


def distances_from_orbit(problem: MultipointProblem, y: np.ndarray, states: Iterable[np.ndarray]) -> list[float]:
    """The distances of states (2 n,), in physical coordinates, from the orbit y, its mirror image and both run backwards, relative to the
    size of each state. A state determines the complete motion."""
    system, half, flight = problem.system, problem.half, flight_of(problem.system)
    cycle = cycle_of(problem, y)
    begins, durations = cycle.after, cycle.duration
    signs = (1.0, -1.0) if problem.system.has_odd_symmetry else (1.0,)
    back = np.concatenate([np.ones(half), -np.ones(half)])
    paths = [core.path(flight, begin, duration) for begin, duration in zip(begins, durations.tolist(), strict=True)]
    times = np.linspace(0.0, 1.0, _SAMPLES)
    track = np.empty((len(durations), _SAMPLES, 2 * half))
    for i, duration in enumerate(durations):
        sample_path(system, np.zeros(1), begins[i : i + 1], times * duration, track[i])
    # The path from each sample to the farther one of its neighbours.
    way = np.linalg.norm(np.diff(track, axis=1), axis=2)
    path = np.maximum(np.pad(way, ((0, 0), (1, 0))), np.pad(way, ((0, 0), (0, 1))))

    def distance(image: np.ndarray) -> float:
        best = math.inf
        away = np.linalg.norm(track - image, axis=2)
        for i, j in zip(*_dips(away, path), strict=True):
            t = times[j] * durations[i]
            for _ in range(8):
                state, rate = paths[i].motion(float(t))
                last, t = t, min(max(t + inner(rate, image - state) / inner(rate, rate), 0.0), durations[i])
                if t == last:
                    break
            best = min(best, length(paths[i].state(float(t)) - image))
        return best

    out = []
    for start in states:
        images = [product(problem.modes.from_state, sign * way * start) for sign in signs for way in (np.ones(2 * half), back)]
        out.append(min(map(distance, images)) / length(images[0]))
    return out


def _dips(away: np.ndarray, path: np.ndarray) -> tuple[np.ndarray, ...]:
    """Local minima (i, j) of the distances `away` (flights, samples), and the smallest distance of all.

    A minimum counts if it is at most twice the `path` to a neighbouring sample: a larger one cannot reach zero between the samples."""
    padded = np.pad(away, ((0, 0), (1, 1)), constant_values=np.inf)
    least = (away <= padded[:, :-2]) & (away <= padded[:, 2:])
    found = least & (away <= 2.0 * path)
    found.flat[int(np.argmin(away))] = True
    return np.nonzero(found)
