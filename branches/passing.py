"""Passing branch points: where a run is stuck beside one, the family is followed again from afar, so that steps fall elsewhere.

Beside a branch point the equations are nearly singular, and a point that happens to be accepted there leads no further.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from branches.identity import Symmetries, symmetries
from bvp.cycle import cycle_of

if TYPE_CHECKING:
    from branches.branch import Branch

__all__ = ["has_jumped", "is_half", "longest"]

PARTS = (0.5, 0.3, 0.8)
"""Parts of its length from where a family is followed again."""

NEARLY = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6)
"""Relative differences of states and flight times up to which an orbit nearly has a symmetry."""

Run = TypeVar("Run")


def longest(first: Run, again: Callable[[Run, float], Run], stuck: Callable[[Run], bool], length: Callable[[Run], float]) -> Run:
    """The longest of some runs along a family.

    Parameters
    ----------
    first : Run
    again : callable
        (run, part) -> a run from the point at that part of the length.
    stuck : callable
        run -> whether it ended where the corrector failed.
    length : callable
        run -> arclength.
    """
    best = first
    for part in PARTS:
        if not stuck(best):
            break
        other = again(best, part)
        if length(other) > length(best):
            best = other
    return best


def has_jumped(branch: Branch) -> bool:
    """Whether steps went over from a family to one of more symmetry at a branch point: then its two ends have not the same symmetries.

    The two can leave the branch point nearly in one direction, as seen in the start state and the energy."""
    if len(branch) < 8:
        return False
    first, last = (symmetries(cycle_of(branch.problem, branch.unknowns(place))) for place in (2, len(branch) - 3))
    return _order(first) != _order(last)


def is_half(branch: Branch, end: int) -> bool:
    """Whether a branch that is stuck at an end (0 or 1) is stuck beside an orbit of more symmetry than its own.

    That orbit is a branch point, where the family meets one of more symmetry. The symmetry maps the family onto itself and exchanges its
    two sides: what lies beyond is the image of what was followed.
    """
    last = len(branch) - 1
    place, inside = (0, last) if end == 0 else (last, 0)
    length = branch.points["arclength"]
    middle = int(np.argmin(np.abs(length - 0.5 * (length[place] + length[inside]))))
    there, own = (cycle_of(branch.problem, branch.unknowns(i)) for i in (place, middle))
    return any(_order(symmetries(there, nearly)) > _order(symmetries(own, nearly)) for nearly in NEARLY)


def _order(found: Symmetries) -> int:
    """How many symmetries an orbit has, itself and its mirror image taken as two."""
    return found.turns * (1 + found.half) * max(1, len(found.reversals))
