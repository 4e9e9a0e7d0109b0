"""Choice of one family among those that begin at an event of a family in the energy: `GR1`, `GR1,origin-stop+:`."""

from __future__ import annotations

from branches.branch import Branch, BranchEvent
from branches.grazing.following import leaves_upward, meetings_at
from branches.naming.matching import AmbiguousName, NameNotFound
from branches.orbit import Orbit
from branches.presentation import canonical_orbit
from branches.sequences import Ends, ImpactSequence, canonical_sequence, format_ends, impacts_per_period, split_family_id
from branches.switching import emanating_families
from branches.tracing import follow_family
from bvp.system import ImpactSystem

__all__ = ["id_without_hash", "orbit_at_event", "orbits_at_event"]


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
    chosen, _ = orbits_at_event(branch, event, family)
    if family in chosen or len(chosen) == 1:
        return chosen.get(family) or next(iter(chosen.values()))
    every, reasons = (chosen, []) if chosen else orbits_at_event(branch, event)
    listed = ", ".join(f"{name},{id}" for id in every)
    if chosen:
        raise AmbiguousName(f"{len(chosen)} families begin at {name}; choose one of {listed}")
    why = f"expected one of {listed}" if listed else "; ".join(reasons) or "the families there are those without impacts"
    raise NameNotFound(f"no family {family + ' ' if family else ''}begins at {name}: {why}")


def orbits_at_event(branch: Branch, event: BranchEvent, family: str = "") -> tuple[dict[str, Orbit], list[str]]:
    """An orbit of each family that begins at an event, or crosses there, next to it, and why there are no others where an impact grazes.

    Only families are solved whose ids begin with `family`, or have its ends and sequence. Keys are the beginnings of the ids, or the ids
    where the hash is asked for or tells two apart.
    """

    def fits(ends: Ends, sequence: ImpactSequence) -> bool:
        beginning = id_without_hash(branch.system, ends, sequence)
        return beginning.startswith(family) or family.startswith(f"{beginning}:")

    reasons: list[str] = []
    hashed = family.count(":") == 2
    if event.type == "GR":
        y, rising = branch.orbit(event.point).solution.y, leaves_upward(branch, event.point)
        impacts = impacts_per_period(*reversed(split_family_id(family)[:2])) if hashed else 0
        met = meetings_at(branch.problem, y, rising, impacts=impacts, accept=lambda alpha, choice: fits(choice.ends, choice.sequence))
        found = [(item.beside.problem, item.beside.y) for item in met if item.beside is not None]
        reasons = list(dict.fromkeys(item.reason for item in met if item.beside is None))
    else:
        found = [(item.problem, item.step.y) for item in emanating_families(branch, event)]
    # From some impacts of a period a run gets stuck: a family without a reversal begins where a build begins it.
    begun = [canonical_orbit(*item) if item[0].periodic else item for item in found if fits(item[0].ends, item[0].sequence)]
    orbits = [Orbit(problem, problem.solve(y, energy=problem.energy(y))) for problem, y in begun]
    ids = [id_without_hash(branch.system, orbit.ends, orbit.problem.sequence) for orbit in orbits]
    if len(set(ids)) < len(ids) or hashed:  # the hash tells them apart, or is asked for
        ids = [follow_family(orbit.problem, orbit.solution.y, points=1).id for orbit in orbits]
    return {id: orbit for id, orbit in zip(ids, orbits, strict=True) if id.startswith(family)}, reasons


def id_without_hash(system: ImpactSystem, ends: Ends, sequence: ImpactSequence) -> str:
    """The beginning of a family's id: canonical ends and sequence."""
    sequence, ends = canonical_sequence(tuple(sequence), ends, odd_symmetry=system.has_odd_symmetry)
    return f"{format_ends(ends)}:{''.join(sequence)}"
