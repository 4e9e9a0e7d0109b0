"""The catalogue itself: families in, families out, one transaction each."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from branches.catalogue.errors import CatalogueDamaged, CatalogueError, not_taken, translated
from branches.catalogue.rows import (
    EDGE_COLUMNS,
    EVENT_COLUMNS,
    FAMILY_COLUMNS,
    NODE_COLUMNS,
    Edge,
    FamilyRow,
    Node,
    crc_of,
    dead_end_id,
    no_nan,
)
from branches.catalogue.work import WorkQueue
from bvp.shown import shown

if TYPE_CHECKING:
    import networkx
    import numpy as np

    from branches.branch import Branch
    from branches.catalogue.find import Match
    from branches.catalogue.identify import KeptFamilies
    from branches.catalogue.packing import PackedFamily
    from branches.catalogue.widening import Kept
    from branches.events import BranchEvent
    from branches.orbit import Orbit
    from bvp.multipoint import MultipointProblem

__all__ = ["Catalogue"]


class Catalogue(WorkQueue):
    """The families of one system, in one file.

    Parameters
    ----------
    path : path-like
    mode : {"r", "a"}
        "r" reads, and changes nothing; "a" also adds, and makes the file where there is none. One process writes at a time.
    scene : saltus.Scene, ImpactSystem or SceneRecord, optional
        Needed to make a file. Of a file that exists, its system has to be the one of the catalogue.
    provenance : mapping, optional
        Written beside the versions of the libraries when the file is made: JSON values by name.

    Raises
    ------
    CatalogueError
        For a file that is no catalogue, has another schema, or belongs to another system; `CatalogueDamaged` and `CatalogueInUse`
        are of this kind.
    WriteFailure
        Where the file cannot be written.

    Examples
    --------
    >>> import tempfile, saltus
    >>> directory = tempfile.TemporaryDirectory()
    >>> path = directory.name + "/lee2009.sqlite"
    >>> with saltus.Catalogue(path, "a", scene=saltus.load_scene()) as catalogue:
    ...     id = catalogue.add(saltus.trace("S13O00+", energy=(0.2, 1.0)))
    >>> with saltus.Catalogue(path) as catalogue:
    ...     [family.label for family in catalogue.families(energy=0.5)], [event.id for event in catalogue.branch(id).events]
    (['S13O00+'], ['EP1', 'SB1', 'RT1', 'EP2'])
    >>> directory.cleanup()
    """

    def counts(self) -> dict[str, int]:
        """How many families, points, events and edges it holds, and how many pieces of work are left."""
        tables = {"families": "families", "points": "points", "events": "events", "edges": "edges", "pending": "work"}
        with translated(self.path):
            return {name: self._connection.execute(f"SELECT count(*) FROM {rows}").fetchone()[0] for name, rows in tables.items()}

    # -- families -------------------------------------------------------------------------------------------------------------

    def families(
        self,
        *,
        label: str | None = None,
        energy: float | None = None,
        stable: bool = False,
        ends: str | None = None,
        impacts: tuple[float, float] | None = None,
    ) -> list[FamilyRow]:
        """The families, those with few impacts and low energies first.

        Parameters
        ----------
        label : str, optional
            Only those that have such a label somewhere: a label or pattern of labels (``U83``), or shell wildcards (``U8*``).
        energy : float, optional
            Only those that cross this energy.
        stable : bool
            Only those that are stable somewhere. Label, energy and stability have to hold together.
        ends : str, optional
            ``origin-stop`` for both sides of the stop, ``origin-stop+``, ``periodic``.
        impacts : (float, float), optional
            Least and most in half a period.

        Returns
        -------
        list of FamilyRow

        Raises
        ------
        LabelSyntaxError
            For a label that cannot be read and has no wildcard.
        CatalogueError
            For ends that no family has, and for what is no label or no number.
        """
        from branches.catalogue.find import chosen

        return chosen(self._families, label=label, energy=energy, stable=stable, ends=ends, impacts=impacts)

    def family(self, id: str) -> FamilyRow:
        """The row of one family.

        Raises
        ------
        CatalogueError
            For an id that it does not have; the nearest is named.
        """
        if not isinstance(id, str):
            raise not_taken("a family is named by its id, such as origin-stop+::44db5a75", id)
        rows = self._select("families", ("number", *FAMILY_COLUMNS), "WHERE id = ?", (id,))
        if not rows:
            from branches.labels import nearest

            near = ", ".join(nearest(id, [row.id for row in self._families])) or "none, it holds no family"
            raise CatalogueError(f"{self.path} has no family {shown(id)}; nearest: {near}")
        return self._family(rows[0])

    def __contains__(self, id: object) -> bool:
        if not isinstance(id, str):
            return False
        with translated(self.path):
            return self._connection.execute("SELECT 1 FROM families WHERE id = ?", (id,)).fetchone() is not None

    def __len__(self) -> int:
        with translated(self.path):
            return int(self._connection.execute("SELECT count(*) FROM families").fetchone()[0])

    def points(self, id: str) -> dict[str, np.ndarray]:
        """The columns of a family's points, as `branches.branch.Branch.points` has them; they cannot be written to.

        Raises
        ------
        CatalogueDamaged
            Where a checksum does not fit.
        """
        from bvp.frozen import Frozen

        row = self.family(id)
        return Frozen(self._points(row, self._problem(row)))

    def track(self, row: FamilyRow) -> list[tuple[float, float, str]]:
        """Energy, quarter period and label at each point of a family, without arrays; checksums are not compared."""
        with translated(self.path):
            found = self._connection.execute(
                "SELECT h, alpha, label FROM points WHERE number >= ? AND number < ? ORDER BY number",
                (row.first_point, row.first_point + row.points),
            ).fetchall()
        if len(found) != row.points:
            raise CatalogueDamaged(f"{self.path} is damaged: family {row.id}: it has {len(found)} of {row.points} points")
        return found

    def events(self, id: str) -> tuple[BranchEvent, ...]:
        """The events of a family, in order of arclength."""
        from branches.catalogue.events import read_event

        row = self.family(id)
        with translated(self.path):
            found = self._connection.execute(
                f"SELECT {', '.join(EVENT_COLUMNS)}, crc FROM events WHERE family = ? ORDER BY position", (row.number,)
            ).fetchall()
        if len(found) != row.events:
            raise CatalogueDamaged(f"{self.path} is damaged: family {id}: it has {len(found)} of {row.events} events")
        return tuple(read_event(self._checked(values, f"event {values[0]} of family {id}")) for values in found)

    def branch(self, id: str) -> Branch:
        """A family as the branch that was added, bit for bit."""
        from branches.branch import Branch, Ended

        row = self.family(id)
        problem = self._problem(row)
        first, last = (Ended(*ended) for ended in row.ended)
        return Branch(problem, self._points(row, problem), self.events(id), (first, last), row.start).known_as(row.id)

    def find(self, name: str, *, pins: Mapping[str, Mapping[str, float]] | None = None) -> Match:
        """The one family, or linear mode, that a name stands for.

        Parameters
        ----------
        name : str
            ``LABEL[@h=..][,alpha=..]``, an id, or the beginning of one that no other has.
        pins : mapping, optional
            Cited points that choose among matches of a bare name; by default those of the catalogue's scene.

        Raises
        ------
        NameNotFound, AmbiguousName, LabelSyntaxError, ImpossibleLabelError
        CatalogueError
            For what is no text.
        """
        from branches.catalogue.find import find

        return find(self, name, self.scene.pins if pins is None else pins)

    def identify(self, orbit: Orbit) -> str | None:
        """The id of the family that passes through an orbit, however it is started, mirrored or run; None where none does.

        Raises
        ------
        CatalogueError
            For an orbit of another system.
        """
        self.require_system(orbit.system.describe())
        place = self._kept.find(orbit.problem, orbit.solution.y)
        return None if place is None else place.id

    # -- the graph ------------------------------------------------------------------------------------------------------------

    @property
    def nodes(self) -> list[Node]:
        """The nodes that are no families, in the order of their ids."""
        rows = self._select("nodes", NODE_COLUMNS, "ORDER BY id")
        return [Node.read(self._checked(values, f"node {values[0]}")) for values in rows]

    def edges(self, id: str | None = None) -> list[Edge]:
        """The edges, or those at one node, in an order that does not depend on how they were found."""
        where, values = ("WHERE source = ? OR target = ?", (id, id)) if id is not None else ("", ())
        rows = self._select("edges", EDGE_COLUMNS, f"{where} ORDER BY source, h, source_event, kind, target, target_event", values)
        return [Edge.read(self._checked(row, f"the edge at {row[1] or row[2]} of {row[0]}")) for row in rows]

    def graph(self) -> networkx.MultiDiGraph:
        """The families and linear modes as nodes, their events as edges: see `branches.catalogue.graph`."""
        from branches.catalogue.graph import graph_of

        return graph_of(self)

    # -- adding ---------------------------------------------------------------------------------------------------------------

    def add(self, branch: Branch | PackedFamily) -> str:
        """Keep a family; one with the same id is kept already, and stays as it is.

        Parameters
        ----------
        branch : Branch or PackedFamily
            A worker can do most of the work before, with `branches.catalogue.packing.pack`.

        Returns
        -------
        str
            Its id.

        Raises
        ------
        CatalogueError
            For a branch of another system.
        WriteFailure
            Where the file cannot be written; what it held stays.
        """
        from branches.catalogue.packing import PackedFamily, pack
        from branches.catalogue.points import BLOBS, POINT_COLUMNS

        self._writable()
        family = branch if isinstance(branch, PackedFamily) else pack(branch)
        self.require_system(family.system)
        if family.row.id in self:
            return family.row.id
        with self.transaction():
            number, first = (
                self._connection.execute(f"SELECT coalesce(max(number), 0) + 1 FROM {table}").fetchone()[0]
                for table in ("families", "points")
            )
            row = replace(family.row, number=number, first_point=first)
            self._insert("families", ("number", *FAMILY_COLUMNS), (number, *row.values()), crc_of(row.values()))
            marks = ", ".join("?" * (len(POINT_COLUMNS) + 2))
            self._connection.executemany(
                f"INSERT INTO points (number, family, {', '.join(POINT_COLUMNS)}) VALUES ({marks})",
                ((first + i, number, *values) for i, values in enumerate(family.points)),
            )
            names = ", ".join(f"{name}, {name}_crc" for name in BLOBS)
            self._connection.execute(
                f"INSERT INTO blobs (family, {names}) VALUES (?, {', '.join('?' * (2 * len(BLOBS)))})",
                (number, *(value for blob in family.blobs for value in (blob, zlib.crc32(blob)))),
            )
            marks = ", ".join("?" * (len(EVENT_COLUMNS) + 3))
            self._connection.executemany(
                f"INSERT INTO events (family, position, {', '.join(EVENT_COLUMNS)}, crc) VALUES ({marks})",
                ((number, position, *values, crc_of(values)) for position, values in enumerate(family.events)),
            )
        return row.id

    def widen(self, branch: Branch) -> Kept:
        """Keep a family, and in place of a part of it where only that is kept: events and edges stay, in one transaction.

        Returns
        -------
        Kept
            ``NEW``, ``WIDER``, or ``KNOWN`` where what is kept already has all of the branch.

        Raises
        ------
        CannotWiden
            Where the branch does not have all that is kept, where an edge does not find its event on it, or where a build is not finished.
        CatalogueError, WriteFailure
            As for `add`.
        """
        from branches.catalogue.widening import widen

        return widen(self, branch)

    def remove(self, id: str) -> None:
        """Take a family out, with its events and the edges at it."""
        row = self.family(id)
        with self.transaction():
            self._connection.execute(
                "DELETE FROM points WHERE number >= ? AND number < ?", (row.first_point, row.first_point + row.points)
            )
            for table in ("blobs", "events"):
                self._connection.execute(f"DELETE FROM {table} WHERE family = ?", (row.number,))
            self._delete("edges", "source = ? OR target = ?", (id, id))
            self._delete("families", "number = ?", (row.number,))

    def remove_node(self, id: str) -> None:
        """Take a node out that is no family; the edges at it stay."""
        with self.transaction():
            self._delete("nodes", "id = ?", (id,))

    def connect(self, edge: Edge) -> Edge:
        """Keep an edge; one between the same events is kept already, and stays as it is. An edge without a target is given a dead
        end of its own.

        Returns
        -------
        Edge
            As it is kept.
        """
        with self.transaction():
            if edge.target is None:
                note = edge.note or "no admissible neighbour was found"
                end = Node(dead_end_id(edge.source, edge.source_event), "dead end", note=note)
                self.add_node(end)
                edge = replace(edge, target=end.id)
            edge = replace(edge, h=float(edge.h), alpha=float(edge.alpha))
            self._insert("edges", EDGE_COLUMNS, edge.values(), crc_of(edge.values()), ignore=True)
        return edge

    def add_node(self, node: Node) -> None:
        """Keep a node that is no family, such as a linear mode; one with the same id stays as it is."""
        if node.h is not None:
            node = Node(node.id, node.kind, node.label, (float(node.h[0]), float(node.h[1])), no_nan(node.alpha), node.note)
        with self.transaction():
            self._insert("nodes", NODE_COLUMNS, node.values(), crc_of(node.values()), ignore=True)

    # -- inside ---------------------------------------------------------------------------------------------------------------

    def _problem(self, row: FamilyRow) -> MultipointProblem:
        from branches.words import parse_ends, parse_word
        from bvp.multipoint import MultipointProblem

        return MultipointProblem(self.system, parse_ends(row.ends), parse_word(row.word))

    def _points(self, row: FamilyRow, problem: MultipointProblem) -> dict[str, np.ndarray]:
        from branches.catalogue.points import BLOBS, POINT_COLUMNS, Packed, columns_of

        names = ", ".join(f"{name}, {name}_crc" for name in BLOBS)
        with translated(self.path):
            found = self._connection.execute(
                f"SELECT {', '.join(POINT_COLUMNS)} FROM points WHERE number >= ? AND number < ? ORDER BY number",
                (row.first_point, row.first_point + row.points),
            ).fetchall()
            blobs = self._connection.execute(f"SELECT {names} FROM blobs WHERE family = ?", (row.number,)).fetchone()
        where = f"{self.path} is damaged: family {row.id}"
        if len(found) != row.points:
            raise CatalogueDamaged(f"{where}: it has {len(found)} of {row.points} points")
        if blobs is None:
            raise CatalogueDamaged(f"{where}: the states of its points are missing")
        for name, blob, crc in zip(BLOBS, blobs[::2], blobs[1::2], strict=True):
            if not isinstance(blob, bytes) or zlib.crc32(blob) != crc:
                raise CatalogueDamaged(f"{where}: the {name} of its points do not fit their checksum")
        return columns_of(Packed(found, row.columns_crc, blobs[::2]), row.layout, problem, where)

    @cached_property
    def _kept(self) -> KeptFamilies:
        from branches.catalogue.identify import KeptFamilies

        return KeptFamilies(self)

    @cached_property
    def _families(self) -> list[FamilyRow]:
        return [self._family(row) for row in self._select("families", ("number", *FAMILY_COLUMNS), "ORDER BY impacts, h_low, id")]

    def _family(self, row: tuple[Any, ...]) -> FamilyRow:
        number, *values = row
        return FamilyRow.read(number, self._checked(values, f"the row of family {values[0]}"))

    def _changed(self) -> None:
        # What was read of the families may no longer be all of them.
        for name in ("_families", "_kept"):
            self.__dict__.pop(name, None)
