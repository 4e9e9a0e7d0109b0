"""The contract between a problem and the engine, and the parts of a run: steps, points, events, and the reason of its end.

The engine in `continuation.engine` follows the solutions of n equations in n + 1 unknowns y. All that it knows of them it gets
from an object with the duties of `Problem`. Everything is measured in the problem's own *metric*: a few coordinates,
`Step.position`, in which the curve has an arclength.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np

    from continuation.location import Location

Kind = Literal["crossing", "change", "guard"]
Status = Literal["located", "bracketed"]


class TestFunction(NamedTuple):
    """A test function, which marks events by its value along the family.

    Attributes
    ----------
    code : str
        Type of the event, e.g. ``"SN"``.
    kind : str
        ``"crossing"``: an event where the value changes sign.
        ``"guard"``: the value is positive where the family is valid; an event where it falls to zero. Rising is no event. A
        start outside (value <= 0) that stays outside of a terminal guard is an event at the start.
        ``"change"``: an event where the value, an integer used as a key, changes; located by bisection.
        A value nan means: not defined here; it never makes an event.
    terminal : bool
        The family ends at the event, and the event's point is its last.
    label : str
        What the event is, in words.
    oriented : bool
        The value changes sign when the tangent is reversed (a slope, a determinant bordered by the tangent).
    absorbs : tuple of str
        Codes of events that are this same event when they coincide with it, and are then not reported: a branch point on a
        curve that folds back there is a branch point, not a branch point and a fold.
    singular : float
        Of a test for branch points: the equations are so nearly singular where its value is smaller that the signs of other test functions
        are rounding there. 0 for all others.
    """

    code: str
    kind: Kind
    terminal: bool = False
    label: str = ""
    oriented: bool = False
    absorbs: tuple[str, ...] = ()
    singular: float = 0.0


TestFunction.__test__ = False  # type: ignore[attr-defined]  # pytest takes classes with such a name for tests


class Step(NamedTuple):
    """One corrected point of the family, as a problem gives it.

    Attributes
    ----------
    converged : bool
        False: nothing else in it is looked at.
    y : ndarray, shape (n + 1,)
        The corrected unknowns.
    tangent : ndarray, shape (n + 1,)
        Unit tangent in the metric, pointing along the tangent that was given.
    position : tuple of float, or ndarray
        Metric coordinates; a tuple is faster.
    turn : float
        Cosine between the given and the new tangent in the metric; 1 for `Problem.begin`.
    contraction : float
        Largest ratio of successive corrector updates above rounding level; 0 where there was one update only.
    iterations : int
        Corrector iterations.
    residual : float
        Size of the residual at y.
    parameter, slope : float
        The reported parameter, and its derivative along the arclength.
    tests : sequence of float
        Values of the test functions, in the order of `Problem.tests`. A list is fastest, an ndarray is welcome.
    extra : object
        The problem's own data, carried on untouched.
    """

    converged: bool
    y: np.ndarray
    tangent: np.ndarray
    position: Sequence[float] | np.ndarray
    turn: float
    contraction: float
    iterations: int
    residual: float
    parameter: float
    slope: float
    tests: Sequence[float] | np.ndarray
    extra: Any = None

    def __eq__(self, other: object) -> bool:
        return self is other

    def __ne__(self, other: object) -> bool:
        return self is not other

    def __hash__(self) -> int:
        return id(self)


class Advance(NamedTuple):
    """Result of a problem's `advance`: several steps without events in one call, equal to the steps of the engine.

    ``advance(step, tests, older, oldest, before, first, ds, goal, direction, room, control)`` starts at `step` with its `tests`, those of
    the two points before it (`older`, `oldest`; nan where there are none) and the arclengths from `older` and from `oldest` to the next
    (`before`, `first`), with a first step of length `ds`. It corrects, judges and measures each step with `refusal`, `arclength_of`,
    `watch` and `next_step` of `continuation.control`, given `control`. It stops after `room` steps, or with the first step that is not
    plain: not converged, refused, one that has to be searched for events, or one that passes the position `goal` in the `direction` (its
    `height` was below zero and is not any more) to within `NEAR_GOAL` chords of it. A direction of None, at the first step of a run that
    may come back to its start, is that from there to the next point. The points must be those that the engine finds step by step.

    Attributes
    ----------
    steps : sequence of Step
        The accepted steps in order; their tests are lists. They may be created on access from arrays, since the engine needs only the
        last two.
    strides, lengths : (N,) float
        Requested length and arclength of each step.
    ds : float
        Length of the step after them.
    trial : Step or None
        The step of length `ds`, if it was tried and is not plain. The engine then examines it.
    """

    steps: Sequence[Step]
    strides: np.ndarray
    lengths: np.ndarray
    ds: float
    trial: Step | None


class EventDetails(NamedTuple):
    """A problem's classification of a located event: its final `code`, whether the family ends there, and free `data`."""

    code: str
    terminal: bool = False
    data: dict[str, Any] = {}


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """A special point of the family, with its error bar.

    Attributes
    ----------
    code : str
        Type, as the problem's `classify` gave it.
    test : int
        Index of the test function that marked it.
    status : str
        ``"located"``: a zero or a change of key, inside `bracket`. ``"bracketed"``: it happens inside `bracket`, but is no zero
        (a pole or a jump) or could not be brought nearer.
    arclength : float
        Where it is.
    bracket : tuple of float
        Arclengths between which it certainly is.
    residual : float
        |test function| at `point`; 0 for a change of key, and where it is nan for being rounding.
    point : Step
        The corrected point at the event.
    index : int
        Index of the event's point among the points of the run.
    terminal : bool
        Whether the family ends here.
    details : dict
        The problem's own data. The engine adds ``"absorbed"``, a tuple of codes of coincident events that this one stands for,
        and ``"kind"`` where it is not a plain zero or change: ``"pole"``, ``"jump"`` or ``"interrupted"`` (with ``"reason"``).
    """

    code: str
    test: int
    status: Status
    arclength: float
    bracket: tuple[float, float]
    residual: float
    point: Step
    index: int
    terminal: bool
    details: dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """A point of a run: a corrected `step` with its place.

    Attributes
    ----------
    index : int
        Place in the run.
    arclength : float
        Arclength from the first point.
    step : Step
        The corrected point: its unknowns, tangent, parameter and test functions.
    step_size : float
        The pseudo-arclength step that led here (0 at the start).
    event : Event or None
        The event that this point was made for.
    """

    index: int
    arclength: float
    step: Step
    step_size: float = 0.0
    event: Event | None = None

    def __repr__(self) -> str:
        return f"Point {self.index} at arclength {self.arclength:.10g}, parameter {self.step.parameter:.10g}"


