"""Events on a line whose test functions are known functions of the arclength: the exact places are the oracle."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from continuation import EndReason, EventDetails, Settings, TestFunction, follow, follow_both_ways
from continuation.control import may_hide
from tests.continuation.curves import Line, parts

SHORT = Settings(initial_step=0.1, maximum_step=0.1, maximum_points=60)


def run(problem, settings=SHORT, **options):
    points, events, ends = parts(follow(problem, np.array([0.0]), settings=settings, **options))
    assert len(ends) == 1
    return points, events, ends[0]


@pytest.mark.parametrize("direction", [1, -1])
def test_crossing_is_located_inside_its_bracket_and_is_a_point(direction):
    root = 1.2345678901 * direction
    points, events, _ = run(Line((TestFunction("A", "crossing"), lambda s: math.sin(s - root))), direction=direction)
    (event,) = [event for event in events if event.arclength < 3]
    low, high = event.bracket
    assert low <= abs(root) <= high and high - low <= 1e-10
    assert abs(event.arclength - abs(root)) <= 1e-10 and event.residual <= 1e-10
    assert event.status == "located" and event.details == {}
    assert points[event.index].event is event and points[event.index].step is event.point
    assert event.point.extra == {"at": pytest.approx(root, abs=1e-10)}


@pytest.mark.parametrize("noise", [0.0, 2e-13, 1e-5])
def test_a_crossing_is_far_nearer_than_its_bracket_is_wide(noise):
    """Oracle: zeros of known functions, to rounding; also of one that a problem gives as nan where it is noise."""
    zeros = ((math.log(5), lambda s: math.exp(s) - 5.0), (1.23, lambda s: math.sin(3.0 * s) - math.sin(3.69)), (0.77, lambda s: s - 0.77))
    for root, function in zeros:

        def value(s, function=function):
            return function(s) if abs(function(s)) > noise else math.nan

        _, events, _ = run(Line((TestFunction("A", "crossing"), value if noise else function)))
        event = min(events, key=lambda event: abs(event.arclength - root))
        assert abs(event.arclength - root) < 3e-15 and event.residual < 1e-14
        assert event.bracket[0] <= root <= event.bracket[1] and event.status == "located"


def test_location_is_superlinear():
    """One event costs at most 9 further steps for 1e-10; bisection from 0.1 would need 30."""
    plain, marked = Line(), Line((TestFunction("A", "crossing"), lambda s: math.exp(s) - 5))
    run(plain)
    _, events, _ = run(marked, Settings(initial_step=0.1, maximum_step=0.1, maximum_points=61))
    assert len(events) == 1
    assert marked.steps - plain.steps <= 9


def test_several_tests_in_one_step_come_in_order_of_arclength():
    problem = Line(
        (TestFunction("LATE", "crossing"), lambda s: s - 1.07),
        (TestFunction("KEY", "change"), lambda s: float(s > 1.05)),
        (TestFunction("EARLY", "crossing"), lambda s: 1.02 - s),
    )
    points, events, _ = run(problem)
    assert [event.code for event in events] == ["EARLY", "KEY", "LATE"]
    assert [event.arclength for event in events] == pytest.approx([1.02, 1.05, 1.07], abs=1e-10)
    assert [point.arclength for point in points] == sorted(point.arclength for point in points)
    assert [point.index for point in points] == list(range(len(points)))


def test_all_changes_of_a_key_in_one_step_are_found():
    changes = [1.01, 1.031, 1.0312, 1.07]
    _, events, _ = run(Line((TestFunction("K", "change"), lambda s: float(sum(s > c for c in changes)))))
    assert [event.arclength for event in events] == pytest.approx(changes, abs=1e-10)
    assert all(event.status == "located" and event.residual == 0 for event in events)
    for event, change in zip(events, changes, strict=True):
        assert event.bracket[0] <= change <= event.bracket[1]
        assert event.point.parameter > change  # the first point with the new key


def test_terminal_change_ends_on_the_old_side():
    points, events, end = run(Line((TestFunction("K", "change", terminal=True), lambda s: float(s > 1.03))))
    assert end.reason is EndReason.EVENT and points[-1].event is events[-1]
    assert 1.03 - 1e-10 <= points[-1].step.parameter <= 1.03


def test_undefined_values_make_no_event():
    def crossing(s):
        return math.nan if 0.45 < s < 1.55 else 1.0 - s

    def key(s):
        return math.nan if 0.45 < s < 1.55 else float(s > 1)

    tests = (TestFunction("A", "crossing"), crossing), (TestFunction("G", "guard"), crossing), (TestFunction("K", "change"), key)
    points, events, _ = run(Line(*tests))
    assert events == [] and len(points) == 60
    points, events, end = run(Line((TestFunction("G", "guard", terminal=True), crossing)))
    assert end.reason is EndReason.EVENT and events[0].details["kind"] == "outside"  # violated where it is defined again
    assert 1.55 < points[-1].step.parameter < 1.75


@pytest.mark.parametrize(
    ("function", "kind"),
    [
        (lambda s: 1 / (1.0432 - s), "pole"),
        (lambda s: 1e9 if s < 1.0432 else -1e9, "jump"),
        (lambda s: math.copysign(1.0, s - 1.0432) + 0.1 * s, "jump"),
    ],
)
def test_jumps_and_poles_are_not_called_zeros(function, kind):
    seen = []

    def classify(index, before, at, after, location):
        seen.append((location.kind, location.status, before.step.parameter, after.step.parameter))
        return EventDetails("J", data={"mine": 1})

    _, events, end = run(Line((TestFunction("A", "crossing"), function), classify=classify))
    assert events == [] and "A near 1.0432 could not be located" in end.text
    (found_kind, status, before, after) = seen[0]
    assert (found_kind, status) == (kind, "bracketed") and before < 1.0432 < after


@pytest.mark.parametrize("code", ["SN", "BP", "PD", "SB", "RT", "NS"])
def test_no_event_is_listed_whose_residual_is_not_small(code):
    """Oracle: the function. The problem's own equations put the zero where it is 0.4: that is no event of any kind, and it is said. What
    the problem denies at its place is not said."""

    class Refining(Line):
        def refined(self, index, at):
            return self.step(np.array([1.44]), np.array([1.0]), 0.0)

    def classify(*given):
        return EventDetails(code)

    test = TestFunction(code, "crossing"), lambda s: s - 1.04
    _, events, end = run(Refining(test, classify=classify), Settings(initial_step=0.8, maximum_step=0.8, maximum_points=4))
    assert events == [] and f"{code} near 1.44 could not be located" in end.text
    _, events, end = run(Line(test, classify=classify))
    assert [event.code for event in events] == [code] and "located" not in end.text
    jump = TestFunction(code, "crossing"), lambda s: math.copysign(1.0, s - 1.0432)
    _, events, end = run(Line(jump, classify=classify))
    assert events == [] and f"{code} near 1.0432 could not be located" in end.text
    _, events, end = run(Line(jump, classify=lambda *given: None))
    assert events == [] and "located" not in end.text


def rounded(s):
    """A number between -1 and 1 that changes without order from one s to the next."""
    return math.fmod(s * 1e15 * math.pi, 2.0) - 1.0


@pytest.mark.parametrize(
    ("kind", "terminal", "function", "places"),
    [
        ("crossing", False, lambda s: math.tanh((s - 1.0432) / 1e-6), [1.0432]),
        ("guard", False, lambda s: math.sin(s - 1.0), [1.0 + math.pi]),  # it may rise, but not fall
        ("guard", False, lambda s: (s - 2.05) ** 2 - 0.02**2, [2.03]),
        ("guard", True, lambda s: (s - 2.05) ** 2 - 0.02**2, [2.03]),
        *(("crossing", False, lambda s, place=place: (s - place) ** 2, []) for place in (2.05, 2.0, 1.987654)),
        *(("crossing", False, lambda s, a=a: 1e10 * (s - a) ** 2 + 1e-9 * rounded(s), []) for a in (1.05, 1.0871, 2.0234)),
        *(("crossing", True, lambda s, value=value: s + value, []) for value in (1e-17, -1e-17, 0.0)),  # at the start
    ],
)
def test_one_test_function_has_its_events(kind, terminal, function, places):
    """Oracle: the function: where it passes zero in the direction of its kind, also steeply or twice in a step, but does not touch."""
    _, events, end = run(Line((TestFunction("A", kind, terminal=terminal), function)))
    assert [event.arclength for event in events] == pytest.approx(places, abs=1e-10)
    assert all(event.status == "located" for event in events) and (end.reason is EndReason.EVENT) is (terminal and places != [])


def test_classify_may_drop_rename_and_end():
    def classify(index, before, at, after, location):
        if at.parameter < 2:
            return None
        return EventDetails("NEW", terminal=at.parameter > 4, data={"where": at.parameter})

    points, events, end = run(Line((TestFunction("A", "crossing"), lambda s: math.sin(math.pi * (s + 0.5))), classify=classify))
    assert [event.code for event in events] == ["NEW"] * 3
    assert [event.details["where"] for event in events] == pytest.approx([2.5, 3.5, 4.5], abs=1e-9)
    assert end.reason is EndReason.EVENT and "NEW" in end.detail
    assert points[-1].arclength == pytest.approx(4.5, abs=1e-10)


def test_terminal_event_is_the_last_point_and_later_events_are_none():
    problem = Line(
        (TestFunction("END", "guard", terminal=True), lambda s: 1.03 - s),
        (TestFunction("B", "crossing"), lambda s: s - 1.01),
        (TestFunction("C", "crossing"), lambda s: s - 1.05),
    )
    points, events, end = run(problem)
    assert [event.code for event in events] == ["B", "END"]
    assert events[-1].terminal and points[-1].event is events[-1]
    assert points[-1].arclength == pytest.approx(1.03, abs=1e-10)
    assert end.reason is EndReason.EVENT


@pytest.mark.parametrize("before", [0.0, 1e-12, 1e-11])
def test_a_pole_at_the_end_of_a_family_is_no_event(before):
    """Multipliers have a pole where an impact's speed goes through zero; rounding puts it on either side. Also where a step ends so near to
    it that they are huge there, which makes a pole look like a zero."""
    end = 1.1 - 2e-11
    guard, pole = TestFunction("END", "guard", terminal=True), TestFunction("A", "crossing")
    _, events, _ = run(Line((pole, lambda s: 1.0 / (end - before - s) if s != end - before else math.inf), (guard, lambda s: end - s)))
    assert [event.code for event in events] == ["END"]


@pytest.mark.parametrize(
    ("kind", "before_it", "behind_it"), [("crossing", -8500.0, 79.0), ("crossing", 8500.0, -79.0), ("change", 0.0, 1.0)]
)
@given(end=st.floats(1.05, 1.095), before=st.floats(-9e-11, 9e-11))
def test_a_jump_within_a_bracket_of_the_end_of_a_family_is_no_event(kind, before_it, behind_it, end, before):
    """Oracle: the family ends at `end`, to the width of a bracket. In the last steps multipliers are rounding: of either sign, and small
    beside what they grow to. On which side of the end a key changes is rounding too."""
    guard = TestFunction("END", "guard", terminal=True), lambda s: end - s
    _, events, _ = run(Line((TestFunction("A", kind), lambda s: behind_it if s >= end - before else before_it), guard))
    assert [event.code for event in events] == ["END"]


@pytest.mark.parametrize("value", [0.0, 1e-17, -1e-17])
def test_family_that_starts_on_its_guard_goes_inward_only(value):
    """A start at grazing to rounding: inward is a family, outward ends at once."""
    _, _, inward = run(Line((TestFunction("G", "guard", terminal=True), lambda s: s + value)))
    assert inward.reason is EndReason.POINTS
    points, events, outward = run(Line((TestFunction("G", "guard", terminal=True), lambda s: value - s)))
    assert outward.reason is EndReason.EVENT
    assert abs(points[-1].arclength) <= 1e-10 and events[0].residual <= 1e-10


@pytest.mark.parametrize(("apart", "found"), [(0.0, [("BP", {"absorbed": ("SN",)})]), (1e-5, [("BP", {}), ("SN", {})])])
@pytest.mark.parametrize("order", [1, -1])
def test_coincident_events_are_one_where_a_test_absorbs_another(apart, found, order):
    strong, weak = TestFunction("BP", "crossing", absorbs=("SN",)), TestFunction("SN", "crossing")
    tests = (strong, lambda s: 1.03 - s), (weak, lambda s: 1.03 + apart - s)
    _, events, _ = run(Line(*tests[::order]))
    assert [(event.code, event.details) for event in events] == found


@given(st.floats(-3e-9, 3e-9), st.floats(-3e-9, 3e-9))
@hypothesis_settings(max_examples=40, deadline=None)
def test_coincident_events_about_an_accepted_point_are_one(offset_strong, offset_weak):
    """Steps of 0.1 land on 0.5; the zeros lie on either side of it by a few 1e-9."""
    problem = Line(
        (TestFunction("BP", "crossing", absorbs=("SN",)), lambda s: s - 0.5 - offset_strong),
        (TestFunction("SN", "crossing"), lambda s: s - 0.5 - offset_weak),
    )
    points, events, _ = run(problem)
    assert [event.code for event in events] == ["BP"]
    near = [point for point in points if point.event is None and abs(point.arclength - 0.5) < 1e-7]
    assert len(near) <= 1


@given(st.floats(1.0, 4.0), st.floats(0.004, 0.09), st.floats(0.3, 3.0))
@hypothesis_settings(max_examples=25, deadline=None)
def test_two_zeros_in_one_step_are_found_where_the_test_is_a_parabola(middle, distance, size):
    """Oracle: the zeros of size (s - m)^2 - size d^2; steps are 0.1 long, so most pairs leave no change of sign."""
    problem = Line((TestFunction("A", "crossing"), lambda s: size * ((s - middle) ** 2 - distance**2)))
    _, events, _ = run(problem)
    assert [event.arclength for event in events] == pytest.approx([middle - distance, middle + distance], abs=2e-10)


@given(
    middle=st.floats(-1.0, 2.0),
    depth=st.floats(-0.5, 0.5),
    size=st.floats(0.1, 10.0),
    length=st.floats(0.1, 1.0),
    sign=st.sampled_from([1, -1]),
)
def test_a_parabola_hides_two_zeros_where_it_dips_below_zero(middle, depth, size, length, sign):
    """Oracle: v = size (s - m)^2 + d on (0, length), whose second divided differences are all `size`."""
    a, b = (size * (s - middle) ** 2 + depth for s in (0.0, length))
    assume(a > 1e-9 and b > 1e-9 and abs(depth) > 1e-9)
    hides = may_hide(sign * a, sign * b, length, sign * size, sign * size)
    assert hides is (depth < 0.0 and 0.0 < middle < length)
    assert may_hide(sign * a, sign * b, length, sign * size, 0.0) or not hides  # bends that differ leave more room


@given(
    steps=st.floats(0.01, 0.16),
    start=st.floats(-3.0, 3.0),
    offset=st.floats(-0.999, 0.999),
    direction=st.sampled_from([1, -1]),
    growth=st.floats(1.05, 2.0),
)
@hypothesis_settings(max_examples=25, deadline=None)
def test_events_do_not_depend_on_where_a_run_starts_or_how_long_its_steps_are(steps, start, offset, direction, growth):
    """Oracle: the zeros of cos(7 s) - offset between two guards, in pairs down to 0.013 apart, with steps of up to 0.16."""
    problem = Line(
        (TestFunction("A", "crossing"), lambda s: math.cos(7.0 * s) - offset),
        (TestFunction("END", "guard", terminal=True), lambda s: 3.3 - abs(s)),
    )
    run = follow_both_ways(
        problem, np.array([start]), Settings(initial_step=0.2 * steps, maximum_step=steps, maximum_growth=growth, maximum_points=5000),
        direction=direction,
    )  # fmt: skip
    first = math.acos(offset)
    zeros = sorted(s for k in range(-6, 7) for s in ((first + 2 * math.pi * k) / 7.0, (-first + 2 * math.pi * k) / 7.0) if abs(s) < 3.3)
    found = sorted(event.point.parameter for event in run.events if event.code == "A")
    assert found == pytest.approx(zeros, abs=2e-10)


@pytest.mark.parametrize("noise", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("place", [1.05, 1.0871, 2.0234, 3.0])
def test_a_zero_in_rounding_is_one_event_whose_bracket_tells_the_rounding(noise, place):
    """Oracle: the zero of a function that is steep, with noise added: over 2 noise / steepness it has many zeros."""
    _, events, _ = run(Line((TestFunction("A", "crossing"), lambda s: 1e6 * math.sin(s - place) + noise * rounded(s))))
    (event,) = [event for event in events if abs(event.arclength - place) < 1e-3]
    low, high = event.bracket
    assert low - 1e-6 * noise <= place <= high + 1e-6 * noise and high - low <= 4e-6 * noise + 1e-9


class Hopping(Line):
    """Two lines that cross at s = 1, distinguished by a second unknown that the metric does not see: z = 0 and z = s - 1.

    Steps to a place in `hops` are corrected onto the other one."""

    def __init__(self, *tests, hops):
        super().__init__(*tests)
        self._hops = hops

    def step(self, y, tangent, ds):
        step = super().step(y[:1], tangent[:1], ds)
        s = float(step.y[0])
        hops = self._hops(s) and ds != 0.0
        sense = float(tangent[0])
        tests = [-value for value in step.tests] if hops else step.tests
        return step._replace(y=np.array([s, s - 1.0 if hops else 0.0]), tangent=np.array([sense, sense * hops]), tests=tests)


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(("early", "late"), [(0.0, 0.0), (1e-12, 1e-15), (1e-12, 1e-14)])
def test_a_guard_that_jumps_where_another_one_is_zero_is_not_the_end(order, early, late):
    """Oracle: the guard with the zero. The other one is large before it and negative behind, as a clearance is where an impact vanishes; by
    rounding it can be negative a little earlier."""
    tests = (
        (TestFunction("ZERO", "guard", terminal=True), lambda s: 1.03 - s + late),
        (TestFunction("JUMP", "guard", terminal=True), lambda s: 1e3 if s < 1.03 - early else -1e-3 * (s - 1.02)),
    )
    _, events, _ = run(Line(*tests[::order]))
    assert [event.code for event in events] == ["ZERO"] and events[0].status == "located"


class Bridged(Line):
    """A line whose corrector fails around s = 1; the problem knows the point there, and the one behind it."""

    def beyond(self, at):
        ahead = (1.0 - at.y[0]) * at.tangent[0]
        return tuple(self.step(np.array([s]), at.tangent, 0.0) for s in (1.0, 2.0 - at.y[0])) if ahead > 0.0 else None

    def step(self, y, tangent, ds):
        step = super().step(y, tangent, ds)
        return step._replace(converged=True) if ds == 0.0 else step


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("other", [0.5, 0.9, 1.1])
def test_a_run_that_no_step_leads_past_a_branch_point_goes_on_behind_it(direction, other):
    """Oracle: the zeros. Where another event lies in the gap (here at 1 +- 1e-4), the run ends: it could be met on either side."""
    tests = (TestFunction("BP", "crossing", singular=1e-9), lambda s: s - 1.0), (TestFunction("A", "crossing"), lambda s: s - other)
    gap = lambda s: 0.0 < abs(s - 1.0) < 1e-3  # noqa: E731
    _, events, ends = parts(follow(Bridged(*tests, broken=gap), np.array([1.0 - direction]), direction, SHORT))
    assert sorted(event.point.parameter for event in events) == pytest.approx(sorted((1.0, other)), abs=1e-9)
    assert ends[0].reason is EndReason.POINTS
    hidden = (TestFunction("B", "crossing"), lambda s: abs(s - 1.0) - 1e-4)
    _, events, ends = parts(follow(Bridged(*tests, hidden, broken=gap), np.array([1.0 - direction]), direction, SHORT))
    assert ends[0].reason is EndReason.MINIMUM_STEP and all(event.code == "A" for event in events)


@pytest.mark.parametrize("width", [3e-2, 1e-2, 1e-3])
@pytest.mark.parametrize("start", [0.0, 0.013, 0.031])
def test_steps_inside_that_go_over_to_another_family_are_not_used(width, start):
    """Oracle: one zero at s = 1. On the other family the function has the other sign, so the hops make two zeros more."""
    problem = Hopping((TestFunction("A", "crossing", singular=1e-8), lambda s: s - 1.0), hops=lambda s: 1e-9 < 1.0 - s < width)
    points, events, ends = parts(follow(problem, np.array([start, 0.0]), settings=SHORT))
    assert [event.arclength for event in events] == pytest.approx([1.0 - start], abs=1e-9)
    assert all(point.step.y[1] == 0.0 for point in points) and ends[0].reason is EndReason.POINTS


def test_a_dip_that_stays_above_zero_is_no_event_and_costs_few_steps():
    plain, dipping = Line(), Line((TestFunction("A", "crossing"), lambda s: (s - 2.05) ** 2 + 1e-6))
    run(plain)
    _, events, _ = run(dipping)
    assert events == [] and dipping.steps - plain.steps <= 4


@given(st.lists(st.floats(0.3, 5.0), min_size=1, max_size=5, unique=True))
@hypothesis_settings(max_examples=20, deadline=None)
def test_all_zeros_of_a_polynomial_are_found_in_order(roots):
    """Oracle: the roots the polynomial is made of, kept 0.11 apart so that no step holds two."""
    roots = sorted(roots)
    roots = [roots[0]] + [b for a, b in zip(roots, roots[1:], strict=False) if b - a > 0.11]
    problem = Line((TestFunction("A", "crossing"), lambda s: math.prod(s - root for root in roots)))
    _, events, _ = run(problem, Settings(initial_step=0.1, maximum_step=0.1, maximum_points=65))
    assert [event.arclength for event in events] == pytest.approx(roots, abs=1e-10)
    assert all(e.bracket[0] - 1e-12 <= root <= e.bracket[1] + 1e-12 for e, root in zip(events, roots, strict=True))


def test_unknown_kind_of_test_is_refused():
    with pytest.raises(ValueError, match="kind 'zero', expected crossing, guard or change"):
        run(Line((TestFunction("A", "zero"), lambda s: s)))


def test_step_whose_inside_cannot_be_followed_is_refused_until_the_event_is_outside_the_gap():
    """A sign change across a gap where the corrector fails: the steps shrink, and the family ends at the gap with no event."""
    problem = Line((TestFunction("A", "crossing"), lambda s: s - 1.05), broken=lambda s: 1.04 < s < 1.06)
    points, events, end = run(problem)
    assert events == [] and end.reason is EndReason.MINIMUM_STEP and end.tally.jumped > 0
    assert points[-1].arclength < 1.04


def test_event_in_a_gap_smaller_than_the_coincidence_tolerance_is_bracketed():
    problem = Line((TestFunction("A", "crossing"), lambda s: s - 1.05), broken=lambda s: abs(s - 1.05) < 1e-8)
    _, events, _ = run(problem)
    (event,) = events
    assert event.status == "bracketed" and event.details["kind"] == "interrupted" and "converge" in event.details["reason"]
    assert event.bracket[0] <= 1.05 <= event.bracket[1] and event.bracket[1] - event.bracket[0] <= 1e-6


@pytest.mark.parametrize("value", [0.0, 1.0, -1.0])
def test_constant_test_functions_make_no_event(value):
    plain, constant = Line(), Line((TestFunction("A", "crossing"), lambda s: value), (TestFunction("K", "change"), lambda s: value))
    run(plain)
    _, events, _ = run(constant)
    # the first two steps are sampled, for nothing is known before them of how the function bends
    assert events == [] and constant.steps <= plain.steps + 3


def test_touching_zero_exactly_at_accepted_points_makes_at_most_one_event_each():
    """|s - 0.5| has its zero at a point that the steps of 0.1 meet to rounding; it never changes sign for good."""
    _, events, _ = run(Line((TestFunction("A", "crossing"), lambda s: abs(s - 0.5))))
    assert len(events) <= 2 and all(abs(event.arclength - 0.5) < 1e-9 for event in events)


def test_a_key_that_changes_very_often_asks_for_shorter_steps():
    problem = Line((TestFunction("K", "change"), lambda s: float(math.floor(400 * s))))
    points, events, end = run(problem, Settings(initial_step=0.1, maximum_step=0.1, maximum_points=100))
    assert end.tally.jumped > 0
    assert [event.arclength for event in events] == pytest.approx([(k + 1) / 400 for k in range(len(events))], abs=1e-10)
