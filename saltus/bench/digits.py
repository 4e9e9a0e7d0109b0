"""Periodic orbits in fifty digits: what the errors of symmetric orbits are measured against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np

from bvp import many_digits
from bvp.digit_modes import DIGITS
from bvp.multipoint import MultipointProblem

__all__ = ["DIGITS", "DigitOrbit", "orbit_in_digits", "pair"]


@dataclass(frozen=True, eq=False)
class DigitOrbit:
    """An orbit in many digits.

    Attributes
    ----------
    alpha, h : mpf
    velocities : list of n mpf
        At the start, where u = 0.
    times : list of mpf
        Of the impacts of the solved segment after its start, without that at its end.
    multipliers : list of mpf or mpc
        The nontrivial ones by modulus descending, then by angle; for two degrees of freedom, else empty.
    residual : mpf
        What is left of the equations.
    """

    alpha: Any
    h: Any
    velocities: list[Any]
    times: list[Any]
    multipliers: list[Any]
    residual: Any


def orbit_in_digits(problem: MultipointProblem, y: np.ndarray, alpha: float) -> DigitOrbit:
    """The orbit next to a solution in double precision, at a quarter period.

    Parameters
    ----------
    problem : MultipointProblem
        With an origin start.
    y : (u,) float
        Unknowns near the orbit.
    alpha : float
        The quarter period, taken as the binary fraction that it is.

    Raises
    ------
    ValueError
        For another start.
    ArithmeticError
        Where the corrections do not settle.
    """
    if problem.ends[0] != "origin":
        raise ValueError(f"orbits in many digits start at the origin; received {problem.ends[0]}")
    found = many_digits.orbit_in_digits(problem, y, alpha)
    with mp.workdps(DIGITS):
        moments = [mp.fsum(found.times[: i + 1]) for i in range(problem.inner)]
        multipliers = pair(found.trace / 2) if problem.half == 2 else []
        velocities = found.modes.velocities(found.states[0])
        return DigitOrbit(mp.mpf(float(alpha)), found.energy, velocities, moments, multipliers, found.residual)


def pair(half_trace: Any) -> list[Any]:
    """Roots of x^2 - 2 half_trace x + 1, by modulus descending, then by angle."""
    square = half_trace**2 - 1
    if square < 0:
        turn = mp.sqrt(-square)
        return [mp.mpc(half_trace, -turn), mp.mpc(half_trace, turn)]
    larger = half_trace + mp.sign(half_trace) * mp.sqrt(square)
    return [larger, 1 / larger]
