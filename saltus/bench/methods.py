"""What a method is to the bench, and the methods by name.

A method is asked for a task and a setting of its ladder, and gives the work; whoever asks does it, and measures it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from saltus.bench.answers import Answer
from saltus.bench.tasks import OrbitTask, Task

__all__ = ["OWN", "OWN_SHORT", "SHORT_STEP", "Method", "Work", "methods"]

OWN = "saltus"
"""The method that the others' times are divided by."""

OWN_SHORT = "saltus, short steps"
"""The same with steps of `SHORT_STEP`."""

SHORT_STEP = 1e-4
"""Length of the steps, each program in its own norm, by which continuation programs are compared on equal terms: so short that no point
needs more corrections than another. AUTO takes no others: at longer ones the family ends before its longer run does."""


@dataclass(frozen=True)
class Work:
    """What does a task.

    Attributes
    ----------
    once : callable
        Does it once: measured from outside, by its time divided by the points of its answer.
    measured : callable or None
        For a method that follows a family: does it for many points and measures the time of one itself.
    """

    once: Callable[[], Answer]
    measured: Callable[[], Answer] | None = None


class Method(ABC):
    """A way to do tasks: of its own, each has a name, its work, and what differs from the rest here.

    Attributes
    ----------
    name : str
    setting : str
        What the numbers of its ladder are, in words; "" for a method that has none.
    """

    name: str
    setting: str

    def missing(self) -> str | None:
        """Why it cannot be used here; None where it can."""
        return None

    def does(self, task: Task) -> bool:
        """Whether the task is of a kind that it does."""
        return isinstance(task, OrbitTask)

    def ladder(self, tolerances: tuple[float, ...]) -> tuple[float | None, ...]:
        """Its settings, loose to tight, out of the tolerances asked for; (None,) for a method that works to rounding error."""
        return tolerances

    @abstractmethod
    def prepare(self, task: Task, setting: float | None) -> Work:
        """The work of a task at a setting."""


def methods() -> dict[str, Method]:
    """All methods by name, in the order in which they are done."""
    from saltus.bench.exact import EXACT
    from saltus.bench.integrators import INTEGRATORS
    from saltus.bench.peers import PEERS

    known: tuple[Method, ...] = (*EXACT, *INTEGRATORS, *PEERS)
    return {method.name: method for method in known}
