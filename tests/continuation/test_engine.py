"""Following curves: step control, refusal, closure, ends. Oracles: circles and ellipses, the exact geometry of each curve."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import ellipe

from continuation import End, EndReason, Event, GenericProblem, Point, Settings, TestFunction, follow, follow_both_ways
from tests.continuation.curves import Eight, Line, circle, cubic, ellipse, hyperbola, is_close, parallel_lines, parts, root_end

SHORT = Settings(initial_step=0.1, maximum_step=0.1, maximum_points=60)


def test_circle_closes_with_length_two_pi_and_two_folds():
    points, events, (end,) = parts(follow(circle(), np.array([math.cos(1.0), math.sin(1.0)])))
    assert end.reason is EndReason.CLOSED
    assert is_close(points[-1].arclength, 2 * math.pi, 1e-9)
    np.testing.assert_allclose(points[-1].step.y, points[0].step.y, atol=1e-9)
    assert [event.code for event in events] == ["SN", "SN"]
    assert [event.point.parameter for event in events] == pytest.approx([1.0, -1.0], abs=1e-10)
    for event, angle in zip(events, (math.pi / 2 - 1, 3 * math.pi / 2 - 1), strict=True):
        assert is_close(event.arclength, angle, 1e-9)
    radius = [math.hypot(*point.step.y) for point in points]
    assert max(abs(r - 1) for r in radius) < 1e-14


@given(st.floats(0.3, 3.0), st.floats(0.3, 3.0), st.floats(0.0, 2 * math.pi), st.sampled_from([1, -1]))
@hypothesis_settings(max_examples=15, deadline=None)
def test_any_ellipse_closes_with_its_folds_from_any_start(long, short, angle, direction):
    start = np.array([long * math.cos(angle), short * math.sin(angle)])
    points, events, (end,) = parts(follow(ellipse(long, short), start, direction))
    assert end.reason is EndReason.CLOSED
    exact = 4 * max(long, short) * ellipe(1 - (min(long, short) / max(long, short)) ** 2)
    assert is_close(points[-1].arclength, exact, 2e-4 * exact)
    folds = [event.point.parameter for event in events]
    if abs(math.cos(angle)) > 1e-3:  # the start is no fold
        assert sorted(folds) == pytest.approx([-short, short], abs=1e-9)


def test_figure_of_eight_closes_after_both_loops_only():
    """It passes its start a first time with another tangent. Oracle: the length of the curve by quadrature."""
    tangent = np.array([1.0, 2.0]) / math.sqrt(5)
    start = Eight().step(np.zeros(2), tangent, 0.0)
    points, _, (end,) = parts(follow(Eight(), start, 0, Settings(maximum_step=0.1)))
    length, _ = quad(lambda t: math.hypot(math.cos(t), 2 * math.cos(2 * t)), 0, 2 * math.pi)
    assert end.reason is EndReason.CLOSED
    assert is_close(points[-1].arclength, length, 1e-3)
    assert min(point.step.y[0] for point in points) == pytest.approx(-1, abs=0.05)


def test_arclength_is_of_fourth_order_in_the_step():
    """Oracle: the length of an ellipse, a complete elliptic integral."""
    exact = 4 * 2.0 * ellipe(1 - 0.25)
    errors = []
    for step in (0.2, 0.1, 0.05):
        settings = Settings(
            initial_step=step, maximum_step=step, target_turn=0.8, maximum_turn=1.0, target_contraction=0.4, maximum_points=2000
        )
        points, _, (end,) = parts(follow(ellipse(2.0, 1.0), np.array([2.0, 0.0]), settings=settings))
        assert end.reason is EndReason.CLOSED
        errors.append(abs(points[-1].arclength - exact))
    orders = [math.log2(a / b) for a, b in zip(errors, errors[1:], strict=False)]
    assert all(order > 3.5 for order in orders), (errors, orders)


def test_predictor_is_of_second_order():
    """The corrected point leaves the tangent by curvature ds^2/2."""
    problem = circle()
    start = problem.begin(np.array([0.6, 0.8]))
    errors = []
    for ds in (0.1, 0.05, 0.025):
        step = problem.step(start.y, start.tangent, ds)
        errors.append(float(np.linalg.norm(step.y - start.y - ds * start.tangent)))
        assert is_close(errors[-1], ds * ds / 2, ds**3)
    orders = [math.log2(a / b) for a, b in zip(errors, errors[1:], strict=False)]
    assert orders == pytest.approx([2.0, 2.0], abs=0.02)


def test_steps_keep_to_the_target_turn():
    settings = Settings(target_turn=0.05, maximum_step=1.0, target_contraction=0.4)
    points, _, _ = parts(follow(circle(), np.array([1.0, 0.0]), settings=settings))
    regular = [point for point in points if point.event is None]
    middle = [math.acos(float(a.step.tangent @ b.step.tangent)) for a, b in zip(regular[8:-3], regular[9:-2], strict=True)]
    assert max(middle) < 0.06 and min(middle) > 0.04


def test_direction_is_the_sign_of_the_first_slope_or_that_of_the_start():
    problem = cubic()
    step = problem.begin(np.array([2.0, 6.0]))
    starts = [(step.y, 1, None), (step.y, -1, None), (step, 0, step), (turned := problem.step(step.y, -step.tangent, 0.0), 0, turned)]
    for start, direction, along in starts:
        points, _, _ = parts(follow(problem, start, direction, Settings(maximum_points=5)))
        assert all(point.step.slope * direction > 0 for point in points) or not direction
        assert direction == 0 or (points[1].step.parameter - points[0].step.parameter) * direction > 0
        assert along is None or float((points[1].step.y - points[0].step.y) @ along.tangent) > 0
    ways = [parts(follow(circle(), np.array([0.0, 1.0]), way, Settings(maximum_points=3)))[0][-1].step.y[0] for way in (1, -1)]
    assert ways[0] * ways[1] < 0  # at a fold
    with pytest.raises(ValueError, match=r"direction = 2: expected \+1, -1 or 0"):
        next(follow(problem, step, 2))


@pytest.mark.parametrize("gap", [1e-1, 1e-2])
def test_does_not_jump_to_the_other_branch_of_a_hyperbola(gap):
    """Oracle: see `require_does_not_jump_to_the_other_branch_of_a_hyperbola`."""
    require_does_not_jump_to_the_other_branch_of_a_hyperbola(gap)


def require_does_not_jump_to_the_other_branch_of_a_hyperbola(gap):
    """The step straight on lands on the other branch with a tangent that did not turn; only the inside of the step tells."""
    start = np.array([math.hypot(1.0, gap), -1.0])
    points, events, (end,) = parts(follow(hyperbola(gap), start, settings=Settings(maximum_points=150)))
    assert min(point.step.y[0] for point in points) > 0 and points[-1].step.y[1] > 1
    assert [event for event in events if event.code == "BP"] == []
    assert end.tally.turned + end.tally.jumped > 0


def test_does_not_jump_between_parallel_lines():
    points, _, _ = parts(follow(parallel_lines(0.01), np.array([0.0, 0.0]), settings=Settings(maximum_points=100)))
    assert all(abs(point.step.y[0]) < 1e-12 for point in points)


def test_steps_that_turn_contract_badly_or_go_astray_are_halved_and_counted():
    def turn(s, end):
        return 0.5 if s < 1.0 < end and end - s > 0.03 else 1.0

    points, _, (end,) = parts(follow(Line(turn=turn), np.array([0.0]), settings=SHORT))
    assert end.tally.turned == 2 and sum(end.tally[1:]) == 2 and end.tally.accepted == len(points) - 1
    _, _, (end,) = parts(follow(Line(contraction=lambda ds: 8 * ds), np.array([0.0]), settings=SHORT))
    assert end.tally.slow == 1
    points, _, (end,) = parts(follow(Line(broken=lambda s: 0.95 < s < 1.04), np.array([0.0]), settings=SHORT))
    assert end.tally.not_converged == 1 and end.reason is EndReason.POINTS


@pytest.mark.parametrize("number", [1, 2, 7])
def test_points_limit_counts_all_points(number):
    """Oracle: the limit, where about every third point is an event."""
    problem = Line((TestFunction("A", "crossing"), lambda s: math.sin(20 * s + 1)))
    points, _, (end,) = parts(follow(problem, np.array([0.0]), settings=replace(SHORT, maximum_points=number)))
    assert len(points) == number and end.reason is EndReason.POINTS


def test_a_point_far_from_its_prediction_is_refused():
    class Astray(Line):
        def step(self, y, tangent, ds):
            step = super().step(y, tangent, ds)
            return step if ds < 0.03 else step._replace(position=(step.position[0] + 5 * ds,))

    _, _, (end,) = parts(follow(Astray(), np.array([0.0]), settings=SHORT))
    assert end.tally.jumped > 0


def test_contraction_steers_the_step():
    """contraction = 100 ds^2 with target 0.05 asks for ds = sqrt(0.0005)."""
    points, _, _ = parts(follow(Line(contraction=lambda ds: 100 * ds * ds), np.array([0.0])))
    assert points[20].step_size == pytest.approx(math.sqrt(0.0005), rel=1e-6)


def test_curve_that_ends_gives_the_reason_and_the_words_of_the_problem():
    points, _, (end,) = parts(follow(root_end(), np.array([1.5, 0.25]), -1))
    assert end.reason is EndReason.MINIMUM_STEP
    assert "does not converge" in end.text and "not finite" in end.text and "last point" in end.text and "minimum_step" not in end.text
    assert 0 <= points[-1].step.parameter < 1e-6
    points, _, (end,) = parts(follow(Line(broken=lambda s: s > 1.0), np.array([0.0]), settings=SHORT))
    assert 0 <= 1.0 - points[-1].arclength < 1e-6 and "the line is broken after 1.000" in end.text


def test_stop_when_is_asked_at_every_point_after_the_start():
    seen = []

    def stop(point):
        seen.append(point)
        return "far enough" if point.step.parameter > 1.0 else False

    problem = Line((TestFunction("A", "crossing"), lambda s: s - 0.55))
    points, _, (end,) = parts(follow(problem, np.array([0.0]), settings=SHORT, stop_when=stop))
    assert end.reason is EndReason.STOP_WHEN and end.detail == "far enough"
    assert seen == points[1:] and points[-1].step.parameter > 1.0 >= points[-2].step.parameter
    assert any(point.event for point in seen)
    _, _, (end,) = parts(follow(problem, np.array([0.0]), settings=SHORT, stop_when=lambda point: point.event is not None))
    assert end.reason is EndReason.STOP_WHEN and end.detail == ""


def test_stop_at_ends_at_the_first_event_of_a_code():
    problem = Line((TestFunction("A", "crossing"), lambda s: s - 0.55), (TestFunction("B", "crossing"), lambda s: s - 1.55))
    points, events, (end,) = parts(follow(problem, np.array([0.0]), settings=SHORT, stop_at={"B"}))
    assert end.reason is EndReason.STOP_AT and [event.code for event in events] == ["A", "B"]
    assert points[-1].event is events[-1] and "B" in end.text


def test_iterator_gives_each_event_after_its_point_and_one_end_last():
    items = list(follow(circle(), np.array([1.0, 0.0])))
    assert isinstance(items[0], Point) and isinstance(items[-1], End)
    assert sum(isinstance(item, End) for item in items) == 1
    for before, item in zip(items, items[1:], strict=False):
        if isinstance(item, Event):
            assert isinstance(before, Point) and before.event is item


class Wave(Line):
    """The line whose reported parameter is cos(s): it passes +-1 again and again."""

    def step(self, y, tangent, ds):
        step = super().step(y, tangent, ds)
        return step._replace(parameter=math.cos(step.parameter))


def test_a_family_that_repeats_itself_ends_at_the_third_passage_of_a_branch_point():
    """Oracle: branch points at the multiples of pi, where the parameter is -1, 1, -1, 1, -1."""
    wave = Wave((TestFunction("BP", "crossing", singular=1e-6), math.sin))
    points, events, (end,) = parts(follow(wave, np.array([0.3]), settings=Settings(maximum_points=5000)))
    assert end.reason is EndReason.REPEATED
    assert [event.point.y[0] for event in events] == pytest.approx([k * math.pi for k in range(1, 6)], abs=1e-9)


def with_symmetry(problem, symmetry):
    """The problem with a symmetry of its equations, a matrix."""
    problem.symmetries, problem.sizes = lambda y: [lambda y: symmetry @ y], lambda y: np.ones(y.size)
    return problem


def test_a_closed_family_ends_at_the_image_of_its_start():
    """Oracle: the circle is its own image after a half turn, in which it has one fold and the length pi."""
    start = np.array([math.cos(0.4), math.sin(0.4)])
    run = follow_both_ways(with_symmetry(circle(), -np.eye(2)), start)
    assert [end.reason for end in run.ends] == [EndReason.IMAGE] * 2 and not run.closed
    assert [event.code for event in run.events] == ["SN"]
    assert run.points[-1].arclength == pytest.approx(math.pi, abs=1e-5)
    assert run.points[-1].step.y == pytest.approx(-start, abs=1e-9)
    # A reflection takes the start to a point that the run passes the other way round: it goes on.
    mirrored = follow_both_ways(with_symmetry(circle(), np.diag([1.0, -1.0])), start)
    assert mirrored.closed and [event.code for event in mirrored.events] == ["SN", "SN"]


@pytest.mark.parametrize("once", [False, True])
def test_a_family_does_not_go_over_to_one_of_more_symmetry(once):
    """Oracle: a (p - 90 a^2) = 0 branches at p = 0. Without the symmetry a -> -a a long step along the parabola falls onto a = 0."""
    fork = GenericProblem(lambda y: np.array([y[0] * (y[1] - 90 * y[0] ** 2)]), lambda y: np.array([[y[1] - 270 * y[0] ** 2, y[0]]]))
    rough = Settings(initial_step=0.1, target_turn=0.39, maximum_step=0.5, target_contraction=0.4)
    begun = fork.begin(np.array([0.1, 0.9]))
    begun = begun if begun.slope < 0.0 else fork.step(begun.y, -begun.tangent, 0.0)
    options = {"stop_when": lambda point: abs(point.step.parameter) > 1.0, "both": False, "direction": 0 if once else -1}
    fallen = follow_both_ways(fork, begun, rough, **options)
    assert abs(fallen.points[-1].step.y[0]) < 1e-12
    run = follow_both_ways(with_symmetry(fork, np.diag([-1.0, 1.0])), begun, rough, **options)
    a, p = np.array([point.step.y for point in run.points]).T
    assert np.abs(p - 90.0 * a**2).max() < 1e-9
    assert [event.code for event in run.events] == ["BP"] and abs(run.events[0].point.parameter) < 1e-9
    assert run.ends[1].reason is (EndReason.IMAGE if once else EndReason.STOP_WHEN)
    assert abs(a[-1]) < 1e-6 if once else a[-1] < -0.1
