"""Periodic impulsive orbits over a range of energies.

The impulsive start is at the origin, so an orbit with it is its own reversal there and passes the origin again after half a period;
where it also is symmetric under half a period's shift, it meets rest or a stop after a quarter. So each is a zero of one number along
the energy, and is solved as an exact solution of its multipoint problem with the start velocity of the absorber held at zero.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from branches.family import label_text
from branches.identity import cover_of
from branches.impulsive.scan import FLOOR, Bracket, ImpulsiveMotions, Scan, scan_energies
from branches.orbit import Orbit
from branches.search.orbits import Found, accept
from bvp.checks import checked_energy_range
from bvp.kernels.shooting import TURN, ZERO
from bvp.multipoint import MultipointProblem, NotConverged, Solution
from bvp.summary import brief, listed

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["ImpulsiveOrbit", "ImpulsiveOrbits", "Unpolished", "impulsive_orbits", "solve_impulsive"]

_NARROWINGS = 12
_ASIDE = 1e-6
"""Arclength to the orbit beside an impulsive one whose label it is given."""


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


@dataclass(frozen=True)
class Unpolished:
    """A zero of the scan that no solution was found for: energies around it, the ends, and why."""

    low: float
    high: float
    ends: tuple[str, str]
    reason: str


@brief
@dataclass(frozen=True, eq=False)
class ImpulsiveOrbits:
    """All that a search found.

    orbits : in order of energy. unpolished : zeros without a solution. counts : of each stage. settled : whether the scan could close
    every interval of energies and each zero was either solved or is a repetition of an orbit that was.
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
        closed = "complete" if self.settled else "not complete"
        title = f"ImpulsiveOrbits, h = {self.energy[0]:g} to {self.energy[1]:g}: {len(self.orbits)} orbits, {closed}"
        return title, [("orbits", listed([orbit.label for orbit in self.orbits]))]

    @property
    def settled(self) -> bool:
        return not self.open and not self.unpolished


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
    >>> [(orbit.label, round(orbit.h, 9)) for orbit in found.orbits], found.settled
    ([('U4122-', 2.987367315)], True)
    """
    low, high = checked_energy_range(energy, positive=True)
    if not 0.0 < quarter_period < math.inf:
        raise ValueError(f"quarter_period = {quarter_period:g}: expected a number above 0")
    if impacts is not None and impacts < 0:
        raise ValueError(f"impacts = {impacts}: expected 0 or more")
    motions = ImpulsiveMotions(system, 2.0 * quarter_period)
    scan = scan_energies(motions, (low, high), quarter_period)
    search = _Search(motions, quarter_period, impacts)
    for bracket, level in zip(scan.brackets, narrowed(motions, scan.brackets), strict=True):
        search.polish(bracket, level)
    return search.result(scan, (low, high))


def narrowed(motions: ImpulsiveMotions, brackets: list[Bracket]) -> np.ndarray:
    """log h of each bracket's zero, by Newton's steps kept inside the bracket."""
    if not brackets:
        return np.zeros(0)
    low = np.array([bracket.low for bracket in brackets])
    high = np.array([bracket.high for bracket in brackets])
    event = np.array([bracket.event for bracket in brackets])
    kind = np.array([bracket.kind for bracket in brackets])
    row = np.arange(len(brackets))
    sign = motions.at(low).residual[row, event] > 0.0
    at = 0.5 * (low + high)
    for _ in range(_NARROWINGS):
        traces = motions.at(at)
        known = (traces.count > event) & (traces.kind[row, event] == kind)
        residual, slope = traces.residual[row, event], traces.residual_slope[row, event]
        below = known & ((residual > 0.0) == sign)
        low = np.where(below, at, low)
        high = np.where(known & ~below, at, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = at - residual / slope
        inside = known & (newton > low) & (newton < high)
        at = np.where(inside, newton, 0.5 * (low + high))
    return at


class _Search:
    """Polishes brackets one after another, and sorts what they are."""

    def __init__(self, motions: ImpulsiveMotions, quarter_period: float, impacts: int | None):
        self.motions = motions
        self.system = motions.system
        self.quarter_period = quarter_period
        self.impacts = impacts
        self.counts: Counter[str] = Counter()
        self.orbits: list[ImpulsiveOrbit] = []
        self.unpolished: list[Unpolished] = []
        self.problems: dict[tuple[str, tuple[str, ...]], MultipointProblem] = {}

    def polish(self, bracket: Bracket, level: float) -> None:
        start, sequence, nodes, times = self.motions.segment(level, bracket.event)
        letters = self.motions.modes.contact_letters
        end = {ZERO: "origin", TURN: "rest"}.get(bracket.kind) or "stop" + letters[bracket.kind]
        if end in ("origin", "rest") and not sequence:
            self.counts["linear"] += 1  # two modes in a rational ratio: a periodic motion without impacts
            return
        key = (end, sequence)
        if key not in self.problems:
            self.problems[key] = MultipointProblem(self.system, ("origin", end), sequence)
        problem = self.problems[key]
        try:
            solution = solve_impulsive(problem, problem.pack(start, nodes, times))
        except NotConverged as error:
            self._leave(bracket, problem, str(error))
            return
        found = math.log(solution["energy"])
        slack = 1e-9 + 1e-3 * (bracket.high - bracket.low) + 10.0 * FLOOR
        if not bracket.low - slack <= found <= bracket.high + slack:
            self._leave(bracket, problem, f"Newton's method left the energies between which the zero is, for h = {solution['energy']:.10g}")
            return
        if cover_of(problem, solution) > 1:
            self.counts["repetitions"] += 1
            return
        orbit = accept(problem, solution)
        if orbit is None:
            self._leave(bracket, problem, "the solution pierces a stop or grazes")
            return
        self._keep(orbit)

    def _leave(self, bracket: Bracket, problem: MultipointProblem, reason: str) -> None:
        self.unpolished.append(Unpolished(math.exp(bracket.low), math.exp(bracket.high), problem.ends, reason))

    def _keep(self, found: Found) -> None:
        if found.alpha > self.quarter_period * (1.0 + 1e-12):
            return
        orbit = Orbit(found.problem, found.solution)
        if self.impacts is not None and len(orbit.impacts) // 2 > self.impacts:
            self.counts["too many impacts"] += 1
            return
        # One energy has one impulsive motion, so what has the same energy and the same period is the same orbit.
        if any(abs(other.h / orbit.h - 1.0) < 1e-10 and abs(other.alpha / orbit.alpha - 1.0) < 1e-9 for other in self.orbits):
            self.counts["found twice"] += 1
            return
        self.orbits.append(ImpulsiveOrbit(orbit, *labels_beside(found.problem, found.solution)))

    def result(self, scan: Scan, energy: tuple[float, float]) -> ImpulsiveOrbits:
        orbits = [orbit for orbit in self.orbits if energy[0] <= orbit.h <= energy[1]]
        orbits.sort(key=lambda orbit: (orbit.h, orbit.alpha))
        counts = {
            "motions": scan.motions,
            "changes of the events": scan.changes,
            "zeros": len(scan.brackets),
            **self.counts,
            "unpolished": len(self.unpolished),
            "open": len(scan.open),
            "orbits": len(orbits),
        }
        opened = tuple((math.exp(a), math.exp(b)) for a, b in scan.open)
        return ImpulsiveOrbits(
            self.system, energy, self.quarter_period, self.impacts, tuple(orbits), tuple(self.unpolished), counts, opened
        )


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
        raise NotConverged(f"Newton's corrections did not settle (residual {worst:.1e})")
    solution = problem.step(y, np.zeros(2 * problem.unknowns), 0.0, maximum=0)
    if solution is None:
        raise NotConverged("Newton's corrections did not settle")
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
        sides[bool(velocity[system.absorber] * velocity[system.primary] < 0.0)] = label_text(problem, beside.result)
    return sides[True], sides[False]


