"""The test functions of a family of orbits with two degrees of freedom, from what the kernels know of an orbit.

Pure functions of numbers and sequences, which call no other: `branches.family` calls them as they stand, and
`branches.kernels.advance` compiles the very same ones.
"""

from __future__ import annotations

import math
from typing import Any

from bvp.kernels.multipoint import (
    ABSORBER_END,
    ABSORBER_START,
    BRANCHING,
    CLEARANCE,
    CONDITIONING,
    CONVERGED,
    ENERGY,
    FIRST_QUARTER,
    FLIGHT,
    GAVE_UP,
    HALF_A,
    HALF_B,
    HALF_C,
    HALF_D,
    IN_PHASE,
    QUARTER_PERIOD,
    RESIDUAL,
    SECOND_QUARTER,
    SLOPE,
    SPEED,
    SPEEDS,
    STEEPNESS,
    TRACE,
    WAVES_ABSORBER,
    WAVES_PRIMARY,
)

__all__ = ["COMMON", "NOISE", "PIVOT_NOISE", "common_tests", "is_orbit", "two_dof_tests"]

COMMON = 11
"""Test functions that every family has, whatever its degrees of freedom."""

_ACCURATE = 1e-12
"""Scaled residual below which a solution is an orbit."""

_CLEAR = 1e3
NOISE = 2e-13
"""Part of the half map's largest entry below which an entry is rounding: a conserved momentum makes one vanish all along a family, and
its noise is no event."""


PIVOT_NOISE = 5e-14
"""Noise of the half map's entries, as a part of the largest one, times the smallest pivot: near a branch point an orbit is uncertain by
rounding over the pivot, in the direction of the other family."""

TANGENT_NOISE = 2e-13
"""Noise of the slope times the square of the smallest pivot over the steepness: so the tangent turns with that uncertainty. The steepness
is the change of the scaled unknowns for a unit of arclength."""

CONDITION_NOISE = 5e-17
"""Noise of the slope, as a part of the energy, times the square of the conditioning over the steepness, at most."""

_CLEAR_SLOPE = 0.05
"""Part of the energy up to which the noise of a slope does not count here: it is measured where a zero is (`continuation.events`)."""


def is_orbit(result: Any) -> bool:
    """Whether the result entries are those of an accurate orbit of which everything could be found out."""
    return result[CONVERGED] == 1.0 and result[RESIDUAL] < _ACCURATE and not result[GAVE_UP] == 1.0


def common_tests(result: Any, low: Any, high: Any, longest: Any, out: Any) -> None:
    """The first `COMMON` entries of `out`: fold, branch point, grazing in its three ways, the bounds of the energy's logarithm (low, high)
    and of the quarter period's, impulsive orbits, and the key that stands for the label."""
    level = math.log(result[ENERGY])
    pivot = result[BRANCHING]
    slope = abs(result[SLOPE])
    square = result[CONDITIONING] * result[CONDITIONING]
    doubt = CONDITION_NOISE * result[STEEPNESS]
    certain = slope * pivot * pivot > TANGENT_NOISE * result[STEEPNESS]
    certain = certain and (doubt < _CLEAR_SLOPE * square or slope * square > doubt * result[ENERGY])
    out[0] = result[SLOPE] if certain else math.nan
    out[1] = pivot
    out[2] = result[CLEARANCE] if result[CLEARANCE] < _CLEAR else _CLEAR
    out[3] = result[SPEED]
    out[4] = result[FLIGHT]
    out[5] = level - low if low > -math.inf else 1.0
    out[6] = high - level if high < math.inf else 1.0
    out[7] = longest - math.log(result[QUARTER_PERIOD]) if longest < math.inf else 1.0
    out[8] = result[ABSORBER_START]
    out[9] = result[ABSORBER_END]
    waves = result[WAVES_ABSORBER] * 4096.0 + result[WAVES_PRIMARY]
    out[10] = (waves * 4096.0 + result[FIRST_QUARTER]) * 8192.0 + result[SECOND_QUARTER] * 4.0 + result[IN_PHASE]


def two_dof_tests(result: Any, quarters: Any, targets: Any, out: Any) -> None:
    """The entries of `out` after the common ones, n = 2: the entries of the half map (`bvp.kernels.stability`), each bifurcation a plain
    zero of one, then the distances from the `targets` of a trace: of a quarter that of the half map (tau_half), else that of the full
    period (tau). `quarters`: quarter periods solved.

    The linearised impacts are rank-one terms over the impact's speed, so an entry times the product of all speeds is smooth at a grazing,
    where the entry itself grows without bound. Traces contain each impact of a segment with a reversal twice."""
    a = result[HALF_A]
    b = result[HALF_B]
    c = result[HALF_C]
    d = result[HALF_D]
    product = b * c
    largest = abs(a)
    for entry in (b, c, d):
        if abs(entry) > largest:
            largest = abs(entry)
    pivot = abs(result[BRANCHING])
    noise = largest * (NOISE + PIVOT_NOISE / pivot) if pivot > 0.0 else math.inf
    if abs(a) < noise:
        a = math.nan
    if abs(b) < noise:
        b = math.nan
    if abs(d) < noise:
        d = math.nan
    speeds = result[SPEEDS]
    if quarters == 4:
        tau = result[TRACE]
        weight = speeds
        out[11] = weight * (tau + 2.0)
        at = 12
    else:
        tau = 2.0 + 4.0 * product
        weight = speeds * speeds
        out[11] = speeds * b
        out[12] = speeds * a
        out[13] = speeds * d
        at = 14
        if quarters == 1:
            out[14] = weight * tau
            at = 15
    for i in range(len(targets)):
        out[at + i] = weight * (tau - targets[i])
