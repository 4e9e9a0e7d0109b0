"""`saltus show NAME`: one family of a catalogue, with its labels, events, neighbours and stability; a curve; or a file of them."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from branches.events import FREE_NORMAL_FORMS, BranchEvent
from saltus import catalogues, compiling, curves, inputs, outputs, responses
from saltus.catalogues import SCHEMA, edge_record, event_record, family_record, impacts_text, node_record, printed_event, same_meeting
from saltus.errors import BadInput
from saltus.terminal import EVENT_COLUMNS, event_cells, range_text, stability_word, table_lines, terminal_width, wrapped

if TYPE_CHECKING:
    from branches.catalogue import Catalogue, Edge
    from branches.catalogue.curves import CurveRow
    from branches.catalogue.find import NameMatch
    from branches.catalogue.rows import Axes
    from branches.orbit import Orbit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    what = "S13O00+, U83@h=1.9, an id or its beginning, L11+, or a JSON file of responses or curves"
    parser.add_argument("name", metavar="NAME", help=what)
    outputs.add_arguments(
        parser, "json", plot="draw the orbit that the suffix of NAME selects, a response, or a curve: FILE.png, FILE.pdf or FILE.svg"
    )
    catalogues.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    if inputs.is_response_file(arguments.name):
        return responses.show(arguments)
    if inputs.is_curve_file(arguments.name):
        return curves.show(arguments)
    files = outputs.outputs_of(arguments)

    from branches.catalogue.curves import find_curve

    with catalogues.open_catalogue(arguments) as catalogue:
        try:
            match = catalogue.find(arguments.name)
        except ValueError:
            row = find_curve(catalogue, arguments.name)
            if row is None:
                curves.refuse_curve(catalogue, arguments.name)
                raise
            return _curve(catalogue, row, files)
        events = tuple(printed_event(catalogue, event) for event in _events(catalogue, match.id)) if match.kind == "family" else ()
        record = catalogues.in_axes(catalogue, _record(catalogue, match, events))
        lines = _lines(catalogue, match, events)
        figure: outputs.Drawing
        if catalogue.scene.parameters:
            branches = [catalogue.branch(match.id)] if match.kind == "family" else []
            if "plot" in files.places and not branches:
                raise BadInput(f"{match.id} is a {match.kind}, which has no curve to draw")
            figure, shown = ("transitions.response.figure:response_figure", branches, {"title": catalogue.scene.title}), match.id
        else:
            orbit, name = _orbit(catalogue, match) if "plot" in files.places else (None, "")
            figure, shown = ("branches.figures.single:orbit_figure", orbit, {}), f"the orbit {name}"
    return files.finish(lines, lambda: record, figure=figure, notes={"plot": shown})


def _curve(catalogue: Catalogue, row: CurveRow, files: outputs.Outputs) -> int:
    """Print a curve, and write its files; return the exit code."""
    record = catalogues.in_axes(catalogue, curves.row_record(catalogue, row))
    drawn = [catalogue.curve(row.id)] if "plot" in files.places else []
    return files.finish(
        curves.row_lines(catalogue, row, terminal_width(sys.stdout)),
        lambda: {"schema": SCHEMA, "curve": record},
        figure=("branches.curves.figure:curve_figure", drawn, {"title": catalogue.scene.title}),
        notes={"plot": row.id},
    )


def _events(catalogue: Catalogue, id: str) -> tuple[BranchEvent, ...]:
    """The events of a family. Normal forms that the catalogue lacks are computed."""
    events = catalogue.events(id)
    forms = catalogue.family(id).normal_forms
    if forms or not any(event.type in FREE_NORMAL_FORMS for event in events):
        return events
    from branches.normal_forms import with_normal_forms

    compiling.prepare("continue")
    found: tuple[BranchEvent, ...] = with_normal_forms(catalogue.branch(id)).events
    return found


def _record(catalogue: Catalogue, match: NameMatch, events: tuple[BranchEvent, ...]) -> dict[str, Any]:
    """A family or linear mode with its events and neighbours, as plain data."""
    from saltus.scene.model import explain

    neighbours = [_neighbour(catalogue, edge, match.id) for edge in catalogue.edges(match.id)]
    if match.kind != "family":
        return {"schema": SCHEMA, "node": node_record(catalogue, match.id), "neighbours": neighbours}
    row = catalogue.family(match.id)
    family: dict[str, Any] = {"schema": SCHEMA, "family": family_record(catalogue, row)}
    found = list(map(event_record, events))
    if catalogue.scene.parameters:
        through = [{"curve": curve.id, "edge": edge_record(edge)} for curve, edge in catalogue.curve_edges(row.id)]
        return {**family, "path": catalogue.scene.parameters, "events": found, "neighbours": neighbours, "curves": through}
    return {**family, "model": explain(catalogue.system, row.id), "events": found, "neighbours": neighbours}


def _neighbour(catalogue: Catalogue, edge: Edge, id: str) -> dict[str, Any]:
    """An edge as it is seen from one of its ends."""
    out = edge.source == id
    other = (edge.target if out else edge.source) or ""
    event = edge.source_event if out else edge.target_event
    return {"event": event, "direction": "out" if out else "in", "to": node_record(catalogue, other), "edge": edge_record(edge)}


def _lines(catalogue: Catalogue, match: NameMatch, events: tuple[BranchEvent, ...]) -> list[str]:
    """The same in words."""
    from saltus.scene.model import explain

    width, axes = terminal_width(sys.stdout), catalogue.scene.axes
    edges = catalogue.edges(match.id)
    neighbours = _each_once([_neighbour(catalogue, edge, match.id) for edge in edges], edges)
    if match.kind != "family":
        node = node_record(catalogue, match.id)
        lines = [f"{node['kind']}  {node['id']}"]
        if node["h"] is not None:
            lines.append(f"energy   h = {node['h'][0]:.10g} to {node['h'][1]:.10g}, where it grazes a stop")
        return lines + _neighbours(neighbours, width, axes)
    row = catalogue.family(match.id)
    if row.response is None:
        lines = [
            f"family   {row.id}",
            f"label    {family_record(catalogue, row)['label'] or '(outside the grammar of labels)'}",
            *([f"name     {match.note}"] if match.note else []),
            f"ends     {row.ends}  sequence {row.sequence or '(none)'}  {impacts_text(row.impacts)}",
            f"energy   h = {row.h[0]:.12g} to {row.h[1]:.12g}",
            f"quarter  alpha = {row.alpha[0]:.12g} to {row.alpha[1]:.12g}",
        ]
        model = explain(catalogue.system, row.id)
    else:
        path, model = catalogue.scene.parameters, []
        what, of = ("ends", "") if catalogue.scene.is_free else ("closure", " of the loads")
        lines = [
            f"family   {row.id}",
            f"{what:<7}  {row.ends}  sequence {row.sequence or '(none)'}  {row.impacts:g} impacts in a period{of}",
            f"in       {axes.symbols[0]} = {row.h[0]:.12g} to {row.h[1]:.12g}" + "".join(f", with {text}" for text in path["keep"]),
            f"period   T = {row.alpha[0]:.12g} to {row.alpha[1]:.12g}",
        ]
    lines += [
        f"points   {row.points}, stable over {100.0 * row.stable_fraction:.1f}% of the arclength",
        *(f"ended    at the {place} point: {text}" for place, (_, text) in zip(("first", "last"), row.ended, strict=True)),
        *(f"model    {text}" for text in model),
    ]
    lines = [*wrapped(lines, width, 9), ""]
    cells: list[tuple[str, ...]] = []
    if row.response is None:
        names = [part["label"] for part in family_record(catalogue, row)["labels"]]
        cells += [("label", name or "-", *map(range_text, p[1:])) for name, p in zip(names, row.labels, strict=True)]
    cells += [("stable", stability_word(p.value), *map(range_text, p[1:])) for p in row.stability]
    lines += table_lines(("along it", "", "arclength", *axes.names), cells, width=width)
    if events:
        cells = list(map(event_cells, events))
        head: tuple[str, ...] = (*EVENT_COLUMNS[:3], *axes.names, *EVENT_COLUMNS[5:])
        columns = "rlllllllt"
        if row.response is not None:  # its events have no label
            cells, head, columns = [(*line[:2], *line[3:]) for line in cells], (*head[:2], *head[3:]), "rllllllt"
        lines += ["", *table_lines(head, cells, width=width, columns=columns)]
    return lines + _neighbours(neighbours, width, axes) + curves.catalogue_lines(catalogue, row.id, width)


def _neighbours(neighbours: list[dict[str, Any]], width: int | None, axes: Axes) -> list[str]:
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
    head = ("event", "meeting", axes.names[0], "edge", "neighbour", "id", "remark")
    return ["", *table_lines(head, rows, width=width, columns="lllllit")]


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
    from saltus.families import branch_of, list_orbits

    branch = branch_of(match, match.id, catalogue)
    orbit = branch.orbit(branch.start)
    if match.h is not None:
        alpha = match.alpha or orbit.alpha
        found = branch.orbits_at(energy=match.h)
        orbit = min(found, key=lambda item: abs(item.alpha - alpha)) if found else orbit
    return orbit, list_orbits([orbit], branch)
