"""The decorators that compile kernels and keep them on disk. As for arrays, division by zero gives inf or nan."""

import gc
from functools import partial
from typing import Any

import numba as nb
from llvmlite import ir
from numba.core import cgutils
from numba.core.caching import NullCache
from numba.extending import intrinsic

from bvp.kernels.cache import KernelCache, cache_root

_COUNTED: dict[str, Any] = {"_nrt": True}  # numba's own run time for arrays; said in full, for what a kernel calls inherits it
_UNCOUNTED: dict[str, Any] = {"_nrt": False}


_SELDOM = 20_000, 50, 1000


def _made(function: Any, **options: Any) -> Any:
    """The compiled function.

    Literal integers are passed as ordinary integers: numba would compile a separate version for each literal. Garbage collection is
    reduced while numba compiles. The compiler makes millions of objects that stay, and collection would take a tenth of the time."""
    dispatcher = nb.njit(error_model="numpy", **options)(function)
    dispatcher._cache = NullCache() if cache_root() is None else KernelCache(function)
    resolve, compiled = dispatcher.get_call_template, dispatcher.compile

    def of_any_number(arguments: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        plain = {name: nb.types.unliteral(kind) for name, kind in keywords.items()}
        return resolve(tuple(map(nb.types.unliteral, arguments)), plain)

    def compile_in_peace(signature: Any) -> Any:
        before = gc.get_threshold()
        gc.set_threshold(*_SELDOM)
        try:
            return compiled(signature)
        finally:
            gc.set_threshold(*before)

    dispatcher.get_call_template = of_any_number
    dispatcher.compile = compile_in_peace
    return dispatcher


kernel: Any = partial(_made, **_UNCOUNTED)
"""Compile a function of plain arrays and numbers, without Python objects, that makes and returns no arrays.

Views of its arguments are not reference-counted, since the caller holds the arrays. Counting costs more than short sums."""

inlined: Any = partial(_made, forceinline=True, **_UNCOUNTED)
"""A kernel whose machine code becomes part of each caller.

The compiler then uses facts that the caller knows, such as a `sized` length. No arrays are passed, which for a dozen arrays takes longer
than a short flight. Use it for kernels with few callers. For a short kernel with one caller, `part` compiles faster."""

allocating: Any = partial(_made, **_COUNTED)
"""Compile a function that makes arrays. Only such a function may call another one that returns an array."""

part: Any = partial(_made, inline="always")
"""Compile a function as part of the kernel that calls it.

Use it for a function with one caller, since each separate function costs about a second of compilation. Use it also for a few lines
inside a loop, if a call would cost more than the lines."""


def entry_point(function: Any, arguments: tuple[Any, ...]) -> Any:
    """A kernel compiled for given argument types, to be called from Python with these types only. It does not check them.

    For a few named tuples, the check takes longer than a step along a family."""
    return _compiled(function, arguments).entry_point


def address_of(function: Any, arguments: tuple[Any, ...]) -> int:
    """Memory address of a kernel compiled for given argument types, for `call_at` and `integer_at`."""
    code = _compiled(function, arguments)
    return int(code.library.get_pointer_to_function(code.fndesc.llvm_cfunc_wrapper_name))


def _compiled(function: Any, arguments: tuple[Any, ...]) -> Any:
    """Numba's compile result of a kernel for given argument types."""
    types = tuple(nb.typeof(argument) for argument in arguments)
    if types not in function.overloads:
        function.compile(types)
    return function.overloads[types]


def _calling(result: Any) -> Any:
    def call(typing_context, address, arguments):
        """Call, inside a kernel, another kernel at a given address. The tuple must have the argument types that it was compiled for.

        A kernel that calls another one by name compiles all of it again. This call keeps large kernels separate."""

        def code(context, builder, signature, values):
            types = [context.get_value_type(argument) for argument in signature.args[1].types]
            shape = ir.FunctionType(context.get_value_type(result), types)
            pointer = builder.inttoptr(values[0], ir.PointerType(shape))
            answer = builder.call(pointer, cgutils.unpack_tuple(builder, values[1]))
            return context.get_dummy_value() if result is nb.types.none else answer

        return result(address, arguments), code

    return intrinsic(call)


call_at: Any = _calling(nb.types.none)
"""For a kernel without a result."""
integer_at: Any = _calling(nb.types.int64)
"""For one that returns an integer."""


def _sized(typing_context, array, size):
    """The same array, whose last axis is known to have a written-out length: loops along it are unrolled, in this kernel and its parts.

    The array is contiguous, and has that length: it is not looked at.
    """
    length = size.literal_value

    def code(context, builder, signature, values):
        kind = signature.args[0]
        found = context.make_array(kind)(context, builder, values[0])
        item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        shape = cgutils.unpack_tuple(builder, found.shape)
        strides = cgutils.unpack_tuple(builder, found.strides)
        integer = shape[-1].type
        shape[-1] = ir.Constant(integer, length)
        strides[-1] = ir.Constant(integer, item)
        if kind.ndim > 1:
            strides[-2] = ir.Constant(integer, item * length)
        found.shape = cgutils.pack_array(builder, shape)
        found.strides = cgutils.pack_array(builder, strides)
        return found._getvalue()

    return array(array, size), code


sized: Any = intrinsic(prefer_literal=True)(_sized)
