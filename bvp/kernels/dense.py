"""Determinants and eigenvalues of small dense matrices, without arrays of their own.

Gaussian elimination with partial pivoting; Hessenberg form by elimination and Francis's double-shift QR iteration (Golub and Van Loan,
Matrix Computations, 4th ed. 2013, 3.4 and 7.5), after the matrix is balanced by powers of two (Parlett and Reinsch, Numer. Math. 13
(1969) 293).
"""

import math

from bvp.kernels.compiled import inlined, kernel

_EPSILON = 2.220446049250313e-16

_STEPS = 300
"""Most steps of the QR iteration for one eigenvalue, which takes two or three."""

_BALANCED = 0.95
"""A row and its column are scaled where this makes their sum smaller by this factor."""


@kernel
def _swap_rows(matrix, i, j):
    for c in range(matrix.shape[1]):
        x = matrix[i, c]
        matrix[i, c] = matrix[j, c]
        matrix[j, c] = x


@kernel
def determinant(matrix):
    """Determinant of a square matrix (m, m), which is replaced by its triangular factors: the lower one, with a unit diagonal, below."""
    size = matrix.shape[0]
    product = 1.0
    for k in range(size):
        pivot = k
        for r in range(k + 1, size):
            if abs(matrix[r, k]) > abs(matrix[pivot, k]):
                pivot = r
        if pivot != k:
            _swap_rows(matrix, k, pivot)
            product = -product
        product *= matrix[k, k]
        if matrix[k, k] == 0.0:
            continue
        for r in range(k + 1, size):
            factor = matrix[r, k] / matrix[k, k]
            matrix[r, k] = factor
            for c in range(k + 1, size):
                matrix[r, c] -= factor * matrix[k, c]
    return product


@kernel
def least_singular(factors, inverse):
    """Lower bound, sharp to a factor sqrt(m), of the smallest singular value of the matrix with the `factors` of `determinant`: 1 over the
    Frobenius norm of its inverse. inverse (m, m): scratch."""
    size = factors.shape[0]
    for k in range(size):
        if factors[k, k] == 0.0:
            return 0.0
    # Exchanged rows of a matrix exchange columns of its inverse, which leaves the norm. The loops run along rows.
    for r in range(size):
        for c in range(size):
            inverse[r, c] = 1.0 if r == c else 0.0
        for k in range(r):
            factor = factors[r, k]
            for c in range(size):
                inverse[r, c] -= factor * inverse[k, c]
    total = 0.0
    for r in range(size - 1, -1, -1):
        for k in range(r + 1, size):
            factor = factors[r, k]
            for c in range(size):
                inverse[r, c] -= factor * inverse[k, c]
        pivot = factors[r, r]
        for c in range(size):
            inverse[r, c] /= pivot
            total += inverse[r, c] * inverse[r, c]
    return 1.0 / math.sqrt(total)


@kernel
def is_regular(factors, value, square, level, inverse):
    """Whether the smallest singular value of a matrix is above a level, from its `factors` and its `value` by `determinant`, and the sum of
    the squares of its entries. inverse (m, m): scratch.

    |det| is the smallest one times the product of the others, whose mean of squares is at most square/(m - 1)."""
    others = factors.shape[0] - 1
    if abs(value) * (others / square) ** (0.5 * others) > level:
        return True
    return least_singular(factors, inverse) > level


@inlined
def _balance(matrix):
    """Scale by powers of two until the sums of each row and of its column are of like size. No rounding."""
    size = matrix.shape[0]
    done = False
    while not done:
        done = True
        for i in range(size):
            row = 0.0
            column = 0.0
            for j in range(size):
                if j != i:
                    row += abs(matrix[i, j])
                    column += abs(matrix[j, i])
            if row == 0.0 or column == 0.0 or not row + column < math.inf:
                continue
            if 0.51 * column < row < 1.96 * column:
                continue  # the factor is 1
            factor = 2.0 ** float(math.floor(0.5 * (math.log2(row) - math.log2(column)) + 0.5))
            if row / factor + column * factor < _BALANCED * (row + column):
                done = False
                for j in range(size):
                    matrix[i, j] /= factor
                for j in range(size):
                    matrix[j, i] *= factor


