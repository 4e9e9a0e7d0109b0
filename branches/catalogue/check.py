"""Verification of a catalogue: every checksum, every point, every edge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from branches.between_events import missed_events
from branches.branch import Branch
from branches.catalogue import responses
from branches.catalogue.curves import CurveRow, curve_of_row
from branches.catalogue.database import CatalogueDamaged
from branches.catalogue.kept_curves import curve_failures, first_of_each
from branches.catalogue.members import distances_from_orbit, unknowns_of
from branches.catalogue.rows import Edge, EventOrbit, Node
from branches.catalogue.store import CatalogueStore
from branches.events import BranchEvent
from branches.forced.branch import ForcedBranch
from branches.sequences import parse_sequence
from bvp.forced import ForcedProblem
from bvp.multipoint import MultipointProblem, Solution
from bvp.smooth_flights import modal_energies

__all__ = ["Failure", "check_catalogue"]

RESIDUAL = 1e-12
"""Largest residual of a point, scaled by its state, and largest drift of its energy, relatively."""

CLOSURE = 1e-10
"""Largest residual of an edge's orbit in the problems of its two families."""

SAME = 1e-8
"""Largest relative distance of an orbit that was located twice from itself."""

TOUCH = 1e-8
"""How far an orbit at a located grazing may be beyond it: clearance, speed relative to sqrt(2 h), flight time."""


class Failure(NamedTuple):
    """A failure. where: the id of a family, the two ends of an edge, or a table. text: what is wrong."""

    where: str
    text: str


def check_catalogue(catalogue: CatalogueStore, on_family: Callable[[int], object] | None = None) -> tuple[dict[str, int], list[Failure]]:
    """Verify everything in a catalogue. Nothing is repaired.

    Parameters
    ----------
    catalogue : CatalogueStore
    on_family : callable, optional
        Called with the number of verified families.

    Returns
    -------
    counts : dict
        How many families, points, events, edges and curves were verified, and how many missed events are ``hidden`` by rounding.
    failures : list of Failure
        Empty if everything holds.
    """
    counts = {"families": 0, "points": 0, "events": 0, "edges": 0, "curves": 0, "hidden": 0}
    failures: list[Failure] = []
    _file(catalogue, failures)
    intact: dict[str, _Family] = {}
    try:
        ids = [id for (id,) in catalogue._select("SELECT id FROM families ORDER BY id")]
    except CatalogueDamaged as damage:
        return counts, [*failures, Failure("families", str(damage))]
    for id in ids:
        try:
            branch = catalogue.branch(id)
        except ValueError as damage:
            failures.append(Failure(id, str(damage)))
            continue
        if isinstance(branch, ForcedBranch):
            intact[id] = _Family((), "", catalogue.events(id), branch.problem)
            failures += (Failure(id, text) for text in responses.response_failures(branch))
        else:
            intact[id] = _Family(branch.ends, branch.sequence, branch.events)
            failures += (Failure(id, text) for text in _family(branch))
            if all(0 <= event.point < len(branch) for event in branch.events):
                missed = missed_events(branch)
                failures += (Failure(id, f"an event ({' or '.join(m.types)}) is missed {m.text}") for m in missed if not m.hidden)
                counts["hidden"] += sum(m.hidden for m in missed)
        followed = branch.full_family.ids
        if id != followed[0] and not (isinstance(branch, ForcedBranch) and id in followed):
            failures.append(Failure(id, f"its points and ends give the id {followed[0]}"))
        counts["families"] += 1
        counts["points"] += len(branch)
        counts["events"] += len(branch.events)
        if on_family is not None:
            on_family(counts["families"])
    nodes = {Node.of(row).id for row in _intact(catalogue, "nodes", failures)}
    with _recording(failures, "edges"):
        found, expected = catalogue.counts()["edges"], catalogue.recorded("edges")
        if found != expected:
            failures.append(Failure("edges", f"the catalogue has {found} edges, expected {expected}"))
    for edge in map(Edge.of, _intact(catalogue, "edges", failures)):
        counts["edges"] += 1
        where = f"{edge.source} {edge.source_event or edge.type} > {edge.target}"
        failures += (Failure(where, text) for text in _edge(catalogue, edge, intact, nodes))
    counts["curves"] = _curves(catalogue, failures)
    return counts, failures


