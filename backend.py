"""The build backend: that of setuptools, and the compilation of the core with CMake.

A machine without a compiler of C++20 gets one from the package index: zig, which contains clang. To compile the core by hand, install
cmake, ninja and nanobind, then call `python backend.py FOLDER [arguments of CMake]`. It prints the path of the module.
"""

import importlib.metadata
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403  the other hooks are those of setuptools

ROOT = Path(__file__).resolve().parent
BUILD = ROOT / "build"
TOOLS = {"cmake": (3, 18), "ninja": (1, 5)}
"""What compiles the core, with the oldest version of each that does."""


def output(command, text=""):
    """What a command prints; None if there is none of its name or if it fails."""
    try:
        done = subprocess.run(command, input=text, capture_output=True, text=True)
    except OSError:
        return None
    return None if done.returncode else done.stdout


def compiler():
    """The command of this machine's compiler: CXX, or the first that knows C++20. It is empty for Visual Studio, which CMake finds, and
    None where there is no compiler or CXX is `zig`."""
    given = shlex.split(os.environ.get("CXX", ""))
    if given:
        return None if given == ["zig"] else given
    if os.name == "nt":
        finder = Path(os.environ.get("ProgramFiles(x86)", ""), "Microsoft Visual Studio", "Installer", "vswhere.exe")
        if output([finder, "-products", "*", "-requires", "Microsoft.VisualStudio.Component.VC.Tools.x86.x64"]):
            return []
    trial = ["-std=c++20", "-fsyntax-only", "-x", "c++", "-"]
    return next(([name] for name in ("c++", "g++", "clang++") if output([name, *trial], "#include <span>\n") is not None), None)


def missing():
    """The packages of the index that replace what this machine lacks."""
    found = {tool: re.search(r"(\d+)\.(\d+)", output([tool, "--version"]) or "0.0") for tool in TOOLS}
    packages = [tool for tool, oldest in TOOLS.items() if tuple(map(int, found[tool].groups())) < oldest]
    return packages if compiler() is not None or kept("ziglang") else [*packages, "ziglang"]


def get_requires_for_build_wheel(config_settings=None):
    return [*build_meta.get_requires_for_build_wheel(config_settings), *missing()]


def get_requires_for_build_editable(config_settings=None):
    return [*build_meta.get_requires_for_build_editable(config_settings), *missing()]


def kept(package):
    """A copy of a package, or None. pip builds in a new environment each time. With new files, all would be compiled again."""
    found = importlib.util.find_spec(package)
    if found is None:
        return max(BUILD.glob(f"{package}-*[0-9]"), default=None)
    folder = BUILD / f"{package}-{importlib.metadata.version(package)}"
    if not folder.is_dir():
        shutil.copytree(found.submodule_search_locations[0], f"{folder}.part", dirs_exist_ok=True)
        os.rename(f"{folder}.part", folder)
    return folder


def build_folder():
    """The folder of the compiled core, which is kept: one for each kind of Python and compiler."""
    command = compiler()
    words = ["zig"] if command is None else command[:1]
    return BUILD / "-".join(["core", sys.implementation.cache_tag, *(Path(word).name for word in words)])


def compile_core(folder, *arguments):
    """Compile what has changed of the core into a folder, with further arguments of CMake. Returns the path of the module."""
    source, cache = ROOT / "bvp" / "core", folder / "CMakeCache.txt"
    if cache.is_file() and f"CMAKE_HOME_DIRECTORY:INTERNAL={source.as_posix()}\n" not in cache.read_text():
        shutil.rmtree(folder)  # it was copied or moved
    settings = {"Python_EXECUTABLE": sys.executable, "nanobind_DIR": kept("nanobind") / "cmake"}
    environment, command, generator = dict(os.environ), compiler(), []
    if command is None:
        command = [str(kept("ziglang") / "zig"), "c++", "-mcpu=baseline"]
        # zig builds its C++ library for each new kind of program, which takes a minute: the trials of CMake and nanobind link nothing.
        settings |= {"CMAKE_CXX_ABI_COMPILED": True, "CMAKE_CXX_FLAGS": "", "NB_HAS_MTLS_GNU2": False}
        environment |= {"CXXFLAGS": "-c", "ZIG_GLOBAL_CACHE_DIR": str(BUILD / "zig-cache")}
    if command:
        environment["CXX"] = shlex.join(command)
        settings["CMAKE_MAKE_PROGRAM"] = shutil.which("ninja")
        generator = ["-G", "Ninja"]
    defined = [f"-D{name}={value}" for name, value in settings.items()]
    subprocess.run(["cmake", "-S", source, "-B", folder, *generator, *defined, *arguments], env=environment, check=True, stdout=sys.stderr)
    subprocess.run(["cmake", "--build", folder, "--config", "Release"], env=environment, check=True, stdout=sys.stderr)
    return next(file for file in folder.glob("saltus_core*") if file.suffix in (".so", ".pyd"))


if __name__ == "__main__":
    print(compile_core(Path(sys.argv[1]).resolve(), *sys.argv[2:]))
