"""Whether a catalogue is what it says: every checksum, every point, every edge. Nothing is repaired."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from branches.catalogue.closures import distance, unknowns_of
from branches.catalogue.errors import CatalogueDamaged, translated
from branches.catalogue.rows import EDGE_COLUMNS, NODE_COLUMNS, Edge, Node
from branches.words import parse_word
from bvp.multipoint import MultipointProblem, Solution

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue.rows import EventOrbit
    from branches.catalogue.store import Catalogue
    from branches.events import BranchEvent

__all__ = ["Failure", "check"]

Row = TypeVar("Row")

RESIDUAL = 1e-12
"""Largest residual of a point, scaled by its state, and largest drift of its energy, relatively."""

CLOSURE = 1e-10
"""Largest residual of an edge's orbit in the problems of its two families."""

SAME = 1e-8
"""How far, relatively, the same orbit may be apart where it was located twice."""

TOUCH = 1e-8
"""How far an orbit at a located grazing may be beyond it: clearance, speed relative to sqrt(2 h), flight time."""


class Failure(NamedTuple):
    """What fails, where: the id of a family, or the two ends of an edge; and in which way."""

    where: str
    text: str


def check(catalogue: Catalogue, on_family: Callable[[int], object] | None = None) -> tuple[dict[str, int], list[Failure]]:
    """Look at everything that a catalogue holds.

    Parameters
    ----------
    catalogue : Catalogue
    on_family : callable, optional
        Called with the number of families that were looked at so far.

    Returns
    -------
    counts : dict
        How many families, points, events and edges were looked at.
    failures : list of Failure
        Empty where everything holds.
    """
    counts = {"families": 0, "points": 0, "events": 0, "edges": 0}
    failures = list(_file(catalogue))
    kept: dict[str, _Kept] = {}
    try:
        ids = [id for (id,) in catalogue._select("families", ("id",), "ORDER BY id")]
    except CatalogueDamaged as damage:
        return counts, [*failures, Failure("families", str(damage))]
    for id in ids:
        try:
            branch = catalogue.branch(id)
        except ValueError as damage:
            failures.append(Failure(id, str(damage)))
            continue
        kept[id] = _Kept(branch.ends, branch.word, branch.events)
        failures += (Failure(id, text) for text in _family(branch))
        followed = branch.whole.ids[0]
        if followed != id:
            failures.append(Failure(id, f"its points and ends give the id {followed}"))
        counts["families"] += 1
        counts["points"] += len(branch)
        counts["events"] += len(branch.events)
        if on_family is not None:
            on_family(counts["families"])
    edges, damaged = _each(catalogue, "edges", EDGE_COLUMNS, Edge.read)
    nodes, more = _each(catalogue, "nodes", NODE_COLUMNS, Node.read)
    for edge in edges:
        counts["edges"] += 1
        where = f"{edge.source} {edge.source_event or edge.type} > {edge.target}"
        failures += (Failure(where, text) for text in _edge(catalogue, edge, kept, {node.id for node in nodes}))
    return counts, [*failures, *damaged, *more]


def _each(
    catalogue: Catalogue, table: str, columns: tuple[str, ...], read: Callable[[tuple[Any, ...]], Row]
) -> tuple[list[Row], list[Failure]]:
    """The rows of a table that fit their checksums, and what is wrong with the others."""
    rows: list[Row] = []
    failures = []
    try:
        found = catalogue._select(table, columns, "ORDER BY 1, 2")
    except CatalogueDamaged as damage:
        return rows, [Failure(table, str(damage))]
    for values in found:
        where = " ".join(str(value) for value in values[:2])
        try:
            rows.append(read(catalogue._checked(values, f"the row {where} of {table}")))
        except ValueError as damage:
            failures.append(Failure(where, str(damage)))
    return rows, failures


def _file(catalogue: Catalogue) -> Iterator[Failure]:
    """The pages of the file, and the tables that hold no families."""
    try:
        with translated(catalogue.path):
            told = [text for (text,) in catalogue._connection.execute("PRAGMA quick_check(8)")]
            if told != ["ok"]:
                yield Failure("file", "; ".join(told))
            stray = catalogue._connection.execute(
                "SELECT count(*) FROM points p LEFT JOIN families f ON p.family = f.number"
                " WHERE f.number IS NULL OR p.number < f.first_point OR p.number >= f.first_point + f.points"
            ).fetchone()[0]
            if stray:
                yield Failure("points", f"{stray} points belong to no family")
        _ = catalogue.scene, catalogue.provenance
        yield from _counts(catalogue)
        yield from (Failure(table, text) for table, text in catalogue.damaged_work())
    except CatalogueDamaged as damage:
        yield Failure("file", str(damage))


def _counts(catalogue: Catalogue) -> Iterator[Failure]:
    """Tables that have more or fewer rows than they were given."""
    with translated(catalogue.path):
        catalogue._connection.execute("SAVEPOINT counts")  # of one moment, also where another process writes
        try:
            given = catalogue._rows()
            there = {table: catalogue._connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0] for table in given}
        finally:
            catalogue._connection.execute("RELEASE counts")
    for table, count in there.items():
        if count != given[table]:
            yield Failure(table, f"the table {table} has {count} rows, {given[table]} were kept")


# -- points -------------------------------------------------------------------------------------------------------------------


