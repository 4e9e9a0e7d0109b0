"""Which families of a picture the names are for that a scene pins, and where on them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from branches.crossings import nearest_crossing
from branches.label import Label
from branches.labels import matches, parse, parse_name
from branches.name_pins import fits_otherwise

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.name_pins import Pin

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
    tracks = {branch.id: list(zip(*(branch.points[name].tolist() for name in ("h", "alpha", "label")), strict=True)) for branch in branches}
    out: dict[str, list[PinnedName]] = {}
    for text, pin in pins.items():
        label = parse_name(text).label
        if label is None:
            continue
        h, alpha = pin.get("h"), pin.get("alpha")
        for id, name in _families(tracks, text, label, h, alpha):
            out.setdefault(id, []).append(name)
    return out


def _families(
    tracks: Mapping[str, list[tuple[float, float, str]]], text: str, label: Label, h: float | None, alpha: float | None
) -> list[tuple[str, PinnedName]]:
    for same in (matches, fits_otherwise):
        fits = _test(same, label)
        having = {id: track for id, track in tracks.items() if any(fits(point[2]) for point in track)}
        if h is None and alpha is None:
            return [(id, PinnedName(text, label)) for id in having]
        found = {id: nearest_crossing(track, h, alpha, fits) for id, track in having.items()}
        misses = {id: crossing[0] for id, crossing in found.items() if crossing is not None}
        if h is None or alpha is None:
            return [(id, PinnedName(text, label)) for id in misses]
        if misses:
            id = min(misses, key=lambda id: misses[id])
            return [(id, PinnedName(text, label) if same is matches else PinnedName(text, label, h, alpha))]
    return []


def _test(same: Callable[[Label, Label], bool], label: Label) -> Callable[[str], bool]:
    return cache(lambda text: bool(text) and same(label, parse(text)))
