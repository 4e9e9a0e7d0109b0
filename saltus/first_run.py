"""The first run on a machine compiles the kernels: say so, and use a second core for it."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

__all__ = ["prepare", "prepare_motion", "tell_compiling"]


def prepare(**kernels: bool) -> None:
    """Say on standard error that kernels will be compiled, if they were not before, and compile some of them beside this process.

    The second process is a help, not a need: where it cannot be started, or fails, this one compiles everything itself.

    Parameters
    ----------
    **kernels
        What else is needed than to follow a family: as for `branches.kernels.warm.kept`.
    """
    from branches.kernels.warm import kept
    from bvp.kernels.cache import keeps

    if kept(**kernels):
        return
    _tell()
    if (os.cpu_count() or 1) < 2 or not keeps():
        return
    try:
        subprocess.Popen(
            [sys.executable, "-m", "branches.kernels.warm"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
            start_new_session=True,
        )
    except OSError:
        return


def prepare_motion() -> None:
    """Tell, as `tell_compiling`, of the kernels of damped motion."""
    from bvp.kernels.motion import move

    tell_compiling(move)


def tell_compiling(kernel: Any) -> None:
    """Say on standard error that kernels will be compiled, if this one of them was not before."""
    from bvp.kernels.warm import stored

    if not stored(kernel):
        _tell()


def _tell() -> None:
    if sys.stderr is not None:
        print("saltus: compiling the kernels, which takes a minute or two, at the first run only", file=sys.stderr, flush=True)
