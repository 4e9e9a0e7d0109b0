"""Pieces of work and what comes of them; as JSON values, as they wait in a catalogue, and back."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from branches.building.plan import Bounds, Plan
from branches.catalogue.rows import EventOrbit
from branches.sequences import PERIODIC

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue.packing import PackedFamily
    from branches.presentation import Presentation

__all__ = ["Answer", "Grazing", "KnownGrazings", "Link", "Seed", "plain_seed", "read_seed"]


class Seed(NamedTuple):
    """A piece of work.

    kind: "energy", "mode", "name", "orbit" or "grazing". value: the energy; (index of the mode, its turns); the name; the orbit as an
    `EventOrbit`; or a `Grazing`. plan: how far to go. wide: whether the family is followed, and its neighbours looked for, in the wider
    limits of the plan. further: how many more generations of neighbours come of it, None without a limit; below 0 its family is not
    followed, but connected if it is known from elsewhere in the end. link: how the orbit's family was reached, None where it was found by
    itself. images: the orbit's presentations (`branches.identity.presentations`), by which it is recognised; empty where they are not at
    hand.
    """

    kind: str
    value: Any
    plan: Plan
    wide: bool = False
    further: int | None = None
    link: Link | None = None
    images: tuple[Presentation, ...] = ()

    @property
    def is_closed(self) -> bool:
        """Whether it is of a family without a reversal."""
        orbit = self.value.orbit if self.kind == "grazing" else self.value
        return isinstance(orbit, EventOrbit) and orbit.ends == PERIODIC

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
    """Where two nodes of the graph meet, before it is known which family is on the other side.

    source: id of the family or linear mode. event, type: of the event there. kind: of the edge. note: in words. target: id of the node on
    the other side, where it is known without a search. here, there: the event's orbit as the two families have it. width: of the
    event's bracket.
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


class Answer(NamedTuple):
    """What came of a seed.

    seeds: what is to be done next. branch: the family that was followed, with its `full_family` known. packed: its rows for the catalogue.
    ends: links without a family on the other side, with the reason as their note. beyond: how many neighbours lie outside the limits.
    failed: what could not be done, in words. halves: 1 for a family of which one side of a branch point was followed, where the other is
    its image (`is_half`). lost: bifurcations at which no new family was found, in words. unsettled: energies at which
    the search did not settle. missed: events that the family needs and does not have, in words (`branches.between_events.missed_events`).
    """

    seeds: tuple[Seed, ...]
    branch: Branch | None = None
    packed: PackedFamily | None = None
    ends: tuple[Link, ...] = ()
    beyond: int = 0
    failed: tuple[str, ...] = ()
    halves: int = 0
    lost: tuple[str, ...] = ()
    unsettled: tuple[float, ...] = ()
    missed: tuple[str, ...] = ()


def plain_seed(seed: Seed) -> dict[str, Any]:
    """A seed without its plan, which is that of the whole build, and without its images, which follow from its orbit."""
    return {
        "kind": seed.kind,
        "value": _plain(seed.value),
        "wide": seed.wide,
        "further": seed.further,
        "link": None if seed.link is None else asdict(seed.link),
    }


def read_seed(plain: dict[str, Any], plan: Plan) -> Seed:
    """The inverse of `plain_seed`."""
    kind, value, link = plain["kind"], plain["value"], plain["link"]
    if kind == "orbit":
        value = _kept(value)
    elif kind == "grazing":
        value = Grazing(_kept(value["orbit"]), value["rising"], None if value["mark"] is None else tuple(value["mark"]))
    elif kind == "mode":
        value = tuple(value)
    if link is not None:
        link = replace(Link(**link), here=_orbit(link["here"]), there=_orbit(link["there"]))
    return Seed(kind, value, plan, plain["wide"], plain["further"], link)


def _plain(value: Any) -> Any:
    if isinstance(value, Grazing):
        return {"orbit": asdict(value.orbit), "rising": value.rising, "mark": value.mark}
    return asdict(value) if isinstance(value, EventOrbit) else value


def _orbit(plain: dict[str, Any] | None) -> EventOrbit | None:
    return None if plain is None else _kept(plain)


def _kept(plain: dict[str, Any]) -> EventOrbit:
    return EventOrbit(tuple(plain["ends"]), plain["sequence"], tuple(plain["start"]), tuple(plain["flight_times"]))


Mark = tuple[float, float, float]

SAME = 1e-7
"""Relative difference of energies, quarter periods and patterns below which two grazing orbits are one. Events are located to 1e-10."""


class KnownGrazings:
    """The grazing orbits that were unfolded, with how many generations of families without a reversal were asked for there.

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

    def add(self, mark: Mark | None, asked: tuple[bool, int]) -> None:
        """Remember a grazing orbit that was unfolded.

        Parameters
        ----------
        mark : (float, float, float) or None
            `branches.grazing.touching.Touching.mark`; what has none is never known.
        asked : (bool, int)
            In which limits - the wide ones or not -, and how many generations further.
        """
        if mark is not None:
            self._marks.setdefault((asked[0], _cell(mark)), []).append((mark, asked[1]))

    def has(self, mark: Mark | None, asked: tuple[bool, int]) -> bool:
        """Whether it was unfolded in those limits or in wider ones, for at least as many generations."""
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
