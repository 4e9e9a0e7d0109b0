"""Names to families: a label is searched by discovery over energies, and what is found is sorted into families by tracing.

A pin never starts a search: it only chooses among the families that were found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.discovery import Found, Scanner, accept
from branches.identity import same_orbit
from branches.labels import Label, Name, canonical, matches, nearest, parse_name, roots
from branches.words import canonical as canonical_word
from branches.words import split_family_id
from bvp.multipoint import MultipointProblem, NotConverged

if TYPE_CHECKING:
    from branches.branch import Branch
    from bvp.system import ImpactSystem

__all__ = ["AmbiguousName", "Limits", "NameNotFound", "resolve", "search_bounds"]

LEVELS = ((0.15, 128), (0.15, 1024), (0.05, 4096))
"""Scans: step in log h (twice that where there are no inner impacts: such families are wide), and angles over half a turn for each
inner impact up to four (at least one). Each level is finer; the search ends at the first that finds the name."""

PIN_TOLERANCE = 0.02
"""How far, relatively, the quarter period of a chosen family may be from its pin at the pin's energy."""


class NameNotFound(ValueError):
    """No orbit has the name within the bounds; the message says what was searched and what exists."""


class AmbiguousName(ValueError):
    """Several families have the name; the message lists the suffix that selects each."""


@dataclass(frozen=True)
class Limits:
    """Where names are searched: energies, longest quarter period, most impacts in a half period."""

    energy: tuple[float, float] = (0.05, 1e4)
    quarter_period: float = 10.0
    impacts: int = 16


def search_bounds(bounds: Mapping[str, Any] | None) -> Limits:
    """Limits from a scene's bounds (missing ones by default)."""
    bounds = dict(bounds or {})
    default = Limits()
    for key in bounds:
        if key not in default.__dataclass_fields__:
            near = nearest(key, default.__dataclass_fields__, 1) or tuple(default.__dataclass_fields__)
            raise ValueError(f"unknown bound {key!r}; expected {', '.join(near)}")
    energy = bounds.get("energy", default.energy)
    return Limits(
        (float(energy[0]), float(energy[1])),
        float(bounds.get("quarter_period", default.quarter_period)),
        int(bounds.get("impacts", default.impacts)),
    )


def resolve(
    text: str, system: ImpactSystem, *, pins: Mapping[str, Mapping[str, float]], limits: Limits, energy: tuple[float, float]
) -> tuple[Found, bool]:
    """An orbit of the one family that a name stands for, and whether the family, followed up from it, ends at its higher end.

    Parameters
    ----------
    text : str
    system : ImpactSystem
    pins : mapping of bare names to {"h", "alpha"}
    limits : Limits
    energy : (float, float)
        The range in which the family will be followed; the search is kept to it.

    Raises
    ------
    NameNotFound, AmbiguousName, LabelSyntaxError, ImpossibleLabelError
    ValueError
        For a system on which names cannot be searched.
    """
    reason = system.why_not_conservative()
    if reason is not None:
        raise ValueError(f"families of periodic orbits need a conservative system: {reason}")
    name = parse_name(text)
    if name.label is not None and name.label.kind == "L":
        raise NameNotFound(_linear_mode(system, name.label))
    search = _Search(system, name, limits, energy)
    if name.label is not None and system.has_odd_symmetry and (system.absorber is None or system.primary is None):
        raise NameNotFound(
            f"{text} is a label, and labels count the half-waves of an absorber and a primary, which this system does not name; "
            "expected absorber and primary (in a scene NES and LO under [coordinates])"
        )
    families = search.families(search.run(LEVELS)) or _passing(system, name, limits, energy)
    families = _select(name, families)
    if not families:
        raise NameNotFound(search.nothing())
    if len(families) > 1 and name.h is None and name.alpha is None:
        bare = str(name.label) if name.label is not None else name.family
        pin = pins.get(text) or pins.get(str(bare))
        if pin is not None:
            families = _pinned(families, pin) or families
    if len(families) > 1:
        listed = " ".join(f"{text.split('@')[0]}@h={f.h:.6g},alpha={f.alpha:.6g}" for f, _ in families)
        raise AmbiguousName(f"{text} is {len(families)} families; expected one of {listed}")
    found_orbit, branch = families[0]
    return found_orbit, bool(branch.points["h"][0] <= branch.points["h"][-1])


