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
from branches.catalogue.rows import Edge

if TYPE_CHECKING:
    from branches.catalogue.store import CatalogueStore
    from branches.curves.record import BifurcationCurve
    from branches.events import BranchEvent

__all__ = ["CurveEdge", "CurveRow", "curve_edges", "curve_of_row", "edges_of", "find_curve"]

_MATCH = 1e-6
"""Largest relative difference of a parameter, and of a period, of one event that was located twice."""

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


def curve_edges(catalogue: CatalogueStore, id: str | None = None) -> list[CurveEdge]:
    """The curves as edges, or those at one family, in order of the curves' ids: see `edges_of`."""
    edges = (CurveEdge(row, edge) for row in catalogue.curve_rows() for edge in edges_of(catalogue, row))
    return [found for found in edges if id is None or id in (found.edge.source, found.edge.target)]


def edges_of(catalogue: CatalogueStore, row: CurveRow) -> Iterator[Edge]:
    """The edges that a curve is, in order of its meetings.

    An edge leads from the family whose event the curve continues to the one on the other side. That is the same family for SN and NS. If
    the other family is not in the catalogue, the edge is a loop whose note says what begins there.
    """
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
