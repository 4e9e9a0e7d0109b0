"""Curves in the plane of two parameters: their files on the command line, what is printed of them, and catalogues that keep them."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from saltus import __version__, catalogues, inputs, outputs
from saltus.errors import BadInput, nearest, one_line
from saltus.terminal import table_lines, terminal_width

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from branches.catalogue.curves import CurveRow
    from branches.catalogue.rows import SceneRecord
    from branches.curves.record import BifurcationCurve
    from branches.forced.branch import ForcedBranch, ForcedEvent

__all__ = [
    "catalogue_lines", "in_catalogue", "interval_on", "list_lines", "no_curve", "place_named", "refuse_curve", "report_lines",
    "require_plane", "row_lines", "row_record", "rows_record", "save", "show", "start_line", "write",
]  # fmt: skip

_POINT = re.compile(r"(?:(\d+)\.)?#(.*)")


def place_named(curves: Sequence[BifurcationCurve], source: str, place: str | None) -> tuple[BifurcationCurve, int, str]:
    """The curve, the index of its point, and the name of a place: an event, CP1, or the number of a point, #120; of the second curve and
    later ones with its number before it, 2.CP1 and 2.#120."""
    from branches.forced.record import named_events

    known = named_events(curves)
    match = _POINT.fullmatch(place or "")
    if match:
        number = int(match[1] or 1)
        if not 1 <= number <= len(curves):
            raise BadInput(f"{source}:{place}: there is no curve {number}; expected 1 to {len(curves)}")
        curve = curves[number - 1]
        if not match[2].isdecimal() or int(match[2]) >= len(curve):
            raise BadInput(f"{source}:{place}: no such point; the curve has the points #0 to #{len(curve) - 1}")
        return curve, int(match[2]), match[0]
    key = inputs.event_named(source, place, known, f", and points by number, #N from #0 to #{len(curves[0]) - 1}")
    curve, event = known[key]
    return curve, event.point, key


def interval_on(curve: BifurcationCurve, source: str, name: str, given: tuple[float, float] | None) -> tuple[float, float]:
    """The range of a parameter that is given, else that of a curve."""
    if given is None and name not in curve.names:
        raise BadInput(f"--range LO:HI is required: {source} has no range of {name}")
    return given or curve.window[curve.names.index(name)]


def start_line(curve: BifurcationCurve, index: int, source: str | None, name: str | None) -> str:
    """The line about a family that starts at a point of a curve."""
    where = " and ".join(f"{name} = {value:.12g}" for name, value in zip(curve.names, curve.parameters[index].tolist(), strict=True))
    return f"start  {name} of {source}, a point of a curve {curve.code} at {where}"


def require_plane(names: Sequence[str]) -> None:
    """Refuse parameters of ``--in`` that span no plane."""
    if len(names) < 2:
        raise BadInput(f"--in {','.join(names)}: a curve lies in the plane of two parameters; received {len(names)}, expected P1,P2")


# -- printing -----------------------------------------------------------------------------------------------------------------


def report_lines(curve: BifurcationCurve, width: int | None, number: int | None = None) -> list[str]:
    """The table of a curve's points of codimension two, and its ends."""
    (first, second), values = curve.shown
    low, high = values.min(axis=0), values.max(axis=0)
    title = f"curve  {curve.code}" if number is None else f"curve {number}: {curve.code}"
    lines = [f"{title}: {len(curve)} points, {first} = {low[0]:.8g} to {high[0]:.8g}, {second} = {low[1]:.8g} to {high[1]:.8g}"]
    rows = []
    for event in curve.events:
        a, b = values[event.point]
        rows.append((event.id, f"{a:.14g}", f"{b:.14g}", event.status, event.note or ""))
    if rows:
        lines += table_lines(("event", first, second, "status", "remark"), rows, width=width, columns="lrrlt")
    missed = _CHANGES.get(curve.code)
    if missed is not None and all(map(math.isnan, curve.coefficient.tolist())):
        lines.append(f"note   the coefficient of the normal form is not known along the curve: a point {missed} on it is not found")
    lines += dict.fromkeys(f"end    {end.text}" for end in curve.ended)
    return lines


_CHANGES = {"SB": "DP", "PD": "GPD", "NS": "GH"}
"""Where the criticality changes."""


def show(arguments: argparse.Namespace) -> int:
    """Print what a file of curves has, and draw it; return the exit code."""
    files = outputs.outputs_of(arguments)
    curves = inputs.curves_in(arguments.name)
    if not files.to_stdout:
        for number, curve in enumerate(curves, 1):
            files.report(report_lines(curve, terminal_width(files.words), number if len(curves) > 1 else None))
    return write(files, curves, os.path.basename(arguments.name))


