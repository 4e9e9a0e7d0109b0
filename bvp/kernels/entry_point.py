"""The entry points of a compiled kernel: for Python, which hands over objects, and for other kernels, which hand over values.

The one for Python has the convention METH_FASTCALL of Python's interface for C. Its `self` is the type numpy.ndarray. It reads an array's
data, shape and strides where numpy's interface for C keeps them (PyArrayObject_fields, the same in numpy 1 and 2). Arguments of other types
are refused: it returns NotImplemented.
"""

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.np import numpy_support
from numba.np.arrayobj import populate_array

nb: Any = numba

_POINTER = ir.IntType(8).as_pointer()
_INT32, _INT64 = ir.IntType(32), ir.IntType(64)
_VOID = ir.VoidType()
_HEADER = object.__basicsize__
"""Bytes before the data of an object; the last eight contain its type."""

_C_CONTIGUOUS, _ALIGNED, _WRITEABLE = 0x1, 0x100, 0x400
"""Flags of an array."""

_FUNCTIONS = {
    "PyTuple_Size": (_INT64, [_POINTER]),
    "PyTuple_GetItem": (_POINTER, [_POINTER, _INT64]),
    "PyTuple_New": (_POINTER, [_INT64]),
    "PyTuple_SetItem": (_INT32, [_POINTER, _INT64, _POINTER]),
    "PyFloat_AsDouble": (ir.DoubleType(), [_POINTER]),
    "PyFloat_FromDouble": (_POINTER, [ir.DoubleType()]),
    "PyLong_AsLongLong": (_INT64, [_POINTER]),
    "PyLong_FromLongLong": (_POINTER, [_INT64]),
    "PyObject_IsTrue": (_INT32, [_POINTER]),
    "PyBool_FromLong": (_POINTER, [_INT64]),
    "PyErr_Occurred": (_POINTER, []),
    "PyErr_Clear": (_VOID, []),
    "PyErr_NoMemory": (_POINTER, []),
    "Py_IncRef": (_VOID, [_POINTER]),
}
"""The functions of Python's interface for C that are called: result and arguments."""


class _Writer:
    """Writes the entry point for Python. Wherever a requirement does not hold, control goes to the block `refuse`."""

    def __init__(self, context: Any, module: ir.Module, builder: ir.IRBuilder, array_type: Any):
        self.context, self.module, self.builder, self.array_type = context, module, builder, array_type
        self.refuse = builder.function.append_basic_block("refuse")

    def python(self, name: str, *arguments: Any) -> Any:
        """Call a function of Python's interface."""
        return self.builder.call(declared(self.module, name), arguments)

    def field(self, thing: Any, offset: int, kind: Any) -> Any:
        """What an object contains at an offset in bytes."""
        place = self.builder.gep(thing, [_INT64(offset)])
        return self.builder.load(self.builder.bitcast(place, kind.as_pointer()))

    def require(self, condition: Any) -> None:
        """Go on only if the condition holds."""
        after = self.builder.append_basic_block()
        self.builder.cbranch(condition, after, self.refuse)
        self.builder.position_at_end(after)

    def require_no_error(self, suspect: Any) -> None:
        """Where a result may be an error, go on only if Python knows of none."""
        builder = self.builder
        with builder.if_then(suspect, likely=False):
            self.require(builder.icmp_unsigned("==", self.python("PyErr_Occurred"), _POINTER(None)))

    def value(self, thing: Any, kind: Any) -> Any:
        """The value of a Python object that must have a type."""
        builder = self.builder
        if isinstance(kind, nb.types.Array):
            return self.array(thing, kind)
        if isinstance(kind, nb.types.BaseTuple):
            size = self.python("PyTuple_Size", thing)
            self.require(builder.icmp_signed("==", size, _INT64(len(kind.types))))
            parts = [self.value(self.python("PyTuple_GetItem", thing, _INT64(i)), part) for i, part in enumerate(kind.types)]
            return self.context.make_tuple(builder, kind, parts)
        if isinstance(kind, nb.types.Boolean):
            true = self.python("PyObject_IsTrue", thing)
            self.require(builder.icmp_signed(">=", true, _INT32(0)))
            return builder.icmp_signed("!=", true, _INT32(0))
        if isinstance(kind, nb.types.Integer):
            number = self.python("PyLong_AsLongLong", thing)
            self.require_no_error(builder.icmp_signed("==", number, _INT64(-1)))
            return number
        if isinstance(kind, nb.types.Float):
            number = self.python("PyFloat_AsDouble", thing)
            self.require_no_error(builder.fcmp_ordered("==", number, ir.DoubleType()(-1.0)))
            return number
        raise TypeError(f"a kernel cannot take {kind}")

    def array(self, thing: Any, kind: Any) -> Any:
        """The value of an array."""
        builder, context = self.builder, self.context
        self.require(builder.icmp_unsigned("==", self.field(thing, _HEADER - 8, _POINTER), self.array_type))
        # PyArrayObject_fields: data, number of dimensions, dimensions, strides, base, descriptor, flags
        data, dimensions, lengths, steps, _, descriptor, flags = (
            self.field(thing, _HEADER + 8 * k, member)
            for k, member in enumerate([_POINTER, _INT32, _INT64.as_pointer(), _INT64.as_pointer(), _POINTER, _POINTER, _INT32])
        )
        self.require(builder.icmp_signed("==", dimensions, _INT32(kind.ndim)))
        # PyArray_Descr: type, then four characters (the third one is the order of bytes), number of the type
        number = self.field(descriptor, _HEADER + 12, _INT32)
        self.require(builder.icmp_signed("==", number, _INT32(numpy_support.as_dtype(kind.dtype).num)))
        order = self.field(descriptor, _HEADER + 10, ir.IntType(8))
        self.require(builder.icmp_unsigned("!=", order, ir.IntType(8)(ord(">" if np.little_endian else "<"))))
        wanted = _ALIGNED | (_C_CONTIGUOUS if kind.layout == "C" else 0) | (_WRITEABLE if kind.mutable else 0)
        self.require(builder.icmp_signed("==", builder.and_(flags, _INT32(wanted)), _INT32(wanted)))
        shape, strides = ([builder.load(builder.gep(at, [_INT64(k)])) for k in range(kind.ndim)] for at in (lengths, steps))
        out = context.make_array(kind)(context, builder)
        item = context.get_data_type(kind.dtype)
        size = numpy_support.as_dtype(kind.dtype).itemsize
        populate_array(out, builder.bitcast(data, item.as_pointer()), shape, strides, _INT64(size), None)
        return out._getvalue()

    def result(self, value: Any, kind: Any) -> Any:
        """A new Python object of a result."""
        builder = self.builder
        if isinstance(kind, nb.types.NoneType):
            return self.constant("_Py_NoneStruct")
        if isinstance(kind, nb.types.BaseTuple):
            out = self.python("PyTuple_New", _INT64(len(kind.types)))
            for i, part in enumerate(kind.types):
                self.python("PyTuple_SetItem", out, _INT64(i), self.result(builder.extract_value(value, i), part))
            return out
        if isinstance(kind, nb.types.Boolean):
            return self.python("PyBool_FromLong", builder.zext(value, _INT64))
        if isinstance(kind, nb.types.Integer | nb.types.IntegerLiteral):
            return self.python("PyLong_FromLongLong", builder.sext(value, _INT64) if value.type != _INT64 else value)
        if isinstance(kind, nb.types.Float):
            return self.python("PyFloat_FromDouble", value)
        raise TypeError(f"a kernel cannot return {kind} to Python")

    def constant(self, name: str) -> Any:
        """A new reference to an object of Python's, by its name in the interface for C."""
        if name not in self.module.globals:
            ir.GlobalVariable(self.module, ir.IntType(8), name)
        self.python("Py_IncRef", self.module.globals[name])
        return self.module.globals[name]


