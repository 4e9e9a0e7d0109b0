"""Eigenvalues of a product of matrices and inverses of matrices, by the periodic QR iteration with implicit double shifts.

The product is never formed. Rotations keep each factor triangular but the last one, which is a Hessenberg matrix, and turn the coordinates
between two factors. What results is exact for factors that differ by rounding from the given ones, so small eigenvalues keep their digits
beside large ones (Bojanczyk, Golub and Van Dooren, Proc. SPIE 1770 (1992) 31; Kressner, BIT 46 (2006) 135). Shifts part eigenvalues of
equal or nearly equal size, which sweeps without shifts do not.
"""

import math

from bvp.kernels.compiled import inlined, kernel, shared

_EPSILON = 2.220446049250313e-16

_STEPS = 300
"""Most steps of the iteration for one eigenvalue, which takes two or three; 66 where pairs on the unit circle hardly differ."""

_LARGE = 1e100
"""Products outside 1/this .. this are scaled by a power of two."""


@inlined
def rotation(a, b):
    """c, s with c a + s b = r, -s a + c b = 0."""
    if b == 0.0:
        return 1.0, 0.0
    r = math.hypot(a, b)
    return a / r, b / r


@inlined
def _turn_rows(matrix, i, c, s, first, last):
    """Rows i, i + 1 from column `first` to `last`: c x + s y, c y - s x."""
    for k in range(first, last + 1):
        x = matrix[i, k]
        y = matrix[i + 1, k]
        matrix[i, k] = c * x + s * y
        matrix[i + 1, k] = c * y - s * x


@inlined
def _turn_columns(matrix, i, c, s, first, last):
    """The same for columns i, i + 1 from row `first` to `last`."""
    for k in range(first, last + 1):
        x = matrix[k, i]
        y = matrix[k, i + 1]
        matrix[k, i] = c * x + s * y
        matrix[k, i + 1] = c * y - s * x


@kernel
def _pass_on(factors, inverse, i, c, s, low, high, bottom):
    """A rotation of the coordinates i, i + 1 before the first factor, through all triangular ones to the columns of the last one, whose
    rows end at `bottom`."""
    last = factors.shape[0] - 1
    for k in range(last):
        matrix = factors[k]
        if inverse[k] == 0:
            _turn_columns(matrix, i, c, s, low, i + 1)
            c, s = rotation(matrix[i, i], matrix[i + 1, i])
            _turn_rows(matrix, i, c, s, i, high)
        else:
            _turn_rows(matrix, i, c, s, i, high)
            c, s = rotation(matrix[i + 1, i + 1], -matrix[i + 1, i])
            _turn_columns(matrix, i, c, s, low, i + 1)
        matrix[i + 1, i] = 0.0
    _turn_columns(factors[last], i, c, s, low, bottom)


@inlined
def _triangular(factors, inverse, k):
    """Make factor k triangular by rotations of the coordinates behind it, which turn the next factor too."""
    size = factors.shape[1]
    matrix = factors[k]
    after = k + 1 if k + 1 < factors.shape[0] else 0
    other = factors[after]
    for j in range(size - 1):
        for r in range(size - 2, j - 1, -1):
            if inverse[k] == 0:
                i = r
                c, s = rotation(matrix[i, j], matrix[i + 1, j])
                _turn_rows(matrix, i, c, s, j, size - 1)
                matrix[i + 1, j] = 0.0
            else:
                # From the last row upwards.
                row = size - 1 - j
                i = size - 2 - r
                c, s = rotation(matrix[row, i + 1], -matrix[row, i])
                _turn_columns(matrix, i, c, s, 0, row)
                matrix[row, i] = 0.0
            if inverse[after] == 0:
                _turn_columns(other, i, c, s, 0, size - 1)
            else:
                _turn_rows(other, i, c, s, 0, size - 1)