@runtime_checkable
class Problem(Protocol):
    """The interface that the engine needs from a problem.

    1. `tests` is fixed for the life of the problem.
    2. `begin(y)` corrects y onto the curve with no condition on the arclength, and gives the tangent in either
       orientation, the same for the same y.
    3. `step(y, tangent, ds)` solves for the point of the curve on the hyperplane at the distance ds from y along the unit
       tangent, in the metric, and gives the tangent there pointing to the same side (`turn` > 0). ds may have
       either sign, and may be 0: then y itself is given back, with test functions in the given orientation. It does not raise
       if the numbers are bad: a failed step has ``converged=False``.
    4. The result depends on the arguments alone, so that any step can be repeated. Each step has new arrays.
    5. `classify(index, before, at, after, location)` returns the type of the event of test `index`; None if it is spurious.
       `before` and `after` are the points between which it was found (`after` need not be kept), `at` is the step at the
       event, and ``location.kind`` says how it was found: ``"zero"``, ``"change"``, ``"pole"``, ``"jump"``, ``"outside"``
       or ``"interrupted"``.
    6. `residual(y)` (n,) and `jacobian(y)` (n, n + 1) are used for switching only.

    Optional, found by name: ``advance(step, tests, older, before, ds, goal, direction, room, control) -> Advance``, which takes many
    plain steps at once, for speed alone (see `Advance`); ``failure(y, tangent, ds) -> str``, words for where steps fail;
    ``step_near(y, tangent, ds, guess) -> Step``, the step of duty 3 with its corrector started at the unknowns `guess`;
    ``refined(index, at) -> Step | None``, the event of test `index` to full accuracy, where steps bring it no nearer than the step
    `at` (whose tangent and turn it has), None where that is as near as it gets;
    ``beyond(at) -> (Step, Step)``, the branch point just ahead of the step `at` and the point of the family that is as far behind it, None
    where there is none, for runs that no step leads past it;
    ``second_derivative(y, a, b)`` (n,), F''(y)[a, b], and ``weights`` (n + 1,), the metric as a diagonal, for switching.
    """

    @property
    def tests(self) -> tuple[TestFunction, ...]: ...

    def begin(self, y: np.ndarray) -> Step: ...

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step: ...

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None: ...

    def residual(self, y: np.ndarray) -> np.ndarray: ...

    def jacobian(self, y: np.ndarray) -> np.ndarray: ...


class EndReason(Enum):
    """Why a family was followed no further. The value is a text for the user."""

    CLOSED = "the family closes on itself: it is back at its first point; nothing is left to follow"
    REPEATED = "the family repeats itself: it passes one branch point for the third time; what follows are images of what was followed"
    EVENT = "the family ends at this event; to go on, start the neighbouring family from the last point"
    STOP_AT = "an event of a type to stop at was reached; start again from the last point to go on"
    STOP_WHEN = "the stop condition held; start again from the last point to go on"
    POINTS = "the number of points was reached; allow more points, or start again from the last point"
    NOT_ASKED = "this direction was not asked for; start again from this point to go there"
    MINIMUM_STEP = (
        "steps were refused down to the shortest allowed; the family may end here or turn sharply: "
        "look at the detail, then try a smaller minimum_step"
    )
    NO_START = "the start could not be corrected onto a family; give a start that is nearer to a solution"

    @property
    def text(self) -> str:
        """What happened and what to do next."""
        return self.value


class Tally(NamedTuple):
    """What a run tried: the steps it accepted, and those it refused and halved, by cause.

    ``accepted`` counts steps, not points: the start and the points at events are not steps.
    """

    accepted: int = 0
    not_converged: int = 0
    slow: int = 0
    turned: int = 0
    jumped: int = 0

    @property
    def refused(self) -> int:
        """All refused steps."""
        return self.not_converged + self.slow + self.turned + self.jumped


class End(NamedTuple):
    """The end of a run: `reason`, `detail` in words (may be empty), and the `tally` of steps."""

    reason: EndReason
    detail: str = ""
    tally: Tally = Tally()

    @property
    def text(self) -> str:
        """The reason in words with its detail."""
        return f"{self.reason.text} ({self.detail})" if self.detail else self.reason.text
