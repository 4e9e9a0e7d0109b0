"""Periodic impulsive orbits over a range of energies.

The impulsive start is at the origin, so a reversal maps an orbit with it to itself, and after half a period it meets the origin again. If
the orbit also has half-period symmetry, it meets rest or a stop after a quarter. So each orbit is a zero of one residual along the energy.
It is solved as a multipoint problem in which the absorber starts without velocity.

The events of the motion change at some energies: a new impact by grazing, or a new pair of zeros of the gap coordinate. In between, each
event's residual is a smooth function of log h. `scan_energies` halves intervals of log h until it can close them. An interval is closed if
each residual cannot vanish inside, or is monotone. It cannot vanish if twice its largest derivative at both ends is too small. It is
monotone if the derivatives at both ends and the secant agree within a factor. The distance of each turning point from the stops and from
zero, and the speeds of impacts, must pass the same test, so that no change of the events hides inside. At a change of events an interval
is halved down to rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from branches.orbit import Orbit, label_at
from branches.search.discovery import OrbitSearch, Unpolished, is_complete, judged
from branches.search.impulsive_motions import ImpulsiveMotions, Traces
from branches.search.starts import ScannedSegment
from bvp.checks import checked_energy_range
from bvp.kernels.shooting import TURNING, ZERO
from bvp.multipoint import MultipointProblem, NotConverged, Solution
from bvp.texts import brief, listed

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Bracket", "ImpulsiveOrbit", "ImpulsiveOrbits", "Scan", "certain", "impulsive_orbits", "judge", "scan_energies"]

_NARROWINGS = 12

_ASIDE = 1e-6
"""Arclength to the orbit beside an impulsive one whose label it is given."""

_STAGES = {"without_impacts": "linear", "covers": "k-fold covers", "duplicates": "found twice", "beyond_bounds": "beyond the bounds"}
"""Stages of the search that `ImpulsiveOrbits.counts` names if they occur."""


@brief
@dataclass(frozen=True, eq=False)
class ImpulsiveOrbit:
    """A periodic orbit that starts with the velocity of the primary alone.

    Parameters
    ----------
    orbit : branches.orbit.Orbit
    label : str
        On the side of its family where absorber and primary start out of phase: at the orbit itself the velocity of the absorber has
        no sign to count. "" outside the grammar.
    other_label : str
        On the other side.
    """

    orbit: Orbit
    label: str
    other_label: str

    @property
    def h(self) -> float:
        """Energy."""
        return self.orbit.h

    @property
    def alpha(self) -> float:
        """Quarter period."""
        return self.orbit.alpha

    @property
    def impacts(self) -> int:
        """Impacts in half a period."""
        return len(self.orbit.impacts) // 2

    @property
    def velocity(self) -> float:
        """Start velocity of the primary, positive."""
        system = self.orbit.system
        assert system.primary is not None
        velocities = self.orbit.velocities
        assert velocities is not None
        return abs(float(velocities[system.primary]))


@brief
@dataclass(frozen=True, eq=False)
class ImpulsiveOrbits:
    """The periodic impulsive orbits in a range of energies.

    orbits : by energy. unpolished : zeros without a solution, between two energies. counts : of each stage. open : ranges of energy that
    are not decided.
    """

    system: ImpactSystem
    energy: tuple[float, float]
    quarter_period: float
    impacts: int | None
    orbits: tuple[ImpulsiveOrbit, ...]
    unpolished: tuple[Unpolished, ...]
    counts: dict[str, int] = field(default_factory=dict)
    open: tuple[tuple[float, float], ...] = ()

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        closed = "complete" if self.complete else "not complete"
        title = f"ImpulsiveOrbits, h = {self.energy[0]:g} to {self.energy[1]:g}: {len(self.orbits)} orbits, {closed}"
        return title, [("orbits", listed([orbit.label for orbit in self.orbits]))]

    @property
    def complete(self) -> bool:
        """Whether the scan closed every interval of energies, and each zero was solved or repeats an orbit that was."""
        return is_complete(self.counts)


def impulsive_orbits(
    system: ImpactSystem, energy: tuple[float, float], *, quarter_period: float, impacts: int | None = None
) -> ImpulsiveOrbits:
    """Every primitive periodic orbit with an impulsive start in a range of energies.

    Parameters
    ----------
    system : ImpactSystem
        Two degrees of freedom, one stop with equal gaps, undamped and elastic, absorber and primary named.
    energy : (float, float)
    quarter_period : float
        The longest.
    impacts : int, optional
        Most impacts in half a period.

    Returns
    -------
    ImpulsiveOrbits

    Raises
    ------
    ValueError
        For another system, or a range or bound that is empty or reversed.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> found = impulsive_orbits(vibro_impact_nes(), (2.5, 3.5), quarter_period=2.0)
    >>> [(orbit.label, round(orbit.h, 9)) for orbit in found.orbits], found.complete
    ([('U4122-', 2.987367315)], True)
    """
    low, high = checked_energy_range(energy, positive=True)
    if not 0.0 < quarter_period < math.inf:
        raise ValueError(f"quarter_period = {quarter_period:g}: expected a number above 0")
    if impacts is not None and impacts < 0:
        raise ValueError(f"impacts = {impacts}: expected 0 or more")
    motions = ImpulsiveMotions(system, 2.0 * quarter_period)
    scan = scan_energies(motions, (low, high), quarter_period)
    search = OrbitSearch(system)
    for bracket, level in zip(scan.brackets, narrowed(motions, scan.brackets), strict=True):
        search.add(motions.segment(level, bracket.event, bracket.low, bracket.high), solve_impulsive, _strayed)
    found = [orbit for orbit in search.orbits(quarter_period, impacts) if low <= orbit.h <= high]
    orbits = tuple(
        ImpulsiveOrbit(Orbit(orbit.problem, orbit.solution), *labels_beside(orbit.problem, orbit.solution))
        for orbit in sorted(found, key=lambda orbit: (orbit.h, orbit.alpha))
    )
    counts = {"motions": scan.motions, "changes of the events": scan.changes, "zeros": len(scan.brackets)}
    counts |= {text: search.counts[stage] for stage, text in _STAGES.items() if search.counts[stage]}
    counts |= {"unpolished": len(search.unpolished), "open": len(scan.open), "orbits": len(orbits)}
    unpolished = tuple(item._replace(low=math.exp(item.low), high=math.exp(item.high)) for item in search.unpolished)
    opened = tuple((math.exp(a), math.exp(b)) for a, b in scan.open)
    return ImpulsiveOrbits(system, (low, high), quarter_period, impacts, orbits, unpolished, counts, opened)


def _strayed(segment: ScannedSegment, problem: MultipointProblem, solution: Solution) -> str | None:
    """Why a solution is not the zero that was bracketed; None if it is."""
    slack = 1e-9 + 1e-3 * (segment.high - segment.low) + 10.0 * FLOOR
    if not segment.low - slack <= math.log(solution["energy"]) <= segment.high + slack:
        return f"Newton's method left the energies between which the zero is, for h = {solution['energy']:.10g}"
    return "the solution pierces a stop or grazes" if judged(problem, solution) == "inadmissible" else None


def narrowed(motions: ImpulsiveMotions, brackets: list[Bracket]) -> np.ndarray:
    """log h of each bracket's zero, by Newton's steps kept inside the bracket."""
    if not brackets:
        return np.zeros(0)
    low, high, event, kind = (np.array(column) for column in zip(*brackets, strict=True))
    row = np.arange(len(brackets))
    sign = motions.at(low).residual[row, event] > 0.0
    at = 0.5 * (low + high)
    for _ in range(_NARROWINGS):
        traces = motions.at(at)
        known = (traces.number > event) & (traces.kind[row, event] == kind)
        residual, slope = traces.residual[row, event], traces.residual_slope[row, event]
        below = known & ((residual > 0.0) == sign)
        low = np.where(below, at, low)
        high = np.where(known & ~below, at, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = at - residual / slope
        inside = known & (newton > low) & (newton < high)
        at = np.where(inside, newton, 0.5 * (low + high))
    return at


def solve_impulsive(problem: MultipointProblem, y: np.ndarray) -> Solution:
    """Newton's solution near y of the multipoint problem together with: the absorber starts without velocity.

    Raises
    ------
    NotConverged
        When the update does not shrink to rounding level.
    """
    system = problem.system
    assert system.absorber is not None
    n = system.degrees_of_freedom
    y = np.array(y, dtype=float)
    row = np.zeros(problem.unknowns)
    row[: problem.parameters] = system.modes.to_state[n + system.absorber] @ problem.segment.start_map
    row /= math.sqrt(2.0 * problem.energy(y))
    for _ in range(4):
        good, worst = problem.correct(y, row, 0.0, 20)
        if not np.all(np.isfinite(y)):
            raise NotConverged("Newton's corrections diverged")
        if good:
            break
    else:
        raise NotConverged(f"Newton's corrections did not converge (residual {worst:.1e})")
    solution = problem.step(y, np.zeros(2 * problem.unknowns), 0.0, maximum=0)
    if solution is None:
        raise NotConverged("Newton's corrections did not converge")
    return solution


def labels_beside(problem: MultipointProblem, solution: Solution) -> tuple[str, str]:
    """Labels of the family on the side where absorber and primary start out of phase, and on the other one."""
    system = problem.system
    n = system.degrees_of_freedom
    assert system.absorber is not None and system.primary is not None
    sides: dict[bool, Any] = {True: "", False: ""}
    for sign in (1.0, -1.0):
        beside = problem.step(solution.y, solution.tangent, sign * _ASIDE)
        if beside is None:
            continue
        velocity = system.modes.to_state[n:] @ problem.start(beside.y)
        sides[bool(velocity[system.absorber] * velocity[system.primary] < 0.0)] = str(label_at(problem, beside.result) or "")
    return sides[True], sides[False]


PANEL = 0.05
"""Width in log h of the intervals that a scan starts from."""

FLOOR = 2e-14
"""Width in log h that is not halved any more."""

SAFETY = 2.0
"""How many times steeper than at both ends a residual may be inside an interval that is closed."""

BATCH = 256
MOST_MOTIONS = 400_000


class Bracket(NamedTuple):
    """A zero of the residual at one event: log h below and above, index and kind of the event."""

    low: float
    high: float
    event: int
    kind: int


@dataclass(eq=False)
class Scan:
    """What a scan found: brackets of zeros; counts; `open`, the intervals of log h that could not be closed."""

    brackets: list[Bracket] = field(default_factory=list)
    open: list[tuple[float, float]] = field(default_factory=list)
    motions: int = 0
    changes: int = 0
    """Energies at which the events change, each an interval of width `FLOOR`."""


def scan_energies(motions: ImpulsiveMotions, energy: tuple[float, float], quarter_period: float) -> Scan:
    """Bracket each energy at which the impulsive motion meets an end set.

    Parameters
    ----------
    motions : ImpulsiveMotions
        That follows for two quarter periods at least.
    energy : (float, float)
    quarter_period : float
        Longest; an origin is met after two quarter periods, rest and stop after one.
    """
    scan = Scan()
    low, high = math.log(energy[0]), math.log(energy[1])
    edges = np.linspace(low, high, max(2, math.ceil((high - low) / PANEL) + 1))
    at = motions.at(edges)
    scan.motions += len(edges)
    # Last in, first out: only the intervals next to be halved are kept in memory.
    pending = [(edges[:-1], edges[1:], at.rows(slice(-1)), at.rows(slice(1, None)))]
    while pending:
        a, b, first, last = pending.pop()
        if len(a) > BATCH:
            for half in (slice(len(a) // 2, None), slice(len(a) // 2)):
                pending.append((a[half], b[half], first.rows(half), last.rows(half)))
            continue
        changed, closed, clear, zero = judge(first, last, b - a, motions, quarter_period)
        narrow = b - a <= FLOOR
        done = narrow | (closed.all(axis=1) & clear.all(axis=1) & ~changed)
        for i, j in np.argwhere(zero & done[:, None]):
            scan.brackets.append(Bracket(float(a[i]), float(b[i]), int(j), int(first.kind[i, j])))
        scan.changes += int(np.sum(narrow & changed))
        split = np.flatnonzero(~done)
        left = narrow & ~(closed | zero).all(axis=1)
        if scan.motions > MOST_MOTIONS:
            left, split = left | ~done, split[:0]
        scan.open += [(float(a[i]), float(b[i])) for i in np.flatnonzero(left)]
        if not len(split):
            continue
        middle = 0.5 * (a[split] + b[split])
        between = motions.at(middle)
        scan.motions += len(split)
        lower, upper = np.concatenate([a[split], middle]), np.concatenate([middle, b[split]])
        pending.append((lower, upper, first.rows(split).joined(between), between.joined(last.rows(split))))
    scan.brackets.sort(key=lambda bracket: (bracket.low, bracket.event))
    return scan


def judge(
    first: Traces, last: Traces, width: np.ndarray, motions: ImpulsiveMotions, quarter_period: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Compare the motions at both ends of I intervals.

    Returns
    -------
    changed : (I,) bool
        The events differ, other than by one that leaves the time followed.
    closed, clear, zero : (I, E) bool
        Whether the residual of each event hides no zero but one; whether a turning point hides no change of events; whether the residual
        changes sign. Events after the first that differs are left out.
    """
    size = min(first.kind.shape[1], last.kind.shape[1])
    index = np.arange(size)
    both = index < np.minimum(first.number, last.number)[:, None]
    same = np.logical_and.accumulate(both & (first.kind[:, :size] == last.kind[:, :size]), axis=1)
    prefix = same.sum(axis=1)
    changed = (first.number > prefix) & (last.number > prefix)
    for one, other in ((first, last), (last, first)):
        more = (one.number > prefix) & (other.number <= prefix)
        row = np.flatnonzero(more)
        here = prefix[row]
        # Only the next event may leave at the end of the time, as far as its time moves over the interval.
        moves = SAFETY * np.abs(one.time_slope[row, here]) * width[row]
        leaves = one.time[row, here] + moves + 1e-12 * motions.longest >= motions.longest
        changed[row] = ~leaves
    changed |= (first.number < 0) | (last.number < 0)
    first, last = (Traces(one.number, *(values[:, :size] for values in one[1:])) for one in (first, last))
    late = np.minimum(first.time, last.time)
    within = same & (late <= np.where(first.kind == ZERO, 2.0, 1.0) * quarter_period)
    w = width[:, None]
    sure, sign = certain(first.residual, last.residual, first.residual_slope, last.residual_slope, w)
    clear, _ = certain(first.crossing, last.crossing, first.crossing_slope, last.crossing_slope, w)
    for bound in (0.0, *motions.modes.contacts.bound):
        alone, _ = certain(first.gap - bound, last.gap - bound, first.gap_slope, last.gap_slope, w)
        clear &= (first.kind != TURNING) | alone
    return changed, ~within | sure, ~same | clear, within & sign


def certain(
    low: np.ndarray, high: np.ndarray, low_slope: np.ndarray, high_slope: np.ndarray, width: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether a function with these values and derivatives at both ends of an interval has no zero or just one in it, and whether it
    changes sign."""
    secant = (high - low) / width
    steepest = SAFETY * np.maximum(np.maximum(np.abs(low_slope), np.abs(high_slope)), np.abs(secant))
    sign = (low > 0.0) != (high > 0.0)
    away = ~sign & (np.abs(low) + np.abs(high) > steepest * width)
    least = np.minimum(np.minimum(np.abs(low_slope), np.abs(high_slope)), np.abs(secant))
    monotone = (low_slope * high_slope > 0.0) & (low_slope * secant > 0.0) & (SAFETY * least >= steepest / SAFETY)
    return away | monotone, sign
