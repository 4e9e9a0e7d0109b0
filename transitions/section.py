"""Poincare sections: many motions of one energy, each followed from crossing to crossing.

Flights are exact, impacts and crossings are found by bounds, so that none is missed (`transitions.kernels.section`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import is_finite
from bvp.damped import Mover
from bvp.kernels import motion as motion_kernels
from bvp.kernels.compiled import address_of
from bvp.kernels.phase import CLOCK, COUNTS, PASSES
from bvp.pace import Pace
from bvp.shown import shown
from transitions.kernels import section as kernels
from transitions.section_plane import SectionPlane, checked_points

if TYPE_CHECKING:
    from bvp.kernels.phase import Log, Phases, Scratch
    from bvp.system import ImpactSystem

__all__ = ["Section", "SectionEnd", "follow", "section"]

SETTLING = 0.1
"""Part of an orbit's crossings that its Lyapunov exponent leaves out: the perturbation turns to its fastest direction there."""

MOST = 10**9
"""Orbits, and crossings of each, that can be asked for."""

_BATCH = 32
_PERIODS = 8.0
_PATIENCE = 50.0


class SectionEnd(Enum):
    """How following an orbit ended; the value says it in words."""

    COMPLETE = "all crossings asked for"
    TIME_OVER = "crosses the section too seldom: the longest time was reached"
    SIMULTANEOUS = "hits two stops at the same instant whose impulses interact: the outcome is not defined by restitution"
    OUTSIDE = "started beyond a stop"
    PIERCED = "was carried beyond a stop by rounding"
    UNDECIDED = "meets its stops again and again without time passing"
    EXHAUSTED = "the search for its next impact or crossing gave up"


_ENDS = {
    kernels.COMPLETE: SectionEnd.COMPLETE,
    kernels.TIME_OVER: SectionEnd.TIME_OVER,
    motion_kernels.INTERACTING: SectionEnd.SIMULTANEOUS,
    motion_kernels.STARTED_OUTSIDE: SectionEnd.OUTSIDE,
    motion_kernels.PIERCED: SectionEnd.PIERCED,
    motion_kernels.CYCLING: SectionEnd.UNDECIDED,
    motion_kernels.GAVE_UP: SectionEnd.EXHAUSTED,
}


@dataclass(frozen=True, eq=False)
class Section:
    """Crossings of the section by m orbits, up to k of each; the start is the first. What comes after an orbit's end is NaN.

    Attributes
    ----------
    plane : SectionPlane
    times : (m, k) ndarray
    points : (m, k, 2) ndarray
        x and y of `plane`.
    energies : (m, k) ndarray
    growths : (m, k) ndarray
        Logarithm of the size of a perturbation along the section, in the plane, over that at the start.
    tangents : (m, k, 2) ndarray
        Direction of that perturbation in the plane. Both are NaN from where the orbit has stuck to a stop: a degree of freedom is lost
        there, so that the plane maps to a curve, and perturbations that meet on it have no rate.
    held_times : (m,) ndarray
        Time that each orbit sticks to stops, up to its last crossing or its end.
    counts, impacts : (m,) ndarray of int
        Crossings of each orbit, and impacts on its way.
    ends : tuple of m SectionEnd
    interrupted : bool
        Whether it was stopped before all orbits were followed.
    """

    plane: SectionPlane
    times: np.ndarray
    points: np.ndarray
    energies: np.ndarray
    growths: np.ndarray
    tangents: np.ndarray
    counts: np.ndarray
    impacts: np.ndarray
    held_times: np.ndarray
    ends: tuple[SectionEnd, ...]
    interrupted: bool = False

    @property
    def system(self) -> ImpactSystem:
        """The system of the motions."""
        return self.plane.system

    def __len__(self) -> int:
        return int(self.counts.sum())

    @cached_property
    def drift(self) -> float:
        """Largest relative difference of an energy from that of the section; of a conservative system that is rounding."""
        return float(np.nanmax(np.abs(self.energies / self.plane.energy - 1.0), initial=0.0))

    @cached_property
    def exponents(self) -> np.ndarray:
        """Largest Lyapunov exponent of each orbit, per unit of time, (m,): growth of a perturbation along the section over time,
        without the first `SETTLING` of its crossings. NaN for an orbit with fewer than two crossings, and for one that sticks to a stop."""
        out = np.full(len(self.counts), math.nan)
        for m, count in enumerate(self.counts.tolist()):
            first, last = int(SETTLING * (count - 1)), count - 1
            if last > first:
                out[m] = (self.growths[m, last] - self.growths[m, first]) / (self.times[m, last] - self.times[m, first])
        return out


