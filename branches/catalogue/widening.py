"""Replacement of a cut branch by a wider one: its events get new numbers, and the edges are updated."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING

from branches.catalogue.database import CatalogueError
from branches.catalogue.members import KnownFamilies
from branches.catalogue.rows import dead_end_id

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue.rows import Edge, EventOrbit
    from branches.catalogue.store import CatalogueStore
    from branches.events import BranchEvent

__all__ = ["CannotWiden", "Kept", "holds", "widen"]

SAME = 1e-8
"""Largest relative distance of an event that was located twice from itself."""

PLACES = 9
"""Number of orbits, evenly spread and with both ends, that decide whether one branch contains another."""


class Kept(Enum):
    """The effect of adding a branch."""

    NEW = "the family is new"
    KNOWN = "the catalogue has all of the branch already"
    WIDER = "the branch has replaced a part of it"


class CannotWiden(CatalogueError):
    """A family stays as it was, without the given branch. The message says why."""


def holds(branch: Branch, other: Branch) -> bool:
    """Whether `branch` contains `other`, tested at both ends of `other` and at `PLACES` - 2 points between them.

    Parameters
    ----------
    branch, other : Branch
        Branches of the same system.
    """
    known = KnownFamilies()
    known.add("", branch)
    # The ends come first: they are the points that a narrower branch most often lacks.
    last = len(other) - 1
    places = sorted({round(k * last / (PLACES - 1)) for k in range(PLACES)}, key=lambda i: (i not in (0, last), i))
    return all(known.find(other.problem, other.unknowns(i)) is not None for i in places)


def widen(catalogue: CatalogueStore, branch: Branch) -> Kept:
    """Add a family, or replace a part of it that is there already: see `Catalogue.widen`."""
    catalogue.require_system(branch.system.describe())
    if branch.id not in catalogue:
        catalogue.add(branch)
        return Kept.NEW
    narrow = catalogue.branch(branch.id)
    if holds(narrow, branch):
        return Kept.KNOWN
    if not holds(branch, narrow):
        raise CannotWiden("the new branch does not have all orbits of the family in the catalogue")
    if catalogue.work():
        raise CannotWiden("a build of the catalogue is not finished, and refers to the family's events")
    edges = _Edges(narrow, branch)
    moved = [(edge, edges.moved(edge)) for edge in catalogue.edges(narrow.id)]
    nodes = {node.id: node for node in catalogue.nodes}
    with catalogue.transaction():
        catalogue.remove(narrow.id)
        catalogue.add(branch)
        ends = [(nodes[old.target], new.target) for old, new in moved if old.target != new.target and old.target and new.target]
        # Two of them may exchange their ids.
        for node, _ in ends:
            catalogue.remove_node(node.id)
        for node, id in ends:
            catalogue.add_node(replace(node, id=id))
        for _, edge in moved:
            catalogue.connect(edge)
    return Kept.WIDER


class _Edges:
    """The edges at a family as they are at a wider branch of it.

    Raises
    ------
    CannotWiden
        If an edge's event, or its orbit, is not found on the wider branch.
    """

    def __init__(self, narrow: Branch, wider: Branch) -> None:
        self.narrow, self.wider = narrow, wider
        self.names = {"": ""}

    def moved(self, edge: Edge) -> Edge:
        """An edge at the wider branch: at its source, at its target, or both."""
        id, out = self.narrow.id, edge
        if edge.source == id:
            name = self.name(edge.source_event)
            out = replace(out, source_event=name, source_orbit=_seen(edge.source_orbit, self.narrow, self.wider))
            if edge.target == dead_end_id(id, edge.source_event):
                out = replace(out, target=dead_end_id(id, name))
        if edge.target == id:
            out = replace(out, target_event=self.name(edge.target_event), target_orbit=_seen(edge.target_orbit, self.narrow, self.wider))
        return out

    def name(self, id: str) -> str:
        """The id on the wider branch of an event of the narrow one."""
        if id not in self.names:
            old = next((event for event in self.narrow.events if event.id == id), None)
            new = None if old is None else _same_event(old, self.wider)
            if new is None or new.id in self.names.values():
                raise CannotWiden(f"the event {id}, where other families meet it, is not found on the new branch")
            self.names[id] = new.id
        return self.names[id]


def _same_event(event: BranchEvent, branch: Branch) -> BranchEvent | None:
    """The event of a branch that is the same as an event of another one."""

    def slack(found: BranchEvent) -> float:
        return max(SAME, event.bracket[1] - event.bracket[0], found.bracket[1] - found.bracket[0])

    def apart(found: BranchEvent) -> float:
        return max(abs(found.h / event.h - 1.0), abs(found.alpha / event.alpha - 1.0))

    def details(found: BranchEvent) -> tuple[object, ...]:
        return found.stop, found.p_q, found.breaks

    near = [found for found in branch.events if found.type == event.type and apart(found) <= slack(found)]
    # Several events can be at one orbit: grazings of several stops, several resonances.
    near = [found for found in near if details(found) == details(event)] or near
    return min(near, key=apart) if near else None


def _seen(orbit: EventOrbit | None, narrow: Branch, wider: Branch) -> EventOrbit | None:
    """An edge's orbit with the ends and impact sequence of the wider branch."""
    from branches.catalogue.members import presented, unknowns_of

    if orbit is None or (narrow.ends, narrow.sequence) == (wider.ends, wider.sequence):
        return orbit
    found = presented(narrow.problem, unknowns_of(narrow.problem, orbit), wider.ends, tuple(wider.problem.sequence))
    if found is None:
        raise CannotWiden("an orbit where another family meets it is not found between the ends of the new branch")
    return found
