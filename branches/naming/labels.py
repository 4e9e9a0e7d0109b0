"""Labels and names of periodic orbits, in the notation of Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868.

    S m n E|O p p +|-     symmetric      u(t + T/2) = -u(t)
    U m n p q +|-         unsymmetric
    L m m +|-             linear modes, all equivalent to L11

m, n: half-waves of absorber (NES) and primary (LO) in the half period, the sign changes of u1' and u2'. p, q: impacts strictly
inside the first and second quarter; O: one more impact at the quarter itself, E: none. +: u1' and u2' have the same sign at
the start of both half periods, where the displacements are zero. Numbers of two or more digits are in parentheses:
`U(15)578-`.

What is left out at the end matches everything that fits: `U21`, `S73O`, `S13O00`. With one exception, the published short
names S11- and S13+: a symmetric label of m, n and a sign alone has no inner impacts and means SmnO00 with that sign.

A **name** selects an orbit or a family: a label, or a family id `ends:sequence:hash`, and after `@` the energy or quarter period
that choose among several: `U8353-@h=1.9458,alpha=4.9065`.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from branches.sequences import SequenceSyntaxError, split_family_id
from bvp.texts import shown

__all__ = [
    "ImpossibleLabelError", "Label", "LabelSyntaxError", "Name", "canonical_label", "latex", "most_alike", "parse", "parse_name",
    "parse_printed", "parse_suffix",
]  # fmt: skip


_WITHOUT_IMPACTS = "labels without impacts are those of linear modes, L11+ and L11-, and in systems without stops such as S11+"


class ImpossibleLabelError(ValueError):
    """A label that can be read, but that no periodic orbit with impacts (or linear mode) can have; the message says why."""


@dataclass(frozen=True)
class Label:
    """A label, or a pattern of labels where parity, p and q, or sign are None.

    Parameters
    ----------
    kind
        "S", "U" or "L".
    m, n
        Half-waves of absorber and primary in the half period.
    parity
        "E" or "O", symmetric labels only.
    p, q
        Impacts strictly inside the first and second quarter; both or none; none for linear modes.
    sign
        "+" or "-".

    Raises
    ------
    ImpossibleLabelError
        Where no orbit can have the label.
    ValueError
        Where the fields make no label at all.

    Notes
    -----
    The displacements vanish at both ends of a half period, so each velocity changes sign in it. Over a half period a symmetric orbit
    becomes its own negative, so its velocities change sign an odd number of times, and its quarters have equally many impacts.
    """

    kind: str
    m: int
    n: int
    parity: str | None = None
    p: int | None = None
    q: int | None = None
    sign: str | None = None

    def __post_init__(self) -> None:
        kind, m, n, parity, p, q, sign = self.kind, self.m, self.n, self.parity, self.p, self.q, self.sign
        if kind not in ("S", "U", "L"):
            raise ValueError(f"kind of a label is {kind!r}, expected S, U or L")
        if parity is not None and (kind != "S" or parity not in ("E", "O")):
            raise ValueError(f"parity of a {kind} label is {parity!r}, expected E or O for S, none for U and L")
        if sign not in (None, "+", "-"):
            raise ValueError(f"sign of a label is {sign!r}, expected + or -")
        if (p is None) != (q is None) or (p is not None and kind != "U" and parity is None):
            rule = "expected both or none, none for L, and for S only with E or O"
            raise ValueError(f"impacts p, q of a {kind} label are {p}, {q}: {rule}")
        for field, value in (("m", m), ("n", n), ("p", p), ("q", q)):
            if value is not None and (not isinstance(value, int) or value < 0):
                raise ValueError(f"{field} of a label is {value!r}, expected an integer, 0 or more")
        reason = ""
        if m == 0 or n == 0:
            body = "LO" if m else "NES"
            reason = f"the {body} has 0 half-waves, but its velocity changes sign at least once in a half period (m, n >= 1)"
        elif kind == "L" and m != n:
            reason = f"m = {m} and n = {n} differ, but in a linear mode both bodies move alike (L11+, L11-)"
        elif kind == "S" and p != q:
            reason = f"a symmetric orbit has as many impacts in its second quarter as in its first, here {p} and {q}"
        elif kind == "S" and (m % 2 == 0 or n % 2 == 0):
            reason = f"a symmetric orbit reverses each velocity over a half period, so m and n are odd, here {m} and {n}"
        elif parity == "E" and p == 0:
            reason = f"it has no impact at all (none inside a quarter, E: none at the quarter); {_WITHOUT_IMPACTS}"
        elif kind == "U" and p == q == 0:
            reason = f"it has no impact at all (p = q = 0); {_WITHOUT_IMPACTS}"
        if reason:
            raise ImpossibleLabelError(f"{self} cannot be the label of a periodic orbit: {reason}")

    def __str__(self) -> str:
        """The label as `parse` reads it."""
        m, n, p, q = ("" if value is None else f"({value})" if value > 9 else str(value) for value in (self.m, self.n, self.p, self.q))
        return f"{self.kind}{m}{n}{self.parity or ''}{p}{q}{self.sign or ''}"

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left open: one label, not a pattern of several."""
        return self.sign is not None and (self.kind == "L" or self.p is not None)


