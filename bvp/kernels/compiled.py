"""How kernels are compiled: once, kept on disk, with division by zero giving inf or nan, as the arithmetic of arrays does."""

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
    """The compiled function. Other kernels call it with literal integers as with any others: numba would compile one of its own
    for each such number. While it is compiled, which makes millions of objects that stay, garbage is collected seldom: a tenth of the time
    goes there else."""
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

Views that it takes are not counted as references to their arrays, which the caller holds: counting costs more than short sums do."""

inlined: Any = partial(_made, forceinline=True, **_UNCOUNTED)
"""A kernel whose machine code becomes part of each caller's: what the caller knows of its arguments, such as a `sized` length, holds
inside, and arrays need not be handed over, which for a dozen of them takes longer than a short flight. For what is called from few
places; where it is one place, and short, `part` compiles faster."""

allocating: Any = partial(_made, **_COUNTED)
"""Compile a function that makes arrays of its own. Only such a one may call another that returns an array."""

part: Any = partial(_made, inline="always")
"""Compile a function as part of the kernel that calls it. For what is called from one place, a function of its own costing about a
second to compile, however short it is; and for a few lines inside a loop, where a call would cost more than they do."""


def entry_point(function: Any, arguments: tuple[Any, ...]) -> Any:
    """A kernel compiled for such arguments, to be called from Python with arguments of these types alone: it does not look at them.

    A look at the types of a few named tuples takes longer than a step along a family."""
    return _compiled(function, arguments).entry_point


def address_of(function: Any, arguments: tuple[Any, ...]) -> int:
    """Where a kernel, compiled for such arguments, stands in memory, for `call_at` and `integer_at`."""
    code = _compiled(function, arguments)
    return int(code.library.get_pointer_to_function(code.fndesc.llvm_cfunc_wrapper_name))


def _compiled(function: Any, arguments: tuple[Any, ...]) -> Any:
    """What numba knows of a kernel, compiled for such arguments."""
    types = tuple(nb.typeof(argument) for argument in arguments)
    if types not in function.overloads:
        function.compile(types)
    return function.overloads[types]


def _calling(result: Any) -> Any:
    def call(typing_context, address, arguments):
        """Call, in a kernel, another one that stands at an address, with a tuple of arguments of the very types that it was compiled for.

        A kernel that calls another by name is compiled together with all of it once more; this keeps large kernels apart.
        """

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
