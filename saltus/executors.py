"""Where work runs: processes on this machine, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from saltus.errors import BadInput

__all__ = ["open_executor"]


@contextmanager
def open_executor(workers: int, dask: str | None = None) -> Iterator[tuple[Executor, int]]:
    """An executor and how many work on it.

    Parameters
    ----------
    workers : int
        Processes, where no cluster is named.
    dask : str, optional
        Address of a Dask scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    BadInput
        Where Dask is not installed, or no scheduler answers at the address.
    """
    if dask is None:
        # One thread a worker: small matrices gain nothing from more, and workers that share cores lose much.
        for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")
        # A fresh process: one that was forked while kernels are compiled in another thread may wait for ever.
        pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_leave_interrupts_to_the_parent)
        try:
            yield pool, workers
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return
    try:
        from distributed import Client
    except ImportError:
        raise BadInput("--dask needs the package distributed, which is not installed; expected pip install 'saltus[dask]'") from None
    try:
        client = Client(dask, timeout=10)
    except (OSError, ValueError) as error:
        raise BadInput(f"no Dask scheduler answers at {dask!r}: {error}; expected an address such as tcp://127.0.0.1:8786") from error
    with client:
        yield client.get_executor(), max(1, sum(client.nthreads().values()))


def _leave_interrupts_to_the_parent() -> None:
    """Ctrl-C reaches every process of a terminal: the parent ends the work, and the workers say nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
