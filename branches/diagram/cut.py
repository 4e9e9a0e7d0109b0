"""The part of a family within a range of energies: its points there, and its orbits at the very bounds where it passes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.orbit import Orbit

__all__ = ["cut"]

Row = tuple[int, "Orbit | None"]
"""A point by its index, or an orbit between that point and the next."""


def cut(branch: Branch, low: float, high: float, names: Sequence[str]) -> list[dict[str, np.ndarray]]:
    """The pieces of a branch that lie within low <= h <= high, in order of arclength.

    Without the orbits at the bounds a family that has no point within a narrow range would be left out, and every other one would end
    before the bound, at its last point within.

    Parameters
    ----------
    branch : Branch
    low, high : float
    names : sequence of str
        Columns of `Branch.points`.

    Returns
    -------
    list of dict
        Of each piece those columns, (N, ...) arrays with N >= 1; a bound where the corrector fails is left out.
    """
    h = branch.points["h"]
    inside = (h >= low) & (h <= high)
    pieces: list[list[Row]] = []
    open_ = False
    for i in range(len(h)):
        if inside[i]:
            if not open_:
                pieces.append([])
            pieces[-1].append((i, None))
        open_ = bool(inside[i])
        if i + 1 == len(h):
            break
        passed = [bound for bound in (low, high) if (h[i] - bound) * (h[i + 1] - bound) < 0.0]
        for bound in sorted(passed, reverse=bool(h[i] > h[i + 1])):
            if not open_:
                pieces.append([])
            orbit = _between(branch, i, bound)
            if orbit is not None:
                pieces[-1].append((i, orbit))
            open_ = not open_
    return [{name: _column(branch, piece, name) for name in names} for piece in pieces if piece]


def _between(branch: Branch, i: int, energy: float) -> Orbit | None:
    """The orbit of an energy between points i and i + 1; None where the corrector fails, or ends on another orbit."""
    h, alpha = branch.points["h"], branch.points["alpha"]
    part = (energy - h[i]) / (h[i + 1] - h[i])
    orbit = branch.orbit_between(i, part, energy=energy)
    if orbit is None:
        return None
    off = abs(orbit.alpha - (1.0 - part) * alpha[i] - part * alpha[i + 1])
    return orbit if off <= abs(alpha[i + 1] - alpha[i]) + 1e-3 * alpha[i] else None


def _column(branch: Branch, piece: Sequence[Row], name: str) -> np.ndarray:
    column: Any = branch.points[name]
    values = [column[i] if orbit is None else orbit.described.columns[name][0] for i, orbit in piece]
    return np.array(values, dtype=None if column.dtype.kind == "U" else column.dtype)  # a label may be longer than all that are kept