@kernel
def _corner(factors, inverse, first, count, out):
    """out (3, 3) <- the diagonal block of `count` rows from `first` of the product of all factors but the last, times 2^-exponent, which is
    returned."""
    exponent = 0.0
    for r in range(count):
        for c in range(count):
            out[r, c] = 1.0 if r == c else 0.0
    for k in range(factors.shape[0] - 1):
        matrix = factors[k]
        largest = 0.0
        for c in range(count):
            for step in range(c + 1):
                r = step if inverse[k] == 0 else c - step
                if inverse[k] == 0:
                    total = 0.0
                    for j in range(r, c + 1):
                        total += matrix[first + r, first + j] * out[j, c]
                else:
                    total = out[r, c]
                    for j in range(r + 1, c + 1):
                        total -= matrix[first + r, first + j] * out[j, c]
                    total /= matrix[first + r, first + r]
                out[r, c] = total
                largest = max(largest, abs(total))
        if largest > _LARGE or 0.0 < largest < 1.0 / _LARGE:
            shift = float(math.floor(math.log2(largest)))
            exponent += shift
            for r in range(count):
                for c in range(r, count):
                    out[r, c] *= 2.0**-shift
    return exponent


@inlined
def _two(factors, inverse, at, corner, values):
    """Eigenvalues of the diagonal block of two rows. The smaller real one is determinant / larger, which avoids cancellation."""
    h = factors[factors.shape[0] - 1]
    unit = 2.0 ** _corner(factors, inverse, at, 2, corner)
    a = h[at, at] * corner[0, 0]
    b = h[at, at] * corner[0, 1] + h[at, at + 1] * corner[1, 1]
    c = h[at + 1, at] * corner[0, 0]
    d = h[at + 1, at] * corner[0, 1] + h[at + 1, at + 1] * corner[1, 1]
    middle = 0.5 * (a + d)
    difference = 0.5 * (a - d)
    square = difference * difference + b * c
    if square < 0.0:
        for i in range(2):
            values[0, at + i] = middle * unit
            values[1, at + i] = math.copysign(math.sqrt(-square), i - 0.5) * unit
        return
    larger = middle + math.copysign(math.sqrt(square), middle)
    determinant = (h[at, at] * h[at + 1, at + 1] - h[at, at + 1] * h[at + 1, at]) * corner[0, 0]
    values[0, at] = larger * unit
    values[0, at + 1] = determinant / larger * corner[1, 1] * unit if larger != 0.0 else 0.0
    values[1, at] = 0.0
    values[1, at + 1] = 0.0


