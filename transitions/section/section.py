"""Poincare sections: many motions of one energy, each followed from crossing to crossing.

Flights are exact, or Taylor series to rounding. Impacts and crossings are found by bounds, so that none is missed (`transitions.kernels`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np

from bvp.checks import is_finite, is_whole
from bvp.dense import product
from bvp.interrupts import Pace
from bvp.kernels import motion as motion_kernels
from bvp.kernels.contact_mode import PASSES, ContactModes
from bvp.simulate import Simulator
from bvp.system import ImpactSystem
from bvp.texts import brief, listed, shown
from transitions import kernels
from transitions.section.plane import SectionPlane, checked_points

__all__ = ["Section", "SectionEnd", "follow_crossings", "section"]

SETTLING = 0.1
"""Fraction of an orbit's crossings that its Lyapunov exponent leaves out. There the perturbation rotates to its fastest direction."""

MOST = 10**9
"""Largest number of orbits, and of crossings of each, that can be asked for."""

_BATCH = 32  # orbits between two reports of progress
_PERIODS = 8.0  # of the fastest mode in one block
_PATIENCE = 50.0  # of the longest natural period for each crossing


class SectionEnd(Enum):
    """How an orbit ended; the value says it in words."""

    COMPLETE = "all crossings asked for"
    TIME_OVER = "crosses the section too seldom: the longest time was reached"
    SIMULTANEOUS = "hits two stops at the same instant whose impulses interact: the outcome is not defined by restitution"
    OUTSIDE = "started beyond a stop"
    PIERCED = "was carried beyond a stop by rounding"
    UNDECIDED = "meets its stops again and again without time passing"
    EXHAUSTED = "the search for its next impact or crossing gave up"
    UNRESOLVED = "met smooth forces that grow beyond what the steps of a flight can follow"


_ENDS = {
    kernels.COMPLETE: SectionEnd.COMPLETE,
    kernels.TIME_OVER: SectionEnd.TIME_OVER,
    motion_kernels.INTERACTING: SectionEnd.SIMULTANEOUS,
    motion_kernels.STARTED_OUTSIDE: SectionEnd.OUTSIDE,
    motion_kernels.PIERCED: SectionEnd.PIERCED,
    motion_kernels.CYCLING: SectionEnd.UNDECIDED,
    motion_kernels.GAVE_UP: SectionEnd.EXHAUSTED,
    motion_kernels.UNRESOLVED: SectionEnd.UNRESOLVED,
}


@brief
@dataclass(frozen=True, eq=False)
class Section:
    """Crossings of the section by m orbits, up to k of each. The start is the first crossing. NaN fills the rows after an orbit's end.

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
        Direction of that perturbation in the plane. Growths and tangents are NaN after the orbit has stuck to a stop. A degree of freedom
        is lost there, so that the plane maps to a curve, and the growth has no rate.
    counts, impacts : (m,) ndarray of int
        Number of crossings and of impacts of each orbit.
    sticking_times : (m,) ndarray
        Time that each orbit sticks to stops, up to its last crossing or its end.
    ends : tuple of m SectionEnd
    interrupted : bool
        Whether Ctrl-C came before all orbits were followed.
    """

    plane: SectionPlane
    times: np.ndarray
    points: np.ndarray
    energies: np.ndarray
    growths: np.ndarray
    tangents: np.ndarray
    counts: np.ndarray
    impacts: np.ndarray
    sticking_times: np.ndarray
    ends: tuple[SectionEnd, ...]
    interrupted: bool = False

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        ended = Counter(end.value for end in self.ends)
        title = f"Section at h = {self.plane.energy:.10g}: {len(self)} crossings of {len(self.counts)} motions"
        return title, [("impacts", str(int(self.impacts.sum()))), ("ended", listed([f"{n}: {text}" for text, n in ended.items()]))]

    @property
    def system(self) -> ImpactSystem:
        """The system of the motions."""
        return self.plane.system

    def __len__(self) -> int:
        return int(self.counts.sum())

    @cached_property
    def drift(self) -> float:
        """Largest relative difference of an energy from that of the section. For a conservative system it is rounding."""
        return float(np.nanmax(np.abs(self.energies / self.plane.energy - 1.0), initial=0.0))

    @cached_property
    def exponents(self) -> np.ndarray:
        """Largest Lyapunov exponent of each orbit, per unit of time, (m,): growth of the perturbation over time, without the first
        `SETTLING` of the crossings. NaN for an orbit that sticks to a stop or has fewer than two crossings."""
        last = self.counts - 1
        ends = np.stack([(SETTLING * last).astype(int), last])
        growth, time = (np.diff(values[np.arange(len(last)), ends], axis=0)[0] for values in (self.growths, self.times))
        with np.errstate(invalid="ignore"):
            return np.where(last > ends[0], growth / time, math.nan)


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

    If the system loses energy, the motions leave the energy surface; `Section.energies` shows by how much.

    Parameters
    ----------
    system : ImpactSystem
        With two degrees of freedom, one of them the primary.
    energy : float
        h > 0 at the starts.
    orbits : int
        Number of starts, spread over the section.
    crossings : int
        Largest number of points of each orbit, its start included.
    starts : (m, 2) array_like, optional
        Starts in the plane, in place of the spread ones.
    longest : float, optional
        Time limit of an orbit; by default 50 of the longest natural period for each crossing.
    on_orbits : callable, optional
        Called from time to time with the number of orbits that are done.

    Returns
    -------
    Section
        After Ctrl-C with the orbits that are done.

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
        if not is_whole(value, 1, MOST):
            raise ValueError(f"{name} is an integer from 1 to {MOST}; received {shown(value)}")
    if longest is not None and not (is_finite(longest) and longest > 0.0):
        raise ValueError(f"longest is a finite time above 0; received {shown(longest)}")
    points = plane.starts(orbits) if starts is None else checked_points(starts, "starts")
    parts: list[Section] = []
    interrupted = False
    try:
        for first in range(0, len(points), _BATCH):
            parts.append(follow_crossings(plane, points[first : first + _BATCH], crossings, longest=longest))
            if on_orbits is not None:
                on_orbits(min(first + _BATCH, len(points)))
    except KeyboardInterrupt:
        interrupted = True
        if not parts:
            raise
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in kernels.Crossings._fields[:-1]}
    return Section(plane, **arrays, ends=tuple(end for part in parts for end in part.ends), interrupted=interrupted)