def _linear_mode(system: ImpactSystem, label: Label) -> str:
    modes = system.modes
    k = 0 if label.sign == "+" else 1
    w, b = modes.frequencies[k], modes.contact_gap[0, k]
    stop = system.stops[0]
    reach = min(abs(stop.lower), abs(stop.upper))
    return (
        f"{label} is a linear mode of frequency {w:.10g}: it has no impacts, and grazes the stops at h = "
        f"{0.5 * (w * reach / b) ** 2:.10g}; expected the name of an impacting family such as S13O00+ or S11O00-"
    )


def _passing(system: ImpactSystem, name: Name, limits: Limits, energy: tuple[float, float]) -> list[tuple[Found, Branch]]:
    """Families found elsewhere within the limits, each with an orbit in a range of energies, or at the one energy of the name,
    where the search itself found none: one so narrow, or so near to grazing, that the orbits lie between its angles."""
    low, high = energy
    if name.h is not None:
        beyond = (min(limits.energy[0], 0.9 * name.h), max(limits.energy[1], 1.1 * name.h))
        anywhere = _Search(system, replace(name, h=None), limits, beyond)
        return anywhere.families(anywhere.run(LEVELS[:1]))
    if not 0.0 < low < high < math.inf or (low <= limits.energy[0] and high >= limits.energy[1]):
        return []
    wide = _Search(system, name, limits, limits.energy)
    out = []
    for _, branch in wide.families(wide.run(LEVELS[:1])):
        least, most = max(low, float(branch.points["h"].min())), min(high, float(branch.points["h"].max()))
        for part in (0.5, 0.1, 0.9) if least < most else ():
            candidates = branch.orbits_at(energy=least ** (1.0 - part) * most**part)
            orbits = [orbit for orbit in (accept(c.problem, c.solution) for c in candidates) if orbit is not None and wide._matches(orbit)]
            if orbits:
                out.append((orbits[0], branch))
                break
    return out


def _select(name: Name, families: list[tuple[Found, Branch]]) -> list[tuple[Found, Branch]]:
    """The families, each with its orbit at the energy or quarter period of the name's suffix, where it has one."""
    if name.h is None and name.alpha is None:
        return families
    chosen: list[tuple[float, Found, Branch]] = []
    for found, branch in families:
        orbits = branch.orbits_at(energy=name.h) if name.h is not None else branch.orbits_at(alpha=name.alpha)
        for orbit in orbits:
            miss = abs(orbit.alpha / name.alpha - 1.0) if name.h is not None and name.alpha is not None else 0.0
            if miss < PIN_TOLERANCE:
                chosen.append((miss, Found(orbit.problem, orbit.solution, found.label), branch))
                break
    if name.h is not None and name.alpha is not None and chosen:
        best = min(miss for miss, _, _ in chosen)
        chosen = [item for item in chosen if item[0] <= best + 1e-9]
    return [(found, branch) for _, found, branch in chosen]


def _pinned(families: list[tuple[Found, Branch]], pin: Mapping[str, float]) -> list[tuple[Found, Branch]]:
    """The family that passes nearest to the pin, if one passes near; those at its energy or quarter period where it has only one."""
    if "h" not in pin or "alpha" not in pin:
        return [
            (found, branch)
            for found, branch in families
            if (branch.orbits_at(energy=pin["h"]) if "h" in pin else branch.orbits_at(alpha=pin["alpha"]))
        ]
    best, chosen = PIN_TOLERANCE, []
    for found, branch in families:
        for orbit in branch.orbits_at(energy=pin["h"]):
            miss = abs(orbit.alpha / pin["alpha"] - 1.0)
            if miss < best:
                best, chosen = miss, [(found, branch)]
    return chosen


