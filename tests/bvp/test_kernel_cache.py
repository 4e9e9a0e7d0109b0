"""Compiled kernels live in the user's cache folder, and are used exactly where they are valid."""

from __future__ import annotations

import ast
import errno
import functools
import importlib.metadata
import itertools
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import platformdirs
import pytest

from bvp.kernels import compiled, hook, stored
from bvp.kernels.linear import substitute

ROOT = Path(__file__).resolve().parents[2]
FILES = [file for package in ("bvp", "branches", "transitions") for file in (ROOT / package).rglob("*.py")]
KERNELS = sorted(file for file in FILES if "kernels" in file.with_suffix("").parts)
OUR_PACKAGES = {"bvp", "branches", "continuation", "transitions", "saltus"}


@functools.cache
def _imported(file):
    """The project's modules that a file imports when it is loaded, by Python's own parser."""
    found = set()
    for node in ast.parse(file.read_text()).body:
        names = [node.module] if isinstance(node, ast.ImportFrom) else [alias.name for alias in getattr(node, "names", [])]
        for name in names:
            if str(name).split(".")[0] in OUR_PACKAGES:
                place = ROOT / str(name).replace(".", "/")
                files = [place / alias.name for alias in node.names] if place.is_dir() else [place]
                found |= {path.with_suffix(".py") for path in files}
    return found


@pytest.mark.parametrize("file", KERNELS, ids=lambda file: "-".join(file.relative_to(ROOT).parts))
def test_all_that_a_kernel_is_compiled_from_is_hashed(file):
    """Oracle: the imports that Python's own parser finds. A constant from another file would be compiled in unseen."""
    found, waiting = set(), [file]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += _imported(path)
    assert set(stored.sources(file)) == found


@pytest.mark.parametrize("name", ["compiler.py", "entry_point.py", "indexing.py", "lent.py", "passes.py"])
def test_the_compiler_is_hashed(monkeypatch, name):
    """Oracle: another text of the compiler gives another folder."""
    before = stored._digest("bvp.kernels.flight", "")
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b"#" if path.name == name else read(path))
    assert stored._digest("bvp.kernels.flight", "") != before


def _other_version(name):
    """The versions of packages, with another one of a package."""
    return lambda package: "0.0.1" if package == name else importlib.metadata.version(package)


OTHERS = {
    "numba": (stored, "version", _other_version("numba")),
    "llvmlite": (stored, "version", _other_version("llvmlite")),
    "Python": (sys, "version", sys.version.replace("3.", "4.", 1)),
    "processor": (stored.llvm, "get_host_cpu_name", lambda: "another"),
    "features": (stored.llvm, "get_host_cpu_features", lambda: stored.llvm.FeatureMap(fma=False)),
    "nothing": (stored, "version", importlib.metadata.version),
}


@pytest.mark.parametrize("what", OTHERS)
def test_what_the_machine_code_depends_on_gives_another_folder(monkeypatch, tmp_path, what):
    """Oracle: the parts of the key, one changed at a time; nothing else does."""
    for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(stored, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(stored, "processor", stored.processor.__wrapped__)
    before = stored.folder_of.__wrapped__("bvp.kernels.flight")
    monkeypatch.setattr(*OTHERS[what])
    after = stored.folder_of.__wrapped__("bvp.kernels.flight")
    assert (after == before) is (what == "nothing") and after.parent == tmp_path


def test_kernels_of_one_name_in_two_files_have_different_code():
    """Oracle: code is linked by its name, and all of it is loaded into one place."""
    parts = itertools.product(("a", "b"), ("f", "g"), (("", "float"), ("", "integer")))
    names = {stored.symbol(*part) for part in parts}
    assert len(names) == 8


def test_functions_are_compiled_in_kernel_files_alone():
    """Oracle: the imports by Python's own parser. No other file declares a kernel or compiles one."""
    seen = 0
    for package in OUR_PACKAGES:
        for file in set((ROOT / package).rglob("*.py")) - set(KERNELS):
            text = file.read_text()
            seen += 1
            if not any(name in text for name in ("kernels", "numba")):
                continue
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.ImportFrom):
                    assert node.module not in ("bvp.kernels.compiled", "bvp.kernels.compiler", "numba"), file
    assert seen


