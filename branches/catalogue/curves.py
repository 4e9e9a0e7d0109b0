"""Curves in the plane of two parameters in a catalogue of families in one of them: their rows, and the edges of the graph that they are.

A curve crosses the line of a catalogue, on which its families are, at *meetings*. A family of the catalogue that has the event of a
meeting is on one side of the curve there. Edges are found when they are asked for: families can be added, removed and widened.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple
from zipfile import BadZipFile

from branches.catalogue.database import CatalogueDamaged, CatalogueError
from branches.catalogue.rows import Edge, compact_json
from branches.catalogue.widening import CannotWiden, Kept

if TYPE_CHECKING:
    import numpy as np

    from branches.catalogue.store import CatalogueStore
    from branches.curves.record import BifurcationCurve
    from branches.events import BranchEvent
    from bvp.parameters import ParametricSystem
    from continuation.curves import Curve

__all__ = ["CurveEdge", "CurveRow", "curve_edges", "curve_failures", "curve_of_row", "curve_row", "find_curve", "keep_curve"]

RESIDUAL = 1e-11
"""Largest residual of a stored point, in units of its unknowns."""

CONDITION = 1e-8
"""Largest value of the condition of a curve at a stored point: a singular value, or a distance from a grazing."""

_SAME = 1e-7
"""Largest difference of a parameter from that of the families, relative to the larger one of its size and 1."""

_MATCH = 1e-6
"""Largest relative difference of a parameter, and of a period, of one event that was located twice."""

_CONSTANT = 1e-9
"""Relative change of a number along a curve that is rounding."""

_REFINEMENTS = 30

_MOST_PERIODS = 8
"""Most periods of an orbit in the one of a family that meets it at a curve."""

_BEGINS = {
    "PD": "a family of twice the period begins there",
    "SB": "families without the symmetry begin there",
    "GR": "a family with other impacts begins there",
    "BP": "another family crosses there",
}


class CurveRow(NamedTuple):
    """A curve without its points. The fields are the columns of the table.

    Attributes
    ----------
    id : str
        See `branches.curves.identity.curve_id`.
    code : str
        SN, PD, SB, NS, BP or GR.
    first, second : str
        Its two parameters.
    first_low, first_high, second_low, second_high : float
        Their ranges.
    points, events : int
        How many.
    details : str
        JSON: `curve`, all but its points, as in its file; `defaults` of the parameters of its system, which its arclength depends on; and
        `meetings`, each with the parameter and the period of the families.
    npz : bytes
        Its points: a compressed numpy file with an array for each column.
    """

    id: str
    code: str
    first: str
    second: str
    first_low: float
    first_high: float
    second_low: float
    second_high: float
    points: int
    events: int
    details: str
    npz: bytes

    @property
    def names(self) -> tuple[str, str]:
        """Its two parameters."""
        return self.first, self.second

    @property
    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Their ranges."""
        return (self.first_low, self.first_high), (self.second_low, self.second_high)

    @property
    def header(self) -> Any:
        """The curve without its points, as in its file."""
        return json.loads(self.details)["curve"]

    @property
    def meetings(self) -> list[tuple[float, float]]:
        """The parameter and the period of the families, where the curve crosses their line."""
        return [(value, period) for value, period in json.loads(self.details)["meetings"]]

    @property
    def places(self) -> list[tuple[str, float, float]]:
        """Id and both parameters of each event."""
        return [(event["id"], *(event["values"][name] for name in self.names)) for event in self.header["events"]]


class CurveEdge(NamedTuple):
    """A curve as an edge of the graph: between the families on its sides."""

    curve: CurveRow
    edge: Edge


# -- edges --------------------------------------------------------------------------------------------------------------------


def curve_edges(catalogue: CatalogueStore, id: str | None = None) -> list[CurveEdge]:
    """The curves as edges, or those at one family, in order of the curves' ids.

    An edge leads from the family whose event the curve continues to the one on the other side. That is the same family for SN and NS. If
    the other family is not in the catalogue, the edge is a loop whose note says what begins there.
    """
    found = []
    for row in catalogue.curve_rows():
        for edge in _edges_of(catalogue, row):
            if id is None or id in (edge.source, edge.target):
                found.append(CurveEdge(row, edge))
    return found


