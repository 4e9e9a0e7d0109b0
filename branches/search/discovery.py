"""All primitive symmetric orbits of a system at one energy, within bounds."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from branches.naming.labels import nearest
from branches.orbit import Orbit
from branches.search.orbits import Collector, Unpolished, first_crossings, is_one_sided, preference
from branches.search.scan import EndCrossing, Opening, follow_start, resumed, scan
from branches.search.scope import START_FROM_A_STATE, require_conservative, require_one_stop, require_two_degrees
from branches.search.starts import Path, curves
from branches.sequences import impacts_per_period, segments_per_period
from bvp.checks import is_finite, require_system
from bvp.kernels.shooting import TURN_LIMIT
from bvp.kernels.verdict import GRAZED
from bvp.shown import shown
from bvp.summary import brief, listed

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["CLASSES", "WITHOUT_ORIGIN", "Discovery", "discover"]

CLASSES = {
    "origin-origin": ("origin-origin", "origin-rest", "origin-stop"),
    "origin-rest": ("origin-rest",),
    "origin-stop": ("origin-stop",),
    "rest-rest": ("rest-rest", "origin-rest"),
    "rest-stop": ("rest-stop",),
    "stop-stop": ("stop-stop", "origin-stop"),
}
"""Pairs of ends that can be asked for, each with the classes of more symmetry inside it, which are listed as such."""

WITHOUT_ORIGIN = ("rest-rest", "rest-stop", "stop-stop")
"""Pairs of ends that every reversible system has: an origin end needs odd symmetry."""

BUDGET = 1_000_000
"""Starts followed at most in one search; where they do not do, the rest stays open and the search is not settled."""

LONG = 100.0
"""Angle by which the fastest mode may turn within the longest segment (rad); where it turns more, each start takes as much longer, and
fewer are followed."""

LONGEST = 0.5 * TURN_LIMIT
"""Angle by which the fastest mode may turn at most within the longest segment (rad): a flight is looked through in so many steps."""


MOST_BOUND = 10_000
"""Largest bound for the impacts of half a period: the scan keeps so many of a start in memory."""

STAGES = (
    "starts", "split", "closed", "open", "resumed", "at_grazing", "over_budget", "grazings", "crossings", "repeated", "polished",
    "unpolished", "inadmissible", "without_impacts", "multiple_turns", "duplicates", "one_sided", "beyond_bounds", "orbits",
)  # fmt: skip
"""What `Discovery.counts` counts, in this order."""


@brief
@dataclass(frozen=True, eq=False)
class Discovery:
    """What was found at one energy.

    Parameters
    ----------
    system : ImpactSystem
    energy : float
    quarter_period : float
        Longest quarter period searched.
    impacts : int or None
        Most impacts in half a period; None: not bounded.
    ends : tuple of str
        Pairs of ends asked for.
    orbits : list of Orbit
        By quarter period.
    unpolished : list of Unpolished
        What was found but not solved.
    open : list of Opening
        Intervals of starts (by curve) in which it is not decided what they hold.
    counts : dict of str to int
        Of each stage: ``starts`` followed; intervals ``split``, ``closed``, ``open``, ``resumed`` (as narrow as rounding, and
        scanned on from their image), ``at_grazing`` (as narrow as rounding) and ``over_budget``; ``grazings`` located; ``crossings``
        of far ends; ``repeated`` (several turns, known from the start), ``polished``, ``unpolished``, ``inadmissible``,
        ``without_impacts``, ``multiple_turns``, ``duplicates``, ``one_sided`` (found from one of two ends alone), ``beyond_bounds``,
        ``orbits``.
    families : tuple of (str or None)
        Where a catalogue was asked: the id of each orbit's family in it, None where none lies there. Else empty.
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
        closed = "complete" if self.settled else "not complete"
        title = f"Discovery at h = {self.energy:.10g}: {len(self.orbits)} orbits, {closed}"
        return title, [("orbits", listed([orbit.label or "-".join(orbit.ends) for orbit in self.orbits]))]

    @property
    def settled(self) -> bool:
        """Whether the scan has decided all: no interval stayed open, nothing stayed unpolished, each orbit was found from both its ends.

        That is the scan's own part. Whether families that were followed here from other energies add nothing is for a catalogue to say."""
        return not (self.counts["open"] or self.counts["unpolished"] or self.counts["one_sided"])


