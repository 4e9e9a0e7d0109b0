"""What a basin covers: the system at values of its parameters, the grid of starts, and the responses that name attractors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from branches.forced.branch import ForcedBranch
from bvp.checks import is_whole
from bvp.description import BASE
from bvp.parameters import ParametricSystem
from bvp.texts import shown
from transitions.basin.grid import StartGrid
from transitions.basin.identity import orbits_at
from transitions.basin.record import FamilyOrbit
from transitions.response.path import ParameterPath
from transitions.sweep.forced import harmonics_of

__all__ = ["PERIODS", "BasinPlan", "path_of"]

PERIODS = 4000
"""Most periods of the loads that a start is followed, unless something else is asked for."""

MOST = 10**9
"""Largest number of periods."""


@dataclass(frozen=True, eq=False)
class BasinPlan:
    """A basin to compute.

    Attributes
    ----------
    path : ParameterPath
        The system at the values of its parameters.
    grid : StartGrid
    most : int
        Most periods of the loads for each start.
    branches : sequence of ForcedBranch
        Followed responses by which attractors are named, and of which the unstable orbits are the saddles.
    """

    path: ParameterPath
    grid: StartGrid
    most: int = PERIODS
    branches: Sequence[ForcedBranch] = ()

    def __post_init__(self) -> None:
        if not is_whole(self.most, 1, MOST):
            raise ValueError(f"most is an integer from 1 to {MOST}; received {shown(self.most)}")

    @cached_property
    def orbits(self) -> list[FamilyOrbit]:
        """The orbits of the branches at the values of the parameters; a ValueError if a branch has other values there."""
        return orbits_at(self.branches, dict(self.path.values))


def path_of(parametric: ParametricSystem, values: Mapping[str, float] | None = None) -> ParameterPath:
    """The system at the values of its parameters, as a path along the frequency of its loads: none of its orbits is followed.

    A system without a parameter gets the base frequency of its loads as one."""
    if not parametric.names:
        base, multiples = harmonics_of(parametric.forces())
        given = parametric.describe()
        loads = [
            {key: value for key, value in load.items() if key != "frequency"} | ({"harmonic": k} if k else {})
            for load, k in zip(given["forces"], multiples, strict=True)
        ]
        parametric = type(parametric).from_description(given | {"parameters": {BASE: base}, "forces": loads})
    name = BASE if BASE in parametric.names else parametric.names[0]
    return ParameterPath(parametric, [name], (), dict(values or {}))
