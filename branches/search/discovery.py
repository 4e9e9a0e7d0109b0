"""All primitive orbits with a reversal at one energy, within bounds: each scanned segment is solved, and each orbit is kept once.

Two scans find segments. `branches.search.intervals` splits a curve of starts into intervals until each is decided.
`branches.search.starts` compares starts at given angles. It proves nothing, and for a name it is 2 to 90 times as fast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from branches.naming.labels import most_alike
from branches.orbit import Orbit
from branches.search.intervals import segment_limits
from branches.search.known import Boxes
from branches.search.meetings import nothing_new
from branches.search.orbit_search import CLASSES, STAGES, WITHOUT_ORIGIN, Discovery, OrbitSearch, kept_problems
from branches.search.smooth_starts import SmoothSampler
from branches.search.starts import FROM_LINEAR_MODES, ScannedSegment, curves
from bvp.checks import is_finite, require_system
from bvp.kernels.extrema import STEP_LIMIT
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem
from bvp.texts import shown

__all__ = ["check", "check_bounds", "default_budget", "discover_orbits", "fastest_turn"]

BUDGET = 1_000_000
"""Most starts that one search follows. The intervals left then stay open, and the search is not complete."""

LONG = 100.0
"""Angle of the fastest mode within the longest segment (rad) above which fewer starts are followed, because each takes longer."""

LONGEST = 0.1 * STEP_LIMIT
"""Largest angle of the fastest mode within the longest segment (rad). A flight is searched in a limited number of steps."""

STARTS = 768
"""Starts over half a turn in the second scan of a system with smooth forces where no number is given."""

MOST_BOUND = 10_000
"""Largest bound for the impacts of half a period. The scan keeps as many of a start in memory."""


def discover_orbits(
    system: ImpactSystem,
    energy: float,
    *,
    quarter_period: float = 10.0,
    impacts: int | None = None,
    ends: Sequence[str] | None = None,
    budget: int | None = None,
    known: Boxes | None = None,
) -> Discovery:
    """Find every primitive symmetric orbit at an energy, within bounds: `saltus.discover` without a catalogue.

    Parameters
    ----------
    system, energy, quarter_period, impacts, ends, budget
        As for `saltus.discover`. With `ends` None they are the published kind: half periods between two origins, and the quarter periods
        inside them. A system without odd symmetry has no such orbits. There they are `WITHOUT_ORIGIN`. With `budget` None it is
        a million starts, or fewer if the phase of the fastest mode advances by more than `LONG` within a segment.
    known : mapping, optional
        Boxes around the orbits of known families at this energy (`branches.search.known`). The result leaves out the orbits that are
        recognised by them. They are not solved. If a search by meetings (`branches.search.meetings`) shows that there are no others, the
        complete scan is left out, and `counts` are of the search by meetings.
    """
    check(system, energy, quarter_period, impacts, ends)
    if ends is None:
        ends = ("origin-origin",) if system.has_odd_symmetry else WITHOUT_ORIGIN
    smooth = system.smooth_forces is not None
    if budget is None and not smooth:
        budget = default_budget(system, quarter_period)
    if budget is not None and (isinstance(budget, bool) or not isinstance(budget, int | np.integer) or not 0 < budget < 1 << 63):
        raise ValueError(f"the most starts is {shown(budget)}, expected an integer above 0 and below 2^63")
    if smooth:
        return _discover_smooth(system, energy, quarter_period, impacts, ends, budget or STARTS)
    assert budget is not None
    wanted = sorted({part for name in ends for part in CLASSES[name] if system.has_odd_symmetry or "origin" not in part})
    if known and impacts is not None:
        counts = nothing_new(system, energy, wanted, quarter_period, impacts, known)
        if counts is not None:
            return Discovery(system, energy, quarter_period, impacts, tuple(ends), [], [], [], {stage: counts[stage] for stage in STAGES})
    search = OrbitSearch(system, kept_problems(system))
    scanned: list[ScannedSegment] = []
    for start in ("origin", "rest", "stop"):
        far_ends = [name.split("-")[1] for name in wanted if name.startswith(f"{start}-")]
        if far_ends:
            limits = {far: segment_limits(start, far, quarter_period, impacts) for far in far_ends}
            scanned += search.scanned(curves(system, start, energy), limits, budget)
    search.solve(scanned, partial(MultipointProblem.solve, energy=energy), known)
    orbits = [Orbit(orbit.problem, orbit.solution) for orbit in search.orbits(quarter_period, impacts)]
    search.counts["over_budget"] = search.counts["budget"]
    of_stages = {stage: search.counts[stage] for stage in STAGES}
    return Discovery(system, energy, quarter_period, impacts, tuple(ends), orbits, search.unpolished, search.open, of_stages)


def _discover_smooth(
    system: ImpactSystem, energy: float, quarter_period: float, impacts: int | None, ends: Sequence[str], starts: int
) -> Discovery:
    """The orbits of a system with smooth forces that two scans of starts at the origin find (`branches.search.smooth_starts`).

    starts: of the second scan, over half a turn for each kind of far end. It is twice as fine as the first. What it adds shows how much the
    first one overlooked; neither proves anything."""
    wanted = sorted({part for name in ends for part in CLASSES[name]})
    samplers = []
    for far in [name.split("-")[1] for name in wanted]:
        _, inner = segment_limits("origin", far, quarter_period, impacts)
        if (far != "stop" or system.stops) and (inner is None or inner >= 0):
            numbers = range(1) if not system.stops else None if inner is None else range(inner + 1)
            samplers.append(SmoothSampler(system, far, quarter_period * (1.0 + 1e-12), numbers))
    search = OrbitSearch(system, kept_problems(system))
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


def default_budget(system: ImpactSystem, quarter_period: float) -> int:
    """Starts that one search follows if no number is given."""
    return math.ceil(BUDGET / max(1.0, fastest_turn(system, quarter_period) / LONG))


def fastest_turn(system: ImpactSystem, quarter_period: float) -> float:
    """Angle by which the fastest mode rotates within the longest segment, half a period (rad)."""
    return 2.0 * quarter_period * math.sqrt(max(0.0, float(np.max(system.modes.squares))))


def _check_positive(value: Any, what: str) -> None:
    """Raise ValueError for what is not a finite number above 0."""
    if not (is_finite(value) and value > 0.0):
        raise ValueError(f"the {what} is {shown(value)}, expected a finite number above 0")


def check_bounds(system: ImpactSystem, quarter_period: float, impacts: int | None) -> None:
    """Raise ValueError if the longest quarter period or the most impacts cannot bound a search, or if the fastest mode rotates too far
    within the longest segment for a complete scan."""
    _check_positive(quarter_period, "longest quarter period")
    turn = fastest_turn(system, quarter_period)
    if turn > LONGEST:
        raise ValueError(
            f"the fastest mode (frequency {turn / (2.0 * quarter_period):.4g}) rotates by {turn:.4g} within half of the longest period "
            f"searched, expected {LONGEST:g} or less: a quarter period up to {LONGEST / turn * quarter_period:.3g} can be searched"
        )
    if impacts is not None and (isinstance(impacts, bool) or not isinstance(impacts, int | np.integer) or not 0 <= impacts <= MOST_BOUND):
        raise ValueError(f"the most impacts of half a period is {shown(impacts)}, expected an integer from 0 to {MOST_BOUND}, or no bound")


def check(system: ImpactSystem, energy: float, quarter_period: float, impacts: int | None, ends: Sequence[str] | None) -> None:
    """Raise ValueError if the system or the bounds of `discover_orbits` cannot be searched."""
    smooth = getattr(system, "smooth_forces", None) is not None
    stops = "orbits are discovered for" if not smooth or system.stops else ""
    require_system(system, conservative="families of periodic orbits", two_dof=stops, advice=FROM_LINEAR_MODES, smooth=True)
    if smooth:
        _check_smooth(system, ends)
    _check_positive(energy, "energy")
    check_bounds(system, quarter_period, impacts)
    if ends is not None and (not ends or isinstance(ends, str)):
        raise ValueError(f"the ends are {shown(ends)}, expected a list with some of {', '.join(CLASSES)}")
    for name in ends or ():
        if name not in CLASSES:
            near = most_alike(shown(name), CLASSES, 1)
            raise ValueError(f"unknown ends {shown(name)}, expected some of {', '.join(CLASSES)}; nearest: {near[0]}")
        if name.startswith("origin") and not system.has_odd_symmetry:
            raise ValueError(
                f"the ends {name} need odd symmetry (a two-sided stop with equal gaps and no constant load), which this system lacks: "
                "ask for rest-rest, rest-stop or stop-stop"
            )


def _check_smooth(system: ImpactSystem, ends: Sequence[str] | None) -> None:
    """Raise ValueError for smooth forces or ends that the scan of starts at the origin does not cover."""
    n = system.degrees_of_freedom
    if n != 2:
        raise ValueError(f"orbits are discovered for two degrees of freedom; this system has {n}: {FROM_LINEAR_MODES}")
    if not system.has_odd_symmetry:
        raise ValueError(
            f"its orbits are discovered from the origin, and it has no odd symmetry ({system.why_not_odd()}): {FROM_LINEAR_MODES}"
        )
    if "origin-stop" in (ends or ()) and not system.stops:
        raise ValueError("the ends origin-stop need a stop, which this system lacks; expected origin-origin or origin-rest")
    others = [name for name in ends or () if name in WITHOUT_ORIGIN]
    if others:
        raise ValueError(f"its orbits are discovered from the origin; received the ends {others[0]}, expected origin-origin")
