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
