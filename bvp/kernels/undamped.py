"""The modes of an undamped system whose masses or springs change, and what free flights of a multipoint problem take from them.

The method is that of `bvp.modes.undamped_modes`, which takes matrices of any size to LAPACK: for a few coordinates it is all overhead.
"""

import math

from bvp.kernels.compiled import kernel

EPSILON = 2.220446049250313e-16
SMALLEST, LARGEST = 1e-25, 1e25
"""Sizes of masses, and of all entries, that can be computed with: as in `bvp.checks`, which the machine code does not depend on."""

SWEEPS = 60
"""Most sweeps of Jacobi's method; ten are many."""

SUBNORMAL = 2.2250738585072014e-308 / EPSILON
"""A square below this has no digits left in products with it; a motion in a period of 1e145 is uniform."""

WORK = 8
"""Matrices (n, n) of scratch."""


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
def congruence(matrix, shapes, half, out):
    """out = shapes' matrix shapes, (n, n). half: matrix shapes."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += matrix[i, k] * shapes[k, j]
            half[i, j] = total
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += shapes[k, i] * half[k, j]
            out[i, j] = total


@kernel
def sizes_of_terms(matrix, shapes, half, out):
    """The same of the moduli of all entries: the sizes of the terms of a congruence."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += abs(matrix[i, k]) * abs(shapes[k, j])
            half[i, j] = total
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += abs(shapes[k, i]) * half[k, j]
            out[i, j] = total


@kernel
def refine_shapes(mass, stiffness, squares, shapes, work):
    """One step of Ogita and Aishima's refinement. Where a coupling is rounding, only orthogonality is restored."""
    n = mass.shape[0]
    gram, energy, half, correction, of_mass, of_stiffness = work[0], work[1], work[2], work[3], work[6], work[7]
    congruence(mass, shapes, half, gram)
    congruence(stiffness, shapes, half, energy)
    sizes_of_terms(mass, shapes, half, of_mass)
    sizes_of_terms(stiffness, shapes, half, of_stiffness)
    for k in range(n):
        squares[k] = energy[k, k] / gram[k, k]
    for i in range(n):
        for j in range(n):
            defect = (1.0 if i == j else 0.0) - gram[i, j]
            coupling = energy[i, j] + squares[j] * defect
            gap = squares[j] - squares[i]
            correction[i, j] = 0.5 * defect
            if abs(coupling) < 1e-3 * abs(gap):
                noise = of_stiffness[i, j] + abs(squares[j]) * of_mass[i, j]
                if abs(coupling) > 4.0 * n * EPSILON * noise:
                    correction[i, j] = coupling / gap
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += shapes[i, k] * correction[k, j]
            half[i, j] = shapes[i, j] + total
    for i in range(n):
        for j in range(n):
            shapes[i, j] = half[i, j]


@kernel
def undamped_modes(mass, stiffness, squares, shapes, work):
    """The squared frequencies (n,), ascending, and the shapes of K phi = w^2 M phi, the columns of (n, n): see `bvp.modes.undamped_modes`.

    work (WORK, n, n): scratch. Matrix 5 gets the triangular factor of the mass, scaled to a unit diagonal, and the first row of matrix 4
    the scale. Returns the smallest squared pivot: not above 0 where the mass is not positive definite, or Jacobi's method does not
    converge.
    """
    n = mass.shape[0]
    scale, reduced, vectors, lower = work[4, 0], work[0], work[1], work[5]
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
            shapes[i, j] = scale[i] * vectors[i, j]
    refine_shapes(mass, stiffness, squares, shapes, work)
    refine_shapes(mass, stiffness, squares, shapes, work)
    finish_modes(mass, stiffness, squares, shapes, work)
    return least


@kernel
def finish_modes(mass, stiffness, squares, shapes, work):
    """Give the shapes their length and sign, and bring the modes in order. A square below its rounding is 0."""
    n = mass.shape[0]
    half, energy, of_stiffness = work[2], work[1], work[7]
    congruence(mass, shapes, half, energy)
    for k in range(n):
        size = math.sqrt(energy[k, k])
        for i in range(n):
            shapes[i, k] /= size
    congruence(stiffness, shapes, half, energy)
    sizes_of_terms(stiffness, shapes, half, of_stiffness)
    for k in range(n):
        square = energy[k, k]
        rounding = 4.0 * n * EPSILON * of_stiffness[k, k]
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
def solve_mass(lower, scale, column):
    """Solve M x = column in place, with the triangular factor of the scaled mass."""
    for i in range(len(column)):
        column[i] *= scale[i]
    solve_lower(lower, column)
    solve_upper(lower, column)
    for i in range(len(column)):
        column[i] *= scale[i]


