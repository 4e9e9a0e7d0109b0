"""Images of free orbits in released parameters: the primitive one, and numbers that no image changes.

Each orbit is one of the system at its own parameters, whose images are those of `branches.presentation`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from branches.presentation import canonical_orbit, embed, is_solved_as_it_is, pattern_of
from branches.sequences import canonical_sequence, format_ends, impacts_per_period
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem
from bvp.released import ReleasedProblem

__all__ = ["canonical_names", "embedded_orbit", "free_invariants", "order_of", "primitive_free_orbit", "released_orbit"]


def canonical_names(problem: ReleasedProblem) -> tuple[str, str]:
    """The ends and the impact sequence in an id: the smallest of all images."""
    sequence, ends = canonical_sequence(tuple(problem.sequence), problem.ends, odd_symmetry=problem.system.has_odd_symmetry)
    return format_ends(ends), "".join(sequence)


def order_of(problem: ReleasedProblem) -> tuple[int, int]:
    """Impacts in a period, and quarter periods that are solved: of an orbit with more symmetry than its family they are less."""
    return impacts_per_period(tuple(problem.sequence), problem.ends), problem.quarters


def primitive_free_orbit(problem: ReleasedProblem, y: np.ndarray) -> tuple[ReleasedProblem, np.ndarray]:
    """The orbit that y repeats, between neighbouring reversals, with its problem; the orbit itself where it is that already."""
    plain, at = problem.orbit_problem(y)
    if is_solved_as_it_is(plain, at):
        return problem, y
    return released_orbit(problem, problem.parameters(y), *canonical_orbit(plain, at))


def released_orbit(
    problem: ReleasedProblem, values: Mapping[str, float], plain: MultipointProblem, y: np.ndarray
) -> tuple[ReleasedProblem, np.ndarray]:
    """The problem of an orbit y of the system at values of the parameters, in the parameters of another problem, and its unknowns."""
    found = problem.sibling(plain.sequence, ends=plain.ends, values=values, energy=plain.energy(y))
    return found, found.of_orbit(plain, y)


def embedded_orbit(
    problem: ReleasedProblem, values: Mapping[str, float], plain: MultipointProblem, y: np.ndarray, window: tuple[int, int] | int
) -> tuple[ReleasedProblem, np.ndarray]:
    """The same of the orbit over a window of its time, see `branches.presentation.embed`."""
    found = embed(plain, y, window)
    wide = MultipointProblem(plain.system, found.ends, found.sequence)
    return released_orbit(problem, values, wide, found.unknowns(wide))


def free_invariants(problem: ReleasedProblem, y: np.ndarray) -> np.ndarray:
    """The parameter, the period, the pattern of the impacts (`branches.presentation.pattern_of`), the energy, and the root mean square of
    the impact speeds, (5,)."""
    plain, at = problem.orbit_problem(y)
    cycle = cycle_of(plain, at)
    pattern = pattern_of(plain.system, cycle.times / cycle.period, cycle.contact)
    value = problem.parameters(y)[problem.released[0]]
    speed = np.sqrt(np.mean(cycle.speeds**2)) if len(cycle.speeds) else 0.0
    return np.array([value, cycle.period, pattern, plain.energy(at), speed])
