"""How much a compiled call does before it returns: an interrupt is seen, and progress told, only between two calls."""

from __future__ import annotations

import time
from collections.abc import Iterator
from types import TracebackType
from typing import Self

__all__ = ["Pace"]

SHORT, LONG = 0.05, 0.2
"""Seconds: a call that takes less is followed by one that does twice as much, one that takes more by one that does a quarter."""

FIRST, MOST = 256, 1 << 20


class Pace:
    """How many passes of a loop the next call may make, by the time that the last one took.

    What is computed must not depend on it: a call goes on exactly where the one before has returned.

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
