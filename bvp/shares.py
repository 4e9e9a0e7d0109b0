"""Whose dissipation: the dampers across the gaps, and elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["split_damping"]


def split_damping(system: ImpactSystem) -> dict[str, np.ndarray]:
    """C as {"gaps": sum of the dampers across the gaps, "rest": what is left}.

    A gap between two coordinates, c = (.. a .. b ..), has the damper d c c' that explains the entry C_ij = d a b; one of a single
    coordinate, c = (.. a ..), the damper from there to the ground, a^2 d = sum_j C_ij. What would be negative, or is asymmetric, or belongs
    to a gap of more coordinates, stays with the rest.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> split_damping(vibro_impact_nes(lam=0.01))["rest"]
    array([[0.  , 0.  ],
           [0.  , 0.01]])
    """
    damping = np.array(system.damping)
    gaps = np.zeros_like(damping)
    for row in _distinct([np.array(stop.gap) for stop in system.stops]):
        at = np.flatnonzero(row)
        left = damping - gaps
        if len(at) == 2 and left[at[0], at[1]] == left[at[1], at[0]]:
            coefficient = left[at[0], at[1]] / (row[at[0]] * row[at[1]])
        elif len(at) == 1:
            coefficient = left[at[0]].sum() / row[at[0]] ** 2
        else:
            continue
        if coefficient > 0.0:
            gaps += coefficient * np.outer(row, row)
    return {"gaps": gaps, "rest": damping - gaps}


def _distinct(rows: list[np.ndarray]) -> list[np.ndarray]:
    """Rows that are not multiples of earlier ones."""
    kept: list[np.ndarray] = []
    for row in rows:
        if all(abs(abs(row @ other) - np.linalg.norm(row) * np.linalg.norm(other)) > 1e-12 * (row @ row) for other in kept):
            kept.append(row)
    return kept
