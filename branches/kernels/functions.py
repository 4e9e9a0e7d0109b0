"""The test functions of families of orbits.

Those for two degrees of freedom between two ends are pure functions of the results for an orbit: `branches.kernels.blocks` compiles what
`branches.family` calls from Python. The others are kernels of their own, `general_tests` and `periodic_tests`, which both call.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from bvp.kernels import multipoint as entry
from bvp.kernels.compiled import inlined, kernel, square
from bvp.kernels.cuts import is_cut
from bvp.kernels.dense import determinant, eigenvalues, is_regular
from bvp.kernels.flight import copy_1, set_1
from bvp.kernels.monodromy import (
    LOST,
    ClosedOrbit,
    EigenvalueWork,
    LinearisedOrbit,
    Reduction,
    formed_multipliers,
    make_eigenvalue_work,
    make_linearised_orbit,
    make_reduction,
)  # fmt: skip
from bvp.kernels.multipoint import ImpactList, unfold_impacts, unpack
from bvp.kernels.pencil import ContactRows
from bvp.kernels.periodic_qr import product_eigenvalues
from bvp.kernels.stability import HalfMap, half_map, make_half_map, make_impacts

__all__ = [
    "COMMON", "CONDITION_NOISE", "NOISE", "PIVOT_NOISE", "SMOOTH_TANGENT_NOISE", "TANGENT_NOISE", "PairsWork",
    "common_tests", "general_tests", "is_orbit", "make_pairs_work", "periodic_tests", "two_dof_tests",
]  # fmt: skip

COMMON = 11
"""Test functions that every family has, whatever its degrees of freedom."""

_ACCURATE = 1e-12
"""Scaled residual below which a solution is an orbit."""

_CLEAR = 1e3
"""Larger clearances are replaced by this value."""

_MIRRORED = 1e-9
"""Part of the largest coordinate up to which two states are mirror images of each other."""

NOISE = 2e-13
"""Part of the half map's largest entry below which an entry is rounding: a conserved momentum makes one vanish all along a family, and
its noise is no event."""

PIVOT_NOISE = 5e-14
"""Noise of the half map's entries, as a part of the largest one, times the smallest pivot: near a branch point an orbit is uncertain by
rounding over the pivot, in the direction of the other family."""

TANGENT_NOISE = 2e-13
"""Noise of the slope, as a part of the energy, times the square of the smallest pivot over the steepness: the direction of the tangent is
uncertain by as much. The steepness is the change of the scaled unknowns for a unit of arclength."""

SMOOTH_TANGENT_NOISE = 6e-14
"""The same for smooth flights. Long sequences of impacts, which magnify rounding, are rare among them. Measured: 2e-16 as a rule, at most
2.4e-14, beside a branch point of closed orbits."""

CONDITION_NOISE = 5e-17
"""Noise of the slope, as a part of the energy, times the square of the conditioning over the steepness, at most."""

_CLEAR_SLOPE = 0.05
"""Part of the energy up to which the noise of a slope does not count here: it is measured where a zero is (`continuation.events`)."""


_RESOLVED = 1e-3
"""Noise of the entries of 4 b'c up to which its eigenvalues between -4 and 0 are told apart."""


def is_orbit(result: Any) -> bool:
    """Whether the step converged accurately and no search of its observation gave up."""
    return result[entry.CONVERGED] == 1.0 and result[entry.RESIDUAL] < _ACCURATE and not result[entry.GAVE_UP] == 1.0


def common_tests(result: Any, low: Any, high: Any, longest: Any, tangent_noise: Any, out: Any) -> None:
    """The first `COMMON` entries of `out`: fold, branch point, grazing in its three ways, the bounds of the energy's logarithm (low, high)
    and of the quarter period's, impulsive orbits, and a number that identifies the label. tangent_noise: see `TANGENT_NOISE`."""
    level = math.log(result[entry.ENERGY])
    pivot = result[entry.BRANCHING]
    slope = abs(result[entry.SLOPE])
    square = result[entry.CONDITIONING] * result[entry.CONDITIONING]
    unit = result[entry.STEEPNESS] * result[entry.ENERGY]
    error = CONDITION_NOISE * unit
    certain = slope * pivot * pivot > tangent_noise * unit
    certain = certain and (error < _CLEAR_SLOPE * result[entry.ENERGY] * square or slope * square > error)
    out[0] = result[entry.SLOPE] if certain else math.nan
    out[1] = pivot
    out[2] = result[entry.CLEARANCE] if result[entry.CLEARANCE] < _CLEAR else _CLEAR
    out[3] = result[entry.SPEED]
    out[4] = result[entry.FLIGHT]
    out[5] = level - low if low > -math.inf else 1.0
    out[6] = high - level if high < math.inf else 1.0
    out[7] = longest - math.log(result[entry.QUARTER_PERIOD]) if longest < math.inf else 1.0
    out[8] = result[entry.ABSORBER_START]
    out[9] = result[entry.ABSORBER_END]
    waves = result[entry.WAVES_ABSORBER] * 4096.0 + result[entry.WAVES_PRIMARY]
    out[10] = (waves * 4096.0 + result[entry.FIRST_QUARTER]) * 8192.0 + result[entry.SECOND_QUARTER] * 4.0 + result[entry.IN_PHASE]


