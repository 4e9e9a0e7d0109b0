"""How the core is built: what a machine lacks is found, and the module loads nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import backend

COMPILES = "#!/bin/sh\nexit 0\n"
FAILS = "#!/bin/sh\necho 'unknown option' >&2; exit 1\n"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A function that makes a machine which has some programs, given by their text, and nothing else."""
    if os.name != "posix":
        pytest.skip("the programs are scripts of a POSIX shell")

    def make(**programs):
        for name, text in programs.items():
            program = tmp_path / name.replace("_plus", "+")
            program.write_text(text)
            program.chmod(0o755)

    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(backend, "BUILD", tmp_path / "build")
    return make


def prints(text):
    return f"#!/bin/sh\necho '{text}'\n"


def test_a_bare_machine_lacks_a_compiler_and_its_tools(machine):
    machine()
    assert backend.compiler() is None
    assert backend.missing() == ["cmake", "ninja", "ziglang"]
    assert backend.build_folder().name == f"core-{sys.implementation.cache_tag}-zig"


@pytest.mark.parametrize("name", ["c_plus_plus", "g_plus_plus", "clang_plus_plus"])
def test_what_the_machine_has_is_not_required(machine, name):
    machine(cmake=prints("cmake version 3.25.1"), ninja=prints("1.11.1"), **{name: COMPILES})
    assert backend.missing() == []
    assert backend.compiler() == [name.replace("_plus", "+")]
    assert backend.build_folder().name == f"core-{sys.implementation.cache_tag}-{backend.compiler()[0]}"


def test_what_is_too_old_is_required(machine):
    """Oracle: a CMake before 3.18 does not find a Python without its library, and a compiler that fails does not know C++20."""
    machine(cmake=prints("cmake version 3.16.3"), ninja=FAILS, c_plus_plus=FAILS, g_plus_plus=FAILS)
    assert backend.missing() == ["cmake", "ninja", "ziglang"]
    machine(clang_plus_plus=COMPILES, cmake=prints("cmake version 4.0.0"))
    assert backend.missing() == ["ninja"]


def test_the_compiler_is_asked_for_cpp20(machine):
    """Oracle: the arguments and the text that a program receives in the place of the compiler."""
    machine(c_plus_plus=FAILS, g_plus_plus='#!/bin/sh\nread line\n[ "$1 $line" = "-std=c++20 #include <span>" ]\n')
    assert backend.compiler() == ["g++"]


def test_cxx_decides(machine, monkeypatch):
    machine(c_plus_plus=COMPILES)
    monkeypatch.setenv("CXX", "/opt/clang/bin/clang++ --gcc-toolchain=/opt/gcc")
    assert backend.compiler() == ["/opt/clang/bin/clang++", "--gcc-toolchain=/opt/gcc"]
    monkeypatch.setenv("CXX", "zig")
    assert backend.compiler() is None and "ziglang" in backend.missing()


def test_a_kept_compiler_is_not_loaded_again(machine):
    machine()
    (backend.BUILD / "ziglang-0.17.1").mkdir(parents=True)
    (backend.BUILD / "ziglang-0.17.2.part").mkdir()  # its copy was interrupted
    assert backend.missing() == ["cmake", "ninja"]
    assert backend.kept("ziglang").name == "ziglang-0.17.1"


@pytest.mark.parametrize("hook", ["get_requires_for_build_wheel", "get_requires_for_build_editable"])
def test_the_hooks_require_what_is_missing(machine, monkeypatch, hook):
    machine(c_plus_plus=COMPILES)
    monkeypatch.setattr(backend.build_meta, hook, lambda settings: ["first"])
    assert getattr(backend, hook)() == ["first", "cmake", "ninja"]


def test_the_core_is_imported_without_numba():
    """Oracle: the modules that a new process has loaded. The module knows what it was compiled by."""
    code = "import sys, saltus_core; print({'numba', 'llvmlite', 'bvp'} & set(sys.modules), bool(saltus_core.compiler))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "set() True\n"


def test_no_flag_permits_other_roundings():
    """Oracle: the words of the build. Fast mathematics, contraction and the machine's own instructions change bits."""
    text = (Path(backend.ROOT) / "bvp" / "core" / "CMakeLists.txt").read_text()
    assert "-ffp-contract=off" in text
    assert not any(word in text for word in ("-ffast-math", "-Ofast", "-march", "/fp:fast", "-funsafe", "-fassociative"))
