"""A followed family of orbits under periodic loads, as data: its points, events and ends. Nothing here follows a family."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from branches.events import Ended, normal_form_text
from branches.forced.identity import FullResponse, full_response
from bvp.contact_sequence import joined_sequence
from bvp.forced import ForcedProblem
from bvp.texts import brief

__all__ = ["ForcedBranch", "ForcedEvent", "largest_multiplier", "sequence_text", "wrapped"]

_ROUNDING = 16.0 * np.finfo(float).eps
"""Relative change of the unknowns whose effect on a multiplier, times `_SAFETY`, counts as its error."""

_INSTANT = 1e-12
"""Part of the period within which impacts are at one instant."""

_SAFETY = 10.0
_LEAST_ERROR = 1e-12


class ForcedEvent(NamedTuple):
    """A special point of a forced family, with its error bar.

    id: type and count along the branch, "PD1". point: index of its point. values: of all parameters. bracket: arclengths between which it
    certainly is. residual: of its test function. stop: contact touched or left (GR). angle: of the pair of multipliers in (0, pi) (NS).
    multiplier: modulus of the largest nontrivial one. neighbours: at GR the sequences of the families that begin there, each with whether
    the motion persists; else both are on one side of the parameter, a nonsmooth fold. symmetric: whether each of these has symmetric
    orbits, solved over half the period; empty if it is not known. coefficient: of the normal form at SN, PD, SB and NS
    (`bvp.criticality`); criticality: what it means at PD, SB and NS.
    """

    id: str
    type: str
    point: int
    values: Mapping[str, float]
    arclength: float
    status: str
    bracket: tuple[float, float]
    residual: float
    stop: str | None
    angle: float | None
    note: str | None
    multiplier: float | None
    neighbours: tuple[tuple[str, bool], ...] = ()
    symmetric: tuple[bool, ...] = ()
    coefficient: float | None = None
    criticality: str | None = None

    @property
    def normal_form(self) -> str:
        """The criticality and the coefficient, as a table shows them."""
        return normal_form_text(self.criticality, self.coefficient)

    @property
    def remark(self) -> str:
        """What is said about it in a table."""
        parts = [self.note or ""]
        if self.angle is not None:
            parts.append(f"angle {self.angle:.8g}")
        for k, (sequence, persists) in enumerate(self.neighbours):
            symmetric = any(self.symmetric[k : k + 1])
            side = "the motion persists" if persists else "nonsmooth fold, on this side too"
            # The response without impacts is one. A sequence can have symmetric orbits and others.
            family = f"symmetric orbits with sequence {sequence} begin" if symmetric and sequence else f"{sequence_text(sequence)} begins"
            parts.append(f"{family} here ({side})")
        return "; ".join(dict.fromkeys(part for part in parts if part))


def sequence_text(sequence: str) -> str:
    """A sequence in words: "without impacts" if it is empty."""
    return f"sequence {sequence}" if sequence else "the response without impacts"


def largest_multiplier(problem: ForcedProblem, multipliers: np.ndarray) -> float:
    """Largest modulus of the nontrivial multipliers of an orbit, given all 2n of its period. Without a clock one of them is 1, and is left
    out. A conservative system with one degree of freedom has trivial ones only, which are 1."""
    if not multipliers.size:
        return 1.0
    if not problem.has_clock and np.all(np.isfinite(multipliers)):
        multipliers = np.delete(multipliers, np.argmin(np.abs(multipliers - 1.0)))
    return float(np.abs(multipliers).max())


def wrapped(fractions: np.ndarray) -> np.ndarray:
    """Return fractions of the period modulo 1. Those that are whole to rounding are 0, not nearly 1."""
    rest = fractions % 1.0
    return np.where(rest > 1.0 - _INSTANT, 0.0, rest)


@brief
@dataclass(frozen=True, eq=False)
class ForcedBranch:
    """A family of forced orbits with k impacts in the solved segment, in order of arclength.

    Attributes
    ----------
    problem : ForcedProblem
    unknowns, tangents : (N, u) ndarray
        Of the problem; the tangents point along growing arclength.
    arclength, residual : (N,) ndarray
    events : tuple of ForcedEvent
    ended : (Ended, Ended)
        At the first point and at the last.
    start : int
        Index of the point that it was started from.
    interval : (float, float)
        Range of the parameter in which it was followed.
    """

    problem: ForcedProblem
    unknowns: np.ndarray
    tangents: np.ndarray
    arclength: np.ndarray
    residual: np.ndarray
    events: tuple[ForcedEvent, ...]
    ended: tuple[Ended, Ended]
    start: int
    interval: tuple[float, float]

    def __len__(self) -> int:
        return len(self.unknowns)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        low, high = float(self.parameter.min()), float(self.parameter.max())
        title = f"ForcedBranch of {len(self)} points, {sequence_text(self.sequence)}, {self.name} = {low:.8g} to {high:.8g}"
        return title, [(event.id, f"{self.name} = {event.values[self.name]:.12g}") for event in self.events]

    @cached_property
    def full_family(self) -> FullResponse:
        """The family beyond the branch, and what identifies it."""
        return full_response(self)

    @cached_property
    def id(self) -> str:
        """`closure:sequence:hash` of the family, which does not depend on how it was reached or cut: see `branches.forced.identity`."""
        return self.full_family.ids[0]

    @property
    def known_id(self) -> str | None:
        """Its id if a catalogue gave it or it was computed before, else None: the family is not followed for it."""
        known = {"id", "full_family"} & self.__dict__.keys()
        return self.id if known else None

    def share_identity(self, other: ForcedBranch) -> None:
        """Take over the full family of a branch of the same orbits in the same window, if it is known."""
        if "full_family" in other.__dict__:
            self.__dict__["full_family"] = other.full_family

    def known_as(self, id: str) -> ForcedBranch:
        """This branch, with the id of its family known. The family is not followed for it."""
        self.__dict__["id"] = id
        return self

    @property
    def name(self) -> str:
        """The released parameter."""
        return self.problem.released[0]

    @cached_property
    def parameter(self) -> np.ndarray:
        """Its values, (N,)."""
        return self.unknowns[:, self.problem.place].copy()

    @cached_property
    def periods(self) -> np.ndarray:
        """T, (N,)."""
        return np.array([self.problem.period(y) for y in self.unknowns])

    @cached_property
    def _fractions(self) -> np.ndarray:
        """Time of each solved impact as a fraction of the period, (N, k); without a clock since the first one."""
        problem = self.problem
        if problem.has_clock:
            return np.array([problem.nodes(y)[:, 2 * problem.degrees_of_freedom] for y in self.unknowns])
        times = np.array([problem.flight_times(y) for y in self.unknowns])
        return (np.cumsum(times, axis=1) - times) / self.periods[:, None]

    @cached_property
    def _order(self) -> tuple[np.ndarray, np.ndarray]:
        """The nodes in order of phase, from the impact with the smallest one at the start, and fractions of the period to be added."""
        problem = self.problem
        count = len(problem.sequence)
        nodes, added = np.arange(count), np.zeros(count)
        if problem.half:
            nodes, added = np.tile(nodes, 2), np.repeat([0.0, 0.5], count)
        fractions = wrapped(self._fractions[self.start, nodes] + added)
        fractions[~np.isin(nodes, problem.impacts)] = math.inf
        # Of impacts at one instant the first one of the solved sequence is the first: rounding does not order them.
        tied = fractions <= np.min(fractions, initial=math.inf) + _INSTANT
        first = int(np.argmax(tied & ~np.roll(tied, 1))) if count else 0
        return np.roll(nodes, -first)[:count], np.roll(added, -first)[:count]

    @cached_property
    def _impacts(self) -> tuple[np.ndarray, np.ndarray]:
        """The same, without the releases."""
        nodes, added = self._order
        kept = np.isin(nodes, self.problem.impacts)
        return nodes[kept], added[kept]

    @property
    def sequence(self) -> str:
        """Symbols of the impacts of the solved segment. The first impact is the one with the smallest phase at the start."""
        problem = self.problem
        found = [(problem.sequence[node], added) for node, added in zip(*self._order, strict=True)]
        return joined_sequence([problem.mirrored(symbol) if added else symbol for symbol, added in found])

    @cached_property
    def phases(self) -> np.ndarray:
        """Phase w t at each impact, modulo 2 pi p, in radians, (N, k). Without a clock it is 2 pi t/T since the first impact. Of a chatter
        that is summed it is that of the first bounce."""
        problem, fractions, (nodes, added) = self.problem, self._fractions, self._impacts
        if problem.contact_modes.sums_chatter:
            # The node is the end of the chatter. Its first bounce is where the flight before it ends.
            times = np.array([problem.flight_times(y) for y in self.unknowns])
            begun = np.roll(fractions + times / self.periods[:, None], 1, axis=1)
            begun[:, 0] -= problem.closing[1]
            summed = np.roll(problem.contact_modes.summed[: fractions.shape[1]], 1)
            fractions = np.where(summed == 1, begun, fractions)
        return 2.0 * math.pi * problem.load_periods * wrapped(fractions[:, nodes] + added)

    @cached_property
    def speeds(self) -> np.ndarray:
        """Speed of approach of each impact, (N, k); of a chatter that is summed, that of the first bounce."""
        nodes = self._impacts[0]
        return np.array([self.problem.impact_speeds(y)[nodes] for y in self.unknowns]).reshape(len(self), len(nodes))

    @cached_property
    def multipliers(self) -> np.ndarray:
        """All 2n multipliers of the full period at each point, (N, 2n) complex. NaN where an impact grazes. `problem.multipliers` has those
        of the map over half of it, where half of it was solved."""
        return np.array([self.problem.period_multipliers(y) for y in self.unknowns])

    @cached_property
    def largest_multiplier(self) -> np.ndarray:
        """Largest modulus of the nontrivial multipliers, (N,)."""
        return np.array([largest_multiplier(self.problem, multipliers) for multipliers in self.multipliers])

    @cached_property
    def stable(self) -> np.ndarray:
        """1: all nontrivial multipliers are inside the unit circle by more than their error; 0: one is outside; -1: undecided. (N,)

        The error is what rounding of the unknowns makes of the largest modulus."""
        largest = self.largest_multiplier
        turned = [self.problem.period_multipliers(y * (1.0 + _ROUNDING)) for y in self.unknowns]
        rounded = np.array([largest_multiplier(self.problem, multipliers) for multipliers in turned])
        found = np.full(len(self), -1, dtype=np.int64)
        with np.errstate(invalid="ignore"):
            error = np.where(np.isinf(largest), 0.0, _SAFETY * np.abs(rounded - largest) + _LEAST_ERROR)
            found[largest < 1.0 - error] = 1
            found[largest > 1.0 + error] = 0
        # At a bifurcation a multiplier is on the circle, whatever rounding says.
        found[[event.point for event in self.events if event.type in ("SN", "BP", "PD", "SB", "NS", "GR")]] = -1
        return found
