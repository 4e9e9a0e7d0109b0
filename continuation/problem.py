"""The contract between a problem and the engine, and the parts of a run: steps, points, events, and the reason of its end.

The engine in `continuation.engine` follows the solutions of n equations in n + 1 unknowns y. All that it knows of them it gets
from an object with the duties of `Problem`. Everything is measured in the problem's own *metric*: a few coordinates,
`Step.position`, in which the curve has an arclength.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, overload, runtime_checkable

import numpy as np

if TYPE_CHECKING:
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
        ``"guard"``: the value is positive where the family is valid; an event where it falls to zero. A start that is and stays outside of
        a terminal guard is an event at the start.
        ``"change"``: an event where the value, an integer used as a key, changes; located by bisection.
        A value nan means: not defined here; it never makes an event.
    terminal : bool
        The family ends at the event, and the event's point is its last.
    label : str
        What the event is, in words.
    oriented : bool
        The value changes sign when the tangent is reversed (a slope, a determinant bordered by the tangent).
    absorbs : tuple of str
        Codes of events that are not reported when they coincide with this one: a branch point on a curve that folds back there is no fold.
    singular : float
        Of a test for branch points: below this value the equations are so nearly singular that signs of other test functions are rounding.
        0 for all others.
    touches : bool
        A zero without a change of sign is an event, too: there are several at once, as of parts that do not interact.
    """

    code: str
    kind: Kind
    terminal: bool = False
    label: str = ""
    oriented: bool = False
    absorbs: tuple[str, ...] = ()
    singular: float = 0.0
    touches: bool = False


TestFunction.__test__ = False  # type: ignore[attr-defined]  # pytest takes classes with such a name for tests


class Step(NamedTuple):
    """One corrected point of the family, as a problem gives it.

    Attributes
    ----------
    converged : bool
        False: nothing else in it is looked at.
    y, tangent : ndarray, shape (n + 1,)
        The corrected unknowns, and the unit tangent in the metric, pointing along the tangent that was given.
    position : tuple of float, or ndarray
        Metric coordinates; a tuple is faster.
    turn : float
        Cosine between the given and the new tangent in the metric; 1 for `Problem.begin`.
    contraction : float
        Largest ratio of successive corrector updates above rounding level; 0 where there was one update only.
    iterations, residual : int, float
        Corrector iterations, and the size of the residual at y.
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

    @classmethod
    def failed(cls, y: np.ndarray) -> Step:
        """One that did not converge."""
        nan = float("nan")
        return cls(False, y, np.full(y.size, nan), (nan,), nan, float("inf"), 0, float("inf"), nan, nan, [])


class Recent(NamedTuple):
    """A point of a run with what step control remembers: two places before it. These are points, or events inside a step.

    Attributes
    ----------
    step : Step
    tests : list of float
        Values of the test functions at it,
    older, oldest : list of float
        and at the two places before; nan where there are none.
    length, length_before : float
        Arclength from the nearer place to the point, and from the farther place to the nearer one.
    """

    step: Step
    tests: Any
    older: Any
    oldest: Any
    length: float = 0.0
    length_before: float = 0.0


class Goal(NamedTuple):
    """A point that a run may come back to, which closes the family.

    direction: in which the run would pass it, roughly along the curve. None until the first step away from it gives this direction.
    """

    step: Step
    direction: np.ndarray | None = None


class Advance(NamedTuple):
    """Result of a problem's `advance`: several steps without events in one call, equal to the steps of the engine.

    ``advance(recent, ds, goal, room, control)`` starts at `recent` (a `Recent`) with a first step of length `ds`. It corrects, judges and
    measures each step with `refusal`, `arclength_of`, `watch` and `next_step` of `continuation.control`, given `control`. It stops after
    `room` steps, or with the first step that is not plain. Such a step is not converged, or refused, or has to be searched for events, or
    passes the `goal` (a `Goal`) to within `NEAR_GOAL` chords: its `height` was below zero and is not any more.
    At the beginning of a run it may `watch` the first two steps together with the third, when their test functions have bends. If one of
    the three is not plain, no step is accepted, and the first one is the trial.

    Attributes
    ----------
    steps : sequence of Step
        The accepted steps in order; their tests are lists. They may be created on access, since the engine needs only the last three.
    strides, lengths : (N,) float
        Requested length and arclength of each step.
    ds, trial : float, Step or None
        Length of the step after them, and that step if it was tried and is not plain. The engine then examines it.
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
    code, test : str, int
        Type, as the problem's `classify` gave it, and index of the test function that marked it.
    status : str
        ``"located"``: a zero or a change of key, inside `bracket`. ``"bracketed"``: it happens inside `bracket`, but is no zero
        (a pole or a jump) or could not be brought nearer.
    arclength, bracket : float, tuple of float
        Where it is, and the arclengths between which it certainly is.
    residual : float
        |test function| at `point`; 0 for a change of key, and where it is nan for being rounding.
    point, index : Step, int
        The corrected point at the event, and its index among the points of the run.
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
    index, arclength : int, float
        Place in the run, and arclength from the first point.
    step : Step
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