def declared(module: ir.Module, name: str) -> Any:
    """A function of Python's interface for C, declared in a module."""
    if name not in module.globals:
        ir.Function(module, ir.FunctionType(*_FUNCTIONS[name]), name)
    return module.globals[name]


def add_entry_points(context: Any, module: ir.Module, function: Any, name: str) -> tuple[str, str]:
    """Add to a module the entry points of a function that numba lowered: call.NAME for Python, at.NAME for kernels. Returns their names."""
    kinds, answer = function.argtypes, function.restype
    convention = context.call_conv
    compiled = ir.Function(module, convention.get_function_type(answer, kinds), function.llvm_func_name)

    shape = ir.FunctionType(_POINTER, [_POINTER, _POINTER.as_pointer(), _INT64])
    call = ir.Function(module, shape, f"call.{name}")
    builder = ir.IRBuilder(call.append_basic_block())
    writer = _Writer(context, module, builder, call.args[0])
    writer.require(builder.icmp_signed("==", call.args[2], _INT64(len(kinds))))
    values = [writer.value(builder.load(builder.gep(call.args[1], [_INT64(i)])), kind) for i, kind in enumerate(kinds)]
    status, result = convention.call_function(builder, compiled, answer, kinds, values)
    with builder.if_then(status.is_error, likely=False):  # an array could not be made: kernels raise nothing else
        builder.ret(writer.python("PyErr_NoMemory"))
    builder.ret(writer.result(result, answer))
    builder.position_at_end(writer.refuse)
    writer.python("PyErr_Clear")
    builder.ret(writer.constant("_Py_NotImplementedStruct"))

    packer = context.get_arg_packer(kinds)
    at = ir.Function(module, ir.FunctionType(context.get_value_type(answer), packer.argument_types), f"at.{name}")
    builder = ir.IRBuilder(at.append_basic_block())
    status, result = convention.call_function(builder, compiled, answer, kinds, packer.from_arguments(builder, at.args))
    builder.ret(result)
    return call.name, at.name


MEMORY = """
declare ptr @malloc(i64)
declare void @free(ptr)

define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %align64 = zext i32 %align to i64
  %room = add i64 %align64, 48
  %total = add i64 %size, %room
  %record = call ptr @malloc(i64 %total)
  %failed = icmp eq ptr %record, null
  br i1 %failed, label %done, label %fill
fill:
  %number = ptrtoint ptr %record to i64
  %end = add i64 %number, %room
  %rest = urem i64 %end, %align64
  %start = sub i64 %end, %rest
  %data = inttoptr i64 %start to ptr
  store i64 1, ptr %record
  %data_field = getelementptr i8, ptr %record, i64 24
  store ptr %data, ptr %data_field
  %size_field = getelementptr i8, ptr %record, i64 32
  store i64 %size, ptr %size_field
  br label %done
done:
  ret ptr %record
}

define void @NRT_MemInfo_call_dtor(ptr %record) {
  call void @free(ptr %record)
  ret void
}
"""
"""What numba's code asks of its run time library for an array that a kernel makes: a record (references, destructor, its argument, data,
size, allocator: six words), and the memory behind it; and both freed when the last reference is gone."""
