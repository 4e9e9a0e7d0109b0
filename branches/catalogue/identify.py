"""Which family of a catalogue an orbit belongs to, however it is started, mirrored, or run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from branches.catalogue.closures import distance
from branches.words import canonical, parse_ends, parse_word

if TYPE_CHECKING:
    from branches.catalogue.store import Catalogue
    from bvp.multipoint import MultipointProblem

__all__ = ["identify"]

SAME = 1e-7
"""How far, relatively, two solutions of one orbit may be apart."""

_MARGIN = 1e-9
"""How far, relatively, the energy of an orbit may be beyond the ends of its family."""


def identify(catalogue: Catalogue, problem: MultipointProblem, y: np.ndarray) -> str | None:
    """The id of the family that passes through an orbit; None where none does.

    Parameters
    ----------
    catalogue : Catalogue
    problem : MultipointProblem
        Of the catalogue's system.
    y : (u,) float
        Unknowns of a solved orbit.
    """
    odd = problem.system.has_odd_symmetry
    same = canonical(problem.word, problem.ends, odd_symmetry=odd)
    h = problem.energy(y)
    start = problem.modes.to_state @ problem.start(y)
    alpha = problem.quarter_period(y)
    for row in catalogue.families():
        if not row.h[0] * (1.0 - _MARGIN) <= h <= row.h[1] * (1.0 + _MARGIN):
            continue
        if not row.alpha[0] * (1.0 - 1e-6) <= alpha <= row.alpha[1] * (1.0 + 1e-6):
            continue
        if canonical(parse_word(row.word), parse_ends(row.ends), odd_symmetry=odd) != same:
            continue
        branch = catalogue.branch(row.id)
        for orbit in branch.orbits_at(energy=min(max(h, row.h[0]), row.h[1])):
            if abs(orbit.alpha / alpha - 1.0) < SAME and distance(branch.problem, orbit.solution.y, start) < SAME:
                return row.id
    return None
