"""An interrupt (Ctrl-C) waits while a result that is complete is made ready and written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["Held", "held"]


class Held:
    """A handler of interrupts: the first one is kept, a second one raises `KeyboardInterrupt`.

    Attributes
    ----------
    came : bool
        Whether there was one.
    """

    def __init__(self) -> None:
        self.came = False
        self._raises = False
        self._kept = False
        self._inside: Held | None = None

    def __call__(self, number: int, frame: object) -> None:
        if self._inside is not None:
            self._inside(number, frame)
        elif self._raises or self.came:
            raise KeyboardInterrupt
        else:
            self.came = True

    @contextmanager
    def released(self) -> Iterator[None]:
        """Within it an interrupt raises `KeyboardInterrupt`, until `keep` is called."""
        self._raises, self._kept = True, False
        try:
            yield
        finally:
            self._raises = False

    def keep(self) -> None:
        """Keep interrupts from now on."""
        self._raises, self._kept = False, True

    @contextmanager
    def inner(self) -> Iterator[Held]:
        """A handler inside of this one, which keeps what would raise here."""
        handler = Held()
        if not self._raises or self._inside is not None:
            yield handler
            return
        self._inside = handler
        try:
            yield handler
        finally:
            self._inside = None
            if self._kept:
                self.came, handler.came = handler.came, False


@contextmanager
def held() -> Iterator[Held]:
    """Keep an interrupt until the end of the block, where the caller decides what follows from it.

    Inside another such block the outer one keeps it. Where interrupts are handled otherwise, or ignored, nothing changes.

    Yields
    ------
    Held

    Examples
    --------
    >>> with held() as interrupt:
    ...     signal.raise_signal(signal.SIGINT)
    ...     print("goes on")
    goes on
    >>> interrupt.came
    True
    """
    before = signal.getsignal(signal.SIGINT)
    if isinstance(before, Held):
        with before.inner() as handler:
            yield handler
        return
    handler = Held()
    if before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield handler
        return
    signal.signal(signal.SIGINT, handler)
    try:
        yield handler
    finally:
        signal.signal(signal.SIGINT, before)
