"""A label as data: its fields, its text, and why some cannot be; see `branches.labels` for the notation."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

__all__ = ["ImpossibleLabelError", "Label", "count_half_waves", "label_of", "pieces", "why_impossible"]


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
        Where no orbit can have the label; `why_impossible` gives the rules.
    ValueError
        Where the fields make no label at all.
    """

    kind: str
    m: int
    n: int
    parity: str | None = None
    p: int | None = None
    q: int | None = None
    sign: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("S", "U", "L"):
            raise ValueError(f"kind of a label is {self.kind!r}, expected S, U or L")
        if self.parity is not None and (self.kind != "S" or self.parity not in ("E", "O")):
            raise ValueError(f"parity of a {self.kind} label is {self.parity!r}, expected E or O for S, none for U and L")
        if self.sign not in (None, "+", "-"):
            raise ValueError(f"sign of a label is {self.sign!r}, expected + or -")
        countable = self.kind == "U" or self.parity is not None
        if (self.p is None) != (self.q is None) or (self.p is not None and not countable):
            rule = "expected both or none, none for L, and for S only with E or O"
            raise ValueError(f"impacts p, q of a {self.kind} label are {self.p}, {self.q}: {rule}")
        for field in ("m", "n", "p", "q"):
            value = getattr(self, field)
            if value is not None and (not isinstance(value, int) or value < 0):
                raise ValueError(f"{field} of a label is {value!r}, expected a whole number, 0 or more")
        reason = why_impossible(self)
        if reason is not None:
            raise ImpossibleLabelError(f"{self} cannot be a periodic orbit: {reason}")

    def __str__(self) -> str:
        """The label as `parse` reads it."""
        return "".join(pieces(self)) + (self.sign or "")

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left open: one label, not a pattern of several."""
        return self.sign is not None and (self.kind == "L" or self.p is not None)


def why_impossible(label: Label) -> str | None:
    """Why no orbit can have this label, in words; None where one can.

    The displacements vanish at both ends of a half period, so each velocity changes sign in it. Over a half period a symmetric
    orbit turns into its own negative, so its velocities change sign an odd number of times, and its quarters have equally many
    impacts.
    """
    if label.m == 0 or label.n == 0:
        body = "NES" if label.m == 0 else "LO"
        return f"the {body} has 0 half-waves, but its velocity changes sign at least once in a half period (m, n >= 1)"
    if label.kind == "L":
        differ = f"m = {label.m} and n = {label.n} differ, but in a linear mode both bodies move alike (L11+, L11-)"
        return differ if label.m != label.n else None
    if label.kind == "S" and label.p != label.q:
        return f"a symmetric orbit has as many impacts in its second quarter as in its first, here {label.p} and {label.q}"
    if label.kind == "S" and (label.m % 2 == 0 or label.n % 2 == 0):
        return f"a symmetric orbit reverses each velocity over a half period, so m and n are odd, here {label.m} and {label.n}"
    if label.kind == "S" and label.parity == "E" and label.p == 0:
        return "it has no impact at all (none inside a quarter, E: none at the quarter); the linear modes are L11+, L11-"
    if label.kind == "U" and label.p == label.q == 0:
        return "it has no impact at all (p = q = 0); the linear modes are L11+, L11-"
    return None


def label_of(m: int, n: int, parity: str | None, p: int, q: int, sign: str) -> Label:
    """The label of an orbit from its counts, p and q in the order of its start: S where a parity is given, else U.

    Raises
    ------
    ImpossibleLabelError
        Where the counts contradict each other, as they can where a velocity is zero to rounding at an origin (impulsive orbit).

    Examples
    --------
    >>> str(label_of(1, 3, "O", 0, 0, "+")), str(label_of(15, 5, None, 8, 7, "-"))
    ('S13O00+', 'U(15)587-')
    """
    return Label("U" if parity is None else "S", m, n, parity, p, q, sign)


def count_half_waves(signs: Iterable[float]) -> int:
    """The number of sign changes in a sequence of velocities (or their signs) over a half period; zeros are passed over.

    Raises
    ------
    ValueError
        For a value that is not a number.

    Examples
    --------
    >>> count_half_waves([1, 0, -1, -1, 0, 0, -1, 1])
    2
    """
    count, last = 0, 0
    for value in signs:
        if math.isnan(value):
            raise ValueError("a velocity is NaN, expected numbers")
        sign = (value > 0) - (value < 0)
        if sign:
            count += last == -sign
            last = sign
    return count


def pieces(label: Label) -> list[str]:
    """The parts of the label's text, without the sign."""
    numbers = [f"({value})" if value > 9 else str(value) for value in (label.m, label.n, label.p, label.q) if value is not None]
    return [label.kind, *numbers[:2], label.parity or "", *numbers[2:]]
