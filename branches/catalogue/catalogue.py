"""`Catalogue`: the contents of a catalogue with the operations on them as methods; its graph, and the graph as text."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from branches.catalogue.curves import curve_edges
from branches.catalogue.database import CatalogueError, not_taken
from branches.catalogue.store import CatalogueStore
from branches.naming.matching import spelled
from bvp.texts import brief

if TYPE_CHECKING:
    import networkx
    from matplotlib.axes import Axes

    from branches.branch import Branch
    from branches.catalogue.curves import CurveEdge
    from branches.catalogue.find import NameMatch
    from branches.catalogue.rows import Edge, FamilyRow
    from branches.catalogue.widening import Kept
    from branches.curves.record import BifurcationCurve
    from branches.forced.branch import ForcedBranch
    from branches.orbit import Orbit

__all__ = ["Catalogue", "FLATTENED", "graph_of", "graph_text"]


@brief
class Catalogue(CatalogueStore):
    """The families of one system, in one file.

    Parameters
    ----------
    path : path-like
    mode : {"r", "a"}
        "r" reads and changes nothing. "a" also adds; it makes the file if there is none, and converts a file of an older schema. One
        process writes at a time.
    scene : saltus.Scene, ImpactSystem or SceneRecord, optional
        Needed to make a file. The system of an existing file must be the same.
    provenance : mapping, optional
        JSON values by name, written beside the versions of the libraries when the file is made.

    Raises
    ------
    CatalogueError
        For a file that is no catalogue, has another schema, or belongs to another system. `CatalogueDamaged` and `CatalogueInUse`
        are of this kind.
    WriteFailure
        If the file cannot be written.

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

    plot: ClassVar[Callable[..., Axes]]
    """The package `saltus` adds it."""

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        try:
            counts = self.counts()
        except CatalogueError:
            return f"Catalogue {self.path} (closed)", []
        return f"Catalogue {self.path}", [("holds", ", ".join(f"{count} {name}" for name, count in counts.items()))]

    def families(
        self,
        *,
        label: str | None = None,
        energy: float | None = None,
        stable: bool = False,
        ends: str | None = None,
        impacts: tuple[float, float] | None = None,
    ) -> list[FamilyRow]:
        """The families that fit; those with few impacts and low energies first.

        Parameters
        ----------
        label : str, optional
            Only those with such a label somewhere: a label or pattern of labels (``U83``), or shell wildcards (``U8*``).
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
            For ends that no family has, and for an argument of the wrong type.
        """
        from branches.catalogue.find import chosen

        return chosen(self.all_families(), label=label, energy=energy, stable=stable, ends=ends, impacts=impacts)

    def find(self, name: str, *, reference_points: Mapping[str, Mapping[str, float]] | None = None) -> NameMatch:
        """The one family, or linear mode, that has a name.

        Parameters
        ----------
        name : str
            ``LABEL[@h=..][,alpha=..]``, an id, or the beginning of one that no other has.
        reference_points : mapping, optional
            Cited points that choose among matches of a bare name; by default those of the catalogue's scene.

        Raises
        ------
        NameNotFound, AmbiguousName, LabelSyntaxError, ImpossibleLabelError
        CatalogueError
            If the name is no text.
        """
        from branches.catalogue.find import find

        return find(self, name, self.scene.reference_points if reference_points is None else reference_points)

    def identify(self, orbit: Orbit) -> str | None:
        """The id of the family that passes through an orbit, in any of its images; None if there is none.

        Raises
        ------
        CatalogueError
            For an orbit of another system.
        """
        from branches.catalogue.members import family_of

        if not hasattr(orbit, "solution"):
            raise not_taken("an orbit is a saltus.Orbit, such as those of Branch.orbits_at", orbit)
        self.require_system(orbit.system.describe())
        return family_of(self, orbit)

    def graph(self) -> networkx.MultiDiGraph:
        """The families and linear modes as nodes, their events as edges: see `graph_of`."""
        return graph_of(self)

    def widen(self, branch: Branch | ForcedBranch) -> Kept:
        """Add a family, or replace a part of it that is there already. Events and edges stay, in one transaction. Parts of a family of
        forced orbits are joined.

        Returns
        -------
        Kept
            ``NEW``, ``WIDER``, or ``KNOWN`` if all of the branch is there already.

        Raises
        ------
        CannotWiden
            If the branch lacks orbits that are there already, if an edge does not find its event on it, or if a build is not finished.
        """
        from branches.catalogue.widening import widen

        return widen(self, branch)

    def keep_curve(self, curve: BifurcationCurve) -> tuple[Kept, str]:
        """Add a curve in the plane of two parameters, or replace shorter parts of it.

        Returns
        -------
        Kept, str
            ``NEW``, ``WIDER``, or ``KNOWN`` if all of the curve is there already; and its id.

        Raises
        ------
        CatalogueError
            For a curve of another system.
        CannotWiden
            If a part that overlaps it could not be joined.
        """
        from branches.catalogue.kept_curves import keep_curve

        return keep_curve(self, curve)

    def curve_edges(self, id: str | None = None) -> list[CurveEdge]:
        """The curves as edges between the families on their sides, or those at one family."""
        return curve_edges(self, id)


