"""Pseudo-arclength continuation: step control, rejection of steps, events in order, and the reason why the run ends.

Plain points come in blocks from a problem that can advance by itself, or one by one; both ways use the same functions of
`continuation.control`. Everything else - event location, refused steps, a family that closes - is done here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from bvp.dense import inner, length
from continuation.bracketing import StepRefused, bracketed_root
from continuation.control import (
    ACCEPTED,
    BLOCK,
    JUMPED,
    NEAR_BRANCH_POINT,
    NEAR_GOAL,
    NOT_CONVERGED,
    SLOW,
    TURNED,
    Settings,
    arclength_of,
    control_of,
    distance,
    height,
    next_step,
    refusal,
    watch,
)  # fmt: skip
from continuation.events import EventFinder, FoundEvent, arclength_between, make_event
from continuation.images import Images
from continuation.location import Locator
from continuation.problem import Advance, End, EndReason, Event, Goal, PlainPoints, Point, Problem, Recent, Step, Tally

REPEATED = 1e-9
"""Relative difference of the parameter at one branch point that is passed again."""

LEAP = 100.0
"""A leap over a branch point is at most this many times as long as the step that was refused."""

AFTER = 64.0
"""Length of the first step behind a branch point that no step led past, in shortest steps."""

_LEVEL = 1e-8  # a smaller |slope| at the start is no direction
_BESIDE = 0.1  # least distance, as a part of a step, of places whose test functions give a bend
_PARALLEL = 0.999  # cosine between the tangents at one point of one curve, at least

_CAUSES = {
    NOT_CONVERGED: "the corrector does not converge",
    SLOW: "the corrector contracts by {contraction:.3g} only",
    TURNED: "the tangent rotates too far",
    JUMPED: "the corrector goes {chord:.3g} away in a step of {ds:.3g}",
}

StopWhen = Callable[[Point], "bool | str"]


def first_step(problem: Problem, start: np.ndarray | Step, direction: int) -> Step | str:
    """The first point of a run, corrected and oriented, or words that say why there is none.

    Parameters
    ----------
    problem : Problem
        The problem.
    start : ndarray (n + 1,) or Step
        Where to begin. A `Step` is taken as it is.
    direction : int
        +1 or -1: sign of the slope of the parameter; where the slope is zero, the tangent as it comes (+1) or reversed (-1).
        0: the tangent as it comes.
    """
    if direction not in (-1, 0, 1):
        raise ValueError(f"direction = {direction!r}: expected +1, -1 or 0")
    step = start if isinstance(start, Step) else problem.begin(np.asarray(start, dtype=float))
    if not step.converged:
        return "the corrector did not converge at the start"
    if not all(math.isfinite(x) for x in step.position):
        return "the start has no finite position"
    sense = direction
    if direction and abs(step.slope) > _LEVEL and step.slope < 0:
        sense = -direction
    if sense < 0:
        reversed_step = problem.step(step.y, -step.tangent, 0.0)
        if not reversed_step.converged:
            return "the corrector did not converge at the start with its tangent reversed"
        return reversed_step
    return step


def follow(
    problem: Problem,
    start: np.ndarray | Step,
    direction: int = 1,
    settings: Settings | None = None,
    stop_when: StopWhen | None = None,
    stop_at: Collection[str] = frozenset(),
) -> Iterator[Point | Event | End]:
    """Follow a family from a start in one direction.

    Parameters
    ----------
    problem : Problem
        The equations of the family; `Problem` lists its duties.
    start : ndarray (n + 1,) or Step
        A guess of the first point, or a point that is corrected already.
    direction : int
        +1 or -1: sign of the slope of the parameter at the first step; where the slope is zero, the tangent of the start as it
        comes (+1) or reversed (-1). 0: along the tangent as it comes.
    settings : Settings, optional
        Step control, limits, tolerances.
    stop_when : callable, optional
        Called with every `Point` after the start. The run ends there if it returns True or a text with the reason.
    stop_at : collection of str, optional
        The family ends at the first event with one of these codes.

    Yields
    ------
    Point
        Each point as it is accepted, in order of arclength; a point at an event has its `event`.
    Event
        Each event, right after its point.
    End
        Last, and once.

    Raises
    ------
    ValueError
        For an unknown direction or test function.

    Notes
    -----
    Each point is corrected from the last one. A step is refused and halved if

    - the corrector fails or contracts badly,
    - the tangent rotates by more than `Settings.maximum_turn`,
    - the chord is more than twice the step, or
    - a step to an event inside it is refused for one of these reasons. This detects a jump to another branch: it changes the sign of
      a bordered determinant without a zero.

    Turn and contraction grow with the square of the step, so the next length is chosen to bring both to their targets.

    An event or a guard within `Settings.location_tolerance` of the start belongs to the start. It is not reported here:
    `continuation.follow_both_ways`, which sees both sides, reports it.

    Examples
    --------
    >>> import numpy as np
    >>> from continuation import GenericProblem, Settings, follow
    >>> circle = GenericProblem(lambda y: np.array([y[0]**2 + y[1]**2 - 1]), lambda y: np.array([[2*y[0], 2*y[1]]]))
    >>> *path, end = follow(circle, np.array([1.0, 0.1]), settings=Settings(maximum_points=200))
    >>> end.reason.name, [round(item.point.parameter, 9) for item in path if hasattr(item, "code")]
    ('CLOSED', [1.0, -1.0])
    """
    settings = Settings() if settings is None else settings
    first = first_step(problem, start, direction)
    if isinstance(first, str):
        yield End(EndReason.NO_START, first)
        return
    for item in follow_in_blocks(problem, first, settings, stop_when, stop_at, Allowance(settings.maximum_points)):
        if isinstance(item, PlainPoints):
            yield from item
        else:
            yield item


@dataclass(slots=True)
class Allowance:
    """How many points may still be made; shared by the two directions of a trace, which may `resume` when there are more."""

    points: int
    resume: bool = False


def follow_in_blocks(
    problem: Problem,
    first: Step,
    settings: Settings,
    stop_when: StopWhen | None,
    stop_at: Collection[str],
    allowance: Allowance,
    goal: Goal | None = None,
    *,
    once: bool = False,
) -> Iterator[Point | PlainPoints | Event | End]:
    """The run that `follow` describes, from a corrected and oriented start. Without `stop_when`, the points of a block of steps are
    yielded together.

    It yields an `End` with reason POINTS when the allowance is used up. If the caller raises the allowance, the next item continues
    the run. Every other `End` is the last item. The family is closed when the run returns to the `goal`, by default the start. It ends at
    an image of the start, and, to be followed `once`, at a branch point with more symmetry, behind which it is its own image.
    """
    advance = getattr(problem, "advance", None)
    finder = EventFinder(problem, settings)
    tolerance, exact, shortest = settings.coincidence_tolerance, settings.location_tolerance, settings.minimum_step
    control = control_of(settings)
    counts = [0] * len(Tally._fields)  # by verdict
    goal = Goal(first) if goal is None else goal
    images = Images(problem, first)
    point = Point(0, 0.0, first)
    recent = Recent(first, list(map(float, first.tests)), finder.undefined, finder.undefined)
    index, arclength, ds = 0, 0.0, settings.initial_step
    allowance.points -= 1
    yield point
    met: list[float] = []  # the parameter at the branch points so far
    fallback = 0.0  # length of the next try if a leap fails; inf when it has failed
    trial: Step | None = None  # the step of length ds where it was tried already

    def end(reason: EndReason, detail: str = "") -> End:
        return End(reason, detail, Tally(*counts), "".join(f"; {words}" for words in finder.unlocated.values()))

    while True:
        while allowance.points <= 0:
            yield end(EndReason.POINTS)
            if not allowance.resume:
                return
        if trial is None and advance is not None:
            taken: Advance = advance(recent, ds, goal, min(allowance.points, BLOCK), control)
            ds, trial = taken.ds, taken.trial
            count = images.plain(recent.step, taken.steps)
            if count < len(taken.steps):
                ds, trial = float(taken.strides[count]), taken.steps[count]
                taken = Advance(taken.steps[:count], taken.strides[:count], taken.lengths[:count], ds, trial)
            if count:
                fallback = 0.0
                if goal.direction is None:
                    goal = Goal(first, np.asarray(taken.steps[0].position) - np.asarray(first.position))
                arclengths = np.cumsum(np.concatenate([[arclength], taken.lengths]))[1:]
                plain = PlainPoints(index + 1, arclengths, taken.strides, taken.steps)
                for piece in (plain,) if stop_when is None else plain:
                    made = len(piece) if isinstance(piece, PlainPoints) else 1
                    counts[ACCEPTED] += made
                    index += made
                    allowance.points -= made
                    yield piece
                    if isinstance(piece, Point) and stop_when is not None and (words := stop_when(piece)):
                        yield end(EndReason.STOP_WHEN, words if isinstance(words, str) else "")
                        return
                for k in range(max(0, count - 3), count):
                    step = taken.steps[k]
                    recent = Recent(step, step.tests, recent.tests, recent.older, float(taken.lengths[k]), recent.length)
                point = plain[-1]
                arclength = point.arclength
                continue
        cause = ""
        found: list[FoundEvent] = []
        closed: EndReason | None = None
        tests: Any
        position: Any = recent.step.position
        new = problem.step(recent.step.y, recent.step.tangent, ds) if trial is None else trial
        trial = None
        chord, length, verdict = math.inf, 0.0, NOT_CONVERGED
        if new.converged:
            chord = distance(position, new.position)
            verdict = refusal(new.turn, new.contraction, chord, ds, control)
        if verdict != ACCEPTED:
            counts[verdict] += 1
            cause = _CAUSES[verdict].format(contraction=new.contraction, chord=chord, ds=ds)
        elif images.gains(new.y):
            counts[JUMPED] += 1
            cause = f"a step of {ds:.3g} goes over to a family of more symmetry"
        else:
            goals = [] if goal.direction is None else [(goal, EndReason.CLOSED), *((g, EndReason.IMAGE) for g in images.goals(recent.step))]
            for target, reached in goals:
                if closed is None and distance(new.position, target.step.position) <= NEAR_GOAL * chord:
                    landed = landing(problem, settings, target, point, new, ds)
                    if landed is not None:
                        ds, new = landed
                        chord = distance(position, new.position)
                        closed = reached
            length = arclength_of(chord, new.turn)
            tests = new.tests
            if type(tests) is not list:  # comparing array items is far slower
                tests = list(map(float, tests))
            leaping = 0.0 < fallback < math.inf
            lengths = recent.length_before, recent.length, length
            if leaping or watch(finder.kinds, finder.singular, (recent.oldest, recent.older, recent.tests, tests), lengths):
                history = [(-recent.length - recent.length_before, recent.oldest), (-recent.length, recent.older)]
                try:
                    found = finder.find(history, point, Point(index + 1, arclength + length, new, ds), ds)
                except StepRefused as refused:
                    counts[JUMPED] += 1
                    cause = f"{refused} (inside a step of {ds:.3g})"
                else:
                    if leaping and not any(problem.tests[event.index].singular for event in found):
                        counts[JUMPED] += 1
                        cause = "a leap meets no branch point"
                    elif closed is None:
                        # an accepted point on an event, or beside a branch point, would have test functions of undecided sign
                        on_event = any(ds - event.location.s <= tolerance and not event.details.terminal for event in found)
                        sizes = zip(recent.tests, tests, finder.singular, strict=True)
                        near = any(s and abs(b) < NEAR_BRANCH_POINT * abs(a) for a, b, s in sizes)
                        if (on_event and ds > 4 * tolerance) or (near and ds > 4 * shortest):
                            ds *= 0.75
                            continue
        reach = ds
        if cause:
            # The corrector fails if a step lands too near to a branch point: try the point as far behind it as this one is before.
            leap = 2.0 * finder.distance_to_branch_point(recent.older, recent.tests, recent.length)
            if fallback == 0.0 and shortest < leap < LEAP * ds:
                fallback, ds = 0.5 * ds, leap
                continue
            ds, fallback = (fallback, math.inf) if 0.0 < fallback < math.inf else (0.5 * ds, fallback)
            if ds >= shortest:
                continue
            passed = finder.passed(point)
            if passed is None:
                words = f"{cause} at arclength {arclength:.6g}"
                failure = getattr(problem, "failure", None)
                if failure is not None:
                    words += f"; {failure(recent.step.y, recent.step.tangent, 2 * ds)}"
                yield end(EndReason.MINIMUM_STEP, words)
                return
            found, new = [passed[0]], passed[1]
            crossing = passed[0].location
            ds, tests, closed = AFTER * shortest, list(map(float, new.tests)), None
            reach = length = crossing.s + arclength_of(distance(crossing.step.position, new.position), 1.0)

        counts[ACCEPTED] += 1
        fallback = 0.0
        places: list[tuple[float, Step, FoundEvent | None]] = []  # what the step leads to, in order
        for located in found:
            if located.between is not None:
                places.append((*located.between, None))
            places.append((located.location.s, located.location.step, located))
        for stride, at, event in [*places, (reach, new, None)]:
            s = length if at is new else arclength_between(position, at)
            guard = event is not None and problem.tests[event.index].kind == "guard"
            if event is not None and not guard and (arclength + s <= exact or (closed is EndReason.CLOSED and length - s <= exact)):
                continue  # at the start
            while allowance.points <= 0:
                yield end(EndReason.POINTS)
                if not allowance.resume:
                    return
            index += 1
            allowance.points -= 1
            special = None if event is None else make_event(event, position, arclength, index)
            point = Point(index, arclength + s if special is None else special.arclength, at, stride, special)
            yield point
            if special is not None:
                yield special
                reason = None
                if problem.tests[special.test].singular:
                    met.append(special.point.parameter)
                    reason = EndReason.REPEATED if sum(abs(value - met[-1]) <= REPEATED * abs(met[-1]) for value in met) > 2 else None
                    if once and images.gains(special.point.y):
                        reason = EndReason.IMAGE
                if special.terminal:
                    reason = EndReason.EVENT
                elif reason is None and special.code in stop_at:
                    reason = EndReason.STOP_AT
                if reason is not None:
                    yield end(reason, f"{special.code} at arclength {special.arclength:.9g}")
                    return
            if stop_when is not None and (words := stop_when(point)):
                yield end(EndReason.STOP_WHEN, words if isinstance(words, str) else "")
                return
        arclength += length
        if closed is not None:
            yield end(closed, f"length {arclength:.9g}")
            return
        if goal.direction is None:
            goal = Goal(first, np.asarray(new.position) - np.asarray(first.position))
        recent = _remembered(recent, Recent(new, tests, recent.tests, recent.older, length, recent.length), places)
        ds = next_step(ds, new.turn, new.contraction, control)


def _remembered(before: Recent, after: Recent, places: list[tuple[float, Step, FoundEvent | None]]) -> Recent:
    """The end of a step as it is remembered: with the last places inside the step, where it has events, instead of the points before it.

    Test functions can bend much inside a step. Over the next one their bend is then taken from beside it. Places that are close to each
    other are passed over: their second differences are rounding."""
    inside = [(arclength_between(before.step.position, step), list(map(float, step.tests))) for _, step, _ in places]
    known = [(-before.length, before.older), (0.0, before.tests), *inside]
    kept, end = list[tuple[float, Any]](), after.length
    for s, tests in reversed(known):
        is_defined = s <= 0.0 or all(a == a or b != b for a, b in zip(tests, after.tests, strict=True))
        if len(kept) < 2 and is_defined and end - s >= _BESIDE * after.length:
            kept.append((s, tests))
            end = s
    if len(kept) < 2:
        return after
    (s, older), (first, oldest) = kept
    return after._replace(older=older, oldest=oldest, length=after.length - s, length_before=s - first)


def landing(problem: Problem, settings: Settings, goal: Goal, before: Point, after: Step, ds: float) -> tuple[float, Step] | None:
    """The step from `before` that lands on the goal, with its length; None if the step to `after`, of length ds, does not pass the goal.

    The run passes the goal where its position goes through the plane there at right angles to the goal's direction. The step is shortened
    to land on that plane. The family is closed if it lands on the goal itself, in position and in the unknowns, with its tangent pointing
    the same way.
    """
    target = goal.step
    low, high = (float(height(step.position, target.position, goal.direction)) for step in (before.step, after))
    if not low < 0.0 <= high:
        return None
    locator = Locator(problem, before, ds, after, settings)
    try:
        found = bracketed_root(
            lambda s: float(height(locator.step(s).position, target.position, goal.direction)),
            0.0, low, ds, high, settings.location_tolerance,
        )  # fmt: skip
        step = locator.step(found.root)
    except StepRefused:
        return None
    near = settings.coincidence_tolerance
    if found.interrupted or math.dist(step.position, target.position) > near:
        return None
    if float(np.max(np.abs(step.y - target.y))) > near * (1.0 + float(np.max(np.abs(target.y)))):
        return None
    # Behind a tangent its curvature can stand, which is not known at every start.
    one, other = step.tangent[: step.y.size], target.tangent[: step.y.size]
    if not inner(one, other) > _PARALLEL * length(one) * length(other):
        return None  # another branch through the same point
    return found.root, step