def two_dof_tests(result: Any, shape: Any, targets: Any, out: Any) -> None:
    """The entries of `out` after the common ones between two ends, n = 2: the entries of the half map (`bvp.kernels.stability`), each
    bifurcation a plain zero of one, then the distances from the `targets` of a trace: of a quarter that of the half map (tau_half), else
    that of the full period (tau). shape: of the segment.

    The linearised impacts are rank-one terms over the impact's speed, so an entry times the product of all speeds is smooth at a grazing,
    where the entry itself grows without bound. Traces contain each impact of a segment with a reversal twice."""
    a = result[entry.HALF_A]
    b = result[entry.HALF_B]
    c = result[entry.HALF_C]
    d = result[entry.HALF_D]
    product = b * c
    # In the arclength's unit of time all are displacements. The origin keeps a velocity, any other end a displacement.
    first, far = min(shape[3], 1), min(shape[4], 1)
    of_a, of_b = 2.0 ** (shape[5] * (far - first)), 2.0 ** (shape[5] * (first + far - 1))
    largest = max(abs(a) * of_a, abs(b) * of_b, abs(c) / of_b, abs(d) / of_a)
    pivot = abs(result[entry.BRANCHING])
    noise = largest * (NOISE + PIVOT_NOISE / pivot) if pivot > 0.0 else math.inf
    if abs(a) * of_a < noise:
        a = math.nan
    if abs(b) * of_b < noise:
        b = math.nan
    if abs(d) / of_a < noise:
        d = math.nan
    speeds = result[entry.SPEEDS]
    tau = 2.0 + 4.0 * product
    weight = speeds * speeds
    out[11] = speeds * b
    out[12] = speeds * a
    out[13] = speeds * d
    at = 14
    if shape[2] == 1:
        out[14] = weight * tau
        at = 15
    for i in range(len(targets)):
        out[at + i] = weight * (tau - targets[i])


@kernel
def _certain_determinant(matrix, noise, inverse):
    """Determinant of a square matrix, which is overwritten; nan where its smallest singular value is not above the noise."""
    total = 0.0
    for r in range(matrix.shape[0]):
        for c in range(matrix.shape[0]):
            total += matrix[r, c] * matrix[r, c]
    value = determinant(matrix)
    return value if is_regular(matrix, value, total, noise, inverse) else math.nan


@inlined
def _block(phi, row, column, out):
    """One of the four blocks of a half map; returns its largest entry."""
    m = out.shape[0]
    largest = 0.0
    for r in range(m):
        for c in range(m):
            out[r, c] = phi[row * m + r, column * m + c]
            largest = max(largest, abs(out[r, c]))
    return largest


@kernel
def _shifted_determinant(work, unit, shift, product_noise, noise):
    """Determinant of 4 b'c + shift; nan where it is not certain.

    Where rounding of the formed product b'c can be seen, it is 4^m times that of [[shift/4, -b'/unit], [unit c, 1]], in which b and c are
    not multiplied. product_noise, noise: those of the entries of both."""
    m = work.product.shape[0]
    out = square(work.block, m)
    for r in range(m):
        for c in range(m):
            out[r, c] = 4.0 * work.product[r, c] + (shift if r == c else 0.0)
    value = _certain_determinant(out, product_noise, square(work.inverse, m))
    if value == value:
        return value
    out = square(work.block, 2 * m)
    for r in range(m):
        for c in range(m):
            out[r, c] = 0.25 * shift if r == c else 0.0
            out[r, m + c] = -work.phi[c, m + r] / unit
            out[m + r, c] = work.phi[m + r, c] * unit
            out[m + r, m + c] = 1.0 if r == c else 0.0
    return 4.0**m * _certain_determinant(out, noise, square(work.inverse, 2 * m))


