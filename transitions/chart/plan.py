"""What a chart covers: the plane of two parameters, the responses that it starts from, and how much is looked for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from branches.curves.monitor import Window
from branches.curves.starting import CURVES
from branches.forced.branch import ForcedBranch, ForcedEvent
from bvp.checks import is_whole
from bvp.parameters import ParametricSystem
from bvp.texts import nearest_known, shown
from transitions.response.path import ParameterPath

__all__ = ["FACTOR", "GRID", "LEVELS", "MOST_CURVES", "PERIODS", "ChartPlan", "default_window"]

FACTOR = 4.0
"""The default range of a parameter in which no branch was followed reaches so many times below and above its value."""

LEVELS = 3
"""Levels of the second parameter at which responses are followed, unless something else is asked for."""

GRID = 24, 16
"""Cells along both parameters, likewise."""

MOST_CURVES = 60
"""Most curves, likewise."""

PERIODS = 2000
"""Most periods of the loads that a motion of a cell is simulated."""

MOST = 10**9
"""Largest number of periods, levels and curves."""

_LOG = 8.0
"""Ratio of the ends of a range from which on levels and cells are spaced by ratios."""


@dataclass(frozen=True, eq=False)
class ChartPlan:
    """A chart to compute.

    Attributes
    ----------
    branches : sequence of ForcedBranch
        Of one system under periodic loads, all at one value of the second parameter. The parameter of each is one of `names`.
    names : sequence of str
        The parameters that vary. The first two span the plane.
    keep : sequence of str
        Equations that determine the others: two less than there are names.
    window : ((float, float), (float, float))
        Ranges of the two parameters.
    levels : int
        Levels of the second parameter at which responses are followed.
    grid : (int, int)
        Cells along both parameters; (0, 0) for no regions.
    most : int
        Most curves.
    periods : int
        Most periods of the loads that a motion of a cell is simulated.

    See Also
    --------
    transitions.chart.chart.find_chart : computes it

    Raises
    ------
    ValueError
        For parameters that the system cannot have, and for other numbers than those expected, in one line.
    """

    branches: Sequence[ForcedBranch]
    names: Sequence[str]
    window: Window
    keep: Sequence[str] = ()
    levels: int = LEVELS
    grid: tuple[int, int] = GRID
    most: int = MOST_CURVES
    periods: int = PERIODS

    def __post_init__(self) -> None:
        if not self.branches:
            raise ValueError("a chart starts from one branch at least")
        if len(self.names) != len(self.keep) + 2 or len(set(self.names)) < len(self.names):
            raise ValueError(f"a chart has two parameters and one more for each equation; received {shown(list(self.names))}")
        for name in self.names:
            if name not in self.parametric.names:
                raise ValueError(f"unknown parameter {shown(name)}{nearest_known(name, self.parametric.names)}")
        for branch in self.branches:
            if branch.name not in self.names:
                one = branch.name
                raise ValueError(f"the events of the response have different values of {one}; expected {one} among the parameters")
        for name, (low, high) in zip(self.names, self.window, strict=False):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError(f"the range of {name} is two finite numbers, LO < HI; received {low:g} to {high:g}")
        for what, value, least in (("levels", self.levels, 0), ("most", self.most, 1), ("periods", self.periods, 1)):
            if not is_whole(value, least, MOST):
                raise ValueError(f"{what} is an integer from {least} to {MOST}; received {shown(value)}")
        if len(self.grid) != 2 or not (tuple(self.grid) == (0, 0) or all(is_whole(count, 1, MOST) for count in self.grid)):
            raise ValueError(f"grid is two integers above 0, or (0, 0) for no regions; received {shown(self.grid)}")
        self.path(self.start)

    @property
    def parametric(self) -> ParametricSystem:
        """The system with its parameters."""
        return self.branches[0].problem.parametric

    @property
    def start(self) -> dict[str, float]:
        """All parameters at the start of the first branch."""
        first = self.branches[0]
        return first.problem.parameters(first.unknowns[first.start])

    def path(self, values: Mapping[str, float]) -> ParameterPath:
        """The line in the first parameter through some values of all parameters; the equations are fulfilled on it."""
        names = [self.names[0], *self.names[2:]]
        return ParameterPath(self.parametric, names, self.keep, values).at()

    @property
    def events(self) -> list[tuple[int, ForcedBranch, ForcedEvent]]:
        """The events of the branches that can be continued in two parameters, with the number of the branch from 1."""
        return [
            (number, branch, event)
            for number, branch in enumerate(self.branches, 1)
            for event in branch.events
            if event.type in CURVES
        ]  # fmt: skip

    def contains(self, values: Mapping[str, float]) -> bool:
        """Whether a point is in the window."""
        return all(low <= values[name] <= high for name, (low, high) in zip(self.names, self.window, strict=False))

    @property
    def level_values(self) -> list[float]:
        """The levels of the second parameter, between the ends of its range."""
        return self.edges(1, self.levels + 1)[1:-1].tolist()

    def by_ratios(self, which: int) -> bool:
        """Whether a parameter, 0 or 1, has levels and cells that are spaced by ratios: its range spans a factor of 8."""
        low, high = self.window[which]
        return low > 0.0 and high >= _LOG * low

    def edges(self, which: int, count: int) -> np.ndarray:
        """The ends of `count` intervals of a parameter, (count + 1,)."""
        space = np.geomspace if self.by_ratios(which) else np.linspace
        return space(*self.window[which], count + 1)

    def middles(self, which: int, count: int) -> np.ndarray:
        """The middles of the same intervals, (count,)."""
        edges = self.edges(which, count)
        middles: np.ndarray = np.sqrt(edges[:-1] * edges[1:]) if self.by_ratios(which) else 0.5 * (edges[:-1] + edges[1:])
        return middles


def default_window(branches: Sequence[ForcedBranch], names: Sequence[str]) -> tuple[Window, list[str]]:
    """The ranges of two parameters, and in words where each comes from.

    The range of a parameter in which a branch was followed is that of the branch; that of another one reaches `FACTOR` times below and
    above its value, as far as its domain.
    """
    first = branches[0]
    values = first.problem.parameters(first.unknowns[first.start])
    ranges, words = [], []
    for name in names[:2]:
        value = values[name]
        if name == first.name:
            found = [(branch.interval, branch.parameter) for branch in branches if branch.name == name]
            low = min(_finite(interval[0], float(points.min())) for interval, points in found)
            high = max(_finite(interval[1], float(points.max())) for interval, points in found)
            words.append(f"{name} = {low:.6g} to {high:.6g}, the range of the branch")
        else:
            wide = (-1.0, 1.0) if value == 0.0 else sorted((value / FACTOR, value * FACTOR))
            least, largest = first.problem.parametric.domain(name)
            low, high = max(wide[0], least), min(wide[1], largest)
            around = " around its value 0" if value == 0.0 else f", a factor of {FACTOR:g} around its value {value:.6g}"
            cut = "" if (low, high) == tuple(wide) else ", in its domain"
            words.append(f"{name} = {low:.6g} to {high:.6g}{around}{cut}")
        ranges.append((low, high))
    return (ranges[0], ranges[1]), words


def _finite(bound: float, instead: float) -> float:
    return bound if math.isfinite(bound) else instead
