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
    """One orbit; None for what the method does not compute.

    Attributes
    ----------
    alpha : float
        Quarter period.
    energy : float or None
    velocities : (n,) float or None
        At the start, where u = 0.
    times : (k,) float or None
        Of the inner impacts.
    multipliers : (m,) complex or None
        The nontrivial ones, by modulus descending, then by angle.
    unknowns : (u,) float or None
        Of the multipoint problem, if the method has them. The reference orbit is solved from here.
    """

    alpha: float
    energy: float | None = None
    velocities: np.ndarray | None = None
    times: np.ndarray | None = None
    multipliers: np.ndarray | None = None
    unknowns: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method computed for a task.

    Attributes
    ----------
    points : int
        Number of points computed (orbits, located points, impacts). The time is divided by it.
    seconds : float or None
        Per point, if the method measures it itself. Otherwise the whole call is measured.
    orbits : tuple of OrbitAnswer
    located : mapping of str to (alpha, h)
    ran : (float, (2 n,) float, float) or None
        Time, state and energy after the last impact of a motion.
    layers : mapping of str to float or None
        Seconds a point by layer, if the method separates them.
    """

    points: int = 1
    seconds: float | None = None
    orbits: tuple[OrbitAnswer, ...] = ()
    located: dict[str, tuple[float, float]] = field(default_factory=dict)
    ran: tuple[float, np.ndarray, float] | None = None
    layers: dict[str, float] | None = None


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
    """The work of a method on a task.

    Attributes
    ----------
    once : callable
        Does the task once. Its time is divided by the number of points of its answer.
    measured : callable or None
        For a method that follows a family: computes many points and measures the time of one.
    """

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
