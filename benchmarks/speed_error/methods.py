"""The contract between tasks and methods: a method takes a task and a setting and returns work; the work returns an answer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

__all__ = ["OWN", "OWN_SHORT", "SHORT_STEP", "Answer", "Errors", "Method", "OrbitAnswer", "Task", "Work"]

OWN = "saltus"
"""The method that the times of the others are divided by."""

OWN_SHORT = "saltus, short steps"
"""The same method with steps of `SHORT_STEP`."""

SHORT_STEP = 1e-4
"""Length of the steps, each program in its own norm, at which continuation programs are compared on equal terms.

The steps are so short that no point needs more corrections than another. AUTO takes no others: at longer ones the family ends before its
longer run does."""


@dataclass(frozen=True, eq=False)
class OrbitAnswer:
    """One orbit; None for what the method does not compute."""

    alpha: float
    energy: float | None = None
    velocities: np.ndarray | None = None  # (n,) at the start, where u = 0
    times: np.ndarray | None = None  # (k,) of the inner impacts
    multipliers: np.ndarray | None = None  # (m,) complex, the nontrivial ones, by modulus descending, then by angle
    unknowns: np.ndarray | None = None  # (u,) of the multipoint problem; the reference orbit is solved from here


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method computed for a task."""

    points: int = 1  # orbits, located points or impacts; the time is divided by it
    seconds: float | None = None  # per point, if the method measures it itself; otherwise the whole call is measured
    orbits: tuple[OrbitAnswer, ...] = ()
    located: dict[str, tuple[float, float]] = field(default_factory=dict)  # (alpha, h) by name
    ran: tuple[float, np.ndarray, float] | None = None  # time, state (2 n,) and energy after the last impact of a motion
    layers: dict[str, list[float]] | None = None  # seconds a point and their scatter, by layer, if the method separates them


class Errors(NamedTuple):
    """Relative errors of the orbit, the energy, the multipliers and the located points; None for what was not computed."""

    orbit: float | None = None
    energy: float | None = None
    multipliers: float | None = None
    located: float | None = None


class Task(Protocol):
    """A problem with a known answer.

    Attributes
    ----------
    name, title, reference : str
        For files; for a reader; what the errors are measured against.
    point : str
        What is counted: "orbit", "impact" or "located point".
    """

    @property
    def name(self) -> str: ...

    @property
    def title(self) -> str: ...

    @property
    def reference(self) -> str: ...

    @property
    def point(self) -> str: ...

    def errors(self, answer: Answer) -> Errors:
        """The errors of an answer."""


@dataclass(frozen=True)
class Work:
    """The work of a method on a task: `once` does it once. For a method that follows a family, `measured` computes many points and
    measures the time of one."""

    once: Callable[[], Answer]
    measured: Callable[[], Answer] | None = None


class Method(ABC):
    """A way to do tasks.

    Attributes
    ----------
    name : str
    setting : str
        Name of the setting that the method varies; "" for a method without one.
    """

    name: str
    setting: str

    def missing(self) -> str | None:
        """Return why the method cannot be used here, or None."""
        return None

    def does(self, task: Task) -> bool:
        """Return whether the method does tasks of this kind."""
        return task.point == "orbit"

    def settings(self, tolerances: tuple[float, ...]) -> tuple[float | None, ...]:
        """Return its settings, loose to tight, for the wanted tolerances; (None,) for a method that works to rounding error."""
        return tolerances

    @abstractmethod
    def prepare(self, task: Task, setting: float | None) -> Work:
        """Return the work of a task at a setting."""
