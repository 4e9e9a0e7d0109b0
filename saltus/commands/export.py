"""`saltus export WHAT --out FILE`: what a catalogue holds, as pictures or as data."""

from __future__ import annotations

import argparse
from typing import Any

from saltus.commands import export_data, export_picture
from saltus.errors import BadInput, nearest

__all__ = ["add_arguments", "run"]

WHAT: dict[str, tuple[Any, str]] = {
    "fep": (export_picture, "frequency-energy plot: a picture, or its data"),
    "velocities": (export_picture, "start velocities against energy: a picture, or its data"),
    "graph": (export_data, "the graph: json (node-link), graphml, dot"),
    "points": (export_data, "a row a point: csv, json, npz, mat"),
    "orbits": (export_data, "a row an orbit: csv, json, npz, mat"),
}


class _Choice(dict[str, Any]):
    """The parsers of what can be exported; a word that is none of them is answered with the nearest."""

    def __contains__(self, word: object) -> bool:
        if not super().__contains__(word):
            raise BadInput(f"cannot export {word!r}, expected {', '.join(self)}{nearest(str(word), self)}")
        return True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    parsers = parser.add_subparsers(dest="what", metavar="WHAT", title="what is written", required=True)
    for what, (module, summary) in WHAT.items():
        part = parsers.add_parser(what, help=summary, description=summary[0].upper() + summary[1:] + ".")
        module.add_arguments(part)
        part.set_defaults(parser=part)
    parsers.choices = parsers._name_parser_map = _Choice(parsers.choices)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked; return the exit code."""
    code: int = WHAT[arguments.what][0].run(arguments)
    return code
