"""Reference points of names, and the errors of a name that can be read.

A scene gives a reference point (h, alpha) for a bare name. It chooses among the orbits that a search finds at its energy. Orbits with the
label itself come first. If the literature counts half-waves otherwise, orbits of the same kind with the same impacts follow. A catalogue
has curves in place of a search: there the crossing of a curve with the energy or the quarter period is chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from branches.naming.labels import Label, canonical_label, matches, parse_name, roots

__all__ = [
    "AmbiguousName",
    "Crossing",
    "NameNotFound",
    "REFERENCE_TOLERANCE",
    "Track",
    "crossings",
    "fits_otherwise",
    "nearest_crossing",
    "note",
    "reference_point_of",
    "reaches",
    "why_a_cover",
]

REFERENCE_TOLERANCE = 0.02
"""How far, relatively, the quarter period of a chosen family may be from its pin at the pin's energy."""


class NameNotFound(ValueError):
    """No orbit has the name within the bounds; the message says what was searched and what exists."""


class AmbiguousName(ValueError):
    """Several families have the name; the message lists the suffix that selects each."""


def why_a_cover(label: Label, exists: Callable[[Label], bool]) -> str:
    """Which multiple cover of an existing orbit a label is; nothing if it is none.

    Examples
    --------
    >>> from branches.naming.labels import parse
    >>> why_a_cover(parse("L22-"), lambda label: True)
    'L22- is the 2-fold cover of L11-; expected the name of a primitive orbit'
    """
    known = ((canonical_label(label), label.m),) if label.kind == "L" else roots(label)
    for root, count in known:
        if count > 1 and exists(root):
            return f"{label} is the {count}-fold cover of {root}; expected the name of a primitive orbit"
    return ""


ReferencePoint = Mapping[str, float]


def reference_point_of(text: str, label: Label | None, pins: Mapping[str, ReferencePoint]) -> ReferencePoint | None:
    """The pin of a bare name: of its text, or of an equivalent label; for a label that lacks nothing but its sign, that of the one sign
    that has a pin.

    Examples
    --------
    >>> from branches.naming.labels import parse
    >>> pins = {"U8344-": {"h": 1.2, "alpha": 4.89}, "U8353-": {"h": 1.9, "alpha": 4.91}}
    >>> reference_point_of("U8344", parse("U8344"), pins), reference_point_of("U8335-", parse("U8335-"), pins)
    ({'h': 1.2, 'alpha': 4.89}, {'h': 1.9, 'alpha': 4.91})
    """
    if text in pins or label is None:
        return pins.get(text)
    labelled = ((parse_name(name).label, pin) for name, pin in pins.items())
    known = {canonical_label(named): pin for named, pin in labelled if named is not None}
    asked = canonical_label(label)
    if label.sign is not None or label.p is None:
        return known.get(asked)
    signed = [known[one] for one in (replace(asked, sign=sign) for sign in "+-") if one in known]
    return known.get(asked) or (signed[0] if len(signed) == 1 else None)


def fits_otherwise(asked: Label, label: Label) -> bool:
    """Whether a label has the kind and, as far as they are given, the impacts of the one asked for; half-waves and sign may differ."""
    one, other = canonical_label(asked), canonical_label(label)
    fields = ((one.kind, other.kind), (one.parity, other.parity), (one.p, other.p), (one.q, other.q))
    return all(wanted is None or wanted == given for wanted, given in fields)


def note(asked: Label | None, label: Label | None) -> str:
    """What there is to say of an orbit whose label is not the one asked for; nothing where it is, or where no label was asked for."""
    if asked is None or (label is not None and matches(asked, label)):
        return ""
    return f"{asked} is the scene's name of this orbit, whose half-waves are counted otherwise"


_ROUNDED = 1e-5
"""How far outside a family, relatively, an orbit is that is named by the printed digits of the family's end."""

Track = Sequence[tuple[float, float, str]]
"""h, alpha and label of the points of a family, in their order."""

Crossing = tuple[float, float]
"""h and alpha of an orbit."""


def reaches(ends: tuple[float, float], value: float) -> bool:
    """Whether a range holds a value, or ends so near to it that printed digits do not tell them apart.

    Examples
    --------
    >>> reaches((0.118507810594, 14.5537010891), 0.1185078), reaches((0.118507810594, 14.5537010891), 14.56)
    (True, False)
    """
    return ends[0] * (1.0 - _ROUNDED) <= value <= ends[1] * (1.0 + _ROUNDED)


def crossings(track: Track, key: int, value: float, fits: Callable[[str], bool] | None = None) -> list[Crossing]:
    """Where a track reaches a value of h (key 0) or alpha (key 1), between points of which one has a label that fits.

    Examples
    --------
    >>> crossings([(1.0, 2.0, "S13O00+"), (3.0, 1.0, "S13O00+")], 0, 2.0)
    [(2.0, 1.5)]
    >>> crossings([(1.0, 2.0, "S13O00+"), (3.0, 1.0, "S13O00+")], 0, 3.0)
    [(3.0, 1.0), (3.0, 1.0)]
    """
    out = []
    for one, other in zip(track, [*track[1:], track[-1]], strict=True):
        before, after = one[:2][key] - value, other[:2][key] - value
        if before * after > 0.0 and abs(before) > _ROUNDED * value:
            continue
        if fits is not None and not (fits(one[2]) or fits(other[2])):
            continue
        part = before / (before - after) if before * after <= 0.0 and before != after else 0.0
        out.append((one[0] + part * (other[0] - one[0]), one[1] + part * (other[1] - one[1])))
    return out


def nearest_crossing(
    track: Track, h: float | None, alpha: float | None, fits: Callable[[str], bool] | None = None
) -> tuple[float, Crossing] | None:
    """The orbit at an energy, a quarter period, or an energy with the quarter period nearest to one: how far that is off, relatively, and
    the orbit; None where there is none, or none within `REFERENCE_TOLERANCE`.

    Raises
    ------
    ValueError
        Without h and alpha.
    """
    if h is None and alpha is None:
        raise ValueError("neither h nor alpha is given, expected one or both")
    best: tuple[float, Crossing] | None = None
    for crossing in crossings(track, 1, alpha, fits) if h is None and alpha is not None else crossings(track, 0, h or 0.0, fits):
        miss = abs(crossing[1] / alpha - 1.0) if h is not None and alpha is not None else 0.0
        if miss < (best[0] if best else REFERENCE_TOLERANCE):
            best = (miss, crossing)
    return best
