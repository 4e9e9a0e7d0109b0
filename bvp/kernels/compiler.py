"""Compile kernels to machine code with numba. As for arrays, division by zero gives inf or nan.

A kernel that Python calls becomes one object file. It contains the code of all kernels that it calls, optimised once: these are typed and
lowered, but have no machine code of their own. Its entry point for Python reads the arguments where Python and numpy keep them.
"""

import gc
import importlib
import inspect
import operator
import os
import re
from collections.abc import Sequence
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
from numba.core.registry import CPUDispatcher, CPUTarget
from numba.core.target_extension import CPU, dispatcher_registry, jit_registry, target_override, target_registry
from numba.core.targetconfig import ConfigStack
from numba.core.typing import Context
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from bvp.kernels.declared import Chosen, Declared, Intrinsic
from bvp.kernels.entry_point import MEMORY, add_entry_points
from bvp.kernels.fours import four_of, plus_times, spread, times, write_four  # noqa: F401  named by `Intrinsic`
from bvp.kernels.indexing import IndexingContext, types_from_first
from bvp.kernels.lent import MODELS, keep_lent
from bvp.kernels.passes import Options, Pipeline
from bvp.kernels.stored import processor, require_imported, symbol

nb: Any = numba

if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
    raise ValueError("NUMBA_DISABLE_JIT is set, and saltus computes with compiled code alone; expected it unset, or 0")


class _Library(AOTCodeLibrary):
    """Intermediate code of one function. That which is `exported` receives the code of all functions that it calls, directly or not, and is
    then optimised; the others are left as they are."""

    exported: tuple[str, ...] = ()
    loops = ""
    callees: Sequence[Any] = ()

    def add_ir_module(self, ir_module):
        keep_lent(ir_module)
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
        for library in sorted(seen, key=_order):
            module = library._final_module.clone()
            _set_linkage(module.functions, "weak_odr")  # can be defined twice, and is linked before it is called
            self._final_module.link_in(module)
        # A function that could be called from elsewhere is copied into its only caller if it is short, not always: an object whose
        # functions all become one takes several times as long to optimise.
        _set_linkage(self._final_module.functions, "linkonce_odr", self.exported)
        _set_linkage(self._final_module.global_variables, "internal")
        self._optimize()
        _set_linkage(self._final_module.functions, "internal", self.exported)
        self._final_module.verify()
        declared = [function.name for function in self._final_module.functions if function.is_declaration]
        self.callees = [_shared_kernels[name] for name in declared if name in _shared_kernels]
        for name in declared:
            if name.startswith(("numba_", "NRT_")):
                raise NotImplementedError(f"a kernel calls {name}, which only numba has; expected arithmetic alone")

    def _optimize(self) -> None:
        """Loops are unrolled where most have a known length. Elsewhere, and at higher levels, a kernel takes a quarter longer to compile,
        and is no faster."""
        short = self.loops == "short"
        tuning = llvm.create_pipeline_tuning_options(2 if short else 1)
        tuning.loop_vectorization = self.loops == "long"
        tuning.loop_unrolling = tuning.slp_vectorization = short
        builder = llvm.create_pass_builder(self._codegen._tm, tuning)
        builder.getModulePassManager().run(self._final_module, builder)


def _order(library: Any) -> list[str]:
    """What a library defines, without the numbers that numba counts up. The order of functions decides which of them LLVM copies into their
    callers, and so the speed: it must not depend on what was compiled before."""
    return sorted(re.sub(r"B\d+v\d+", "", function.name) for function in library._final_module.functions if not function.is_declaration)


intermediate_code = attrgetter("library")
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


