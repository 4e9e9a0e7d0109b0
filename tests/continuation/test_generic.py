"""The generic problem. Oracles: folds and branch points in closed form; Bratu's fold 8 (x^2 - 1), x = coth x."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from continuation import GenericProblem, Problem, Settings, TestFunction, follow, follow_both_ways
from tests.continuation.curves import (
    Line,
    bratu,
    central_differences,
    chebyshev,
    circle,
    cubic,
    imperfect_pitchfork,
    parts,
    pitchfork,
    transcritical,
)

MANY = Settings(maximum_points=100)


def bratu_fold() -> float:
    """Critical value of u'' + lam e^u = 0, u(0) = u(1) = 0: 3.513830719, by Newton's method on x = coth x.

    The form 8 (x^2 - 1) is in R. Buckmire, On exact and numerical solutions of the one-dimensional planar Bratu problem (2003).
    """
    x = 1.2
    for _ in range(20):
        x -= (x - 1 / math.tanh(x)) / (1 + 1 / math.sinh(x) ** 2)
    return 8 * (x * x - 1)


def test_folds_of_the_cubic():
    run = follow_both_ways(cubic(), np.array([-1.5, -1.875]), MANY)
    assert [event.code for event in run.events] == ["SN", "SN"]
    fold = 2 / (3 * math.sqrt(3))
    assert [event.point.parameter for event in run.events] == pytest.approx([fold, -fold], abs=1e-10)
    assert [event.point.y[0] for event in run.events] == pytest.approx([-1 / math.sqrt(3), 1 / math.sqrt(3)], abs=1e-9)


@pytest.mark.parametrize(("make", "start"), [(pitchfork, [0.0, -1.0]), (transcritical, [0.0, -1.0]), (transcritical, [-1.0, -1.0])])
def test_a_branch_without_a_fold_has_its_branch_point_alone(make, start):
    (event,) = follow_both_ways(make(), np.array(start), MANY).events
    assert event.code == "BP" and event.status == "located"
    np.testing.assert_allclose(event.point.y, [0.0, 0.0], atol=1e-10 if make is pitchfork else 1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_side_branch_of_the_pitchfork_has_one_branch_point_that_stands_for_the_fold(side):
    """The corrector tells the two branches apart to sqrt(eps) only; the bracket says so and holds the branch point."""
    run = follow_both_ways(pitchfork(), np.array([side, 1.0]), MANY)
    (event,) = run.events
    assert event.code == "BP" and event.details["absorbed"] == ("SN",)
    np.testing.assert_allclose(event.point.y, [0.0, 0.0], atol=1e-7)
    assert event.bracket[0] <= event.arclength <= event.bracket[1] <= event.bracket[0] + 1e-6
    x = [point.step.y[0] for point in run.points]
    assert x == sorted(x, reverse=bool(x[0] > x[-1]))  # it went straight through
    for point in run.points:
        assert abs(point.step.y[1] - point.step.y[0] ** 2) < 1e-12 or abs(point.step.y[0]) < 1e-6


@given(st.floats(1e-4, 0.5), st.sampled_from([1.0, -1.0]))
@hypothesis_settings(max_examples=15, deadline=None)
def test_imperfect_pitchfork_has_a_fold_and_no_branch_point(imperfection, sign):
    e = sign * imperfection
    x = -sign * 1.5
    run = follow_both_ways(imperfect_pitchfork(e), np.array([x, x * x - e / x]), MANY)
    assert [event.code for event in run.events] == ["SN"]
    assert run.events[0].point.parameter == pytest.approx(3 * (imperfection / 2) ** (2 / 3), abs=1e-10)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_imperfect_pitchfork_main_branch_has_no_event(side):
    run = follow_both_ways(imperfect_pitchfork(side * 0.01), np.array([side * 1.5, 2.25 - 0.01 / 1.5]), MANY)
    assert run.events == ()


def test_bratus_fold_by_chebyshev_collocation():
    assert bratu_fold() == pytest.approx(3.513830719, abs=5e-10)  # as published
    run = follow_both_ways(bratu(chebyshev(20)), np.zeros(20), Settings(maximum_points=60, maximum_step=0.4), both=False, stop_at={"SN"})
    assert run.events[-1].code == "SN" and run.events[-1].point.parameter == pytest.approx(bratu_fold(), abs=1e-9)


def test_bratus_fold_by_differences_converges_with_the_second_order():
    errors = []
    for intervals in (8, 16, 32):
        settings = Settings(maximum_points=60, maximum_step=0.4)
        run = follow_both_ways(bratu(central_differences(intervals)), np.zeros(intervals), settings, both=False, stop_at={"SN"})
        errors.append(abs(run.events[-1].point.parameter - bratu_fold()))
    orders = [math.log2(a / b) for a, b in zip(errors, errors[1:], strict=False)]
    assert orders == pytest.approx([2.0, 2.0], abs=0.05)


def test_fields_of_a_step():
    problem = circle()
    begin = problem.begin(np.array([0.7, 0.9]))
    step = problem.step(begin.y, begin.tangent, 0.1)
    assert float(begin.tangent @ (step.y - begin.y)) == pytest.approx(0.1, abs=1e-15)
    assert float(step.tangent @ step.y) == pytest.approx(0, abs=1e-15) and float(step.tangent @ step.tangent) == pytest.approx(
        1
    )
    assert step.turn == pytest.approx(float(step.tangent @ begin.tangent)) and begin.turn == 1
    assert step.slope == step.tests[0] == step.tangent[1] and step.parameter == step.y[1]
    assert step.residual < 1e-15 and 0 < step.contraction < 0.1 and step.position == tuple(step.y)
    again = problem.step(step.y, -step.tangent, 0.0)
    np.testing.assert_allclose(again.tangent, -step.tangent, atol=1e-15)
    np.testing.assert_allclose(again.y, step.y, atol=1e-15)
    assert again.tests == pytest.approx([-value for value in step.tests])


def test_scaled_determinant_is_the_signed_smallest_singular_value():
    """Oracle: numpy's determinant over the product of the other singular values, on a system of three equations."""
    rng = np.random.default_rng(3)
    matrix = rng.normal(size=(3, 4))
    problem = GenericProblem(lambda y: matrix @ y, lambda y: matrix)
    step = problem.begin(np.zeros(4))
    bordered = np.vstack((matrix, step.tangent))
    others = np.prod(np.linalg.svd(bordered, compute_uv=False)[:-1])
    assert step.tests[1] == pytest.approx(np.linalg.det(bordered) / others)