def _edges_of(catalogue: CatalogueStore, row: CurveRow) -> Iterator[Edge]:
    for value, period in row.meetings:
        slack = _MATCH * max(1.0, abs(value))
        own: dict[str, BranchEvent] = {}
        others: dict[str, str] = {}
        for family in catalogue.all_families():
            if not family.h_low - slack <= value <= family.h_high + slack:
                continue
            for event in catalogue.events(family.id):
                if event.type not in (row.code, "BP") or abs(event.h - value) > slack:
                    continue
                if event.type == row.code and math.isclose(event.alpha, period, rel_tol=_MATCH):
                    own.setdefault(family.id, event)
                elif row.code not in ("SN", "NS") and _repeats(event.alpha, period):
                    others.setdefault(family.id, event.id)
        if not own:
            continue
        source, event = min(own.items())
        targets = {id: one.id for id, one in own.items() if id != source} | {id: name for id, name in others.items() if id not in own}
        if row.code not in ("SN", "NS"):
            for edge in catalogue.edges(source):
                at, to, other = (
                    (edge.source_event, edge.target, edge.target_event) if edge.source == source else
                    (edge.target_event, edge.source, edge.source_event)
                )  # fmt: skip
                if at == event.id and to in catalogue:
                    targets.setdefault(str(to), other)
        if row.code in ("SN", "NS"):
            yield Edge(source, event.id, row.code, "curve", source, event.h, event.alpha, event.id, event.stop)
        elif not targets:
            note = _BEGINS[row.code]
            yield Edge(source, event.id, row.code, "curve", source, event.h, event.alpha, event.id, event.stop, note)
        for target, name in sorted(targets.items()):
            yield Edge(source, event.id, row.code, "curve", target, event.h, event.alpha, name, event.stop)


def _repeats(period: float, other: float) -> bool:
    """Whether one of two periods is a multiple of the other one."""
    ratio = max(period, other) / min(period, other)
    return round(ratio) <= _MOST_PERIODS and abs(ratio - round(ratio)) < _MATCH * ratio


def find_curve(catalogue: CatalogueStore, text: str) -> CurveRow | None:
    """The curve with an id, or with the beginning of one or of its hash; None if there is none.

    Raises
    ------
    CatalogueError
        If several curves have it.
    """
    rows = catalogue.curve_rows()
    exact = [row for row in rows if row.id == text]
    found = exact or [row for row in rows if len(text) >= 3 and (row.id.startswith(text) or row.id.rpartition(":")[2].startswith(text))]
    if len(found) > 1:
        raise CatalogueError(f"{text} matches {', '.join(row.id for row in found)}; expected one of them")
    return found[0] if found else None


# -- rows ---------------------------------------------------------------------------------------------------------------------


def curve_row(catalogue: CatalogueStore, curve: BifurcationCurve) -> CurveRow:
    """The row of a curve of the catalogue's system."""
    import numpy as np

    from branches.curves.files import COLUMNS, curve_header
    from branches.curves.identity import canonical_names, curve_id

    names = canonical_names(curve)
    order = [curve.names.index(name) for name in names]
    low, high = (np.array(values)[order].tolist() for values in curve.span)
    file = io.BytesIO()
    np.savez_compressed(file, **{key: getattr(curve, name) for key, name in COLUMNS.items()})
    defaults = dict(curve.plane.problem.parametric.values)
    details = {"curve": curve_header(curve), "defaults": defaults, "meetings": meetings_of(catalogue, curve)}
    return CurveRow(
        curve_id(curve), curve.code, *names, low[0], high[0], low[1], high[1], len(curve), len(curve.events), compact_json(details),
        file.getvalue(),
    )  # fmt: skip