def follow_crossings(
    plane: SectionPlane, starts: np.ndarray, crossings: int, *, directions: Any = None, longest: float | None = None
) -> Section:
    """Follow starts (m, 2) of a plane to so many crossings, with a perturbation of each along one of `directions` (m, 2).

    By default the perturbations point along the diagonal of the section's extent. `longest` as in `section`."""
    u, v = plane.states(starts)
    count, simulator = len(u), Simulator(plane.system)
    if directions is None:
        directions = np.tile(plane.scales, (count, 1))
    changes = plane.tangents(starts, checked_points(directions, "directions"))
    shortest, slowest = _periods(plane)
    limits = kernels.SectionLimits(_PERIODS * shortest, _PATIENCE * slowest * crossings if longest is None else float(longest))
    times, energies, growths = np.full((3, count, crossings), math.nan)
    points, tangents = np.full((2, count, crossings, 2), math.nan)
    counts, impacts, statuses = np.zeros((3, count), dtype=np.int64)
    out = kernels.Crossings(times, points, energies, growths, tangents, counts, impacts, np.zeros(count), statuses)
    first, sticking = 0, 0
    pace = Pace()
    while first < count:
        if sticking >= 0:  # with one more contact mode the orbit is followed from its start
            modes = simulator.table.stacked
            rows = kernels.Rows(*plane.rows(modes))
            begun = kernels.SectionStarts(np.concatenate([u, v], 1), product(changes, modes.enter[0].T))
            orbit, work = _arrays(simulator, modes)
        orbit.motion.counts[PASSES] = pace.passes
        with pace:
            first, sticking = kernels.follow_section(modes, rows, begun, limits, first, orbit, out, work)
        if first < count and sticking >= 0:
            simulator.table.add(int(sticking))
    return Section(plane, *out[:-1], ends=tuple(_ENDS[code] for code in out.statuses.tolist()))


def _arrays(simulator: Simulator, modes: ContactModes) -> tuple[kernels.Following, kernels.Work]:
    """Arrays for the orbit that is followed, and to write into."""
    n, size = simulator.system.degrees_of_freedom, modes.matrix.shape[1]
    log, scratch = simulator.log(kernels.EVENTS_AT_ONCE), simulator.scratch(np.zeros(2 * n))
    z, begin, change, state, image, velocity, row = np.zeros((7, size))
    places, clocks = np.zeros(kernels.PLACES, dtype=np.int64), np.zeros(kernels.CLOCKS)
    orbit = kernels.Following(simulator.state(0, 0)._replace(z=z), begin, change, places, clocks)
    return orbit, kernels.Work(state, image, velocity, row, np.zeros(kernels.ROOM), log, scratch)


def _periods(plane: SectionPlane) -> tuple[float, float]:
    """Shortest and longest natural period; for motions without springs the time to cross the section at full speed."""
    frequencies = plane.system.modes.frequencies
    moving = frequencies[frequencies > 0.0]
    if not len(moving):
        low, high = plane.reach
        return ((high - low) / float(plane.height(0.5 * (low + high))),) * 2
    return 2.0 * math.pi / float(moving.max()), 2.0 * math.pi / float(moving.min())