@dataclass(slots=True, eq=False, repr=False)
class PlainPoints(Sequence[Point]):
    """A sequence of consecutive points without events. Each `Point` is created on access.

    Parameters
    ----------
    begin : int
        Index of the first point in the run.
    arclengths, strides : (N,) float
        Arclength of each, and the length of the step that led there.
    steps : sequence of N Step
    seen : callable, optional
        Converts a step to the orientation of the run; by default steps are unchanged.
    """

    begin: int
    arclengths: np.ndarray
    strides: np.ndarray
    steps: Sequence[Step]
    seen: Callable[[Step], Step] | None = None

    def __len__(self) -> int:
        return len(self.steps)

    def __getitem__(self, place: int) -> Point:  # type: ignore[override]
        place = range(len(self.steps))[place]
        step = self.steps[place]
        arclength, stride = float(self.arclengths[place]), float(self.strides[place])
        return Point(self.begin + place, arclength, step if self.seen is None else self.seen(step), stride)


Piece = list[Point] | PlainPoints


@dataclass(eq=False, repr=False)
class Points(Sequence[Point]):
    """The points of a run, in pieces: lists of points, and blocks of steps. `begins`: index of the first point of each piece."""

    pieces: list[Piece] = field(default_factory=list)
    begins: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return self.begins[-1] + len(self.pieces[-1]) if self.pieces else 0

    def __iter__(self) -> Iterator[Point]:
        return chain.from_iterable(self.pieces)

    @overload
    def __getitem__(self, place: int) -> Point: ...

    @overload
    def __getitem__(self, place: slice) -> list[Point]: ...

    def __getitem__(self, place: int | slice) -> Point | list[Point]:
        if isinstance(place, slice):
            return list(self)[place]
        place = range(len(self))[place]
        k = bisect_right(self.begins, place) - 1
        return self.pieces[k][place - self.begins[k]]

    def add(self, piece: Piece) -> None:
        """Add some points; single ones are put to those before them."""
        if isinstance(piece, list) and self.pieces and isinstance(self.pieces[-1], list):
            self.pieces[-1] += piece
        elif len(piece):
            self.begins.append(len(self))
            self.pieces.append(list(piece) if isinstance(piece, list) else piece)

    def mark(self, point: Point) -> None:
        """Put a point in the place of the single point with its index."""
        k = bisect_right(self.begins, point.index) - 1
        piece = self.pieces[k]
        assert isinstance(piece, list)
        piece[point.index - self.begins[k]] = point

    def arclengths(self) -> np.ndarray:
        """Arclength of each, (N,)."""
        return np.concatenate(
            [np.empty(0), *(p.arclengths if isinstance(p, PlainPoints) else [point.arclength for point in p] for p in self.pieces)]
        )


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
       or ``"interrupted"``. Where a crossing is no zero to its accuracy, no event is reported: the `End` names it.
    6. `residual(y)` (n,) and `jacobian(y)` (n, n + 1) are used for switching only.

    Optional, found by name:

    - ``advance(recent, ds, goal, room, control) -> Advance``: many plain steps at once, for speed alone (see `Advance`).
    - ``failure(y, tangent, ds) -> str``: words for where steps fail.
    - ``step_near(y, tangent, ds, guess) -> Step``: the step of duty 3 with its corrector started at the unknowns `guess`.
    - ``step_between(before, s, low, high, least_turn) -> (Step, bool)``, beside `advance`: the step of length s, its corrector started at
      the cubic through two known steps (pairs of length and `Step`); and whether it is on another family than these.
    - ``narrow(before, low, high, index, tolerance, least_turn, known) -> list``, beside `advance`, for speed alone: steps that close in
      on a zero of test `index` between two known steps as `continuation.bracketing.bracketed_root` does. `known`: the samples in order.
    - ``refined(index, at) -> Step | None``: the event of test `index` to full accuracy, where steps bring it no nearer than the step `at`
      (whose tangent and turn it has); None if that is as near as it gets.
    - ``shares_fold(y) -> bool``: whether the parameter has an extremum at the unknowns y, a branch point, along each family through it.
    - ``beyond(at) -> (Step, Step) | None``: the branch point just ahead of the step `at`, and the point of the family as far behind it.
      It is for runs that no step leads past the branch point.
    - ``symmetries(y) -> list``: functions that take unknowns to those of their image (`continuation.images.Symmetry`), and ``sizes(y)``
      (n + 1,), of the unknowns: with them a run ends at the image of its start, and goes over to no family of more symmetry.
    - ``second_derivative(y, a, b)`` (n,), F''(y)[a, b], and ``weights`` (n + 1,), the metric as a diagonal, for switching.
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
    IMAGE = "the family is its own image from here on: what follows are images of what was followed; nothing is left to follow"
    REPEATED = "the family repeats itself: it passes one branch point for the third time; what follows are images of what was followed"
    EVENT = "the family ends at this event; other families begin there: continue from the event"
    STOP_AT = "an event of a type to stop at was reached; start again from the last point to go on"
    STOP_WHEN = "the stop condition held; start again from the last point to go on"
    POINTS = "the number of points was reached; allow more points, or start again from the last point"
    NOT_ASKED = "this direction was not asked for; start again from this point to go there"
    INTERRUPTED = "the run was interrupted here; trace on from this point"
    MINIMUM_STEP = (
        "steps failed down to the shortest length; the family may end here, turn sharply, or need more digits than numbers have: "
        "its last point shows what it approaches"
    )
    SADDLE = "the family ends at an equilibrium, near which its orbits dwell ever longer; none of them turns beyond it"
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


class End(NamedTuple):
    """The end of a run: `reason`, `detail` in words (may be empty), the `tally` of steps, and words for what could not be located."""

    reason: EndReason
    detail: str = ""
    tally: Tally = Tally()
    unlocated: str = ""

    @property
    def text(self) -> str:
        """The reason in words with its detail."""
        return (f"{self.reason.text} ({self.detail})" if self.detail else self.reason.text) + self.unlocated
