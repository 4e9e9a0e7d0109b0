"""A queue of work that grows while it is processed by any executor. Results do not depend on the number of workers or their timing.

Seeds wait in a queue. The executor works ahead on seeds near the front, but results are taken one at a time, in the queue's order, and
new seeds go to the end. If a seed is already known when its turn comes, its result is discarded. So the outcome does not depend on what
was known when the seed was submitted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import Executor, Future
from typing import Generic, NamedTuple, TypeVar

__all__ = ["Frontier", "Taken"]

LOOK = 8
"""Number of seeds at the front that are examined for each seed that may be submitted."""

Seed = TypeVar("Seed")
Result = TypeVar("Result")


class Taken(NamedTuple, Generic[Seed, Result]):
    """A seed and its result; the result is None if the seed was already known when its turn came."""

    seed: Seed
    result: Result | None


class Frontier(Generic[Seed, Result]):
    """A queue of seeds, some of which are being processed.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    work : callable
        seed -> result; runs on the executor, and depends on the seed alone.
    known : callable
        seed -> whether nothing is left to do for it. Once true it has to stay true.
    key : callable
        seed -> its name; a name is queued once.
    ahead : int
        How many seeds near the front may be worked on at a time.
    kin : callable, optional
        seed -> a group (None: no group). A result may make other seeds of the same group known, so a seed is not processed before the
        earlier seeds of its group.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> found = set()
    >>> with ThreadPoolExecutor(2) as pool:
    ...     frontier = Frontier(pool, lambda n: [n // 2, n // 3], lambda n: n in found, lambda n: n, ahead=4)
    ...     _ = frontier.extend([100])
    ...     for seed, result in frontier:
    ...         found.add(seed)
    ...         _ = frontier.extend(result or [])
    >>> sorted(found)[-4:]
    [25, 33, 50, 100]
    """

    def __init__(
        self,
        executor: Executor,
        work: Callable[[Seed], Result],
        known: Callable[[Seed], bool],
        key: Callable[[Seed], Hashable],
        ahead: int,
        kin: Callable[[Seed], Hashable] | None = None,
    ) -> None:
        self._executor = executor
        self._work = work
        self._known = known
        self._key = key
        self._ahead = ahead
        self._kin = kin or (lambda seed: None)
        self._queue: deque[Seed] = deque()
        self._names: set[Hashable] = set()
        self._running: dict[Hashable, Future[Result]] = {}

    def __len__(self) -> int:
        """How many seeds wait for their turn."""
        return len(self._queue)

    def extend(self, seeds: Iterable[Seed]) -> int:
        """Queue those seeds that never were, in their order.

        Returns
        -------
        int
            How many they are.
        """
        before = len(self._queue)
        for seed in seeds:
            name = self._key(seed)
            if name not in self._names:
                self._names.add(name)
                self._queue.append(seed)
        return len(self._queue) - before

    def __iter__(self) -> Iterator[Taken[Seed, Result]]:
        """The seeds in their order, each with its result, until none is left; what was not taken is cancelled at the end."""
        try:
            while self._queue:
                self._submit()
                seed = self._queue.popleft()
                future = self._running.pop(self._key(seed), None)
                if future is None or self._known(seed):
                    if future is not None:
                        future.cancel()
                    yield Taken(seed, None)
                else:
                    yield Taken(seed, future.result())
        finally:
            for future in self._running.values():
                future.cancel()
            self._running.clear()

    def _submit(self) -> None:
        """Have those near the front worked on that are not known, and have no elder kin in the queue."""
        waiting = 0
        elders: set[Hashable] = set()
        for seed, _ in zip(self._queue, range(LOOK * self._ahead), strict=False):
            if waiting == self._ahead:
                break
            name, kin = self._key(seed), self._kin(seed)
            if name in self._running:
                waiting += 1
            elif kin not in elders and not self._known(seed):
                self._running[name] = self._executor.submit(self._work, seed)
                waiting += 1
            if kin is not None:
                elders.add(kin)
