"""Families, events, edges and nodes of a catalogue as plain data for JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branches.catalogue import Catalogue, Edge, FamilyRow, Node
    from branches.events import BranchEvent

__all__ = [
    "SCHEMA",
    "edge_record",
    "event_record",
    "family_record",
    "impacts_text",
    "node_record",
    "same_meeting",
]

SCHEMA = 1


def family_record(row: FamilyRow) -> dict[str, Any]:
    """A family without its points."""
    return {
        "id": row.id,
        "label": row.label,
        "ends": row.ends,
        "word": row.sequence,
        "impacts": row.impacts,
        "h": list(row.h),
        "alpha": list(row.alpha),
        "points": row.points,
        "events": row.events,
        "stable_fraction": row.stable_fraction,
        "labels": [_interval("label", part.label, part) for part in row.labels],
        "stability": [_interval("stable", None if part.stable < 0 else bool(part.stable), part) for part in row.stability],
        "ended": [{"reason": reason, "text": text} for reason, text in row.ended],
    }


def _interval(name: str, value: Any, part: Any) -> dict[str, Any]:
    return {name: value, "arclength": list(part.arclength), "h": list(part.h), "alpha": list(part.alpha)}


def event_record(event: BranchEvent) -> dict[str, Any]:
    """An event with the fields that a branch's file has."""
    record = event._asdict()
    return {**record, "bracket": [_finite(value) for value in event.bracket], "residual": _finite(event.residual)}


def edge_record(edge: Edge) -> dict[str, Any]:
    """An edge without its orbits."""
    names = ("source", "source_event", "type", "kind", "target", "target_event", "h", "alpha", "stop", "note")
    return {name: getattr(edge, name) for name in names}


def same_meeting(one: Edge, other: Edge) -> bool:
    """Whether two edges are one meeting of two families, which each of them reports.

    Examples
    --------
    >>> from branches.catalogue import Edge
    >>> here, there = Edge("A", "GR1", "GR", "fold", "B", 1.0, 1.7), Edge("B", "GR2", "GR", "fold", "A", 1.0, 1.7, "GR1")
    >>> same_meeting(here, there), same_meeting(here, Edge("B", "GR2", "GR", "fold", "A", 1.0, 1.7, "GR3")), same_meeting(here, here)
    (True, False, False)
    """
    sides = (one.source_event, other.target_event), (one.target_event, other.source_event)
    return (
        (one.source, one.target, one.kind) == (other.target, other.source, other.kind)
        and abs(one.h / other.h - 1.0) < 1e-6
        and all(a == b or not (a and b) for a, b in sides)
    )


def node_record(catalogue: Catalogue, id: str) -> dict[str, Any]:
    """A node of the graph in a few words: a family by its label and energies, another node by what it is."""
    from branches.naming.labels import spelled

    if id in catalogue:
        row = catalogue.family(id)
        return {"id": id, "kind": "family", "label": spelled(row.label, catalogue.scene.reference_points), "h": list(row.h)}
    node: Node | None = next((node for node in catalogue.nodes if node.id == id), None)
    if node is None:
        return {"id": id, "kind": "missing", "label": "", "h": None}
    record = {"id": id, "kind": node.kind, "label": node.label, "h": None if node.h is None else list(node.h)}
    return {**record, "note": node.note} if node.note else record


def impacts_text(impacts: float) -> str:
    """Impacts in half a period, which are half a number where a period has an odd one.

    Examples
    --------
    >>> impacts_text(1.0), impacts_text(2.5)
    ('1 impact in half a period', '2.5 impacts in half a period')
    """
    return f"{impacts:g} impact{'' if impacts == 1 else 's'} in half a period"


def _finite(value: float) -> float | None:
    return value if value == value and abs(value) != float("inf") else None
