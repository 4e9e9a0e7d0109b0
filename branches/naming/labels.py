"""Labels and names of periodic orbits, in the notation of Lee, Nucera, Vakakis, McFarland, Bergman, Physica D 238 (2009) 1868.

    S m n E|O p p +|-     symmetric      u(t + T/2) = -u(t)
    U m n p q +|-         unsymmetric
    L m m +|-             linear modes, all equivalent to L11

m, n: half-waves of absorber (NES) and primary (LO) in the half period, the sign changes of u1' and u2'. p, q: impacts strictly
inside the first and second quarter; O: one more impact at the quarter itself, E: none. +: u1' and u2' have the same sign at
the start of both half periods, where the displacements are zero. Numbers of two or more digits stand in parentheses:
`U(15)578-`.

What is left out at the end matches everything that fits: `U21`, `S73O`, `S13O00`. With one exception, the published short
names S11- and S13+: a symmetric label of m, n and a sign alone has no inner impacts and means SmnO00 with that sign.

A **name** selects an orbit or a family: a label, or a family id `ends:sequence:hash`, and after `@` the energy or quarter period
that choose among several: `U8353-@h=1.9458,alpha=4.9065`.
"""

from __future__ import annotations

import dataclasses
import difflib
import itertools
import math
from collections.abc import Iterable
from functools import lru_cache

from branches.naming.label import (
    ImpossibleLabelError,
    Label,
    LabelSyntaxError,
    Name,
    count_half_waves,
    label_of,
    parse,
    parse_name,
    pieces,
    why_impossible,
)

__all__ = [
    "ImpossibleLabelError",
    "Label",
    "LabelSyntaxError",
    "Name",
    "canonical_label",
    "count_half_waves",
    "label_of",
    "latex",
    "matches",
    "nearest",
    "nearest_labels",
    "parse",
    "parse_name",
    "roots",
    "spelled",
    "cover_label",
    "why_impossible",
]


def canonical_label(label: Label) -> Label:
    """The one label that stands for all equivalent ones: p <= q (Umnpq and Umnqp are one orbit), and L11 for each Lmm.

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


def spelled(text: str, names: Iterable[str]) -> str:
    """A label as it is printed where no start is printed with it: as one of the names has it, otherwise with p <= q.

    Examples
    --------
    >>> spelled("U4502-", ["S31O11", "U4520-"]), spelled("U2210+", []), spelled("", [])
    ('U4520-', 'U2201+', '')
    """
    if not text:
        return text
    label = canonical_label(parse(text))
    return _spellings(tuple(names)).get(label) or str(label)


@lru_cache(maxsize=8)
def _spellings(names: tuple[str, ...]) -> dict[Label, str]:
    return {canonical_label(parse(name)): name for name in reversed(names)}


def matches(pattern: Label, label: Label) -> bool:
    """Whether the label is one of the pattern's: equal in all that the pattern does not leave open, up to equivalence.

    Examples
    --------
    >>> [matches(parse(pattern), parse("U8353-")) for pattern in ("U83", "U8335-", "U8353+")]
    [True, True, False]
    """
    wanted, given = (dataclasses.astuple(canonical_label(item)) for item in (pattern, label))
    return all(field is None or field == value for field, value in zip(wanted, given, strict=True))


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
    short = short and label.parity == "O" and label.p == 0 and label.sign is not None
    body = "".join(pieces(label)[: 3 if short else None])
    return rf"$\mathrm{{{body}}}" + (f"^{{{label.sign}}}$" if label.sign else "$")


def nearest(text: str, candidates: Iterable[object], count: int = 3) -> tuple[str, ...]:
    """The `count` candidates whose text is most like the given one, the most alike first.

    Examples
    --------
    >>> nearest("S73O3-", ["S73O33-", "S13O00+", "U8353-"], 1)
    ('S73O33-',)
    """
    return tuple(difflib.get_close_matches(text, dict.fromkeys(str(item) for item in candidates), n=count, cutoff=0.0))


_IMPACT, _KIND = 3, 9
"""Half-waves that an impact, and another symmetry, count for: half-waves and sign change along a family, impacts only at its grazings."""


def nearest_labels(asked: Label, existing: Iterable[str], count: int = 3) -> tuple[str, ...]:
    """The existing labels nearest to one that nothing has: `count` by their fields, and the one whose text is most alike.

    Parameters
    ----------
    asked : Label
        What it leaves open makes no difference.
    existing : iterable of str
        Labels.
    count : int

    Returns
    -------
    tuple of str
        The nearest first: by the sum of the differences of half-waves, impacts (three times) and sign; equally near ones by their text.
        Of several equivalent labels the canonical one.

    Examples
    --------
    >>> nearest_labels(parse("U3401"), ["S13O00+", "U3411-", "U3201-", "U1101+", "U8353-"], 1)
    ('U3201-', 'U3411-')
    """
    wanted = canonical_label(asked)
    known = {str(label): label for label in (canonical_label(parse(text)) for text in existing)}
    alike = nearest(str(wanted), known, max(1, len(known)))
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
                root = label_of(label.m // count, label.n // count, parity, p, q, sign)
            except ImpossibleLabelError:
                continue
            if matches(cover_label(root, count), label):
                found.append((root, count))
    return tuple(found)