@inlined
def _step(factors, inverse, low, high, exceptional, corner):
    """A double-shift step on the coordinates low .. high."""
    h = factors[factors.shape[0] - 1]
    exponent = _corner(factors, inverse, high - 2, 3, corner)
    # The last two rows and columns of the product.
    a = h[high - 1, high - 2] * corner[0, 1] + h[high - 1, high - 1] * corner[1, 1]
    b = h[high - 1, high - 2] * corner[0, 2] + h[high - 1, high - 1] * corner[1, 2] + h[high - 1, high] * corner[2, 2]
    c = h[high, high - 1] * corner[1, 1]
    d = h[high, high - 1] * corner[1, 2] + h[high, high] * corner[2, 2]
    trace = a + d
    product = a * d - b * c
    if exceptional:
        side = abs(c) + abs(h[high - 1, high - 2] * corner[0, 0])
        trace = 1.5 * side
        product = side * side
    shift = 2.0 ** (exponent - _corner(factors, inverse, low, 3, corner))
    trace *= shift
    product *= shift * shift
    # The first column of (product - one shift) (product - other shift).
    a = h[low, low] * corner[0, 0]
    b = h[low + 1, low] * corner[0, 0]
    c = h[low, low] * corner[0, 1] + h[low, low + 1] * corner[1, 1]
    d = h[low + 1, low] * corner[0, 1] + h[low + 1, low + 1] * corner[1, 1]
    x = a * (a - trace) + product + b * c
    y = b * (a + d - trace)
    z = b * h[low + 2, low + 1] * corner[1, 1]
    largest = max(abs(x), abs(y), abs(z))
    if not 0.0 < largest < math.inf:
        x = 1.0
        y = 1.0
        z = 1.0
        largest = 1.0
    x /= largest
    y /= largest
    z /= largest
    for k in range(low - 1, high - 1):
        # A rotation of the last two of three rows, then one of the first two.
        if k + 3 <= high:
            cosine, sine = rotation(y, z)
            _turn_rows(h, k + 2, cosine, sine, max(k, low), high)
            _pass_on(factors, inverse, k + 2, cosine, sine, low, high, min(k + 5, high))
            if k >= low:
                h[k + 3, k] = 0.0
                y = h[k + 2, k]
            else:
                y = math.hypot(y, z)
        if k >= low:
            x = h[k + 1, k]
        cosine, sine = rotation(x, y)
        _turn_rows(h, k + 1, cosine, sine, max(k, low), high)
        _pass_on(factors, inverse, k + 1, cosine, sine, low, high, min(k + 4, high))
        if k >= low:
            h[k + 2, k] = 0.0
        if k + 3 <= high:
            # of the next column
            y = h[k + 3, k + 1]
            z = h[k + 4, k + 1] if k + 4 <= high else 0.0


@shared("integer")
def product_eigenvalues(factors, inverse, corner, product, values):
    """Eigenvalues of the product of factors (K, m, m), the first one applied first, into `values` (2, m), real and imaginary parts.

    inverse (K,) int64: 1 for a factor whose inverse is taken; the last one is 0. The factors are overwritten. corner (3, 3): scratch.
    product (m, m) becomes the product in some orthonormal frame, for its size: small entries are lost. Returns the number of steps; 0 where
    they do not converge, -1 where an inverse does not exist."""
    size = factors.shape[1]
    last = factors.shape[0] - 1
    h = factors[last]
    # Twice round: the first round sorts the coordinates by growth.
    for k in range(last + 1):
        _triangular(factors, inverse, k)
    for k in range(last):
        _triangular(factors, inverse, k)
        if inverse[k] != 0:
            for r in range(size):
                if factors[k, r, r] == 0.0:
                    return -1
    for j in range(size - 2):
        for i in range(size - 2, j, -1):
            c, s = rotation(h[i, j], h[i + 1, j])
            _turn_rows(h, i, c, s, j, size - 1)
            h[i + 1, j] = 0.0
            _pass_on(factors, inverse, i, c, s, 0, size - 1, size - 1)
    unit = 2.0 ** _corner(factors, inverse, 0, size, product)
    column = values[0]
    for c in range(size):
        for r in range(size):
            column[r] = product[r, c] * unit if r <= c else 0.0
        for r in range(size):
            product[r, c] = 0.0
            for j in range(max(r - 1, 0), c + 1):
                product[r, c] += h[r, j] * column[j]
    high = size - 1
    steps = 0
    total = 1
    while high >= 0:
        low = high
        while low > 0:
            around = abs(h[low, low]) + abs(h[low - 1, low - 1])
            if abs(h[low, low - 1]) <= _EPSILON * around or not around < math.inf:
                h[low, low - 1] = 0.0
                break
            low -= 1
        if low == high:
            unit = 2.0 ** _corner(factors, inverse, high, 1, corner)
            values[0, high] = h[high, high] * corner[0, 0] * unit
            values[1, high] = 0.0
            high -= 1
            steps = 0
        elif low == high - 1:
            _two(factors, inverse, low, corner, values)
            high -= 2
            steps = 0
        elif steps == _STEPS:
            return 0
        else:
            steps += 1
            total += 1
            _step(factors, inverse, low, high, steps % 10 == 0, corner)
    return total
