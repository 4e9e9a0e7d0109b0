"""`saltus check`: verify every checksum, point, edge and curve of a catalogue. It repairs nothing."""

from __future__ import annotations

import argparse

from saltus import catalogues, compiling, options, outputs
from saltus.errors import DONE, FAILED
from saltus.terminal import ProgressBar, counted

THINGS = {"families": "family", "points": "point", "events": "event", "edges": "edge"}
"""What is counted, and what one of it is called."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of the command."""
    catalogues.add_arguments(parser)
    outputs.add_arguments(parser, "json")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; return the exit code, 1 if a check fails."""
    files = outputs.outputs_of(arguments)

    with catalogues.open_catalogue(arguments) as catalogue:
        scene = catalogue.scene
        compiling.prepare("parameter" if scene.is_free else "response" if scene.parameters else "continue")

        from branches.catalogue.check import check_catalogue

        with ProgressBar(len(catalogue), "families") as bar:
            counts, failures = check_catalogue(catalogue, bar.update)
    lines = options.parameter_lines(options.scene_of(arguments)) if arguments.scene is not None else []
    things = THINGS | ({"curves": "curve"} if counts["curves"] else {})
    looked = ", ".join(counted(counts[name], thing) for name, thing in things.items())
    lines += [f"FAILS  {failure.where}: {failure.text}" for failure in failures]
    lines.append(f"{looked} looked at: " + (f"{counted(len(failures), 'failure')}" if failures else "all hold"))
    if counts["hidden"]:
        lines.append(f"{counted(counts['hidden'], 'event')} hidden by rounding: stability changes there, seen in fifty digits")
    code = files.finish(lines, lambda: {"counts": counts, "failures": [failure._asdict() for failure in failures]})
    return max(code, FAILED if failures else DONE)
