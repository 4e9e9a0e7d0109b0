"""The graph of a catalogue.

Nodes are ids.

- A family has ``kind`` ("family"), ``label``, ``labels`` (all along it), ``ends``, ``sequence``, ``impacts`` (in half a period), ``h_low``,
  ``h_high``, ``alpha_low``, ``alpha_high``, ``points`` and ``stable_fraction`` (of its arclength).
- A linear mode has ``kind`` ("linear mode"), ``label``, ``h_low``, ``h_high`` and ``alpha``.
- A dead end has ``kind`` ("dead end") and ``note``.
- A node that an edge names and the catalogue lacks has the kind "missing".

Edges are events, from the family that has the event to the one that meets it there: ``type`` (GR, SN, BP, SB, PD, RT), ``kind`` (fold,
passage, switch, dead end, linear mode), ``source_event``, ``target_event``, ``h``, ``alpha``, ``stop``, ``note``. The key of an edge
is ``source_event>target_event:kind``.

As text the graph is node-link JSON, GraphML or Graphviz DOT. Only JSON holds lists and null. In GraphML and DOT a list is joined by spaces,
and an attribute without a value is left out.
"""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import networkx

    from branches.catalogue.store import CatalogueStore

__all__ = ["FLATTENED", "GRAPH_FORMATS", "graph_of", "graph_text"]

GRAPH_FORMATS = ("json", "graphml", "dot")

FLATTENED = "{} holds neither lists nor null: labels are joined by spaces, attributes without a value are left out"
"""The remark for a format that cannot hold every attribute."""

_COLOURS = {"linear mode": "#0072B2", "dead end": "#999999", "missing": "#D55E00"}


def graph_of(catalogue: CatalogueStore) -> networkx.MultiDiGraph:
    """The families and linear modes of a catalogue as nodes, their events as edges.

    Returns
    -------
    networkx.MultiDiGraph
        With the attributes that this module's text lists; in an order that does not depend on how the catalogue was filled.
    """
    import networkx

    graph = networkx.MultiDiGraph()
    for family in sorted(catalogue.all_families(), key=lambda row: row.id):
        graph.add_node(
            family.id, kind="family", label=family.label, labels=list(family.label_names),
            ends=family.ends, sequence=family.sequence, impacts=family.impacts, h_low=family.h[0], h_high=family.h[1],
            alpha_low=family.alpha[0], alpha_high=family.alpha[1], points=family.points, stable_fraction=family.stable_fraction,
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
        graph.add_edge(
            edge.source, edge.target, f"{edge.source_event}>{edge.target_event}:{edge.kind}", type=edge.type, kind=edge.kind,
            source_event=edge.source_event, target_event=edge.target_event, h=edge.h, alpha=edge.alpha, stop=edge.stop, note=edge.note,
        )  # fmt: skip
    return graph


def graph_text(graph: networkx.MultiDiGraph, format: str) -> str:
    """The graph in one of `GRAPH_FORMATS`.

    Raises
    ------
    ValueError
        For another format.
    """
    writers = {"json": _node_link, "graphml": _graphml, "dot": _dot}
    if format not in writers:
        raise ValueError(f"unknown format {format!r} of a graph, expected {', '.join(GRAPH_FORMATS)}")
    return writers[format](graph)


def _node_link(graph: networkx.MultiDiGraph) -> str:
    nodes = [{"id": id, **data} for id, data in graph.nodes(data=True)]
    edges = [{"source": a, "target": b, "key": key, **data} for a, b, key, data in graph.edges(keys=True, data=True)]
    lines = [f'  "{name}": {json.dumps(value)}' for name, value in (("directed", True), ("multigraph", True), ("graph", {"schema": 2}))]
    for name, entries in (("nodes", nodes), ("edges", edges)):
        listed = ",\n    ".join(json.dumps(entry, allow_nan=False) for entry in entries)
        lines.append(f'  "{name}": [\n    {listed}\n  ]' if entries else f'  "{name}": []')
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _flat(data: dict[str, Any]) -> dict[str, Any]:
    """Attributes that are numbers or text only."""
    flat = {name: " ".join(map(str, value)) if isinstance(value, list) else value for name, value in data.items()}
    return {name: value for name, value in flat.items() if value is not None}


def _graphml(graph: networkx.MultiDiGraph) -> str:
    import networkx

    flat = networkx.MultiDiGraph()
    flat.add_nodes_from((id, _flat(data)) for id, data in graph.nodes(data=True))
    flat.add_edges_from((a, b, key, _flat(data)) for a, b, key, data in graph.edges(keys=True, data=True))
    file = io.BytesIO()
    networkx.write_graphml(flat, file)
    return file.getvalue().decode() + "\n"


def _dot(graph: networkx.MultiDiGraph) -> str:
    lines = ["digraph saltus {", "  node [shape=box, fontname=Helvetica];", "  edge [fontname=Helvetica, fontsize=10];"]
    for id, data in graph.nodes(data=True):
        shown = data.get("label") or (data["note"] if data["kind"] == "dead end" else id)
        colour = {"color": _COLOURS[data["kind"]]} if data["kind"] in _COLOURS else {}
        lines.append(f"  {_quoted(id)} [{_attributes({**_flat(data), 'label': shown, **colour})}];")
    for a, b, key, data in graph.edges(keys=True, data=True):
        shown = f"{data['source_event'] or data['type']} {data['kind']}\nh = {data['h']:.6g}"
        lines.append(f"  {_quoted(a)} -> {_quoted(b)} [{_attributes({**_flat(data), 'key': key, 'label': shown})}];")
    return "\n".join([*lines, "}"]) + "\n"


def _attributes(data: dict[str, Any]) -> str:
    return ", ".join(f"{name}={_quoted(repr(value) if isinstance(value, float) else str(value))}" for name, value in data.items())


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
