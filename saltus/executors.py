"""Where work runs: processes on this machine, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
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
        # A fresh process: one that was forked while kernels are compiled in another thread may wait for ever.
        pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
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
