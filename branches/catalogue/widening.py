"""Adding a branch to a catalogue that may hold a part of its family already.

A cut branch is replaced by a wider one: its events get new numbers, and the edges are updated.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Any

from branches.catalogue.database import CatalogueError
from branches.catalogue.rows import Edge, EventOrbit, dead_end_id
from branches.catalogue.store import CatalogueStore
from branches.events import BranchEvent

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.forced.branch import ForcedBranch

__all__ = ["CannotWiden", "Kept", "holds", "widen"]

SAME = 1e-8
"""Largest relative distance of an event that was located twice from itself."""

_SMALL = 1e-6
"""Smallest size of a number that a relative distance refers to."""

PLACES = 9
"""Number of orbits, evenly spread and with both ends, that decide whether one branch contains another."""


class Kept(Enum):
    """The effect of adding a branch."""

    NEW = "the family is new"
    KNOWN = "the catalogue has all of the branch already"
    WIDER = "the branch has replaced a part of it"


class CannotWiden(CatalogueError):
    """A family stays as it was, without the given branch. The message says why."""


def holds(branch: Branch | ForcedBranch, other: Branch | ForcedBranch) -> bool:
    """Whether `branch` contains `other`, tested at both ends of `other` and at `PLACES` - 2 points between them.

    Parameters
    ----------
    branch, other : Branch or ForcedBranch
        Branches of the same system.
    """
    from branches.forced.branch import ForcedBranch

    if isinstance(branch, ForcedBranch) and isinstance(other, ForcedBranch):
        from branches.catalogue.responses import contains

        return contains(branch, other, PLACES)
    assert not isinstance(branch, ForcedBranch) and not isinstance(other, ForcedBranch)
    from branches.catalogue.members import KnownFamilies

    known = KnownFamilies()
    known.add("", branch)
    # The ends come first: they are the points that a narrower branch most often lacks.
    last = len(other) - 1
    places = sorted({round(k * last / (PLACES - 1)) for k in range(PLACES)}, key=lambda i: (i not in (0, last), i))
    return all(known.find(other.problem, other.unknowns(i)) is not None for i in places)


def widen(catalogue: CatalogueStore, branch: Branch | ForcedBranch) -> Kept:
    """Add a family, or replace a part of it that is there already: see `Catalogue.widen`."""
    from branches.forced.branch import ForcedBranch
    from bvp.checks import require_branch

    require_branch(branch)
    if isinstance(branch, ForcedBranch):
        from branches.catalogue.responses import kept_branch

        branch = kept_branch(catalogue, branch)
    else:
        catalogue.require_system(branch.system.describe())
    if branch.id not in catalogue:
        catalogue.add(branch)
        return Kept.NEW
    narrow = catalogue.branch(branch.id)
    if holds(narrow, branch):
        return Kept.KNOWN
    wider: Branch | ForcedBranch | None
    if isinstance(branch, ForcedBranch):
        from branches.catalogue.responses import joined_family

        wider = joined_family(narrow, branch)
    else:
        wider = branch if holds(branch, narrow) else None
    if wider is None:
        raise CannotWiden("the new branch does not have all orbits of the family in the catalogue")
    if catalogue.work():
        raise CannotWiden("a build of the catalogue is not finished, and refers to the family's events")
    names = {"": ""}
    moved = [(edge, _moved(edge, narrow, wider, names)) for edge in catalogue.edges(narrow.id)]
    nodes = {node.id: node for node in catalogue.nodes}
    with catalogue.transaction():
        catalogue.remove(narrow.id)
        catalogue.add(wider)
        ends = [(nodes[old.target], new.target) for old, new in moved if old.target != new.target and old.target and new.target]
        # Two of them may exchange their ids.
        for node, _ in ends:
            catalogue.remove_node(node.id)
        for node, id in ends:
            catalogue.add_node(replace(node, id=id))
        for _, edge in moved:
            catalogue.connect(edge)
    return Kept.WIDER


def _moved(edge: Edge, narrow: Any, wider: Any, names: dict[str, str]) -> Edge:
    """An edge at the narrow branch as it is at the wider one. `names` collects the ids there of events here.

    Raises
    ------
    CannotWiden
        If the edge's event, or its orbit, is not found on the wider branch.
    """
    if edge.source == narrow.id:
        name = _name(edge.source_event, narrow, wider, names)
        dead = edge.target == dead_end_id(narrow.id, edge.source_event)
        target = dead_end_id(narrow.id, name) if dead else edge.target
        edge = replace(edge, source_event=name, target=target, source_orbit=_seen(edge.source_orbit, narrow, wider))
    if edge.target == narrow.id:
        name = _name(edge.target_event, narrow, wider, names)
        edge = replace(edge, target_event=name, target_orbit=_seen(edge.target_orbit, narrow, wider))
    return edge


def _name(id: str, narrow: Any, wider: Any, names: dict[str, str]) -> str:
    if id not in names:
        old = next((event for event in _events_of(narrow) if event.id == id), None)
        new = None if old is None else _same_event(old, wider, names.values())
        if new is None:
            raise CannotWiden(f"the event {id}, where other families meet it, is not found on the new branch")
        names[id] = new.id
    return names[id]


def _events_of(branch: Branch | ForcedBranch) -> tuple[BranchEvent, ...]:
    from branches.forced.branch import ForcedBranch

    if isinstance(branch, ForcedBranch):
        from branches.catalogue.responses import plain_events

        return plain_events(branch)
    return branch.events


def _same_event(event: BranchEvent, branch: Branch | ForcedBranch, taken: Collection[str]) -> BranchEvent | None:
    """The event of a branch that is the same as an event of another one, and not taken: a family can pass twice through an orbit."""

    def apart(found: BranchEvent) -> float:
        pairs = (found.h, event.h), (found.alpha, event.alpha)
        return max(abs(one - other) / max(abs(other), _SMALL) for one, other in pairs)

    def details(found: BranchEvent) -> tuple[object, ...]:
        return found.stop, found.p_q, found.breaks

    def slack(found: BranchEvent) -> float:
        return max(SAME, *(located.bracket[1] - located.bracket[0] for located in (event, found)))

    free = (found for found in _events_of(branch) if found.type == event.type and found.id not in taken)
    near = [found for found in free if apart(found) <= slack(found)]
    # Several events can be at one orbit: grazings of several stops, several resonances.
    near = [found for found in near if details(found) == details(event)] or near
    return min(near, key=lambda found: max(apart(found), SAME), default=None)


def _seen(orbit: EventOrbit | None, narrow: Any, wider: Any) -> EventOrbit | None:
    """An edge's orbit with the ends and impact sequence of the wider branch."""
    # Of a forced family both branches have the problem of the narrow one.
    if orbit is None or not hasattr(narrow, "ends") or (narrow.ends, narrow.sequence) == (wider.ends, wider.sequence):
        return orbit
    from branches.catalogue.members import presented, unknowns_of

    found = presented(narrow.problem, unknowns_of(narrow.problem, orbit), wider.ends, tuple(wider.problem.sequence))
    if found is None:
        raise CannotWiden("an orbit where another family meets it is not found between the ends of the new branch")
    return found
