"""Families of orbits in a parameter in a catalogue: their rows, the branch of a row, whether one contains another, and their checks.

They have the rows of conservative families. The parameter and the period take the places of the energy and the quarter period, and the
largest modulus of the multipliers that of tau.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.admissible import unphysical
from branches.catalogue.packing import PackedFamily, encode, label_intervals, queried_rows, stability_intervals, stable_fraction
from branches.catalogue.rows import EventOrbit, FamilyRow, compact_json, event_values
from branches.events import BranchEvent, Ended
from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.closing import largest_residual
from branches.forced.identity import impact_flux, invariants, window_of
from branches.forced.record import problem_from, problem_record, range_from
from branches.forced.tracing import follow_response, primitive_branch
from branches.released.branch import branch_in_parameter
from branches.released.family import PlacedSolution, placed
from branches.sequences import impacts_per_period, parse_sequence
from branches.tables import plain
from bvp.forced import ForcedProblem
from bvp.multipoint import NotConverged, Solution
from bvp.released import ReleasedProblem

if TYPE_CHECKING:
    from branches.catalogue.store import CatalogueStore

__all__ = [
    "are_on", "contains", "joined_family", "kept_as", "kept_branch", "meeting_failures", "orbit_of", "pack_response", "plain_events",
    "problem_at", "response_failures", "system_of", "unpack_response",
]  # fmt: skip

RESIDUAL = 1e-11
"""Largest residual of a stored point, in units of its unknowns."""

NEAR = 0.1
"""Distance from the chord between two points, relative to its length, within which an orbit lies on a family. Steps turn by a twentieth."""

_FLOOR = 1e-7
"""Smallest distance that counts, in units of the curve's size: orbits are located to 1e-10."""

_MEETS = 0.05
"""Largest relative difference of the orbits on both sides of an event: the first orbit of the new family is a step away from it."""

_ROUNDING = 1e-12
"""Displacement, in units of arclength, that is rounding."""


def system_of(problem: ForcedProblem) -> dict[str, Any]:
    """The system of a family as plain data, with its values of all parameters."""
    described: dict[str, Any] = plain(problem.parametric.replaced(problem.values).describe())
    return described


def pack_response(branch: ForcedBranch) -> PackedFamily:
    """Pack a family of orbits in a parameter into the rows of a catalogue."""
    problem = branch.problem
    count = len(branch)
    largest = branch.largest_multiplier
    columns: dict[str, np.ndarray] = {
        "h": branch.parameter, "alpha": branch.periods, "arclength": np.asarray(branch.arclength, float), "tau": largest,
        "stable": branch.stable.astype(np.int8), "label": np.full(count, ""), "unknowns": branch.unknowns, "tangents": branch.tangents,
        "residual": np.asarray(branch.residual, float),
    }  # fmt: skip
    events = plain_events(branch)
    arrays, layout = encode(columns, problem)
    stability = stability_intervals(columns, events)
    closure, sequence, _ = branch.id.split(":")
    extra = [
        [event.note, event.angle, [list(one) for one in event.neighbours], list(event.symmetric), event.coefficient, event.criticality]
        for event in branch.events
    ]
    response = {**problem_record(problem), "range": plain(branch.interval), "events": extra}
    ended = [(str(end.reason), end.text) for end in branch.ended]
    details = {"labels": label_intervals(columns, ()), "stability": stability, "ended": ended, "layout": layout, "response": response}
    row = FamilyRow(
        0, branch.id, "", closure, sequence, _impacts(problem),
        float(branch.parameter.min()), float(branch.parameter.max()), float(branch.periods.min()), float(branch.periods.max()),
        count, len(events), int(branch.start), stable_fraction(stability), "", compact_json(details),
    )  # fmt: skip
    return PackedFamily(system_of(problem), row, queried_rows(columns), arrays, [event_values(event) for event in events])


def _impacts(problem: ForcedProblem) -> float:
    """Impacts in a period of the loads; of free orbits in one of their own."""
    if isinstance(problem, ReleasedProblem):
        return float(impacts_per_period(tuple(problem.sequence), problem.ends))
    return len(problem.sequence) * (2.0 if problem.half else 1.0) / problem.load_periods


def plain_events(branch: ForcedBranch) -> tuple[BranchEvent, ...]:
    """The events of a forced family as events of any family: the parameter in place of h, the period in place of alpha."""
    found = []
    for event in branch.events:
        behind = int(branch.stable[event.point + 1]) if event.point + 1 < len(branch) else -1
        found.append(
            BranchEvent(
                event.id, event.type, event.point, event.point - branch.start, float(branch.parameter[event.point]),
                float(branch.periods[event.point]), event.arclength, event.status, event.bracket, event.residual, "", event.stop, None,
                None, event.remark or None, None if behind < 0 else bool(behind), event.multiplier,
            )
        )  # fmt: skip
    return tuple(found)