FLATTENED = "{} holds neither lists nor null: labels are joined by spaces, attributes without a value are left out"
"""The remark for a format that cannot hold every attribute."""

_OF_EDGE = ("type", "kind", "source_event", "target_event", "h", "alpha", "stop", "note")

_COLOURS = {"linear mode": "#0072B2", "dead end": "#999999", "missing": "#D55E00"}


def graph_of(catalogue: CatalogueStore) -> networkx.MultiDiGraph:
    """The families and linear modes of a catalogue as nodes, their events as edges, in an order that does not depend on how it was filled.

    Nodes are ids.

    - A family has ``kind`` ("family"), ``label``, ``labels`` (all along it), ``ends``, ``sequence``, ``impacts`` (in half a period),
      ``h_low``, ``h_high``, ``alpha_low``, ``alpha_high``, ``points`` and ``stable_fraction`` (of its arclength).
    - A linear mode has ``kind`` ("linear mode"), ``label``, ``h_low``, ``h_high`` and ``alpha``.
    - A dead end has ``kind`` ("dead end") and ``note``.
    - A node that an edge names and the catalogue lacks has the kind "missing".

    Edges are events, from the family that has the event to the one that meets it there: ``type`` (GR, SN, BP, SB, PD, RT), ``kind`` (fold,
    passage, switch, dead end, linear mode), ``source_event``, ``target_event``, ``h``, ``alpha``, ``stop``, ``note``. The key of an edge
    is ``source_event>target_event:kind``.

    A family in a parameter has no labels, and ``parameter`` and ``period`` in place of ``h`` and ``alpha``. A forced response has
    ``closure`` in place of ``ends``.

    A curve in the plane of two parameters is an edge of the kind "curve" between the families on its sides. It has more attributes:
    ``curve``, its id; ``names``, its two parameters; ``first`` and ``second``, their ranges; ``points``; and ``events``, id and both
    parameters of each. The key has the curve's id behind it.
    """
    import networkx

    first, second = catalogue.scene.axes.keys
    graph = networkx.MultiDiGraph(axes=list(catalogue.scene.axes.symbols)) if catalogue.scene.parameters else networkx.MultiDiGraph()
    for family in sorted(catalogue.all_families(), key=lambda row: row.id):
        label, *labels = (spelled(text, catalogue.scene.reference_points) for text in (family.label, *family.label_names))
        names: dict[str, Any] = {"label": label, "labels": [*dict.fromkeys(labels)], "ends": family.ends}
        if catalogue.scene.parameters:
            names = {"ends" if catalogue.scene.is_free else "closure": family.ends}
        extents = (first, family.h), (second, family.alpha)
        ranges = {f"{key}_{side}": end for key, ends in extents for side, end in zip(("low", "high"), ends, strict=True)}
        graph.add_node(
            family.id, kind="family", **names, sequence=family.sequence, impacts=family.impacts, **ranges, points=family.points,
            stable_fraction=family.stable_fraction,
        )  # fmt: skip
    for node in catalogue.nodes:
        if node.kind == "dead end":
            graph.add_node(node.id, kind=node.kind, note=node.note)
        else:
            low, high = node.h or (None, None)
            graph.add_node(node.id, kind=node.kind, label=node.label, h_low=low, h_high=high, alpha=node.alpha)
    for edge in catalogue.edges():
        for id in (edge.source, edge.target):
            if id not in graph:
                graph.add_node(id, kind="missing")
        graph.add_edge(edge.source, edge.target, _key(edge), **_attributes_of(edge, first, second))
    for curve, edge in curve_edges(catalogue):
        events = [list(place) for place in curve.places]
        of_curve = {"curve": curve.id, "names": list(curve.names), "points": curve.points, "events": events}
        of_curve |= dict(zip(("first", "second"), map(list, curve.ranges), strict=True))
        graph.add_edge(edge.source, edge.target, f"{_key(edge)} {curve.id}", **_attributes_of(edge, first, second), **of_curve)
    return graph


