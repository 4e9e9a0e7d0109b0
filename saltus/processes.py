"""Worker processes: their threads, and the choice of processes here or a Dask cluster."""

from __future__ import annotations

import argparse
import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from branches.files import reason
from bvp.interrupts import SIGNALS
from saltus.errors import BadInput, one_line, plain_warnings

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from multiprocessing.context import BaseContext

__all__ = [
    "LOADED",
    "end_with_the_parent",
    "executor_of",
    "new_processes",
    "one_thread",
    "open_executor",
]


def one_thread() -> None:
    """Ask the linear algebra libraries for one thread, here and in the processes started from here, unless the environment says otherwise.

    Small matrices gain nothing from more, and processes that share cores lose much by them. A library that is already loaded does not
    change.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


_SELDOM = 20_000, 20, 100
"""Thresholds of garbage collection in these processes. They make much that stays: with Python's own thresholds, all of it is looked
through again and again, which takes some per cent of the time."""

_PATIENCE = 10.0
"""Seconds to wait for a scheduler."""


@contextmanager
def open_executor(workers: int | None = None, dask: str | None = None) -> Iterator[tuple[Executor, int]]:
    """An executor and its number of workers: processes (by default one for each core), or the Dask cluster whose scheduler has the address
    `dask`. `BadInput` if both are given or no cluster answers; `RuntimeError` if the cluster or a process is lost while it works."""
    import multiprocessing
    from concurrent.futures import CancelledError, ProcessPoolExecutor, ThreadPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    if workers is not None and dask is not None:
        raise BadInput(f"--workers counts processes here, and --dask {dask} works in their place; expected one of them")
    if dask is None:
        workers = workers or os.cpu_count() or 1
        one_thread()

        class Pool(ProcessPoolExecutor):
            def submit(self, /, *call: Any, **options: Any) -> Any:
                future = beginner.submit(super().submit, *call, **options).result()
                for process in multiprocessing.active_children():
                    process.terminate = process.kill  # type: ignore[method-assign]  # workers ignore what `terminate` sends
                return future

        # An interrupt is raised in the main thread. A process that is begun in another one is begun completely, before the pool ends.
        beginner = ThreadPoolExecutor(1, initializer=_hold_interrupts)
        beginner.submit(int).result()
        pool = Pool(workers, mp_context=new_processes(), initializer=_begin_worker)
        before = gc.get_threshold()
        gc.set_threshold(*_SELDOM)
        try:
            yield pool, workers
        except BrokenProcessPool as error:
            raise RuntimeError(
                "a worker process was killed, or ran out of memory; what was finished is kept, and the same command goes on"
            ) from error
        finally:
            gc.set_threshold(*before)
            pool.shutdown(wait=True, cancel_futures=True)
            beginner.shutdown()
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


@contextmanager
def executor_of(arguments: argparse.Namespace, little: bool) -> Iterator[Executor | None]:
    """The executor of ``--workers`` and ``--dask``. None for one worker, and by default for little work: it is done in this process."""
    if arguments.dask is None and (arguments.workers or int(little)) == 1:
        yield None
        return
    with open_executor(arguments.workers, arguments.dask) as (executor, _):
        yield executor


LOADED: tuple[str, ...] = ("branches.building.work", "branches.catalogue", "transitions.sweep.runs")
"""Modules that most workers need. The process that the workers are copies of loads them once."""


def new_processes() -> BaseContext:
    """How processes begin: as copies of one that has done nothing but load modules, where the system has that, else as new ones.

    They are not copies of this process: one that is copied while another thread compiles kernels can wait for ever.
    """
    import multiprocessing

    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(LOADED))
    return context


def _knock(address: str) -> None:
    """Raise an error at once if a text is not an address or if nothing answers there. A Dask client would try again and again."""
    import socket

    from distributed.comm.addressing import get_address_host_port, parse_address, resolve_address

    if parse_address(resolve_address(address))[0] in ("tcp", "tls"):
        with socket.create_connection(get_address_host_port(address), timeout=_PATIENCE):
            pass


def _version() -> str:
    from saltus import __version__

    return __version__


def _hold_interrupts() -> None:
    """Keep interrupts from this thread, and from the processes that it begins: they would end, or print tracebacks, until `_begin_worker`
    is called."""
    from multiprocessing import resource_tracker

    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        resource_tracker.ensure_running()  # a process of its own; when it begins, this thread is released from the signals
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)


def _begin_worker() -> None:
    """Prepare a worker process.

    Ctrl-C reaches every process of a terminal, and SIGTERM every process of a batch job: the parent ends the work, and the workers say
    nothing. A parent that is killed cannot end them: they would wait for work for ever, so that each ends by itself.
    """
    gc.set_threshold(*_SELDOM)
    plain_warnings()
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=end_with_the_parent, daemon=True).start()


def end_with_the_parent() -> None:
    """End this process when its parent process has ended."""
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
