"""Where the machine code of kernels is kept, and how it is loaded. That takes no compiler.

Each kernel file has a folder of its own in the cache. The folder's name contains a hash of all that the machine code depends on: the
file, the project's files that it imports, the versions of Python, numba and llvmlite, and the processor. A changed callee in another file
is thus noticed, and copies of saltus with equal sources share their kernels.
"""

import ctypes
import hashlib
import importlib
import json
import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from llvmlite import binding as llvm

DAY = 86_400.0
_KEPT_DAYS = 30.0
"""A folder that was not used for so long is removed."""
_ROOM = 8_000_000
"""Bytes that all kernels take, about."""

_SOURCES = Path(__file__).resolve().parents[2]
_COMPILER = [Path(__file__).with_name(f"{name}.py") for name in ("compiler", "entry_point", "fours", "indexing", "lent", "passes")]
_IMPORT = re.compile(rb"^from ((?:bvp|branches|continuation|transitions)\.[\w.]+) import \(?\s*(\w+)", re.MULTILINE)

# -- the cache folder ---------------------------------------------------------------------------------------------------------------


@cache
def cache_root() -> Path:
    """The folder of all compiled kernels, below `NUMBA_CACHE_DIR` where that is set."""
    place = os.environ.get("NUMBA_CACHE_DIR")
    if place:
        return Path(place) / "saltus-kernels"
    from platformdirs import user_cache_path

    return user_cache_path("saltus", appauthor=False) / "kernels"


@cache
def unread(module: str) -> str:
    """Why no kernel of a file is read from the cache; empty where they are. Its folder is made, without that of the file.

    Who can write machine code there could run it as this user. What the administrator wrote is read.
    """
    root = cache_root()
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        for folder in (root, folder_of(module)):
            if os.name == "posix" and folder.exists():
                status = folder.stat()
                if status.st_uid not in (0, os.geteuid()) or status.st_mode & 0o022:
                    return f"others can write to the folder {folder}; remove it, and it is made anew"
    except OSError as error:
        return f"cannot make the folder {root}: {error.strerror}"
    return ""


def unkept(module: str) -> str:
    """Why kernels of a file that are compiled now are not there at the next run; empty where they are."""
    folder = folder_of(module)
    return unread(module) or _unwritten(folder if folder.is_dir() else cache_root())


@cache
def _unwritten(folder: Path) -> str:
    """Why kernels cannot be written to a folder; empty where they can."""
    import tempfile

    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_ROOM))
    except OSError as error:
        return f"cannot write to the folder {folder}: {error.strerror}"
    return ""


@cache
def sources(path: Path) -> dict[Path, bytes]:
    """The contents of a kernel file and of all the project's files that it imports, directly or not."""
    text = path.read_bytes()
    found = {path: text}
    for module, name in _IMPORT.findall(text):
        place = _SOURCES.joinpath(*module.decode().split("."))
        found |= sources((place / name.decode() if place.is_dir() else place).with_suffix(".py"))
    return found


def require_imported(module: str, other: str) -> None:
    """Refuse machine code of a kernel file that depends on another file which it does not import: that one is not in its key."""
    paths = [_SOURCES.joinpath(*name.split(".")).with_suffix(".py") for name in (module, other)]
    if paths[1] not in sources(paths[0]):
        raise TypeError(f"a kernel of {module} contains one of {other}, which it does not import")


@cache
def processor() -> tuple[str, str]:
    """The name and the features of this processor, as LLVM writes them; `NUMBA_CPU_NAME` and `NUMBA_CPU_FEATURES` replace them."""
    name, features = os.environ.get("NUMBA_CPU_NAME"), os.environ.get("NUMBA_CPU_FEATURES")
    return name or llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten() if features is None else features


@cache
def folder_of(module: str) -> Path:
    """The folder of a kernel file in the cache. Its date is renewed, about once a day, where it exists."""
    machine = repr((sys.version, version("numba"), version("llvmlite"), *processor()))
    folder = cache_root() / f"{module}-{_digest(module, machine)}"
    with suppress(OSError):
        if time.time() - folder.stat().st_mtime > DAY:
            os.utime(folder)
    return folder


def _digest(module: str, machine: str) -> str:
    """The hash of all that the machine code of a kernel file depends on."""
    digest = hashlib.sha256(f"{module} {machine}".encode())
    compiler = {file: file.read_bytes() for file in _COMPILER}
    for file, text in sorted((sources(_SOURCES.joinpath(*module.split(".")).with_suffix(".py")) | compiler).items()):
        digest.update(f"\n{file.stem} {len(text)}\n".encode() + text)
    return digest.hexdigest()[:24]


class Level(NamedTuple):
    """The processors that wheels are compiled for."""

    name: str  # as LLVM writes it
    features: tuple[str, ...]  # that they have beyond the least of their kind


