"""All primitive symmetric orbits of a system at one energy, within bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from branches.naming.labels import most_alike
from branches.orbit import Orbit
from branches.search.intervals import Opening
from branches.search.orbits import OrbitSearch, Unpolished, is_complete, kept_problems
from branches.search.starts import START_FROM_A_STATE
from branches.sequences import impacts_per_period, segments_per_period
from bvp.checks import is_finite, require_system
from bvp.kernels.shooting import STEP_LIMIT
from bvp.texts import brief, listed, shown

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["CLASSES", "WITHOUT_ORIGIN", "Discovery", "check", "discover_orbits", "fastest_turn", "segment_limits"]

CLASSES = {
    "origin-origin": ("origin-origin", "origin-rest", "origin-stop"),
    "origin-rest": ("origin-rest",),
    "origin-stop": ("origin-stop",),
    "rest-rest": ("rest-rest", "origin-rest"),
    "rest-stop": ("rest-stop",),
    "stop-stop": ("stop-stop", "origin-stop"),
}
"""Pairs of ends that can be searched, each with the pairs of the more symmetric orbits among its own."""

WITHOUT_ORIGIN = ("rest-rest", "rest-stop", "stop-stop")
"""Pairs of ends of every reversible system. An origin end needs odd symmetry."""

BUDGET = 1_000_000
"""Most starts that one search follows. The intervals left then stay open, and the search is not complete."""

LONG = 100.0
"""Angle of the fastest mode within the longest segment (rad) above which fewer starts are followed, because each takes longer."""

LONGEST = 0.5 * STEP_LIMIT
"""Largest angle of the fastest mode within the longest segment (rad). A flight is searched in a limited number of steps."""

MOST_BOUND = 10_000
"""Largest bound for the impacts of half a period. The scan keeps as many of a start in memory."""

STAGES = (
    "starts", "split", "closed", "open", "resumed", "at_grazing", "over_budget", "grazings", "crossings", "repeated", "polished",
    "unpolished", "inadmissible", "without_impacts", "covers", "duplicates", "one_sided", "beyond_bounds", "orbits",
)  # fmt: skip
"""Keys of `Discovery.counts`."""


@brief
@dataclass(frozen=True, eq=False)
class Discovery:
    """The orbits found at one energy.

    Parameters
    ----------
    system : ImpactSystem
    energy : float
    quarter_period : float
        Longest quarter period searched.
    impacts : int or None
        Most impacts in half a period; None: not bounded.
    ends : tuple of str
        Pairs of ends searched.
    orbits : list of Orbit
        By quarter period.
    unpolished : list of Unpolished
        Segments that were found but not solved.
    open : list of Opening
        Intervals of starts that are not decided.
    counts : dict of str to int
        Of each stage: ``starts`` followed; intervals ``split``, ``closed``, ``open``, ``resumed`` (as narrow as rounding, and
        scanned on from their image), ``at_grazing`` (as narrow as rounding) and ``over_budget``; ``grazings`` located; ``crossings``
        of far ends; ``repeated`` (k-fold covers, known from the start), ``polished``, ``unpolished``, ``inadmissible``,
        ``without_impacts``, ``covers``, ``duplicates``, ``one_sided`` (found from one of two ends alone), ``beyond_bounds``,
        ``orbits``.
    families : tuple of (str or None)
        The id of each orbit's family in a catalogue, None if it has none there. Empty without a catalogue.
    """

    system: ImpactSystem
    energy: float
    quarter_period: float
    impacts: int | None
    ends: tuple[str, ...]
    orbits: list[Orbit]
    unpolished: list[Unpolished]
    open: list[Opening]
    counts: dict[str, int]
    families: tuple[str | None, ...] = ()

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        closed = "complete" if self.complete else "not complete"
        title = f"Discovery at h = {self.energy:.10g}: {len(self.orbits)} orbits, {closed}"
        return title, [("orbits", listed([orbit.label or "-".join(orbit.ends) for orbit in self.orbits]))]

    @property
    def complete(self) -> bool:
        """Whether the scan decided all intervals, all segments were solved, and each orbit was found from both its ends.

        Whether families followed from other energies add nothing can only be checked with a catalogue."""
        return is_complete(self.counts)


def discover_orbits(
    system: ImpactSystem,
    energy: float,
    *,
    quarter_period: float = 10.0,
    impacts: int | None = None,
    ends: Sequence[str] | None = None,
    budget: int | None = None,
) -> Discovery:
    """Find every primitive symmetric orbit at an energy, within bounds.

    Parameters
    ----------
    system : ImpactSystem
        Conservative, two degrees of freedom, one stop.
    energy : float
        h > 0.
    quarter_period : float
        Longest quarter period.
    impacts : int, optional
        Most impacts in half a period; None: not bounded.
    ends : sequence of str, optional
        Of `CLASSES`. The default is the published kind: half periods between two origins, and the quarter periods inside them. A system
        without odd symmetry has no such orbits. There the default is `WITHOUT_ORIGIN`.
    budget : int, optional
        Largest number of starts that are followed. The default is a million, or fewer if the phase of the fastest mode advances by
        more than `LONG` within a segment.

    Returns
    -------
    Discovery

    Raises
    ------
    ValueError
        For a system or bounds that cannot be searched.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> found = discover_orbits(vibro_impact_nes(), 0.3, quarter_period=3.0, impacts=2)
    >>> found.complete, [orbit.label for orbit in found.orbits]
    (True, ['S11O00-', 'U2111-', 'S13O00+'])
    """
    check(system, energy, quarter_period, impacts, ends)
    if ends is None:
        ends = ("origin-origin",) if system.has_odd_symmetry else WITHOUT_ORIGIN
    if budget is None:
        budget = math.ceil(BUDGET / max(1.0, fastest_turn(system, quarter_period) / LONG))
    if isinstance(budget, bool) or not isinstance(budget, int | np.integer) or not 0 < budget < 1 << 63:
        raise ValueError(f"the most starts is {shown(budget)}, expected an integer above 0 and below 2^63")
    wanted = sorted({part for name in ends for part in CLASSES[name] if system.has_odd_symmetry or "origin" not in part})
    search = OrbitSearch(system, kept_problems(system))
    for start in ("origin", "rest", "stop"):
        far_ends = [name.split("-")[1] for name in wanted if name.startswith(f"{start}-")]
        if far_ends:
            search.scan(start, energy, {far: segment_limits(start, far, quarter_period, impacts) for far in far_ends}, budget)
    orbits = [Orbit(orbit.problem, orbit.solution) for orbit in search.orbits(quarter_period, impacts)]
    search.counts["over_budget"] = search.counts["budget"]
    counts = {stage: search.counts[stage] for stage in STAGES}
    return Discovery(system, energy, quarter_period, impacts, tuple(ends), orbits, search.unpolished, search.open, counts)


def segment_limits(first: str, far: str, quarter_period: float, impacts: int | None) -> tuple[float, int | None]:
    """Longest time and largest number of inner impacts of a segment between two kinds of end; (-1, -1) if there is no such segment."""
    # A segment with the origin at one end only is a quarter of a period; every other segment is half a period.
    quarter = (first == "origin") != (far == "origin")
    time = quarter_period * (1.0 if quarter else 2.0) * (1.0 + 1e-12)
    if impacts is None:
        return time, None
    ends = ("stop+" if first == "stop" else first, "stop+" if far == "stop" else far)
    inner = (2 * impacts - impacts_per_period((), ends)) // segments_per_period(ends)
    return (time, inner) if inner >= 0 else (-1.0, -1)


def fastest_turn(system: ImpactSystem, quarter_period: float) -> float:
    """Angle by which the fastest mode rotates within the longest segment, half a period (rad)."""
    return 2.0 * quarter_period * math.sqrt(max(0.0, float(np.max(system.modes.squares))))


def check(system: ImpactSystem, energy: float, quarter_period: float, impacts: int | None, ends: Sequence[str] | None) -> None:
    """Raise ValueError if the system or the bounds of `discover_orbits` cannot be searched."""
    require_system(system, conservative="families of periodic orbits", two_dof="orbits are discovered for", advice=START_FROM_A_STATE)
    for what, value in (("energy", energy), ("longest quarter period", quarter_period)):
        if not (is_finite(value) and value > 0.0):
            raise ValueError(f"the {what} is {shown(value)}, expected a finite number above 0")
    turn = fastest_turn(system, quarter_period)
    if turn > LONGEST:
        raise ValueError(
            f"the fastest mode (frequency {turn / (2.0 * quarter_period):.4g}) rotates by {turn:.4g} within half of the longest period "
            f"searched, expected {LONGEST:g} or less: a quarter period up to {LONGEST / turn * quarter_period:.3g} can be searched"
        )
    if impacts is not None and (isinstance(impacts, bool) or not isinstance(impacts, int | np.integer) or impacts < 0):
        raise ValueError(f"the most impacts of half a period is {shown(impacts)}, expected an integer, 0 or more")
    if impacts is not None and impacts > MOST_BOUND:
        raise ValueError(f"the most impacts of half a period is {shown(impacts)}, expected {MOST_BOUND} or less, or no bound")
    if ends is None:
        return
    if not ends or isinstance(ends, str):
        raise ValueError(f"the ends are {shown(ends)}, expected a list with some of {', '.join(CLASSES)}")
    for name in ends:
        if name not in CLASSES:
            near = most_alike(shown(name), CLASSES, 1)
            raise ValueError(f"unknown ends {shown(name)}, expected some of {', '.join(CLASSES)}; nearest: {near[0]}")
        if name.startswith("origin") and not system.has_odd_symmetry:
            raise ValueError(
                f"the ends {name} need odd symmetry (a two-sided stop with equal gaps and no constant load), which this system lacks: "
                "ask for rest-rest, rest-stop or stop-stop"
            )
