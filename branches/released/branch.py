"""A followed family of free orbits in a parameter, as data: its points, events and ends, and what is known of each orbit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from branches.between_events import Barrier, decide_between, stable_at_event
from branches.forced.branch import ForcedBranch
from branches.orbit import Orbit, orbit_columns
from branches.released.family import PlacedSolution, placed
from bvp.forced import ForcedProblem
from bvp.released import ReleasedProblem
from bvp.texts import brief

__all__ = ["ReleasedBranch", "branch_in_parameter"]


@brief
@dataclass(frozen=True, eq=False)
class ReleasedBranch(ForcedBranch):
    """A family of free orbits of a conservative system in released parameters, in order of arclength.

    Its attributes are those of `ForcedBranch`; the problem is a `ReleasedProblem`. Multipliers are the nontrivial ones of the full period,
    and speeds those of the impacts of the solved segment, also at its ends.
    """

    problem: ReleasedProblem

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        low, high = float(self.parameter.min()), float(self.parameter.max())
        ends, sequence = "-".join(self.problem.ends or ()), self.sequence or "(none)"
        title = f"ReleasedBranch of {len(self)} points: {ends}, sequence {sequence}, {self.name} = {low:.8g} to {high:.8g}"
        return title, [("keep", " and ".join(self.problem.keep)), *super()._summary()[1]]

    def orbit(self, i: int) -> Orbit:
        """The orbit at point i: one of the system at its parameters, which can be followed in the energy."""
        stable = int(self.stable[i])
        return Orbit(self._placed[i].problem, self._placed[i], on_family=None if stable < 0 else bool(stable))

    @cached_property
    def _placed(self) -> list[PlacedSolution]:
        found = [placed(self.problem, y) for y in self.unknowns]
        return [one for one in found if one is not None]

    def with_orbits(self, found: Sequence[object]) -> ReleasedBranch:
        """This branch, with the orbit of each point known: found by `branches.released.family.placed`."""
        orbits = [one for one in found if isinstance(one, PlacedSolution)]
        if len(orbits) == len(self):
            self.__dict__["_placed"] = orbits
        return self

    @cached_property
    def columns(self) -> Mapping[str, np.ndarray]:
        """What is known of each orbit, as `branches.orbit.orbit_columns` names it: columns of length N."""
        rows = [orbit_columns(one.problem, [one]) for one in self._placed]
        columns = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
        columns["arclength"], columns["residual"] = self.arclength, self.residual
        for event in self.events:
            columns["stable"][event.point] = stable_at_event(event.type, columns, event.point)
        barriers = [Barrier(event.type, event.point, event.bracket) for event in self.events]
        at = self._placed
        columns["stable"], _ = decide_between(at[0].problem, lambda i: (at[i].problem, at[i].y), columns, barriers)
        return columns

    @property
    def sequence(self) -> str:
        """Letters of the impacts inside the solved segment."""
        return "".join(self.problem.sequence)

    @property
    def periods(self) -> np.ndarray:
        """T, (N,)."""
        return 4.0 * self.columns["alpha"]

    @property
    def speeds(self) -> np.ndarray:
        """Speed of approach of each impact, (N, k)."""
        return self.columns["impact_speeds"]

    @property
    def phases(self) -> np.ndarray:
        """Free orbits have no phase, (N, 0)."""
        return np.zeros((len(self), 0))

    @property
    def multipliers(self) -> np.ndarray:
        """Nontrivial multipliers of the full period, (N, 2 m) complex; NaN where an impact grazes."""
        return self.columns["multipliers"]

    @property
    def stable(self) -> np.ndarray:
        """1: stable; 0: unstable; -1: undecided. (N,)"""
        return self.columns["stable"]


def branch_in_parameter(problem: ForcedProblem, *rest: Any) -> ForcedBranch:
    """The branch of a problem of forced or free orbits; the other attributes follow in order."""
    return ReleasedBranch(problem, *rest) if isinstance(problem, ReleasedProblem) else ForcedBranch(problem, *rest)
