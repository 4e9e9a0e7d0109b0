"""Short loops over arrays, element by element: assignments to slices compile tens of times slower."""

from bvp.kernels.compiled import kernel


@kernel
def set_1(array, value):
    """array (n,) = value."""
    for i in range(array.shape[0]):
        array[i] = value


@kernel
def set_2(array, value):
    """array (m, n) = value."""
    for i in range(array.shape[0]):
        for j in range(array.shape[1]):
            array[i, j] = value


@kernel
def inner(a, b):
    """a . b"""
    total = 0.0
    for r in range(a.shape[0]):
        total += a[r] * b[r]
    return total


@kernel
def dot(rows, c, z):
    """rows[c] . z, without the cost of making a view."""
    total = 0.0
    for r in range(z.shape[0]):
        total += rows[c, r] * z[r]
    return total
