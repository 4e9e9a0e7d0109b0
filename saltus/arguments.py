"""Reading command-line arguments: a parser whose errors are one line, and the kinds of value that options have."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from saltus.errors import BadInput, nearest

__all__ = [
    "SHELLS",
    "OneLineParser",
    "completion_script",
    "energy_range",
    "joined_values",
    "number",
    "one_of",
    "positive",
    "whole_above_zero",
]

SHELLS = ("bash", "zsh", "tcsh")
"""Shells that have completion."""

_LOOKS_NEGATIVE = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)

MOST = 10**15
"""Largest whole number of an option: what counts beyond it has no end."""


class OneLineParser(argparse.ArgumentParser):
    """A parser that raises `BadInput` where argparse would print its usage and end the process."""

    def __init__(self, **options: Any) -> None:
        options.setdefault("allow_abbrev", False)
        super().__init__(**options)

    def error(self, message: str) -> NoReturn:
        """Raise what argparse found wrong."""
        message = message.replace("the following arguments are required: ", "missing: ").removeprefix("argument ")
        message = re.sub(r"ignored explicit argument (.*)", r"received \1, expected no value", message)
        raise BadInput(f"{message} (see {self.prog} --help)")

    def options(self) -> list[str]:
        """Return the options that the help shows."""
        return sorted(set(re.findall(r"--[a-z][a-z-]*", self.format_help())))

    def refuse(self, word: str, words: Sequence[str]) -> NoReturn:
        """Raise for a word, of those of the command line, that is no option and no argument of this parser."""
        option = word.partition("=")[0]
        if "--" in words and word.startswith("-") and word not in words[: words.index("--")]:
            after = "" if word == "--" else f" after --, where nothing is an option: expected {option} before --"
            raise BadInput(f"unexpected argument {word!r}{after} (see {self.prog} --help)")
        if not option.startswith("-"):
            raise BadInput(f"unexpected argument {word!r} (see {self.prog} --help)")
        raise BadInput(f"unknown option {option} of {self.prog}{nearest(option, self.options())}")


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script by which a shell completes the commands and options of a parser, and the names of files."""
    import shtab

    def complete_files(part: argparse.ArgumentParser) -> None:
        for action in part._actions:
            if isinstance(action, argparse._SubParsersAction):
                for inner in action.choices.values():
                    complete_files(inner)
            elif action.metavar == "FILE":
                action.complete = shtab.FILE  # type: ignore[attr-defined]

    complete_files(parser)
    return shtab.complete(parser, shell)


def joined_values(words: list[str]) -> list[str]:
    """Join an option with a value that looks like an option itself because it starts with a minus sign.

    Raises
    ------
    BadInput
        For an option with the value ``--``, which argparse takes for the mark before positional arguments, and drops.

    Parameters
    ----------
    words : list of str

    Returns
    -------
    list of str

    Examples
    --------
    >>> joined_values(["continue", "S13+", "--energy", "-1:2", "--json", "-"])
    ['continue', 'S13+', '--energy=-1:2', '--json', '-']
    """
    joined: list[str] = []
    for word in words:
        if word.startswith("--") and word.endswith("=--") and "--" not in joined:
            raise BadInput(f"{word}: -- is no value of an option")
        if joined and joined[-1].startswith("--") and "=" not in joined[-1] and _LOOKS_NEGATIVE.match(word):
            joined[-1] += "=" + word
        else:
            joined.append(word)
    return joined


def number(text: str) -> float:
    """Read a number; NaN is none.

    Examples
    --------
    >>> number("nan")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received 'nan', expected a number
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise argparse.ArgumentTypeError(f"received {text!r}, expected a number")
    return value


def positive(text: str) -> float:
    """Read a finite number above 0."""
    value = number(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"received {text!r}, expected a number above 0")
    return value


def whole_above_zero(text: str) -> int:
    """Read a whole number above 0.

    Examples
    --------
    >>> whole_above_zero("99999999999999999999")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received '99999999999999999999', expected a whole number above 0, up to 1e15
    """
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"received {text!r}, expected a whole number above 0")
    if value > MOST:
        raise argparse.ArgumentTypeError(f"received {text!r}, expected a whole number above 0, up to 1e15")
    return value


def energy_range(text: str) -> tuple[float, float]:
    """Read a range of energies, ``LO:HI`` with 0 < LO < HI, both finite.

    Examples
    --------
    >>> energy_range("0.1:10")
    (0.1, 10.0)
    >>> energy_range("10:0.1")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received '10:0.1', a reversed range, expected LO:HI with 0 < LO < HI
    """
    expected = "expected LO:HI with 0 < LO < HI"
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"received {text!r}, {expected}") from None
    faults = {
        "NaN is no energy": math.isnan(low) or math.isnan(high),
        "a reversed range": low > high,
        "an empty range": low == high,
        "an energy that is not above 0": low <= 0.0,
        "an energy that is not finite": math.isinf(high),
    }
    for fault, found in faults.items():
        if found:
            raise argparse.ArgumentTypeError(f"received {text!r}, {fault}, {expected}")
    return low, high


def one_of(*known: str) -> Callable[[str], str]:
    """Return a reader of one of several words.

    Examples
    --------
    >>> one_of("up", "down", "both")("downn")
    Traceback (most recent call last):
    argparse.ArgumentTypeError: received 'downn', expected one of up, down, both; nearest: down
    """

    def read(text: str) -> str:
        if text not in known:
            raise argparse.ArgumentTypeError(f"received {text!r}, expected one of {', '.join(known)}{nearest(text, known)}")
        return text

    return read