@kernel
def impulse(lower, scale, gap, along):
    """along = M^-1 gap. Returns gap . along."""
    for i in range(len(along)):
        along[i] = gap[i]
    solve_mass(lower, scale, along)
    total = 0.0
    for i in range(len(along)):
        total += gap[i] * along[i]
    return total


@kernel
def renew_free_flight(segment, places, matrices, vectors, work):
    """Compute what flights and impacts of an undamped system without sticking take from its masses and springs, and the derivatives, at
    the entries that a segment has (`bvp.kernels.forced.LoadedSegment`).

    places (2,) int64: where the mass and the stiffness begin among the entries. matrices (4, n, n), vectors (3, n),
    work (WORK, n, n): scratch. Returns whether the system can have these entries.

    The derivatives are those of `bvp.forced_modes.mode_slopes`, without damping: with Phi' M Phi = 1 and K Phi = M Phi W, the rates of
    modal velocities have Phi' M_p Phi W - Phi' K_p Phi.
    """
    flight, released = segment.flight, segment.released
    size = flight.enter.shape[0]
    n = size // 2
    mass, stiffness, shapes, rates = matrices[0], matrices[1], matrices[2], matrices[3]
    squares, along, turned, scale, lower = vectors[0], vectors[1], vectors[2], work[4, 0], work[5]
    for i in range(n):
        for j in range(n):
            mass[i, j] = released.entries[places[0] + i * n + j]
            stiffness[i, j] = released.entries[places[1] + i * n + j]
        if not mass[i, i] >= SMALLEST:
            return False
    if not (symmetrise(mass) and symmetrise(stiffness)):
        return False
    if not undamped_modes(mass, stiffness, squares, shapes, work) > 4.0 * n * EPSILON:
        return False
    blocks = flight.free
    for i in range(n):
        blocks.delta[i] = 0.0 - squares[i]
        blocks.matrix[n + i, i] = 0.0 - squares[i]
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += shapes[k, i] * mass[k, j]
            flight.enter[i, j] = flight.enter[n + i, n + j] = total
            flight.leave[i, j] = flight.leave[n + i, n + j] = shapes[i, j]
            segment.drive[n + i, j] = shapes[j, i]
    for i in range(n, blocks.delta.shape[0]):  # the last block stands several times
        blocks.delta[i] = blocks.delta[n - 1]
    for row in range(segment.gap.shape[0]):
        reach = impulse(lower, scale, segment.gap[row, :n], along)
        for i in range(n):
            segment.push[row, n + i] = along[i] / reach if reach > 0.0 else 0.0
    for p in range(segment.push_slope.shape[0]):
        slopes = released.slopes[p]
        for part in range(2):
            for i in range(n):
                for j in range(n):
                    rates[i, j] = slopes[places[part] + i * n + j]
            congruence(rates, shapes, work[0], work[1 + part])
        for i in range(n):
            for j in range(n):
                flight.change[p, n + i, j] = work[1, i, j] * squares[j] - work[2, i, j]
                total = 0.0
                for k in range(n):
                    total += work[1, i, k] * shapes[j, k]
                segment.drive_slope[p, n + i, j] = -total
        for row in range(segment.gap.shape[0]):
            reach = impulse(lower, scale, segment.gap[row, :n], along)
            if not reach > 0.0:
                continue
            for i in range(n):
                total = 0.0
                for j in range(n):
                    total -= slopes[places[0] + i * n + j] * along[j]
                turned[i] = total
            solve_mass(lower, scale, turned)
            total = 0.0
            for i in range(n):
                total += segment.gap[row, i] * turned[i]
            for i in range(n):
                segment.push_slope[p, row, n + i] = (turned[i] - along[i] * total / reach) / reach
    return True
