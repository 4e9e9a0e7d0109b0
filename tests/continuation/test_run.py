"""Both directions put together. Oracles: one run through the whole family; exact places on lines and circles."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from continuation import EndReason, GenericProblem, Settings, TestFunction, follow_both_ways
from tests.continuation.curves import Line, Ring, circle, cubic

TESTS = (
    (TestFunction("A", "crossing"), lambda s: s + 1.234),
    (TestFunction("O", "crossing", oriented=True), lambda s: s - 0.77),
    (TestFunction("K", "change"), lambda s: float(math.floor(s + 0.5))),
    (TestFunction("LOW", "guard", terminal=True), lambda s: s + 2.1),
    (TestFunction("HIGH", "guard", terminal=True), lambda s: 3.3 - s),
)
SHORT = Settings(initial_step=0.1, maximum_step=0.1, maximum_points=200)


def consistent(run):
    """What holds for every run."""
    assert [point.index for point in run.points] == list(range(len(run.points)))
    arclength = [point.arclength for point in run.points]
    assert arclength == sorted(arclength) and arclength[0] == 0
    assert [event.arclength for event in run.events] == sorted(event.arclength for event in run.events)
    for event in run.events:
        assert event.bracket[0] <= event.arclength <= event.bracket[1]
        assert run.points[event.index].arclength == event.arclength
        assert run.points[event.index].event is not None and run.points[event.index].step is event.point
    for a, b in zip(run.points, run.points[1:], strict=False):
        assert float((b.step.y - a.step.y) @ a.step.tangent) >= -1e-15


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("start", [0.0, -1.9, 3.0])
def test_two_directions_are_one_run(start, direction):
    run = follow_both_ways(Line(*TESTS), np.array([start]), SHORT, direction=direction)
    consistent(run)
    places = {"LOW": [-2.1], "A": [-1.234], "K": [-1.5, -0.5, 0.5, 1.5, 2.5], "O": [0.77], "HIGH": [3.3]}
    for code, exact in places.items():
        found = [event.point.parameter for event in run.events if event.code == code]
        assert found == pytest.approx(sorted(exact, reverse=direction < 0), abs=2e-10)
    first, last = (-2.1, 3.3) if direction > 0 else (3.3, -2.1)
    assert run.points[0].step.parameter == pytest.approx(first, abs=1e-9)
    assert run.points[-1].step.parameter == pytest.approx(last, abs=1e-9)
    assert run.points[-1].arclength == pytest.approx(5.4, abs=1e-9)
    assert [end.reason for end in run.ends] == [EndReason.EVENT, EndReason.EVENT]
    assert run.points[run.start].step.parameter == start and run.points[run.start].event is None
    assert all(point.step.slope == direction and point.step.tangent[0] == direction for point in run.points)
    for point in run.points:  # the oriented test points one way along the whole run
        assert float(point.step.tests[1]) == pytest.approx(direction * (point.step.parameter - 0.77), abs=1e-12)


@given(st.sampled_from([1e-17, -1e-17, 0.0, 1e-9, -1e-9, 3e-11]), st.sampled_from([1, -1]), st.booleans())
@hypothesis_settings(max_examples=20, deadline=None)
def test_event_on_the_start_is_reported_once(offset, direction, oriented):
    problem = Line((TestFunction("A", "crossing", oriented=oriented), lambda s: math.sin(s + offset)))
    run = follow_both_ways(problem, np.array([0.0]), Settings(maximum_points=30, initial_step=0.1, maximum_step=0.1), direction=direction)
    consistent(run)
    (event,) = run.events
    assert (event.index == run.start) is (abs(offset) <= 1e-10)  # an event further away than brackets are wide is no longer at the start
    assert event.arclength == pytest.approx(run.points[run.start].arclength - direction * offset, abs=2e-10)
    assert event.residual <= 1e-9 and event.status == "located"


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(
    ("function", "events"), [(lambda s: 11.0, ["END"]), (lambda s: s - 0.95, ["A", "END"])], ids=["no zero", "a zero on the start"]
)
@pytest.mark.parametrize("noise", [-1e3, 1e3, math.nan])
def test_noise_at_the_end_of_a_family_is_no_sign_beside_a_start_next_to_it(direction, function, events, noise):
    """Oracle: the zeros of the function. At the end, one step from the start, it is large noise of any sign, as multipliers are at a
    grazing."""
    guard, test = TestFunction("END", "guard", terminal=True), TestFunction("A", "crossing")
    problem = Line((guard, lambda s: 1.0 - s), (test, lambda s: function(s) if s < 1.0 - 5e-11 else noise))
    run = follow_both_ways(problem, np.array([0.95]), replace(SHORT, maximum_points=20), direction=direction)
    consistent(run)
    assert sorted(event.code for event in run.events) == events
    assert all(event.index == run.start for event in run.events if event.code == "A")


def test_start_on_a_branch_point_and_fold_is_one_branch_point():
    """On the side branch of the pitchfork, followed with its exact tangent: the start is the origin."""
    problem = Line(
        (TestFunction("SN", "crossing", oriented=True), lambda s: s),
        (TestFunction("BP", "crossing", oriented=True, absorbs=("SN",)), lambda s: -s),
    )
    run = follow_both_ways(problem, np.array([0.0]), Settings(maximum_points=20))
    assert [(event.code, event.details) for event in run.events] == [("BP", {"absorbed": ("SN",)})]


@pytest.mark.parametrize("number", [40, 66, 100, 133])
def test_family_that_closes_late_is_covered_at_most_once(number):
    """With half of the points for each direction the circle may close in either, or not at all."""
    run = follow_both_ways(circle(), np.array([math.cos(0.3), math.sin(0.3)]), Settings(maximum_points=number))
    consistent(run)
    assert len(run.points) <= number
    assert len(run.events) == (2 if number >= 66 else 1)
    assert run.closed == (run.points[-1].arclength > 6.28)
    assert run.points[-1].arclength < 2 * math.pi + 1e-9
    if number >= 100:
        assert run.closed


@pytest.mark.parametrize("number", [1, 2, 3, 10, 11])
def test_points_limit_is_for_both_directions_together(number):
    run = follow_both_ways(Line(), np.array([0.0]), Settings(maximum_points=number))
    assert len(run.points) == number
    assert [end.reason for end in run.ends] == [EndReason.POINTS, EndReason.POINTS]
    consistent(run)


@pytest.mark.parametrize(("code", "bound"), [("LOW", lambda s: s + 0.2), ("HIGH", lambda s: 0.2 - s)])
def test_a_direction_takes_the_points_that_the_other_leaves(code, bound):
    run = follow_both_ways(Line((TestFunction(code, "guard", terminal=True), bound)), np.array([0.0]), SHORT)
    assert len(run.points) == SHORT.maximum_points
    assert [end.reason for end in run.ends] == [EndReason.EVENT, EndReason.POINTS][:: 1 if code == "LOW" else -1]
    consistent(run)


def test_one_direction_alone():
    run = follow_both_ways(Line(*TESTS), np.array([0.0]), SHORT, both=False, direction=-1)
    assert run.points[-1].step.parameter == pytest.approx(-2.1, abs=1e-9) and run.points[0].step.parameter == 0
    assert run.ends[0].reason is EndReason.NOT_ASKED and "not asked for" in run.ends[0].text
    consistent(run)


def test_same_family_from_two_starts():
    """The cubic from either side gives the same folds at the same distance."""
    lengths = []
    for x in (-1.5, 1.5):
        run = follow_both_ways(cubic(), np.array([x, x**3 - x]), Settings(maximum_points=150), direction=1)
        consistent(run)
        assert len(run.events) == 2
        lengths.append(run.events[1].arclength - run.events[0].arclength)
        assert all(np.sign(event.point.tangent[0]) == np.sign(run.points[0].step.tangent[0]) for event in run.events)
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-4)


def test_callbacks_hear_everything_as_it_is_found():
    points, events = [], []
    run = follow_both_ways(Line(*TESTS), np.array([0.0]), SHORT, on_points=points.extend, on_event=events.append)
    assert len(points) == len(run.points) and len(events) == len(run.events)
    assert {event.code for event in events} == {event.code for event in run.events}


def test_stop_conditions_hold_in_both_directions():
    run = follow_both_ways(Line(*TESTS), np.array([0.0]), SHORT, stop_at={"O"}, stop_when=lambda point: point.step.parameter < -1)
    assert [end.reason for end in run.ends] == [EndReason.STOP_WHEN, EndReason.STOP_AT]
    assert run.tally.accepted == run.ends[0].tally.accepted + run.ends[1].tally.accepted


def test_no_start_is_an_empty_run_with_words():
    nowhere = GenericProblem(lambda y: np.array([y @ y + 1]), lambda y: 2 * y[None, :])
    run = follow_both_ways(nowhere, np.array([0.3, 0.2]))
    assert len(run.points) == 0 and run.events == ()
    assert all(end.reason is EndReason.NO_START for end in run.ends)


@given(st.floats(0, 2 * math.pi), st.integers(90, 140), st.sampled_from([1, -1]))
@example(math.pi / 2, 120, 1)  # the start is a fold itself
@example(-math.pi / 2, 120, 1)
@hypothesis_settings(max_examples=15, deadline=None)
def test_circle_is_covered_once_wherever_the_directions_meet(angle, number, direction):
    """With 90 to 140 points one direction alone may or may not go round; both together always do."""
    start = np.array([math.cos(angle), math.sin(angle)])
    run = follow_both_ways(circle(), start, Settings(maximum_points=number), direction=direction)
    consistent(run)
    assert run.closed and run.points[-1].arclength == pytest.approx(2 * math.pi, abs=1e-8)
    assert sorted(event.point.parameter for event in run.events) == pytest.approx([-1.0, 1.0], abs=1e-9)
    np.testing.assert_allclose(run.points[0].step.y, run.points[-1].step.y, atol=1e-6)
    assert run.points[run.start].step.y == pytest.approx(start, abs=1e-9)


@pytest.mark.parametrize("offset", [0.0, 1e-17, -1e-17, 1e-12, -1e-12, 3e-10, -3e-10, 1e-8, -1e-8])
@pytest.mark.parametrize("direction", [1, -1])
def test_event_on_the_start_of_a_closed_family_is_reported_once(offset, direction):
    problem = Ring((TestFunction("A", "crossing"), lambda angle: math.sin(angle + offset)))
    run = follow_both_ways(problem, np.array([0.0]), direction=direction)
    consistent(run)
    assert run.closed
    places = sorted(math.remainder(event.arclength + direction * offset, 2.0 * math.pi) % math.pi for event in run.events)
    assert len(places) == 2 and all(min(place, math.pi - place) < 2e-10 for place in places)
    assert (run.events[0].index == 0) is (abs(offset) <= 1e-10)


@pytest.mark.parametrize("words", [True, "far enough"])
def test_a_condition_that_holds_at_the_start_ends_it_there(words):
    """Oracle: the definition: one point, and both ends say why."""
    seen = []
    run = follow_both_ways(Line(*TESTS), np.array([0.0]), SHORT, stop_when=lambda p: p.step.parameter < 1 and words, on_points=seen.extend)
    assert [point.step.parameter for point in run.points] == [0.0] and run.events == () and len(seen) == 1
    assert all(end.reason is EndReason.STOP_WHEN and "at the start" in end.detail for end in run.ends)
    assert words is True or all("far enough" in end.detail for end in run.ends)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("off", [0.0, 1e-16, -1e-16, 3e-16])
@pytest.mark.parametrize("end", [-2.0, 3.0])
def test_a_start_at_its_end_is_one_point(end, off, direction):
    """Oracle: exact places: the guard is zero at the start, to rounding; arclength rises from point to point."""
    tests = ((TestFunction("LOW", "guard", terminal=True), lambda s: s + 2.0),
             (TestFunction("HIGH", "guard", terminal=True), lambda s: 3.0 - s))
    run = follow_both_ways(Line(*tests), np.array([end + off]), SHORT, direction=direction)
    consistent(run)
    assert np.all(np.diff([point.arclength for point in run.points]) > 0.0)
    assert [event.code for event in run.events] == ["LOW", "HIGH"][::direction]
    assert [end.reason for end in run.ends] == [EndReason.EVENT, EndReason.EVENT]
    assert run.start in (0, len(run.points) - 1) and run.points[-1].arclength == pytest.approx(5.0, abs=1e-12)
    alone = follow_both_ways(Line(*tests), np.array([end + off]), SHORT, direction=1 if end > 0 else -1, both=False)
    assert [point.event.code for point in alone.points] == ["HIGH" if end > 0 else "LOW"]


@given(st.floats(0.05, 3.0), st.floats(0.2, 5.0), st.sampled_from([1, -1]))
@hypothesis_settings(max_examples=25, deadline=None)
def test_a_guard_is_not_negative_at_its_event(place, power, direction):
    """Oracle: the definition of a guard: the family is valid where it is not negative; exact place of its zero."""
    bound = direction * place
    guard = TestFunction("BOUND", "guard", terminal=True), lambda s: math.copysign(abs(bound - s) ** power, direction * (bound - s))
    run = follow_both_ways(Line(guard), np.array([0.0]), SHORT, direction=direction, both=False)
    assert run.points[-1].event is not None and run.points[-1].step.tests[0] >= 0.0
    assert direction * (bound - run.points[-1].step.parameter) >= 0.0 and run.points[-1].step.parameter == pytest.approx(bound, abs=1e-10)


@pytest.mark.parametrize("place", [1.0, 0.0, 1e-11])
def test_an_event_at_the_start_is_found_where_all_other_points_are_events(place):
    """Oracle: the zeros themselves; the two ends are met in the first step on either side."""
    tests = (
        (TestFunction("A", "crossing"), lambda s: s - place),
        (TestFunction("B", "crossing"), lambda s: s - place - 0.01),
        (TestFunction("END", "guard", terminal=True), lambda s: 0.03 - abs(s - place)),
    )
    run = follow_both_ways(Line(*tests), np.array([place]), Settings(initial_step=0.1, maximum_step=0.1))
    assert [event.code for event in run.events] == ["END", "A", "B", "END"]
    assert [event.point.parameter for event in run.events] == pytest.approx([place - 0.03, place, place + 0.01, place + 0.03], abs=1e-10)
