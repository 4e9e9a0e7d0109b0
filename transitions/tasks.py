"""Tasks that do not depend on each other, here or beside each other in processes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from typing import Any, TypeVar

__all__ = ["completed"]

Result = TypeVar("Result")


def completed(function: Callable[..., Result], tasks: Iterable[tuple[Any, ...]], executor: Executor | None) -> Iterator[tuple[int, Result]]:
    """The index of each task and ``function(*task)``: here, in this order, or in an executor's processes, as they are finished.

    What has not begun is cancelled if the iteration ends early, as by Ctrl-C.

    Raises
    ------
    Exception
        What a task has raised.

    Examples
    --------
    >>> list(completed(pow, [(2, 3), (3, 2)], None))
    [(0, 8), (1, 9)]
    """
    if executor is None:
        for k, task in enumerate(tasks):
            yield k, function(*task)
        return
    waiting = {executor.submit(function, *task): k for k, task in enumerate(tasks)}
    try:
        while waiting:
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                yield waiting.pop(future), future.result()
    finally:
        for future in waiting:
            future.cancel()
