"""Four numbers as one register of the processor, as the compiler sees them: the operations that `bvp.kernels.compiled` declares.

LLVM would find out by itself that four sums do the same, but then puts the registers together in other ways, which take longer."""

from typing import Any

import numba
from llvmlite import ir
from numba.core.datamodel import PrimitiveModel
from numba.extending import intrinsic

from bvp.kernels.lent import MODELS

nb: Any = numba

_REGISTER = ir.VectorType(ir.DoubleType(), 4)


class _Four(nb.types.Type):
    """The type of four numbers."""

    def __init__(self) -> None:
        super().__init__("four numbers")


class _FourModel(PrimitiveModel):
    """How four numbers are kept."""

    def __init__(self, models, kind):
        super().__init__(models, kind, _REGISTER)


_FOUR = _Four()
MODELS.register(_Four, _FourModel)


def _place(context, builder, kind, row):
    """Where the numbers of a row are in memory."""
    return builder.bitcast(context.make_array(kind)(context, builder, row).data, _REGISTER.as_pointer())


def _four_times(builder, number):
    """The same number four times."""
    first = builder.insert_element(ir.Constant(_REGISTER, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(ir.IntType(32), 4), [0] * 4))


def _four_of(typing_context, row):
    def code(context, builder, signature, values):
        return builder.load(_place(context, builder, signature.args[0], values[0]), align=8)

    return _FOUR(row), code


def _write_four(typing_context, row, four):
    def code(context, builder, signature, values):
        builder.store(values[1], _place(context, builder, signature.args[0], values[0]), align=8)
        return context.get_dummy_value()

    return nb.types.none(row, _FOUR), code


def _times(typing_context, factor, four):
    def code(context, builder, signature, values):
        return builder.fmul(_four_times(builder, values[0]), values[1])

    return _FOUR(nb.types.float64, _FOUR), code


def _plus_times(typing_context, total, factor, four):
    def code(context, builder, signature, values):
        return builder.fadd(values[0], builder.fmul(_four_times(builder, values[1]), values[2]))

    return _FOUR(_FOUR, nb.types.float64, _FOUR), code


def _spread(typing_context, number):
    def code(context, builder, signature, values):
        return _four_times(builder, values[0])

    return _FOUR(nb.types.float64), code


four_of = intrinsic(_four_of)
write_four = intrinsic(_write_four)
spread = intrinsic(_spread)
times = intrinsic(_times)
plus_times = intrinsic(_plus_times)
