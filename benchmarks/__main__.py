"""`python -m benchmarks TASK`: the one entry of the benchmarks. Without a task it is `speed-error`."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from saltus.errors import BAD_INPUT, FAILED, INTERRUPTED, BadInput, exit_code, nearest, one_line
from saltus.options import OneLineParser
from saltus.processes import one_thread

__all__ = ["TASKS", "main"]

PROGRAM = "python -m benchmarks"

DEFAULT = "speed-error"

TASKS = {
    DEFAULT: ("speed_error.command:add_arguments", "speed against error, beside scipy, the paper's method and AUTO-07p (the default task)"),
    "continuation": ("continuation:add_arguments", "a point of a family beside shooting, its layers, full families, memory, processes"),
    "building": ("catalogues:building_arguments", "building a catalogue: time, memory, size"),
    "browsing": ("catalogues:browsing_arguments", "size of a catalogue, and times of the commands that read it"),
    "sections": ("motions:section_arguments", "Poincare sections beside scipy's integrator"),
    "studies": ("motions:study_arguments", "many damped runs beside scipy's integrator"),
    "hard-cases": ("hard_cases:add_arguments", "errors of the hard cases, into docs/reference/hard_cases.md"),
    "orbit": ("orbit:add_arguments", "one orbit by the paper's nonsmooth time transformation, beside the exact one"),
}
"""Summary of each task, and the function that fills its parser and sets `run`, which returns the exit code."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a task from its command line.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; by default those of the process.

    Returns
    -------
    int
        0 done; 1 something could not be measured; 2 bad input, nothing started; 130 interrupted.
    """
    one_thread()
    words = list(sys.argv[1:] if argv is None else argv)
    if not words or (words[0].startswith("-") and words[0] not in ("-h", "--help")):
        words = [DEFAULT, *words]
    try:
        return _run(words)
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted, nothing was written", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        code = exit_code(error)
        if code not in (BAD_INPUT, FAILED):
            raise
        print(f"{PROGRAM}: {one_line(error)}", file=sys.stderr)
        return code


def _run(words: list[str]) -> int:
    name = words[0]
    if not name.startswith("-") and name not in TASKS:
        raise BadInput(f"unknown task {name!r}, expected {' or '.join(TASKS)}{nearest(name, TASKS)}")
    parser = OneLineParser(prog=PROGRAM, description="Benchmarks of saltus, from a checkout.")
    tasks = parser.add_subparsers(metavar="TASK", title="tasks")
    for task, (place, summary) in TASKS.items():
        chosen = tasks.add_parser(task, help=summary, description=summary[0].upper() + summary[1:] + ".")
        if task == name:
            # Only the module of the wanted task is imported.
            module, _, function = place.partition(":")
            getattr(importlib.import_module(f"benchmarks.{module}"), function)(chosen)
            parser_of_task = chosen
    arguments, unknown = parser.parse_known_args(words)
    if unknown:
        parser_of_task.refuse(unknown[0], words)
    return int(arguments.run(arguments))


if __name__ == "__main__":
    sys.exit(main())
