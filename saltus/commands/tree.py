"""`saltus tree NAME`: the graph of a catalogue as text, from one family on."""

from __future__ import annotations

import argparse
import sys
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

from saltus import catalogues, outputs
from saltus.catalogues import edge_record, same_meeting
from saltus.options import whole_above_zero
from saltus.terminal import counted, terminal_width, with_short_ids, wrapped

if TYPE_CHECKING:
    from branches.catalogue import Catalogue, Edge

DEPTH = 3


class Way(NamedTuple):
    """An edge as it is met from one of its ends: the event there, the node at the other end, and the edge."""

    event: str
    to: str
    edge: Edge


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="S13O00+, U83@h=1.9, an id or its beginning, or L11+")
    parser.add_argument(
        "--depth", metavar="N", type=whole_above_zero, default=DEPTH, help=f"number of events away from NAME (default: {DEPTH})"
    )
    outputs.add_arguments(parser, "json")
    catalogues.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    files = outputs.outputs_of(arguments)
    with catalogues.open_catalogue(arguments) as catalogue:
        root = catalogue.find(arguments.name).id
        tree = _Tree(catalogue, root, arguments.depth)
        path = catalogue.path
    width = terminal_width(sys.stdout)
    note = f"note   {path} has no family that meets this one: --save keeps one family alone, saltus build also those that it meets"
    lines = tree.lines() if tree.ways.get(root) else [*tree.lines(), note]
    fitted = wrapped((with_short_ids(line, width) for line in lines), width, 8)
    return files.finish(fitted, lambda: {"depth": arguments.depth, "tree": catalogues.in_axes(catalogue, tree.record(root))})


class _Tree:
    """Every node hangs where it is reached with the fewest events; there it is opened, elsewhere it is only named."""

    def __init__(self, catalogue: Catalogue, root: str, depth: int) -> None:
        from branches.naming.matching import spelled
        from branches.order import in_tied_order

        self.root = root
        self.words: dict[str, str] = {}
        names = list(catalogue.scene.reference_points)
        self.symbol = catalogue.scene.axes.symbols[0]
        for row in catalogue.families():
            label = spelled(row.label, names)
            self.words[row.id] = f"{label or row.id}  {self.symbol} {row.h[0]:.5g}:{row.h[1]:.5g}" + (f"  {row.id}" if label else "")
        for other in catalogue.nodes:
            h = "" if other.h is None else f"  h {other.h[0]:.5g}:{other.h[1]:.5g}"
            self.words[other.id] = f"dead end: {other.note}" if other.kind == "dead end" else f"{other.id} ({other.kind}){h}"
        self.ways: dict[str, list[Way]] = {}
        for edge in catalogue.edges():
            target = edge.target or ""
            self.ways.setdefault(edge.source, []).append(Way(edge.source_event or edge.type, target, edge))
            if target != edge.source:
                self.ways.setdefault(target, []).append(Way(edge.target_event or edge.type, edge.source, edge))
        for node, ways in self.ways.items():
            self.ways[node] = in_tied_order(ways, lambda way: way.edge.h, lambda way: (way.event, way.to))
        self.parent: dict[str, Way | None] = {root: None}
        self.depth = {root: 0}
        queue = deque([root])
        while queue:
            node = queue.popleft()
            for way in self.ways.get(node, []) if self.depth[node] < depth else ():
                if way.to not in self.depth:
                    self.depth[way.to] = self.depth[node] + 1
                    self.parent[way.to] = way
                    queue.append(way.to)
        self.limit = depth

    def _shown(self, node: str) -> list[tuple[Way, bool]]:
        """The edges of a node except the one that led to it, each meeting once. The flag: whether the tree continues from the other node
        there."""
        came = self.parent[node]
        kept = [] if came is None else [came]
        shown = []
        for way in self.ways.get(node, []):
            if any(way.edge is other.edge or same_meeting(way.edge, other.edge) for other in kept):
                continue
            kept.append(way)
            shown.append((way, self.parent.get(way.to) is way))
        return shown

    def lines(self) -> list[str]:
        """The tree with its branches drawn."""
        out = [self.words.get(self.root, self.root)]

        def hang(node: str, lead: str) -> None:
            ways = self._shown(node)
            if self.depth[node] >= self.limit:
                if ways:
                    out.append(f"{lead}└─ {counted(len(ways), 'more event')}")
                return
            for k, (way, opens) in enumerate(ways):
                last = k == len(ways) - 1
                words = self.words.get(way.to, f"{way.to} (missing)")
                again = "" if opens or words.startswith("dead end") else "  (elsewhere in this tree)"
                out.append(f"{lead}{'└─' if last else '├─'} {way.event} {way.edge.kind} at {self.symbol} {way.edge.h:.6g}: {words}{again}")
                if opens:
                    hang(way.to, lead + ("   " if last else "│  "))

        hang(self.root, "")
        return out

    def record(self, node: str) -> dict[str, Any]:
        """The same as nested data."""
        ways = self._shown(node) if self.depth[node] < self.limit else []
        return {
            "id": node,
            "events": [
                {"event": way.event, "edge": edge_record(way.edge), **({"opens": self.record(way.to)} if opens else {"to": way.to})}
                for way, opens in ways
            ],
        }
