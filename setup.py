"""Building a wheel from a source distribution compiles the kernels into it. All else is in setup.cfg.

A copy of the repository has no PKG-INFO, so installing from one compiles nothing: kernels are compiled when they are first called.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

COMPILES = Path(__file__).with_name("PKG-INFO").is_file()


class BuildWithKernels(build_py):
    """Copies the packages, and adds the compiled kernels."""

    def run(self):
        super().run()
        if not self.editable_mode:
            place = Path(self.build_lib).resolve()
            with tempfile.TemporaryDirectory() as folder:
                environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(place), *sys.path]), "NUMBA_CACHE_DIR": folder}
                subprocess.run([sys.executable, "-m", "saltus.compiling", place / "bvp/kernels/shipped"], env=environment, check=True)


class WheelWithKernels(bdist_wheel):
    """A wheel for one kind of machine and one version of Python."""

    def finalize_options(self):
        super().finalize_options()
        self.root_is_pure = False


if COMPILES:
    requirements = ["numba", "numpy", "platformdirs"]
    setup(cmdclass={"build_py": BuildWithKernels, "bdist_wheel": WheelWithKernels}, setup_requires=requirements)
else:
    setup()
