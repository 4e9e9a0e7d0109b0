"""Measure saltus' continuation: time and error of a point beside scipy, its layers, whole families, memory, whole processes.

    python -m benchmarks.continuation                      print all tables (about ten minutes)
    python -m benchmarks.continuation --quick              the same with few repeats (below a minute)
    python -m benchmarks.continuation --out docs/speed.md  and put the tables into the page
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from importlib import import_module

from saltus.arguments import OneLineParser
from saltus.errors import BAD_INPUT, DONE, FAILED, INTERRUPTED, BadInput, exit_code, nearest, one_line

__all__ = ["main"]

SECTIONS = {
    "points": "point_tables",
    "layers": "point_tables",
    "families": "whole_tables",
    "memory": "whole_tables",
    "processes": "whole_tables",
}
"""The sections in the order in which they are measured, and the module that holds the function of that name."""

PROGRAM = "python -m benchmarks.continuation"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark from its command line.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; by default those of the process.

    Returns
    -------
    int
        0 done; 1 something could not be measured; 2 bad input, nothing started; 130 interrupted.
    """
    try:
        return _run(argv)
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted, no page was written", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        code = exit_code(error)
        if code not in (BAD_INPUT, FAILED):
            raise
        print(f"{PROGRAM}: {one_line(error)}", file=sys.stderr)
        return code


def _run(argv: Sequence[str] | None) -> int:
    parser = OneLineParser(prog=PROGRAM, description="Speed and memory of continuation, beside what is measured in the same run.")
    parser.add_argument("--quick", action="store_true", help="few repeats: below a minute, for a look")
    parser.add_argument("--only", metavar="SECTION", action="append", help=f"one of {', '.join(SECTIONS)}; may be given several times")
    parser.add_argument("--out", metavar="PAGE", help="a Markdown page; the tables go between its two marks")
    arguments, unknown = parser.parse_known_args(argv)
    if unknown:
        parser.refuse(unknown[0], sys.argv[1:] if argv is None else argv)
    for name in arguments.only or ():
        if name not in SECTIONS:
            raise BadInput(f"unknown section {name!r}, expected one of {', '.join(SECTIONS)}{nearest(name, SECTIONS)}")
    if arguments.out is not None and (arguments.only or arguments.quick):
        raise BadInput("--out writes a whole page of settled figures; expected no --only and no --quick with it")

    from saltus.bench.tables import check_page, write_page

    if arguments.out is not None:
        check_page(arguments.out)

    from benchmarks.effort import FULL, QUICK
    from saltus.bench.machine import describe

    machine = describe()
    print("\n".join(machine), end="\n\n")
    began = time.perf_counter()
    tables = []
    for name, module in SECTIONS.items():
        if not arguments.only or name in arguments.only:
            section = getattr(import_module(f"benchmarks.{module}"), name)
            table = section(QUICK if arguments.quick else FULL, _say)
            tables.append(table)
            print(table.text(), flush=True)
    took = f"Measured in {time.perf_counter() - began:.0f} s by `{PROGRAM}{' --quick' if arguments.quick else ''}`."
    print(took)
    if arguments.out is not None:
        write_page(arguments.out, "\n\n".join(["\n".join([*machine, took]), *(table.markdown() for table in tables)]))
    return DONE


def _say(text: str) -> None:
    """Progress, on standard error where that is a terminal."""
    if sys.stderr.isatty():
        print(f"  {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
