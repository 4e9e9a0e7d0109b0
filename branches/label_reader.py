"""Reading labels and names: a text to a `Label` or a `Name`, or an error that points at the character."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import NoReturn

from branches.label import Label
from branches.words import WordSyntaxError, split_family_id
from bvp.shown import shown

__all__ = ["LabelSyntaxError", "Name", "parse", "parse_name"]

_SIGNS = dict.fromkeys("+\N{SUPERSCRIPT PLUS SIGN}", "+") | dict.fromkeys(
    "-\N{MINUS SIGN}\N{EN DASH}\N{SUPERSCRIPT MINUS}", "-"
)
_DIGITS = "0123456789"
_FLOAT = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


class LabelSyntaxError(ValueError):
    """A label or name that does not parse; the message is one line that points at the character.

    Attributes
    ----------
    text : str
        What was given.
    position : int
        The character, counted from 1, at which reading stopped; len(text) + 1 where the text ends too early.
    expected : str
        What could have stood there.
    caret : str
        Two lines: the text, and a caret below the character.
    """

    def __init__(self, text: str, position: int, expected: str):
        self.text, self.position, self.expected = text, position, expected
        self.caret = f"{text}\n{' ' * (position - 1)}^"
        found = f'unexpected "{text[position - 1]}" at' if position <= len(text) else "it ends before"
        super().__init__(f'label "{text}": {found} character {position}: expected {expected}')


@dataclass(frozen=True)
class Name:
    """A label or a family id, with what selects among several orbits: energy h > 0, quarter period alpha > 0, or None."""

    label: Label | None = None
    family: str | None = None
    h: float | None = None
    alpha: float | None = None

    def __str__(self) -> str:
        """The name as `parse_name` reads it."""
        suffix = ",".join(f"{key}={value!r}" for key, value in (("h", self.h), ("alpha", self.alpha)) if value is not None)
        return (self.family or str(self.label)) + ("@" + suffix if suffix else "")


def parse(text: str) -> Label:
    """Read a label or a pattern of labels.

    Raises
    ------
    LabelSyntaxError
        Where the text does not follow the notation; it points at the character.
    ImpossibleLabelError
        Where it does, but no orbit can have the label.

    Examples
    --------
    >>> parse("S73O33-")
    Label(kind='S', m=7, n=3, parity='O', p=3, q=3, sign='-')
    >>> str(parse("S13+")), str(parse("U(15)578-")), str(parse("U21"))
    ('S13O00+', 'U(15)578-', 'U21')
    """
    reader = _Reader(text)
    fields = reader.fields()
    if reader.here:
        reader.fail(reader.after)
    return Label(*fields)


def parse_name(text: str) -> Name:
    """Read a name: a label or a family id, then `@h=..`, `@alpha=..` or both with a comma between.

    Raises
    ------
    LabelSyntaxError, ImpossibleLabelError
        As in `parse`.
    TypeError
        For what is no text.

    Examples
    --------
    >>> name = parse_name("U8353-@h=1.9458,alpha=4.9065")
    >>> str(name.label), name.h, name.alpha
    ('U8353-', 1.9458, 4.9065)
    >>> parse_name("origin-stop+:+-:03fa9c1e").family
    'origin-stop+:+-:03fa9c1e'
    """
    if not isinstance(text, str):
        raise TypeError(f"a name is text such as S13O00+ or U8353-@h=1.9; received {shown(text)}")
    reader = _Reader(text)
    head = text.partition("@")[0]
    family, fields = None, None
    if ":" in head:
        try:
            split_family_id(head)
        except WordSyntaxError as error:
            raise LabelSyntaxError(text, 1, f"a label or a family id ({error})") from None
        reader.at, family = len(head), head
        reader.after = "@ or the end of the name"
    else:
        fields = reader.fields()
        reader.after = reader.after.replace("the end of the label", "@ or the end of the name").replace("or @", "@")
    chosen: dict[str, float] = {}
    if reader.here == "@" or (family is None and reader.here == ","):
        reader.at += 1
        reader.condition(chosen)
        while reader.here == "," and len(chosen) < 2:
            reader.at += 1
            reader.condition(chosen)
        reader.after = "the end of the name" if len(chosen) == 2 else "a comma or the end of the name"
    if reader.here:
        reader.fail(reader.after)
    return Name(Label(*fields) if fields else None, family, chosen.get("h"), chosen.get("alpha"))


class _Reader:
    """A place in a text, which moves on as parts are read and knows what could have stood where it stops."""

    def __init__(self, text: str):
        self.text, self.at = text, 0
        self.after = ""

    @property
    def here(self) -> str:
        return self.text[self.at : self.at + 1]

    def fail(self, expected: str, back: int = 0) -> NoReturn:
        raise LabelSyntaxError(self.text, self.at + 1 - back, expected)

    def number(self, meaning: str) -> int:
        """One digit, or several in parentheses."""
        if self.here and self.here in _DIGITS:
            self.at += 1
            return int(self.text[self.at - 1])
        if self.here != "(":
            self.fail(f"{meaning}, a digit or a longer number in parentheses")
        self.at += 1
        start = self.at
        while self.here and self.here in _DIGITS:
            self.at += 1
        digits = self.text[start : self.at]
        if not digits:
            self.fail("a digit")
        if len(digits) > 1 and digits[0] == "0":
            self.fail("a number without leading zeros", back=len(digits))
        if len(digits) > 9:
            self.fail("a number of at most 9 digits", back=len(digits) - 9)
        if self.here != ")":
            self.fail("a digit or )")
        self.at += 1
        return int(digits)

    def fields(self) -> tuple[str, int, int, str | None, int | None, int | None, str | None]:
        """The longest label from here on, as the fields of a Label."""
        kind = self.here
        if not kind or kind not in "SUL":
            self.fail("S (symmetric), U (unsymmetric) or L (linear mode)")
        self.at += 1
        m, n = self.number("the half-waves m of the NES"), self.number("the half-waves n of the LO")
        parity, p, q = None, None, None
        more = {"S": "the letter O or E, ", "U": "the impacts p, ", "L": ""}[kind]
        self.after = more + "a sign + or -, or the end of the label"
        if kind == "S" and self.here and self.here in "EO":
            parity = self.here
            self.at += 1
            self.after = "the impacts p, a sign + or -, or the end of the label"
        if (kind == "U" or parity) and self.here and self.here in _DIGITS + "(":
            p, q = self.number("the impacts p"), self.number("the impacts q")
            self.after = "a sign + or -, or the end of the label"
        sign = _SIGNS.get(self.here)
        if sign:
            self.at += 1
            self.after = "the end of the label"
            if kind == "S" and parity is None:
                parity, p, q = "O", 0, 0
        return kind, m, n, parity, p, q, sign

    def condition(self, chosen: dict[str, float]) -> None:
        """One `h=..` or `alpha=..`, added to those chosen."""
        keys = [key for key in ("h", "alpha") if key not in chosen]
        key = next((key for key in keys if self.text.startswith(key + "=", self.at)), None)
        if key is None:
            self.fail(" or ".join(f"{key}=.." for key in keys))
        self.at += len(key) + 1
        found = _FLOAT.match(self.text, self.at)
        value = float(found.group()) if found else 0.0
        if found is None or not 0.0 < value < math.inf:
            self.fail(f"a positive number, the {'energy' if key == 'h' else 'quarter period'} {key}")
        self.at = found.end()
        chosen[key] = value
