"""`saltus export graph|points|orbits --out FILE`: what a catalogue holds, as data."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from saltus import catalogue_arguments, family_filters
from saltus.arguments import whole_above_zero
from saltus.errors import DONE, BadInput, nearest
from saltus.files import STANDARD_OUTPUT, check_writable, output_path, replacing, write_data
from saltus.wording import counted

if TYPE_CHECKING:
    from branches.catalogue import Catalogue
    from branches.export.table_files import Table
    from branches.orbit import Orbit

__all__ = ["add_arguments", "run"]

GRAPHS = {"json": "json", "graphml": "graphml", "dot": "dot", "gv": "dot"}
TABLES = {"csv": "csv", "json": "json", "npz": "npz", "mat": "mat"}
FORMATS = {"graph": GRAPHS, "points": TABLES, "orbits": TABLES}
"""The formats of each thing, by the suffix of a file."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parser.add_argument("names", metavar="NAME", nargs="*", help="orbits: S13O00+@h=1, an id with @h=..; points: the families' names")
    parser.add_argument("--out", metavar="FILE", type=output_path, required=True, help="the suffix tells the format; - is standard output")
    parser.add_argument("--format", metavar="FORMAT", help="in place of the suffix")
    parser.add_argument("--columns", metavar="A,B", help="points: columns, in this order (default: all but the states)")
    parser.add_argument("--samples", metavar="N", type=whole_above_zero, help="orbits: the motion at N times over a period")
    family_filters.add_arguments(parser)
    catalogue_arguments.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    kind = _format(arguments)
    check_writable(arguments.out)
    columns = _columns(arguments)
    with catalogue_arguments.from_arguments(arguments) as catalogue:
        if arguments.what == "graph":
            return _graph(catalogue, arguments, kind)
        if arguments.what == "points":
            from branches.catalogue.tables import points_table

            filters = family_filters.from_arguments(arguments)
            families = catalogue.families(**filters)
            if arguments.names:
                chosen = {catalogue.find(name).id for name in arguments.names}
                families = [row for row in families if row.id in chosen]
            if not families:
                raise family_filters.nothing_fits(str(catalogue.path), len(catalogue), filters, arguments.names)
            table = points_table(catalogue, families, columns)
        else:
            table = _orbits(catalogue, arguments)
    _write(arguments, kind, table, arguments.what)
    count = len(next(iter(table.values())))
    _tell(arguments, f"wrote  {arguments.out}: {counted(count, 'sample' if arguments.samples else arguments.what[:-1])}")
    return DONE


def _format(arguments: argparse.Namespace) -> str:
    """The format asked for."""
    known = FORMATS[arguments.what]
    suffix = arguments.format if arguments.format is not None else Path(arguments.out).suffix.lstrip(".")
    if arguments.out == STANDARD_OUTPUT and arguments.format is None:
        raise BadInput(f"which format for standard output? expected --format {' or '.join(_texts(known))}")
    kind = known.get(suffix.lower())
    if kind is None:
        listed = ", ".join(dict.fromkeys(known.values()))
        raise BadInput(f"unknown format {suffix!r} of {arguments.what}, expected one of {listed}{nearest(suffix, known)}")
    if arguments.out == STANDARD_OUTPUT and kind in ("npz", "mat"):
        raise BadInput(f"{kind} cannot go to standard output: expected a file, or {' or '.join(_texts(known))}")
    return kind


def _texts(known: dict[str, str]) -> list[str]:
    """The formats that can go to standard output."""
    return [kind for kind in dict.fromkeys(known.values()) if kind not in ("npz", "mat")]


def _columns(arguments: argparse.Namespace) -> tuple[str, ...]:
    """The columns asked for, of points."""
    if arguments.columns is not None and arguments.what != "points":
        raise BadInput(f"--columns is for points, not for {arguments.what}")
    if arguments.samples is not None and arguments.what != "orbits":
        raise BadInput(f"--samples is for orbits, not for {arguments.what}")
    if arguments.what != "points":
        return ()

    from branches.catalogue.tables import DEFAULT_COLUMNS, POINT_NAMES

    if arguments.columns is None:
        return DEFAULT_COLUMNS
    names = tuple(name.strip() for name in arguments.columns.split(","))
    for name in names:
        if name not in POINT_NAMES:
            hint = nearest(name, POINT_NAMES) or f", expected some of {', '.join(POINT_NAMES)}"
            raise BadInput(f"unknown column {name!r} of points{hint}")
        if names.count(name) > 1:
            raise BadInput(f"column {name!r} is asked for {names.count(name)} times, expected each column once")
    return names


