"""Choice of one family among those that begin at an event of a family in the energy: `GR1`, `GR1,origin-stop+:`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from branches.grazing.following import leaves_upward, meetings_at
from branches.naming.matching import AmbiguousName, NameNotFound
from branches.orbit import Orbit
from branches.sequences import canonical_sequence, format_ends
from branches.switching import emanating_families
from branches.tracing import follow_family

if TYPE_CHECKING:
    from branches.branch import Branch

__all__ = ["orbit_at_event"]


def orbit_at_event(branch: Branch, name: str, family: str = "") -> Orbit:
    """An orbit of the one family that begins at an event, or crosses there, next to it.

    Parameters
    ----------
    branch : Branch
    name : str
        Id of an event of type GR, BP, SB, PD or RT; its type is enough if there is one.
    family : str
        The id of one of several families, or its beginning.

    Raises
    ------
    NameNotFound, AmbiguousName
        If there is no such family, or several; the message lists those that there are.
    ValueError
        For an event that the branch does not have, or at which no family begins.
    RuntimeError
        Where the computation finds none.

    Examples
    --------
    >>> import saltus
    >>> orbit = orbit_at_event(saltus.trace("S13O00+", energy=(0.1, 1.0)), "SB1")
    >>> orbit.ends, orbit.sequence
    (('origin', 'origin'), '-')
    """
    of_type = [event for event in branch.events if event.type == name]
    event = of_type[0] if len(of_type) == 1 else branch.event(name)
    reasons: list[str] = []
    if event.type == "GR":
        met = meetings_at(branch.problem, branch.orbit(event.point).solution.y, leaves_upward(branch, event.point))
        found = [(item.beside.problem, item.beside.y) for item in met if item.beside is not None]
        reasons = [item.reason for item in met if item.beside is None]
    else:
        found = [(item.problem, item.step.y) for item in emanating_families(branch, event)]
    orbits = [Orbit(problem, problem.solve(y, energy=problem.energy(y))) for problem, y in found]
    ids = [_id_of(orbit) for orbit in orbits]
    if len(set(ids)) < len(ids) or family.count(":") == 2:  # the hash tells them apart, or is asked for
        ids = [follow_family(orbit.problem, orbit.solution.y, points=1).id for orbit in orbits]
    chosen = {id: orbit for id, orbit in zip(ids, orbits, strict=True) if id.startswith(family)}
    if family in chosen or len(chosen) == 1:
        return chosen.get(family) or next(iter(chosen.values()))
    listed = ", ".join(f"{name},{id}" for id in (chosen or dict.fromkeys(ids)))
    if chosen:
        raise AmbiguousName(f"{len(chosen)} families begin at {name}; choose one of {listed}")
    why = f"expected one of {listed}" if ids else "; ".join(dict.fromkeys(reasons)) or "the families there are those without impacts"
    raise NameNotFound(f"no family {family + ' ' if family else ''}begins at {name}: {why}")


def _id_of(orbit: Orbit) -> str:
    """The beginning of the id of an orbit's family: canonical ends and sequence."""
    problem = orbit.problem
    sequence, ends = canonical_sequence(tuple(problem.sequence), problem.ends, odd_symmetry=problem.system.has_odd_symmetry)
    return f"{format_ends(ends)}:{''.join(sequence)}"
