"""The terms of a motion's energy budget: the power of each damper and of the loads, as products of linear functions of the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bvp.forcing import Forcing
from bvp.numerics import EPSILON

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["BudgetTerms", "budget_terms", "split_damping"]


@dataclass(frozen=True, eq=False)
class BudgetTerms:
    """What a run sums up over its flights: integrals of weight (a . y)(b . v) or weight (b . v)^2.

    Attributes
    ----------
    velocity : (R, n) ndarray
        b.
    load : (R,) int64 ndarray
        Index among the 2 G entries y of the loads, or -1 where the square of b . v is integrated.
    weight : (R,) ndarray
    part : (R,) int64 ndarray
        The sum that it goes to: 0 .. dampers - 1, then the stops, then the work of the loads.
    dampers : tuple of str
    """

    velocity: np.ndarray
    load: np.ndarray
    weight: np.ndarray
    part: np.ndarray
    dampers: tuple[str, ...]


def budget_terms(dampers: dict[str, np.ndarray], forcing: Forcing, stops: int) -> BudgetTerms:
    """The terms of named parts of the damping matrix and of the work of the loads; v'Cv goes by the eigenvectors of C's symmetric part."""
    velocity, load, weight, part = [], [], [], []
    for k, matrix in enumerate(dampers.values()):
        values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
        for value, vector in zip(values, vectors.T, strict=True):
            if abs(value) > 8.0 * len(values) * EPSILON * np.abs(values).max():
                velocity.append(vector)
                load.append(-1)
                weight.append(value)
                part.append(k)
    for g in range(len(forcing.loads)):
        for k in range(2):
            column = forcing.loads[g, :, k]
            if np.any(column):
                velocity.append(column)
                load.append(2 * g + k)
                weight.append(1.0)
                part.append(len(dampers) + stops)
    n = next(iter(dampers.values())).shape[0]
    return BudgetTerms(
        np.array(velocity, dtype=float).reshape(-1, n),
        np.array(load, dtype=np.int64),
        np.array(weight, dtype=float),
        np.array(part, dtype=np.int64),
        tuple(dampers),
    )


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
