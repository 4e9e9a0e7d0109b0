"""The search for a name. A label is searched by scans at many energies, and an id by all orbits with its ends at more and more energies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.full_family import energy_scale
from branches.naming.at_events import orbits_at_event
from branches.naming.labels import Label, Name, canonical_label, most_alike
from branches.naming.matching import REFERENCE_TOLERANCE, NameNotFound, matches, nearest_labels, why_a_cover
from branches.naming.parents import SHORT, Sequences, parent_sequences
from branches.presentation import embed, same_orbit
from branches.search.along_sequence import orbits_with_sequence
from branches.search.discovery import LONGEST, check_bounds, fastest_turn
from branches.search.orbit_search import Found, OrbitSearch, judged, kept_problems
from branches.search.smooth_starts import SmoothSampler
from branches.search.starts import Sampler
from branches.sequences import PERIODIC, canonical_sequence, split_family_id
from branches.tracing import HIGHEST, follow_family
from bvp.checks import checked_energy_range, require_system
from bvp.multipoint import MultipointProblem, NotConverged

if TYPE_CHECKING:
    from branches.branch import Branch
    from bvp.system import ImpactSystem

__all__ = [
    "LEVELS", "SMOOTH_LEVELS", "Limits", "Search", "find_by_id", "from_other_end", "least_energy", "passes", "search_bounds",
    "label_without_stops",
]  # fmt: skip

LEVELS = ((0.15, 128), (0.15, 1024), (0.05, 4096))
"""Scans: step in log h (twice that where there are no inner impacts: such families are wide), and angles over half a turn for each
inner impact up to four (at least one). Each level is finer; the search ends at the first that finds the name."""

SMOOTH_LEVELS = ((0.3, 96, 0.1), (0.3, 96, 0.4), (0.15, 384, 1.0))
"""The same for systems with smooth forces, and the part of the longest quarter period."""

MORE = 2
"""Half-waves beyond those of a label to which its motions are searched: orbits with other labels are named as the nearest ones."""


Followed = dict["Branch", Found]
"""The families that searches followed, each with the orbit that it was followed from: no family is followed twice."""


@dataclass(frozen=True)
class Limits:
    """Where names are searched by default: energies, longest quarter period, most impacts in a half period."""

    energy: tuple[float, float] = (0.05, 1e4)
    quarter_period: float = 10.0
    impacts: int = 16


def search_bounds(bounds: Mapping[str, Any] | None) -> Limits:
    """Limits from a scene's bounds (missing ones by default)."""
    given = {**vars(Limits()), **(bounds or {})}
    for key in given.keys() - vars(Limits()).keys():
        raise ValueError(f"unknown bound {key!r}; expected {most_alike(key, vars(Limits()), 1)[0]}")
    return Limits(checked_energy_range(given["energy"]), float(given["quarter_period"]), int(given["impacts"]))


