"""The cache of compiled kernels in the user's cache folder, never among the sources.

Each kernel file has a folder of its own. The folder's name contains a hash of all that the machine code depends on: the file, the project's
files that it imports, the versions of Python, numba and llvmlite, and the processor. A changed callee in another file is thus noticed, and
copies of saltus with equal sources share their kernels.
"""

import hashlib
import multiprocessing
import os
import re
import shutil
import sys
import time
import warnings
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite.binding import get_host_cpu_name
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.codegen import get_host_cpu_features

DAY = 86_400.0
_KEPT_DAYS = 30.0
"""A folder that was not used for so long is removed."""

config: Any = numba.core.config
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
    usable, reason = _examined(root)
    if reason and multiprocessing.parent_process() is None:
        warnings.warn(f"compiled kernels are not kept for the next run: {reason}", RuntimeWarning, stacklevel=2)
    return root if usable else None


def keeps() -> bool:
    """Whether kernels that are compiled now are there at the next run."""
    root = cache_root()
    return root is not None and os.access(root, os.W_OK)


def stored(kernel: Any) -> bool:
    """Whether compiled code of a kernel is on disk."""
    folder, name = kernel.stats.cache_path, kernel.py_func.__name__
    if folder is None or not os.path.isdir(folder):
        return False
    return any(f".{name}-" in entry or entry.startswith(f"{name}-") for entry in os.listdir(folder))


def sources(path: Path) -> dict[Path, bytes]:
    """The contents of a kernel file and of all the project's files that it imports, directly or not.

    Parameters
    ----------
    path : Path
        A file that defines kernels.
    """
    found: dict[Path, bytes] = {}
    waiting = [path]
    while waiting:
        file = waiting.pop()
        if file not in found:
            found[file], imported = _read(file)
            waiting.extend(imported)
    return found


def _examined(root: Path) -> tuple[bool, str]:
    """Whether the folder may be read, and why nothing is kept in it (empty: it is kept)."""
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = root.stat()
    except OSError as error:
        return False, f"cannot make the folder {root}: {error.strerror}"
    if os.name == "posix" and (status.st_uid not in (0, os.geteuid()) or status.st_mode & 0o022):
        return False, f"others can write to the folder {root}; remove it, and it is made anew"
    return True, "" if os.access(root, os.W_OK) else f"cannot write to the folder {root}"


@cache
def _read(path: Path) -> tuple[bytes, list[Path]]:
    """The contents of a file, and the project's files that it imports when it is loaded."""
    text = path.read_bytes()
    imported = []
    for module, name in _IMPORT.findall(text):
        place = _SOURCES.joinpath(*module.decode().split("."))
        imported.append((place / name.decode() if place.is_dir() else place).with_suffix(".py"))
    return text, imported


@cache
def _folder(module: str, path: Path) -> Path:
    """The folder of a kernel file. Its date is renewed, about once a day, where it exists."""
    root = cache_root()
    assert root is not None  # where there is none, nothing is kept
    features = get_host_cpu_features() if config.CPU_FEATURES is None else config.CPU_FEATURES
    machine = repr((sys.version, numba.__version__, llvmlite.__version__, config.CPU_NAME or get_host_cpu_name(), features))
    digest = hashlib.sha256(f"{module} {machine}".encode())
    for file, text in sorted(sources(path).items()):
        digest.update(f"\n{file.stem} {len(text)}\n".encode() + text)
    folder = root / f"{module}-{digest.hexdigest()[:24]}"
    try:
        if time.time() - folder.stat().st_mtime > DAY:
            os.utime(folder)
    except OSError:
        pass
    return folder


@dataclass
class _Locator(_CacheLocator):
    """Finds the folder of a function's compiled code."""

    folder: Path
    line: int

    @classmethod
    def from_function(cls, py_func, py_file):
        return cls(_folder(py_func.__module__, Path(py_file).resolve()), py_func.__code__.co_firstlineno)

    def get_cache_path(self):
        return str(self.folder)

    def get_source_stamp(self):
        return self.folder.name

    def get_disambiguator(self):
        return str(self.line)

    def ensure_cache_path(self):
        if not self.folder.is_dir():
            self.folder.mkdir(mode=0o700, exist_ok=True)
            _remove_unused(self.folder.parent)


class _Impl(CompileResultCacheImpl):
    _locator_classes = [_Locator]


class KernelCache(FunctionCache):
    """Numba's cache, for which a file that cannot be read or written is no failure: the kernel is compiled."""

    _impl_class = _Impl

    def load_overload(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling a damaged file can raise anything
            self._forget()
            return None

    def save_overload(self, sig, data):
        try:
            super().save_overload(sig, data)
        except OSError:  # the folder cannot be written, or the disk is full
            pass

    def _forget(self):
        try:
            self.flush()
        except OSError:
            pass


def _remove_unused(root: Path) -> None:
    """Remove the folders that were not used for a long time: of former sources, of former versions."""
    for entry in os.scandir(root):
        try:
            if time.time() - entry.stat(follow_symlinks=False).st_mtime > _KEPT_DAYS * DAY:
                shutil.rmtree(entry.path, ignore_errors=True)
        except OSError:  # another process removed it first
            pass
