"""What a figure calls its system, its family and their coordinates, and which families have the names that a scene cites."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.naming.labels import Label, parse, parse_name
from branches.naming.matching import REFERENCE_TOLERANCE, Track, fits_otherwise, matches, nearest_crossing, reaches
from branches.sequences import PERIODIC

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.naming.matching import ReferencePoint

_GREEK = {"mu": r"\mu", "sigma": r"\sigma", "lam": r"\lambda", "rho": r"\rho", "alpha": r"\alpha"}


def symbol_of(name: str, *, velocity: bool = False) -> str:
    """Math symbol of a coordinate, of its velocity, or of a parameter. A letter or Greek name with a number becomes an index.

    Examples
    --------
    >>> symbol_of("u12"), symbol_of("sigma"), symbol_of("hull_x")
    ('u_{12}', '\\\\sigma', '\\\\mathrm{hull\\\\_x}')
    >>> symbol_of("u1", velocity=True), symbol_of("hull", velocity=True)
    ('\\\\dot{u}_{1}', "\\\\mathrm{hull}'")
    """
    parts = re.fullmatch(r"([A-Za-z]|mu|sigma|lam|rho|alpha)_?(\d*)", name)
    if not parts:
        return r"\mathrm{" + re.sub(r"[\\^~]|([$#%&_{} ])", lambda m: "\\" + m[1] if m[1] else "", name) + "}" + "'" * velocity
    letter = _GREEK.get(parts[1], parts[1])
    return (rf"\dot{{{letter}}}" if velocity else letter) + (f"_{{{parts[2]}}}" if parts[2] else "")


def system_text(system: Any) -> str:
    """The system in a title's words: the parameters of its model, or its size where it is given by matrices."""
    described = system.describe()
    numbers = {k: v for k, v in described.items() if isinstance(v, (int, float)) and not isinstance(v, bool)}
    if numbers:
        return ", ".join(rf"${symbol_of(k)} = {v:.6g}$" for k, v in numbers.items())
    n, stops = len(system.coordinates), len(system.stops)
    return f"{n} degree{'s' * (n != 1)} of freedom, {stops} stop{'s' * (stops != 1)}"


_SHORTEST = 4  # digits of a hash


def short_ids(ids: Iterable[str]) -> dict[str, str]:
    """Short texts for the ids of families in one picture: the first digits of the hash, as many as tell it from the others.

    Examples
    --------
    >>> short_ids(["rest-stop+::2c49f5ff", "rest-stop+::87c63b1c", "stop+-stop+:-:2c49a000"])
    {'rest-stop+::2c49f5ff': '#2c49f', 'rest-stop+::87c63b1c': '#87c6', 'stop+-stop+:-:2c49a000': '#2c49a'}
    """
    hashes = {id: id.rpartition(":")[2] for id in ids}
    counts = Counter(text[:n] for text in set(hashes.values()) for n in range(_SHORTEST, len(text) + 1))
    out = {}
    for id, text in hashes.items():
        n = next((n for n in range(_SHORTEST, len(text)) if counts[text[:n]] == 1), len(text))
        out[id] = f"#{text[:n]}"
    return out


def family_text(label: str, ends: tuple[str, str], sequence: str) -> str:
    """What a title calls a family: its label as LaTeX, or its ends and impact sequence where it has no label.

    Examples
    --------
    >>> family_text("", ("rest", "stop"), "++"), family_text("", ("periodic", "periodic"), "++")
    ('rest to stop, sequence ++', 'orbits without a reversal, sequence ++')
    """
    if label:
        from branches.naming.labels import latex, parse

        return latex(parse(label))
    shown = sequence if len(sequence) <= 24 else f"{sequence[:18]}\N{HORIZONTAL ELLIPSIS} ({len(sequence)} letters)"
    if ends == PERIODIC:
        return f"orbits without a reversal, sequence {shown}".replace("-", "\N{MINUS SIGN}")
    return f"{ends[0]} to {ends[1]}" + (f", sequence {shown}" if shown else "").replace("-", "\N{MINUS SIGN}")