class Search:
    """One search for a name over a range of energies, coarse first. Families that it follows are added to those `followed`."""

    def __init__(self, system: ImpactSystem, name: Name, limits: Limits, energy: tuple[float, float], followed: Followed):
        self.name = name
        self.limits = limits
        self.followed = followed
        # The range may go beyond the limits. Above HIGHEST orbits are lost in rounding.
        top = max(HIGHEST, limits.energy[1])
        self.energy = (name.h, name.h) if name.h is not None else (energy[0], min(energy[1], top) if energy[0] < top else energy[1])
        self.longest = max(limits.quarter_period, (1.0 + REFERENCE_TOLERANCE) * name.alpha if name.alpha is not None else 0.0)
        self.range = energy
        self.system = system
        self.canonical: tuple[tuple[str, ...], tuple[str, str]] | None = None
        half_waves = None
        if name.label is not None and not system.stops:
            kinds, self.impacts = ["rest" if name.label.kind == "S" else "origin"], [0]
            # A quarter has half of them but one.
            m, n = ((waves - 1) // 2 if name.label.kind == "S" else waves for waves in (name.label.m, name.label.n))
            half_waves = m + MORE, n + MORE
        elif name.label is not None:
            label = name.label
            kinds = {"O": ["stop"], "E": ["rest"], None: ["stop", "rest"]}[label.parity] if label.kind == "S" else ["origin"]
            if label.p is not None and label.q is not None:
                self.impacts = [label.p + label.q if label.kind == "U" else label.p]
            else:
                self.impacts = list(range(1, limits.impacts + 1) if label.kind == "U" else range(limits.impacts // 2 + 1))
        else:
            assert name.family is not None
            ends, sequence, _ = split_family_id(name.family)
            self.canonical = canonical_sequence(sequence, ends, odd_symmetry=system.has_odd_symmetry)
            kinds = ["stop" if ends[1].startswith("stop") else ends[1]]
            self.impacts = [len(sequence)]
        self.samplers: list[Sampler] | list[SmoothSampler] = (
            [Sampler(system, kind, self.longest, self.impacts) for kind in kinds] if system.smooth_forces is None
            else [SmoothSampler(system, kind, self.longest, self.impacts, half_waves) for kind in kinds]
        )  # fmt: skip
        self.seen: dict[str, tuple[float, float]] = {}
        self.others: dict[str, Branch] = {}
        self.searched = (0, 0)

    def run(self, levels: Sequence[tuple[float, int]]) -> list[Found]:
        """All matches of the first of the levels that has any."""
        low, high = self.energy
        least = max(low, 1e-3 * least_energy(self.system)) or 1e-6 * energy_scale(self.system)
        for step, density, *part in levels if self.system.smooth_forces is None else SMOOTH_LEVELS[: len(levels)]:
            energies = np.array([low])
            if low < high:
                count = max(2, math.ceil(math.log(high / least) / (step if max(self.impacts) else 2.0 * step)))
                energies = np.exp(np.linspace(math.log(least), math.log(high), 2 * count + 1)[1::2])
            angles = density * max(1, min(4, max(self.impacts)))
            self.searched = (len(energies), angles)
            found = []
            for h in energies:
                for orbit in self.orbits_at(h, angles, *part):
                    label, pattern = orbit.label, self.name.label
                    if label is not None and pattern is not None and label.kind == "U" and label.p != label.q:
                        # Started at its other end, Umnpq is Umnqp.
                        if not self.fits(orbit) and matches(pattern, label):
                            orbit = from_other_end(orbit)
                    if self.fits(orbit):
                        found.append(orbit)
                    elif orbit.label is not None:
                        self.seen.setdefault(str(canonical_label(orbit.label)), (orbit.h, orbit.alpha))
            if found:
                return found
        return []

    def orbits_at(self, energy: float, angles: int, *part: float) -> list[Found]:
        """The orbits that a scan at an energy finds; arguments of the samplers."""
        search = OrbitSearch(self.system, kept_problems(self.system))
        segments = (segment for sampler in self.samplers for segment in sampler.segments(energy, angles, *part))
        found = (search.add(segment, partial(MultipointProblem.solve, energy=energy)) for segment in segments)
        return [orbit for orbit in found if orbit is not None]

    def fits(self, orbit: Found) -> bool:
        """Whether an orbit has the name, apart from its suffix and the hash of an id."""
        if self.canonical is not None:
            return self.canonical == orbit.canonical
        label, pattern = orbit.label, self.name.label
        if label is None or pattern is None or not matches(pattern, label):
            return False
        if pattern.p is not None and pattern.p != pattern.q:
            return pattern.p == label.p
        return label.p is None or label.q is None or label.p <= label.q

    def families(self, found: list[Found]) -> list[tuple[Found, Branch]]:
        """One orbit of each family, and the family traced."""
        wide = min(self.range[0], self.limits.energy[0]), max(self.range[1], self.limits.energy[1])
        if self.system.smooth_forces is not None and self.range != wide:
            # With steep springs it takes minutes to follow a family to high energies.
            followed = self.followed.copy()
            out = self._families(found, self.range, followed)
            if len(out) == 1:
                self.followed.update(followed)
                return out
        # A range of energies can cut one family into several pieces.
        return self._families(found, wide, self.followed)

    def _families(self, found: list[Found], energy: tuple[float, float], followed: Followed) -> list[tuple[Found, Branch]]:
        """The same, followed in a range of energies."""
        out: dict[Branch, Found] = {}
        for orbit in found:
            branch = followed_through(followed, orbit, energy)
            if self.name.family is not None and self.name.family not in branch.full_family.ids:
                self.others[branch.id] = branch
            else:
                out.setdefault(branch, orbit)
        return [(orbit, branch) for branch, orbit in out.items()]

    def nothing(self) -> str:
        """The message of a search that found nothing: where it searched, and which similar orbits exist."""
        low, high = self.energy
        where = f"at h = {low:g}" if low == high else f"for h in {low:g}:{high:g}"
        counts = self.impacts[0] if len(self.impacts) == 1 else f"{self.impacts[0]} to {self.impacts[-1]}"
        energies, angles = self.searched
        text = (
            f"no orbit {self.name.label or self.name.family} found {where}, quarter period up to {self.longest:g}, "
            f"with {counts} inner impacts in the solved segment ({energies} energies, {angles} angles)"
        )
        turn = fastest_turn(self.system, self.longest)
        if turn > LONGEST:
            text += (
                f"; the fastest mode rotates by {turn:.4g} rad within half of the longest period, and the angles are too far apart for "
                f"orbits in which it rotates by more than {LONGEST:g}"
            )
        if self.name.family is not None and self.others:
            there = "is" if len(self.others) == 1 else "are"
            return f"{text}; with these ends and this sequence there {there} {_listed(self.others.values())}"
        label = self.name.label
        if label is not None:
            cover = why_a_cover(
                label, lambda root: bool(Search(self.system, Name(root), self.limits, self.range, self.followed).run(LEVELS[:1]))
            )
            if cover:
                return cover
        if self.seen and label is not None:
            near = nearest_labels(label, self.seen)
            text += "; nearest that exist: " + ", ".join(f"{k}@h={self.seen[k][0]:.5g},alpha={self.seen[k][1]:.5g}" for k in near)
        return text


def label_without_stops(name: Name) -> Name:
    """A name as it is meant for a system without stops, whose labels have no impacts: S11- is not short for S11O00- there.

    Raises
    ------
    NameNotFound
        For a label with impacts.
    """
    label = name.label
    if label is None:
        return name
    if label.p or label.q or label.parity == "E" or (label.parity == "O" and not name.is_short):
        raise NameNotFound(f"{label} has impacts, and this system has no stops; expected a label such as {label.kind}{label.m}{label.n}+")
    return replace(name, label=Label(label.kind, label.m, label.n, sign=label.sign))


def from_other_end(orbit: Found) -> Found:
    """The same origin..origin orbit, started half a period later. If Newton's method does not confirm it there, the orbit itself."""
    presentation = embed(orbit.problem, orbit.solution.y, (1, 2))
    problem = MultipointProblem(orbit.problem.system, presentation.ends, presentation.sequence)
    try:
        turned = judged(problem, problem.solve(presentation.unknowns(problem), energy=orbit.h))
    except NotConverged:
        return orbit
    return turned if isinstance(turned, Found) else orbit


def least_energy(system: ImpactSystem) -> float:
    """Energy below which the first stop cannot be reached: the least potential energy with the gap coordinate at its nearer bound, which is
    0 where the system can drift there.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> round(least_energy(vibro_impact_nes(sigma=0.1)), 12), least_energy(vibro_impact_nes(sigma=0.0))
    (0.05, 0.0)
    """
    if not system.stops:
        return 0.0
    gap = system.modes.contacts.gap[0, : system.degrees_of_freedom]
    reach = min(abs(system.stops[0].lower), abs(system.stops[0].upper))
    pairs = zip(gap, system.modes.squares, strict=True)
    compliance = sum(math.inf if w <= 0.0 and g != 0.0 else (g * g / w if g else 0.0) for g, w in pairs)
    return float(0.5 * reach**2 / compliance)


def passes(branch: Branch, orbit: Found) -> bool:
    """Whether a branch passes through an orbit, in whatever presentation; both are solved between neighbouring reversals."""
    mine, other = branch.problem, orbit.problem
    if canonical_sequence(mine.sequence, mine.ends, odd_symmetry=mine.system.has_odd_symmetry) != orbit.canonical:
        return False
    return any(
        abs(candidate.alpha / orbit.alpha - 1.0) < 1e-7
        and same_orbit((mine, candidate.solution.y), (other, orbit.solution.y), between_reversals=True)
        for candidate in branch.orbits_at(energy=orbit.h)
    )


def followed_through(followed: Followed, orbit: Found, energy: tuple[float, float]) -> Branch:
    """The family through an orbit: one of those that are known, or else followed now and added to them."""
    known = next((branch for branch in followed if passes(branch, orbit)), None)
    if known is None:
        known = follow_family(orbit.problem, orbit.solution.y, energy=energy)
        followed[known] = orbit
    return known


ROUNDS = {
    "reversal": ((("", 7, 48), ("", 6, 256)), (("", 6, 48),)),
    "closed": ((("near", 4, 48), ("short", 3, 48), ("near", 6, 48), ("near", 4, 256)), (("near", 5, 48), ("short", 4, 48))),
}
"""Searches for an id, in the range of energies and then in that of the limits: which sequences (for orbits without a reversal, of
`branches.naming.parents`), the times that energies are put between those that were searched (seven: 127 energies at most), and the
starts in each piece of a curve of starts (`branches.search.along_sequence`)."""

KEPT = "expected a catalogue that has it (--catalogue FILE)"

FROM_EVENT = "saltus continue --from FILE:EVENT,ID with a file of a family that it meets"


def find_by_id(system: ImpactSystem, name: Name, limits: Limits, energy: tuple[float, float], followed: Followed) -> tuple[Found, Branch]:
    """An orbit of the family with an id, and the family; `energy`, `followed`: as for `branches.naming.families.resolve`.

    The range of energies is searched first, then that of the limits: the family may have orbits in a small part of the range alone. A
    family of orbits without a reversal is sought at the events of families with one.

    Raises
    ------
    NameNotFound
        Where no orbit of it is found.
    ValueError
        For a system whose orbits cannot be searched.
    """
    family = name.family or ""
    if system.smooth_forces is not None:
        raise NameNotFound(f"{family}: with smooth forces ids are searched from the origin; {KEPT}, or {FROM_EVENT}")
    require_system(system, two_dof="families are searched by id for", advice=KEPT)
    check_bounds(system, limits.quarter_period, None)
    low, high = max(energy[0], 1e-3 * limits.energy[0]), min(energy[1], limits.energy[1] if energy[1] == math.inf else energy[1])
    span = min(low, limits.energy[0]), max(high, limits.energy[1])
    asked = (low, high) if name.h is None else (name.h, name.h)
    closed = split_family_id(family)[0] == PERIODIC
    tried: set[Branch] = set()
    for orbit in _orbits_beside(system, family, list(dict.fromkeys([asked, span])), limits.quarter_period):
        branch = followed_through(followed, orbit, span)
        if branch not in tried:
            tried.add(branch)
            found = _begun_on(branch, family) if closed else orbit if family in branch.full_family.ids else None
            if found is not None:
                return found, followed_through(followed, found, span)
    why = f"with these ends and this sequence of impacts there are {_listed(followed)}" if followed else KEPT
    if closed:
        beside = f"this sequence, up to one impact more or less, or up to {SHORT[4]} impacts in a quarter or {SHORT[2]} in half a period"
        why = f"no SB or GR where it begins was found on families with a reversal that have {beside}; {KEPT}, or {FROM_EVENT}"
    raise NameNotFound(f"no orbit {family} found for h in {low:g}:{high:g}, quarter period up to {limits.quarter_period:g}; {why}")


def _listed(branches: Iterable[Branch]) -> str:
    """The first families, with their labels and lowest energies."""
    texts = dict.fromkeys(f"{branch.id} ({branch.label or 'no label'}, from h = {branch.points['h'].min():.6g})" for branch in branches)
    return ", ".join(list(texts)[:5])


def _orbits_beside(system: ImpactSystem, family: str, ranges: list[tuple[float, float]], quarter_period: float) -> Iterator[Found]:
    """Orbits that may lie on the family with an id, or on one where it begins, in the order of `ROUNDS`."""
    ends, sequence, _ = split_family_id(family)
    rounds = zip(ranges, ROUNDS["closed" if ends == PERIODIC else "reversal"], strict=False)
    for (low, high), (which, times, density) in ((between, one) for between, every in rounds for one in every):
        wanted: Sequences = {canonical_sequence(sequence, ends, odd_symmetry=system.has_odd_symmetry): None}
        if which:
            wanted = parent_sequences(sequence, system.modes.contact_letters, which, odd_symmetry=system.has_odd_symmetry)
        parts = [k / 2**level for level in range(1, times + 1) for k in range(1, 2**level, 2)]
        energies = [low * (high / low) ** part for part in parts] if low < high else [low]
        for h, (hits, pair) in product(energies, wanted):
            yield from orbits_with_sequence(system, h, pair, hits, quarter_period, density)


def _begun_on(branch: Branch, family: str) -> Found | None:
    """An orbit of the family with an id next to an SB or a GR of a branch, where it begins; None if it begins at none of them."""
    for event in (event for event in branch.events if event.type in ("SB", "GR")):
        with suppress(RuntimeError):
            orbit = orbits_at_event(branch, event, family)[0].get(family)
            if orbit is not None:
                return Found(orbit.problem, orbit.solution, None)
    return None
