"""Keeping curves in the plane of two parameters in a catalogue: joining their parts, their meetings with its families, and checks."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from branches.catalogue.curves import CurveRow, curve_of_row
from branches.catalogue.database import CatalogueError
from branches.catalogue.responses import are_on
from branches.catalogue.rows import compact_json
from branches.catalogue.store import CatalogueStore
from branches.catalogue.widening import CannotWiden, Kept
from branches.curves.files import COLUMNS, curve_header
from branches.curves.identity import canonical_names, curve_id, curve_numbers
from branches.curves.monitor import ANYWHERE
from branches.curves.record import BifurcationCurve
from branches.curves.tracing import curve_again, extend_curve, is_within, step_at
from branches.tables import plain
from bvp.description import RESERVED
from bvp.parameters import ParametricSystem
from bvp.programs import evaluate_program
from continuation.curves import Curve

__all__ = ["curve_failures", "curve_row", "keep_curve"]

RESIDUAL = 1e-11
"""Largest residual of a stored point, in units of its unknowns."""

CONDITION = 1e-8
"""Largest value of the condition of a curve at a stored point: a singular value, or a distance from a grazing."""

_SAME = 1e-7
"""Largest difference of a parameter from that of the families, relative to the larger one of its size and 1."""

_CONSTANT = 1e-9
"""Relative change of a number along a curve that is rounding."""

_REFINEMENTS = 30


def curve_row(catalogue: CatalogueStore, curve: BifurcationCurve) -> CurveRow:
    """The row of a curve of the catalogue's system."""
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
    if not catalogue.scene.parameters:
        raise CatalogueError(f"{catalogue.path} holds families in the energy, and a curve lies between families in a parameter")
    catalogue.require_system(_described(catalogue, curve))
    replaced: list[str] = []
    while (part := _shared_part(catalogue, curve, replaced)) is not None:
        id, stored, covered, inside = part
        if covered == 1.0 and not replaced:
            return Kept.KNOWN, id
        if inside < 1.0:
            curve = _through_both(curve, stored, id)
        replaced.append(id)
    row = curve_row(catalogue, curve)
    with catalogue.transaction():
        for id in replaced:
            catalogue.remove_curve(id)
        catalogue.insert_curve(row)
    return (Kept.WIDER if replaced else Kept.NEW), row.id


def _shared_part(
    catalogue: CatalogueStore, curve: BifurcationCurve, known: Sequence[str]
) -> tuple[str, BifurcationCurve, float, float] | None:
    """A stored curve that has orbits of a curve: its id, itself, its part of that curve's orbits, and that curve's part of its own.

    None where no curve, beside those with a known id, has some."""
    for row in catalogue.curve_rows():
        if row.id in known or (row.code, row.names) != (curve.code, canonical_names(curve)) or not _overlap(row, curve):
            continue
        stored = curve_of_row(catalogue, row)
        covered, inside = _share(stored, curve), _share(curve, stored)
        if max(covered, inside) > 0.0:
            return row.id, stored, covered, inside
    return None


def _through_both(curve: BifurcationCurve, stored: BifurcationCurve, id: str) -> BifurcationCurve:
    """A curve, followed on through the stored curve with an id."""
    window = _hull(curve, stored)
    longer = extend_curve(curve, window) if is_within(curve, window) else curve
    if _share(longer, stored) < 1.0:
        raise CannotWiden(f"{id} stays kept: the curve overlaps it, and was not found to go on through all of it")
    return longer


def _described(catalogue: CatalogueStore, curve: BifurcationCurve) -> dict[str, Any]:
    """The system of a curve as plain data, with the catalogue's values of the parameters that vary along the curve."""
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
    places = sorted({round(k * (len(other) - 1) / (_PLACES - 1)) for k in range(_PLACES)})
    return float(np.mean(are_on(curve_numbers(curve), curve_numbers(other)[places])))


def meetings_of(catalogue: CatalogueStore, curve: BifurcationCurve) -> list[tuple[float, float]]:
    """Where a curve crosses the line of the families of a catalogue: their parameter and period, in order of the parameter."""
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
        problem = curve_again(curve).curve(ANYWHERE)
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


class _Line:
    """The line on which the families of a catalogue are: its equations, and the values of the parameters that do not vary."""

    def __init__(self, catalogue: CatalogueStore, curve: BifurcationCurve):
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


def _crossing(problem: Curve, curve: BifurcationCurve, i: int, residual: Callable[[np.ndarray], float]) -> np.ndarray | None:
    """The orbit between a point and the next one at which a number vanishes; None where it is not found."""
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


def curve_failures(curve: BifurcationCurve, row: CurveRow) -> Iterator[str]:
    """What does not hold of a stored curve. Of several points with the same failure the first is reported."""
    problem, u = curve_again(curve).curve(ANYWHERE), curve.plane.size
    uncertain = {event.point for event in curve.events if event.status != "located"}
    found: dict[str, list[str]] = {}
    for i, y in enumerate(curve.unknowns):
        where = f"point {i}, " + ", ".join(f"{n} = {v:.8g}" for n, v in zip(curve.names, curve.parameters[i].tolist(), strict=True))
        at = problem.surface.linearised(y[:u])
        residual = problem.surface.worst(at)
        if not residual <= RESIDUAL:
            found.setdefault("residual", []).append(f"{where}: its residual is {residual:.1e}, expected below {RESIDUAL:.0e}")
            continue
        if not np.allclose(at.parameters, curve.parameters[i], 1e-12, 1e-12):
            found.setdefault("parameters", []).append(f"{where}: its orbit has other values of them")
        distance = _from_condition(problem, y)
        if not distance <= CONDITION and i not in uncertain:
            text = f"{where}: its condition {curve.code} does not hold, by {distance:.1e}, expected below {CONDITION:.0e}"
            found.setdefault("condition", []).append(text)
    yield from first_of_each(found)
    if not (np.diff(curve.arclength) >= 0.0).all():
        yield "its points are not in order of arclength"
    if curve_id(curve) != row.id:
        yield f"its events give the id {curve_id(curve)}"
    if (row.code, row.names, row.points, row.events) != (curve.code, canonical_names(curve), len(curve), len(curve.events)):
        yield "its row and its points do not fit each other"


def first_of_each(found: dict[str, list[str]]) -> Iterator[str]:
    """The first of the failures of each kind, with the number of the others."""
    for texts in found.values():
        yield texts[0] + (f" (and {len(texts) - 1} more points)" if len(texts) > 1 else "")


def _from_condition(problem: Curve, y: np.ndarray) -> float:
    """How far a point is from the condition of its curve: the smallest singular value, or a distance in units of the unknowns."""
    u = problem.surface.size
    scale = problem.surface.scales(y[:u])
    at = problem.surface.linearised(y[:u])
    held = problem.condition.held(at, y[u:], problem.condition.first(at, y[u:], scale), scale)
    value = float(np.abs(held.values).max())
    if hasattr(problem.condition, "matrix"):
        return value
    return value / max(float(np.linalg.norm(held.gradient[0] * scale)), 1e-300)
