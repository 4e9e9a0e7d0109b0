"""`saltus show NAME`: one family of a catalogue, with its labels, events, neighbours and stability."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from saltus import catalogue_arguments
from saltus.errors import DONE, BadInput
from saltus.files import STANDARD_OUTPUT, check_picture, replacing
from saltus.outputs import add_json, apart
from saltus.printing import words_stream

if TYPE_CHECKING:
    from branches.catalogue import Catalogue, Edge, FamilyRow
    from branches.catalogue.find import Match

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("name", metavar="NAME", help="S13O00+, U83@h=1.9, an id or its beginning, or L11+")
    parser.add_argument("--orbit", metavar="FILE", help="draw the orbit that the name's suffix selects: FILE.png, FILE.pdf or FILE.svg")
    add_json(parser)
    catalogue_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    from saltus.catalogue_records import tell

    if arguments.orbit is not None:
        check_picture(arguments.orbit)
    apart({"--json": arguments.json, "--orbit": arguments.orbit})
    words = words_stream(arguments.json == STANDARD_OUTPUT)
    with catalogue_arguments.opened(arguments) as catalogue:
        match = catalogue.find(arguments.name)
        record = _record(catalogue, match)
        tell(arguments.json, _lines(catalogue, match, record), lambda: record)
        if arguments.orbit is not None:
            drawn = _draw(catalogue, match, arguments.orbit)
            print(f"wrote  {arguments.orbit}: {drawn}", file=words)
    return DONE


def _record(catalogue: Catalogue, match: Match) -> dict[str, Any]:
    """All that there is to say, as plain data."""
    from saltus.catalogue_records import event_record, family_record, node_record

    neighbours = [_neighbour(catalogue, edge, match.id) for edge in catalogue.edges(match.id)]
    if match.kind != "family":
        return {"node": node_record(catalogue, match.id), "neighbours": neighbours}
    row = catalogue.family(match.id)
    events = [event_record(event) for event in catalogue.events(row.id)]
    return {"family": family_record(row), "model": _model(catalogue, row), "events": events, "neighbours": neighbours}


def _model(catalogue: Catalogue, row: FamilyRow) -> list[str]:
    from saltus.model import explain

    return explain(catalogue.system, row.id)


def _neighbour(catalogue: Catalogue, edge: Edge, id: str) -> dict[str, Any]:
    """An edge as it is seen from one of its ends."""
    from saltus.catalogue_records import edge_record, node_record

    out = edge.source == id
    other = (edge.target if out else edge.source) or ""
    event = edge.source_event if out else edge.target_event
    return {"event": event, "direction": "out" if out else "in", "to": node_record(catalogue, other), "edge": edge_record(edge)}


def _lines(catalogue: Catalogue, match: Match, record: dict[str, Any]) -> list[str]:
    """The same in words."""
    from saltus.catalogue_records import impacts_text, range_text
    from saltus.events_table import COLUMNS, event_cells, stability_word
    from saltus.listing import listing, width_of, wrapped

    width = width_of(sys.stdout)
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
        f"ends     {row.ends}  word {row.word or '(none)'}  {impacts_text(row.impacts)}",
        f"energy   h = {row.h[0]:.12g} to {row.h[1]:.12g}",
        f"quarter  alpha = {row.alpha[0]:.12g} to {row.alpha[1]:.12g}",
        f"points   {row.points}, stable over {100.0 * row.stable_fraction:.1f}% of the arclength",
        *(f"ended    at the {place} point: {text}" for place, (_, text) in zip(("first", "last"), row.ended, strict=True)),
        *(f"model    {text}" for text in record["model"]),
    ]
    lines = [*wrapped(lines, width, 9), ""]
    cells = [("label", p.label or "-", *map(range_text, p[1:])) for p in row.labels]
    cells += [("stable", stability_word(p.stable), *map(range_text, p[1:])) for p in row.stability]
    lines += listing(("along it", "", "arclength", "energy h", "quarter alpha"), cells, width=width)
    if row.events:
        cells = [event_cells(event) for event in catalogue.events(row.id)]
        lines += ["", *listing(tuple(COLUMNS.values()), cells, width=width, columns="rllllllt")]
    return lines + _neighbours(neighbours, width)


def _neighbours(neighbours: list[dict[str, Any]], width: int | None) -> list[str]:
    from saltus.listing import listing

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
    return ["", *listing(("event", "meeting", "energy h", "edge", "neighbour", "id", "remark"), rows, width=width, columns="lllllit")]


def _each_once(neighbours: list[dict[str, Any]], edges: list[Edge]) -> list[dict[str, Any]]:
    """The neighbours in their order; of a meeting that both sides tell, what this one tells."""
    from saltus.catalogue_records import same_meeting

    told: list[Edge] = []
    for _, edge in sorted(zip(neighbours, edges, strict=True), key=lambda pair: pair[0]["direction"] == "in"):
        if not any(same_meeting(edge, other) for other in told):
            told.append(edge)
    return [item for item, edge in zip(neighbours, edges, strict=True) if any(edge is other for other in told)]


def _draw(catalogue: Catalogue, match: Match, path: str) -> str:
    """Draw the orbit that a name selects, which is in the middle of the label's range where it has no suffix and no pin; that which the
    family was started from for an id. Return which it is, by the name that selects it."""
    if match.kind != "family":
        raise BadInput(f"{match.id} is a {match.kind}, which has no orbit with impacts to draw")
    from branches.diagram import draw_orbit
    from saltus.orbit_choice import list_orbits

    branch = catalogue.branch(match.id)
    orbit = branch.orbit(branch.start)
    if match.h is not None:
        alpha = match.alpha or orbit.alpha
        found = branch.orbits_at(energy=match.h)
        orbit = min(found, key=lambda item: abs(item.alpha - alpha)) if found else orbit
    with replacing(path) as beside:
        draw_orbit(orbit, beside)
    return f"the orbit {list_orbits([orbit], branch)}"
