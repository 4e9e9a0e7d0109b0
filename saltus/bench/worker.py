"""Work in a process of its own: fresh, so that the time to its first answer and its memory are its own; and it can be given up."""

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

from saltus.bench.answers import Answer
from saltus.bench.methods import Work
from saltus.errors import exit_code, one_line
from saltus.executors import end_with_the_parent
from saltus.threads import one_thread

__all__ = ["Failed", "Timed", "Worker"]

_LEAST = 3
"""Repetitions of a work, at least, where a work that takes longer than all the time for repetitions is done no second time."""


class Failed(RuntimeError):
    """The work was not done; the message is one line. `final` where the process can do no other."""

    def __init__(self, message: str, final: bool = False) -> None:
        super().__init__(message)
        self.final = final


@dataclass(frozen=True)
class Timed:
    """A measured answer: seconds of the processor a point, seconds by the clock from the start of the process to its first answer (None
    after the first), the most memory that the process has held so far in bytes (None where the system does not tell)."""

    answer: Answer
    seconds: float
    first: float | None
    memory: int | None
    repeats: int


class Worker:
    """A fresh process that does one method's settings of one task, one after another.

    Parameters
    ----------
    prepare : callable
        Takes a task and a setting; returns the work. It is sent to the process, so it is a function of a module or a method of
        such an object.
    task : object
        The task, which is sent too.
    repeat : float
        Seconds for which the work is repeated.
    """

    def __init__(self, prepare: Callable[[Any, Any], Work], task: Any, repeat: float) -> None:
        one_thread()
        context = multiprocessing.get_context("spawn")
        self._connection, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there, prepare, task, repeat, time.monotonic()), daemon=True)
        with _uninterrupted():
            self._process.start()
        there.close()

    def do(self, setting: float | None, limit: float) -> Timed:
        """The answer at a setting.

        Raises
        ------
        Failed
            Where the work failed, took longer than `limit` seconds, or the process ended; after the last two the worker is of no more use.
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
    """Put an interruption off: between its start and what it is sent, a process would end with a traceback. It inherits that it is not
    interrupted, and is ended by its parent."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, prepare: Callable[[Any, Any], Work], task: Any, repeat: float, began: float) -> None:
    """Do what is asked for until the parent ends."""
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
    """Do a work until its time is up; in a fresh process the first time, which loads what is needed, does not count."""
    answer, once = _once(work.once)
    first = None if began is None else time.monotonic() - began
    if work.measured is not None:
        answer = work.measured()
        assert answer.seconds is not None
        return Timed(answer, answer.seconds, first, most_memory(), 1)
    times = [once] if began is None else []
    while not times or (times[0] <= repeat and (len(times) < _LEAST or sum(times) < repeat)):
        answer, once = _once(work.once)
        times.append(once)
    return Timed(answer, min(times) / answer.points, first, most_memory(), len(times))


def _once(work: Callable[[], Answer]) -> tuple[Answer, float]:
    """An answer, and the processor time that it took: other work on the machine does not enter, and there is one thread."""
    began = time.process_time()
    answer = work()
    return answer, time.process_time() - began


def most_memory() -> int | None:
    """The most memory that this process has held, in bytes; None where the system does not tell."""
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