class _Types(Context):
    """What numba knows about types, with the signatures that it has found.

    A call of one name, such as a sum, has dozens of definitions in numba. To try them all anew at each call takes a quarter of the time
    before LLVM begins.
    """

    def __init__(self) -> None:
        super().__init__()
        self._options: Any = None
        self._found: dict[Any, Any] = {}  # for the options of the function that is being compiled
        self._with: dict[Any, dict[Any, Any]] = {}

    def _resolve_user_function_type(self, func, args, kws, literals=None):
        function = self._lookup_global(func) or func
        if not isinstance(function, nb.types.Function):
            return super()._resolve_user_function_type(func, args, kws, literals)
        options = ConfigStack.top_or_none()
        if options is not self._options:
            self._options = options
            self._found = self._with.setdefault(options and options.copy(), {})
        call = function, tuple(args), tuple(kws.items())
        if call not in self._found:
            self._found[call] = function.get_call_type(self, args, kws)
        return self._found[call]

    def resolve_function_type(self, func, args, kws):
        if func is operator.getitem:
            args = args[0], types_from_first(*args)
        return super().resolve_function_type(func, args, kws)

    def resolve_setitem(self, target, index, value):
        return super().resolve_setitem(target, types_from_first(target, index), value)


class _Target(CPUTarget):
    """Where numba finds the compiler of this target: its own one, with other types and other machine code."""

    @cached_property
    def _toplevel_typing_context(self):
        return _Types()

    @cached_property
    def _toplevel_target_context(self):
        context = IndexingContext(self.typing_context, self._target_name)
        context.refresh()
        return context.subtarget(_internal_codegen=_Codegen(), aot_mode=True, data_model_manager=MODELS)


class _Dispatcher(CPUDispatcher):
    """A function as numba sees it: kernels can call it, Python cannot.

    Literal integers are passed as ordinary integers: numba would compile a separate version for each literal."""

    def __init__(self, function: Any, **options: Any):
        # Numba lets what is not set pass on from the caller that is compiled first: one inlined kernel would inline all that it calls.
        options = {"nopython": True, "forceinline": False, **options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        super().__init__(function, targetoptions=options, pipeline_class=Pipeline)
        cast(Any, self)._compiler._customize_flags = _without_machine_code

    def get_call_template(self, args, kws):
        return super().get_call_template(tuple(map(nb.types.unliteral, args)), {name: nb.types.unliteral(kws[name]) for name in kws})

    def compile(self, sig):
        with target_override("saltus"):
            return super().compile(sig)

    def add_overload(self, cres):
        cres = cres._replace(entry_point=object())
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [intermediate_code(cres)])
        self.overloads[tuple(cres.signature.args)] = cres


class _Choice:
    """A function with kinds as numba sees it: the kind for the type of the first argument takes its place."""

    is_compiling = False  # no kind calls itself

    def __init__(self, chosen: Chosen):
        self._chosen = chosen
        self._numba_type_ = nb.types.Dispatcher(self)

    def _kind(self, arguments: Any) -> Any:
        kernel = self._chosen.kinds[arguments[0].instance_class]
        require_imported(_compiling[-1], kernel.function.__module__)
        return dispatcher(kernel) if kernel.result is None else _forwarding(kernel)

    def get_call_template(self, args, kws):
        return self._kind(args).get_call_template(args, kws)

    def get_overload(self, types):
        return self._kind(types).get_overload(types)


_compiling: list[str] = []
"""The kernel file of the machine code that is being made."""


def _without_machine_code(flags: Any) -> Any:
    flags = Options(flags)
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
                space[name] = dispatcher(value) if value.result is None else _shared(value)
            elif isinstance(value, Chosen):
                space[name] = _Choice(value)
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


def _described(kind: Any) -> Any:
    """What `types_of` writes for an argument of one of numba's types. An array that is lent for reading is taken as any other: the code
    would be the same, and there would be two of it."""
    if isinstance(kind, nb.types.Array):
        return f"{kind.dtype.name} {kind.ndim} {kind.layout}"
    if isinstance(kind, nb.types.BaseTuple):
        owner = getattr(kind, "instance_class", None)
        return "" if owner is None else f"{owner.__module__}.{owner.__qualname__}", *map(_described, kind.types)
    return next(name for name, number in _NUMBERS.items() if number == kind)