def _curves(catalogue: CatalogueStore, failures: list[Failure]) -> int:
    """Verify the curves in the plane of two parameters; the number of them."""
    rows = _intact(catalogue, "curves", failures) if catalogue._has_curves else []
    with _recording(failures, "curves"):
        found, expected = len(catalogue._select("SELECT id FROM curves")) if catalogue._has_curves else 0, catalogue.recorded("curves")
        if found != expected:
            failures.append(Failure("curves", f"the catalogue has {found} curves, expected {expected}"))
    for row in map(CurveRow._make, rows):
        with _recording(failures, row.id):
            failures += (Failure(row.id, text) for text in curve_failures(curve_of_row(catalogue, row), row))
    return len(rows)


@contextmanager
def _recording(failures: list[Failure], where: str) -> Iterator[None]:
    """Within the block, damage is a failure, and the block ends."""
    try:
        yield
    except CatalogueDamaged as damage:
        failures.append(Failure(where, str(damage)))


def _file(catalogue: CatalogueStore, failures: list[Failure]) -> None:
    """Verify the pages of the file, and the tables that hold neither families nor the graph."""
    with _recording(failures, "file"):
        texts = [text for (text,) in catalogue._select("PRAGMA integrity_check(8)")]
        if texts != ["ok"]:
            failures.append(Failure("file", "; ".join(texts)))
        stray = Counter(table for table, *_ in catalogue._select("PRAGMA foreign_key_check"))
        failures += (Failure(table, f"{count} rows of the table {table} belong to no family") for table, count in stray.items())
        _ = catalogue.scene, catalogue.provenance
    for table in ("work", "progress"):
        for key, text in _intact(catalogue, table, failures):
            with _recording(failures, table):
                catalogue._parsed(table, key, text)


def _intact(catalogue: CatalogueStore, table: str, failures: list[Failure]) -> list[tuple[Any, ...]]:
    """The rows of a table that fit their checksums. The others are failures."""
    rows = []
    with _recording(failures, table):
        for row in catalogue._select(f"SELECT * FROM {table}"):
            with _recording(failures, table):
                rows.append(catalogue._checked(table, row))
    return rows


# -- points -------------------------------------------------------------------------------------------------------------------


def _family(branch: Branch) -> Iterator[str]:
    """Failures among the points and events of a family. Of several points with the same kind of failure the first is reported."""
    grazing = {event.point for event in branch.events if event.type == "GR"}
    found: dict[str, list[str]] = {}
    for i in range(len(branch)):
        for kind, text in _point(branch, i, i in grazing):
            found.setdefault(kind, []).append(f"point {i}, h = {branch.points['h'][i]:.8g}: {text}")
    yield from first_of_each(found)
    if not (np.diff(branch.points["arclength"]) >= 0.0).all():
        yield "its points are not in order of arclength"
    for event in branch.events:
        if not 0 <= event.point < len(branch):
            yield f"event {event.id} is at point {event.point}, which does not exist"
        elif event.h != branch.points["h"][event.point] or event.alpha != branch.points["alpha"][event.point]:
            yield f"event {event.id} is not at its point {event.point}"


def _point(branch: Branch, i: int, grazing: bool) -> Iterator[tuple[str, str]]:
    """Failures at a point, as (kind, text)."""
    problem, columns = branch.problem, branch.points
    found = _evaluate(problem, branch.unknowns(i))
    h, alpha = float(columns["h"][i]), float(columns["alpha"][i])
    if isinstance(found, float):
        yield "residual", f"its residual is {found:.1e}, expected below {RESIDUAL:.0e}"
        return
    for name, value, expected in (("energy", found["energy"], h), ("quarter period", found["quarter_period"], alpha)):
        if not abs(value - expected) <= RESIDUAL * expected:
            yield name, f"its states have the {name} {value:.17g}, its column says {expected:.17g}"
    y = found.y
    states = np.concatenate([problem.nodes(y), found.ends])
    drift = modal_energies(problem.system, states) / h - 1.0
    if not np.max(np.abs(drift)) <= RESIDUAL:
        yield "drift", f"its energy changes by {np.max(np.abs(drift)):.1e} of itself along the orbit"
    least = -TOUCH if grazing else 0.0
    for kind, value, scale in (
        ("clearance", found["clearance"], 1.0),
        ("speed", found["speed"], np.sqrt(2.0 * h)),
        ("flight", found["flight"], 1.0),
    ):
        if not value >= least * scale:
            texts = {"clearance": "a flight pierces a stop by", "speed": "an impact has the speed", "flight": "a flight takes the time"}
            yield kind, f"it is inadmissible: {texts[kind]} {abs(value) if kind == 'clearance' else value:.1e}"
    if found["gave_up"] == 1.0:
        yield "admissibility", "whether it is admissible could not be decided"


