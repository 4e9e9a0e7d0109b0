"""How kernels index arrays: from the first entry on, in steps of one.

Numba would look at each index, and at both ends of each slice, whether it is negative and counts from the end. That takes a sixth of the
time of a point.
"""

import operator
from functools import partial
from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils
from numba.core.cpu import CPUContext
from numba.core.imputils import impl_ret_borrowed
from numba.np.arrayobj import make_view

nb: Any = numba


def types_from_first(array: Any, index: Any) -> Any:
    """The type of an index of an array, without a sign."""
    if not isinstance(array, nb.types.Array):
        return index
    if isinstance(index, nb.types.BaseTuple):
        return nb.types.Tuple([types_from_first(array, one) for one in index.types])
    is_negative = getattr(index, "literal_value", 0) < 0
    return nb.types.uint64 if nb.types.unliteral(index) == nb.types.int64 and not is_negative else index


class IndexingContext(CPUContext):
    """Numba's intermediate code, with slices of its own."""

    def get_function(self, fn, sig, _firstcall=True):
        if getattr(fn, "typing_key", None) is operator.getitem and isinstance(sig.args[0], nb.types.Array):
            array, index = sig.args
            kinds = index.types if isinstance(index, nb.types.BaseTuple) else (index,)
            if nb.types.slice2_type in kinds and all(one in (nb.types.slice2_type, nb.types.uint64) for one in kinds):
                return partial(self._view, sig, kinds)
        return super().get_function(fn, sig, _firstcall)

    def _view(self, signature, kinds, builder, values, loc=None):
        """The part of an array that slices and indices choose."""
        kind = signature.args[0]
        array = self.make_array(kind)(self, builder, values[0])
        parts = cgutils.unpack_tuple(builder, values[1]) if isinstance(signature.args[1], nb.types.BaseTuple) else values[1:]
        shape, strides = cgutils.unpack_tuple(builder, array.shape), cgutils.unpack_tuple(builder, array.strides)
        zero = ir.Constant(shape[0].type, 0)
        starts, lengths, steps = [], [], []
        for axis, size in enumerate(shape):
            start, length = zero, size
            if axis < len(kinds) and kinds[axis] == nb.types.uint64:
                starts.append(parts[axis])
                continue
            if axis < len(kinds):
                piece = self.make_helper(builder, kinds[axis], value=parts[axis])
                start, last = piece.start, piece.stop
                last = builder.select(builder.icmp_signed("<", last, size), last, size)
                length = builder.sub(last, start)
                length = builder.select(builder.icmp_signed("<", length, zero), zero, length)
            starts.append(start)
            lengths.append(length)
            steps.append(strides[axis])
        data = cgutils.get_item_pointer(self, builder, kind, array, starts, wraparound=False, boundscheck=False)
        view = make_view(self, builder, kind, array, signature.return_type, data, lengths, steps)
        return impl_ret_borrowed(self, builder, signature.return_type, view._getvalue())
