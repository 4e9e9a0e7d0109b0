"""Seeds as JSON values, as they wait in a catalogue, and back."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

from branches.building.bounds import Plan
from branches.building.work import Grazing, Link, Seed
from branches.catalogue.rows import EventOrbit

__all__ = ["plain_seed", "read_seed"]


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
    return EventOrbit(tuple(plain["ends"]), plain["word"], tuple(plain["start"]), tuple(plain["flight_times"]))