def gap_symbol(gap: tuple[float, ...], coordinates: tuple[str, ...]) -> str:
    """Math symbol of a gap coordinate c . u; one of more than three terms is called w.

    Examples
    --------
    >>> gap_symbol((1.0, -1.0), ("u1", "u2")), gap_symbol((0.0, 2.5), ("u1", "u2"))
    ('u_{1} - u_{2}', '2.5\\\\,u_{2}')
    """
    terms = [(c, symbol_of(name)) for c, name in zip(gap, coordinates, strict=True) if c]
    if len(terms) > 3:
        return "w"
    text = ""
    for c, symbol in terms:
        size = "" if abs(c) == 1 else rf"{abs(c):.4g}\,"
        sign = ("-" if c < 0 else "") if not text else (" - " if c < 0 else " + ")
        text += f"{sign}{size}{symbol}"
    return text


class CitedName(NamedTuple):
    """A name that a family goes by: at the points whose label it is, or, where the half-waves are counted otherwise, at the energy and
    quarter period of the reference point."""

    text: str
    label: Label
    h: float | None = None
    alpha: float | None = None

    def points(self, h: np.ndarray, alpha: np.ndarray, labels: Sequence[str]) -> np.ndarray:
        """Which of some successive points (N,) of the family go by the name."""
        if self.h is None or self.alpha is None:
            known = {label: bool(label) and matches(self.label, parse(label)) for label in set(labels)}
            return np.array([known[label] for label in labels], dtype=bool)
        mine = np.zeros(len(h), dtype=bool)
        if h.min() <= self.h <= h.max():
            mine[np.argmin(np.hypot(np.log(h / self.h), np.log(alpha / self.alpha)))] = True
        return mine


def cited_names(branches: Iterable[Branch], points: Mapping[str, ReferencePoint]) -> dict[str, list[CitedName]]:
    """The names that a scene cites for families, by their ids.

    `points` are the reference points {"h", "alpha"} by name, with both, one or none of the values. One with both is for the single family
    that has the orbit: of those with the label, or else of those that have its impacts. Another one is for every family with the label.
    """
    families = [_Family.of(branch) for branch in branches]
    out: dict[str, list[CitedName]] = {}
    for text, point in points.items():
        label = parse_name(text).label
        if label is None:
            continue
        h, alpha = point.get("h"), point.get("alpha")
        near = [family for family in families if family.reaches(h, alpha)]
        for id, name in _named(near, text, label, h, alpha):
            out.setdefault(id, []).append(name)
    return out


class _Family(NamedTuple):
    """The ranges and labels of a family, which show quickly that a reference point is elsewhere."""

    branch: Branch
    h: tuple[float, float]
    alpha: tuple[float, float]
    labels: frozenset[str]

    @classmethod
    def of(cls, branch: Branch) -> _Family:
        h, alpha = branch.points["h"], branch.points["alpha"]
        labels = frozenset(np.unique(branch.points["label"]).tolist()) - {""}
        return cls(branch, (float(h.min()), float(h.max())), (float(alpha.min()), float(alpha.max())), labels)

    def reaches(self, h: float | None, alpha: float | None) -> bool:
        """Whether an orbit at a reference point can be on it; its quarter period is known to `REFERENCE_TOLERANCE`."""
        if h is not None and not reaches(self.h, h):
            return False
        slack = 0.0 if h is None else REFERENCE_TOLERANCE
        return alpha is None or reaches((self.alpha[0] / (1.0 + slack), self.alpha[1] / (1.0 - slack)), alpha)

    def track(self) -> Track:
        """Its points."""
        return list(zip(*(self.branch.points[name].tolist() for name in ("h", "alpha", "label")), strict=True))


def _named(
    families: Sequence[_Family], text: str, label: Label, h: float | None, alpha: float | None
) -> list[tuple[str, CitedName]]:
    for same in (matches, fits_otherwise):
        fits = _test(same, label)
        having = [family for family in families if any(map(fits, family.labels))]
        if h is None and alpha is None:
            return [(family.branch.id, CitedName(text, label)) for family in having]
        found = {family.branch.id: nearest_crossing(family.track(), h, alpha, fits) for family in having}
        distances = {id: crossing[0] for id, crossing in found.items() if crossing is not None}
        if h is None or alpha is None:
            return [(id, CitedName(text, label)) for id in distances]
        if distances:
            id = min(distances, key=lambda id: distances[id])
            return [(id, CitedName(text, label) if same is matches else CitedName(text, label, h, alpha))]
    return []


def _test(same: Callable[[Label, Label], bool], label: Label) -> Callable[[str], bool]:
    return cache(lambda text: bool(text) and same(label, parse(text)))
