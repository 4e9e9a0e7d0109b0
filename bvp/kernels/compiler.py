"""Compile kernels to machine code with numba. As for arrays, division by zero gives inf or nan.

A kernel that Python calls becomes one object file. It contains the code of all kernels that it calls, optimised once: these are typed and
lowered, but have no machine code of their own. Its entry point for Python reads the arguments where Python and numpy keep them.
"""

import gc
import importlib
import os
from functools import cache, cached_property, partial
from operator import attrgetter
from types import FunctionType
from typing import Any, cast

import numba
import numpy as np
from llvmlite import binding as llvm
from llvmlite import ir
from numba.core import cgutils
from numba.core.codegen import AOTCodeLibrary, AOTCPUCodegen
from numba.core.compiler_lock import global_compiler_lock
from numba.core.cpu import CPUContext
from numba.core.datamodel import DataModelManager, default_manager, models
from numba.core.registry import CPUDispatcher, CPUTarget
from numba.core.target_extension import CPU, dispatcher_registry, jit_registry, target_override, target_registry
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from bvp.kernels.declared import Declared, Intrinsic
from bvp.kernels.entry_point import MEMORY, add_entry_points
from bvp.kernels.stored import processor

nb: Any = numba

LEVEL = 2
"""Of optimisation. The third level takes a fifth longer, and its code is no faster."""

if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
    raise ValueError("NUMBA_DISABLE_JIT is set, and saltus computes with compiled code alone; expected it unset, or 0")


class _Lent:
    """How a named tuple is passed from kernel to kernel: by the address at which it is kept. Numba would pass each length and stride of each
    array in it, several hundred numbers with some tuples, and half of all intermediate code would be about that."""

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
    """A named tuple of different types."""


class _LentUniTuple(_Lent, models.UniTupleModel):
    """A named tuple of equal types."""


def _is_kept(builder: Any, value: Any) -> bool:
    """Whether a value was read from an argument, or from a variable that was not written to since."""
    if not isinstance(value, ir.LoadInstr):
        return False
    for instruction in reversed(builder.block.instructions):
        if instruction is value or (isinstance(instruction, ir.StoreInstr) and instruction.operands[1] is value.operands[0]):
            return instruction is value
    return isinstance(value.operands[0], ir.Argument)


_models = DataModelManager()
_models.register(nb.types.NamedTuple, _LentTuple)
_models.register(nb.types.NamedUniTuple, _LentUniTuple)


def _keep_lent(module: ir.Module) -> None:
    """Replace each variable that is a copy of a lent tuple, and nothing else, by the tuple itself: it need not be copied."""
    for function in module.functions:
        writes: dict[Any, list[Any]] = {}
        for block in function.blocks:
            for instruction in block.instructions:
                if isinstance(instruction, ir.StoreInstr) and isinstance(instruction.operands[1], ir.AllocaInstr):
                    writes.setdefault(instruction.operands[1], []).append(instruction)
        copies = {variable: source for variable, stores in writes.items() if (source := _source(stores, function.args)) is not None}
        for block in function.blocks:
            block.instructions[:] = [one for one in block.instructions if not (isinstance(one, ir.StoreInstr) and one.operands[1] in copies)]
            for instruction in block.instructions:
                for variable in copies.keys() & set(instruction.operands):
                    instruction.replace_usage(variable, copies[variable])


def _source(stores: list[Any], arguments: Any) -> Any:
    """The argument that these instructions copy; None if they write anything else. Numba clears a variable after its last use."""
    values = [store.operands[0] for store in stores]
    written = [value for value in values if not (isinstance(value, ir.Constant) and value.constant is None)]
    if len(written) == 1 and isinstance(written[0], ir.LoadInstr) and written[0].operands[0] in arguments:
        return written[0].operands[0]
    return None


