"""Setting arrays to one value, element by element: assignments to slices compile tens of times slower."""

from bvp.kernels.compiled import kernel

__all__ = ["set_1", "set_2"]


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