_V3 = Level("x86-64-v3", ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"))
_LEVELS = {"x86_64": _V3, "amd64": _V3, "aarch64": Level("generic", ()), "arm64": Level("generic", ())}
_SHIPPED = Path(__file__).with_name("shipped")


def level() -> Level | None:
    """That of wheels for this kind of machine."""
    return _LEVELS.get(platform.machine().lower())


def shipped_name(module: str, level: Level) -> str:
    """The name of the folder of a kernel file in a wheel."""
    return f"{module}-{_digest(module, repr((sys.version_info[:2], sys.platform, level.name)))}"


@cache
def _shipped(module: str) -> Path | None:
    """The folder of a kernel file in the wheel; None where there is none for this processor."""
    found = level() if _SHIPPED.is_dir() else None
    if found is None or not all(llvm.get_host_cpu_features().get(feature) for feature in found.features):
        return None
    return _SHIPPED / shipped_name(module, found)


def whole(module: str, symbol: str) -> Iterator[bytes]:
    """The files with the machine code of a kernel that are not damaged (`sealed`): in a wheel, then in the cache."""
    for folder in (_shipped(module), None if unread(module) else folder_of(module)):
        if folder is not None:
            with suppress(OSError):
                file = (folder / symbol).read_bytes()
                if hashlib.sha256(file[_DIGEST:]).digest() == file[:_DIGEST]:
                    yield file


def symbol(module: str, name: str, types: Any) -> str:
    """The name of the machine code of a kernel of a file for arguments of some types (`types_of`). No two kernels have the same, so that
    code is linked to what it calls by it."""
    return f"{name}-{hashlib.sha256(repr((module, types)).encode()).hexdigest()[:16]}"


def keep(module: str, symbol: str, file: bytes) -> None:
    """Write machine code (`sealed`) to the cache. With a new folder, remove those of former sources and versions."""
    if unread(module):
        return
    folder = folder_of(module)
    beside = folder / f"{symbol}.{os.getpid()}"
    with suppress(OSError):  # the folder cannot be written, or the disk is full
        if not folder.is_dir():
            folder.mkdir(mode=0o700, exist_ok=True)
            for entry in os.scandir(folder.parent):
                with suppress(OSError):  # another process removed it first
                    if time.time() - entry.stat(follow_symlinks=False).st_mtime > _KEPT_DAYS * DAY:
                        shutil.rmtree(entry.path, ignore_errors=True)
        try:
            beside.write_bytes(file)
            beside.replace(folder / symbol)
        finally:
            beside.unlink(missing_ok=True)


# -- types of arguments -------------------------------------------------------------------------------------------------------------


def types_of(value: Any) -> Any:
    """What the compiled code must know of an argument: of an array its items, dimensions and layout, of a tuple its class and parts.

    Examples
    --------
    >>> types_of((np.zeros((2, 3)), 1, 0.5, True))
    ('', 'float64 2 C', 'integer', 'float', 'boolean')
    """
    if isinstance(value, np.ndarray):
        layout = "C" if value.flags.c_contiguous else "A"
        return f"{value.dtype.name} {value.ndim} {layout}{'' if value.flags.writeable else ' read-only'}"
    if isinstance(value, tuple):
        kind = type(value)
        return "" if kind is tuple else f"{kind.__module__}.{kind.__qualname__}", *map(types_of, value)
    for name, kinds in _NUMBERS.items():
        if isinstance(value, kinds):
            return name
    raise TypeError(f"a kernel takes arrays, numbers and tuples of them, not {type(value).__name__}")


_NUMBERS = {"boolean": bool | np.bool_, "integer": int | np.integer, "float": float | np.floating}


# -- loading ------------------------------------------------------------------------------------------------------------------------


class Entry(NamedTuple):
    """A kernel compiled for some types of arguments."""

    call: Callable[..., Any]  # from Python; gives NotImplemented where the arguments have other types
    address: int  # in memory


_DIGEST = 32
_FASTCALL = 0x80
"""METH_FASTCALL of Python's interface for C: the arguments come in an array."""


def load(module: str, name: str) -> Any:
    """The `Entry` of a kernel that is on disk; None where it is not."""
    return next((entry_of(file, name) for file in whole(module, name)), None)


class _Method(ctypes.Structure):
    """PyMethodDef of Python's interface for C."""

    _fields_ = (("name", ctypes.c_char_p), ("call", ctypes.c_void_p), ("flags", ctypes.c_int), ("text", ctypes.c_char_p))


@cache
def _engine() -> Any:
    """What puts machine code into memory."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    # The sections of one object are kept together: its code reaches its constants by distances of 32 bits.
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine, use_lmm=True)


def sealed(code: bytes, callees: Any) -> bytes:
    """A file of the cache: a hash; a line of JSON with module, name and types of the shared kernels that the code calls; the code, an
    object file."""
    content = json.dumps(callees).encode() + b"\n" + code
    return hashlib.sha256(content).digest() + content


def types_from(value: Any) -> Any:
    """Types of arguments (`types_of`) as they were before they were written as JSON."""
    return tuple(map(types_from, value)) if isinstance(value, list) else value


def entry_of(file: bytes, name: str) -> Entry:
    """The `Entry` of the kernel in a file of the cache."""
    callees, _, machine_code = file[_DIGEST:].partition(b"\n")
    for module, kernel, types in json.loads(callees):
        getattr(importlib.import_module(module), kernel).entry_for(types_from(types))
    engine = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(machine_code))
    engine.finalize_object()
    method = _Method(name.encode(), engine.get_function_address(f"call.{name}"), _FASTCALL, None)
    # The function reads its method when it is deleted, at the end of Python after all modules. So the method is never deleted.
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(method))
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, (ctypes.POINTER(_Method), ctypes.py_object, ctypes.c_void_p)
    return Entry(make(ctypes.byref(method), np.ndarray, None), engine.get_function_address(f"at.{name}"))