def write(files: outputs.Outputs, curves: Sequence[BifurcationCurve], title: str) -> int:
    """Write the files of some curves of one system; return the exit code."""
    from branches.curves.files import curves_record, curves_table

    if "plot" in files.places:
        other = next((curve for curve in curves if set(curve.names) != set(curves[0].names)), None)
        if other is not None:
            planes = " and ".join(",".join(curve.names) for curve in (curves[0], other))
            raise BadInput(f"--plot shows one plane of two parameters; received curves in {planes}, expected those of one of them")
    return files.write(
        {"json": lambda: outputs.json_text(curves_record(curves))},
        table=lambda: curves_table(curves),
        about=lambda: outputs.json_text({key: value for key, value in curves_record(curves).items() if key != "curves"}),
        figure=("branches.curves.figure:curve_figure", curves, {"title": title}),
    )


# -- catalogues ---------------------------------------------------------------------------------------------------------------


def in_catalogue(catalogue: Catalogue, text: str) -> tuple[Any, str | None]:
    """The family (`ForcedBranch`) or the curve (`BifurcationCurve`) of ID[:EVENT] in a catalogue, and the event."""
    from branches.catalogue.curves import find_curve
    from branches.naming.matching import NameNotFound

    if not catalogue.scene.parameters:
        raise BadInput(f"{catalogue.path} holds families in the energy; expected a catalogue of responses")
    head, _, last = text.rpartition(":")
    for name, event in ((text, None), (head, last)):
        if not name:
            continue
        row = find_curve(catalogue, name)
        if row is not None:
            return catalogue.curve(row.id), event
        try:
            return catalogue.branch(catalogue.find(name).id), event
        except (NameNotFound, ValueError):
            continue
    known = ", ".join([row.id for row in catalogue.all_families()] + [row.id for row in catalogue.curve_rows()]) or "nothing"
    raise BadInput(f"{catalogue.path} has no family and no curve {head or text}; it has {known}")


def no_curve(catalogue: Catalogue, name: str) -> BadInput:
    """The error for a curve that a catalogue does not have."""
    known = [row.id for row in catalogue.curve_rows()]
    return BadInput(f"{catalogue.path} has no curve {name}{nearest(name, known) or '; it has ' + (', '.join(known) or 'none')}")


def refuse_curve(catalogue: Catalogue, name: str) -> None:
    """Refuse the id of a curve that a catalogue does not have; do nothing for another name."""
    from branches.curves.record import WORDS

    if name.partition(":")[0] in WORDS and ":" in name:
        raise no_curve(catalogue, name)


def save(
    curve: BifurcationCurve, place: Path, record: SceneRecord | None, begins: tuple[ForcedBranch, ForcedEvent] | None = None
) -> list[str]:
    """Keep a curve in a catalogue, and the family that has the event it starts at; return lines about the result.

    Parameters
    ----------
    curve : BifurcationCurve
    place : Path
    record : SceneRecord or None
        The scene of a catalogue that is made if there is none.
    begins : (ForcedBranch, ForcedEvent), optional
        The event and its family.
    """
    from branches.catalogue import Catalogue
    from branches.catalogue.curves import edges_of
    from branches.catalogue.responses import kept_branch
    from branches.catalogue.widening import CannotWiden, Kept

    words = {Kept.NEW: "saved", Kept.KNOWN: "known", Kept.WIDER: "wider"}
    lines = []
    with Catalogue(place, "a", scene=record, provenance={"saltus": __version__}) as catalogue:
        if begins is not None:
            branch = kept_branch(catalogue, begins[0])
            name = record.parameters["names"][0] if record is not None else branch.name
            try:
                lines.append(catalogues.keep_branch(catalogue, place, branch, name, branch.parameter))
            except CannotWiden as refused:
                lines.append(f"note   {one_line(refused)}")
        kept, id = catalogue.keep_curve(curve)
        row = next(row for row in catalogue.curve_rows() if row.id == id)
        spans = ", ".join(catalogues.range_line(name, *span) for name, span in zip(row.names, row.ranges, strict=True))
        lines.append(f"{words[kept]}  {id} in {place}, with {spans}")
        edges = list(edges_of(catalogue, row))
        lines += [f"edge   {edge.source} {edge.source_event}: {_other_side(edge)}" for edge in edges]
        if not edges:
            lines.append(f"note   {place} has no family with an event on the curve: expected one saved, too")
    return lines


