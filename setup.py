"""The core is compiled into the wheel. Building a wheel from a source distribution adds the compiled kernels. All else is in setup.cfg.

A copy of the repository has no PKG-INFO, so installing from one compiles no kernels: they are compiled when they are first called.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

import backend

KERNELS = Path(__file__).with_name("PKG-INFO").is_file()
CORE = Path("bvp/core")


class BuildPackages(build_py):
    """Copies the packages, without what an earlier build left."""

    def run(self):
        if not self.editable_mode:
            shutil.rmtree(self.build_lib, ignore_errors=True)
        super().run()


class BuildCore(build_ext):
    """Compiles the core in a folder that is kept, from which an editable installation imports it; then the kernels, which need it."""

    def run(self):
        module = backend.compile_core(backend.build_folder())
        if not self.editable_mode:
            self.copy_file(module, Path(self.build_lib, module.name))
            if KERNELS:
                self.compile_kernels(Path(self.build_lib).resolve())

    def compile_kernels(self, place):
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(place), *sys.path]), "NUMBA_CACHE_DIR": folder}
            subprocess.run([sys.executable, "-m", "saltus.compiling", place / "bvp/kernels/shipped"], env=environment, check=True)

    def get_outputs(self):
        return []

    def get_output_mapping(self):
        return {}


sources = sorted(map(str, CORE.glob("*.cpp")))
setup(
    ext_modules=[Extension("saltus_core", sources, depends=["backend.py", *map(str, CORE.glob("*.hpp")), str(CORE / "CMakeLists.txt")])],
    package_dir={"saltus_core": str(backend.build_folder() / "saltus_core")},
    cmdclass={"build_ext": BuildCore, "build_py": BuildPackages},
    setup_requires=["numba", "numpy", "platformdirs"] if KERNELS else [],
)
