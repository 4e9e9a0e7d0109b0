"""Delay of an interrupt (Ctrl-C, or a signal that ends a process) until a complete result is ready and written."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Self

__all__ = ["SIGNALS", "InterruptHandler", "Pace", "defer_interrupts", "end_by", "ended_by"]

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that interrupt: Ctrl-C; those of batch systems and `timeout`; that of a terminal that closes."""

_received: list[int] = []


def end_by(number: int, frame: object) -> None:
    """Handle a signal that ends a process as an interrupt: `KeyboardInterrupt`."""
    _received.append(number)
    raise KeyboardInterrupt


def ended_by() -> int:
    """Return the first signal other than Ctrl-C that interrupted this process; else that of Ctrl-C."""
    return next((number for number in _received if number != signal.SIGINT), signal.SIGINT)


@dataclass(eq=False)
class InterruptHandler:
    """A handler of interrupts: the first one is kept, a second one raises `KeyboardInterrupt`.

    Attributes
    ----------
    came : bool
        Whether there was one.
    """

    came: bool = False
    _raises: bool = False
    _inside: InterruptHandler | None = None

    def __call__(self, number: int, frame: object) -> None:
        _received.append(number)
        if self._inside is not None:
            self._inside(number, frame)
        elif self._raises or self.came:
            raise KeyboardInterrupt
        else:
            self.came = True

    @contextmanager
    def released(self) -> Iterator[None]:
        """Within it an interrupt raises `KeyboardInterrupt`, until `keep` is called."""
        self._raises = True
        try:
            yield
        finally:
            self._raises = False

    def keep(self) -> None:
        """Keep interrupts from now on, and one that a block inside has delayed."""
        self._raises = False
        if self._inside is not None:
            self.came, self._inside.came = self._inside.came, False
            self._inside = None


@contextmanager
def defer_interrupts() -> Iterator[InterruptHandler]:
    """Delay an interrupt until the end of the block, where the caller decides what to do.

    If blocks are nested, the outer one keeps the interrupt. If the program handles or ignores interrupts itself, nothing changes.

    Yields
    ------
    InterruptHandler

    Examples
    --------
    >>> with defer_interrupts() as interrupt:
    ...     signal.raise_signal(signal.SIGINT)
    ...     print("goes on")
    goes on
    >>> interrupt.came
    True
    """
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    handler = InterruptHandler()
    before = next((found for found in handlers.values() if isinstance(found, InterruptHandler)), None)
    if before is not None:
        if not before._raises or before._inside is not None:
            yield handler
            return
        before._inside = handler  # it keeps what would raise there
        try:
            yield handler
        finally:
            before._inside = None
        return
    handlers = {number: found for number, found in handlers.items() if found in (signal.default_int_handler, end_by)}
    if threading.current_thread() is not threading.main_thread():
        handlers = {}
    for number in handlers:
        signal.signal(number, handler)
    try:
        yield handler
    finally:
        for number, found in handlers.items():
            signal.signal(number, found)


SHORT, LONG = 0.05, 0.2
"""Seconds. After a call shorter than `SHORT` the next one does twice as much; after one longer than `LONG` it does a quarter."""

FIRST, MOST = 256, 1 << 20


class Pace:
    """Number of passes that the next compiled call may make, adapted to the time of the last call.

    Python handles an interrupt only between calls, so calls must be short. Results do not depend on the number: each call continues
    exactly where the last one stopped.

    Attributes
    ----------
    passes : int

    Examples
    --------
    >>> pace = Pace()
    >>> with pace:
    ...     pass
    >>> pace.passes // FIRST, list(pace.blocks(3))
    (2, [slice(0, 3, None)])
    """

    def __init__(self) -> None:
        self.passes = FIRST
        self._begin = 0.0

    def __enter__(self) -> Self:
        self._begin = time.perf_counter()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        took = time.perf_counter() - self._begin
        if took < SHORT:
            self.passes = min(2 * self.passes, MOST)
        elif took > LONG:
            self.passes = max(1, self.passes // 4)

    def blocks(self, count: int) -> Iterator[slice]:
        """Parts of 0 to `count`, each for one call, in order."""
        first = 0
        while first < count:
            stop = min(first + self.passes, count)
            with self:
                yield slice(first, stop)
            first = stop