def discover(
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
        Of `CLASSES`. The default is the published kind: half periods between two origins, and the quarter periods inside them. In a system
        without odd symmetry, which has no such orbits, it is `WITHOUT_ORIGIN`.
    budget : int, optional
        Starts followed at most. The default is a million, and less where the fastest mode turns more than `LONG` within a segment.

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
    >>> found = discover(vibro_impact_nes(), 0.3, quarter_period=3.0, impacts=2)
    >>> found.settled, [orbit.label for orbit in found.orbits]
    (True, ['S11O00-', 'U2111-', 'S13O00+'])
    """
    check(system, energy, quarter_period, impacts, ends)
    if ends is None:
        ends = ("origin-origin",) if system.has_odd_symmetry else WITHOUT_ORIGIN
    if budget is None:
        budget = math.ceil(BUDGET / max(1.0, fastest_turn(system, quarter_period) / LONG))
    if isinstance(budget, bool) or not isinstance(budget, int | np.integer) or not 0 < budget < 1 << 63:
        raise ValueError(f"the most starts is {shown(budget)}, expected a whole number above 0 and below 2^63")
    wanted = sorted({part for name in ends for part in CLASSES[name] if system.has_odd_symmetry or "origin" not in part})
    collector = Collector(system, energy)
    counts: Counter[str] = Counter()
    openings: list[Opening] = []
    for start in ("origin", "rest", "stop"):
        limits: dict[str, tuple[float, int | None]] = {}
        for name in wanted:
            first, far = name.split("-")
            if first == start:
                limits[far] = _limits(first, far, quarter_period, impacts)
        if not limits:
            continue
        longest = max(time for time, _ in limits.values())
        left = deque(curves(system, start, energy))
        while left:
            curve = left.popleft()
            crossings, opened, of_scan = scan(curve, limits, max(1, budget - counts["starts"]))
            counts.update(of_scan)
            for opening in opened:
                on = resumed(curve, opening, longest) if counts["starts"] < budget else None
                if on is not None:
                    left.append(on)
                    counts["resumed"] += 1
                    counts["at_grazing" if opening.reason == GRAZED else "open"] -= 1
                elif opening.reason != GRAZED:
                    openings.append(opening._replace(parameter=curve.angle(opening.parameter), width=curve.piece[1] * opening.width))
            counts["crossings"] += len(crossings)
            paths = [follow_start(curve, crossing.parameter, crossing.impacts, longest) for crossing in crossings]
            instants = [path.until_last + crossing.flight for path, crossing in zip(paths, crossings, strict=True)]
            sequences = [_sequence(path, crossing, system.modes.contact_letters) for path, crossing in zip(paths, crossings, strict=True)]
            first_ones, repeated = first_crossings(crossings, instants, sequences, curve.end, curve.high - curve.low)
            counts["repeated"] += len(repeated)
            for i in first_ones:
                collector.add(curve, crossings[i], paths[i])
    counts.update(collector.counts)
    within = collector.within(quarter_period, impacts)
    orbits = sorted((min(images, key=preference) for images in within), key=lambda o: (o.alpha, o.problem.ends, o.problem.sequence))
    total = sum(len(group) for group in collector.found.values())
    counts["over_budget"] = counts["budget"]
    counts["one_sided"] = sum(is_one_sided(images) for images in within)
    counts["beyond_bounds"] = total - len(orbits)
    counts["orbits"] = len(orbits)
    return Discovery(
        system,
        energy,
        quarter_period,
        impacts,
        tuple(ends),
        [Orbit(orbit.problem, orbit.solution) for orbit in orbits],
        collector.unpolished,
        openings,
        {stage: counts[stage] for stage in STAGES},
    )


def _sequence(path: Path, crossing: EndCrossing, letters: Sequence[str]) -> tuple[str, ...]:
    """The impacts before a crossing; that at a far stop included."""
    return tuple(letters[c] for c in path.contacts[: crossing.impacts + (crossing.kind == "stop")])


def _limits(first: str, far: str, quarter_period: float, impacts: int | None) -> tuple[float, int | None]:
    """Longest time and most inner impacts of a segment between two kinds of end."""
    quarter = (first == "origin") != (far == "origin")
    time = quarter_period * (1.0 if quarter else 2.0) * (1.0 + 1e-12)
    if impacts is None:
        return time, None
    ends = ("stop+" if first == "stop" else first, "stop+" if far == "stop" else far)
    inner = (2 * impacts - impacts_per_period((), ends)) // segments_per_period(ends)
    return (time, inner) if inner >= 0 else (-1.0, -1)


def fastest_turn(system: ImpactSystem, quarter_period: float) -> float:
    """Angle by which the fastest mode turns within the longest segment, half a period (rad)."""
    return 2.0 * quarter_period * math.sqrt(max(0.0, float(np.max(system.modes.squares))))


def check(system: ImpactSystem, energy: float, quarter_period: float, impacts: int | None, ends: Sequence[str] | None) -> None:
    """Refuse what cannot be searched, in one line."""
    require_system(system)
    require_conservative(system, "families of periodic orbits")
    require_two_degrees(system, "orbits are discovered for", START_FROM_A_STATE)
    require_one_stop(system, "orbits are discovered for")
    for what, value in (("energy", energy), ("longest quarter period", quarter_period)):
        if not (is_finite(value) and value > 0.0):
            raise ValueError(f"the {what} is {shown(value)}, expected a finite number above 0")
    turn = fastest_turn(system, quarter_period)
    if turn > LONGEST:
        raise ValueError(
            f"the fastest mode (frequency {turn / (2.0 * quarter_period):.4g}) turns by {turn:.4g} within half of the longest period "
            f"searched, expected {LONGEST:g} or less: a quarter period up to {LONGEST / turn * quarter_period:.3g} can be searched"
        )
    if impacts is not None and (isinstance(impacts, bool) or not isinstance(impacts, int | np.integer) or impacts < 0):
        raise ValueError(f"the most impacts of half a period is {shown(impacts)}, expected a whole number, 0 or more")
    if impacts is not None and impacts > MOST_BOUND:
        raise ValueError(f"the most impacts of half a period is {shown(impacts)}, expected {MOST_BOUND} or less, or no bound")
    if ends is None:
        return
    if not ends:
        raise ValueError(f"no ends are given, expected some of {', '.join(CLASSES)}")
    for name in ends:
        if name not in CLASSES:
            near = nearest(shown(name), CLASSES, 1)
            raise ValueError(f"unknown ends {shown(name)}, expected some of {', '.join(CLASSES)}; nearest: {near[0]}")
        if name.startswith("origin") and not system.has_odd_symmetry:
            raise ValueError(
                f"the ends {name} need odd symmetry (a two-sided stop with equal gaps and no constant load), which this system lacks: "
                "ask for rest-rest, rest-stop or stop-stop"
            )
