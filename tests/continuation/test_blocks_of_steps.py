"""A problem that marches by itself gives the run that the engine finds step by step. Oracle: the same problem without `advance`."""

import math

import numpy as np
import pytest

from continuation import Settings, TestFunction, follow, follow_both_ways
from continuation.control import ACCEPTED, NEAR_GOAL, arclength_of, distance, height, kinds_of, next_step, refusal, watch
from continuation.problem import Advance
from tests.continuation.curves import Eight, Line, Ring, circle, cubic, ellipse, hyperbola, parts, pitchfork


class Marching:
    """Any problem with an advance in plain Python, by the functions that the contract names. patient: the first two steps of a run wait
    for the third one."""

    def __init__(self, problem, patient=False):
        self.problem = problem
        self.patient = patient
        self.blocks = []

    def __getattr__(self, name):
        return getattr(self.problem, name)

    def advance(self, recent, ds, goal, room, control):
        step, tests, older, oldest, before, first = recent
        goal, direction = goal.step.position, goal.direction
        kinds, singular = kinds_of(self.problem.tests), [test.singular for test in self.problem.tests]
        steps, strides, lengths, trial = [], [], [], None
        waits, waiting, initial = self.patient and before == 0.0 and room > 2, 0, ds
        while len(steps) < room and trial is None:
            if direction is None and steps:
                direction = np.subtract(steps[0].position, goal)
            new = self.problem.step(step.y, step.tangent, ds)
            new = new._replace(tests=[float(value) for value in new.tests])
            chord = distance(step.position, new.position) if new.converged else math.inf
            length = arclength_of(chord, new.turn)
            if (
                not new.converged
                or refusal(new.turn, new.contraction, chord, ds, control) != ACCEPTED
                or (passes(step, new, goal, direction) and distance(new.position, goal) <= NEAR_GOAL * chord)
            ):
                trial = new
            elif waits and len(steps) < 2:
                waiting = len(steps) + 1
            else:
                for which in range(2 - waiting, 3):
                    if watch(kinds, singular, (oldest, older, tests, new.tests), (first, before, length), which):
                        trial, waiting = new, 2 - which
                        break
                else:
                    waiting = 0
            if trial is None:
                steps.append(new)
                strides.append(ds)
                lengths.append(length)
                ds = next_step(ds, new.turn, new.contraction, control)
                step, oldest, older, tests, first, before = new, older, tests, new.tests, before, length
            elif waiting and steps:
                trial, ds = steps[0], initial
                steps, strides, lengths = [], [], []
        self.blocks.append(len(steps))
        return Advance(steps, np.array(strides), np.array(lengths), ds, trial)


def passes(old, new, goal, direction):
    return direction is not None and height(old.position, goal, direction) < 0.0 <= height(new.position, goal, direction)


EVENTS = (
    (TestFunction("A", "crossing"), lambda s: math.sin(3 * s)),
    (TestFunction("D", "crossing"), lambda s: math.cos(s) - 0.9999),
    (TestFunction("K", "change"), lambda s: float(math.floor(1.7 * s))),
)
GUARD = (TestFunction("G", "guard", terminal=True), lambda s: 5.03 - abs(s))
SHORT = Settings(initial_step=0.1, maximum_step=0.1, maximum_points=150)
CASES = {
    "closes": (circle, [0.6, 0.8], {}),
    "ellipse": (lambda: ellipse(2.0, 0.5), [2.0, 0.0], {}),
    "folds": (cubic, [0.0, 0.0], {"maximum_points": 120}),
    "turns sharply": (lambda: hyperbola(1e-2), [1.0, -1.0], {"maximum_points": 100}),
    "branch point": (pitchfork, [0.0, -0.5], {"maximum_points": 80}),
    "events": (lambda: Line(*EVENTS, GUARD), [0.3], {"initial_step": 0.1, "maximum_step": 0.1}),
    "events on a ring": (lambda: Ring(*EVENTS), [0.3], {"initial_step": 0.1, "maximum_step": 0.1}),
    "fails": (lambda: Line(*EVENTS, broken=lambda s: s > 4.0), [0.3], {"maximum_points": 100}),
    "contracts badly": (lambda: Line(contraction=lambda ds: 8.0 * ds), [0.3], {"maximum_points": 50}),
}


def same(a, b):
    """Two lists of points, or of events, with the same numbers."""
    assert len(a) == len(b)
    for x, y in zip(a, b, strict=True):
        assert x.index == y.index and x.arclength == y.arclength
        p, q = getattr(x, "step", None) or x.point, getattr(y, "step", None) or y.point
        assert np.array_equal(p.y, q.y) and np.array_equal(p.tangent, q.tangent)
        assert [float(v) for v in p.tests] == pytest.approx([float(v) for v in q.tests], rel=0, abs=0, nan_ok=True)


@pytest.mark.parametrize("points", [None, 66])
@pytest.mark.parametrize("patient", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_a_march_is_the_run_step_by_step(case, patient, points):
    require_a_march_is_the_run_step_by_step(case, patient, points)


def require_a_march_is_the_run_step_by_step(case, patient, points):
    make, start, options = CASES[case]
    settings = Settings(**{**options, **({} if points is None else {"maximum_points": points})})
    marching = Marching(make(), patient)
    begin = np.array(start)
    alone = follow_both_ways(make(), begin, settings)
    together = follow_both_ways(marching, begin, settings)
    same(alone.points, together.points)
    same(alone.events, together.events)
    assert alone.ends == together.ends and alone.start == together.start
    for a, b in zip(alone.points, together.points, strict=True):
        assert a.step_size == b.step_size and (a.event is None) is (b.event is None)
    assert points is not None or sum(marching.blocks) > 0.3 * len(alone.points)


@pytest.mark.parametrize(
    ("make", "options"),
    [
        *((lambda: Line(GUARD), {"stop_when": lambda point, number=number: point.index == number}) for number in (1, 2, 30, 64, 65, 66)),
        (lambda: Line(*EVENTS), {"stop_at": {"A"}}),
        (Eight, {"direction": 0, "settings": Settings(maximum_step=0.1)}),  # it passes its start with another tangent
    ],
)
def test_blocks_in_one_direction_are_the_run_step_by_step(make, options):
    """Points computed ahead of a stop are not given, and not counted."""
    start = Eight().step(np.zeros(2), np.array([1.0, 2.0]) / math.sqrt(5), 0.0) if make is Eight else np.array([0.3])
    alone, together = (parts(follow(problem, start, **{"settings": SHORT, **options})) for problem in (make(), Marching(make())))
    same(alone[0], together[0])
    same(alone[1], together[1])
    assert alone[2] == together[2] and (make is not Eight or alone[2][0].reason.name == "CLOSED")
    assert "stop_when" not in options or alone[2][0].tally.accepted == alone[0][-1].index
