"""Error messages for users - the value received, what was expected, the nearest name that exists - and exit codes."""

from __future__ import annotations

import difflib
import sys
import warnings
from collections.abc import Iterable

from branches.files import WriteFailure, one_line

__all__ = ["BAD_INPUT", "DONE", "FAILED", "INTERRUPTED", "BadInput", "exit_code", "nearest", "one_line", "plain_warnings", "say"]

DONE = 0
FAILED = 1
BAD_INPUT = 2
INTERRUPTED = 130
LONGEST = 800
"""Characters of a message."""


class BadInput(ValueError):
    """Input that cannot be used; the message is one line for the user."""


def nearest(text: str, known: Iterable[str]) -> str:
    """The known name nearest to the received text, as the end of a message; nothing if none is similar.

    Examples
    --------
    >>> nearest("stifness", ["mass", "damping", "stiffness"])
    '; nearest: stiffness'
    >>> nearest("xyz", ["mass", "damping"])
    ''
    """
    # A user means no difference of case. The hyphens of two options do not make them similar.
    lowered = {name.lower().lstrip("-"): name for name in reversed(list(known))}
    found = difflib.get_close_matches(text.lower().lstrip("-"), lowered, n=1, cutoff=0.5)
    return f"; nearest: {lowered[found[0]]}" if found else ""


def say(message: str) -> None:
    """Print one line on standard error. A long message loses its middle."""
    if len(message) > LONGEST:
        message = f"{message[: LONGEST // 2]} [{len(message) - LONGEST} characters] {message[-LONGEST // 2 :]}"
    print(f"saltus: {message}", file=sys.stderr, flush=True)


def plain_warnings() -> None:
    """Print a warning as one line. Those of the arithmetic are left out: what is not finite is checked where it is used."""
    warnings.formatwarning = lambda message, *place: f"saltus: {message}\n"
    warnings.filterwarnings("ignore", r".* encountered in ", RuntimeWarning)


def exit_code(error: Exception) -> int | None:
    """How the program ends after an error: 2 for bad input and for a place that cannot be written, 1 for a numerical failure or too little
    memory, None for a fault of the program.

    Examples
    --------
    >>> exit_code(BadInput("mu = -1")), exit_code(ZeroDivisionError()), exit_code(KeyError("h"))
    (2, 1, None)
    >>> exit_code(WriteFailure("cannot write a.json: no space is left on the device"))
    2
    """
    if isinstance(error, WriteFailure | OSError):
        return BAD_INPUT
    # LinAlgError is a ValueError, but not an error of the input. If numpy is not loaded, it cannot be this error.
    numpy = sys.modules.get("numpy")
    if numpy is not None and isinstance(error, numpy.linalg.LinAlgError):
        return FAILED
    if isinstance(error, NotImplementedError | RecursionError):
        return None
    if isinstance(error, RuntimeError | ArithmeticError | MemoryError):
        return FAILED
    return BAD_INPUT if isinstance(error, ValueError) else None
