"""Identification of orbits: one canonical presentation of each.

An orbit can be solved between other ends, started at another impact, at its other end, as its mirror image -u, backwards in time, or run
through several times. `canonical_orbit` takes all of these to one presentation.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache, reduce
from typing import TYPE_CHECKING

import numpy as np

from branches.presentation import SAME, Presentation, presentation_of, presentations, segment_images, solved, symmetries
from branches.sequences import Ends, ImpactSequence, full_sequence, mirror, segments_per_period
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem, Solution

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = [
    "canonical_orbit", "cover_of", "first_of", "is_solved_as_it_is", "pattern_of", "same_orbit",
]  # fmt: skip

def is_solved_as_it_is(problem: MultipointProblem, y: np.ndarray) -> bool:
    """Whether an orbit is run through once, between neighbouring ones of its reversals, and on itself only where it has none."""
    found = symmetries(cycle_of(problem, y))
    if found.cover > 1 or (found.reversals and problem.periodic):
        return False
    # Both kinds of reversals lie a quarter period apart.
    return problem.quarters != 2 or len({e for _, e in found.reversals}) < 2


def canonical_orbit(problem: MultipointProblem, y: np.ndarray) -> tuple[MultipointProblem, np.ndarray]:
    """The one presentation of an orbit, or of the primitive orbit that it repeats.

    Parameters
    ----------
    problem : MultipointProblem
    y : (u,) float
        A solution of it.

    Returns
    -------
    problem, y
        With the ends that the orbit's reversals have (a quarter where it has both kinds), periodic ends only where it has none. Sequence
        and ends are canonical, see `branches.sequences.canonical_sequence`. Among equal sequences it is one with no more impacts in its
        first half than in its second (p <= q), then the one whose flight times, then start state, come first.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> problem = MultipointProblem(vibro_impact_nes(), ("stop-", "origin"), ())
    >>> solution = problem.solve(problem.pack([0.1, -0.9, 0.5, 0.5], [], [1.7]), quarter_period=1.7)
    >>> canonical_orbit(problem, solution.y)[0].ends
    ('origin', 'stop+')
    """
    best = first_of(presentations(problem, y))
    found = MultipointProblem(problem.system, best.ends, best.sequence)
    return found, solved(found, best.unknowns(found)).y


def first_of(presentations: Sequence[Presentation]) -> Presentation:
    """The canonical one of an orbit's `presentations`."""
    return reduce(lambda best, other: other if _comes_before(other, best) else best, presentations)


def _comes_before(a: Presentation, b: Presentation) -> bool:
    """Order by whether more impacts lie in the first half than in the second, then by flight times, then by start states."""
    if a.leans != b.leans:
        return b.leans
    for x, y in ((a.times, b.times), (-a.start, -b.start)):
        apart = np.flatnonzero(np.abs(x - y) > SAME * np.max(np.abs(x)))
        if apart.size:
            return bool(x[apart[0]] < y[apart[0]])
    return False


def same_orbit(
    a: tuple[MultipointProblem, np.ndarray],
    b: tuple[MultipointProblem, np.ndarray],
    tolerance: float = SAME,
    *,
    between_reversals: bool = False,
) -> bool:
    """Whether two solutions are one orbit: exchanged ends, mirror image, reversal in time, another start, or multiple covers allowed.

    Parameters
    ----------
    a, b : (problem, y)
    tolerance : float
        Of states and times, relative to the largest.
    between_reversals : bool
        Whether both are solved between neighbouring reversals. Then no symmetry has to be looked for: one can only be the other one's
        mirror image, or run from its other end.
    """
    images: Iterable[Presentation]
    if between_reversals:
        presentation, images = presentation_of(*a), segment_images(*b)
    else:
        presentation, images = presentation_of(*canonical_orbit(*a)), presentations(*b)
    size = max(float(np.max(np.abs(part))) for part in (presentation.start, presentation.nodes) if part.size)
    longest = float(np.max(presentation.times))
    return any(
        (image.ends, image.sequence) == (presentation.ends, presentation.sequence)
        and (np.abs(image.times - presentation.times) <= tolerance * longest).all()
        and (np.abs(image.start - presentation.start) <= tolerance * size).all()
        and (np.abs(image.nodes - presentation.nodes) <= tolerance * size).all()
        for image in images
    )


def cover_of(problem: MultipointProblem, solution: Solution) -> int:
    """How often the solved orbit repeats itself: k for the k-fold cover of its primitive orbit, with k = 2 also if the solved half is half
    a period of an orbit with half-period symmetry (a quarter problem solves that one)."""
    if not _may_repeat(problem.ends, problem.sequence):
        return 1
    found = symmetries(cycle_of(problem, solution.y))
    return 2 if found.cover == 1 and problem.quarters == 2 and found.half else found.cover


@lru_cache(maxsize=4096)
def _may_repeat(ends: Ends, sequence: ImpactSequence) -> bool:
    """Whether the contact sequence of a period repeats a shorter sequence, or a shorter sequence and its mirror image in turn."""
    letters = full_sequence(sequence, ends)
    count, half = len(letters), len(letters) // 2
    if any(count % d == 0 and letters[d:] + letters[:d] == letters for d in range(1, count)):
        return True
    # Of a quarter the second half period is the image of the first in any case: its problem solves such an orbit once.
    return segments_per_period(ends) == 2 and count % 2 == 0 and letters[half:] == mirror(letters[:half])


def pattern_of(system: ImpactSystem, parts: np.ndarray, contact: np.ndarray) -> float:
    """A number for the instants of an orbit's impacts: a mean over all pairs of a function of their distance in time, and of whether the
    same side is hit. It is continuous, and no shift, reversal or mirror changes it.

    Parameters
    ----------
    system : ImpactSystem
    parts : (m,) float
        The instants as parts of the period.
    contact : (m,) int
        Contacts hit (rows of the contact arrays of `Modes`).
    """
    phase = 2.0 * np.pi * parts
    stop, side = system.modes.contact_stop[contact], system.modes.contact_side[contact]
    same_side = np.where(stop[:, None] == stop, 2.0 + side[:, None] * side, 1.0)
    return float(np.mean(same_side * np.exp(np.cos(phase[:, None] - phase))))