def section(
    system: ImpactSystem,
    energy: float,
    *,
    orbits: int = 150,
    crossings: int = 400,
    starts: Any = None,
    longest: float | None = None,
    on_orbits: Callable[[int], None] | None = None,
) -> Section:
    """The Poincare section u_p = 0, u_p' > 0 of motions that start on it with one energy.

    A system that loses energy leaves the energy surface: its section is that of motions, the energies of which are told.

    Parameters
    ----------
    system : ImpactSystem
        With two degrees of freedom, one of them the primary.
    energy : float
        h > 0 at the starts.
    orbits : int
        Starts, spread over the section.
    crossings : int
        Most points of each orbit, its start counted.
    starts : (m, 2) array_like, optional
        Starts in the plane, in place of those spread over it.
    longest : float, optional
        Time after which an orbit is left; by default 50 of the longest natural period for each crossing.
    on_orbits : callable, optional
        Told how many orbits are followed, from time to time.

    Returns
    -------
    Section
        On an interruption with the orbits that were followed until then.

    Raises
    ------
    ValueError
        As `SectionPlane`; for counts below 1, and starts outside the bounding curve.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> found = section(vibro_impact_nes(), 0.06, orbits=3, crossings=20)
    >>> len(found), found.drift < 1e-13
    (60, True)
    """
    plane = SectionPlane(system, energy)
    for name, value in (("orbits", orbits), ("crossings", crossings)):
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 0 < value <= MOST:
            raise ValueError(f"{name} is a whole number from 1 to {MOST}; received {shown(value)}")
    if longest is not None and not (is_finite(longest) and longest > 0.0):
        raise ValueError(f"longest is a finite time above 0; received {shown(longest)}")
    points = plane.starts(orbits) if starts is None else checked_points(starts, "starts")
    parts: list[Section] = []
    interrupted = False
    try:
        for first in range(0, len(points), _BATCH):
            parts.append(follow(plane, points[first : first + _BATCH], crossings, longest=longest))
            if on_orbits is not None:
                on_orbits(min(first + _BATCH, len(points)))
    except KeyboardInterrupt:
        interrupted = True
        if not parts:
            raise
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("times", "points", "energies", "growths", "tangents", "counts", "impacts", "held_times")
    }
    return Section(plane, ends=tuple(end for part in parts for end in part.ends), interrupted=interrupted, **arrays)


def follow(
    plane: SectionPlane, starts: np.ndarray, crossings: int, *, directions: Any = None, longest: float | None = None
) -> Section:
    """Follow starts (m, 2) of a plane to as many crossings, with a perturbation of each along one of `directions` (m, 2).

    By default the perturbations point along the diagonal of the section's extent. `longest` as in `section`."""
    system = plane.system
    u, v = plane.states(starts)
    count, mover = len(u), Mover(system)
    if directions is None:
        low, high = plane.reach
        directions = np.tile([0.5 * (high - low), plane.height(min(max(0.0, low), high))], (count, 1))
    changes = plane.tangents(starts, checked_points(directions, "directions"))
    times, energies, growths = (np.full((count, crossings), math.nan) for _ in range(3))
    points, tangents = (np.full((count, crossings, 2), math.nan) for _ in range(2))
    counts, impacts, statuses = (np.zeros(count, dtype=np.int64) for _ in range(3))
    held_times = np.zeros(count)
    fastest, slowest = _periods(plane)
    first, held = 0, 0
    marks = np.zeros((0, len(mover.parts) + 3))
    pace = Pace()
    while first < count:
        if held >= 0:  # with one more phase the orbit is followed from its start
            phases = mover.table.stacked
            log, scratch = mover.log(kernels.EVENTS_AT_ONCE), mover.scratch(np.zeros(2 * system.degrees_of_freedom))
            following = _following(changes.shape[1] // 2, phases, log)
            move = _address_of_move(phases, marks, log, scratch)
        following.numbers[PASSES] = pace.passes
        with pace:
            first, held = kernels.follow_section(
                move,
                phases,
                *plane.rows(phases),
                np.concatenate([u, v], 1),
                changes @ phases.enter[0].T,
                _PERIODS * fastest,
                _PATIENCE * slowest * crossings if longest is None else float(longest),
                first,
                following,
                times,
                points,
                energies,
                growths,
                tangents,
                counts,
                impacts,
                held_times,
                statuses,
                log,
                scratch,
                marks,
            )
        if first < count and held >= 0:
            mover.table.add(int(held))
    ends = tuple(_ENDS[code] for code in statuses.tolist())
    return Section(plane, times, points, energies, growths, tangents, counts, impacts, held_times, ends)


def _following(n: int, phases: Phases, log: Log) -> kernels.Following:
    """Arrays of an orbit that is followed, of a system with n coordinates."""
    size = phases.matrix.shape[1]
    counts, clock = np.zeros(COUNTS, dtype=np.int64), np.zeros(CLOCK)
    z, begin, change = np.zeros((3, size))
    dissipated = np.zeros((log.sums.shape[1], 2))
    whole, sums = np.zeros(kernels.WHOLE, dtype=np.int64), np.zeros(kernels.SUMS)
    return kernels.Following(z, np.zeros(2 * n), begin, change, counts, clock, dissipated, whole, sums)


def _address_of_move(phases: Phases, marks: np.ndarray, log: Log, scratch: Scratch) -> int:
    """Where `bvp.kernels.motion.move` stands, compiled for arguments as `Mover.run` has them too."""
    line, table, counts = np.zeros(0), np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    arguments = (phases, 0.0, kernels.MOST, line, line, counts, line, table, table, marks, line, log, scratch)
    return address_of(motion_kernels.move, arguments)


def _periods(plane: SectionPlane) -> tuple[float, float]:
    """Shortest and longest natural period; for motions without springs the time to cross the section at full speed."""
    frequencies = plane.system.modes.frequencies
    moving = frequencies[frequencies > 0.0]
    if not len(moving):
        low, high = plane.reach
        across = (high - low) / plane.height(0.5 * (low + high))
        return across, across
    return 2.0 * math.pi / float(moving.max()), 2.0 * math.pi / float(moving.min())
