"""Periodic impulsive orbits over a range of energies.

The impulsive starts at all energies of a range are a curve: one velocity, scaled. An impulsive orbit starts at the origin, so after half
a period it meets the origin again. If it also has half-period symmetry, it meets rest or a stop after a quarter. So the complete scan of a
curve of starts finds each. The orbit is solved as a multipoint problem in which the absorber starts without velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from branches.orbit import Orbit, label_at
from branches.search.discovery import check_bounds, default_budget
from branches.search.impulsive_motions import check_system, impulsive_state
from branches.search.intervals import segment_limits
from branches.search.orbit_search import OrbitSearch, Unpolished, is_complete
from branches.search.starts import curve_over_energy
from bvp.checks import checked_energy_range, require_system
from bvp.multipoint import MultipointProblem, NotConverged, Solution
from bvp.system import ImpactSystem
from bvp.texts import brief, listed

__all__ = ["ImpulsiveOrbit", "ImpulsiveOrbits", "impulsive_orbits"]

_ASIDE = 1e-6
"""Arclength to the orbit beside an impulsive one whose label it is given."""

_MOST_IMPACTS = 100_000
"""Most impacts of one start. The scan has room in memory for as many at each depth of its intervals."""

_STAGES = {
    "starts": "starts", "grazings": "grazings", "crossings": "zeros", "without_impacts": "linear", "repeated": "repeated",
    "covers": "k-fold covers", "inadmissible": "inadmissible", "duplicates": "found twice", "beyond_bounds": "beyond the bounds",
}  # fmt: skip
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
        title = f"ImpulsiveOrbits, h = {self.energy[0]:.10g} to {self.energy[1]:.10g}: {len(self.orbits)} orbits, {closed}"
        return title, [("orbits", listed([orbit.label for orbit in self.orbits]))]

    @property
    def complete(self) -> bool:
        """Whether the scan decided every interval of energies, and each zero was solved or repeats an orbit that was."""
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
    check_system(system)
    require_system(system, two_dof="periodic impulsive orbits are found by one scan over energy on")
    if not system.has_odd_symmetry:
        raise ValueError("periodic impulsive orbits need one stop with equal gaps on both sides: they pass through the origin")
    check_bounds(system, quarter_period, impacts)
    start = system.modes.from_state @ np.concatenate(impulsive_state(system, 1.0))
    limits = {far: segment_limits("origin", far, quarter_period, impacts) for far in ("origin", "rest", "stop")}
    curve = curve_over_energy(system, start, (low, high), 2.0 * quarter_period)
    if impacts is None and curve.most_impacts > _MOST_IMPACTS:
        raise ValueError(
            f"a motion with energy {high:g} can have {curve.most_impacts} impacts within half of the longest period searched, expected "
            f"{_MOST_IMPACTS} or less: give a lower energy, a shorter quarter period or the most impacts"
        )
    search = OrbitSearch(system)
    search.scan([curve], limits, default_budget(system, quarter_period), solve_impulsive)
    found = [orbit for orbit in search.orbits(quarter_period, impacts) if low <= orbit.h <= high]
    orbits = tuple(
        ImpulsiveOrbit(Orbit(orbit.problem, orbit.solution), *labels_beside(orbit.problem, orbit.solution))
        for orbit in sorted(found, key=lambda orbit: (orbit.h, orbit.alpha))
    )
    counts = {text: search.counts[stage] for stage, text in _STAGES.items() if search.counts[stage]}
    counts |= {"unpolished": len(search.unpolished), "open": len(search.open), "orbits": len(orbits)}
    unpolished = tuple(item._replace(low=math.exp(item.low), high=math.exp(item.high)) for item in search.unpolished)
    opened = tuple((math.exp(gap.parameter), math.exp(gap.parameter + gap.width)) for gap in search.open)
    return ImpulsiveOrbits(system, (low, high), quarter_period, impacts, orbits, unpolished, counts, opened)


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
    row[: problem.parameters] = system.modes.to_state[n + system.absorber] @ problem.start_map
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
