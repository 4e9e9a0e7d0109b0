"""The modes of an undamped system whose masses or springs change, and what free flights of a multipoint problem take from them.

The method is that of `bvp.modes.undamped_modes`, which takes matrices of any size to LAPACK: for a few coordinates it is all overhead.
"""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import kernel
from bvp.kernels.flight import copy_1, inner, times_matrix

EPSILON = 2.220446049250313e-16
SMALLEST, LARGEST = 1e-25, 1e25
"""Sizes of masses, and of all entries, that can be computed with: as in `bvp.checks`, which the machine code does not depend on."""

SWEEPS = 60
"""Most sweeps of Jacobi's method; ten are many."""

SUBNORMAL = 2.2250738585072014e-308 / EPSILON
"""A square below this has no digits left in products with it; a motion in a period of 1e145 is uniform."""


class ModeWork(NamedTuple):
    """The modes of a system with n coordinates, and scratch."""

    squares: np.ndarray  # (n,) squared frequencies, ascending
    shapes: np.ndarray  # (n, n) columns with Phi' M Phi = 1
    scale: np.ndarray  # (n,) what makes the diagonal of the mass 1
    lower: np.ndarray  # (n, n) the triangular factor of the scaled mass
    gram: np.ndarray  # (n, n) Phi' M Phi
    energy: np.ndarray  # (n, n) Phi' K Phi
    half: np.ndarray  # (n, n)
    correction: np.ndarray  # (n, n)
    mass_terms: np.ndarray  # (n, n) sizes of the terms of `gram`
    stiffness_terms: np.ndarray  # (n, n) and of `energy`
    moduli: np.ndarray  # (2, n, n)


def make_mode_work(n):
    """Arrays for systems with n coordinates."""
    lower, gram, energy, half, correction, mass_terms, stiffness_terms = np.zeros((7, n, n))
    return ModeWork(
        np.zeros(n), np.zeros((n, n)), np.zeros(n), lower, gram, energy, half, correction, mass_terms, stiffness_terms, np.zeros((2, n, n))
    )


class Renewal(NamedTuple):
    """The modes at changed masses and springs, and scratch."""

    places: np.ndarray  # (2,) int64: where the mass and the stiffness begin among the entries
    mass: np.ndarray  # (n, n)
    stiffness: np.ndarray  # (n, n)
    slopes: np.ndarray  # (2, n, n) Phi' M_p Phi and Phi' K_p Phi of a parameter p
    along: np.ndarray  # (n,) M^-1 c of a gap row c
    turned: np.ndarray  # (n,) its derivative
    modes: ModeWork


def make_renewal(n, mass, stiffness):
    """Arrays for a system with n coordinates. mass, stiffness: where these begin among the entries."""
    places, square = np.array([mass, stiffness], dtype=np.int64), (n, n)
    return Renewal(places, np.zeros(square), np.zeros(square), np.zeros((2, *square)), np.zeros(n), np.zeros(n), make_mode_work(n))


