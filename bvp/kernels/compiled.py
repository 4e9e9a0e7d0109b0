"""How kernels are compiled: once, kept on disk, with division by zero giving inf or nan, as the arithmetic of arrays does."""

from typing import Any

import numba as nb

__all__ = ["kernel"]


def kernel(function: Any) -> Any:
    """Compile a function of plain arrays and numbers, without Python objects."""
    return nb.njit(cache=True, error_model="numpy")(function)