@inlined
def _hessenberg(matrix):
    """Similar matrix with zeros below the first subdiagonal, by elimination with partial pivoting."""
    size = matrix.shape[0]
    for k in range(1, size - 1):
        pivot = k
        for r in range(k + 1, size):
            if abs(matrix[r, k - 1]) > abs(matrix[pivot, k - 1]):
                pivot = r
        if matrix[pivot, k - 1] == 0.0:
            continue
        if pivot != k:
            _swap_rows(matrix, k, pivot)
            for r in range(size):
                x = matrix[r, k]
                matrix[r, k] = matrix[r, pivot]
                matrix[r, pivot] = x
        for r in range(k + 1, size):
            factor = matrix[r, k - 1] / matrix[k, k - 1]
            matrix[r, k - 1] = 0.0
            if factor != 0.0:
                for c in range(k, size):
                    matrix[r, c] -= factor * matrix[k, c]
                for c in range(size):
                    matrix[c, k] += factor * matrix[c, r]


@inlined
def _francis(matrix, low, high, trace, product):
    """A double-shift step on the rows and columns low .. high; trace, product: of the two shifts."""
    h = matrix[low + 1, low]
    x = (matrix[low, low] * (matrix[low, low] - trace) + product) / h + matrix[low, low + 1]
    y = matrix[low, low] + matrix[low + 1, low + 1] - trace
    z = matrix[low + 2, low + 1]
    for k in range(low, high):
        three = k < high - 1
        if k > low:
            x = matrix[k, k - 1]
            y = matrix[k + 1, k - 1]
            z = matrix[k + 2, k - 1] if three else 0.0
        largest = abs(x) + abs(y) + abs(z)
        if largest == 0.0:
            continue
        x /= largest
        y /= largest
        z /= largest
        norm = math.copysign(math.sqrt(x * x + y * y + z * z), x)
        if k > low:
            matrix[k, k - 1] = -norm * largest
            matrix[k + 1, k - 1] = 0.0
            if three:
                matrix[k + 2, k - 1] = 0.0
        # Householder's reflection 1 - (u / u_0) (u / norm)' with u = (x + norm, y, z)
        head = x + norm
        p = head / norm
        q = y / norm
        r = z / norm
        y /= head
        z /= head
        for c in range(k, high + 1):
            total = matrix[k, c] + y * matrix[k + 1, c]
            if three:
                total += z * matrix[k + 2, c]
                matrix[k + 2, c] -= total * r
            matrix[k + 1, c] -= total * q
            matrix[k, c] -= total * p
        for c in range(low, min(k + 3, high) + 1):
            total = p * matrix[c, k] + q * matrix[c, k + 1]
            if three:
                total += r * matrix[c, k + 2]
                matrix[c, k + 2] -= total * z
            matrix[c, k + 1] -= total * y
            matrix[c, k] -= total


@kernel
def eigenvalues(matrix, real, imaginary):
    """Eigenvalues of a square matrix (m, m), which is overwritten, into `real` and `imaginary` (>= m,), a complex pair side by side.
    Returns whether the iteration converged."""
    size = matrix.shape[0]
    _balance(matrix)
    _hessenberg(matrix)
    norm = 0.0
    for r in range(size):
        for c in range(size):
            norm += abs(matrix[r, c])
    if not norm < math.inf:
        return False
    high = size - 1
    steps = 0
    while high >= 0:
        low = high
        while low > 0:
            around = abs(matrix[low, low]) + abs(matrix[low - 1, low - 1])
            if abs(matrix[low, low - 1]) <= _EPSILON * (around if around > 0.0 else norm):
                matrix[low, low - 1] = 0.0
                break
            low -= 1
        last = matrix[high, high]
        if low == high:
            real[high] = last
            imaginary[high] = 0.0
            high -= 1
            steps = 0
            continue
        before = matrix[high - 1, high - 1]
        across = matrix[high, high - 1] * matrix[high - 1, high]
        if low == high - 1:
            half = 0.5 * (before - last)
            square = half * half + across
            root = math.sqrt(abs(square))
            if square >= 0.0:
                # The eigenvalue next to `last` follows from the product of the distances from it: no difference cancels.
                far = half + math.copysign(root, half)
                real[high - 1] = last + far
                real[high] = last - across / far if far != 0.0 else last
                imaginary[high - 1] = 0.0
                imaginary[high] = 0.0
            else:
                real[high - 1] = last + half
                real[high] = last + half
                imaginary[high - 1] = root
                imaginary[high] = -root
            high -= 2
            steps = 0
            continue
        if steps == _STEPS:
            return False
        steps += 1
        trace = before + last
        product = before * last - across
        if steps % 10 == 0:
            # a step with other shifts, where these go in circles
            side = abs(matrix[high, high - 1]) + abs(matrix[high - 1, high - 2])
            trace = 1.5 * side
            product = side * side
        _francis(matrix, low, high, trace, product)
    return True
