"""Kernels: functions that are compiled to machine code when they are first called, and loaded from the user's cache folder after that.

`bvp.kernels.compiler` compiles, with numba. To load and to call a kernel takes neither (`bvp.kernels.stored`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from bvp.kernels import hook
from bvp.kernels.declared import Chosen, Declared, Intrinsic
from bvp.kernels.stored import Entry, entry_of, keep, load, sealed, symbol, types_of


class Kernel(Declared):
    """A function that runs as machine code. Its first call with arguments of some types loads it, or compiles it.

    Attributes
    ----------
    entries : dict of Entry
        What is loaded, by the types of the arguments.
    """

    def __init__(self, function: Callable[..., Any], result: Any = None, loops: str = "", **options: Any):
        super().__init__(function, result, loops, **options)
        self.entries: dict[Any, Entry] = {}

    def __call__(self, *arguments: Any) -> Any:
        for call, _ in self.entries.values():
            result = call(*arguments)
            if result is not NotImplemented:
                break
        else:
            if hook.interpreting:
                return self._interpreted(*arguments)
            result = self.entry(*arguments).call(*arguments)
        return result

    def _interpreted(self, *arguments: Any) -> Any:
        """The result in Python, of a kernel that has no machine code."""
        if hook.interpreting[-1]:  # called by another one
            return self.function(*arguments)
        types = types_of(arguments)
        entry = load(self.function.__module__, symbol(self.function.__module__, self.function.__qualname__, types))
        if entry is not None:
            self.entries[types] = entry
            return self(*arguments)
        hook.interpreting.append(True)
        try:
            with np.errstate(all="ignore"):
                return self.function(*arguments)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise hook.NotInterpretedError(f"{self.function.__qualname__}: {error}") from error
        finally:
            hook.interpreting.pop()

    def entry(self, *arguments: Any) -> Entry:
        """The kernel for arguments of these types, from a file or else compiled."""
        return self.entry_for(types_of(arguments))

    def entry_for(self, types: Any) -> Entry:
        """The same for types (`types_of`)."""
        if types not in self.entries:
            module = self.function.__module__
            name = symbol(module, self.function.__qualname__, types)
            entry = load(module, name)
            if entry is None and hook.before_compiling is not None:
                hook.before_compiling(module, self.function.__qualname__, types)
                entry = load(module, name)
            self.entries[types] = entry or entry_of(self.compile(types), name)
        return self.entries[types]

    def compile(self, types: Any) -> bytes:
        """Compile the kernel for arguments of some types (`types_of`), and keep it in the cache."""
        from bvp.kernels.compiler import machine_code

        module = self.function.__module__
        name = symbol(module, self.function.__qualname__, types)
        file = sealed(*machine_code(self, types, name))
        keep(module, name, file)
        return file


kernel: Any = partial(Kernel, _nrt=False)
"""Compile a function of plain arrays and numbers, without Python objects, that makes and returns no arrays.

Views of its arguments are not reference-counted, since the caller holds the arrays. Counting costs more than short sums."""

short_loops: Any = partial(kernel, loops="short")
"""A kernel whose loops are short, and most of a known length (`sized`). LLVM unrolls them, and vectorises the straight code."""

long_loops: Any = partial(kernel, loops="long")
"""A kernel whose loops run along rows and do the same to each entry. LLVM vectorises them. Sums keep their order, so no number changes."""

inlined: Any = partial(Kernel, forceinline=True, _nrt=False)
"""A kernel whose machine code becomes part of each caller.

The compiler then uses facts that the caller knows, such as a `sized` length. No arrays are passed, which for a dozen arrays takes longer
than a short flight. Use it for a kernel with one caller, and for a few lines inside a loop."""


def shared(result: Any, *, allocates: bool = False, loops: str = "") -> Any:
    """Compile a large function that several kernels call: it is machine code of its own, and they call it there.

    Without this, each of them contains its code. `result` says what it returns: "none", "integer", "float", "boolean", or a tuple of these.
    Its callers are then compiled without it. A call costs a few nanoseconds. It writes to no array that its callers have for reading.
    allocates: it makes arrays. loops: "short" or "long", as for such kernels."""
    return partial(Kernel, result=result, loops=loops, _nrt=allocates)


allocating: Any = partial(Kernel, _nrt=True)
"""Compile a function that makes arrays. Only such a function may call another one that returns an array."""

chosen: Any = Chosen
"""Declare a function that comes in kinds (`bvp.kernels.declared.Chosen`): `@name.of(Kind)` above a kernel makes it the one for arguments
whose first is a `Kind`."""


sized: Any = Intrinsic("sized", lambda array, length: array)
"""sized(array, n): the same array, whose last axis is known to have the written-out length n: loops along it are unrolled, in this kernel
and its parts. The array is contiguous, and has that length: it is not looked at."""

square: Any = Intrinsic("square", lambda vector, n: vector[: n * n].reshape(n, n))
"""square(vector, n): the first n^2 entries of a contiguous vector as a matrix (n, n). It has so many entries: it is not looked at."""

four_of: Any = Intrinsic("four_of", np.array)
"""four_of(row): the four numbers of a contiguous row, as one register of the processor. It has so many: it is not looked at. A sum in an
array would wait for each addition to be written and read again."""

write_four: Any = Intrinsic("write_four", np.copyto)
"""write_four(row, four): row = four."""

spread: Any = Intrinsic("spread", lambda number: np.full(4, number))
"""spread(number): the same number four times."""

times: Any = Intrinsic("times", lambda factor, four: factor * four)
"""times(factor, four): factor four."""

plus_times: Any = Intrinsic("plus_times", lambda total, factor, four: total + factor * four)
"""plus_times(total, factor, four): total + factor four, for two fours."""