def curve_of_row(catalogue: CatalogueStore, row: CurveRow) -> BifurcationCurve:
    """The curve of a row, bit for bit.

    Raises
    ------
    CatalogueDamaged
    """
    import numpy as np

    from branches.curves.files import COLUMNS, restored_curve

    try:
        with np.load(io.BytesIO(row.npz)) as stored:
            columns = {name: stored[key] for key, name in COLUMNS.items()}
        return restored_curve(catalogue.parametric.replaced(json.loads(row.details)["defaults"]), row.header, columns)
    except (LookupError, TypeError, ValueError, OSError, EOFError, BadZipFile) as error:
        raise CatalogueDamaged(f"{catalogue.path} is damaged: curve {row.id} cannot be read: {error}") from error


def keep_curve(catalogue: CatalogueStore, curve: BifurcationCurve) -> tuple[Kept, str]:
    """Add a curve, or replace shorter parts of it. Parts that overlap are joined.

    Returns
    -------
    Kept, str
        What was done, and the id of the curve.

    Raises
    ------
    CatalogueError
        For a curve of another system, or a catalogue of families in the energy.
    CannotWiden
        If the curve overlaps another part and could not be followed through both.
    """
    from branches.curves.extending import is_within
    from branches.curves.identity import canonical_names
    from branches.curves.tracing import extend_curve

    if not catalogue.scene.parameters:
        raise CatalogueError(f"{catalogue.path} holds families in the energy, and a curve lies between families in a parameter")
    catalogue.require_system(_described(catalogue, curve))
    replaced: list[str] = []
    while True:
        same = [row for row in catalogue.curve_rows() if (row.code, row.names) == (curve.code, canonical_names(curve))]
        beside = [(row, curve_of_row(catalogue, row)) for row in same if row.id not in replaced and _overlap(row, curve)]
        for row, stored in beside:
            covered, inside = _share(stored, curve), _share(curve, stored)
            if covered == 1.0 and not replaced:
                return Kept.KNOWN, row.id
            if inside == 1.0:
                replaced.append(row.id)
                break
            if max(inside, covered) > 0.0:
                window = _hull(curve, stored)
                longer = extend_curve(curve, window) if is_within(curve, window) else curve
                if _share(longer, stored) < 1.0:
                    raise CannotWiden(f"{row.id} stays kept: the curve overlaps it, and was not found to go on through all of it")
                curve = longer
                replaced.append(row.id)
                break
        else:
            break
    row = curve_row(catalogue, curve)
    with catalogue.transaction():
        for id in replaced:
            catalogue.remove_curve(id)
        catalogue.insert_curve(row)
    return (Kept.WIDER if replaced else Kept.NEW), row.id


def _described(catalogue: CatalogueStore, curve: BifurcationCurve) -> dict[str, Any]:
    """The system of a curve as plain data, with the catalogue's values of the parameters that vary along the curve."""
    from branches.tables import plain

    problem = curve.plane.problem
    at = problem.parametric.replaced(problem.values)
    known: ParametricSystem = catalogue.parametric
    varied = {name: known.values[name] for name in problem.released if name in at.names and name in known.names}
    described: dict[str, Any] = plain(at.replaced(varied).describe())
    return described


def _overlap(row: CurveRow, curve: BifurcationCurve) -> bool:
    """Whether the ranges of two curves overlap."""
    order = [curve.names.index(name) for name in row.names]
    low, high = ([values[k] for k in order] for values in curve.span)
    return all(
        least <= high[k] + _SAME * abs(high[k]) and most >= low[k] - _SAME * abs(low[k]) for k, (least, most) in enumerate(row.ranges)
    )


def _hull(curve: BifurcationCurve, other: BifurcationCurve) -> tuple[tuple[float, float], tuple[float, float]]:
    """The ranges that contain those of two curves, in the order of the first one's parameters."""
    (a, b), (c, d) = (other.window[other.names.index(name)] for name in curve.names)
    (e, f), (g, h) = curve.window
    return (min(a, e), max(b, f)), (min(c, g), max(d, h))


