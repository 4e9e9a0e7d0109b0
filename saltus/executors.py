"""Where work runs: processes on this machine, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from branches.files import reason
from saltus.errors import BadInput, one_line
from saltus.startup import one_thread

__all__ = ["end_with_the_parent", "open_executor"]

_PATIENCE = 10.0
"""Seconds to wait for a scheduler."""


@contextmanager
def open_executor(workers: int | None = None, dask: str | None = None) -> Iterator[tuple[Executor, int]]:
    """An executor and how many work on it.

    Parameters
    ----------
    workers : int, optional
        Processes, where no cluster is named; by default one a core.
    dask : str, optional
        Address of a Dask scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    BadInput
        Where processes are counted and a cluster is named, Dask is not installed, no scheduler answers at the address, or it has no
        workers that can do the work.
    RuntimeError
        Where the cluster, or a process, is lost while it works.
    """
    if workers is not None and dask is not None:
        raise BadInput(f"--workers counts processes here, and --dask {dask} works in their place; expected one of them")
    if dask is None:
        workers = workers or os.cpu_count() or 1
        one_thread()
        # A fresh process: one that was forked while kernels are compiled in another thread may wait for ever.
        pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_depend_on_the_parent)
        try:
            yield pool, workers
        except BrokenProcessPool as error:
            raise RuntimeError(
                "a worker process was killed, or ran out of memory; what was finished is kept, and the same command goes on"
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return
    try:
        from distributed import Client, KilledWorker
        from distributed.comm import CommClosedError
    except ImportError:
        raise BadInput("--dask needs the package distributed, which is not installed; expected pip install 'saltus[dask]'") from None
    try:
        _knock(dask)
        client = Client(dask, timeout=_PATIENCE)
    except (OSError, ValueError) as error:
        said = reason(error) if isinstance(error, OSError) else error
        raise BadInput(f"no Dask scheduler answers at {dask!r}: {said}; expected an address such as tcp://127.0.0.1:8786") from error
    with client:
        count = sum(client.nthreads().values())
        if not count:
            raise BadInput(f"the Dask scheduler at {dask} has no workers; expected one at least: start some with dask worker {dask}")
        try:
            versions = set(client.run(_version).values())
        except Exception as error:
            raise BadInput(f"the workers of the Dask scheduler at {dask} cannot run saltus: {one_line(error)}") from error
        if versions != {_version()}:
            theirs = ", ".join(sorted(versions))
            raise BadInput(f"the workers of the Dask scheduler at {dask} have saltus {theirs}, expected {_version()}, as here")
        try:
            yield client.get_executor(), count
        except (CancelledError, CommClosedError, KilledWorker) as error:
            raise RuntimeError(f"the Dask cluster at {dask} was lost; what was finished is kept, and the same command goes on") from error


def _knock(address: str) -> None:
    """Raise for what is no address, or where nothing answers: at once, where a client would try again and again."""
    from distributed.comm.addressing import get_address_host_port, parse_address, resolve_address

    if parse_address(resolve_address(address))[0] in ("tcp", "tls"):
        with socket.create_connection(get_address_host_port(address), timeout=_PATIENCE):
            pass


def _version() -> str:
    from saltus import __version__

    return __version__


def _depend_on_the_parent() -> None:
    """Ctrl-C reaches every process of a terminal: the parent ends the work, and the workers say nothing. A parent that is killed cannot
    end them: they would wait for work for ever, so that each ends by itself."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_the_parent, daemon=True).start()


def end_with_the_parent() -> None:
    """End this process when the one that started it has ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
