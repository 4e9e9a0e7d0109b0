"""The command `saltus`: finds the subcommand, runs it, and turns errors into one line and an exit code."""

from __future__ import annotations

import atexit
import contextlib
import importlib
import io
import os
import signal
import sys
from collections.abc import Sequence
from typing import Any, NoReturn, cast

from branches.files import reason
from bvp.interrupts import SIGNALS, end_by, ended_by
from saltus import __version__
from saltus.errors import BAD_INPUT, DONE, FAILED, INTERRUPTED, BadInput, core_fault, exit_code, one_line, plain_warnings, say
from saltus.options import SHELLS, OneLineParser, completion_script
from saltus.outputs import GuardedStream
from saltus.processes import one_thread

__all__ = ["main", "program"]

COMMANDS = {
    "continue": "follow the family with a name, and print its events",
    "curve": "follow a bifurcation or a grazing in the plane of two parameters",
    "chart": "follow all curves from the events of a branch, and simulate what attracts between them",
    "discover": "find every orbit with a reversal at an energy, for two degrees of freedom; by default those through the origin",
    "orbit": "show one orbit of a named family: its impacts, multipliers and shape",
    "build": "find and follow families within bounds, and save them: all for two degrees of freedom and one stop, else those modes lead to",
    "list": "list the families of a catalogue",
    "show": "show one family of a catalogue: its labels, events, neighbours and stability",
    "tree": "show the graph of a catalogue as text, starting at one family",
    "path": "find the shortest chain of events between two families of a catalogue",
    "export": "write figures of many families, or the data of a catalogue",
    "check": "verify a catalogue: its checksums, points and edges",
    "section": "make Poincare sections: many motions of one energy, or of several energies in panels",
    "run": "simulate one damped motion, event by event, and report where its energy goes",
    "sweep": "simulate forced motion over a range of a parameter: the brute-force bifurcation diagram",
    "basin": "draw basins of attraction: to which attractor each start of forced motion leads",
    "gallery": "make the figures of a publication, each with its data",
    "impulsive": "find the orbits that start with the velocity of the oscillator alone",
    "spring": "draw the force of a spring at values of a parameter, and the stop that it becomes",
    "study": "simulate many damped motions over a grid or a Latin hypercube of parameters",
    "compile": "compile what all commands need, so that no first run waits",
    "plot": "draw the results of a study: maps, lines against each parameter, the best point",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; by default those of the process.

    Returns
    -------
    int
        0 done; 1 a numerical failure, or an answer that is no (`check`, `path`); 2 bad input, nothing started, or a place that cannot be
        written; 130 interrupted, 143 and 129 ended by SIGTERM and SIGHUP.
    """
    one_thread()
    plain_warnings()
    output = GuardedStream(sys.stdout or open(os.devnull))  # noqa: SIM115  # what is opened to read cannot be written
    errors = GuardedStream(sys.stderr or io.StringIO(), outlasts=True)
    with contextlib.redirect_stdout(cast(Any, output)), contextlib.redirect_stderr(cast(Any, errors)):
        try:
            code = _command(list(sys.argv[1:] if argv is None else argv))
        except KeyboardInterrupt as interrupt:
            say(f"interrupted; {interrupt}" if str(interrupt) else "interrupted; nothing more is written")
            code = INTERRUPTED
        except BrokenPipeError:
            code = FAILED
        except Exception as error:
            # Python 3.11 wraps an interrupt that comes while a class is made, as in an import.
            interrupted = isinstance(error.__cause__, KeyboardInterrupt)
            known = INTERRUPTED if interrupted else exit_code(error)
            if known is None:
                raise
            code = known
            if interrupted:
                say("interrupted; nothing more is written")
            elif error is not output.failure:
                say(core_fault(error) or one_line(error))
        if output.failure is not None and not isinstance(output.failure, BrokenPipeError):
            say(f"cannot write standard output: {reason(output.failure)}")
            code = max(code, BAD_INPUT)
    return 128 + ended_by() if code == INTERRUPTED else code


def program() -> NoReturn:
    """Run the command line as a process. Its exit code stays, whatever comes after the work. Ctrl-C ends the process with 130, SIGTERM with
    143 and SIGHUP with 129; a signal that the caller ignores, as `nohup` does, changes nothing."""
    codes: list[int] = []
    # Registered first, this is called last: other libraries have done their work at exit. Python's own end is left out. It takes
    # a tenth of a second, and an interrupt would change the exit code or print a traceback.
    atexit.register(_leave, codes)
    for number in SIGNALS:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, end_by)
    try:
        codes.append(main())
        for number in SIGNALS:
            if signal.getsignal(number) in (signal.default_int_handler, end_by):
                signal.signal(number, lambda number, _: os._exit(128 + number))
    except KeyboardInterrupt:
        codes[:] = [128 + ended_by()]
    sys.exit(codes[0])


def _leave(codes: Sequence[int]) -> None:
    """End the process with its exit code. After a fault of the program there is none, and Python ends the process."""
    for code in codes:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, AttributeError):
                stream.flush()
        os._exit(code)


def _command(words: list[str]) -> int:
    parser = OneLineParser(prog="saltus", description="Continuation of periodic orbits of mechanical systems with impacts.")
    parser.set_defaults(parser=parser)
    parser.add_argument("-V", "--version", action="version", version=f"saltus {__version__}")
    summary = f"print the completion script of {', '.join(SHELLS)}"
    parser.add_argument("--print-completion", metavar="SHELL", choices=SHELLS, help=summary)
    completing = words[:1] != [] and words[0].startswith("--print-completion")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for name, summary in COMMANDS.items():
        command = commands.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        # The help of the program loads no command, and a command loads no other.
        if completing or name in words:
            module = importlib.import_module("saltus.commands." + name.replace("continue", "continue_"))
            command.set_defaults(parser=command, run=module.run)
            module.add_arguments(command)
    for word in words:
        # Argparse reads it as an empty list, whatever the option expects.
        if word.startswith("--") and word.endswith("=--"):
            raise BadInput(f"{word}: -- is not a value of an option")
    arguments, unknown = parser.parse_known_args(words)
    if unknown:
        arguments.parser.refuse(unknown[0])
    if arguments.print_completion is not None:
        print(completion_script(parser, arguments.print_completion))
    elif arguments.command is None:
        parser.print_help()
    else:
        return arguments.run(arguments)
    return DONE


if __name__ == "__main__":
    program()