def test_no_kernel_counts_from_the_end_of_an_array():
    """Oracle: all indices that Python's own parser finds in declared functions. Compiled code does not look at signs."""
    seen = 0
    for file in KERNELS:
        functions = [node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.FunctionDef) and node.decorator_list]
        for node in (node for function in functions for node in ast.walk(function) if isinstance(node, ast.Subscript)):
            for part in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
                for bound in (part.lower, part.upper, part.step) if isinstance(part, ast.Slice) else (part,):
                    seen += 1
                    is_negative = isinstance(bound, ast.UnaryOp) and isinstance(bound.op, ast.USub)
                    assert not is_negative, f"{file}:{node.lineno}"
    assert seen > 1000


INDEXED = """
import sys
import numpy as np
from bvp.kernels.compiled import kernel
from bvp.kernels import inner
x, out = np.arange(24.0).reshape(2, 3, 4), np.zeros((5, 4))
inner.pieces(x, 1, 2, out)
rows = x[1, 2], x[1, 1:3, 2], x[1, 2, :2], x[1, 2, 2:9], [3.0]
print(out.tolist() == [[*row, 0.0, 0.0, 0.0][:4] for row in rows])
"""
PIECES = """from bvp.kernels.compiled import kernel


@kernel
def pieces(x, i, j, out):
    for r in range(4):
        out[0, r] = x[i, j][r]
    column = x[i, i : j + 1, j]
    for r in range(column.shape[0]):
        out[1, r] = column[r]
    for r in range(j):
        out[2, r] = x[i, j, :j][r]
    part = x[i, j, j : j + 7]
    for r in range(part.shape[0]):
        out[3, r] = part[r]
    out[4, 0] = x[:, j:, i][0, j : i].shape[0] + x[i, :, 1:].shape[1]
"""


def test_indices_and_slices_are_those_of_numpy(project):
    """Oracle: numpy, of indices, of slices beyond an end, of empty ones, and of both together."""
    copy, inner, _ = project
    inner.write_text(PIECES)
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA", "PYTHON"))}
    done = subprocess.run([sys.executable, "-c", INDEXED], cwd=copy, env=clean, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


def runner(copy, place):
    """A call that runs a copy of the kernels in a new process, by default with a cache folder `place`: the value at 3, whether it was
    loaded, which takes no compiler, and what was written to standard error."""

    def run(kept=place, **environment):
        script = "import sys; from bvp.kernels.outer import outer; print(outer(3.0), int('numba' not in sys.modules))"
        place = {"NUMBA_CACHE_DIR": str(kept)} if kept else {}
        clean = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA", "PYTHON"))}
        # Python takes a file of equal size that changed within a second for the old one, if it has kept that.
        clean["PYTHONDONTWRITEBYTECODE"] = "1"
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=copy, env={**clean, **place, **environment}, capture_output=True, text=True, check=True
        )
        value, hits = done.stdout.split()
        return float(value), hits == "1", done.stderr

    return run


@pytest.fixture
def project(tmp_path):
    """A copy of the kernels with two more files, one of which calls the other, that second file, and its `runner`."""
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "bvp", copy / "bvp", ignore=shutil.ignore_patterns("__pycache__"))
    head = "from bvp.kernels.compiled import kernel\n"
    inner = copy / "bvp/kernels/inner.py"
    inner.write_text(head + "@kernel\ndef inner(x):\n    return 2.0 * x\n")
    outer = "from bvp.kernels.inner import inner\n@kernel\ndef outer(x):\n    return inner(x) + 1.0\n"
    (copy / "bvp/kernels/outer.py").write_text(head + outer)
    return copy, inner, runner(copy, tmp_path / "kept")


KEPT = {}


def after_a_run(project, tmp_path, tmp_path_factory):
    """The same after a first run. Copies of equal sources share their kernels, so these are compiled once for all tests."""
    _, inner, run = project
    text = inner.read_text()
    if text not in KEPT:
        folder = tmp_path_factory.mktemp("kept")
        assert run(folder) == (7.0, False, "")
        KEPT[text] = folder
    shutil.copytree(KEPT[text], tmp_path / "kept")
    return project


@pytest.fixture
def kept(project, tmp_path, tmp_path_factory):
    return after_a_run(project, tmp_path, tmp_path_factory)


