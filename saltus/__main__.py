"""The command `saltus`: finds the subcommand, runs it, and turns errors into one line and an exit code."""

from __future__ import annotations

import atexit
import contextlib
import importlib
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from typing import NoReturn, TextIO, cast

from saltus import __version__
from saltus.errors import BAD_INPUT, DONE, FAILED, INTERRUPTED, BadInput, exit_code, nearest, one_line, say
from saltus.options import SHELLS, OneLineParser, completion_script, joined_values
from saltus.processes import one_thread
from saltus.terminal import StandardError, StandardOutput

__all__ = ["main", "program"]

# Modules are imported when their command is asked for: the help of the program loads none of them.
COMMANDS = {
    "continue": ("saltus.commands.continue_", "follow the family with a name, and print its events"),
    "discover": ("saltus.commands.discover", "find every symmetric periodic orbit at an energy, within bounds"),
    "orbit": ("saltus.commands.orbit", "show one orbit of a named family: its impacts, multipliers and shape"),
    "build": ("saltus.commands.build", "find and follow every family within bounds, and save them in a catalogue"),
    "list": ("saltus.commands.list", "list the families of a catalogue"),
    "show": ("saltus.commands.show", "show one family of a catalogue: its labels, events, neighbours and stability"),
    "tree": ("saltus.commands.tree", "show the graph of a catalogue as text, starting at one family"),
    "path": ("saltus.commands.path", "find the shortest chain of events between two families of a catalogue"),
    "export": ("saltus.commands.export", "write figures of many families, or the data of a catalogue"),
    "check": ("saltus.commands.check", "verify a catalogue: its checksums, points and edges"),
    "section": ("saltus.commands.section", "make Poincare sections: many motions of one energy, or of several energies in panels"),
    "run": ("saltus.commands.run", "simulate one damped motion, event by event, and report where its energy goes"),
    "gallery": ("saltus.commands.gallery", "make the figures of a publication, each with its data"),
    "impulsive": ("saltus.commands.impulsive", "find the orbits that start with the velocity of the oscillator alone"),
    "study": ("saltus.commands.study", "simulate many damped motions over a grid or a Latin hypercube of parameters"),
    "plot": ("saltus.commands.plot", "draw the results of a study: maps, lines against each parameter, the best point"),
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
        written; 130 interrupted.
    """
    one_thread()
    warnings.formatwarning = lambda message, *place: f"saltus: {message}\n"
    words = list(sys.argv[1:] if argv is None else argv)
    output = StandardOutput(sys.stdout)
    # Where standard error is None, `print` would write to standard output instead.
    errors = StandardError(sys.stderr or open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    with contextlib.redirect_stdout(cast(TextIO, output)), contextlib.redirect_stderr(cast(TextIO, errors)):
        try:
            try:
                code = _command(words)
            finally:
                output.flush()
        except KeyboardInterrupt:
            say("interrupted; nothing more is written")
            code = INTERRUPTED
        except BrokenPipeError:
            code = FAILED
        except Exception as error:
            known = exit_code(error)
            if known is None:
                raise
            code = known
            if str(error) != output.failure:
                say(one_line(error))
        if output.failure is not None:
            say(output.failure)
            code = INTERRUPTED if code == INTERRUPTED else BAD_INPUT
    return code


def program() -> NoReturn:
    """Run the command line as a process. Its exit code is 130 where an interrupt comes before its last moment."""
    codes: list[int] = []
    # Registered first, this is called last: what other libraries do at exit is done, and an interrupt can no longer change the code.
    atexit.register(_leave, codes)
    try:
        codes.append(main())
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    except KeyboardInterrupt:
        codes[:] = [INTERRUPTED]
    sys.exit(codes[0])


def _leave(codes: Sequence[int]) -> None:
    """End the process with its exit code; not where a fault of the program has left none."""
    for code in codes:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):
                stream.flush()
        os._exit(code)


def _command(words: list[str]) -> int:
    parser = OneLineParser(prog="saltus", description="Continuation of periodic orbits of mechanical systems with impacts.")
    parser.add_argument("-V", "--version", action="version", version=f"saltus {__version__}")
    summary = f"print the completion script of {', '.join(SHELLS)}"
    parser.add_argument("--print-completion", metavar="SHELL", choices=SHELLS, help=summary)
    completing = words[:1] != [] and words[0].partition("=")[0] == "--print-completion"
    asked = None if completing else next((text for text in words if not text.startswith("-")), None)
    if asked is not None and asked not in COMMANDS:
        raise BadInput(f"unknown command {asked!r}, expected one of {', '.join(COMMANDS)}{nearest(asked, COMMANDS)}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for name, (module, summary) in COMMANDS.items():
        command = commands.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        if completing or name == asked:
            importlib.import_module(module).add_arguments(command)
            asked_parser = command
    arguments, unknown = parser.parse_known_args(joined_values(words))
    if asked is None:
        if unknown:
            raise BadInput(f"unknown option {unknown[0]}{nearest(unknown[0], parser.options())}")
        if completing:
            print(completion_script(parser, arguments.print_completion))
        else:
            parser.print_help()
        return DONE
    if unknown:
        getattr(arguments, "parser", asked_parser).refuse(unknown[0], words)
    return importlib.import_module(COMMANDS[asked][0]).run(arguments)


if __name__ == "__main__":
    program()