def canonical_label(label: Label) -> Label:
    """The canonical one of all equivalent labels: p <= q (Umnpq and Umnqp are one orbit), and L11 for each Lmm.

    Examples
    --------
    >>> str(canonical_label(parse("U(15)587-"))), str(canonical_label(parse("L33+")))
    ('U(15)578-', 'L11+')
    """
    if label.kind == "L":
        return dataclasses.replace(label, m=1, n=1)
    if label.p is not None and label.q is not None and label.p > label.q:
        return dataclasses.replace(label, p=label.q, q=label.p)
    return label


def latex(label: Label, *, short: bool = False) -> str:
    """The label for plots, in LaTeX (and matplotlib) mathematics: upright, the sign raised.

    Parameters
    ----------
    short
        Write the short name where there is one: S13+ for S13O00+.

    Examples
    --------
    >>> print(latex(parse("U8353-")), latex(parse("S13+"), short=True))
    $\\mathrm{U8353}^{-}$ $\\mathrm{S13}^{+}$
    """
    body = str(label).removesuffix(label.sign or "")
    if short and label.sign is not None:
        body = body.removesuffix("O00")
    return rf"$\mathrm{{{body}}}" + (f"^{{{label.sign}}}$" if label.sign else "$")


def most_alike(text: str, candidates: Iterable[object], count: int = 3) -> tuple[str, ...]:
    """The `count` candidates whose text is most like the given one, the most alike first.

    Examples
    --------
    >>> most_alike("S73O3-", ["S73O33-", "S13O00+", "U8353-"], 1)
    ('S73O33-',)
    """
    return tuple(difflib.get_close_matches(text, dict.fromkeys(str(item) for item in candidates), n=count, cutoff=0.0))


_SIGNS = dict.fromkeys("+\N{SUPERSCRIPT PLUS SIGN}", "+") | dict.fromkeys("-\N{MINUS SIGN}\N{EN DASH}\N{SUPERSCRIPT MINUS}", "-")
_FLOAT = r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?"