def _family(branch: Branch) -> Iterator[str]:
    """What fails among the points and events of a family; of many points of one kind the first is told, and how many more."""
    grazing = {event.point for event in branch.events if event.type == "GR"}
    told: dict[str, list[str]] = {}
    for i in range(len(branch)):
        for kind, text in _point(branch, i, i in grazing):
            told.setdefault(kind, []).append(f"point {i}, h = {branch.points['h'][i]:.8g}: {text}")
    for texts in told.values():
        yield texts[0] + (f" (and {len(texts) - 1} more points)" if len(texts) > 1 else "")
    if not (np.diff(branch.points["arclength"]) >= 0.0).all():
        yield "its points are not in order of arclength"
    for event in branch.events:
        if not 0 <= event.point < len(branch):
            yield f"event {event.id} is at point {event.point}, which does not exist"
        elif event.h != branch.points["h"][event.point] or event.alpha != branch.points["alpha"][event.point]:
            yield f"event {event.id} is not at its point {event.point}"


def _point(branch: Branch, i: int, grazing: bool) -> Iterator[tuple[str, str]]:
    """What fails at a point, as (kind, words)."""
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
    drift = 0.5 * (states * states) @ problem.segment.weights / h - 1.0
    if not np.max(np.abs(drift)) <= RESIDUAL:
        yield "drift", f"its energy changes by {np.max(np.abs(drift)):.1e} of itself along the orbit"
    least = -TOUCH if grazing else 0.0
    for kind, value, scale in (
        ("clearance", found["clearance"], 1.0),
        ("speed", found["speed"], np.sqrt(2.0 * h)),
        ("flight", found["flight"], 1.0),
    ):
        if not value >= least * scale:
            words = {"clearance": "a flight pierces a stop by", "speed": "an impact has the speed", "flight": "a flight takes the time"}
            yield kind, f"it is inadmissible: {words[kind]} {abs(value) if kind == 'clearance' else value:.1e}"
    if found["gave_up"] == 1.0:
        yield "admissibility", "whether it is admissible could not be decided"


def _evaluate(problem: MultipointProblem, y: np.ndarray, residual: float = RESIDUAL) -> Solution | float:
    """The orbit as it stands, or its residual where that is too large.

    Only start and flight times are kept. Where the nodes of a long unstable segment have lost digits by propagation, those that fit
    best are taken: start and flight times stay.
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


class _Kept(NamedTuple):
    """What the edges of a family are compared with."""

    ends: tuple[str, str]
    word: str
    events: tuple[BranchEvent, ...]


def _edge(catalogue: Catalogue, edge: Edge, kept: dict[str, _Kept], nodes: set[str]) -> Iterator[str]:
    """What fails at an edge."""
    solved: list[tuple[MultipointProblem, np.ndarray]] = []
    sides = (("source", edge.source, edge.source_event, edge.source_orbit), ("target", edge.target, edge.target_event, edge.target_orbit))
    for side, id, event, orbit in sides:
        family = kept.get(id or "")
        if family is None and id not in nodes:
            yield f"its {side} {id} is not in the catalogue, or is damaged"
            continue
        if family is not None and (event or side == "source"):
            yield from _event(family, side, event, edge, kept.get(edge.source))
        if orbit is None:
            if family is not None:
                yield f"it has no orbit of its {side}, so it cannot be seen to close"
            continue
        if family is not None and (orbit.ends, orbit.word) != (family.ends, family.word):
            yield f"the orbit of its {side} is one of {'-'.join(orbit.ends)}:{orbit.word}, not of that family"
        try:
            problem = MultipointProblem(catalogue.system, orbit.ends, parse_word(orbit.word))
            y = unknowns_of(problem, orbit)
        except ValueError as error:
            yield f"the orbit of its {side} cannot be read: {error}"
            continue
        yield from _solves(problem, y, side, orbit, edge)
        solved.append((problem, y))
    if len(solved) == 2:
        apart = distance(*solved[0], _start(*solved[1]))
        if not apart <= SAME:
            yield f"its two orbits are not the same: they are {apart:.1e} of their size apart"


def _solves(problem: MultipointProblem, y: np.ndarray, side: str, orbit: EventOrbit, edge: Edge) -> Iterator[str]:
    found = _evaluate(problem, y)
    residual = found if isinstance(found, float) else found["residual"]
    if not residual <= CLOSURE:
        yield f"its orbit does not solve the problem of its {side}: the residual is {residual:.1e}, expected at most {CLOSURE:.0e}"
    if not abs(problem.energy(y) / edge.h - 1.0) <= CLOSURE:
        yield f"the orbit of its {side} has h = {problem.energy(y):.17g}, the edge h = {edge.h:.17g}"


def _event(family: _Kept, side: str, id: str, edge: Edge, source: _Kept | None) -> Iterator[str]:
    """Whether the edge, which is where its source has its event, is at its event on a family."""
    event = next((event for event in family.events if event.id == id), None)
    if event is None:
        yield f"its {side} has no event {id!r}"
        return
    # log h and log alpha are two of the coordinates of the arclength, so that its error bar bounds theirs.
    own = [] if source is None else [other for other in source.events if other.id == edge.source_event]
    slack = max(SAME, *(known.bracket[1] - known.bracket[0] for known in (event, *own)))
    if not (abs(event.h / edge.h - 1.0) <= slack and (side == "target" or abs(event.alpha / edge.alpha - 1.0) <= slack)):
        yield f"it is at h = {edge.h:.12g}, event {id} of its {side} at h = {event.h:.12g}"


def _start(problem: MultipointProblem, y: np.ndarray) -> np.ndarray:
    return problem.modes.to_state @ problem.start(y)