_SELDOM = 20_000, 50, 1000


def machine_code(kernel: Declared, types: Any, name: str) -> tuple[bytes, list[Any]]:
    """The object file of a kernel for arguments of some types (`bvp.kernels.stored.types_of`), and module, name and types of the shared
    kernels that it calls. It defines call.NAME, for Python, and at.NAME, for kernels.

    Garbage collection is reduced meanwhile. The compiler makes millions of objects that stay, and collection would take a tenth of the
    time.
    """
    before = gc.get_threshold()
    gc.set_threshold(*_SELDOM)
    try:
        with global_compiler_lock:
            _compiling.append(kernel.function.__module__)
            kinds = tuple(map(_numba_type, types[1:]))
            inner: Any = dispatcher(kernel)
            inner.compile(kinds)
            result = inner.overloads[kinds]
            if kernel.result is not None and result.signature.return_type != _result_type(kernel.result):
                raise TypeError(f"{name} returns {result.signature.return_type}, and {kernel.result} is declared")
            context = inner.targetctx
            library = context.codegen().create_library(name)
            module = context.create_module(name)
            library.exported = add_entry_points(context, module, result.fndesc, name)
            library.loops = kernel.loops
            library.add_ir_module(module)
            library.add_llvm_module(llvm.parse_assembly(MEMORY))
            library.add_linking_library(intermediate_code(result))
            return bytes(library.emit_native_object()), library.callees
    finally:
        _compiling.clear()
        gc.set_threshold(*before)


# -- operations on compiled code ----------------------------------------------------------------------------------------------------


def _call_entry(context: Any, builder: Any, signature: Any, values: Any, entry: Any) -> Any:
    """Call the entry point at.NAME of another kernel. entry: gives it for its type."""
    packer = context.get_arg_packer(signature.args)
    shape = ir.FunctionType(context.get_value_type(signature.return_type), packer.argument_types)
    answer = builder.call(entry(shape), packer.as_arguments(builder, values))
    return context.get_dummy_value() if signature.return_type is nb.types.none else answer


def _shared(kernel: Declared) -> Any:
    """A shared kernel as other kernels call it."""

    def call(typing_context, *arguments):
        types = tuple(map(nb.types.unliteral, arguments))
        called = kernel.function.__module__, kernel.function.__qualname__, ("", *map(_described, types))
        name = f"at.{symbol(*called)}"
        _shared_kernels[name] = called

        def code(context, builder, signature, values):
            def entry(shape):
                function = cgutils.get_or_insert_function(builder.module, shape, name)
                # By an address of 64 bits: objects that are loaded at different times can be more than 2 GB apart.
                function.attributes.add("nonlazybind")
                return function

            return _call_entry(context, builder, signature, values, entry)

        return result(*types), code

    result = _result_type(kernel.result)
    parameters = inspect.signature(kernel.function).parameters.values()
    context = inspect.Parameter("typing_context", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    cast(Any, call).__signature__ = inspect.Signature([context, *parameters])
    return intrinsic(call)


@cache
def _forwarding(kernel: Declared) -> _Dispatcher:
    """A kernel that calls a shared one: the form that a kind has for numba."""
    names = ", ".join(inspect.signature(kernel.function).parameters)
    space: dict[str, Any] = {"shared": _shared(kernel)}
    exec(f"def forward({names}):\n    return shared({names})", space)
    return _Dispatcher(space["forward"], error_model="numpy", forceinline=True, _nrt=False)


_shared_kernels: dict[str, tuple[str, str, Any]] = {}
"""Module, name and types of the shared kernels that are called, by the names of their entry points."""


def _result_type(kind: Any) -> Any:
    """Numba's type of a declared result."""
    return nb.types.none if kind == "none" else _numba_type(("", *kind) if isinstance(kind, tuple) else kind)


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
