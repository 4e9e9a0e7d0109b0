"""Words, ends and family ids as text, and back."""

from __future__ import annotations

import re
from collections.abc import Iterable

__all__ = [
    "PERIODIC",
    "Ends",
    "Word",
    "WordSyntaxError",
    "check_ends",
    "format_ends",
    "format_word",
    "join_family_id",
    "parse_ends",
    "parse_word",
    "split_family_id",
]

Word = tuple[str, ...]
Ends = tuple[str, str]

PERIODIC: Ends = ("periodic", "periodic")
"""The ends of an orbit that closes on itself, without any reversal."""

_LETTER = re.compile(r"[a-z]?[+-]")
_END = r"(origin|rest|stop[a-z]?[+-])"
_ENDS = re.compile(_END + "-" + _END)
_HASH = re.compile(r"[0-9a-f]{4,64}")


class WordSyntaxError(ValueError):
    """A word, a pair of ends or a family id that cannot be read; the message is one line."""


def parse_word(text: str) -> Word:
    """Read a word such as `+-+` or `a+b-`.

    Raises
    ------
    WordSyntaxError
        Where a letter is not `+` or `-`, or not a stop's letter followed by one, or where both kinds are mixed.

    Examples
    --------
    >>> parse_word("+-+"), parse_word("a+b-"), parse_word("")
    (('+', '-', '+'), ('a+', 'b-'), ())
    """
    letters: list[str] = []
    at = 0
    while at < len(text):
        found = _LETTER.match(text, at)
        if found is None:
            raise WordSyntaxError(
                f'word "{text}": unexpected "{text[at]}" at character {at + 1}: '
                "expected + or -, after a stop's letter if there are several"
            )
        if letters and len(found.group()) != len(letters[0]):
            raise WordSyntaxError(
                f'word "{text}": "{found.group()}" at character {at + 1} and "{letters[0]}" are mixed: '
                "expected a stop's letter before each sign, or before none"
            )
        letters.append(found.group())
        at = found.end()
    return tuple(letters)


def format_word(word: Iterable[str]) -> str:
    """The word as text, e.g. `+-+`; what `parse_word` reads.

    Examples
    --------
    >>> format_word(("a+", "b-"))
    'a+b-'
    """
    return "".join(word)


def parse_ends(text: str) -> Ends:
    """Read a pair of ends such as `origin-stop+`, or `periodic`.

    Raises
    ------
    WordSyntaxError
        Where the text is neither.

    Examples
    --------
    >>> parse_ends("stop+-stop-"), parse_ends("periodic")
    (('stop+', 'stop-'), ('periodic', 'periodic'))
    """
    if text == "periodic":
        return PERIODIC
    found = _ENDS.fullmatch(text)
    if found is None:
        raise WordSyntaxError(
            f'ends "{text}": expected two of origin, rest, stop+, stop- joined by "-", such as origin-stop+, or periodic'
        )
    return found.group(1), found.group(2)


def format_ends(ends: Ends) -> str:
    """The ends as text, e.g. `origin-stop+`; what `parse_ends` reads.

    Examples
    --------
    >>> format_ends(("origin", "stop+"))
    'origin-stop+'
    """
    check_ends(ends)
    return "periodic" if ends == PERIODIC else "-".join(ends)


def split_family_id(text: str) -> tuple[Ends, Word, str]:
    """Take a family id `ends:word:hash` apart.

    Raises
    ------
    WordSyntaxError
        Where a part is missing or cannot be read.

    Examples
    --------
    >>> split_family_id("origin-stop+:+-:03fa9c1e")
    (('origin', 'stop+'), ('+', '-'), '03fa9c1e')
    """
    parts = text.split(":")
    if len(parts) != 3:
        raise WordSyntaxError(f'family id "{text}": expected ends:word:hash, such as origin-stop+:+-:03fa9c1e')
    ends, word, digest = parse_ends(parts[0]), parse_word(parts[1]), parts[2]
    if not _HASH.fullmatch(digest):
        raise WordSyntaxError(f'family id "{text}": the hash "{digest}" is not of 4 to 64 characters 0-9 and a-f')
    return ends, word, digest


def join_family_id(ends: Ends, word: Iterable[str], digest: str) -> str:
    """The family id `ends:word:hash`, the inverse of `split_family_id`.

    Examples
    --------
    >>> join_family_id(("origin", "origin"), ("+", "-"), "03fa9c1e")
    'origin-origin:+-:03fa9c1e'
    """
    text = f"{format_ends(ends)}:{format_word(word)}:{digest}"
    split_family_id(text)
    return text


def check_ends(ends: Ends) -> None:
    """Refuse ends that do not exist, in words."""
    if tuple(ends) != PERIODIC:
        parse_ends("-".join(ends))