_PLACES = 15
"""Orbits of a curve that decide whether another one contains it."""


def _share(curve: BifurcationCurve, other: BifurcationCurve) -> float:
    """The part of the orbits of another curve that a curve contains, of both ends and some between them."""
    import numpy as np

    from branches.catalogue.responses import are_on
    from branches.curves.identity import curve_numbers

    places = sorted({round(k * (len(other) - 1) / (_PLACES - 1)) for k in range(_PLACES)})
    return float(np.mean(are_on(curve_numbers(curve), curve_numbers(other)[places])))


# -- meetings -----------------------------------------------------------------------------------------------------------------


def meetings_of(catalogue: CatalogueStore, curve: BifurcationCurve) -> list[tuple[float, float]]:
    """Where a curve crosses the line of the families of a catalogue: their parameter and period, in order of the parameter."""
    import numpy as np

    from branches.curves.tracing import curve_again

    line = _Line(catalogue, curve)
    values = np.array([line.residual(y) for y in curve.unknowns])
    sizes = np.maximum(np.abs(values).max(axis=0), line.scale)
    varying = np.ptp(values, axis=0) > _CONSTANT * sizes
    if (np.abs(values[:, ~varying]) > _SAME * line.scale[~varying]).any():
        return []
    spot = np.abs(values) <= _SAME * line.scale
    found = [line.place(curve.unknowns[i]) for i in np.flatnonzero(spot.all(axis=1))]
    if varying.any():
        leading = int(np.argmax(np.where(varying, np.ptp(values, axis=0) / sizes, -1.0)))
        column = values[:, leading]
        problem = curve_again(curve).curve(_ANYWHERE)
        for i in np.flatnonzero(column[:-1] * column[1:] < 0.0).tolist():
            if spot[i, leading] or spot[i + 1, leading]:
                continue
            y = _crossing(problem, curve, i, lambda y: float(line.residual(y)[leading]))
            if y is not None and (np.abs(line.residual(y)) <= _SAME * line.scale).all():
                found.append(line.place(y))
    kept: list[tuple[float, float]] = []
    for value, period in sorted(found):
        if not any(math.isclose(value, a, rel_tol=_SAME, abs_tol=_SAME) and math.isclose(period, b, rel_tol=_SAME) for a, b in kept):
            kept.append((value, period))
    return kept


_ANYWHERE = (-math.inf, math.inf), (-math.inf, math.inf)


class _Line:
    """The line on which the families of a catalogue are: its equations, and the values of the parameters that do not vary."""

    def __init__(self, catalogue: CatalogueStore, curve: BifurcationCurve):
        import numpy as np

        from bvp.description import RESERVED

        parametric, given = catalogue.parametric, catalogue.scene.parameters
        self._plane, self._size = curve.plane, curve.plane.size
        self._name, self._free = given["names"][0], catalogue.scene.is_free
        self._names = parametric.names
        self._fixed = [name for name in parametric.names if name not in given["names"]]
        self._own = np.array([parametric.values[name] for name in self._fixed])
        keep, names = given["keep"], given["names"]
        self._count = len(keep)
        self._program = parametric.equations(keep, names, RESERVED) if self._free else parametric.equations(keep, names) if keep else None
        self.scale = np.concatenate([np.ones(self._count), np.maximum(np.abs(self._own), 1.0)])

    def residual(self, y: np.ndarray) -> np.ndarray:
        """What vanishes at an orbit of the catalogue's families."""
        import numpy as np

        from bvp.programs import evaluate_program

        known = self._plane.values(y[: self._size])
        kept = np.zeros(0)
        if self._program is not None:
            at = [known[name] for name in self._names] + ([known["energy"], known["quarter_period"]] if self._free else [])
            kept = np.asarray(evaluate_program(self._program, at))[: self._count]
        return np.concatenate([kept, np.array([known[name] for name in self._fixed]) - self._own])

    def place(self, y: np.ndarray) -> tuple[float, float]:
        """The parameter and the period of an orbit."""
        y = y[: self._size]
        return float(self._plane.values(y)[self._name]), float(self._plane.problem.period(y))