class _Search:
    """One search for a name over energies, coarse first."""

    def __init__(self, system: ImpactSystem, name: Name, limits: Limits, energy: tuple[float, float]):
        self.name = name
        self.limits = limits
        self.energy = (max(limits.energy[0], energy[0]), min(limits.energy[1], energy[1]))
        if name.h is not None:
            self.energy = (name.h, name.h)
        elif not self.energy[0] < self.energy[1]:
            self.energy = energy
        self.range = energy
        self.system = system
        self.word: tuple[str, ...] | None = None
        self.ends: tuple[str, str] | None = None
        most = limits.impacts
        if name.label is not None:
            label = name.label
            end = "origin" if label.kind == "U" else {"O": "stop", "E": "rest", None: "stop"}[label.parity]
            if label.p is not None and label.q is not None:
                self.impacts = [label.p + label.q if label.kind == "U" else label.p]
            elif label.kind == "U":
                self.impacts = list(range(1, most + 1))
            else:
                self.impacts = list(range(most // 2 + 1))
            kinds = [end] if label.kind == "U" or label.parity is not None else ["stop", "rest"]
        else:
            assert name.family is not None
            self.ends, self.word, _ = split_family_id(name.family)
            if self.ends[0] != "origin":
                raise NameNotFound(
                    f"{name.family} has the ends {self.ends[0]}, {self.ends[1]}; families are found by id from an origin start only: "
                    "reach this one by switching at its symmetry breaking, or read it from its file"
                )
            kinds = ["stop" if self.ends[1].startswith("stop") else self.ends[1]]
            self.impacts = [len(self.word)]
        self.scanners = [Scanner(system, kind, limits.quarter_period) for kind in kinds]
        self.seen: dict[str, tuple[float, float]] = {}
        self.others: dict[str, Branch] = {}
        self.searched = (0, 0)

    def run(self, levels: Sequence[tuple[float, int]]) -> list[Found]:
        """All matches of the first of the levels that has any."""
        for step, density in levels:
            energies = self._energies(step if max(self.impacts) else 2.0 * step)
            angles = density * max(1, min(4, max(self.impacts)))
            self.searched = (len(energies), angles)
            found = [orbit for h in energies for orbit in self._at(h, angles)]
            if found:
                return found
        return []

    def _energies(self, step: float) -> np.ndarray:
        low, high = self.energy
        if low == high:
            return np.array([low])
        low = max(low, 1e-3 * self._least())
        count = max(2, math.ceil(math.log(high / low) / step))
        grid = np.linspace(math.log(low), math.log(high), 2 * count + 1)[1::2]
        return np.exp(grid)

    def _least(self) -> float:
        """Energy below which no stop can be reached: min of the potential energy with |w| at a bound."""
        gap = self.system.modes.contact_gap[0, : self.system.degrees_of_freedom]
        squares = self.system.modes.squares
        reach = min(abs(self.system.stops[0].lower), abs(self.system.stops[0].upper))
        compliance = sum(math.inf if w <= 0.0 and g != 0.0 else (g * g / w if g else 0.0) for g, w in zip(gap, squares, strict=True))
        return 0.5 * reach**2 / compliance if math.isfinite(compliance) else 1e-3

    def _at(self, h: float, angles: int) -> list[Found]:
        out = []
        for scanner in self.scanners:
            for orbit in scanner.orbits(h, angles, self.impacts):
                if not self._matches(orbit) and self._matches_turned(orbit):
                    orbit = from_other_end(orbit)
                if self._matches(orbit):
                    out.append(orbit)
                elif orbit.label is not None:
                    self.seen.setdefault(str(orbit.label), (orbit.h, orbit.alpha))
        return out

    def _matches(self, orbit: Found) -> bool:
        if self.word is not None and self.ends is not None:
            same = canonical_word(orbit.problem.word, orbit.problem.ends, odd_symmetry=self.system.has_odd_symmetry)
            return same == canonical_word(self.word, self.ends, odd_symmetry=self.system.has_odd_symmetry)
        label, pattern = orbit.label, self.name.label
        if label is None or pattern is None or not matches(pattern, label):
            return False
        if pattern.p is not None and pattern.p != pattern.q:
            return pattern.p == label.p
        return label.p is None or label.q is None or label.p <= label.q

    def _matches_turned(self, orbit: Found) -> bool:
        """Whether the orbit has the label when it is started at its other end: Umnpq is Umnqp."""
        label, pattern = orbit.label, self.name.label
        return label is not None and pattern is not None and label.kind == "U" and label.p != label.q and matches(pattern, label)

    def families(self, found: list[Found]) -> list[tuple[Found, Branch]]:
        """One orbit of each family, and the family traced."""
        from branches.tracing import follow_family

        # What a range of energies cuts apart can be one family.
        low, high = min(self.range[0], self.limits.energy[0]), max(self.range[1], self.limits.energy[1])
        out: list[tuple[Found, Branch]] = []
        followed: list[Branch] = []
        for orbit in found:
            if any(passes(branch, orbit) for branch in followed):
                continue
            branch = follow_family(orbit.problem, orbit.solution.y, energy=(low, high))
            followed.append(branch)
            if self.name.family is not None and not branch.has_id(self.name.family):
                self.others[branch.id] = branch
                continue
            out.append((orbit, branch))
        return out

    def nothing(self) -> str:
        """What was searched, and what exists."""
        low, high = self.energy
        where = f"at h = {low:g}" if low == high else f"for h in {low:g}:{high:g}"
        counts = self.impacts if len(self.impacts) == 1 else f"{self.impacts[0]} to {self.impacts[-1]}"
        text = (
            f"no orbit {self.name.label or self.name.family} found {where}, quarter period up to {self.limits.quarter_period:g}, "
            f"with {counts if isinstance(counts, str) else counts[0]} inner impacts in the solved segment "
            f"({self.searched[0]} energies, {self.searched[1]} angles)"
        )
        if self.name.family is not None and self.others:
            known = [
                f"{name} ({branch.label or 'no label'}, from h = {branch.points['h'].min():.6g})" for name, branch in self.others.items()
            ]
            return f"{text}; with these ends and this word there {'is' if len(known) == 1 else 'are'} {', '.join(known[:5])}"
        label = self.name.label
        if label is not None:
            for root, turns in roots(label):
                if turns > 1 and self._exists(root):
                    return f"{label} is {turns} turns of {root}; expected the name of a primitive orbit"
        if self.seen and label is not None:
            near = nearest(str(canonical(label)), list(self.seen))
            near = near or tuple(list(self.seen)[:3])
            text += "; nearest that exist: " + ", ".join(f"{k}@h={self.seen[k][0]:.5g},alpha={self.seen[k][1]:.5g}" for k in near)
        return text

    def _exists(self, root: Label) -> bool:
        search = _Search(self.system, Name(root, None, None, None), self.limits, self.range)
        step, angles = LEVELS[0]
        return any(search._at(h, angles) for h in search._energies(step))


def from_other_end(orbit: Found) -> Found:
    """The same origin..origin orbit, started half a period later; itself where Newton does not confirm it there."""
    from branches.stretch import embed

    stretch = embed(orbit.problem, orbit.solution.y, (1, 2))
    problem = MultipointProblem(orbit.problem.system, stretch.ends, stretch.word)
    try:
        turned = accept(problem, problem.solve(stretch.unknowns(problem), energy=orbit.h))
    except NotConverged:
        return orbit
    return orbit if turned is None else turned


def passes(branch: Branch, orbit: Found) -> bool:
    """Whether a branch passes through an orbit, in whatever presentation."""
    odd = branch.system.has_odd_symmetry
    mine, other = branch.problem, orbit.problem
    if canonical_word(mine.word, mine.ends, odd_symmetry=odd) != canonical_word(other.word, other.ends, odd_symmetry=odd):
        return False
    return any(
        abs(candidate.alpha / orbit.alpha - 1.0) < 1e-7 and same_orbit((mine, candidate.solution.y), (other, orbit.solution.y))
        for candidate in branch.orbits_at(energy=orbit.h)
    )