def _key(edge: Edge) -> str:
    return f"{edge.source_event}>{edge.target_event}:{edge.kind}"


def _attributes_of(edge: Edge, first: str, second: str) -> dict[str, Any]:
    """The attributes of an edge, with the keys of the catalogue's axes."""
    return {{"h": first, "alpha": second}.get(name, name): getattr(edge, name) for name in _OF_EDGE}


def graph_text(graph: networkx.MultiDiGraph, format: str) -> str:
    """The graph as node-link JSON ("json"), "graphml" or Graphviz "dot". `FLATTENED` says what the last two cannot hold."""
    return {"json": _node_link, "graphml": _graphml, "dot": _dot}[format](graph)


def _node_link(graph: networkx.MultiDiGraph) -> str:
    from branches.tables import json_lines

    nodes = [{"id": id, **data} for id, data in graph.nodes(data=True)]
    edges = [{"source": a, "target": b, "key": key, **data} for a, b, key, data in graph.edges(keys=True, data=True)]
    return json_lines({"directed": True, "multigraph": True, "graph": {"schema": 2, **graph.graph}, "nodes": nodes, "edges": edges})


def _flat(data: dict[str, Any]) -> dict[str, Any]:
    """Attributes that are numbers or text only."""
    flat = {name: " ".join(map(_listed, value)) if isinstance(value, list) else value for name, value in data.items()}
    return {name: value for name, value in flat.items() if value is not None}


def _listed(value: Any) -> str:
    return ":".join(map(str, value)) if isinstance(value, list) else str(value)


def _graphml(graph: networkx.MultiDiGraph) -> str:
    import networkx

    flat = networkx.MultiDiGraph()
    flat.add_nodes_from((id, _flat(data)) for id, data in graph.nodes(data=True))
    flat.add_edges_from((a, b, key, _flat(data)) for a, b, key, data in graph.edges(keys=True, data=True))
    file = io.BytesIO()
    networkx.write_graphml(flat, file)
    return file.getvalue().decode() + "\n"


def _dot(graph: networkx.MultiDiGraph) -> str:
    place, symbol = ("parameter", graph.graph["axes"][0]) if "axes" in graph.graph else ("h", "h")
    lines = ["digraph saltus {", "  node [shape=box, fontname=Helvetica];", "  edge [fontname=Helvetica, fontsize=10];"]
    for id, data in graph.nodes(data=True):
        shown = data.get("label") or (data["note"] if data["kind"] == "dead end" else id)
        colour = {"color": _COLOURS[data["kind"]]} if data["kind"] in _COLOURS else {}
        lines.append(f"  {_quoted(id)} [{_attributes({**_flat(data), 'label': shown, **colour})}];")
    for a, b, key, data in graph.edges(keys=True, data=True):
        shown = f"{data['source_event'] or data['type']} {data['kind']}\n{symbol} = {data[place]:.6g}"
        lines.append(f"  {_quoted(a)} -> {_quoted(b)} [{_attributes({**_flat(data), 'key': key, 'label': shown})}];")
    return "\n".join([*lines, "}"]) + "\n"


def _attributes(data: dict[str, Any]) -> str:
    return ", ".join(f"{name}={_quoted(repr(value) if isinstance(value, float) else str(value))}" for name, value in data.items())


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
