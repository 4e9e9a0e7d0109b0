"""`saltus show NAME`: one family of a catalogue, with its labels, events, neighbours and stability, or a file of responses."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from saltus import catalogues, outputs, responses
from saltus.catalogues import SCHEMA, edge_record, event_record, family_record, impacts_text, node_record, same_meeting
from saltus.errors import BadInput
from saltus.terminal import EVENT_COLUMNS, event_cells, range_text, stability_word, table_lines, terminal_width, wrapped

if TYPE_CHECKING:
    from branches.catalogue import Catalogue, Edge
    from branches.catalogue.find import NameMatch
    from branches.orbit import Orbit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="S13O00+, U83@h=1.9, an id or its beginning, L11+, or a JSON file of responses")
    outputs.add_arguments(parser, "json", plot="draw the orbit that the suffix of NAME selects: FILE.png, FILE.pdf or FILE.svg")
    catalogues.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    if responses.is_response_file(arguments.name):
        return responses.show(arguments)
    files = outputs.outputs_of(arguments)
    with catalogues.open_catalogue(arguments) as catalogue:
        match = catalogue.find(arguments.name)
        record = _record(catalogue, match)
        lines = _lines(catalogue, match, record)
        orbit, name = _orbit(catalogue, match) if "plot" in files.places else (None, "")

    figure: outputs.Drawing = "branches.figures.single:orbit_figure", orbit, {}
    return files.finish(lines, lambda: record, figure=figure, notes={"plot": f"the orbit {name}"})


def _record(catalogue: Catalogue, match: NameMatch) -> dict[str, Any]:
    """All that there is to say, as plain data."""
    from saltus.scene.model import explain

    neighbours = [_neighbour(catalogue, edge, match.id) for edge in catalogue.edges(match.id)]
    if match.kind != "family":
        return {"schema": SCHEMA, "node": node_record(catalogue, match.id), "neighbours": neighbours}
    row = catalogue.family(match.id)
    events = [event_record(event) for event in catalogue.events(row.id)]
    family = {"schema": SCHEMA, "family": family_record(row)}
    return {**family, "model": explain(catalogue.system, row.id), "events": events, "neighbours": neighbours}


def _neighbour(catalogue: Catalogue, edge: Edge, id: str) -> dict[str, Any]:
    """An edge as it is seen from one of its ends."""
    out = edge.source == id
    other = (edge.target if out else edge.source) or ""
    event = edge.source_event if out else edge.target_event
    return {"event": event, "direction": "out" if out else "in", "to": node_record(catalogue, other), "edge": edge_record(edge)}


def _lines(catalogue: Catalogue, match: NameMatch, record: dict[str, Any]) -> list[str]:
    """The same in words."""
    width = terminal_width(sys.stdout)
    neighbours = _each_once(record["neighbours"], catalogue.edges(match.id))
    if match.kind != "family":
        node = record["node"]
        lines = [f"{node['kind']}  {node['id']}"]
        if node["h"] is not None:
            lines.append(f"energy   h = {node['h'][0]:.10g} to {node['h'][1]:.10g}, where it grazes a stop")
        return lines + _neighbours(neighbours, width)
    row = catalogue.family(match.id)
    lines = [
        f"family   {row.id}",
        f"label    {row.label or '(outside the grammar of labels)'}",
        *([f"name     {match.note}"] if match.note else []),
        f"ends     {row.ends}  sequence {row.sequence or '(none)'}  {impacts_text(row.impacts)}",
        f"energy   h = {row.h[0]:.12g} to {row.h[1]:.12g}",
        f"quarter  alpha = {row.alpha[0]:.12g} to {row.alpha[1]:.12g}",
        f"points   {row.points}, stable over {100.0 * row.stable_fraction:.1f}% of the arclength",
        *(f"ended    at the {place} point: {text}" for place, (_, text) in zip(("first", "last"), row.ended, strict=True)),
        *(f"model    {text}" for text in record["model"]),
    ]
    lines = [*wrapped(lines, width, 9), ""]
    cells = [("label", p.value or "-", *map(range_text, p[1:])) for p in row.labels]
    cells += [("stable", stability_word(p.value), *map(range_text, p[1:])) for p in row.stability]
    lines += table_lines(("along it", "", "arclength", "energy h", "quarter alpha"), cells, width=width)
    if row.events:
        cells = [event_cells(event) for event in catalogue.events(row.id)]
        lines += ["", *table_lines(EVENT_COLUMNS, cells, width=width, columns="rllllllt")]
    return lines + _neighbours(neighbours, width)


def _neighbours(neighbours: list[dict[str, Any]], width: int | None) -> list[str]:
    if not neighbours:
        return ["", "neighbours  none known"]
    rows = []
    for item in neighbours:
        edge, node = item["edge"], item["to"]
        text = node.get("note") or edge["note"] or ""
        rows.append(
            (item["event"] or "-", edge["kind"], f"{edge['h']:.8g}", item["direction"], node["label"] or node["kind"],
             "" if node["kind"] == "dead end" else node["id"], text)
        )  # fmt: skip
    return ["", *table_lines(("event", "meeting", "energy h", "edge", "neighbour", "id", "remark"), rows, width=width, columns="lllllit")]


def _each_once(neighbours: list[dict[str, Any]], edges: list[Edge]) -> list[dict[str, Any]]:
    """The neighbours in their order; of a meeting that both families report, the report of this one."""
    kept: list[Edge] = []
    for _, edge in sorted(zip(neighbours, edges, strict=True), key=lambda pair: pair[0]["direction"] == "in"):
        if not any(same_meeting(edge, other) for other in kept):
            kept.append(edge)
    return [item for item, edge in zip(neighbours, edges, strict=True) if any(edge is other for other in kept)]


def _orbit(catalogue: Catalogue, match: NameMatch) -> tuple[Orbit, str]:
    """The orbit that a name selects, and the name that selects it alone.

    Without a suffix or a reference point, it is in the middle of the label's range. For an id, it is where the family was started.
    """
    from saltus.families import list_orbits

    if match.kind != "family":
        raise BadInput(f"{match.id} is a {match.kind}, which has no orbit with impacts to draw")
    branch = catalogue.branch(match.id)
    orbit = branch.orbit(branch.start)
    if match.h is not None:
        alpha = match.alpha or orbit.alpha
        found = branch.orbits_at(energy=match.h)
        orbit = min(found, key=lambda item: abs(item.alpha - alpha)) if found else orbit
    return orbit, list_orbits([orbit], branch)
