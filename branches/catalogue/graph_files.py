"""The graph of a catalogue as text: node-link JSON, GraphML, Graphviz DOT.

Only JSON holds lists and null. In GraphML and DOT a list is joined by spaces (no label has one), and an attribute without a value
is left out.
"""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import networkx

__all__ = ["FLATTENED", "GRAPH_FORMATS", "graph_text"]

GRAPH_FORMATS = ("json", "graphml", "dot")

FLATTENED = "{} holds neither lists nor null: labels are joined by spaces, attributes without a value are left out"
"""What to tell of a format that cannot hold every attribute."""

_COLOURS = {"linear mode": "#0072B2", "dead end": "#999999", "missing": "#D55E00"}


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
    lines = [f'  "{name}": {json.dumps(value)}' for name, value in (("directed", True), ("multigraph", True), ("graph", {"schema": 1}))]
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
