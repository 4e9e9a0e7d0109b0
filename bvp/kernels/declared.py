"""What the decorators of `bvp.kernels.compiled` declare, as the compiler sees it."""

from collections.abc import Callable
from functools import update_wrapper
from typing import Any, NamedTuple, cast


class Declared:
    """A function that is compiled.

    Attributes
    ----------
    function : callable
        What it computes, in Python.
    options : dict
        How numba compiles it.
    """

    def __init__(self, function: Callable[..., Any], **options: Any):
        update_wrapper(cast(Any, self), function)
        self.function = function
        self.options = options


class Intrinsic(NamedTuple):
    """An operation on compiled code, by its name in `bvp.kernels.compiler`."""

    name: str