def _graph(catalogue: Catalogue, arguments: argparse.Namespace, kind: str) -> int:
    from branches.catalogue.graph_files import FLATTENED, graph_text

    graph = catalogue.graph()
    filters = family_filters.from_arguments(arguments)
    if arguments.names or family_filters.told(filters):
        kept = {row.id for row in catalogue.families(**filters)}
        if arguments.names:
            kept &= {catalogue.find(name).id for name in arguments.names}
        dropped = [id for id, data in graph.nodes(data=True) if data["kind"] == "family" and id not in kept]
        graph.remove_nodes_from(dropped)
        graph.remove_nodes_from([id for id, data in graph.nodes(data=True) if data["kind"] == "dead end" and not graph.degree(id)])
    write_data(arguments.out, graph_text(graph, kind))
    if kind != "json":
        _tell(arguments, f"note   {FLATTENED.format(kind)}")
    _tell(arguments, f"wrote  {arguments.out}: {counted(graph.number_of_nodes(), 'node')}, {counted(graph.number_of_edges(), 'edge')}")
    return DONE


def _orbits(catalogue: Catalogue, arguments: argparse.Namespace) -> Table:
    """The orbits that are named, or those that the families chosen have at an energy."""
    from branches.catalogue.tables import orbit_rows, orbit_samples

    found: list[tuple[str, Orbit]] = []
    filters = family_filters.from_arguments(arguments)
    if arguments.names:
        if family_filters.told(filters):
            asked = family_filters.words(filters)
            raise BadInput(f"names and {asked} both choose orbits; expected names, or --energy H for all that cross it")
        for name in arguments.names:
            match = catalogue.find(name)
            if match.kind != "family":
                raise BadInput(f"{match.id} is a {match.kind}, which has no orbit with impacts; expected the name of an impacting family")
            if "@" not in name:
                raise BadInput(f"which orbit of {name}? expected {name}@h=.. or @alpha=..")
            branch = catalogue.branch(match.id)
            assert match.h is not None and match.alpha is not None
            orbits = branch.orbits_at(energy=match.h) if "h=" in name else branch.orbits_at(alpha=match.alpha)
            if not orbits:
                raise BadInput(f"the orbit {name} could not be solved for; expected one farther from the end of its family")
            found.append((match.id, min(orbits, key=_distance_to(match.h, match.alpha))))
    elif arguments.energy is None:
        raise BadInput("which orbits? expected names such as S13O00+@h=1, or --energy H for all families that cross it")
    else:
        for row in catalogue.families(**filters):
            found += [(row.id, orbit) for orbit in catalogue.branch(row.id).orbits_at(energy=arguments.energy)]
        if not found:
            raise family_filters.nothing_fits(str(catalogue.path), len(catalogue), filters)
    return orbit_samples(found, arguments.samples) if arguments.samples else orbit_rows(found)


def _distance_to(h: float, alpha: float) -> Callable[[Orbit], float]:
    return lambda orbit: abs(orbit.h / h - 1.0) + abs(orbit.alpha / alpha - 1.0)


def _write(arguments: argparse.Namespace, kind: str, table: Table, name: str) -> None:
    from branches.export.table_files import BINARY, table_text, write_binary

    if kind not in BINARY:
        write_data(arguments.out, table_text(table, kind, "samples" if arguments.samples else name))
        return
    with replacing(arguments.out) as beside, beside.open("wb") as file:
        write_binary(table, kind, file)


def _tell(arguments: argparse.Namespace, words: str) -> None:
    """Say something where standard output does not carry the data."""
    if arguments.out != STANDARD_OUTPUT:
        print(words)