class _Library(AOTCodeLibrary):
    """Intermediate code of one function. That which is `exported` receives the code of all functions that it calls, directly or not, and is
    then optimised; the others are left as they are."""

    exported: tuple[str, ...] = ()

    def add_ir_module(self, ir_module):
        _keep_lent(ir_module)
        super().add_ir_module(ir_module)

    def _optimize_functions(self, ll_module):
        """Nothing for each function alone: all are optimised together, once."""
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self):
        self._finalized = True
        if not self.exported:
            return
        waiting, seen = list(self._linking_libraries), set()
        while waiting:
            library = waiting.pop()
            if library not in seen:
                seen.add(library)
                waiting.extend(library._linking_libraries)
                module = library._final_module.clone()
                _set_linkage(module.functions, "weak_odr")  # can be defined twice, and is linked before it is called
                self._final_module.link_in(module)
        # A function that could be called from elsewhere is copied into its only caller if it is short, not always: an object whose
        # functions all become one takes several times as long to optimise.
        _set_linkage(self._final_module.functions, "linkonce_odr", self.exported)
        _set_linkage(self._final_module.global_variables, "internal")
        passes, builder = self._codegen._module_pass_manager(opt=LEVEL)
        passes.run(self._final_module, builder)
        _set_linkage(self._final_module.functions, "internal", self.exported)
        self._final_module.verify()
        for function in self._final_module.functions:
            if function.is_declaration and function.name.startswith(("numba_", "NRT_")):
                raise NotImplementedError(f"a kernel calls {function.name}, which only numba has; expected arithmetic alone")


_code_of = attrgetter("library")
"""The intermediate code of a function that numba has compiled."""


def _set_linkage(values: Any, linkage: str, exported: tuple[str, ...] = ()) -> None:
    for value in values:
        if not value.is_declaration:
            value.linkage = "external" if value.name in exported else linkage


class _Codegen(AOTCPUCodegen):
    """Machine code for this processor, that can be kept in a file."""

    _library_class = _Library

    def __init__(self) -> None:
        name, self._features = processor()
        super().__init__("saltus", cpu_name=name)

    def _customize_tm_features(self):
        return self._features


class _Saltus(CPU):
    """The target of kernels among those that numba knows; it has all that the processor's own has."""


class _Target(CPUTarget):
    """Where numba finds the compiler of this target: its own one, with other machine code."""

    @cached_property
    def _toplevel_target_context(self):
        context = CPUContext(self.typing_context, self._target_name)
        context.refresh()
        return context.subtarget(_internal_codegen=_Codegen(), aot_mode=True, data_model_manager=_models.chain(default_manager))


class _Dispatcher(CPUDispatcher):
    """A function as numba sees it: kernels can call it, Python cannot.

    Literal integers are passed as ordinary integers: numba would compile a separate version for each literal."""

    def __init__(self, function: Any, **options: Any):
        options = {"nopython": True, **options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        super().__init__(function, targetoptions=options)
        cast(Any, self)._compiler._customize_flags = _without_machine_code

    def get_call_template(self, args, kws):
        return super().get_call_template(tuple(map(nb.types.unliteral, args)), {name: nb.types.unliteral(kws[name]) for name in kws})

    def compile(self, sig):
        with target_override("saltus"):
            return super().compile(sig)

    def add_overload(self, cres):
        cres = cres._replace(entry_point=object())
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [_code_of(cres)])
        self.overloads[tuple(cres.signature.args)] = cres


def _without_machine_code(flags: Any) -> Any:
    flags.no_compile = True
    return flags


target_registry["saltus"] = _Saltus
_Dispatcher.targetdescr = _Target("saltus")
dispatcher_registry[_Saltus] = _Dispatcher
jit_registry[_Saltus] = lambda **options: partial(_Dispatcher, **options)


_namespaces: dict[str, dict[str, Any]] = {}