def kept_as(family: PackedFamily, id: str) -> PackedFamily:
    """The rows of a family under another of its ids."""
    return replace(family, row=family.row._replace(id=id))


def unpack_response(
    problem: ForcedProblem, row: FamilyRow, columns: Mapping[str, np.ndarray], events: tuple[BranchEvent, ...]
) -> ForcedBranch:
    """The branch of a stored family, bit for bit."""
    given = row.response
    unknowns = columns["unknowns"]
    restored = []
    for event, (note, angle, neighbours, *more) in zip(events, given["events"], strict=True):
        restored.append(
            ForcedEvent(
                event.id, event.type, event.point, problem.known_values(unknowns[event.point]), event.arclength, event.status,
                event.bracket, event.residual, event.stop, angle, note, event.multiplier,
                tuple((sequence, persists) for sequence, persists in neighbours), tuple(more[0] if more else ()), *more[1:],
            )
        )  # fmt: skip
    first, last = (Ended(*ended) for ended in row.ended)
    branch = branch_in_parameter(
        problem, unknowns, columns["tangents"], columns["arclength"], columns["residual"], tuple(restored), (first, last), row.start,
        range_from(given["range"]),
    )  # fmt: skip
    return branch.known_as(row.id)


def contains(branch: ForcedBranch, other: ForcedBranch, places: int = 9) -> bool:
    """Whether a branch has the orbits of another one of its family, at both ends and between them.

    Orbits are compared by numbers that no image of them changes (`branches.forced.identity.invariants`)."""
    last = len(other) - 1
    chosen = sorted({round(k * last / (places - 1)) for k in range(places)})
    along = np.array([invariants(branch.problem, y) for y in branch.unknowns])
    return bool(are_on(along, np.array([invariants(other.problem, other.unknowns[i]) for i in chosen])).all())