def _other_side(edge: Any) -> str:
    """The other side of a curve, in words."""
    if edge.target != edge.source:
        return f"curve to {edge.target} {edge.target_event}".rstrip()
    return f"curve; {edge.note}, not in the catalogue" if edge.note else "curve; the family is on both sides"


def catalogue_lines(catalogue: Catalogue, id: str, width: int | None) -> list[str]:
    """The table of the curves through the events of a family; nothing without one."""
    rows = []
    for curve, edge in catalogue.curve_edges(id):
        event, other, there = edge.source_event, edge.target, edge.target_event
        if edge.source != id:
            event, other, there = edge.target_event, edge.source, edge.source_event
        spans = [f"{name} {low:.6g}:{high:.6g}" for name, (low, high) in zip(curve.names, curve.ranges, strict=True)]
        rows.append((event or "-", curve.id, *spans, "same" if other == id else str(other), "" if other == id else there, edge.note or ""))
    head = ("event", "curve", "first parameter", "second parameter", "other side", "its event", "remark")
    return ["", *table_lines(head, rows, width=width, columns="lillilt")] if rows else []


def rows_record(catalogue: Catalogue) -> list[dict[str, Any]]:
    """The curves of a catalogue in a few words, as plain data."""
    return [
        {
            "id": row.id, "code": row.code, "names": list(row.names), "ranges": [list(span) for span in row.ranges], "points": row.points,
            "events": row.events,
        }
        for row in catalogue.curve_rows()
    ]  # fmt: skip


def list_lines(records: Sequence[dict[str, Any]], width: int | None) -> list[str]:
    """The table of the curves of a catalogue; nothing without one."""
    rows = []
    for record in records:
        spans = [f"{name} {low:.6g}:{high:.6g}" for name, (low, high) in zip(record["names"], record["ranges"], strict=True)]
        rows.append((record["id"], *spans, str(record["points"]), str(record["events"])))
    head = ("curve", "first parameter", "second parameter", "points", "events")
    return ["", *table_lines(head, rows, width=width, columns="illrr")] if rows else []


def row_record(catalogue: Catalogue, row: CurveRow) -> dict[str, Any]:
    """A stored curve without its points, as plain data, and its edges."""
    from branches.catalogue.curves import edges_of

    edges = list(map(catalogues.edge_record, edges_of(catalogue, row)))
    first, second = ({"name": name, "range": list(span)} for name, span in zip(row.names, row.ranges, strict=True))
    header = row.header
    return {
        "id": row.id, "code": row.code, "first": first, "second": second, "points": row.points, "closed": header["closed"],
        "origin": header["origin"], "window": header["window"], "ended": header["ended"], "events": header["events"], "edges": edges,
    }  # fmt: skip


def row_lines(catalogue: Catalogue, row: CurveRow, width: int | None) -> list[str]:
    """What is printed of a stored curve: its points of codimension two, its ends, and the families on its sides."""
    from branches.catalogue.curves import edges_of
    from branches.curves.record import WORDS
    from saltus.terminal import wrapped

    header = row.header
    spans = [f"{name} = {low:.12g} to {high:.12g}" for name, (low, high) in zip(row.names, row.ranges, strict=True)]
    lines = [
        f"curve    {row.id}",
        f"type     {WORDS[row.code]}",
        f"plane    {', '.join(spans)}",
        f"points   {row.points}" + (", closed" if header["closed"] else ""),
        f"started  at {header['origin'] or 'a point'}",
        *(f"ended    at the {place} point: {end['text']}" for place, end in zip(("first", "last"), header["ended"], strict=True)),
    ]
    lines = wrapped(lines, width, 9)
    rows = [
        (event["id"], *(f"{event['values'][name]:.14g}" for name in row.names), event["status"], event["note"] or "")
        for event in header["events"]
    ]  # fmt: skip
    if rows:
        lines += ["", *table_lines(("event", *row.names, "status", "remark"), rows, width=width, columns="lrrlt")]
    symbol = catalogue.scene.axes.symbols[0]
    sides = [
        (f"{edge.h:.10g}", edge.source, edge.source_event, str(edge.target), edge.target_event, edge.note or "")
        for edge in edges_of(catalogue, row)
    ]  # fmt: skip
    if not sides:
        return [*lines, "", "sides    no family of the catalogue has an event on the curve"]
    head = (symbol, "family", "event", "other side", "its event", "remark")
    return [*lines, "", *table_lines(head, sides, width=width, columns="lililt")]
