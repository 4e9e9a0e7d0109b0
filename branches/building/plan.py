"""The plan of a build - bounds, names and energies, level by level - and its pieces of work, as objects and as JSON values."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.catalogue.catalogue import Catalogue
from branches.catalogue.database import CatalogueError, readable
from branches.catalogue.members import event_orbit
from branches.catalogue.rows import EventOrbit
from branches.presentation import Presentation, canonical_orbit
from branches.search.known import Boxes
from branches.sequences import PERIODIC, impacts_per_period
from bvp.functions import exp, log

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue.packing import PackedFamily

__all__ = [
    "Answer", "Bounds", "BuildPlan", "Grazing", "KnownGrazings", "Link", "Seed", "level_energies", "open_ranges", "plain_link",
    "plain_seed", "read_link", "read_seed", "refuse_other_plan", "saved_seed",
]  # fmt: skip


@dataclass(frozen=True)
class Bounds:
    """Limits of a catalogue.

    Parameters
    ----------
    energy : (float, float)
        Lowest and highest energy.
    quarter_period : float
        Longest quarter period.
    impacts : int
        Largest number of impacts in half a period.

    Raises
    ------
    ValueError
        If a limit is reversed, negative or not a number.

    Examples
    --------
    >>> Bounds((0.05, 100.0), 5.1, 10).holds(alpha=2.0, impacts=20)
    True
    >>> Bounds((0.05, 100.0), 5.1, 10).holds(alpha=5.2, impacts=20)
    False
    """

    energy: tuple[float, float]
    quarter_period: float
    impacts: int

    def __post_init__(self) -> None:
        low, high = self.energy
        if not 0.0 < low < high < math.inf:
            raise ValueError(f"the energies {low:g}:{high:g} are empty, reversed or without a bound; expected 0 < LO < HI")
        if not 0.0 < self.quarter_period < math.inf:
            raise ValueError(f"the longest quarter period is {self.quarter_period:g}; expected a number above 0")
        if self.impacts < 1:
            raise ValueError(f"the most impacts in half a period are {self.impacts}; expected 1 or more")

    def holds(self, *, alpha: float, impacts: int) -> bool:
        """Whether a quarter period and a number of impacts in a full period are within the bounds."""
        return alpha <= self.quarter_period and impacts <= 2 * self.impacts


@dataclass(frozen=True)
class BuildPlan:
    """The plan of a build: its bounds and its named families.

    Parameters
    ----------
    bounds : Bounds
        Limits of all families.
    named : Bounds
        Wider limits, for families with names and for their direct neighbours.
    names : tuple of str
    reference_points : mapping
        Reference points; they choose among the families that match a name.
    """

    bounds: Bounds
    named: Bounds
    names: tuple[str, ...] = ()
    reference_points: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Seeds carry their plan to other processes, so it is plain data.
        points = {name: dict(point) for name, point in self.reference_points.items()}
        object.__setattr__(self, "reference_points", points)

    @classmethod
    def within(cls, bounds: Bounds) -> BuildPlan:
        """Everything inside the bounds, and no names."""
        return cls(bounds, bounds)

    def plain(self) -> dict[str, Any]:
        """As JSON values."""
        # An older version could follow generations of families without a reversal. Its unfinished builds are continued with none.
        return {**asdict(self), "generations": 0}


COARSE = 0.5
"""Step in log h of the first energies searched."""

GAPS = 4
"""Steps of the last level between energies with complete searches. If there are more, the range between them is open."""

INSIDE = 1e-6
"""Distance of the outermost energies from the bounds, as a part of the range of log h."""


def level_energies(level: int, energy: tuple[float, float]) -> list[float]:
    """Energies of a level. Those of all levels together are even in log h.

    The first level also has two energies just inside the bounds. They meet every family that crosses a bound.

    Examples
    --------
    >>> [round(h, 3) for h in level_energies(0, (1.0, 2.0))], [round(h, 3) for h in level_energies(1, (1.0, 2.0))]
    ([1.0, 1.189, 1.682, 2.0], [1.414])
    """
    low, high = log(energy)
    count = _count(energy)
    if level == 0:
        parts = np.concatenate([[INSIDE], (np.arange(count) + 0.5) / count, [1.0 - INSIDE]])
    else:
        fine = count * 2 ** (level - 1)
        parts = np.arange(1, fine) / fine if level == 1 else (np.arange(fine) + 0.5) / fine
    return [float(h) for h in exp(low + parts * (high - low))]


def open_ranges(levels: int, energy: tuple[float, float], without: Collection[float]) -> list[tuple[float, float]]:
    """Ranges between neighbouring energies of all levels, some left out, that are more than `GAPS` steps of the last level apart.

    Examples
    --------
    >>> open_ranges(2, (1.0, 2.0), [])
    []
    >>> every = sorted(h for level in range(4) for h in level_energies(level, (1.0, 2.0)))
    >>> [(round(low, 3), round(high, 3)) for low, high in open_ranges(4, (1.0, 2.0), every[4:9])]
    [(1.139, 1.477)]
    """
    every = np.sort([h for level in range(levels) for h in level_energies(level, energy)])
    kept = np.array([energy[0], *every[~np.isin(every, list(without))], energy[1]])
    step = log(energy[1] / energy[0]) / (_count(energy) * 2 ** (levels - 1))
    wide = np.flatnonzero(np.diff(log(kept)) > (GAPS + 0.5) * step)
    return [(float(kept[i]), float(kept[i + 1])) for i in wide]


def _count(energy: tuple[float, float]) -> int:
    return max(2, math.ceil(log(energy[1] / energy[0]) / COARSE))


class Seed(NamedTuple):
    """A piece of work.

    kind: "energy", "mode", "name", "orbit" or "grazing". value: the energy; (index of the mode, k of its k-fold cover); the name; the orbit
    as an `EventOrbit`; or a `Grazing`. plan: of the complete build. wide: whether the wider bounds of the plan hold for the family and its
    neighbours. further: how many more generations of neighbours it gives, None without a limit. Below 0 the family is not followed, only
    connected if it is known in the end. link: how the orbit's family was reached, None if it was found by itself. images: the orbit's
    presentations (`branches.presentation.presentations`), by which it is recognised; may be empty. known: boxes around the orbits of the
    families that are known at an energy when it is searched (`branches.search.known`); None if it is to find them, too.
    """

    kind: str
    value: Any
    plan: BuildPlan
    wide: bool = False
    further: int | None = None
    link: Link | None = None
    images: tuple[Presentation, ...] = ()
    known: Boxes | None = None

    @property
    def is_closed(self) -> bool:
        """Whether it is of a family without a reversal."""
        orbit = self.value.orbit if self.kind == "grazing" else self.value
        return isinstance(orbit, EventOrbit) and orbit.ends == PERIODIC

    @property
    def unfolded_within(self) -> tuple[bool, int]:
        """In which limits a grazing orbit is unfolded, and how many generations of families without a reversal may come of it."""
        return self.wide, (self.further or 0) if self.is_closed else 1

    @property
    def bounds(self) -> Bounds:
        """The limits in which the family is followed."""
        return self.plan.named if self.wide else self.plan.bounds


class Grazing(NamedTuple):
    """A grazing orbit, to be unfolded once for all the families that meet there.

    orbit: as the family has it that it was reached on. rising: whether that family leaves it upward in energy. mark: numbers that it has
    for each of the families (`Touching.mark`), None where it is unfolded for each of them.
    """

    orbit: EventOrbit
    rising: bool
    mark: tuple[float, float, float] | None


@dataclass(frozen=True)
class Link:
    """An edge of the graph before the family on its other side is known.

    source: id of the family or linear mode. event, type: of the event there. kind: of the edge. note: a text. target: id of the node on
    the other side, if it is known without a search. here, there: the event's orbit as the two families have it. width: of the event's
    bracket. flux: of the impacts of a response's orbit there.
    """

    source: str
    event: str
    type: str
    kind: str
    h: float
    alpha: float
    stop: str | None = None
    note: str | None = None
    target: str | None = None
    here: EventOrbit | None = None
    there: EventOrbit | None = None
    width: float = 0.0
    flux: float = 0.0


class Answer(NamedTuple):
    """The result of a seed.

    seeds: the next ones. branch: the family that was followed, with its `full_family` known and the columns alone that it is
    compared by. packed: its rows for the catalogue. ends:
    links without a family on the other side, with the reason as their note. beyond: how many neighbours are outside the bounds. failed:
    work that failed, as texts. halves: 1 if only one side of a branch point was followed, because the other side is its
    image (`is_half`). lost: bifurcations at which no new family was found. incomplete: energies at which the search is not
    complete. missed: events that the family needs and does not have (`branches.between_events`).
    """

    seeds: tuple[Seed, ...]
    branch: Branch | None = None
    packed: PackedFamily | None = None
    ends: tuple[Link, ...] = ()
    beyond: int = 0
    failed: tuple[str, ...] = ()
    halves: int = 0
    lost: tuple[str, ...] = ()
    incomplete: tuple[float, ...] = ()
    missed: tuple[str, ...] = ()


def refuse_other_plan(catalogue: Catalogue, plan: BuildPlan) -> bool:
    """Whether a build of this plan was begun in a catalogue.

    Raises
    ------
    CatalogueError
        Where one of another plan was.
    """
    earlier = catalogue.progress("plan")
    if earlier is None:
        return False
    if earlier != json.loads(json.dumps(plan.plain())):
        with readable(catalogue.path, "the plan of its build"):
            there = _in_words(earlier)
        received = _in_words(plan.plain())
        raise CatalogueError(f"{catalogue.path} was built for {there}; received {received}; expected the same, or another file")
    return True


def saved_seed(catalogue: Catalogue, branch: Branch, plan: BuildPlan) -> Seed:
    """The seed of a family that was saved: from its orbit inside the plan's limits that is nearest to the one it was started from.

    Raises
    ------
    CatalogueError
        If no orbit is inside.
    """
    h, alpha = branch.points["h"], branch.points["alpha"]
    impacts = impacts_per_period(branch.problem.sequence, branch.ends)
    for bounds, wide, further in ((plan.bounds, False, None), (plan.named, True, 0)):
        low, high = bounds.energy
        inside = [i for i in range(len(h)) if low <= h[i] <= high and bounds.holds(alpha=float(alpha[i]), impacts=impacts)]
        if inside:
            place = min(inside, key=lambda i: abs(i - branch.start))
            return Seed("orbit", event_orbit(*canonical_orbit(branch.problem, branch.unknowns(place))), plan, wide, further)
    raise CatalogueError(
        f"{catalogue.path} holds the family {branch.id}, h {h.min():.6g}:{h.max():.6g}, quarter period from {alpha.min():.6g}, "
        f"{impacts / 2:g} impacts in half a period, which a build for {_in_words(plan.plain())} would lose; "
        "expected wider limits, or another file"
    )


def _in_words(plan: dict[str, Any]) -> str:
    bounds = plan["bounds"]
    low, high = bounds["energy"]
    within = f"h {low:.15g}:{high:.15g}, quarter period up to {bounds['quarter_period']:g}, up to {bounds['impacts']} impacts"
    return f"{within}, {len(plan['names'])} names"


def plain_seed(seed: Seed) -> dict[str, Any]:
    """A seed as JSON values. Its plan and its images are left out: the build has the plan, and the images follow from the orbit."""
    return {
        "kind": seed.kind,
        "value": _plain(seed.value),
        "wide": seed.wide,
        "further": seed.further,
        "link": plain_link(seed.link),
    }


def read_seed(plain: dict[str, Any], plan: BuildPlan) -> Seed:
    """The inverse of `plain_seed`."""
    kind, value, link = plain["kind"], plain["value"], plain["link"]
    if kind == "orbit":
        value = _kept(value)
    elif kind == "grazing":
        value = Grazing(_kept(value["orbit"]), value["rising"], None if value["mark"] is None else tuple(value["mark"]))
    elif kind == "mode":
        value = tuple(value)
    return Seed(kind, value, plan, plain["wide"], plain["further"], read_link(link))


def _plain(value: Any) -> Any:
    if isinstance(value, Grazing):
        return {"orbit": vars(value.orbit), "rising": value.rising, "mark": value.mark}
    return vars(value) if isinstance(value, EventOrbit) else value


def plain_link(link: Link | None) -> dict[str, Any] | None:
    """A link as JSON values."""
    return None if link is None else {name: _plain(value) for name, value in vars(link).items()}


def read_link(plain: dict[str, Any] | None) -> Link | None:
    """The inverse of `plain_link`."""
    sides = ("here", "there")
    return None if plain is None else Link(**plain | {side: None if plain[side] is None else _kept(plain[side]) for side in sides})


def _kept(plain: dict[str, Any]) -> EventOrbit:
    return EventOrbit(tuple(plain["ends"]), plain["sequence"], tuple(plain["start"]), tuple(plain["flight_times"]))


Mark = tuple[float, float, float]

SAME = 1e-7
"""Largest relative difference of energies, quarter periods and patterns of one grazing orbit. Events are located to 1e-10."""


class KnownGrazings:
    """The grazing orbits whose neighbours were followed, each with its number of generations of families without a reversal.

    Examples
    --------
    >>> known = KnownGrazings()
    >>> known.add((0.5, 1.7, 3.2), (False, 0))
    >>> known.has((0.5 + 1e-12, 1.7, 3.2), (False, 0)), known.has((0.5, 1.7, 3.2), (False, 1)), known.has((0.5, 1.7, 3.2), (True, 0))
    (True, False, False)
    >>> known.add((0.6, 1.7, 3.2), (True, 0))
    >>> known.has((0.6, 1.7, 3.2), (False, 0))
    True
    """

    def __init__(self) -> None:
        self._marks: dict[tuple[bool, int], list[tuple[Mark, int]]] = {}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, mark: Mark | None, asked: tuple[bool, int]) -> None:
        """Remember the `Touching.mark` of an unfolded grazing orbit: whether in the wide bounds, and how many generations further."""
        if mark is not None:
            self._marks.setdefault((asked[0], _cell(mark)), []).append((mark, asked[1]))
            self._count += 1

    def has(self, mark: Mark | None, asked: tuple[bool, int]) -> bool:
        """Whether it was unfolded in those bounds or in wider ones, for at least as many generations. Never without a mark."""
        if mark is None:
            return False
        cell = _cell(mark)
        return any(
            further >= asked[1] and all(abs(a - b) <= SAME * b for a, b in zip(mark, other, strict=True))
            for wide in {asked[0], True}
            for near in (cell - 1, cell, cell + 1)
            for other, further in self._marks.get((wide, near), ())
        )


def _cell(mark: Mark) -> int:
    return int(mark[1] * 1e4)