@kernel
def cholesky(matrix, scale, lower):
    """The triangular factor of diag(scale) matrix diag(scale), (n, n). Returns the smallest square of its diagonal; not above 0: none."""
    n = matrix.shape[0]
    least = math.inf
    for i in range(n):
        for j in range(i + 1):
            total = scale[i] * matrix[i, j] * scale[j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                least = min(least, total)
                if not least > 0.0:
                    return 0.0
                lower[i, i] = math.sqrt(total)
            else:
                lower[i, j] = total / lower[j, j]
                lower[j, i] = 0.0
    return least


@kernel
def solve_lower(lower, column):
    """Solve with the triangular factor, in place."""
    for i in range(lower.shape[0]):
        total = column[i]
        for k in range(i):
            total -= lower[i, k] * column[k]
        column[i] = total / lower[i, i]


@kernel
def solve_upper(lower, column):
    """Solve with the transposed factor, in place."""
    n = lower.shape[0]
    for i in range(n - 1, -1, -1):
        total = column[i]
        for k in range(i + 1, n):
            total -= lower[k, i] * column[k]
        column[i] = total / lower[i, i]


@kernel
def diagonalise(matrix, vectors):
    """Cyclic Jacobi rotations: the matrix (n, n), symmetric, gets its eigenvalues on its diagonal, and `vectors` its eigenvectors as
    columns. Returns whether the sweeps converge.

    An entry is left alone where it is below the rounding of the geometric mean of its two diagonal entries, so that graded matrices keep
    the relative accuracy of their small eigenvalues.
    """
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        quiet = True
        for i in range(n - 1):
            for j in range(i + 1, n):
                coupling = matrix[i, j]
                level = 0.5 * EPSILON * math.sqrt(abs(matrix[i, i])) * math.sqrt(abs(matrix[j, j]))
                if not abs(coupling) > max(level, SUBNORMAL * EPSILON):
                    continue
                quiet = False
                theta = (matrix[j, j] - matrix[i, i]) / 2.0 / coupling
                tangent = 1.0 / (abs(theta) + math.hypot(1.0, theta))
                tangent = -tangent if theta < 0.0 else tangent
                cosine = 1.0 / math.hypot(1.0, tangent)
                sine = tangent * cosine
                low, high = matrix[i, i] - tangent * coupling, matrix[j, j] + tangent * coupling
                for k in range(n):
                    first, second = matrix[i, k], matrix[j, k]
                    matrix[i, k] = cosine * first - sine * second
                    matrix[j, k] = sine * first + cosine * second
                    first, second = vectors[k, i], vectors[k, j]
                    vectors[k, i] = cosine * first - sine * second
                    vectors[k, j] = sine * first + cosine * second
                for k in range(n):
                    matrix[k, i] = matrix[i, k]
                    matrix[k, j] = matrix[j, k]
                matrix[i, i], matrix[j, j], matrix[i, j], matrix[j, i] = low, high, 0.0, 0.0
        if quiet:
            return True
    return False


@kernel
def matrix_product(first, second, out):
    """out = first second, (n, n)."""
    n = first.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += first[i, k] * second[k, j]
            out[i, j] = total


@kernel
def congruence(matrix, shapes, half, out):
    """out = shapes' matrix shapes, (n, n). half: matrix shapes."""
    matrix_product(matrix, shapes, half)
    matrix_product(shapes.T, half, out)


@kernel
def sizes_of_terms(matrix, shapes, moduli, half, out):
    """The same of the moduli of all entries: the sizes of the terms of a congruence."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            moduli[0, i, j] = abs(matrix[i, j])
            moduli[1, i, j] = abs(shapes[i, j])
    congruence(moduli[0], moduli[1], half, out)


@kernel
def refine_shapes(mass, stiffness, work):
    """One step of Ogita and Aishima's refinement. Where a coupling is rounding, only orthogonality is restored."""
    n = mass.shape[0]
    squares, shapes, half, correction = work.squares, work.shapes, work.half, work.correction
    congruence(mass, shapes, half, work.gram)
    congruence(stiffness, shapes, half, work.energy)
    sizes_of_terms(mass, shapes, work.moduli, half, work.mass_terms)
    sizes_of_terms(stiffness, shapes, work.moduli, half, work.stiffness_terms)
    for k in range(n):
        squares[k] = work.energy[k, k] / work.gram[k, k]
    for i in range(n):
        for j in range(n):
            defect = (1.0 if i == j else 0.0) - work.gram[i, j]
            coupling = work.energy[i, j] + squares[j] * defect
            gap = squares[j] - squares[i]
            noise = work.stiffness_terms[i, j] + abs(squares[j]) * work.mass_terms[i, j]
            is_real = 4.0 * n * EPSILON * noise < abs(coupling) < 1e-3 * abs(gap)
            correction[i, j] = coupling / gap if is_real else 0.5 * defect
    matrix_product(shapes, correction, half)
    for i in range(n):
        for j in range(n):
            shapes[i, j] += half[i, j]


@kernel
def modes_of_matrices(mass, stiffness, work):
    """Fill the squared frequencies and the shapes of K phi = w^2 M phi, and the factor of the mass, into a `ModeWork`.

    Returns the smallest squared pivot of that factor: not above 0 where the mass is not positive definite, or Jacobi's method does not
    converge."""
    n = mass.shape[0]
    scale, lower, reduced, vectors = work.scale, work.lower, work.gram, work.energy
    for i in range(n):
        if not mass[i, i] > 0.0:
            return 0.0
        scale[i] = 1.0 / math.sqrt(mass[i, i])
    least = cholesky(mass, scale, lower)
    if not least > 0.0:
        return 0.0
    for i in range(n):
        for j in range(n):
            reduced[i, j] = scale[i] * stiffness[i, j] * scale[j]
    for j in range(n):
        solve_lower(lower, reduced[:, j])
    for i in range(n):
        solve_lower(lower, reduced[i])
    for i in range(n):
        for j in range(i):
            reduced[i, j] = reduced[j, i] = 0.5 * (reduced[i, j] + reduced[j, i])
    if not diagonalise(reduced, vectors):
        return 0.0
    for j in range(n):
        solve_upper(lower, vectors[:, j])
    for i in range(n):
        for j in range(n):
            work.shapes[i, j] = scale[i] * vectors[i, j]
    refine_shapes(mass, stiffness, work)
    refine_shapes(mass, stiffness, work)
    finish_modes(mass, stiffness, work)
    return least


@kernel
def finish_modes(mass, stiffness, work):
    """Give the shapes their length and sign, and bring the modes in order. A square below its rounding is 0."""
    n = mass.shape[0]
    squares, shapes = work.squares, work.shapes
    congruence(mass, shapes, work.half, work.gram)
    for k in range(n):
        size = math.sqrt(work.gram[k, k])
        for i in range(n):
            shapes[i, k] /= size
    congruence(stiffness, shapes, work.half, work.energy)
    sizes_of_terms(stiffness, shapes, work.moduli, work.half, work.stiffness_terms)
    for k in range(n):
        square = work.energy[k, k]
        rounding = 4.0 * n * EPSILON * work.stiffness_terms[k, k]
        squares[k] = square if abs(square) > max(rounding, SUBNORMAL) else 0.0
    for k in range(n):
        most_weight, most_size = 0.0, 0.0
        for i in range(n):
            most_weight = max(most_weight, abs(shapes[i, k]) * math.sqrt(mass[i, i]))
            most_size = max(most_size, abs(shapes[i, k]))
        leading = n
        for i in range(n):
            size = abs(shapes[i, k])
            weight = size * math.sqrt(mass[i, i])
            # A free translation can cover any distance: rounding would move bodies that do not take part in it.
            if squares[k] == 0.0 and weight <= 8.0 * n * EPSILON * most_weight and size <= math.sqrt(EPSILON) * most_size:
                shapes[i, k] = 0.0
            if leading == n and weight >= (1.0 - 1e-6) * most_weight:
                leading = i
        if shapes[leading, k] < 0.0:
            for i in range(n):
                shapes[i, k] = -shapes[i, k]
    for k in range(1, n):  # equal ones keep their order
        for m in range(k, 0, -1):
            if not squares[m] < squares[m - 1]:
                break
            squares[m], squares[m - 1] = squares[m - 1], squares[m]
            for i in range(n):
                shapes[i, m], shapes[i, m - 1] = shapes[i, m - 1], shapes[i, m]


@kernel
def solve_mass(modes, column):
    """Solve M x = column in place, with the factor of the scaled mass in a `ModeWork`."""
    for i in range(len(column)):
        column[i] *= modes.scale[i]
    solve_lower(modes.lower, column)
    solve_upper(modes.lower, column)
    for i in range(len(column)):
        column[i] *= modes.scale[i]


@kernel
def impulse(modes, gap, along):
    """along = M^-1 gap. Returns gap . along."""
    copy_1(gap, along)
    solve_mass(modes, along)
    return inner(gap, along)


@kernel
def symmetrise(matrix):
    """Make a matrix exactly symmetric. Returns whether it was, to a few roundings, with numbers of sizes that can be computed with."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i + 1):
            first, second = matrix[i, j], matrix[j, i]
            if not (abs(first) <= LARGEST and abs(second) <= LARGEST):
                return False
            if abs(first - second) > 8.0 * EPSILON * max(abs(first), abs(second)):
                return False
            matrix[i, j] = matrix[j, i] = 0.5 * (first + second)
    return True


@kernel
def renew_free_flight(segment, work):
    """Compute what flights and impacts of an undamped system without sticking take from its masses and springs, and the derivatives, at
    the entries that a segment has (`bvp.kernels.forced.LoadedSegment`). work: `Renewal`. Returns whether the system can have these entries.

    The derivatives are those of `bvp.forced_modes.mode_slopes`, without damping: with Phi' M Phi = 1 and K Phi = M Phi W, the rates of
    modal velocities have Phi' M_p Phi W - Phi' K_p Phi.
    """
    flight, entries = segment.flight, segment.released.entries
    modes, mass, stiffness = work.modes, work.mass, work.stiffness
    n = mass.shape[0]
    squares, shapes, half = modes.squares, modes.shapes, modes.half
    for i in range(n):
        for j in range(n):
            mass[i, j] = entries[work.places[0] + i * n + j]
            stiffness[i, j] = entries[work.places[1] + i * n + j]
        if not mass[i, i] >= SMALLEST:
            return False
    if not (symmetrise(mass) and symmetrise(stiffness)):
        return False
    if not modes_of_matrices(mass, stiffness, modes) > 4.0 * n * EPSILON:
        return False
    free = flight.free
    matrix_product(shapes.T, mass, half)
    for i in range(n):
        free.delta[i] = 0.0 - squares[i]
        free.matrix[n + i, i] = 0.0 - squares[i]
        for j in range(n):
            flight.enter[i, j] = flight.enter[n + i, n + j] = half[i, j]
            flight.leave[i, j] = flight.leave[n + i, n + j] = shapes[i, j]
            segment.drive[n + i, j] = shapes[j, i]
    for i in range(n, free.delta.shape[0]):  # the last block stands several times
        free.delta[i] = free.delta[n - 1]
    for row in range(segment.gap.shape[0]):
        reach = impulse(modes, segment.gap[row, :n], work.along)
        for i in range(n):
            segment.push[row, n + i] = work.along[i] / reach if reach > 0.0 else 0.0
    for p in range(segment.push_slope.shape[0]):
        renew_slopes(segment, work, p)
    return True


@kernel
def renew_slopes(segment, work, p):
    """The derivatives by a released parameter, for `renew_free_flight`."""
    modes, along, turned = work.modes, work.along, work.turned
    n = len(along)
    of_mass, of_stiffness, slope = work.slopes[0], work.slopes[1], modes.correction
    for part in range(2):
        for i in range(n):
            for j in range(n):
                slope[i, j] = segment.released.slopes[p, work.places[part] + i * n + j]
        congruence(slope, modes.shapes, modes.half, work.slopes[part])
    matrix_product(of_mass, modes.shapes.T, modes.half)
    for i in range(n):
        for j in range(n):
            segment.flight.change[p, n + i, j] = of_mass[i, j] * modes.squares[j] - of_stiffness[i, j]
            segment.drive_slope[p, n + i, j] = -modes.half[i, j]
            slope[i, j] = -segment.released.slopes[p, work.places[0] + i * n + j]
    for row in range(segment.gap.shape[0]):
        reach = impulse(modes, segment.gap[row, :n], along)
        if reach > 0.0:
            times_matrix(slope, along, turned)
            solve_mass(modes, turned)
            change = inner(segment.gap[row, :n], turned)
            for i in range(n):
                segment.push_slope[p, row, n + i] = (turned[i] - along[i] * change / reach) / reach
