"""One measurement in a new process: the time to the first answer and the memory are its own, and it can be stopped."""

from __future__ import annotations

import multiprocessing
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any

from benchmarks.measure import timed
from benchmarks.speed_error.methods import Answer, Task, Work
from saltus.errors import exit_code, one_line
from saltus.processes import end_with_the_parent, one_thread

__all__ = ["Failed", "Timed", "Worker"]

REPETITIONS = 3
"""Least number of repetitions of a work. A work that takes longer than the time for all repetitions is done only once."""


class Failed(RuntimeError):
    """The work was not done; the message is one line. After a `final` failure the worker cannot do any other work."""

    def __init__(self, message: str, final: bool = False) -> None:
        super().__init__(message)
        self.final = final


@dataclass(frozen=True)
class Timed:
    """A measured answer."""

    answer: Answer
    seconds: float  # of the processor, a point
    first: float | None  # seconds by the clock from the start of the process to its first answer; None after the first
    memory: int | None  # most bytes that the process has held so far; None if the system does not report it
    repeats: int


class Worker:
    """A fresh process that does the settings of one method for one task, one after another.

    Parameters
    ----------
    prepare : callable
        Takes a task and a setting and returns the work. It is sent to the process, so it is a function or method of a module.
    task : Task
        Sent to the process as well.
    repeat : float
        Seconds for which the work is repeated.
    """

    def __init__(self, prepare: Callable[[Any, Any], Work], task: Task, repeat: float) -> None:
        one_thread()
        context = multiprocessing.get_context("spawn")
        self._connection, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there, prepare, task, repeat, time.monotonic()), daemon=True)
        with _uninterrupted():
            self._process.start()
        there.close()

    def do(self, setting: float | None, limit: float) -> Timed:
        """Return the answer at a setting.

        Raises
        ------
        Failed
            If the work failed, took longer than `limit` seconds, or the process ended. The last two are final.
        """
        try:
            self._connection.send(setting)
            if not self._connection.poll(limit):
                raise Failed(f"not done in {limit:g} s", final=True)
            found = self._connection.recv()
        except (EOFError, OSError):
            raise Failed("its process ended", final=True) from None
        if isinstance(found, str):
            raise Failed(found)
        assert isinstance(found, Timed)
        return found

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._process.kill()
        self._process.join()
        self._connection.close()


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Postpone an interruption, so that a process that is just starting does not end with a traceback.

    The process inherits the blocked signal; its parent ends it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, prepare: Callable[[Any, Any], Work], task: Task, repeat: float, began: float) -> None:
    """Do the wanted works until the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_the_parent, daemon=True).start()
    first: float | None = began
    while True:
        try:
            setting = connection.recv()
        except EOFError:
            return
        try:
            connection.send(_measured(prepare(task, setting), repeat, first))
            first = None
        except Exception as error:
            if exit_code(error) is None:
                raise
            connection.send(one_line(error))


def _measured(work: Work, repeat: float, began: float | None) -> Timed:
    """Repeat a work until its time is up. The first time in a fresh process does not count: it loads modules and kernels."""
    answer, seconds = timed(work.once)
    first = None if began is None else time.monotonic() - began
    if work.measured is not None:
        answer = work.measured()
        assert answer.seconds is not None
        return Timed(answer, answer.seconds, first, most_memory(), 1)
    times = [seconds] if began is None else []
    while not times or (times[0] <= repeat and (len(times) < REPETITIONS or sum(times) < repeat)):
        answer, seconds = timed(work.once)
        times.append(seconds)
    return Timed(answer, min(times) / answer.points, first, most_memory(), len(times))


def most_memory() -> int | None:
    """Most bytes that this process has held; None if the system does not report it."""
    try:
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    except OSError:
        pass
    try:
        import resource
    except ImportError:
        return None
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most
