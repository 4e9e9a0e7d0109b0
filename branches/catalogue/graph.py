"""The graph of a catalogue.

Nodes are ids. Attributes of a family: ``kind`` ("family"), ``label``, ``labels`` (all along it), ``ends``, ``word``, ``impacts`` (in half
a period), ``h_low``, ``h_high``, ``alpha_low``, ``alpha_high``, ``points``, ``stable_fraction`` (of its arclength). Of a linear mode:
``kind`` ("linear mode"), ``label``, ``h_low``, ``h_high``, ``alpha``. Of a dead end: ``kind`` ("dead end"), ``note``. A node that an edge
names and the catalogue lacks has the kind "missing".

Edges are events, from the family that has the event to the one that meets it there: ``type`` (GR, SN, BP, SB, PD, RT), ``kind`` (fold,
passage, switch, dead end, linear mode), ``source_event``, ``target_event``, ``h``, ``alpha``, ``stop``, ``note``. The key of an edge
is ``source_event>target_event:kind``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import networkx

    from branches.catalogue.store import Catalogue

__all__ = ["graph_of"]


def graph_of(catalogue: Catalogue) -> networkx.MultiDiGraph:
    """The families and linear modes of a catalogue as nodes, their events as edges.

    Returns
    -------
    networkx.MultiDiGraph
        With the attributes that this module's text lists; in an order that does not depend on how the catalogue was filled.
    """
    import networkx

    graph = networkx.MultiDiGraph()
    for family in sorted(catalogue.families(), key=lambda row: row.id):
        graph.add_node(
            family.id, kind="family", label=family.label, labels=list(family.label_names),
            ends=family.ends, word=family.word, impacts=family.impacts, h_low=family.h[0], h_high=family.h[1],
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
