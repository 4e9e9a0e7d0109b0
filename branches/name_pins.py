"""Pins: the orbit that a scene cites for a bare name, and what it may choose.

A pin chooses among orbits that a search at its energy has found, by their quarter period. It comes first to those with the label itself;
for a name whose half-waves are counted otherwise than the literature prints them, to those of the same kind with the same impacts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from branches.labels import Label, canonical, matches, parse_name

__all__ = ["fits_otherwise", "note", "pin_of"]

Pin = Mapping[str, float]


def pin_of(text: str, label: Label | None, pins: Mapping[str, Pin]) -> Pin | None:
    """The pin of a bare name: of its text, or of an equivalent label; for a label that lacks nothing but its sign, that of the one sign
    that has a pin.

    Examples
    --------
    >>> from branches.labels import parse
    >>> pins = {"U8344-": {"h": 1.2, "alpha": 4.89}, "U8353-": {"h": 1.9, "alpha": 4.91}}
    >>> pin_of("U8344", parse("U8344"), pins), pin_of("U8335-", parse("U8335-"), pins)
    ({'h': 1.2, 'alpha': 4.89}, {'h': 1.9, 'alpha': 4.91})
    """
    if text in pins or label is None:
        return pins.get(text)
    known = {canonical(named): pin for named, pin in ((parse_name(name).label, pin) for name, pin in pins.items()) if named is not None}
    asked = canonical(label)
    if label.sign is not None or label.p is None:
        return known.get(asked)
    signed = [known[one] for one in (replace(asked, sign=sign) for sign in "+-") if one in known]
    return known.get(asked) or (signed[0] if len(signed) == 1 else None)


def fits_otherwise(asked: Label, label: Label) -> bool:
    """Whether a label has the kind and, as far as they are given, the impacts of the one asked for; half-waves and sign may differ."""
    one, other = canonical(asked), canonical(label)
    fields = ((one.kind, other.kind), (one.parity, other.parity), (one.p, other.p), (one.q, other.q))
    return all(wanted is None or wanted == given for wanted, given in fields)


def note(asked: Label | None, label: Label | None) -> str:
    """What there is to say of an orbit whose label is not the one asked for; nothing where it is, or where no label was asked for."""
    if asked is None or (label is not None and matches(asked, label)):
        return ""
    return f"{asked} is the scene's name of this orbit, whose half-waves are counted otherwise"
