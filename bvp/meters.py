"""What a run sums up over its flights: the power of each damper and of the loads, as products of linear functions of the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bvp.forcing import Forcing
from bvp.numerics import EPSILON

__all__ = ["Meters", "meters_of"]


@dataclass(frozen=True, eq=False)
class Meters:
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


def meters_of(dampers: dict[str, np.ndarray], forcing: Forcing, stops: int) -> Meters:
    """The meters of named parts of the damping matrix and of the work of the loads; v'Cv goes by the eigenvectors of C's symmetric part."""
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
    return Meters(
        np.array(velocity, dtype=float).reshape(-1, n),
        np.array(load, dtype=np.int64),
        np.array(weight, dtype=float),
        np.array(part, dtype=np.int64),
        tuple(dampers),
    )
