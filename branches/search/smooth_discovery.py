"""Orbits of a system with smooth forces at one energy, by two scans of starts at the origin (`branches.search.smooth_starts`).

The second scan is twice as fine as the first. What it adds shows how much the first one overlooked; neither proves anything.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from branches.orbit import Orbit
from branches.search.intervals import segment_limits
from branches.search.orbit_search import CLASSES, STAGES, Discovery, OrbitSearch
from branches.search.smooth_starts import SmoothSampler
from bvp.multipoint import MultipointProblem

if TYPE_CHECKING:
    from collections.abc import Sequence

    from branches.search.orbit_search import Problems
    from bvp.system import ImpactSystem

__all__ = ["STARTS", "discover_smooth"]

STARTS = 768
"""Starts over half a turn in the second scan where no number is given."""


def discover_smooth(
    system: ImpactSystem, energy: float, quarter_period: float, impacts: int | None, ends: Sequence[str], starts: int, problems: Problems
) -> Discovery:
    """The orbits that two scans find; arguments as for `branches.search.discovery.discover_orbits`.

    starts: of the second scan, over half a turn for each kind of far end. problems: as of `OrbitSearch`."""
    wanted = sorted({part for name in ends for part in CLASSES[name]})
    samplers = []
    for far in [name.split("-")[1] for name in wanted]:
        _, inner = segment_limits("origin", far, quarter_period, impacts)
        if (far != "stop" or system.stops) and (inner is None or inner >= 0):
            numbers = range(1) if not system.stops else None if inner is None else range(inner + 1)
            samplers.append(SmoothSampler(system, far, quarter_period * (1.0 + 1e-12), numbers))
    search = OrbitSearch(system, problems)
    angles = max(1, starts // 2), starts
    orbits: list[int] = []
    for count in angles:
        # A segment that the first scan could not solve is met again by the second.
        search.unpolished.clear()
        search.counts["unpolished"] = 0
        for sampler in samplers:
            search.counts["starts"] += count + 1
            for segment in sampler.segments(energy, count):
                search.counts["crossings"] += 1
                search.add(segment, partial(MultipointProblem.solve, energy=energy))
        orbits.append(len(search.orbits(quarter_period, impacts)))
    found = [Orbit(orbit.problem, orbit.solution) for orbit in search.orbits(quarter_period, impacts)]
    counts = {stage: search.counts[stage] for stage in STAGES}
    return Discovery(
        system, energy, quarter_period, impacts, tuple(ends), found, search.unpolished, [], counts,
        angles=angles, added=orbits[1] - orbits[0],
    )  # fmt: skip
