"""Matching of labels: which labels match a name, which orbit a label covers, and which family a reference point selects.

A scene gives a reference point (h, alpha) for a bare name. It chooses among the orbits that a search finds at its energy. Orbits with the
label itself come first. If the literature counts half-waves otherwise, orbits of the same kind with the same impacts follow. A catalogue
has curves in place of a search: there the crossing of a curve with the energy or the quarter period is chosen.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache

from branches.naming.labels import ImpossibleLabelError, Label, canonical_label, most_alike, parse, parse_name, parse_printed

__all__ = [
    "AmbiguousName", "Crossing", "NameNotFound", "REFERENCE_TOLERANCE", "ReferencePoint", "Track", "cover_label", "fits_otherwise",
    "matches", "nearest_crossing", "nearest_labels", "reaches", "reference_point_of", "remark_on_name", "roots", "spelled",
    "why_a_cover",
]  # fmt: skip


def matches(pattern: Label, label: Label) -> bool:
    """Whether the label is one of the pattern's: equal in all that the pattern does not leave open, up to equivalence.

    Examples
    --------
    >>> [matches(parse(pattern), parse("U8353-")) for pattern in ("U83", "U8335-", "U8353+")]
    [True, True, False]
    """
    wanted, given = (dataclasses.astuple(canonical_label(item)) for item in (pattern, label))
    return all(field is None or field == value for field, value in zip(wanted, given, strict=True))


def spelled(text: str, names: Iterable[str]) -> str:
    """A label as it is printed where no start is printed with it: as one of the names has it, otherwise with p <= q.

    Examples
    --------
    >>> spelled("U4502-", ["S31O11", "U4520-"]), spelled("U2210+", []), spelled("", [])
    ('U4520-', 'U2201+', '')
    """
    if not text:
        return text
    label = canonical_label(parse_printed(text))
    return _spellings(tuple(names)).get(label) or str(label)


@lru_cache(maxsize=8)
def _spellings(names: tuple[str, ...]) -> dict[Label, str]:
    return {canonical_label(parse(name)): name for name in reversed(names)}


_IMPACT, _KIND = 3, 9
"""Half-waves that an impact, and another symmetry, count for: half-waves and sign change along a family, impacts only at its grazings."""


def nearest_labels(asked: Label, existing: Iterable[str], count: int = 3) -> tuple[str, ...]:
    """The existing labels nearest to a label without an orbit: `count` by their fields, and one by its spelling.

    Fields are compared by the sum of the differences of half-waves, impacts (three times) and sign. Fields that the label leaves open are
    not compared. Of several equivalent labels the canonical one is given.

    Examples
    --------
    >>> nearest_labels(parse("U3401"), ["S13O00+", "U3411-", "U3201-", "U1101+", "U8353-"], 1)
    ('U3201-', 'U3411-')
    """
    wanted = canonical_label(asked)
    known = {str(label): label for label in (canonical_label(parse_printed(text)) for text in existing)}
    alike = most_alike(str(wanted), known, max(1, len(known)))
    near = sorted(alike, key=lambda text: _distance(wanted, known[text]))[:count]
    return tuple(dict.fromkeys([*near, *alike[:1]]))


def _distance(asked: Label, label: Label) -> int:
    pairs = [(1, asked.m, label.m), (1, asked.n, label.n), (_IMPACT, asked.p, label.p), (_IMPACT, asked.q, label.q)]
    apart = sum(weight * abs(one - other) for weight, one, other in pairs if one is not None and other is not None)
    marks = ((_KIND, asked.kind, label.kind), (_IMPACT, asked.parity, label.parity), (1, asked.sign, label.sign))
    return apart + sum(weight for weight, one, other in marks if one is not None and one != other)


def cover_label(label: Label, count: int) -> Label:
    """The label of the `count`-fold cover of the orbit that has the given complete label.

    An even cover of a symmetric orbit is unsymmetric. The sign is left open where the cover starts its second half
    in the middle of a half period's sequence (an even cover of an unsymmetric `-` orbit).

    Examples
    --------
    >>> str(cover_label(parse("S13+"), 3)), str(cover_label(parse("U2101+"), 3))
    ('S39O11+', 'U6321+')
    """
    if not label.is_complete or count < 1:
        raise ValueError(f"the {count}-fold cover of {label}: expected a complete label and a cover of 1 or more")
    if label.p is None or label.q is None:
        return label
    m, n, p, q = count * label.m, count * label.n, label.p, label.q
    if label.kind == "S":
        impacts = count * (2 * p + (label.parity == "O"))
        if count % 2:
            return dataclasses.replace(label, m=m, n=n, p=impacts // 2, q=impacts // 2)
        return Label("U", m, n, None, impacts // 2, impacts // 2, label.sign)
    quarters = ([p, q, q, p] * count)[: 2 * count]
    sign = label.sign if count % 2 or label.sign == "+" else None
    return Label("U", m, n, None, sum(quarters[:count]), sum(quarters[count:]), sign)


def roots(label: Label) -> tuple[tuple[Label, int], ...]:
    """The labels and the numbers k, two or more, of whose k-fold cover the given complete label can be; p <= q.

    Examples
    --------
    >>> [(str(root), count) for root, count in roots(parse("S39O11+"))]
    [('S13O00+', 3)]
    """
    if not label.is_complete or label.p is None or label.q is None:
        return ()
    found = []
    impacts = label.p + label.q + (label.parity == "O")  # in the half period, which is `count` half periods of the root
    for count in range(2, math.gcd(label.m, label.n, impacts) + 1):
        if label.m % count or label.n % count or impacts % count:
            continue
        each = impacts // count
        fields: list[tuple[str | None, int, int]] = [("O" if each % 2 else "E", each // 2, each // 2)]
        fields += [(None, p, each - p) for p in range(each // 2 + 1)]
        for (parity, p, q), sign in itertools.product(fields, "+-"):
            try:
                root = Label("U" if parity is None else "S", label.m // count, label.n // count, parity, p, q, sign)
            except ImpossibleLabelError:
                continue
            if matches(cover_label(root, count), label):
                found.append((root, count))
    return tuple(found)


REFERENCE_TOLERANCE = 0.02
"""How far, relatively, the quarter period of a chosen family may be from its reference point, at the energy of the point."""


class NameNotFound(ValueError):
    """No orbit has the name within the bounds; the message says what was searched and what exists."""


class AmbiguousName(ValueError):
    """Several families have the name; the message lists the suffix that selects each."""


def why_a_cover(label: Label, exists: Callable[[Label], bool]) -> str:
    """Which multiple cover of an existing orbit a label is; nothing if it is none.

    Examples
    --------
    >>> why_a_cover(parse("L22-"), lambda label: True)
    'L22- is the 2-fold cover of L11-; expected the name of a primitive orbit'
    """
    known = ((canonical_label(label), label.m),) if label.kind == "L" else roots(label)
    for root, count in known:
        if count > 1 and exists(root):
            return f"{label} is the {count}-fold cover of {root}; expected the name of a primitive orbit"
    return ""


ReferencePoint = Mapping[str, float]


def reference_point_of(text: str, label: Label | None, points: Mapping[str, ReferencePoint]) -> ReferencePoint | None:
    """The reference point of a bare name: of its text, or of an equivalent label.

    A label without a sign uses the point of the label with a sign, if only one sign has a point.

    Examples
    --------
    >>> points = {"U8344-": {"h": 1.2, "alpha": 4.89}, "U8353-": {"h": 1.9, "alpha": 4.91}}
    >>> reference_point_of("U8344", parse("U8344"), points), reference_point_of("U8335-", parse("U8335-"), points)
    ({'h': 1.2, 'alpha': 4.89}, {'h': 1.9, 'alpha': 4.91})
    """
    if text in points or label is None:
        return points.get(text)
    known = {canonical_label(named): point for name, point in points.items() if (named := parse_name(name).label) is not None}
    asked = canonical_label(label)
    if label.sign is not None or label.p is None:
        return known.get(asked)
    signed = [known[one] for one in (dataclasses.replace(asked, sign=sign) for sign in "+-") if one in known]
    return known.get(asked) or (signed[0] if len(signed) == 1 else None)


def fits_otherwise(asked: Label, label: Label) -> bool:
    """Whether a label has the kind and impacts of the requested one, as far as it gives them; half-waves and sign may differ."""
    one, other = canonical_label(asked), canonical_label(label)
    fields = ((one.kind, other.kind), (one.parity, other.parity), (one.p, other.p), (one.q, other.q))
    return all(wanted is None or wanted == given for wanted, given in fields)


def remark_on_name(asked: Label | None, label: Label | None) -> str:
    """A remark if an orbit's label differs from the requested one; else empty."""
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
    """Whether a range contains a value, or ends so close to it that both print alike.

    Examples
    --------
    >>> reaches((0.118507810594, 14.5537010891), 0.1185078), reaches((0.118507810594, 14.5537010891), 14.56)
    (True, False)
    """
    return ends[0] * (1.0 - _ROUNDED) <= value <= ends[1] * (1.0 + _ROUNDED)