def test_weights_are_the_metric():
    weights = np.array([4.0, 0.25])
    problem = circle(weights=weights)
    step = problem.begin(np.array([0.6, 0.8]))
    assert float(weights * step.tangent @ step.tangent) == pytest.approx(1)
    np.testing.assert_allclose(step.position, np.sqrt(weights) * step.y)
    scaled = problem.step(step.y, step.tangent, 0.05)
    assert float(weights * step.tangent @ (scaled.y - step.y)) == pytest.approx(0.05)
    assert scaled.turn == pytest.approx(float(weights * step.tangent @ scaled.tangent))


def test_own_test_functions_follow_the_built_in_ones():
    problem = circle(tests=[(TestFunction("X", "crossing", label="x = 0.25"), lambda y, tangent: y[0] - 0.25)])
    _, events, _ = parts(follow(problem, np.array([1.0, 0.0])))
    places = [event.point.y for event in events if event.code == "X"]
    assert [place[0] for place in places] == pytest.approx([0.25, 0.25], abs=1e-10)
    assert [place[1] for place in places] == pytest.approx([math.sqrt(1 - 0.0625), -math.sqrt(1 - 0.0625)], abs=1e-10)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        *(({"weights": weights}, "weights: expected finite") for weights in ([1.0, 0.0], [1.0, -2.0], [math.nan, 1.0], [math.inf, 1.0])),
        ({"maximum_iterations": 0}, "maximum_iterations = 0"),
    ],
)
def test_refuses_options_that_cannot_be(options, words):
    with pytest.raises(ValueError, match=words):
        circle(**options)


def test_a_wrong_sign_in_the_jacobian_is_seen():
    """With a mutated Jacobian Newton's method is no longer quadratic: the contraction shows it."""
    right = circle()
    wrong = GenericProblem(right.residual, lambda y: right.jacobian(y) * np.array([1.0, -1.0]))
    start = right.begin(np.array([0.6, 0.8]))
    good, bad = (problem.step(start.y, start.tangent, 0.05) for problem in (right, wrong))
    assert good.converged and good.contraction < 0.01
    assert not bad.converged or bad.contraction > 0.1


def test_keeps_the_contract():
    assert isinstance(circle(), Problem) and isinstance(Line(), Problem) and not isinstance(object(), Problem)
