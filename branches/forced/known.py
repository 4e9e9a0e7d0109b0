"""Which families of forced orbits are known already: two are one family if they share an event."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from branches.forced.branch import ForcedBranch
from branches.forced.primitive import kind_of
from branches.forced.tracing import SWITCHES
from bvp.forced import ForcedProblem

__all__ = ["KnownEvents"]

_SAME = 1e-7
"""Largest difference, beside the value, of the parameter at an event that two families share."""

_SPEED = 1e-3
"""Largest relative difference of the fastest impact of the orbit there."""

Key = TypeVar("Key")


@dataclass
class KnownEvents(Generic[Key]):
    """The events of families that were followed. A family that begins at one of them is known if its orbits have the same period, symmetry
    and impacts. Impacts are the same if they are those of the mirror image, so of two mirror images one is known by the other."""

    _rows: dict[str, list[tuple[float, float, Key]]] = field(default_factory=dict)

    def add(self, problem: ForcedProblem, value: float, speed: float, key: Key) -> None:
        """Know a family at a value of its parameter, where it begins, and where the fastest impact of the orbit has a speed."""
        self._rows.setdefault(kind_of(problem), []).append((value, speed, key))

    def add_events(self, branch: ForcedBranch, key: Key) -> None:
        """Know a family at all its events at which others begin."""
        for event in branch.events:
            if event.type in SWITCHES:
                self.add(branch.problem, event.values[branch.name], branch.fastest(event.point), key)

    def family_at(self, kind: str, type: str, value: float, speed: float, fits: Callable[[Key], bool] = lambda key: True) -> Key | None:
        """The family of some kind that begins at an event, at whose orbit the fastest impact has a speed; None if it is not known. Of parts
        that do not interact, several families of one kind begin at one value, at orbits with other impacts."""
        if type == "LB":  # with the other order of its impacts an orbit can have the same sequence, begun at another impact
            return None
        slack = _SAME * max(1.0, abs(value))
        near = ((of, key) for at, of, key in self._rows.get(kind, ()) if abs(at - value) <= slack)
        return next((key for of, key in near if abs(of - speed) <= _SPEED * max(of, speed) and fits(key)), None)