def nearest_crossing(
    track: Track, h: float | None, alpha: float | None, fits: Callable[[str], bool] | None = None
) -> tuple[float, Crossing] | None:
    """The orbit of a track at an energy, or else at a quarter period. Of several at an energy, the one nearest to the quarter period.

    One of the two points beside a crossing must have a label that fits.

    Returns
    -------
    (distance, orbit) or None
        The relative difference of the quarter period, and (h, alpha). None if no orbit is within `REFERENCE_TOLERANCE`.

    Examples
    --------
    >>> nearest_crossing([(1.0, 2.0, "S13O00+"), (3.0, 1.0, "S13O00+")], 2.0, None)
    (0.0, (2.0, 1.5))
    """
    best: tuple[float, Crossing] | None = None
    key, value = (1, alpha or 0.0) if h is None else (0, h)
    for one, other in zip(track, [*track[1:], track[-1]], strict=True):
        before, after = one[:2][key] - value, other[:2][key] - value
        if before * after > 0.0 and abs(before) > _ROUNDED * value:
            continue
        if fits is not None and not (fits(one[2]) or fits(other[2])):
            continue
        part = before / (before - after) if before * after <= 0.0 and before != after else 0.0
        crossing = one[0] + part * (other[0] - one[0]), one[1] + part * (other[1] - one[1])
        distance = abs(crossing[1] / alpha - 1.0) if h is not None and alpha is not None else 0.0
        if distance < (best[0] if best else REFERENCE_TOLERANCE):
            best = (distance, crossing)
    return best
