"""What the rows of a catalogue say, without their points: families, events, edges, and nodes that are no families. Neither numpy nor
compiled kernels are needed to read them."""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

__all__ = [
    "EDGE_COLUMNS",
    "EVENT_COLUMNS",
    "FAMILY_COLUMNS",
    "NODE_COLUMNS",
    "Edge",
    "EventOrbit",
    "FamilyRow",
    "LabelInterval",
    "Node",
    "StabilityInterval",
    "crc_of",
    "crosses",
    "dead_end_id",
    "no_nan",
]

_ON_BOUND = 1e-10
"""How far, relatively, the last orbit of a family can be from the energy that cut it: as for `Branch.orbits_at`."""


class LabelInterval(NamedTuple):
    """Part of a family with one label: from where the last one ends, in arclength, and its ranges of energy and quarter period."""

    label: str
    arclength: tuple[float, float]
    h: tuple[float, float]
    alpha: tuple[float, float]


class StabilityInterval(NamedTuple):
    """Part of a family that is stable (1), unstable (0) or undecided (-1)."""

    stable: int
    arclength: tuple[float, float]
    h: tuple[float, float]
    alpha: tuple[float, float]


def crosses(h: tuple[float, float], energy: float) -> bool:
    """Whether a range of energies holds an energy, to the accuracy to which the end of a family lies on the bound that cut it.

    Examples
    --------
    >>> crosses((0.06911644996826903, 99.99999999999821), 100.0), crosses((0.07, 99.9999), 100.0)
    (True, False)
    """
    return h[0] * (1.0 - _ON_BOUND) <= energy <= h[1] * (1.0 + _ON_BOUND)


@dataclass(frozen=True)
class FamilyRow:
    """A family without its points.

    Attributes
    ----------
    id, label, ends, word : str
        As of `branches.branch.Branch`; `ends` joined by a hyphen, or ``periodic``.
    impacts : float
        In half a period.
    h, alpha : (float, float)
        Lowest and highest.
    points, events : int
        How many.
    start : int
        Index of the point that it was started from.
    stable_fraction : float
        Part of its arclength that is stable.
    label_names : tuple of str
        All labels along it, each once.
    details : str
        `labels`, `stability`, `ended` and `layout` as JSON: read where they are asked for.
    first_point, columns_crc : int
        Row of its first point; checksum of the columns of its points.
    number : int
        Its row.
    """

    id: str
    label: str
    ends: str
    word: str
    impacts: float
    h: tuple[float, float]
    alpha: tuple[float, float]
    points: int
    events: int
    start: int
    stable_fraction: float
    label_names: tuple[str, ...]
    details: str
    first_point: int
    columns_crc: int
    number: int

    @cached_property
    def labels(self) -> tuple[LabelInterval, ...]:
        """Where along the family each label holds."""
        return tuple(LabelInterval(name, *map(tuple, rest)) for name, *rest in self._read["labels"])

    @cached_property
    def stability(self) -> tuple[StabilityInterval, ...]:
        """Where along the family it is stable, unstable, undecided."""
        return tuple(StabilityInterval(code, *map(tuple, rest)) for code, *rest in self._read["stability"])

    @cached_property
    def ended(self) -> tuple[tuple[str, str], ...]:
        """Reason and words, at the first point and at the last."""
        return tuple((reason, text) for reason, text in self._read["ended"])

    @cached_property
    def layout(self) -> dict[str, Any]:
        """How the blobs of its points are laid out (see `branches.catalogue.points`)."""
        return self._read["layout"]

    @cached_property
    def _read(self) -> dict[str, Any]:
        return json.loads(self.details)

    def arclengths(self, name: str, fits: Callable[[Any], bool], energy: float | None = None) -> list[tuple[float, float]]:
        """Where along the family the intervals of ``labels`` or ``stability`` are whose label or code fits, and that cross an energy."""
        return [
            (s[0], s[1])
            for value, s, h, _ in self._read[name]
            if (energy is None or crosses(h, energy)) and fits(value)
        ]

    def values(self) -> tuple[Any, ...]:
        """The row, without its number and checksum, as it is stored."""
        return (
            self.id, self.label, self.ends, self.word, self.impacts, *self.h, *self.alpha, self.points, self.events, self.start,
            self.stable_fraction, " ".join(self.label_names), self.details, self.first_point, self.columns_crc,
        )  # fmt: skip

    @classmethod
    def make(
        cls,
        *,
        labels: tuple[LabelInterval, ...],
        stability: tuple[StabilityInterval, ...],
        ended: tuple[tuple[str, str], ...],
        layout: dict[str, Any],
        **fields: Any,
    ) -> FamilyRow:
        """A row from what its details say and its other fields."""
        total = stability[-1].arclength[1] - stability[0].arclength[0]
        stable = sum(part.arclength[1] - part.arclength[0] for part in stability if part.stable == 1)
        details = {"labels": labels, "stability": stability, "ended": ended, "layout": layout}
        return cls(
            stable_fraction=stable / total if total > 0.0 else float(stability[0].stable == 1),
            label_names=tuple(dict.fromkeys(part.label for part in labels if part.label)),
            details=_json(details),
            **fields,
        )

    @classmethod
    def read(cls, number: int, values: tuple[Any, ...]) -> FamilyRow:
        """The inverse of `values`."""
        (
            id, label, ends, word, impacts, h_low, h_high, alpha_low, alpha_high, points, events, start, fraction, names, details,
            first_point, columns_crc,
        ) = values  # fmt: skip
        return cls(
            id, label, ends, word, impacts, (h_low, h_high), (alpha_low, alpha_high), points, events, start, fraction,
            tuple(names.split()), details, first_point, columns_crc, number,
        )  # fmt: skip


