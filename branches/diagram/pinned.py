"""Which families of a picture the names are for that a scene pins, and where on them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from branches.naming.label import Label
from branches.naming.labels import matches, parse, parse_name
from branches.naming.reference_points import PIN_TOLERANCE, Track, fits_otherwise, nearest_crossing, reaches

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.naming.reference_points import Pin

__all__ = ["PinnedName", "pinned_names"]


class PinnedName(NamedTuple):
    """A name that a family goes by: at the points whose label it is, or, where the half-waves are counted otherwise, at the energy and
    quarter period of the pin."""

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


def pinned_names(branches: Iterable[Branch], pins: Mapping[str, Pin]) -> dict[str, list[PinnedName]]:
    """The pinned names of families, by their ids.

    A pin with energy and quarter period is for the one family that has the orbit: of those with the label, or else of those that have
    its impacts. Another one is for every family with the label.

    Parameters
    ----------
    branches : iterable of Branch
    pins : mapping of names to {"h", "alpha"}, both, one or none of them
    """
    families = [_Family.of(branch) for branch in branches]
    out: dict[str, list[PinnedName]] = {}
    for text, pin in pins.items():
        label = parse_name(text).label
        if label is None:
            continue
        h, alpha = pin.get("h"), pin.get("alpha")
        near = [family for family in families if family.reaches(h, alpha)]
        for id, name in _named(near, text, label, h, alpha):
            out.setdefault(id, []).append(name)
    return out


class _Family(NamedTuple):
    """What tells quickly that a pin is elsewhere: the ranges and labels of a family."""

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
        """Whether an orbit at a pin can be on it; its quarter period is known to `PIN_TOLERANCE`."""
        if h is not None and not reaches(self.h, h):
            return False
        slack = 0.0 if h is None else PIN_TOLERANCE
        return alpha is None or reaches((self.alpha[0] / (1.0 + slack), self.alpha[1] / (1.0 - slack)), alpha)

    def track(self) -> Track:
        """Its points."""
        return list(zip(*(self.branch.points[name].tolist() for name in ("h", "alpha", "label")), strict=True))


def _named(
    families: Sequence[_Family], text: str, label: Label, h: float | None, alpha: float | None
) -> list[tuple[str, PinnedName]]:
    for same in (matches, fits_otherwise):
        fits = _test(same, label)
        having = [family for family in families if any(map(fits, family.labels))]
        if h is None and alpha is None:
            return [(family.branch.id, PinnedName(text, label)) for family in having]
        found = {family.branch.id: nearest_crossing(family.track(), h, alpha, fits) for family in having}
        misses = {id: crossing[0] for id, crossing in found.items() if crossing is not None}
        if h is None or alpha is None:
            return [(id, PinnedName(text, label)) for id in misses]
        if misses:
            id = min(misses, key=lambda id: misses[id])
            return [(id, PinnedName(text, label) if same is matches else PinnedName(text, label, h, alpha))]
    return []


def _test(same: Callable[[Label, Label], bool], label: Label) -> Callable[[str], bool]:
    return cache(lambda text: bool(text) and same(label, parse(text)))