def _crossing(problem: Curve, curve: BifurcationCurve, i: int, residual: Any) -> np.ndarray | None:
    """The orbit between a point and the next one at which a number vanishes; None where it is not found."""
    from branches.curves.tracing import step_at

    begin = step_at(problem, curve, i)
    if begin is None:
        return None
    low, high = 0.0, float(curve.arclength[i + 1] - curve.arclength[i])
    at_low, at_high = residual(curve.unknowns[i]), residual(curve.unknowns[i + 1])
    y = None
    for k in range(_REFINEMENTS):
        # The Illinois method, and a bisection now and then.
        ds = 0.5 * (low + high) if k % 5 == 4 else (low * at_high - high * at_low) / (at_high - at_low)
        step = problem.step(begin.y, begin.tangent, ds)
        if not step.converged:
            return None
        y, value = step.y, residual(step.y)
        if abs(value) < 1e-13 or high - low < 1e-13:
            break
        if value * at_low < 0.0:
            high, at_high, at_low = ds, value, 0.5 * at_low
        else:
            low, at_low, at_high = ds, value, 0.5 * at_high
    return y


# -- checks -------------------------------------------------------------------------------------------------------------------


def curve_failures(curve: BifurcationCurve, row: CurveRow) -> Iterator[str]:
    """What does not hold of a stored curve. Of several points with the same failure the first is reported."""
    import numpy as np

    from branches.curves.identity import canonical_names, curve_id
    from branches.curves.tracing import curve_again

    problem, u = curve_again(curve).curve(_ANYWHERE), curve.plane.size
    uncertain = {event.point for event in curve.events if event.status != "located"}
    found: dict[str, list[str]] = {}
    for i, y in enumerate(curve.unknowns):
        where = f"point {i}, " + ", ".join(f"{n} = {v:.8g}" for n, v in zip(curve.names, curve.parameters[i].tolist(), strict=True))
        at = curve.plane.linearised(y[:u])
        residual = curve.plane.worst(at)
        if not residual <= RESIDUAL:
            found.setdefault("residual", []).append(f"{where}: its residual is {residual:.1e}, expected below {RESIDUAL:.0e}")
            continue
        if not np.array_equal(at.parameters, curve.parameters[i]) and not np.allclose(at.parameters, curve.parameters[i], 1e-12, 1e-12):
            found.setdefault("parameters", []).append(f"{where}: its orbit has other values of them")
        distance = _from_condition(problem, y)
        if not distance <= CONDITION and i not in uncertain:
            text = f"{where}: its condition {curve.code} does not hold, by {distance:.1e}, expected below {CONDITION:.0e}"
            found.setdefault("condition", []).append(text)
    for texts in found.values():
        yield texts[0] + (f" (and {len(texts) - 1} more points)" if len(texts) > 1 else "")
    if not (np.diff(curve.arclength) >= 0.0).all():
        yield "its points are not in order of arclength"
    if curve_id(curve) != row.id:
        yield f"its events give the id {curve_id(curve)}"
    if (row.code, row.names, row.points, row.events) != (curve.code, canonical_names(curve), len(curve), len(curve.events)):
        yield "its row and its points do not fit each other"


def _from_condition(problem: Curve, y: np.ndarray) -> float:
    """How far a point is from the condition of its curve: the smallest singular value, or a distance in units of the unknowns."""
    import numpy as np

    u = problem.surface.size
    scale = problem.surface.scales(y[:u])
    at = problem.surface.linearised(y[:u])
    held = problem.condition.held(at, y[u:], problem.condition.first(at, y[u:], scale), scale)
    value = float(np.abs(held.values).max())
    if hasattr(problem.condition, "matrix"):
        return value
    return value / max(float(np.linalg.norm(held.gradient[0] * scale)), 1e-300)
