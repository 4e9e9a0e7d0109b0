"""What a process needs before it computes: one thread for linear algebra, and compiled kernels."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

__all__ = ["one_thread", "prepare", "prepare_motion", "report_compiling"]


def one_thread() -> None:
    """Ask the linear algebra libraries for one thread, here and in the processes started from here, unless the environment says otherwise.

    Small matrices gain nothing from more, and processes that share cores lose much by them. A library that is already loaded does not
    change.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


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
    _report()
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
    """Report, as `report_compiling`, about the kernels of damped motion."""
    from bvp.kernels.motion import move

    report_compiling(move)


def report_compiling(kernel: Any) -> None:
    """Say on standard error that kernels will be compiled, if this one of them was not before."""
    from bvp.kernels.cache import stored

    if not stored(kernel):
        _report()


def _report() -> None:
    if sys.stderr is not None:
        print("saltus: compiling the kernels, which takes a minute or two, at the first run only", file=sys.stderr, flush=True)