FAMILY_COLUMNS = (
    "id", "label", "ends", "word", "impacts", "h_low", "h_high", "alpha_low", "alpha_high", "points", "events", "start",
    "stable_fraction", "label_names", "details", "first_point", "columns_crc",
)  # fmt: skip

EVENT_COLUMNS = (
    "id", "type", "point", "number", "h", "alpha", "arclength", "status", "bracket_low", "bracket_high", "residual", "label",
    "stop", "p", "q", "breaks", "note", "stable", "multiplier", "more",
)  # fmt: skip


@dataclass(frozen=True)
class Node:
    """A node of the graph that is no family.

    Attributes
    ----------
    id : str
        ``L11+``; of a dead end it is made from the edge that ends there.
    kind : str
        ``linear mode`` or ``dead end``.
    label : str
    h : (float, float) or None
        Range of energies of a linear mode.
    alpha : float or None
        Its quarter period.
    note : str
        Why an edge ends here.
    """

    id: str
    kind: str
    label: str = ""
    h: tuple[float, float] | None = None
    alpha: float | None = None
    note: str = ""

    def values(self) -> tuple[Any, ...]:
        """The row without its checksum."""
        low, high = self.h or (None, None)
        return self.id, self.kind, self.label, low, high, self.alpha, self.note

    @classmethod
    def read(cls, values: tuple[Any, ...]) -> Node:
        """The inverse of `values`."""
        id, kind, label, low, high, alpha, note = values
        return cls(id, kind, label, None if low is None else (low, high), alpha, note)


NODE_COLUMNS = ("id", "kind", "label", "h_low", "h_high", "alpha", "note")


@dataclass(frozen=True)
class EventOrbit:
    """The orbit of an event as an orbit of one of the two families that meet there.

    Attributes
    ----------
    ends : (str, str)
    word : str
    start : tuple of 2 n float
        Displacements, then velocities, at the start of the solved segment.
    flight_times : tuple of float
        One more than the inner impacts.
    """

    ends: tuple[str, str]
    word: str
    start: tuple[float, ...]
    flight_times: tuple[float, ...]

    def values(self) -> tuple[str, bytes, int]:
        """Problem (JSON), states (float64, little-endian) and their checksum."""
        problem = _json([*self.ends, self.word, len(self.start), len(self.flight_times)])
        numbers = [*map(float, self.start), *map(float, self.flight_times)]
        states = struct.pack(f"<{len(numbers)}d", *numbers)
        return problem, states, zlib.crc32(states)

    @classmethod
    def read(cls, problem: str, states: bytes) -> EventOrbit:
        """The inverse of `values`."""
        first, last, word, count, flights = json.loads(problem)
        numbers = struct.unpack(f"<{count + flights}d", states)
        return cls((first, last), word, numbers[:count], numbers[count:])


@dataclass(frozen=True)
class Edge:
    """An event that joins two nodes.

    Attributes
    ----------
    source : str
        Id of the family, or of the linear mode, that has the event.
    source_event : str
        The event's id there; "" of a linear mode's grazing.
    type : str
        Its code: GR, SN, BP, SB, PD, RT.
    kind : str
        How they meet: ``fold``, ``passage``, ``switch``, ``dead end``, ``linear mode``.
    target : str or None
        Id of the node on the other side; None makes a dead end, with `note` as its reason.
    target_event : str
        The event's id on the target; "" where it has none of its own.
    h, alpha : float
    stop : str or None
        Contact that is touched or left.
    note : str or None
    source_orbit, target_orbit : EventOrbit or None
        The event's orbit as the two families have it, so that it can be checked that the edge closes.
    """

    source: str
    source_event: str
    type: str
    kind: str
    target: str | None
    h: float
    alpha: float
    target_event: str = ""
    stop: str | None = None
    note: str | None = None
    source_orbit: EventOrbit | None = None
    target_orbit: EventOrbit | None = None

    def values(self) -> tuple[Any, ...]:
        """The row without its number and checksum."""
        nothing = (None, None, None)
        return (
            self.source, self.source_event, self.type, self.kind, self.target, self.target_event, self.h, self.alpha, self.stop,
            self.note, *(self.source_orbit.values() if self.source_orbit else nothing),
            *(self.target_orbit.values() if self.target_orbit else nothing),
        )  # fmt: skip

    @classmethod
    def read(cls, values: tuple[Any, ...]) -> Edge:
        """The inverse of `values`; the blobs' checksums are not looked at."""
        (
            source, source_event, type, kind, target, target_event, h, alpha, stop, note,
            source_problem, source_states, _, target_problem, target_states, _,
        ) = values  # fmt: skip
        return cls(
            source, source_event, type, kind, target, h, alpha, target_event, stop, note,
            None if source_problem is None else EventOrbit.read(source_problem, source_states),
            None if target_problem is None else EventOrbit.read(target_problem, target_states),
        )  # fmt: skip


def dead_end_id(source: str, event: str) -> str:
    """Id of the node at which an edge without a target ends."""
    return f"dead end:{source}:{event}"


EDGE_COLUMNS = (
    "source", "source_event", "type", "kind", "target", "target_event", "h", "alpha", "stop", "note",
    "source_problem", "source_states", "source_crc", "target_problem", "target_states", "target_crc",
)  # fmt: skip


def crc_of(values: tuple[Any, ...]) -> int:
    """Checksum of a row's values.

    Examples
    --------
    >>> crc_of(("L11+", 0.5, None)) == crc_of(("L11+", 0.5, None)), crc_of((0.0,)) == crc_of((-0.0,))
    (True, False)
    """
    return zlib.crc32(repr(values).encode())


def no_nan(value: float | None) -> float | None:
    """A number as a float; None for NaN, which SQLite does not know."""
    return None if value is None or math.isnan(value) else float(value)


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False)
