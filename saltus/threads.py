"""One thread for each process: small matrices gain nothing from more, and processes that share cores lose much by them."""

from __future__ import annotations

import os

__all__ = ["one_thread"]


def one_thread() -> None:
    """Ask the linear algebra libraries that are not loaded yet, here and in processes started from here, for one thread, where the
    user's environment says nothing else."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