@inlined
def _find_eigenvalues(work, product_noise, noise):
    """The eigenvalues of b'c into work.values: of the formed product, or where its rounding can be seen of its two factors. Returns whether
    they are found."""
    m = work.product.shape[0]
    if product_noise < _RESOLVED:
        out = square(work.block, m)
        for r in range(m):
            copy_1(work.product[r], out[r])
        return eigenvalues(out, work.values[0], work.values[1])
    if not 4.0 * noise < _RESOLVED:
        return False
    for r in range(m):
        for c in range(m):
            work.factors[0, r, c] = work.phi[m + r, c]
            work.factors[1, r, c] = work.phi[c, m + r]
    return product_eigenvalues(work.factors, work.forward, work.corner, work.product, work.values) > 0


@inlined
def _discriminant(real, imaginary):
    """The second function of equation (35), which is real.

    It changes its sign where two of them meet and leave the real line. The denominators keep it at most 1 where all nu are real, also
    where one of them grows without bound at a grazing. Those of complex nu are conjugate, so their product is positive."""
    found = complex(1.0, 0.0)
    for i in range(real.shape[0]):
        for j in range(i):
            a = complex(real[i], imaginary[i])
            b = complex(real[j], imaginary[j])
            found *= (a - b) / (1.0 + a * a) * ((a - b) / (1.0 + b * b))
    return found.real


class PairsWork(NamedTuple):
    """Scratch of the test functions for any number of degrees of freedom."""

    half_map: HalfMap
    impacts: ImpactList
    reduction: Reduction
    linearised: LinearisedOrbit
    spectrum: EigenvalueWork


def make_pairs_work(problem):
    """Scratch for the orbits of a `MultipointProblem`."""
    nodes = problem.inner + 1 if problem.periodic else 0
    impacts, linearised = make_impacts(nodes, problem.size), make_linearised_orbit(nodes, problem.size, problem.segment.flight)
    reduction = make_reduction(problem.free, problem.segment.weights, True)
    return PairsWork(make_half_map(problem.held), impacts, reduction, linearised, make_eigenvalue_work(2 * problem.pairs))


@kernel
def general_tests(packed, y, ends, pairs_work, result, targets, out):
    """The entries of `out` after the common ones between two ends, any number of degrees of freedom: those of `two_dof_tests` with
    determinants of the blocks of the half map in place of its entries, and before the distances from the `targets` the discriminant of b'c.

    Equation (35). The pairs of multipliers have the traces 2 + 4 nu with the eigenvalues nu of b'c, so det(4 b'c + 2 - target) is the
    product of their distances from a target over all pairs: its zeros need no pair to be followed. A determinant is affine in each
    linearised impact, a rank-one term over the impact's speed, so it is smooth at a grazing times the product of the speeds, and times its
    square for b'c.

    A determinant is not defined where the smallest singular value is below the noise of the entries. pairs_work: `PairsWork`."""
    after = out[COMMON:]
    set_1(after, math.nan)
    quarters = packed.shape[2]
    work = pairs_work.half_map
    phi = work.phi
    m = work.product.shape[0]
    if m == 0:
        return
    half_map(unpack(packed), y, ends, work.held, work.rows, work.square, work.small, phi)
    for r in range(2 * m):
        for c in range(2 * m):
            if not abs(phi[r, c]) < math.inf:
                return
    first, far = min(packed.shape[3], 1), min(packed.shape[4], 1)
    of_a, of_b = 2.0 ** (packed.shape[5] * (far - first)), 2.0 ** (packed.shape[5] * (first + far - 1))
    block = square(work.block, m)
    inverse = square(work.inverse, m)
    size_b = _block(phi, 0, 1, block)
    size_c = _block(phi, 1, 0, block)
    largest = max(_block(phi, 0, 0, block) * of_a, size_b * of_b, size_c / of_b)
    largest = max(largest, _block(phi, 1, 1, block) / of_a)
    pivot = abs(result[entry.BRANCHING])
    noise = NOISE + PIVOT_NOISE / pivot if pivot > 0.0 else math.inf
    speeds = result[entry.SPEEDS]
    after[2] = speeds * _certain_determinant(block, noise * largest * of_a, inverse)
    _block(phi, 0, 0, block)
    after[1] = speeds * _certain_determinant(block, noise * largest / of_a, inverse)
    _block(phi, 0, 1, block)
    after[0] = speeds * _certain_determinant(block, noise * largest / of_b, inverse)
    for r in range(m):
        set_1(work.product[r], 0.0)
        for i in range(m):
            factor = phi[i, m + r]
            for c in range(m):
                work.product[r, c] += factor * phi[m + i, c]
    # The noise of the entries of 4 b'c, and that of b and c in a unit in which both are of one size.
    product_noise = noise * 4.0 * m * size_b * size_c
    noise *= math.sqrt(size_b * size_c)
    unit = math.sqrt(size_b / size_c) if size_b > 0.0 and size_c > 0.0 else 1.0
    at = 3
    if quarters == 1:
        after[3] = speeds * speeds * _shifted_determinant(work, unit, 2.0, product_noise, noise)
        at = 4
    for i in range(targets.shape[0]):
        after[at + 1 + i] = speeds * speeds * _shifted_determinant(work, unit, 2.0 - targets[i], product_noise, noise)
    if _find_eigenvalues(work, product_noise, noise):
        after[at] = _discriminant(work.values[0], work.values[1])


