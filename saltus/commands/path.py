"""`saltus path A B`: the shortest chain of bifurcations between two families of a catalogue."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from saltus import catalogues, outputs
from saltus.catalogues import edge_record, node_record
from saltus.errors import FAILED, say
from saltus.terminal import counted

if TYPE_CHECKING:
    from branches.catalogue import Catalogue


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    for name, place in (("first", "A"), ("last", "B")):
        parser.add_argument(name, metavar=place, help="S13O00+, U83@h=1.9, an id or its beginning, or L11+")
    outputs.add_arguments(parser, "json")
    catalogues.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code, 1 if no chain exists."""
    files = outputs.outputs_of(arguments)
    with catalogues.open_catalogue(arguments) as catalogue:
        first, last = catalogue.find(arguments.first).id, catalogue.find(arguments.last).id
        chain = _chain(catalogue, first, last)
        symbols = catalogue.scene.axes.symbols
        nodes, edges = catalogues.in_axes(catalogue, list(chain)) if chain else (None, None)
    lines = _lines(*chain, symbols) if chain else []
    code = files.finish(lines, lambda: {"from": first, "to": last, "nodes": nodes, "edges": edges})
    if chain is None:
        say(f"no chain of events joins {arguments.first} and {arguments.last} in this catalogue")
        return max(code, FAILED)
    return code


def _chain(catalogue: Catalogue, first: str, last: str) -> tuple[list[dict[str, Any]], list[dict[str, Any]]] | None:
    """The nodes and edges of the shortest chain; of several equally short ones the first in the order of ids and energies."""
    import networkx

    between: dict[frozenset[str], Any] = {}
    graph = networkx.Graph()
    graph.add_nodes_from((first, last))
    for edge in catalogue.edges():
        graph.add_edge(edge.source, edge.target)
        between.setdefault(frozenset((edge.source, edge.target or "")), edge)
    try:
        found = networkx.shortest_path(graph, first, last)
    except networkx.NetworkXNoPath:
        return None
    edges = [edge_record(between[frozenset(pair)]) for pair in zip(found, found[1:], strict=False)]
    return [node_record(catalogue, id) for id in found], edges


def _lines(nodes: list[dict[str, Any]], edges: list[dict[str, Any]], symbols: tuple[str, str]) -> list[str]:
    out = []
    for k, node in enumerate(nodes):
        extent = "" if node["h"] is None else f"  {symbols[0]} {node['h'][0]:.6g}:{node['h'][1]:.6g}"
        out.append(f"{node['label'] or node['kind']}{extent}  {node['id']}")
        if k < len(edges):
            edge = edges[k]
            here, there = edge["source_event"], edge["target_event"]
            if edge["source"] != node["id"]:
                here, there = there, here
            way = " to ".join(event for event in (here, there) if event) or edge["type"]
            out.append(f"  {way}: {edge['kind']} at {symbols[0]} = {edge['h']:.10g}, {symbols[1]} = {edge['alpha']:.10g}")
    out.append(counted(len(edges), "event"))
    return out
