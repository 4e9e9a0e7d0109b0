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
    DEFAULT: "speed against error, beside scipy, the paper's method and AUTO-07p (the default task)",
    "continuation": "a point of a family beside shooting, its layers, full families, memory, processes",
    "before-now": "an earlier commit and this one, each in its own environment: first runs, warm runs, points, multipliers",
    "building": "building a catalogue: time, memory, size",
    "browsing": "size of a catalogue, and times of the commands that read it",
    "sections": "Poincare sections beside scipy's integrator",
    "studies": "many damped runs beside scipy's integrator",
    "forced": "a point of a forced family beside AUTO-07p, and beside one period by scipy's integrator",
    "curves": "a point of a curve of bifurcations in two parameters beside a point of the family that it crosses",
    "smooth": "a point of a smooth family beside AUTO-07p, and beside shooting by scipy",
    "sweeps": "impacts a second of forced motion beside scipy's integrator",
    "hard-cases": "errors of the hard cases, into docs/reference/hard_cases.md",
    "functions": "elementary functions of the core beside the system's library; derivatives by jets",
    "kernels": "write the list of the kernels that each command calls, which are compiled before it starts",
    "orbit": "one orbit by the paper's nonsmooth time transformation, beside the exact one",
}
"""Summary of each task."""

_MODULES = {
    DEFAULT: "speed_error.command", "building": "catalogues", "browsing": "catalogues", "sections": "motions", "studies": "motions",
}  # fmt: skip
"""Modules of the tasks that have another name than their task."""


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
    parsers = {task: tasks.add_parser(task, help=text, description=f"{text[0].upper()}{text[1:]}.") for task, text in TASKS.items()}
    if name in TASKS:
        # Only the module of the wanted task is imported. Its function fills the parser and sets `run`, which returns the exit code.
        own = name.replace("-", "_")
        module = importlib.import_module(f"benchmarks.{_MODULES.get(name, own)}")
        fill = getattr(module, f"{own}_arguments", None) or module.add_arguments
        fill(parsers[name])
    arguments, unknown = parser.parse_known_args(words)
    if unknown:
        parsers[name].refuse(unknown[0])
    return int(arguments.run(arguments))


if __name__ == "__main__":
    sys.exit(main())
