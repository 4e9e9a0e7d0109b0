"""The regions of a chart as data: cells of the plane, and the kinds of attractors that were found in each."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bvp.texts import brief
from transitions.basin.record import Attractor, AttractorKind

__all__ = ["MotionKind", "Regions", "kind_of_attractor"]


class MotionKind(NamedTuple):
    """What kind of attractor it is: attractors of one kind are not told apart.

    kind: a value of `AttractorKind`. period: in periods of the loads, 0 if there is none. impacts: in the period. symmetric: whether
    x(t + T/2) = -x(t); not told of linear motion without impacts, which has no other choice. sticks: whether a stop sticks for a part of
    the period.
    """

    kind: str
    period: int = 0
    impacts: int = 0
    symmetric: bool = False
    sticks: bool = False

    @property
    def text(self) -> str:
        """The kind in words.

        Examples
        --------
        >>> MotionKind("periodic", 2, 3).text, MotionKind("periodic", 1, 2, True).text, MotionKind("chaos").text
        ('period 2, 3 impacts', 'period 1, 2 impacts, symmetric', 'chaos')
        """
        if self.kind != AttractorKind.PERIODIC.value:
            return self.kind
        count = "no impacts" if not self.impacts else f"{self.impacts} impact{'s' * (self.impacts != 1)}"
        more = ", symmetric" if self.symmetric else ""
        return f"period {self.period}, {count}{more}{', sticks' if self.sticks else ''}"


def kind_of_attractor(attractor: Attractor, impacts: int, sticks: bool) -> MotionKind:
    """The kind of an attractor. impacts: of the simulation, in its period; sticks: whether a stop stuck for a while."""
    if attractor.kind is not AttractorKind.PERIODIC:
        return MotionKind(attractor.kind.value)
    problem = attractor.problem
    if problem is not None:  # bounces that are summed are one impact
        impacts = len(problem.impacts) * (2 if problem.half else 1)
    free = bool(impacts) or (problem is not None and problem.is_smooth)
    return MotionKind(attractor.kind.value, attractor.period, impacts, free and attractor.family.startswith("half-"), sticks)


@brief
@dataclass(frozen=True, eq=False)
class Regions:
    """A grid of simulated attractors over the plane of two parameters, ny times nx cells.

    Attributes
    ----------
    x, y : (nx,), (ny,) ndarray
        Values of the parameters in the middle of the cells.
    found : tuple of tuple of frozenset of MotionKind
        ``found[j][i]``: the kinds in the cell at (x[i], y[j]); empty where nothing has settled or the cell was not simulated.
    reasons : mapping of str to int
        Of cells without an attractor: how many there are for each reason.
    simulated : int
        Motions that were simulated.
    unsettled : int
        Of these, the motions that did not settle.
    """

    x: np.ndarray
    y: np.ndarray
    found: tuple[tuple[frozenset[MotionKind], ...], ...]
    reasons: Counter[str]
    simulated: int
    unsettled: int

    def __len__(self) -> int:
        return len(self.x) * len(self.y)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        rows = [(f"{count / len(self):.1%}", " and ".join(kind.text for kind in kinds)) for kinds, count in self.counts.items()]
        return f"Regions of {len(self.x)} x {len(self.y)} cells, {len(rows)} sets of attractors", rows

    @cached_property
    def counts(self) -> dict[tuple[MotionKind, ...], int]:
        """The sets of attractors that occur, with the number of their cells, the largest first. Each is sorted."""
        counts = Counter(tuple(sorted(kinds)) for row in self.found for kinds in row if kinds)
        return dict(sorted(counts.items(), key=lambda pair: (-pair[1], pair[0])))

    @cached_property
    def image(self) -> np.ndarray:
        """Index in `counts` of the set of each cell, (ny, nx); -1 without an attractor."""
        index = {kinds: k for k, kinds in enumerate(self.counts)}
        return np.array([[index.get(tuple(sorted(kinds)), -1) for kinds in row] for row in self.found], dtype=np.int64)
