"""The grid of starts of a basin: two coordinates of the state vary, and the others are fixed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bvp.checks import is_finite, is_whole
from bvp.forcing import Force
from bvp.system import ImpactSystem
from bvp.texts import shown
from transitions.sweep.forced import Carried, ForcedMotion, carried_into

__all__ = ["MOST", "BasinAxis", "StartGrid", "default_range", "inside", "state_names"]

MOST = 10**7
"""Most starts."""

_SETTLING, _WATCHED = 200, 50
"""Periods of the motion from rest that are left out, and those whose sizes give the default ranges."""


def state_names(coordinates: Sequence[str]) -> tuple[str, ...]:
    """Names of the coordinates of the state: displacements, then velocities.

    Examples
    --------
    >>> state_names(["u1", "u2"])
    ('u1', 'u2', "u1'", "u2'")
    """
    return (*coordinates, *(f"{name}'" for name in coordinates))


@dataclass(frozen=True)
class BasinAxis:
    """A coordinate that varies: its name, its range, and the number of cells. The starts are in the middle of the cells."""

    name: str
    low: float
    high: float
    count: int

    def __post_init__(self) -> None:
        if not (is_finite(self.low) and is_finite(self.high) and self.low < self.high):
            raise ValueError(f"the range of {self.name} is two finite numbers, LO < HI; received {shown(self.low)} and {shown(self.high)}")
        if not is_whole(self.count, 2, MOST):
            raise ValueError(f"the number of starts along {self.name} is an integer from 2 to {MOST}; received {shown(self.count)}")

    @property
    def values(self) -> np.ndarray:
        """The values of the starts, (count,)."""
        return self.low + (np.arange(self.count) + 0.5) * ((self.high - self.low) / self.count)


@dataclass(frozen=True)
class StartGrid:
    """Starts over two coordinates of the state, at one phase of the loads.

    Parameters
    ----------
    coordinates : sequence of str
        Names of the n displacements.
    x, y : BasinAxis
        Two of the coordinates of the state (`state_names`).
    fixed : mapping of str to float
        Values of others; those that are not given are 0.
    phase : float
        Phase w t of the start, in [0, 2 pi).

    Raises
    ------
    ValueError
        For names that the state lacks, one name for both axes or a fixed one, another phase, too many starts.

    Examples
    --------
    >>> grid = StartGrid(["x"], BasinAxis("x", -1.0, 1.0, 2), BasinAxis("x'", 0.0, 3.0, 3))
    >>> grid.states[:3]
    array([[-0.5,  0.5],
           [ 0.5,  0.5],
           [-0.5,  1.5]])
    """

    coordinates: Sequence[str]
    x: BasinAxis
    y: BasinAxis
    fixed: Mapping[str, float] = field(default_factory=dict)
    phase: float = 0.0

    def __post_init__(self) -> None:
        known = state_names(self.coordinates)
        for name in (self.x.name, self.y.name, *self.fixed):
            if name not in known:
                raise ValueError(f"the state has no coordinate {name!r}; expected some of {', '.join(known)}")
        if self.x.name == self.y.name:
            raise ValueError(f"a basin needs two state coordinates to vary; received {self.x.name} twice")
        for name in {self.x.name, self.y.name} & set(self.fixed):
            raise ValueError(f"{name} varies over the grid; expected no fixed value")
        for name, value in self.fixed.items():
            if not is_finite(value):
                raise ValueError(f"the value of {name} is a finite number; received {shown(value)}")
        if not (is_finite(self.phase) and 0.0 <= self.phase < 2.0 * math.pi):
            raise ValueError(f"phase is a number from 0 to below 2 pi; received {shown(self.phase)}")
        if len(self) > MOST:
            raise ValueError(f"the grid has {len(self)} starts; expected {MOST} at most")

    def __len__(self) -> int:
        return self.x.count * self.y.count

    @property
    def axes(self) -> tuple[int, int]:
        """Indices of x and y in the state."""
        known = state_names(self.coordinates)
        return known.index(self.x.name), known.index(self.y.name)

    @property
    def base(self) -> np.ndarray:
        """The state (2n,) with the fixed values, and 0 for x and y."""
        return np.array([self.fixed.get(name, 0.0) for name in state_names(self.coordinates)], dtype=float)

    @property
    def states(self) -> np.ndarray:
        """The starts, (N, 2n): x changes first."""
        found = np.tile(self.base, (len(self), 1))
        i, j = self.axes
        found[:, i] = np.tile(self.x.values, self.y.count)
        found[:, j] = np.repeat(self.y.values, self.x.count)
        return found

    def possible(self, system: ImpactSystem) -> np.ndarray:
        """Whether each start violates no stop, bool (N,)."""
        return inside(system, self.states, 0.0)

    def image(self, values: np.ndarray) -> np.ndarray:
        """Values of the starts (N,) as rows of the picture, (y, x)."""
        return np.reshape(values, (self.y.count, self.x.count))


def inside(system: ImpactSystem, states: np.ndarray, slack: float = 1e-9) -> np.ndarray:
    """Whether states (N, 2n) are beyond no stop, by more than a part of its bound: bool (N,)."""
    found = np.ones(len(states), dtype=bool)
    for stop in system.stops:
        w = states[:, : system.degrees_of_freedom] @ np.asarray(stop.gap)
        low, high = (slack * max(1.0, abs(bound)) if math.isfinite(bound) else 0.0 for bound in (stop.lower, stop.upper))
        found &= (w >= stop.lower - low) & (w <= stop.upper + high)
    return found


def default_range(system: ImpactSystem, forces: Sequence[Force], name: str, fixed: Mapping[str, float], free: int) -> tuple[float, float]:
    """The range of a coordinate that is not given one: twice the motion from rest, rounded up, between the stops.

    fixed: values of the coordinates that do not vary. free: displacements that vary; with two of them stops give no bounds."""
    n, names = system.degrees_of_freedom, state_names(system.coordinates)
    place = names.index(name)
    motion = ForcedMotion(system, forces, carried_into(system, Carried(np.zeros(2 * n)))[0])
    motion.advance(_SETTLING)
    record = motion.advance(_WATCHED, impacts=True, peaks=True)
    peak = float(record.peaks[place % n]) if record.peaks is not None else 0.0
    if place >= n:
        speeds = np.concatenate([record.states[:, place], record.impacts.before[:, place], record.impacts.after[:, place]])
        peak = max(2.0 * math.pi / motion.period * peak, float(np.abs(speeds).max(initial=0.0)))
    reach = _rounded_up(2.0 * peak)
    low, high = -reach, reach
    if place < n and free == 1:
        base = np.array([fixed.get(key, 0.0) for key in names[:n]])
        base[place] = 0.0
        for stop in system.stops:
            gap = np.asarray(stop.gap)
            if gap[place] != 0.0:
                ends = sorted((bound - float(gap @ base)) / gap[place] for bound in (stop.lower, stop.upper))
                low, high = max(low, ends[0]), min(high, ends[1])
    return (low, high) if low < high else (-reach, reach)


def _rounded_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten; 1 for what is no size."""
    if not (0.0 < value < 1e100):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return float(next(part * power for part in (1.0, 2.0, 5.0, 10.0) if part * power >= value * (1.0 - 1e-9)))
