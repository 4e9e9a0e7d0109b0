"""Error messages for users - the value received, what was expected, the nearest name that exists - and exit codes."""

from __future__ import annotations

import difflib
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from branches.files import WriteFailure, one_line

__all__ = [
    "BAD_INPUT", "DONE", "FAILED", "FAILURES", "INTERRUPTED", "BadInput", "computed", "core_fault", "exit_code", "nearest", "one_line",
    "plain_warnings", "refusing", "say",
]  # fmt: skip

DONE = 0
FAILED = 1
BAD_INPUT = 2
INTERRUPTED = 130
FAILURES = ("MINIMUM_STEP", "NO_START")
"""The reasons of an end, as `continuation.problem.EndReason` names them, that are numerical failures."""
LONGEST = 800
"""Characters of a message."""


class BadInput(ValueError):
    """Input that cannot be used; the message is one line for the user."""


@contextmanager
def refusing(what: str = "", kinds: type[Exception] | tuple[type[Exception], ...] = ValueError) -> Iterator[None]:
    """Make `BadInput` of errors of some kinds, by default `ValueError`: one line, behind `what` and a colon. A `BadInput` stays.

    Examples
    --------
    >>> with refusing("--keep"):
    ...     raise ValueError("F is no parameter")
    Traceback (most recent call last):
    saltus.errors.BadInput: --keep: F is no parameter
    """
    try:
        yield
    except BadInput:
        raise
    except kinds as error:
        raise BadInput(f"{what}: {one_line(error)}" if what else one_line(error)) from error


def computed(error: BaseException) -> tuple[Any, int]:
    """What a run has computed before an interrupt or a numerical failure, which is said, and the exit code. Raise an error without it."""
    found = getattr(error, "branch", None)
    if found is None:
        raise error
    interrupted = isinstance(error, KeyboardInterrupt)
    say("interrupted, with the points that were computed so far" if interrupted else one_line(error))
    return found, INTERRUPTED if interrupted else FAILED


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


def core_fault(error: BaseException) -> str:
    """What is wrong with the compiled core, where that is the reason of an error, and the command that compiles it; else empty.

    Examples
    --------
    >>> print(core_fault(ImportError("no such file", name="saltus_core")))  # doctest: +ELLIPSIS
    the compiled core of saltus cannot be imported (no such file); compile it: ... -m pip install ...
    >>> import saltus_core
    >>> try:
    ...     saltus_core.forgotten
    ... except AttributeError as error:
    ...     print(core_fault(error))  # doctest: +ELLIPSIS
    the compiled core of saltus is older than the program (module 'saltus_core' has no attribute 'forgotten'); compile it: ...
    >>> core_fault(ImportError("No module named 'numpy'", name="numpy")), core_fault(AttributeError("x"))
    ('', '')
    """
    is_old = isinstance(error, AttributeError) or "cannot import name" in str(error)
    place = getattr(error.obj, "__name__", "") if isinstance(error, AttributeError) else getattr(error, "name", "")
    if place != "saltus_core":
        return ""
    fault = "is older than the program" if is_old else "cannot be imported"
    folder = Path(__file__).resolve().parents[1]
    what = f'--editable "{folder}"' if (folder / "backend.py").is_file() else "--force-reinstall --no-deps saltus"
    return f"the compiled core of saltus {fault} ({error}); compile it: {sys.executable} -m pip install {what}"


def exit_code(error: Exception) -> int | None:
    """How the program ends after an error: 2 for bad input, for a place that cannot be written and for a core that is not compiled, 1 for a
    numerical failure or too little memory, None for a fault of the program.

    Examples
    --------
    >>> exit_code(BadInput("mu = -1")), exit_code(ZeroDivisionError()), exit_code(KeyError("h"))
    (2, 1, None)
    >>> exit_code(WriteFailure("cannot write a.json: no space is left on the device"))
    2
    """
    if isinstance(error, WriteFailure | OSError) or core_fault(error):
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