def _namespace(function: Any) -> dict[str, Any]:
    """What the names in a kernel's file mean to numba."""
    if function.__module__ not in _namespaces:
        space = _namespaces[function.__module__] = dict(function.__globals__)
        for name, value in space.items():
            if isinstance(value, Declared):
                space[name] = dispatcher(value)
            elif isinstance(value, Intrinsic):
                space[name] = globals()[value.name]
    return _namespaces[function.__module__]


@cache
def dispatcher(kernel: Declared) -> _Dispatcher:
    """A kernel as other kernels call it."""
    function = kernel.function
    spelled = FunctionType(function.__code__, _namespace(function), function.__name__, function.__defaults__)
    spelled.__module__, spelled.__qualname__ = function.__module__, function.__qualname__
    return _Dispatcher(spelled, error_model="numpy", **kernel.options)


_NUMBERS = {"boolean": nb.types.boolean, "integer": nb.types.int64, "float": nb.types.float64}


def _numba_type(kind: Any) -> Any:
    """Numba's type of what `types_of` describes."""
    if isinstance(kind, str):
        if kind in _NUMBERS:
            return _NUMBERS[kind]
        item, dimensions, layout, *lent = kind.split(" ")
        return nb.types.Array(nb.from_dtype(np.dtype(item)), int(dimensions), layout, readonly=bool(lent))
    name, *parts = kind
    types = tuple(map(_numba_type, parts))
    if not name:
        return nb.types.BaseTuple.from_types(types)
    module, _, name = name.rpartition(".")
    return nb.types.BaseTuple.from_types(types, getattr(importlib.import_module(module), name))


_SELDOM = 20_000, 50, 1000


def machine_code(kernel: Declared, types: Any, name: str) -> bytes:
    """The object file of a kernel for arguments of some types (`bvp.kernels.stored.types_of`): it defines
    call.NAME, for Python, and at.NAME, for kernels.

    Garbage collection is reduced meanwhile. The compiler makes millions of objects that stay, and collection would take a tenth of the
    time.
    """
    before = gc.get_threshold()
    gc.set_threshold(*_SELDOM)
    try:
        with global_compiler_lock:
            kinds = tuple(map(_numba_type, types[1:]))
            inner: Any = dispatcher(kernel)
            inner.compile(kinds)
            result = inner.overloads[kinds]
            context = inner.targetctx
            library = context.codegen().create_library(name)
            module = context.create_module(name)
            library.exported = add_entry_points(context, module, result.fndesc, name)
            library.add_ir_module(module)
            library.add_llvm_module(llvm.parse_assembly(MEMORY))
            library.add_linking_library(_code_of(result))
            return bytes(library.emit_native_object())
    finally:
        gc.set_threshold(*before)


# -- operations on compiled code ----------------------------------------------------------------------------------------------------


def _calling(result: Any) -> Any:
    def call(typing_context, address, arguments):
        def code(context, builder, signature, values):
            packer = context.get_arg_packer(signature.args[1].types)
            shape = ir.FunctionType(context.get_value_type(result), packer.argument_types)
            pointer = builder.inttoptr(values[0], ir.PointerType(shape))
            answer = builder.call(pointer, packer.as_arguments(builder, cgutils.unpack_tuple(builder, values[1])))
            return context.get_dummy_value() if result is nb.types.none else answer

        return result(address, arguments), code

    return intrinsic(call)


call_at = _calling(nb.types.none)
integer_at = _calling(nb.types.int64)


def _sized(typing_context, array, size):
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


sized = intrinsic(prefer_literal=True)(_sized)


def _square(typing_context, vector, size):
    def code(context, builder, signature, values):
        kind = signature.return_type
        found = context.make_array(signature.args[0])(context, builder, values[0])
        out = context.make_array(kind)(context, builder)
        item = found.itemsize
        populate_array(out, found.data, [values[1], values[1]], [builder.mul(values[1], item), item], item, None)
        return out._getvalue()

    return nb.types.Array(vector.dtype, 2, "C")(vector, nb.types.int64), code


square = intrinsic(_square)
