"""The contents of a catalogue: families, points, events, nodes, edges, and the queue of a build. Each change is one transaction."""

from __future__ import annotations

import json
import math
import sys
import zlib
from array import array
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import groupby
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any

from branches.catalogue.database import CatalogueDamaged, CatalogueError, add_table, not_taken
from branches.catalogue.file import CatalogueFile
from branches.catalogue.rows import Edge, FamilyRow, Node, dead_end_id, event_from_row
from branches.order import in_tied_order
from bvp.texts import shown

if TYPE_CHECKING:
    import numpy as np

    from branches.branch import Branch
    from branches.catalogue.curves import CurveRow
    from branches.catalogue.packing import PackedFamily
    from branches.curves.record import BifurcationCurve
    from branches.events import BranchEvent
    from branches.forced.branch import ForcedBranch

__all__ = ["CatalogueStore"]

_IGNORE = "INSERT OR IGNORE"


class CatalogueStore(CatalogueFile):
    """Data of a `branches.catalogue.Catalogue`. Functions that take a catalogue need no more than this."""

    def counts(self) -> dict[str, int]:
        """The number of families, points, events and edges, and of pieces of work that are left."""
        tables = {"families": "families", "points": "points", "events": "events", "edges": "edges", "pending": "work"}
        return {name: self._select(f"SELECT count(*) FROM {table}")[0][0] for name, table in tables.items()}

    # -- families -------------------------------------------------------------------------------------------------------------

    def all_families(self) -> list[FamilyRow]:
        """All families; those with few impacts and low energies first."""
        return list(self._families)

    def family(self, id: str) -> FamilyRow:
        """The row of one family.

        Raises
        ------
        CatalogueError
            For an unknown id. The message suggests the nearest.
        """
        if not isinstance(id, str):
            raise not_taken("a family is named by its id, such as origin-stop+::44db5a75", id)
        for row in self._rows("families", "WHERE id = ?", (id,)):
            return FamilyRow(*row)
        from branches.naming.labels import most_alike

        near = ", ".join(most_alike(id, [row.id for row in self._families])) or "none, it holds no family"
        raise CatalogueError(f"{self.path} has no family {shown(id)}; nearest: {near}")

    def __contains__(self, id: object) -> bool:
        return isinstance(id, str) and bool(self._select("SELECT 1 FROM families WHERE id = ?", (id,)))

    def __len__(self) -> int:
        return int(self._select("SELECT count(*) FROM families")[0][0])

    def points(self, id: str) -> dict[str, np.ndarray]:
        """The columns of a family's points, read-only, with the keys of `branches.branch.Branch.points`.

        Raises
        ------
        CatalogueDamaged
            If the stored points do not match their checksum.
        """
        from bvp.checks import Frozen

        row = self.family(id)
        return Frozen(self._columns(row, self._problem(row)))

    def damage(self) -> str:
        """What is damaged of the pages of the file, or of the points and events of its families, in a few words; "" if nothing is.

        It is quick, and loads no numpy. `branches.catalogue.check.check_catalogue` verifies all, and names each damaged part."""
        try:
            pages = [text for (text,) in self._select("PRAGMA quick_check(1)")]
            if pages != ["ok"]:
                return f"its pages are damaged: {' '.join(str(pages[0]).split())[:80]}"
            columns = "h, alpha, arclength, tau, stable, label"
            points = groupby(self._select(f"SELECT family, {columns} FROM points ORDER BY family, position"), key=itemgetter(0))
            found = {number: [row[1:] for row in rows] for number, rows in points}
            arrays = {number: (npz, crc) for number, npz, crc in self._select("SELECT family, npz, crc FROM arrays")}
            events = Counter(row[0] for row in self._rows("events"))
        except CatalogueDamaged as error:
            return str(error).partition(": ")[2]
        damaged = []
        for row in self.all_families():
            npz, crc = arrays.get(row.number, (None, None))
            rows = found.get(row.number, [])
            whole = len(rows) == row.points and events[row.number] == row.events and isinstance(npz, bytes)
            if not whole or checksum_of_rows(rows, npz) != crc:
                damaged.append(row.id)
        what = "does not fit its checksum" if len(damaged) == 1 else "do not fit their checksums"
        return f"{len(damaged)} of {len(self.all_families())} families {what}, the first one {damaged[0]}" if damaged else ""

    def track(self, row: FamilyRow) -> list[tuple[float, float, str]]:
        """Energy, quarter period and label at each point of a family, without arrays; the checksum is not compared."""
        found = self._select("SELECT h, alpha, label FROM points WHERE family = ? ORDER BY position", (row.number,))
        return self._complete(found, row, "points")

    def events(self, id: str) -> tuple[BranchEvent, ...]:
        """The events of a family, in order of arclength."""
        row = self.family(id)
        found = list(self._rows("events", "WHERE family = ? ORDER BY position", (row.number,)))
        events = [event_from_row(values[2:]) for values in self._complete(found, row, "events")]
        forms = row.normal_forms or [(None, None)] * len(events)
        return tuple(
            event._replace(coefficient=coefficient, criticality=criticality)
            for event, (coefficient, criticality) in zip(events, forms, strict=True)
        )

    def branch(self, id: str) -> Any:
        """A family as the branch that was added, bit for bit: a `Branch`, or a `ForcedBranch`."""
        from branches.branch import Branch, Ended

        row = self.family(id)
        problem = self._problem(row)
        if row.response is not None:
            from branches.catalogue.responses import unpack_response

            return unpack_response(problem, row, self._columns(row, problem), self.events(id))
        first, last = (Ended(*ended) for ended in row.ended)
        return Branch(problem, self._columns(row, problem), self.events(id), (first, last), row.start).known_as(row.id)

    def add(self, branch: Branch | ForcedBranch | PackedFamily) -> str:
        """Add a family. A family with the same id stays as it is.

        Parameters
        ----------
        branch : Branch, ForcedBranch or PackedFamily
            A worker can do most of the work before, with `branches.catalogue.packing.pack_family`.

        Returns
        -------
        str
            Its id.

        Raises
        ------
        CatalogueError
            For a branch of another system.
        WriteFailure
            If the file cannot be written. It keeps what it held.
        """
        from branches.catalogue.packing import PackedFamily, checksum_of_points, queried

        self._writable()
        family = branch if isinstance(branch, PackedFamily) else _packed(branch)
        self.require_system(family.system)
        if self.scene.parameters:
            self.require_parameters({"names": family.row.response["released"], "keep": family.row.response["keep"]})
        if family.row.id in self:
            return family.row.id
        with self.transaction():
            number = self._select("SELECT coalesce(max(number), 0) + 1 FROM families")[0][0]
            self._insert("families", family.row._replace(number=number))
            rows = ((number, position, *values) for position, values in enumerate(family.points))
            self._connection.executemany("INSERT INTO points VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)
            crc = checksum_of_points(queried(family.points), family.arrays)
            self._connection.execute("INSERT INTO arrays VALUES (?, ?, ?)", (number, family.arrays, crc))
            for position, values in enumerate(family.events):
                self._insert("events", (number, position, *values))
        return family.row.id

    def remove(self, id: str) -> None:
        """Remove a family, with its points and events and the edges at it."""
        row = self.family(id)
        with self.transaction():
            removed = self._connection.execute("DELETE FROM edges WHERE source = ? OR target = ?", (id, id)).rowcount
            self._count_edges(-removed)
            self._connection.execute("DELETE FROM families WHERE number = ?", (row.number,))

    # -- the graph ------------------------------------------------------------------------------------------------------------

    @property
    def nodes(self) -> list[Node]:
        """The nodes that are no families, in order of their ids."""
        return [Node.of(row) for row in self._rows("nodes", "ORDER BY id")]

    def edges(self, id: str | None = None) -> list[Edge]:
        """All edges, or those at one node, in an order that does not depend on how they were found."""
        where, values = ("WHERE source = ? OR target = ?", (id, id)) if id is not None else ("", ())
        rows = groupby((Edge.of(row) for row in self._rows("edges", f"{where} ORDER BY source", values)), key=attrgetter("source"))
        order = attrgetter("h"), lambda edge: (edge.source_event, edge.kind, edge.target or "", edge.target_event)
        return [edge for _, edges in rows for edge in in_tied_order(edges, *order)]

    def add_node(self, node: Node) -> None:
        """Add a node that is no family, such as a linear mode. A node with the same id stays as it is."""
        if not isinstance(node, Node):
            raise not_taken("a node is a saltus.Node", node)
        with self.transaction():
            self._insert("nodes", node.values(), _IGNORE)

    def remove_node(self, id: str) -> None:
        """Remove a node that is no family. The edges at it stay."""
        with self.transaction():
            self._connection.execute("DELETE FROM nodes WHERE id = ?", (id,))

    def connect(self, edge: Edge) -> Edge:
        """Add an edge. An edge between the same events stays as it is. An edge without a target gets a dead end of its own.

        Returns
        -------
        Edge
            With the dead end as its target.
        """
        if not isinstance(edge, Edge):
            raise not_taken("an edge is a saltus.Edge", edge)
        edge = replace(edge, h=float(edge.h), alpha=float(edge.alpha))
        with self.transaction():
            if edge.target is None:
                edge = replace(edge, target=dead_end_id(edge.source, edge.source_event))
                self.add_node(Node(str(edge.target), "dead end", note=edge.note or "no admissible neighbour was found"))
            self._count_edges(self._insert("edges", edge.values(), _IGNORE))
        return edge

    def _count_edges(self, change: int) -> None:
        # No other row shows that an edge is missing, so `check` compares their number.
        if change:
            self._insert("counts", ("edges", json.dumps(self.recorded("edges") + change)), "INSERT OR REPLACE")

    def recorded(self, table: str) -> int:
        """The number of edges or curves by the record that is kept of it when some are added or removed."""
        return int(self._values("counts").get(table, 0))

    # -- curves in the plane of two parameters --------------------------------------------------------------------------------

    def curve_rows(self) -> list[CurveRow]:
        """The rows of all curves in order of their ids; none in a file without this table."""
        from branches.catalogue.curves import CurveRow

        return [CurveRow(*row) for row in self._rows("curves", "ORDER BY id")] if self._has_curves else []

    def curve(self, id: str) -> BifurcationCurve:
        """The curve with an id, bit for bit.

        Raises
        ------
        CatalogueError
            For an unknown id.
        """
        from branches.catalogue.curves import curve_of_row

        rows = self.curve_rows()
        for row in rows:
            if row.id == id:
                return curve_of_row(self, row)
        raise CatalogueError(f"{self.path} has no curve {shown(id)}; it has {', '.join(row.id for row in rows) or 'none'}")

    def insert_curve(self, row: CurveRow) -> None:
        """Add the row of a curve. A curve with the same id stays as it is."""
        with self.transaction():
            add_table(self._connection, "curves")
            self._insert("curves", row, _IGNORE)
            self._count_curves()

    def remove_curve(self, id: str) -> None:
        """Remove a curve. The families on its sides stay."""
        with self.transaction():
            if self._has_curves:
                self._connection.execute("DELETE FROM curves WHERE id = ?", (id,))
                self._count_curves()

    def _count_curves(self) -> None:
        count = self._select("SELECT count(*) FROM curves")[0][0]
        self._insert("counts", ("curves", json.dumps(count)), "INSERT OR REPLACE")

    @property
    def _has_curves(self) -> bool:
        return bool(self._select("SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = 'curves'"))

    # -- the work of a build --------------------------------------------------------------------------------------------------

    def add_work(self, items: Iterable[tuple[str, Any]]) -> int:
        """Queue pieces of work, as (key, JSON value). A piece with a known key stays as it is.

        Returns
        -------
        int
            The number of new pieces.
        """
        with self.transaction():
            return sum(self._insert("work", (key, json.dumps(value, sort_keys=True)), _IGNORE) for key, value in items)

    def finish(self, key: str) -> None:
        """Remove a piece of work, in one transaction with its results."""
        with self.transaction():
            self._connection.execute("DELETE FROM work WHERE key = ?", (key,))

    def work(self) -> list[tuple[str, Any]]:
        """Pieces of work that are left: (key, value) in order of their keys."""
        return sorted(self._values("work").items())

    def note(self, key: str, value: Any) -> None:
        """Note a JSON value under a key, in place of an earlier one."""
        with self.transaction():
            self._insert("progress", (key, json.dumps(value, sort_keys=True)), "INSERT OR REPLACE")

    def progress(self, key: str) -> Any:
        """The value that was last noted under a key, None without one."""
        for _, text in self._rows("progress", "WHERE key = ?", (key,)):
            return self._parsed("progress", key, text)
        return None

    def notes(self, beginning: str) -> list[Any]:
        """All values noted under keys with this beginning, in order of the keys."""
        rows = self._rows("progress", "WHERE substr(key, 1, ?) = ? ORDER BY key", (len(beginning), beginning))
        return [self._parsed("progress", key, text) for key, text in rows]

    # -- inside ---------------------------------------------------------------------------------------------------------------

    def _problem(self, row: FamilyRow) -> Any:
        if row.response is not None:
            from branches.forced.record import problem_from

            return problem_from(self.parametric, row.response)
        from branches.sequences import parse_ends, parse_sequence
        from bvp.multipoint import MultipointProblem

        return MultipointProblem(self.system, parse_ends(row.ends), parse_sequence(row.sequence))

    def _columns(self, row: FamilyRow, problem: Any) -> dict[str, np.ndarray]:
        from branches.catalogue.packing import QUERIED, checksum_of_points, decode, queried

        found = self._select(f"SELECT {', '.join(QUERIED)} FROM points WHERE family = ? ORDER BY position", (row.number,))
        rows = self._complete(found, row, "points")
        try:
            columns = queried(rows)
            arrays, crc = next(iter(self._select("SELECT npz, crc FROM arrays WHERE family = ?", (row.number,))), (b"", None))
            if not isinstance(arrays, bytes) or checksum_of_points(columns, arrays) != crc:
                raise ValueError("its points do not fit their checksum")
            return decode(arrays, row.layout, columns, problem)
        except ValueError as error:
            raise CatalogueDamaged(f"{self.path} is damaged: family {row.id}: {error}") from error

    def _complete(self, found: list[Any], row: FamilyRow, table: str) -> list[Any]:
        """The rows that were found for a family, if they are all."""
        expected = getattr(row, table)
        if len(found) != expected:
            raise CatalogueDamaged(f"{self.path} is damaged: family {row.id} has {len(found)} of {expected} {table}")
        return found

    @cached_property
    def _families(self) -> list[FamilyRow]:
        rows = groupby((FamilyRow(*row) for row in self._rows("families", "ORDER BY impacts, id")), key=attrgetter("impacts"))
        return [row for _, alike in rows for row in in_tied_order(alike, attrgetter("h_low"), attrgetter("id"))]

    def _changed(self) -> None:
        self.__dict__.pop("_families", None)


def _packed(branch: Branch | ForcedBranch) -> PackedFamily:
    """The rows of a branch of any kind."""
    from branches.forced.branch import ForcedBranch

    if isinstance(branch, ForcedBranch):
        from branches.catalogue.responses import pack_response

        return pack_response(branch)
    from branches.catalogue.packing import pack_family

    return pack_family(branch)


def checksum_of_rows(rows: Sequence[tuple[Any, ...]], npz: bytes) -> int | None:
    """`branches.catalogue.packing.checksum_of_points` of rows of the table of points, without numpy; None for values of a wrong type."""
    crc = zlib.crc32(npz)
    try:
        for values, kind in zip(zip(*rows, strict=True), "ddddbU", strict=True):
            if kind == "U":
                width = max(1, *map(len, values))
                code = "utf-32-le" if sys.byteorder == "little" else "utf-32-be"
                crc = zlib.crc32("".join(text.ljust(width, "\0") for text in values).encode(code), crc)
            else:
                crc = zlib.crc32(array(kind, [math.nan if value is None else value for value in values]).tobytes(), crc)
    except (AttributeError, OverflowError, TypeError, ValueError):
        return None
    return crc
