"""How kernels pass named tuples to each other: by the address at which a tuple is kept.

Numba would pass each length and stride of each array in it, several hundred numbers with some tuples. Half of all intermediate code would
be about that.
"""

from typing import Any, cast

import numba
from llvmlite import ir
from numba.core import cgutils
from numba.core.datamodel import DataModelManager, default_manager, models

nb: Any = numba


class _Lent:
    """A named tuple. Its value is that of numba's model; as an argument it is an address."""

    def get_argument_type(self):
        return cast(Any, self).get_value_type().as_pointer()

    def as_argument(self, builder, value):
        return value.operands[0] if _is_kept(builder, value) else cgutils.alloca_once_value(builder, value)

    def from_argument(self, builder, address):
        # As numba marks the address of the result: nothing else leads there, and it is not kept. Nothing is written to a named tuple.
        for attribute in address.parent.args[0].attributes:
            address.add_attribute(attribute)
        return builder.load(address)


class _LentTuple(_Lent, models.TupleModel):
    """One of different types."""


class _LentUniTuple(_Lent, models.UniTupleModel):
    """One of equal types."""


def _is_kept(builder: Any, value: Any) -> bool:
    """Whether a value was read from an argument, or from a variable that was not written to since."""
    if not isinstance(value, ir.LoadInstr):
        return False
    for instruction in reversed(builder.block.instructions):
        if instruction is value or (isinstance(instruction, ir.StoreInstr) and instruction.operands[1] is value.operands[0]):
            return instruction is value
    return isinstance(value.operands[0], ir.Argument)


_own = DataModelManager()
_own.register(nb.types.NamedTuple, _LentTuple)
_own.register(nb.types.NamedUniTuple, _LentUniTuple)
MODELS = _own.chain(default_manager)
"""How the values of all types are laid out and passed: as numba does it, but for named tuples."""


def keep_lent(module: ir.Module) -> None:
    """Replace each variable that is a copy of a lent tuple, and nothing else, by the tuple itself: it need not be copied."""
    for function in module.functions:
        writes: dict[Any, list[Any]] = {}
        for block in function.blocks:
            for instruction in block.instructions:
                if isinstance(instruction, ir.StoreInstr) and isinstance(instruction.operands[1], ir.AllocaInstr):
                    writes.setdefault(instruction.operands[1], []).append(instruction)
        copies = {variable: source for variable, stores in writes.items() if (source := _source(stores, function.args)) is not None}
        for block in function.blocks:
            kept = [one for one in block.instructions if not (isinstance(one, ir.StoreInstr) and one.operands[1] in copies)]
            block.instructions[:] = kept
            for instruction in kept:
                for variable in copies.keys() & set(instruction.operands):
                    instruction.replace_usage(variable, copies[variable])


def _source(stores: list[Any], arguments: Any) -> Any:
    """The argument that these instructions copy; None if they write anything else. Numba clears a variable after its last use."""
    values = [store.operands[0] for store in stores]
    written = [value for value in values if not (isinstance(value, ir.Constant) and value.constant is None)]
    if len(written) == 1 and isinstance(written[0], ir.LoadInstr) and written[0].operands[0] in arguments:
        return written[0].operands[0]
    return None
