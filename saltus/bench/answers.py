"""What a method answers to a task, and how wrong that is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mpmath as mp
import numpy as np

__all__ = ["Answer", "Errors", "OrbitAnswer", "farthest", "largest", "multiplier_error", "relative"]


@dataclass(frozen=True, eq=False)
class OrbitAnswer:
    """One orbit; None for what the method does not give.

    Attributes
    ----------
    alpha : float
        Quarter period.
    energy : float or None
    velocities : (n,) float or None
        At the start, where u = 0.
    times : (k,) float or None
        Of the inner impacts.
    multipliers : (m,) complex or None
        The nontrivial ones, by modulus descending, then by angle.
    unknowns : (u,) float or None
        Of the multipoint problem, where the method has them: where the orbit in many digits is looked for.
    """

    alpha: float
    energy: float | None = None
    velocities: np.ndarray | None = None
    times: np.ndarray | None = None
    multipliers: np.ndarray | None = None
    unknowns: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """An answer to a task.

    Attributes
    ----------
    points : int
        How many points (orbits, located points, impacts) were computed: what the time is divided by.
    seconds : float or None
        A point, where the method measures it itself; else the whole call is measured.
    orbits : tuple of OrbitAnswer
    located : mapping of str to (alpha, h)
    ran : (float, (2 n,) float, float) or None
        Time, state and energy after the last impact of a motion.
    layers : mapping of str to float or None
        Seconds a point by layer, where the method takes them apart.
    """

    points: int = 1
    seconds: float | None = None
    orbits: tuple[OrbitAnswer, ...] = ()
    located: dict[str, tuple[float, float]] = field(default_factory=dict)
    ran: tuple[float, np.ndarray, float] | None = None
    layers: dict[str, float] | None = None


class Errors(NamedTuple):
    """Relative errors of the orbit, of the energy, of the multipliers and of the located points; None for what was not given."""

    orbit: float | None = None
    energy: float | None = None
    multipliers: float | None = None
    located: float | None = None


def largest(errors: Sequence[float]) -> float:
    """The largest of some errors.

    Raises
    ------
    ArithmeticError
        Where one is not a number: `max` might pass over it.
    """
    if any(math.isnan(error) for error in errors):
        raise ArithmeticError("the answer holds what is not a number")
    return max(errors)


def relative(value: Any, exact: Any) -> float:
    """|value - exact| / |exact|, the difference taken in many digits."""
    return float(abs(mp.mpmathify(value) - exact) / abs(exact))


def farthest(values: Any, exact: list[Any]) -> float:
    """Norm of the difference of two vectors over the norm of the exact one, in many digits."""
    differences = [mp.mpf(float(a)) - b for a, b in zip(values, exact, strict=True)]
    return float(mp.norm(mp.matrix(differences)) / mp.norm(mp.matrix(exact)))


def multiplier_error(values: np.ndarray, exact: list[Any]) -> float:
    """Largest relative error of a multiplier; the two lists are matched as well as they can be."""
    if len(values) != len(exact) or not np.all(np.isfinite(values)):
        return math.inf
    left = [complex(value) for value in values]
    worst = 0.0
    for target in exact:
        errors = [relative(mp.mpc(value), mp.mpc(target)) for value in left]
        best = int(np.argmin(errors))
        worst = max(worst, errors[best])
        left.pop(best)
    return worst