def are_on(curve: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Whether each of some places (M, k) is on the line through the points of a curve (N, k), (M,)."""
    unit = np.maximum(np.ptp(curve, axis=0), 1e-9 * np.abs(curve).max(axis=0))
    unit = np.where(unit > 0.0, unit, 1.0)
    curve = curve / unit
    chords = np.diff(curve, axis=0)
    lengths = np.maximum(np.linalg.norm(chords, axis=1), 1e-150)
    found = []
    for place in places / unit:
        away = place - curve
        found.append(bool(np.linalg.norm(away, axis=1).min() <= _FLOOR))
        if not found[-1] and len(chords):
            parts = np.clip(np.sum(away[:-1] * chords, axis=1) / lengths**2, 0.0, 1.0)
            found[-1] = bool((np.linalg.norm(away[:-1] - parts[:, None] * chords, axis=1) <= NEAR * lengths + _FLOOR).any())
    return np.array(found)


def orbit_of(problem: ForcedProblem, y: np.ndarray) -> EventOrbit:
    """An orbit as an edge stores it: all unknowns of its problem."""
    if isinstance(problem, ReleasedProblem):
        return EventOrbit(problem.ends, "".join(problem.sequence), tuple(map(float, y)), ())
    closure = f"{'half' if problem.half else 'full'}-{problem.load_periods}"
    return EventOrbit((closure, " ".join(problem.sequence)), "".join(problem.sequence), tuple(map(float, y)), ())


def problem_at(beside: ForcedProblem, orbit: EventOrbit) -> ForcedProblem:
    """The problem of an orbit that `orbit_of` gave, in the parameters of another problem."""
    given = problem_record(beside)
    if isinstance(beside, ReleasedProblem):
        # The unknowns of free orbits do not name their impacts one by one.
        given |= {"ends": orbit.ends, "solved": parse_sequence(orbit.sequence)}
    else:
        closure, load_periods = orbit.ends[0].split("-")
        given |= {"solved": orbit.ends[1].split(), "half": closure == "half", "load_periods": int(load_periods)}
    return problem_from(beside.parametric, given)


def response_failures(branch: ForcedBranch) -> Iterator[str]:
    """What does not hold of a stored family. Of several points with the same failure the first is reported."""
    problem = branch.problem
    grazing = {event.point for event in branch.events if event.type in ("GR", "LB", "EP")}
    found: dict[str, list[str]] = {}
    for i, y in enumerate(branch.unknowns):
        for kind, text in _point(problem, y, i in grazing):
            found.setdefault(kind, []).append(f"point {i}, {branch.name} = {branch.parameter[i]:.8g}: {text}")
    for texts in found.values():
        yield texts[0] + (f" (and {len(texts) - 1} more points)" if len(texts) > 1 else "")
    if not (np.diff(branch.arclength) >= 0.0).all():
        yield "its points are not in order of arclength"


def _point(problem: ForcedProblem, y: np.ndarray, grazing: bool) -> Iterator[tuple[str, str]]:
    residual = largest_residual(problem, y)
    if not residual <= RESIDUAL:
        yield "residual", f"its residual is {residual:.1e}, expected below {RESIDUAL:.0e}"
        return
    if grazing:
        return
    solution = placed(problem, y) if isinstance(problem, ReleasedProblem) else _as_it_is(problem, y)
    own = solution.problem if isinstance(solution, PlacedSolution) else problem
    beyond = None if solution is None else unphysical(own, solution)
    if beyond is not None:
        yield "admissibility", f"it is inadmissible: {beyond}"


def _as_it_is(problem: ForcedProblem, y: np.ndarray) -> Solution | None:
    """The orbit without corrections; None if its residual is too large for that."""
    return problem.step(y, np.zeros(2 * problem.unknowns), 0.0, maximum=0)


def meeting_failures(here: tuple[ForcedProblem, EventOrbit], there: tuple[ForcedProblem, EventOrbit]) -> Iterator[str]:
    """What does not hold of the two orbits of an edge: each solves its equations, and both are one within the first step away from the
    event."""
    measures = []
    for side, (problem, orbit) in (("source", here), ("target", there)):
        y = np.array(orbit.start)
        if len(y) != problem.unknowns or "".join(problem.sequence) != orbit.sequence:
            yield f"the orbit of its {side} is not one of that family"
            return
        residual = largest_residual(problem, y)
        if not residual <= RESIDUAL:
            yield f"its orbit does not solve the problem of its {side}: the residual is {residual:.1e}, expected at most {RESIDUAL:.0e}"
        measures.append(_measures(problem, y))
    for one, other in zip(*measures, strict=True):
        # An orbit can rest at its stop, at zero: then both numbers are rounding.
        if not abs(one - other) <= _MEETS * max(abs(one), abs(other), measures[0][1] * 1e-3, _ROUNDING * float(here[0].units[0])):
            yield f"its two orbits are not the same: {one:.6g} and {other:.6g} differ"
            return


def _measures(problem: ForcedProblem, y: np.ndarray) -> tuple[float, float]:
    """Numbers that an orbit has in the unknowns of both families: the sum of the squared impact speeds over the period, and the largest
    displacement at an impact; of free orbits their energy."""
    if isinstance(problem, ReleasedProblem):
        _, period, _, energy, speed = invariants(problem, y).tolist()
        return _impacts(problem) * speed**2 / period, energy
    return impact_flux(problem, y), float(np.abs(problem.nodes(y)[:, : problem.degrees_of_freedom]).max())


def kept_branch(catalogue: CatalogueStore, branch: ForcedBranch) -> ForcedBranch:
    """A branch as a catalogue keeps it: of the primitive orbit, of the catalogue's system, and with the id that the family has there.

    Raises
    ------
    CatalogueError
        For a branch of another system, or in other parameters.
    """
    given, branch = branch, primitive_branch(branch)
    catalogue.require_system(system_of(branch.problem))
    branch = replace(branch, problem=problem_from(catalogue.parametric, problem_record(branch.problem)))
    if window_of(branch.problem) == window_of(given.problem):
        branch.share_identity(given)
    return branch.known_as(next((id for id in branch.full_family.ids if id in catalogue), branch.full_family.ids[0]))


def joined_family(narrow: ForcedBranch, branch: ForcedBranch) -> ForcedBranch | None:
    """The family of two branches followed so far that it has both; None where it could not be.

    The family of the narrow one is followed again, so that its unknowns are begun at the same impact."""
    low, high = (extreme(one, other) for extreme, one, other in zip((min, max), narrow.interval, branch.interval, strict=True))
    for interval in dict.fromkeys([(low, high), branch.full_family.reach((low, high))]):
        try:
            found = follow_response(narrow.problem, narrow.unknowns[narrow.start], interval).known_as(narrow.id)
        except (NotConverged, RuntimeError, ValueError):
            continue
        if contains(found, branch) and contains(found, narrow):
            return found
    return None