def _evaluate(problem: MultipointProblem, y: np.ndarray) -> Solution | float:
    """The orbit without corrections, or its residual if that is too large.

    Only start and flight times are stored. The nodes of a long unstable segment can lose digits by propagation. Then the nodes that fit
    best are used; start and flight times stay.
    """
    zero = np.zeros(2 * problem.unknowns)
    first, step = problem.parameters, problem.size + 1
    columns = [j for j in range(first, problem.unknowns) if (j - first) % step and j < first + problem.inner * step + 1]
    size = float("nan")
    for attempt in range(4):
        found = problem.step(y, zero, 0.0, maximum=0)
        if found is not None:
            return found
        values = problem.residual(y)
        size = float(np.max(np.abs(values)))
        if attempt == 3 or not columns or not np.isfinite(size):
            break
        matrix = problem.jacobian(y)[:, columns]
        scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        y = y.copy()
        y[columns] -= np.linalg.lstsq(matrix / scale, values, rcond=None)[0] / scale
    return size


# -- edges --------------------------------------------------------------------------------------------------------------------


class _Family(NamedTuple):
    """The data of a family that its edges are compared with."""

    ends: tuple[str, ...]
    sequence: str
    events: tuple[BranchEvent, ...]
    problem: ForcedProblem | None = None


def _edge(catalogue: CatalogueStore, edge: Edge, families: dict[str, _Family], nodes: set[str]) -> Iterator[str]:
    """Failures of an edge."""
    solved: list[tuple[MultipointProblem, np.ndarray]] = []
    forced: list[tuple[ForcedProblem, EventOrbit]] = []
    sides = (("source", edge.source, edge.source_event, edge.source_orbit), ("target", edge.target, edge.target_event, edge.target_orbit))
    for side, id, event, orbit in sides:
        family = families.get(id or "")
        if family is None and id not in nodes:
            yield f"its {side} {id} is not in the catalogue, or is damaged"
            continue
        if family is not None and (event or side == "source"):
            yield from _event(family, side, event, edge, families.get(edge.source))
        if orbit is None:
            if family is not None:
                yield f"it has no orbit of its {side}, so it cannot be seen to close"
            continue
        if family is not None and family.problem is not None:
            forced.append((family.problem, orbit))
            continue
        if family is not None and (orbit.ends, orbit.sequence) != (family.ends, family.sequence):
            yield f"the orbit of its {side} is one of {'-'.join(orbit.ends)}:{orbit.sequence}, not of that family"
        try:
            problem = MultipointProblem(catalogue.system, orbit.ends, parse_sequence(orbit.sequence))
            y = unknowns_of(problem, orbit)
        except ValueError as error:
            yield f"the orbit of its {side} cannot be read: {error}"
            continue
        yield from _solves(problem, y, side, orbit, edge)
        solved.append((problem, y))
    if len(forced) == 2:
        yield from responses.meeting_failures(*forced)
    if len(solved) == 2:
        problem, y = solved[1]
        apart = distances_from_orbit(*solved[0], [problem.modes.to_state @ problem.start(y)])[0]
        if not apart <= SAME:
            yield f"its two orbits are not the same: they are {apart:.1e} of their size apart"


def _solves(problem: MultipointProblem, y: np.ndarray, side: str, orbit: EventOrbit, edge: Edge) -> Iterator[str]:
    found = _evaluate(problem, y)
    residual = found if isinstance(found, float) else found["residual"]
    if not residual <= CLOSURE:
        yield f"its orbit does not solve the problem of its {side}: the residual is {residual:.1e}, expected at most {CLOSURE:.0e}"
    if not abs(problem.energy(y) / edge.h - 1.0) <= CLOSURE:
        yield f"the orbit of its {side} has h = {problem.energy(y):.17g}, the edge h = {edge.h:.17g}"


def _event(family: _Family, side: str, id: str, edge: Edge, source: _Family | None) -> Iterator[str]:
    """Differences between an edge and its event on one of its two families. The edge stores the place of the source's event."""
    event = next((event for event in family.events if event.id == id), None)
    if event is None:
        yield f"its {side} has no event {id!r}"
        return
    # log h and log alpha are two of the coordinates of the arclength, so that its error bar bounds theirs.
    own = [] if source is None else [other for other in source.events if other.id == edge.source_event]
    slack = max(SAME, *(known.bracket[1] - known.bracket[0] for known in (event, *own)))
    # A parameter can be zero; a period that was doubled is that of the source.
    size = abs(edge.h) if family.problem is None else max(abs(edge.h), 1.0)
    if not (abs(event.h - edge.h) <= slack * size and (side == "target" or abs(event.alpha / edge.alpha - 1.0) <= slack)):
        yield f"it is at h = {edge.h:.12g}, event {id} of its {side} at h = {event.h:.12g}"
