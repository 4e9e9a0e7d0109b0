"""How kernels are compiled: once, kept on disk, with division by zero giving inf or nan, as the arithmetic of arrays does."""

from typing import Any

import numba as nb

__all__ = ["kernel", "part"]


def kernel(function: Any) -> Any:
    """Compile a function of plain arrays and numbers, without Python objects."""
    return nb.njit(cache=True, error_model="numpy")(function)


def part(function: Any) -> Any:
    """Compile a function as part of the kernel that calls it. For what is called from one place: a function of its own costs about a
    second to compile, however short it is."""
    return nb.njit(cache=True, error_model="numpy", inline="always")(function)
