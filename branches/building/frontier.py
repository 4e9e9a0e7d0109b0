"""A queue of work that grows while it is processed by any executor. Results do not depend on the number of workers or their timing.

Seeds wait in a queue. The executor works ahead on seeds near the front, but results are taken one at a time, in the queue's order, and
new seeds go to the end. If a seed is already known when its turn comes, its result is discarded. So the outcome does not depend on what
was known when the seed was submitted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from itertools import islice
from typing import Any, Generic, TypeVar

__all__ = ["Frontier"]

LOOK = 8
"""Number of seeds at the front that are examined for each seed that may be submitted."""

Seed = TypeVar("Seed")
Result = TypeVar("Result")


@dataclass
class _Waiting(Generic[Seed, Result]):
    seed: Seed
    future: Future[Result] | None = None


class Frontier(Generic[Seed, Result]):
    """A queue of seeds, some of which are being processed. Iteration gives each seed with its result, in their order, until none is left;
    the result is None if the seed was already known when its turn came.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    work : callable
        seed -> result; runs on the executor, and depends on the seed alone.
    known : callable
        seed -> whether nothing is left to do for it. Once true it has to stay true.
    ahead : int
        How many seeds near the front may be worked on at a time.
    kin : callable, optional
        seed -> a group (None: no group). A result may make other seeds of the same group known, so a seed is not processed before the
        earlier seeds of its group.
    handed : callable, optional
        seed -> what `work` is given for it, made when it is submitted. The result may contain less than that of the seed alone, but no
        less of what is not known then.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> found = set()
    >>> with ThreadPoolExecutor(2) as pool:
    ...     frontier = Frontier(pool, lambda n: [n // 2, n // 3], lambda n: n in found, ahead=4)
    ...     frontier.extend([100])
    ...     for seed, result in frontier:
    ...         found.add(seed)
    ...         frontier.extend(result or [])
    >>> sorted(found)[-4:]
    [25, 33, 50, 100]
    """

    def __init__(
        self,
        executor: Executor,
        work: Callable[[Any], Result],
        known: Callable[[Seed], object],
        ahead: int,
        kin: Callable[[Seed], Hashable] = lambda seed: None,
        handed: Callable[[Seed], Any] = lambda seed: seed,
    ) -> None:
        self._executor = executor
        self._work = work
        self._known = known
        self._ahead = ahead
        self._kin = kin
        self._handed = handed
        self._queue: deque[_Waiting[Seed, Result]] = deque()

    def __len__(self) -> int:
        """How many seeds wait for their turn."""
        return len(self._queue)

    def extend(self, seeds: Iterable[Seed]) -> None:
        """Queue seeds in their order."""
        self._queue.extend(_Waiting(seed) for seed in seeds)

    def __iter__(self) -> Iterator[tuple[Seed, Result | None]]:
        try:
            while self._queue:
                self._submit()
                waiting = self._queue.popleft()
                seed, future = waiting.seed, waiting.future
                if future is None or self._known(seed):
                    if future is not None:
                        future.cancel()
                    yield seed, None
                else:
                    yield seed, future.result()
        finally:
            for waiting in self._queue:
                if waiting.future is not None:
                    waiting.future.cancel()

    def _submit(self) -> None:
        """Have those near the front worked on that are not known, and have no elder kin in the queue."""
        working = 0
        elders: set[Hashable] = set()
        for waiting in islice(self._queue, LOOK * self._ahead):
            if working == self._ahead:
                break
            kin = self._kin(waiting.seed)
            if waiting.future is None and kin not in elders and not self._known(waiting.seed):
                waiting.future = self._executor.submit(self._work, self._handed(waiting.seed))
            working += waiting.future is not None
            if kin is not None:
                elders.add(kin)