@kernel
def _nodes_of_a_half(states):
    """Half the number of nodes where each state is followed by its mirror image half a period later; else all of them."""
    count, rest = divmod(states.shape[0], 2)
    size = apart = 0.0
    for i in range(count):
        for r in range(states.shape[1]):
            size = max(size, abs(states[i, r]))
            apart = max(apart, abs(states[i, r] + states[count + i, r]))
    return count if rest == 0 and apart <= _MIRRORED * size else states.shape[0]


@kernel
def periodic_tests(packed, y, ends, work, result, targets, out):
    """The same for periodic closures: the products of 2 + trace and of trace - target over all pairs, and the discriminant between them.

    Each pair has the trace lambda + 1/lambda, a sum of two eigenvalues of the formed product, which is smooth where they meet at 1 or -1.
    Where half a period is followed by its mirror image, its map has the traces s, and 2 + trace = s^2 touches zero: s is in its place.
    Nothing is defined where rounding times the norm of that product can be seen beside several pairs. work: `PairsWork`."""
    after = out[COMMON:]
    set_1(after, math.nan)
    m = work.half_map.product.shape[0]
    if m == 0:
        return
    segment = unpack(packed)
    unfold_impacts(segment, y, ends, work.impacts, work.half_map.rows)
    for i in range(work.impacts.row.shape[0]):
        if is_cut(segment.flight, segment.side, work.impacts.row[i]):
            work.impacts.row[i] = -1
    contacts = ContactRows(segment.gap, segment.gap_rate, segment.push, segment.jump)
    nodes = _nodes_of_a_half(work.impacts.after)
    turned = nodes < work.impacts.row.shape[0]
    orbit = ClosedOrbit(work.impacts.before[:nodes], work.impacts.after[:nodes], work.impacts.duration[:nodes], work.impacts.row[:nodes])
    found, norm, _, _, _ = formed_multipliers(segment.flight, contacts, orbit, True, True, work.reduction, work.linearised, work.spectrum)
    pivot = abs(result[entry.BRANCHING])
    if found == LOST or ends.shape[1] > 4 and not (NOISE * pivot + PIVOT_NOISE) * norm < _RESOLVED * pivot:
        return
    real = work.spectrum.sums[0, :m]
    imaginary = work.spectrum.sums[1, :m]
    doubled = complex(result[entry.SPEEDS], 0.0)
    for j in range(m):
        trace = complex(real[j], imaginary[j])
        doubled *= trace if turned else trace + 2.0
        if turned:
            real[j], imaginary[j] = trace.real**2 - trace.imag**2 - 2.0, 2.0 * trace.real * trace.imag
    after[0] = doubled.real
    for i in range(targets.shape[0]):
        product = complex(result[entry.SPEEDS], 0.0)
        for j in range(m):
            product *= complex(real[j] - targets[i], imaginary[j])
        after[2 + i] = product.real
    for j in range(m):
        real[j] = 0.25 * (real[j] - 2.0)
        imaginary[j] = 0.25 * imaginary[j]
    after[1] = _discriminant(real, imaginary)
