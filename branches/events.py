"""Special points of a branch, the reasons of its ends, and counters of stability work. Importing this loads neither numpy nor kernels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any, NamedTuple, TypeVar

from bvp.texts import brief

__all__ = [
    "FREE_NORMAL_FORMS", "BranchEvent", "DigitWork", "Ended", "event_ids", "ids_at_points", "moved", "normal_form_text", "numbered",
]  # fmt: skip

AnyEvent = TypeVar("AnyEvent", bound=Any)
"""A `BranchEvent`, or an event of a branch or curve in parameters."""

FREE_NORMAL_FORMS = ("SN", "SB", "PD")
"""Bifurcations of free orbits whose normal form has a coefficient."""


def event_ids(types: Iterable[str]) -> list[str]:
    """Ids of events in order of arclength: type and count, "SB1"; with a hyphen behind a type that ends in a digit, "R1-1"."""
    counts = Counter[str]()
    ids = []
    for type in types:
        counts[type] += 1
        ids.append(f"{type}{'-' if type[-1].isdigit() else ''}{counts[type]}")
    return ids


def numbered(events: Iterable[AnyEvent]) -> tuple[AnyEvent, ...]:
    """Events in order of arclength, with their `event_ids`."""
    found = list(events)
    return tuple(event._replace(id=id) for event, id in zip(found, event_ids(event.type for event in found), strict=True))


def moved(event: AnyEvent, place: int, length: float, sign: int = 1) -> AnyEvent:
    """An event of a piece whose first point has this place and arclength in another branch, along it or against it (sign -1)."""
    low, high = sorted(length + sign * end for end in event.bracket)
    at = length + sign * event.arclength
    # Rounding must not move the event out of its bracket.
    return event._replace(point=place + sign * event.point, arclength=at, bracket=(min(low, at), max(high, at)))


def ids_at_points(events: Iterable[tuple[int, str]], count: int) -> list[str]:
    """The ids of the events at each of count points, separated by spaces. events: places and ids."""
    found = [""] * count
    for place, id in events:
        found[place] = f"{found[place]} {id}".lstrip()
    return found


def normal_form_text(criticality: str | None, coefficient: float | None) -> str:
    """The criticality and the coefficient of an event, as a table shows them; empty if neither is known. Of a degenerate one the
    coefficient is below its error, and says nothing."""
    number = "" if coefficient is None or criticality == "degenerate" else f"{coefficient:.4g}"
    return " ".join(part for part in (criticality or "", number) if part)


@brief
class BranchEvent(NamedTuple):
    """A special point of a branch, with its error bar.

    id: type and count along the branch, e.g. "SB1". point: index into `Branch.points`. number: count of points from the start orbit,
    negative below it. bracket: arclengths between which it certainly is. residual: of its test function. stop: contact touched or
    left (GR). p_q: [p, q] of a p:q resonance. breaks: what an SB breaks. multiplier: modulus of the largest multiplier. coefficient: of
    the normal form at SN, SB and PD, if it was computed (`branches.released.criticality`); criticality: what it means at SB and PD.
    """

    id: str
    type: str
    point: int
    number: int
    h: float
    alpha: float
    arclength: float
    status: str
    bracket: tuple[float, float]
    residual: float
    label: str
    stop: str | None
    p_q: list[int] | None
    breaks: str | None
    note: str | None
    stable: bool | None
    multiplier: float | None
    coefficient: float | None = None
    criticality: str | None = None

    @property
    def normal_form(self) -> str:
        """The criticality and the coefficient, as a table shows them."""
        return normal_form_text(self.criticality, self.coefficient)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        low, high = self.bracket
        return f"{self.id}: h = {self.h:.10g}, alpha = {self.alpha:.10g}, arclength {low:.10g} to {high:.10g}, {self.status}", []


class Ended(NamedTuple):
    """Why a branch ends where it does: `reason`, the name of a member of `continuation.EndReason`, and `text`."""

    reason: str
    text: str


class DigitWork(NamedTuple):
    """How many orbits were solved in fifty digits to decide their stability, and the time in seconds."""

    orbits: int = 0
    seconds: float = 0.0

    def __add__(self, other: tuple[object, ...]) -> DigitWork:  # of the sums, not of the tuples
        assert isinstance(other, DigitWork)
        return DigitWork(self.orbits + other.orbits, self.seconds + other.seconds)