@pytest.fixture
def kept_shared(project, tmp_path, tmp_path_factory):
    """The second file declares a shared kernel."""
    inner = project[1]
    inner.write_text(inner.read_text().replace("import kernel", "import shared").replace("@kernel", '@shared("float")'))
    return after_a_run(project, tmp_path, tmp_path_factory)


def test_kernels_are_loaded_where_nothing_changed_and_only_there(kept):
    """Oracle: the values by hand. A second process loads; a changed callee in another file, and another processor, compile anew."""
    copy, inner, run = kept
    assert run() == (7.0, True, "")
    assert run(NUMBA_CPU_NAME="generic") == (7.0, False, "")
    text = inner.read_text()
    inner.write_text(text.replace("2.0", "5.0"))
    assert run() == (16.0, False, "")
    inner.write_text(text)
    assert run() == (7.0, True, "")
    assert not [file for file in copy.rglob("outer-*")]


def test_kernels_are_kept_in_the_cache_folder_of_the_user(kept, tmp_path, monkeypatch):
    """Oracle: the place that platformdirs gives."""
    _, _, run = kept
    for name in ("XDG_CACHE_HOME", "HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path / "user"))
    shutil.copytree(tmp_path / "kept/saltus-kernels", platformdirs.user_cache_path("saltus", appauthor=False) / "kernels")
    assert run(kept=None) == (7.0, True, "")


KINDS = """
from typing import NamedTuple
from bvp.kernels.compiled import chosen, shared

class One(NamedTuple):
    x: float

@chosen
def inner(one):
    pass

@inner.of(One)
@shared("float")
def inner_of_one(one):
    return 2.0 * one.x
"""


def test_a_shared_kind_is_code_of_its_own(project, tmp_path):
    """Oracle: the value by hand, and the files of machine code."""
    copy, inner, run = project
    inner.write_text(KINDS)
    outer = copy / "bvp/kernels/outer.py"
    outer.write_text(outer.read_text().replace("import inner", "import One, inner").replace("inner(x)", "inner(One(x))"))
    assert run() == (7.0, False, "")
    assert {file.name.split("-")[0] for file in (tmp_path / "kept").rglob("*-*") if file.is_file()} == {"inner_of_one", "outer"}


FAR = """
import ctypes, sys
from bvp.kernels.inner import inner
from bvp.kernels.outer import outer
reserve = ctypes.CDLL(None).mmap
reserve.restype, reserve.argtypes = ctypes.c_void_p, (ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long)
inner(3.0)
for size, times in (1 << 32, 1), (1 << 16, 30_000), (1 << 12, 20_000):
    for _ in range(times):
        reserve(None, size, 0, 0x4022, -1, 0)
print(outer(3.0), int(abs(outer.entry(3.0).address - inner.entry(3.0).address) > 1 << 31))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the numbers of mmap are those of Linux")
def test_a_shared_kernel_can_be_far_from_its_callers(kept_shared, tmp_path):
    """Oracle: the values by hand. Between the loading of both, all gaps near the first are reserved, and 4 GB."""
    copy, _, _ = kept_shared
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    done = subprocess.run([sys.executable, "-c", FAR], cwd=copy, env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.split()[0] == "7.0", done.stderr
    if done.stdout.split()[1] == "0":
        pytest.skip("this system has room near the first object all the same")


TRAPPED = """
import ctypes, os, sys
import numpy as np
from llvmlite import binding as llvm
from bvp.kernels import compiled, stored
from bvp.kernels.flight import flow_state
from bvp.system import vibro_impact_nes
from saltus.__main__ import main
from tests.bvp.test_modes import exceptional_point

trap = ctypes.CFUNCTYPE(None)(lambda: os._exit(77))
real, trapped = stored.entry_of, []

def entry_of(code, name):
    if not name.startswith(("block_matrix-", "block_state-")):
        return real(code, name)
    trapped.append(name)
    address = ctypes.cast(trap, ctypes.c_void_p).value
    llvm.add_symbol("at." + name, address)
    return stored.Entry(None, address)

stored.entry_of = compiled.entry_of = entry_of

def flown(system):
    z = np.ones(4)
    flow_state(system.modes.flight, z, 1.0, np.empty(4))

flown(vibro_impact_nes())
code = main(["continue", "S13O00+", "--energy", "0.5:0.7", "--json", os.devnull])
print(code, "block_state" in {name.partition("-")[0] for name in trapped}, flush=True)
flown(exceptional_point() if len(sys.argv) > 1 else vibro_impact_nes())
"""


def test_two_undamped_modes_need_no_exponential_of_a_larger_block():
    """Oracle: another function in place of those that call `flow_block`, which ends the process: a run without damping goes on, and
    a flight at the point where two pairs of damped modes become one does not."""
    for arguments, code in (((), 0), (("damped",), 77)):
        command = [sys.executable, "-c", TRAPPED, *arguments]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert done.stdout.splitlines()[-1] == "0 True"


@pytest.mark.skipif(os.name != "posix", reason="owners of folders are those of POSIX")
@pytest.mark.parametrize("given_away", [False, True])
@pytest.mark.parametrize("inner", [False, True])
def test_a_folder_that_others_can_write_to_is_not_used(monkeypatch, tmp_path, given_away, inner):
    """Oracle: the mode and the owner that the system gives: of the folder of all kernels, and of that of a file in it."""
    if given_away and os.geteuid() != 0:
        pytest.skip("only the administrator gives folders away")
    module = "bvp.kernels.flight"
    monkeypatch.setattr(stored, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(stored, "folder_of", lambda module: tmp_path / module)
    monkeypatch.setattr(stored, "_shipped", lambda module: None)
    monkeypatch.setattr(stored, "unread", stored.unread.__wrapped__)
    stored.keep(module, "name", stored.sealed(b"code", []))
    assert len(list(stored.whole(module, "name"))) == 1 and not stored.unkept(module)
    folder = tmp_path / module if inner else tmp_path
    if given_away:
        os.chown(folder, 1, -1)
    else:
        folder.chmod(0o777)
    assert not list(stored.whole(module, "name"))
    assert stored.unkept(module) == f"others can write to the folder {folder}; remove it, and it is made anew"
    stored.keep(module, "other", stored.sealed(b"code", []))
    assert [file.name for file in (tmp_path / module).iterdir()] == ["name"]


def test_a_full_disk_keeps_no_parts_of_files(monkeypatch, tmp_path):
    """Oracle: the folder, after a write that failed half way."""

    def fill(path, file):
        with path.open("wb") as opened:
            opened.write(file[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(stored, "unread", lambda module: "")
    monkeypatch.setattr(stored, "folder_of", lambda module: tmp_path / module)
    monkeypatch.setattr(Path, "write_bytes", fill)
    stored.keep("module", "name", stored.sealed(b"code", []))
    assert list((tmp_path / "module").iterdir()) == []


def test_an_entry_can_be_deleted_after_all_modules():
    """Python collects the cycle when all modules are gone. Oracle: the process ends well, with freed memory overwritten (by glibc)."""
    lines = (
        "import numpy as np",
        "from bvp.kernels.flight import times_matrix",
        "arguments = np.eye(2), np.ones(2), np.zeros(2)",
        "kept = [times_matrix.entry(*arguments).call]",
        "assert kept[0](*arguments) is None and arguments[2].tolist() == [1.0, 1.0]",
        "kept.append(kept)",
    )
    environment = {**os.environ, "PYTHONMALLOC": "malloc", "MALLOC_PERTURB_": "2"}
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr


def test_a_kernel_without_machine_code_can_run_in_python(monkeypatch):
    """Oracle: the same kernel, compiled. Python does not divide by zero."""
    monkeypatch.setattr(hook, "before_compiling", None)
    monkeypatch.setattr(compiled, "load", lambda module, name: None)
    monkeypatch.setattr(compiled, "keep", lambda module, name, file: None)
    factors, pivots, column = np.array([[2.0, 0.7], [0.5, 3.0]]), np.arange(2), np.array([1.0, -0.3])
    solve, divide = (compiled.Kernel(function, _nrt=False) for function in (substitute.function, inverse))
    with hook.interpreted():
        solve(factors, pivots, found := column.copy())
        assert not solve.entries
        assert divide(2.0) == 0.5 and not divide.entries
        with pytest.raises(hook.NotInterpretedError, match="inverse: float division by zero"):
            divide(0.0)
    assert divide(0.0) == math.inf and divide.entries
    solve(factors, pivots, column)
    assert solve.entries and np.array_equal(found, column)


def inverse(x):
    return 1.0 / x
