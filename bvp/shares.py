"""Whose energy: quadratic forms of the absorber and of the rest, and the dampers across the gaps and elsewhere.

For an absorber carried by a primary mass the absorber's share is its kinetic energy and the spring between the two (Lee et al., Physica D
238 (2009) 1868, section 3); the primary's share is the rest. Dampers across a gap belong to the absorber, all others to the primary.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["absorber_energy", "split_damping"]


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


def absorber_energy(system: ImpactSystem) -> tuple[np.ndarray, np.ndarray]:
    """(M_a, K_a): the absorber's share of the energy is (v M_a v + u K_a u)/2.

    M_a is the absorber's mass, K_a the spring between it and the primary (where no primary is named, all springs that hold the absorber).

    Raises
    ------
    ValueError
        Where the system names no absorber, or the mass matrix couples it to other coordinates.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> absorber_energy(vibro_impact_nes(mu=0.1, sigma=0.2))
    (array([[0.1, 0. ],
           [0. , 0. ]]), array([[ 0.2, -0.2],
           [-0.2,  0.2]]))
    """
    a, n = system.absorber, system.degrees_of_freedom
    if a is None:
        raise ValueError("the system names no absorber; mark its coordinate to have shares of the energy")
    mass, stiffness = np.zeros((n, n)), np.zeros((n, n))
    others = [j for j in range(n) if j != a]
    if np.any(system.mass[a, others]):
        raise ValueError(f"the mass matrix couples {system.coordinates[a]} to others; its kinetic energy has no share of its own")
    mass[a, a] = system.mass[a, a]
    for j in others if system.primary is None else [system.primary]:
        row = np.zeros(n)
        row[a], row[j] = 1.0, -1.0
        stiffness -= system.stiffness[a, j] * np.outer(row, row)
    return mass, stiffness + 0.0


def _distinct(rows: list[np.ndarray]) -> list[np.ndarray]:
    """Rows that are not multiples of earlier ones."""
    kept: list[np.ndarray] = []
    for row in rows:
        if all(abs(abs(row @ other) - np.linalg.norm(row) * np.linalg.norm(other)) > 1e-12 * (row @ row) for other in kept):
            kept.append(row)
    return kept
