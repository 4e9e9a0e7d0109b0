"""A family that is kept over part of its range is kept over a wider one: events are numbered anew, and the edges go along."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING

from branches.catalogue.errors import CatalogueError
from branches.catalogue.known import KnownFamilies
from branches.catalogue.rows import dead_end_id

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue.rows import Edge, EventOrbit
    from branches.catalogue.store import Catalogue
    from branches.events import BranchEvent

__all__ = ["CannotWiden", "Kept", "holds", "widen"]

SAME = 1e-8
"""How far, relatively, the same event may be apart where it was located twice: as for an edge and its event."""

PLACES = 9
"""Orbits of a family, evenly spread and with both ends, by which it is told whether another branch holds it."""


class Kept(Enum):
    """What became of a branch that was to be kept."""

    NEW = "the family was not kept before"
    KNOWN = "the family is kept already, with all of the branch"
    WIDER = "the branch was kept in place of a part of it"


class CannotWiden(CatalogueError):
    """A family stays kept as it was, and not with the branch that was given; the message says why."""


def holds(branch: Branch, other: Branch) -> bool:
    """Whether one branch of a family has all orbits of another: its two ends and orbits spread between them.

    Parameters
    ----------
    branch, other : Branch
        Of one system.
    """
    known = KnownFamilies()
    known.add("", branch)
    last = len(other) - 1
    places = sorted({round(k * last / (PLACES - 1)) for k in range(PLACES)}, key=lambda i: (i not in (0, last), i))
    return all(known.find(other.problem, other.unknowns(i)) is not None for i in places)


def widen(catalogue: Catalogue, branch: Branch) -> Kept:
    """Keep a family, and in place of a part of it where only that is kept: see `Catalogue.widen`."""
    catalogue.require_system(branch.system.describe())
    if branch.id not in catalogue:
        catalogue.add(branch)
        return Kept.NEW
    kept = catalogue.branch(branch.id)
    if holds(kept, branch):
        return Kept.KNOWN
    if not holds(branch, kept):
        raise CannotWiden("the branch that was followed now does not have all of what is kept")
    if catalogue.work():
        raise CannotWiden("a build of the catalogue is not finished, and refers to the family's events")
    edges = _Edges(kept, branch)
    moved = [(edge, edges.moved(edge)) for edge in catalogue.edges(kept.id)]
    nodes = {node.id: node for node in catalogue.nodes}
    with catalogue.transaction():
        catalogue.remove(kept.id)
        catalogue.add(branch)
        ends = [(nodes[old.target], new.target) for old, new in moved if old.target != new.target and old.target and new.target]
        # Two of them may change places.
        for node, _ in ends:
            catalogue.remove_node(node.id)
        for node, id in ends:
            catalogue.add_node(replace(node, id=id))
        for _, edge in moved:
            catalogue.connect(edge)
    return Kept.WIDER


class _Edges:
    """The edges at a kept family as they are at a branch that holds all of it.

    Raises
    ------
    CannotWiden
        Where an edge's event, or its orbit, is not found on the wider branch.
    """

    def __init__(self, kept: Branch, wider: Branch) -> None:
        self.kept, self.wider = kept, wider
        self.names = {"": ""}

    def moved(self, edge: Edge) -> Edge:
        """An edge at the wider branch: at its source, at its target, or both."""
        id, out = self.kept.id, edge
        if edge.source == id:
            name = self.name(edge.source_event)
            out = replace(out, source_event=name, source_orbit=_seen(edge.source_orbit, self.kept, self.wider))
            if edge.target == dead_end_id(id, edge.source_event):
                out = replace(out, target=dead_end_id(id, name))
        if edge.target == id:
            out = replace(out, target_event=self.name(edge.target_event), target_orbit=_seen(edge.target_orbit, self.kept, self.wider))
        return out

    def name(self, id: str) -> str:
        """What an event of the kept family is called on the wider branch."""
        if id not in self.names:
            old = next((event for event in self.kept.events if event.id == id), None)
            new = None if old is None else _same_event(old, self.wider)
            if new is None or new.id in self.names.values():
                raise CannotWiden(f"the event {id}, where other families meet it, is not told apart on the branch that was followed now")
            self.names[id] = new.id
        return self.names[id]


def _same_event(event: BranchEvent, branch: Branch) -> BranchEvent | None:
    """The event of a branch that is an event of another one."""

    def slack(found: BranchEvent) -> float:
        return max(SAME, event.bracket[1] - event.bracket[0], found.bracket[1] - found.bracket[0])

    def apart(found: BranchEvent) -> float:
        return max(abs(found.h / event.h - 1.0), abs(found.alpha / event.alpha - 1.0))

    def told(found: BranchEvent) -> tuple[object, ...]:
        return found.stop, found.p_q, found.breaks

    near = [found for found in branch.events if found.type == event.type and apart(found) <= slack(found)]
    # Several can be at one orbit: grazings of several stops, q-tuplings of several p/q.
    near = [found for found in near if told(found) == told(event)] or near
    return min(near, key=apart) if near else None


def _seen(orbit: EventOrbit | None, kept: Branch, wider: Branch) -> EventOrbit | None:
    """An edge's orbit between the ends, and with the word, of the wider branch."""
    from branches.catalogue.closures import presented, unknowns_of

    if orbit is None or (kept.ends, kept.word) == (wider.ends, wider.word):
        return orbit
    found = presented(kept.problem, unknowns_of(kept.problem, orbit), wider.ends, tuple(wider.problem.word))
    if found is None:
        raise CannotWiden("an orbit where another family meets it is not found between the ends of the branch that was followed now")
    return found
