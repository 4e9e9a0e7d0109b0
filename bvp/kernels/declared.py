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
    result : str, tuple or None
        What it returns, as `bvp.kernels.stored.types_of` writes types, or "none"; None where only the compiler knows.
    loops : str
        What LLVM does with loops: "short" are unrolled, and straight code is vectorised; "long" are vectorised; nothing otherwise.
    options : dict
        How numba compiles it.
    """

    def __init__(self, function: Callable[..., Any], result: Any = None, loops: str = "", **options: Any):
        update_wrapper(cast(Any, self), function)
        self.function = function
        self.result = result
        self.loops = loops
        self.options = options


class Chosen:
    """A function that comes in kinds: the type of the first argument, a named tuple, selects the kernel that is called.

    A kernel that calls it contains the kind for its own argument alone.

    Attributes
    ----------
    kinds : dict of Declared
        The kernels, by the types of their first arguments.
    """

    def __init__(self, function: Callable[..., Any]):
        update_wrapper(cast(Any, self), function)
        self.kinds: dict[type, Any] = {}

    def of(self, kind: type) -> Callable[[Any], Any]:
        """Declare the kernel for a type."""

        def declare(kernel: Any) -> Any:
            self.kinds[kind] = kernel
            return kernel

        return declare

    def __call__(self, *arguments: Any) -> Any:
        return self.kinds[type(arguments[0])](*arguments)


class Intrinsic(NamedTuple):
    """An operation on compiled code, by its name in `bvp.kernels.compiler`, and what it does in Python."""

    name: str
    function: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)
