"""How kernels are compiled, and kept in the user's cache folder. As for arrays, division by zero gives inf or nan.

Each kernel file has a folder of its own in the cache. The folder's name contains a hash of all that the machine code depends on: the
file, the project's files that it imports, the versions of Python, numba and llvmlite, and the processor. A changed callee in another file
is thus noticed, and copies of saltus with equal sources share their kernels.
"""

import gc
import hashlib
import multiprocessing
import os
import re
import shutil
import sys
import time
import warnings
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite
import numba as nb
from llvmlite import ir
from llvmlite.binding import get_host_cpu_name
from numba.core import cgutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, NullCache
from numba.core.codegen import get_host_cpu_features
from numba.experimental.function_type import _get_wrapper_address
from numba.extending import intrinsic

DAY = 86_400.0
_KEPT_DAYS = 30.0
"""A folder that was not used for so long is removed."""

config: Any = nb.core.config
_SOURCES = Path(__file__).resolve().parents[2]
_IMPORT = re.compile(rb"^from ((?:bvp|branches|continuation|transitions)\.[\w.]+) import \(?\s*(\w+)", re.MULTILINE)


@cache
def cache_root() -> Path | None:
    """The folder of all compiled kernels, below `NUMBA_CACHE_DIR` where that is set. It is made where it does not exist.

    Returns
    -------
    Path or None
        None where the folder cannot be made, or where others can write to it: its files are pickles, so reading one runs code. A warning
        gives the reason.
    """
    if config.CACHE_DIR:
        root = Path(config.CACHE_DIR) / "saltus-kernels"
    else:
        from platformdirs import user_cache_path

        root = user_cache_path("saltus", appauthor=False) / "kernels"
    usable, reason = False, ""
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = root.stat()
        usable = os.name != "posix" or (status.st_uid in (0, os.geteuid()) and not status.st_mode & 0o022)
        if not usable:
            reason = f"others can write to the folder {root}; remove it, and it is made anew"
        elif not os.access(root, os.W_OK):
            reason = f"cannot write to the folder {root}"
    except OSError as error:
        reason = f"cannot make the folder {root}: {error.strerror}"
    if reason and multiprocessing.parent_process() is None:
        warnings.warn(f"compiled kernels are not kept for the next run: {reason}", RuntimeWarning, stacklevel=2)
    return root if usable else None


def keeps() -> bool:
    """Whether kernels that are compiled now are there at the next run."""
    root = cache_root()
    return root is not None and os.access(root, os.W_OK)


def stored(kernel: Any) -> bool:
    """Whether compiled code of a kernel is on disk."""
    folder = kernel.stats.cache_path
    return folder is not None and any(Path(folder).glob(f"*.{kernel.py_func.__name__}-*"))


@cache
def sources(path: Path) -> dict[Path, bytes]:
    """The contents of a kernel file and of all the project's files that it imports, directly or not."""
    text = path.read_bytes()
    found = {path: text}
    for module, name in _IMPORT.findall(text):
        place = _SOURCES.joinpath(*module.decode().split("."))
        found |= sources((place / name.decode() if place.is_dir() else place).with_suffix(".py"))
    return found


@cache
def _folder(module: str, path: Path) -> Path:
    """The folder of a kernel file. Its date is renewed, about once a day, where it exists."""
    root = cache_root()
    assert root is not None  # where there is none, nothing is kept
    features = get_host_cpu_features() if config.CPU_FEATURES is None else config.CPU_FEATURES
    machine = repr((sys.version, nb.__version__, llvmlite.__version__, config.CPU_NAME or get_host_cpu_name(), features))
    digest = hashlib.sha256(f"{module} {machine}".encode())
    for file, text in sorted(sources(path).items()):
        digest.update(f"\n{file.stem} {len(text)}\n".encode() + text)
    folder = root / f"{module}-{digest.hexdigest()[:24]}"
    with suppress(OSError):
        if time.time() - folder.stat().st_mtime > DAY:
            os.utime(folder)
    return folder


class KernelCache(FunctionCache):
    """Numba's cache, for which a file that cannot be read or written is no failure: the kernel is compiled.

    It replaces numba's search for a folder and its time stamp of the source: `_folder` contains both."""

    def __init__(self, function: Any):
        file = Path(function.__code__.co_filename).resolve()
        folder = _folder(function.__module__, file)
        name = f"{file.stem}.{function.__qualname__}-{function.__code__.co_firstlineno}"
        self._name, self._py_func, self._cache_path = name, function, str(folder)
        self._impl = CompileResultCacheImpl.__new__(CompileResultCacheImpl)
        self._impl._locator = self
        self._cache_file = IndexDataCacheFile(self._cache_path, name, folder.name)
        self.enable()

    def load_overload(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling a damaged file can raise anything
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig, data):
        with suppress(OSError):  # the folder cannot be written, or the disk is full
            super().save_overload(sig, data)

    def ensure_cache_path(self):
        """Make the folder, as numba asks before it writes; with a new one, remove those of former sources and versions."""
        folder = Path(self._cache_path)
        if folder.is_dir():
            return
        folder.mkdir(mode=0o700, exist_ok=True)
        for entry in os.scandir(folder.parent):
            with suppress(OSError):  # another process removed it first
                if time.time() - entry.stat(follow_symlinks=False).st_mtime > _KEPT_DAYS * DAY:
                    shutil.rmtree(entry.path, ignore_errors=True)


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


kernel: Any = partial(_made, _nrt=False)
"""Compile a function of plain arrays and numbers, without Python objects, that makes and returns no arrays.

Views of its arguments are not reference-counted, since the caller holds the arrays. Counting costs more than short sums."""

inlined: Any = partial(_made, forceinline=True, _nrt=False)
"""A kernel whose machine code becomes part of each caller.

The compiler then uses facts that the caller knows, such as a `sized` length. No arrays are passed, which for a dozen arrays takes longer
than a short flight. Use it for kernels with few callers. For a short kernel with one caller, `part` compiles faster."""

allocating: Any = partial(_made, _nrt=True)
"""Compile a function that makes arrays. Only such a function may call another one that returns an array."""

part: Any = partial(_made, inline="always")
"""Compile a function as part of the kernel that calls it.

Use it for a function with one caller, since each separate function costs about a second of compilation. Use it also for a few lines
inside a loop, if a call would cost more than the lines."""


def compiled_for(function: Any, arguments: tuple[Any, ...]) -> tuple[Any, int]:
    """A kernel compiled for given argument types: what Python calls, and the memory address for `call_at` and `integer_at`.

    What Python calls does not check its arguments. For a few named tuples, a check takes longer than a step along a family."""
    types = tuple(nb.typeof(argument) for argument in arguments)
    entry_point = function.compile(types)
    return entry_point, _get_wrapper_address(function, function.overloads[types].signature)


@dataclass(eq=False)
class Direct:
    """A kernel that Python calls without a check of the arguments, as `compiled_for` makes it: their types are those of the first call."""

    function: Any
    entry_point: Any = None

    def __call__(self, *arguments: Any) -> Any:
        if self.entry_point is None:
            self.entry_point, _ = compiled_for(self.function, arguments)
        return self.entry_point(*arguments)


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
