"""Linear equations with small dense matrices, real or complex: elimination with partial pivoting."""

from bvp.kernels.compiled import kernel


@kernel
def factorise(matrix, pivots):
    """Replace a square matrix (m, m) by its triangular factors: the lower one, with a unit diagonal, below. pivots (m,) int64: the row that
    each row was exchanged with. Returns the smallest over the largest modulus of the pivots."""
    size = matrix.shape[0]
    least = abs(matrix[0, 0]) * 0.0 - 1.0
    most = 0.0
    for k in range(size):
        pivot = k
        largest = abs(matrix[k, k])
        for r in range(k + 1, size):
            value = abs(matrix[r, k])
            if value > largest:
                largest = value
                pivot = r
        pivots[k] = pivot
        least = largest if least < 0.0 else min(least, largest)
        most = max(most, largest)
        if pivot != k:
            for c in range(size):
                x = matrix[k, c]
                matrix[k, c] = matrix[pivot, c]
                matrix[pivot, c] = x
        if largest == 0.0:
            continue
        inverse = 1.0 / matrix[k, k]
        for r in range(k + 1, size):
            factor = matrix[r, k]
            if factor != 0.0:
                factor *= inverse
                matrix[r, k] = factor
                for c in range(k + 1, size):
                    matrix[r, c] -= factor * matrix[k, c]
    return least / most if most > 0.0 else 0.0


@kernel
def substitute(factors, pivots, x):
    """Solve the equations with the right side x (m,), in place."""
    size = factors.shape[0]
    for k in range(size):
        value = x[pivots[k]]
        x[pivots[k]] = x[k]
        x[k] = value
    for r in range(1, size):
        total = x[r]
        for c in range(r):
            total -= factors[r, c] * x[c]
        x[r] = total
    for r in range(size - 1, -1, -1):
        total = x[r]
        for c in range(r + 1, size):
            total -= factors[r, c] * x[c]
        x[r] = total / factors[r, r]


@kernel
def substitute_transposed(factors, pivots, x):
    """The same with the transposed matrix."""
    size = factors.shape[0]
    for r in range(size):
        value = x[r] / factors[r, r]
        x[r] = value
        for c in range(r + 1, size):
            x[c] -= factors[r, c] * value
    for r in range(size - 1, 0, -1):
        value = x[r]
        for c in range(r):
            x[c] -= factors[r, c] * value
    for k in range(size - 1, -1, -1):
        value = x[pivots[k]]
        x[pivots[k]] = x[k]
        x[k] = value


@kernel
def norm_1(matrix):
    """The largest sum of the moduli of a column."""
    largest = 0.0
    for c in range(matrix.shape[1]):
        total = 0.0
        for r in range(matrix.shape[0]):
            total += abs(matrix[r, c])
        largest = max(largest, total)
    return largest


@kernel
def inverse_norm(factors, pivots, x):
    """A lower bound of `norm_1` of the inverse, rarely below a third of it: Hager's, SIAM J. Sci. Stat. Comput. 5 (1984) 311.
    x (2, m), as the factors: scratch."""
    size = factors.shape[0]
    best = 0.0
    place = -1
    for attempt in range(3):
        for r in range(size):
            x[0, r] = 1.0 / size if place < 0 else 1.0 if r == place else 0.0
        substitute(factors, pivots, x[0])
        total = 0.0
        for r in range(size):
            total += abs(x[0, r])
            x[1, r] = x[0, r].conjugate() / abs(x[0, r]) if abs(x[0, r]) > 0.0 else 1.0
        best = max(best, total)
        if attempt == 2:
            break
        substitute_transposed(factors, pivots, x[1])
        largest = -1
        for r in range(size):
            if largest < 0 or abs(x[1, r]) > abs(x[1, largest]):
                largest = r
        if largest == place:
            break
        place = largest
    return best