class LabelSyntaxError(ValueError):
    """A label or name that does not parse; the message is one line that points at the character.

    Attributes
    ----------
    text : str
        What was given.
    position : int
        The character, counted from 1, at which reading stopped; len(text) + 1 where the text ends too early.
    expected : str
        The characters that were possible there.
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
    """A label or a family id, with what selects among several orbits: energy h > 0, quarter period alpha > 0, or None.

    is_short: whether the text of the label leaves its impacts out, as S13+ does, which is S13O00+ with stops and S13+ without."""

    label: Label | None = None
    family: str | None = None
    h: float | None = None
    alpha: float | None = None
    is_short: bool = dataclasses.field(default=False, compare=False)

    def __str__(self) -> str:
        """The name as `parse_name` reads it."""
        suffix = ",".join(f"{key}={value!r}" for key, value in (("h", self.h), ("alpha", self.alpha)) if value is not None)
        label = str(self.label).replace("O00", "") if self.is_short else str(self.label)
        return (self.family or label) + ("@" + suffix if suffix else "")


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
    reader.take(r"\Z", reader.after)
    return Label(*fields)


def parse_printed(text: str) -> Label:
    """Read a label of an orbit, as it is printed. A symmetric one without O or E is that of an orbit without impacts, and not short.

    Raises
    ------
    LabelSyntaxError, ImpossibleLabelError
        As in `parse`.

    Examples
    --------
    >>> str(parse("S13+")), str(parse_printed("S13+")), str(parse_printed("S13O00+"))
    ('S13O00+', 'S13+', 'S13O00+')
    """
    label = parse(text)
    if label.kind == "S" and _is_short(text):
        return Label(label.kind, label.m, label.n, sign=label.sign)
    return label


def _is_short(text: str) -> bool:
    return not {"O", "E"} & set(text)


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
        except SequenceSyntaxError as error:
            hint = "linear modes are for --from; in Python see saltus.linear_modes" if head.startswith("mode:") else str(error)
            raise LabelSyntaxError(text, 1, f"a label or a family id ({hint})") from None
        reader.at, family = len(head), head
        reader.after = "@ or the end of the name"
    else:
        fields = reader.fields()
        reader.after = reader.after.replace("the end of the label", "@ or the end of the name").replace("or @", "@")
    h, alpha = reader.suffix("@" if family else "[@,]")
    return Name(Label(*fields) if fields else None, family, h, alpha, _is_short(head))


def parse_suffix(text: str, at: int) -> tuple[float | None, float | None]:
    """Read what selects an orbit behind a text of another kind, from its character `at` on: `@h=..`, `@alpha=..`, both or nothing.

    Raises
    ------
    LabelSyntaxError
        As in `parse`.

    Examples
    --------
    >>> parse_suffix("S13.json@h=0.6", 8)
    (0.6, None)
    """
    return _Reader(text, at, "@ or the end of the name").suffix("@")


@dataclass
class _Reader:
    """A position in a text. It advances as parts are read, and collects what was possible at the place where reading stops."""

    text: str
    at: int = 0
    after: str = ""

    def take(self, pattern: str, expected: str = "") -> str:
        """What matches a pattern from here on; if nothing does and something was `expected`, that is an error."""
        found = re.compile(pattern).match(self.text, self.at)
        if found is None and expected:
            raise LabelSyntaxError(self.text, self.at + 1, expected)
        self.at += len(found[0]) if found else 0
        return found[0] if found else ""

    def number(self, meaning: str) -> int:
        """One digit, or several in parentheses."""
        if digit := self.take("[0-9]"):
            return int(digit)
        self.take(r"\(", f"{meaning}, a digit or a longer number in parentheses")
        start = self.at
        digits = self.take("[0-9]+", "a digit")
        if len(digits) > 1 and digits[0] == "0":
            raise LabelSyntaxError(self.text, start + 1, "a number without leading zeros")
        if len(digits) > 9:
            raise LabelSyntaxError(self.text, start + 10, "a number of at most 9 digits")
        self.take(r"\)", "a digit or )")
        return int(digits)

    def fields(self) -> tuple[str, int, int, str | None, int | None, int | None, str | None]:
        """The longest label from here on, as the fields of a Label."""
        kind = self.take("[SUL]", "S (symmetric), U (unsymmetric) or L (linear mode)")
        m, n = self.number("the half-waves m of the NES"), self.number("the half-waves n of the LO")
        p, q = None, None
        parity = self.take("[EO]") or None if kind == "S" else None
        impacts = kind == "U" or parity is not None
        if impacts and self.text[self.at : self.at + 1] in {*"0123456789("}:
            p, q = self.number("the impacts p"), self.number("the impacts q")
            impacts = False
        more = "the impacts p, " if impacts else "the letter O or E, " if kind == "S" and parity is None else ""
        self.after = more + "a sign + or -, or the end of the label"
        sign = _SIGNS.get(self.take(f"[{''.join(map(re.escape, _SIGNS))}]"))
        if sign:
            self.after = "the end of the label"
            if kind == "S" and parity is None:
                parity, p, q = "O", 0, 0
        return kind, m, n, parity, p, q, sign

    def suffix(self, begin: str) -> tuple[float | None, float | None]:
        """The energy and the quarter period at the end of the text, after what matches the pattern `begin`."""
        chosen: dict[str, float] = {}
        while self.take(begin if not chosen else "," if len(chosen) == 1 else r"(?!)"):
            self.condition(chosen)
            self.after = "the end of the name" if len(chosen) == 2 else "a comma or the end of the name"
        self.take(r"\Z", self.after)
        return chosen.get("h"), chosen.get("alpha")

    def condition(self, chosen: dict[str, float]) -> None:
        """One `h=..` or `alpha=..`, added to those chosen."""
        keys = [key for key in ("h", "alpha") if key not in chosen]
        key = self.take("|".join(f"{key}=" for key in keys), " or ".join(f"{key}=.." for key in keys))[:-1]
        start = self.at
        text = self.take(_FLOAT)
        chosen[key] = float(text or 0.0)
        if not 0.0 < chosen[key] < math.inf:
            raise LabelSyntaxError(self.text, start + 1, f"a positive number, the {'energy' if key == 'h' else 'quarter period'} {key}")
