"""Switching at branch points. Oracles: directions and branches in closed form; for tripled solutions Arnold's normal form at 1/3, whose
solutions are straight lines, in turned coordinates."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from continuation import GenericProblem, Settings, SwitchError, branch_directions, follow, follow_both_ways, other_branch_starts
from continuation.switching import oriented, refine_branch_point, tripling_direction
from tests.continuation.curves import circle, parts, pitchfork, transcritical


def test_pitchfork_from_the_trivial_branch_lands_on_the_side_branch():
    problem = pitchfork()
    (event,) = follow_both_ways(problem, np.array([0.0, -1.0]), Settings(maximum_points=100)).events
    steps = other_branch_starts(problem, event)
    assert len(steps) == 2
    assert sorted(np.sign(step.y[0]) for step in steps) == [-1, 1]
    for step in steps:
        assert abs(step.y[0]) == pytest.approx(math.sqrt(step.y[1]), abs=1e-14) and abs(step.y[0]) == pytest.approx(0.02, rel=1e-3)
        points, events, _ = parts(follow(problem, step, 0, Settings(maximum_points=30)))
        assert events == [] and all(abs(abs(p.step.y[0]) - math.sqrt(p.step.y[1])) < 1e-13 for p in points)
        assert points[-1].step.y[0] / step.y[0] > 1  # away from the branch point


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_pitchfork_from_the_side_branch_lands_on_the_trivial_branch(side):
    problem = pitchfork()
    (event,) = follow_both_ways(problem, np.array([side, 1.0]), Settings(maximum_points=100)).events
    steps = other_branch_starts(problem, event, distance=0.1)
    assert [step.y[0] for step in steps] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert sorted(step.y[1] for step in steps) == pytest.approx([-0.1, 0.1], abs=1e-7)


def test_transcritical_directions():
    directions = branch_directions(transcritical(), np.zeros(2), np.array([0.0, 1.0]))
    diagonal = np.array([1.0, 1.0]) / math.sqrt(2)
    for found, exact in zip(directions, (diagonal, -diagonal, np.array([0.0, 1.0]), np.array([0.0, -1.0])), strict=True):
        np.testing.assert_allclose(found * np.sign(found[1]), exact * np.sign(exact[1]), atol=1e-9)
    np.testing.assert_array_equal(directions[0], -directions[1])
    other = branch_directions(transcritical(), np.zeros(2), diagonal)
    np.testing.assert_allclose(np.abs(other[0]), [0.0, 1.0], atol=1e-9)


def crossing_in_space(one: np.ndarray, two: np.ndarray, curvature: float) -> GenericProblem:
    """Two curves through the origin of R^3 with tangents one and two: a product of planes with a bent surface."""
    normal = np.cross(one, two)
    normal = normal / np.linalg.norm(normal)
    across_one, across_two = np.cross(normal, one), np.cross(normal, two)

    def function(y):
        height = normal @ y - curvature * (y @ y)
        return np.array([height, (across_one @ y) * (across_two @ y) + 0.3 * height])

    def jacobian(y):
        height = normal - 2 * curvature * y
        return np.array([height, across_one * (across_two @ y) + across_two * (across_one @ y) + 0.3 * height])

    return GenericProblem(function, jacobian)


@given(st.floats(0.1, 1.5), st.floats(-1.0, 1.0), st.floats(0.0, 6.0), st.booleans())
@hypothesis_settings(max_examples=25, deadline=None)
def test_directions_of_any_crossing_in_space(angle, curvature, turn, exact_second_derivative):
    first = np.array([math.cos(turn), math.sin(turn), 0.5])
    first /= np.linalg.norm(first)
    perpendicular = np.cross(first, [0.3, -0.2, 0.9])
    perpendicular /= np.linalg.norm(perpendicular)
    second = math.cos(angle) * first + math.sin(angle) * perpendicular
    problem = crossing_in_space(first, second, curvature)
    if exact_second_derivative:
        step = 1e-3  # the Jacobian is linear in y: this difference is exact
        problem.second_derivative = lambda y, a, b: (problem.jacobian(y + step * b) - problem.jacobian(y - step * b)) @ a / (2 * step)
    other, opposite, known, _ = branch_directions(problem, np.zeros(3), first)
    assert abs(other @ second) == pytest.approx(1, abs=1e-9) and abs(known @ first) == pytest.approx(1, abs=1e-9)
    np.testing.assert_array_equal(other, -opposite)


def test_second_derivative_of_the_problem_is_used():
    calls = []

    def second(y, a, b):
        calls.append(1)
        hessian = np.array([[-6 * y[0], 1.0], [1.0, 0.0]])
        return np.array([a @ hessian @ b])

    problem = GenericProblem(
        lambda y: np.array([y[0] * (y[1] - y[0] ** 2)]), lambda y: np.array([[y[1] - 3 * y[0] ** 2, y[0]]]), second_derivative=second
    )
    other = branch_directions(problem, np.zeros(2), np.array([0.0, 1.0]))[0]
    assert calls and np.abs(other) == pytest.approx([1.0, 0.0], abs=1e-14)


def test_directions_are_of_unit_length_in_the_metric():
    weights = np.array([9.0, 0.5])
    problem = GenericProblem(lambda y: np.array([y[0] * (y[1] - y[0])]), lambda y: np.array([[y[1] - 2 * y[0], y[0]]]), weights=weights)
    for direction in branch_directions(problem, np.zeros(2), np.array([0.0, 1.0])):
        assert float(weights * direction @ direction) == pytest.approx(1)
    other = branch_directions(problem, np.zeros(2), np.array([0.0, 1.0]))[0]
    assert other[0] == pytest.approx(other[1], rel=1e-8)


def test_refuses_a_fold_in_words():
    fold = next(event for event in follow_both_ways(circle(), np.array([1.0, 0.0])).events)
    with pytest.raises(SwitchError, match="null space of the Jacobian is one-dimensional"):
        other_branch_starts(circle(), fold)


@pytest.mark.parametrize(
    ("function", "jacobian", "words"),
    [
        (lambda y: [y @ y], lambda y: [2 * y], "no two different real solutions"),  # an isolated point
        (lambda y: [y[0] * (y[0] - y[1] ** 2)], lambda y: [[2 * y[0] - y[1] ** 2, -2 * y[0] * y[1]]], "no two different real solutions"),
        (lambda y: [y[0] * y[2], y[1] * y[2]], lambda y: [[y[2], 0.0, y[0]], [0.0, y[2], y[1]]], "more than two dimensions"),
    ],
)
def test_refuses_points_without_two_branches_that_cross(function, jacobian, words):
    size = 3 if "dimensions" in words else 2
    with pytest.raises(SwitchError, match=words):
        branch_directions(GenericProblem(function, jacobian), np.zeros(size), np.eye(size)[-1])


def test_refuses_a_distance_at_which_there_can_be_no_point():
    (event,) = follow_both_ways(pitchfork(), np.array([0.0, -1.0]), Settings(maximum_points=100)).events
    with pytest.raises(ValueError, match="distance = 0"):
        other_branch_starts(pitchfork(), event, distance=0.0)
    # A parabola turns more than that at every distance.
    with pytest.raises(SwitchError, match="no point of the other branch could be corrected within 0.1 of the branch point"):
        other_branch_starts(pitchfork(), event, Settings(maximum_turn=1e-9, target_turn=1e-10), distance=0.1)


@pytest.mark.parametrize("offset", [1e-3, 1e-5, 1e-7])
def test_a_branch_point_is_refined_to_rounding(offset):
    """Oracle: two lines that cross at a known place in the plane x + y + z = 2.5, seen from beside it."""

    def residual(y):
        return np.array([(y[0] - 1.0) * (y[1] - 2.0), y[0] + y[1] + y[2] - 2.5])

    def jacobian(y):
        return np.array([[y[1] - 2.0, y[0] - 1.0, 0.0], [1.0, 1.0, 1.0]])

    near = np.array([1.0 + offset, 2.0 - 0.3 * offset, -0.5 + 0.4 * offset])
    found = refine_branch_point(GenericProblem(residual, jacobian), near)
    assert found is not None and np.max(np.abs(found - [1.0, 2.0, -0.5])) < 1e-14
    assert np.linalg.svd(jacobian(found), compute_uv=False)[-1] < 1e-14


class CrossingLines:
    """F = ((x - 1)(y - 2), v^3 + x - 1, w^2 + y - 4), whose second derivatives are by x and y, by v, and by w."""

    def residual(self, at):
        x, y, v, w = at
        return np.array([(x - 1.0) * (y - 2.0), v**3 - 8.0 + x - 1.0, w * w - 9.0 + y - 2.0])

    def jacobian(self, at):
        x, y, v, w = at
        return np.array([[y - 2.0, x - 1.0, 0.0, 0.0], [1.0, 0.0, 3.0 * v * v, 0.0], [0.0, 1.0, 0.0, 2.0 * w]])


class InBlocks(CrossingLines):
    """The same equations with their blocks, one shorter than the longest."""

    curvature_blocks = (np.array([0, 1]), np.array([2]), np.array([3]))


class WrongBlocks(CrossingLines):
    """Blocks that part x from y."""

    curvature_blocks = (np.array([0, 2]), np.array([1, 3]))


def test_one_difference_serves_a_column_of_each_block():
    """Oracle: the place in closed form, and the differences column by column, to the bit. Wrong blocks are noticed."""
    near = np.array([1.001, 1.999, 2.0005, 2.9995])
    found = refine_branch_point(InBlocks(), near)
    assert found is not None and np.max(np.abs(found - [1.0, 2.0, 2.0, 3.0])) < 1e-13
    assert np.array_equal(found, refine_branch_point(CrossingLines(), near))
    wrong = refine_branch_point(WrongBlocks(), near)
    assert wrong is None or not np.array_equal(found, wrong)


class Coupled:
    """F = ((x - 1)(y - 2)(1 + p), v^3 - 8 + x - 1 + p v, p (1 + v) + y - 2): p acts on the blocks of x and y, and of v."""

    curvature_blocks = (np.array([0, 1]), np.array([2]))

    def __init__(self):
        self.taken = 0

    def residual(self, at):
        x, y, v, p = at
        return np.array([(x - 1.0) * (y - 2.0) * (1.0 + p), v**3 - 8.0 + x - 1.0 + p * v, p * (1.0 + v) + y - 2.0])

    def jacobian(self, at):
        self.taken += 1
        x, y, v, p = at
        first = [(y - 2.0) * (1.0 + p), (x - 1.0) * (1.0 + p), 0.0, (x - 1.0) * (y - 2.0)]
        return np.array([first, [1.0, 0.0, 3.0 * v * v + p, v], [0.0, 1.0, p, 1.0 + v]])


def test_an_unknown_that_acts_on_all_blocks():
    """Oracle: the place in closed form; column by column it is the same, with more differences."""
    near = np.array([1.001, 1.999, 2.0005, 0.0004])
    coupled, plain = Coupled(), Coupled()
    plain.curvature_blocks = (np.arange(4),)
    found, other = (refine_branch_point(equations, near) for equations in (coupled, plain))
    assert np.max(np.abs(found - [1.0, 2.0, 2.0, 0.0])) < 1e-13 and np.max(np.abs(found - other)) < 1e-13
    assert coupled.taken < plain.taken


def test_where_no_branch_point_is_near_none_is_refined():
    """Oracle: a circle has none; lines that cross farther away than asked for are left alone."""
    circle_problem = GenericProblem(lambda y: np.array([y @ y - 1.0]), lambda y: 2.0 * y[None, :])
    assert refine_branch_point(circle_problem, np.array([1.0, 0.0])) is None
    lines = GenericProblem(lambda y: np.array([y[0] * y[1]]), lambda y: np.array([[y[1], y[0]]]))
    assert refine_branch_point(lines, np.array([0.02, 0.0]), farthest=0.01) is None
    assert refine_branch_point(lines, np.array([0.02, 0.0]), farthest=0.03) is not None


class NormalForm:
    """i e z + c conj(z)^2 = 0 for z = x + i y with a further equation, s = e + x y; unknowns are a regular linear image of (e, x, y, s)."""

    def __init__(self, c, seed):
        self.c = c
        self.turn = np.random.default_rng(seed).normal(size=(4, 4)) + 2.0 * np.eye(4)

    def residual(self, unknowns):
        e, x, y, s = self.turn @ unknowns
        out = 1j * e * (x + 1j * y) + self.c * (x - 1j * y) ** 2
        return np.array([out.real, out.imag, s - e - x * y])

    def jacobian(self, unknowns):
        e, x, y, _ = self.turn @ unknowns
        z = x + 1j * y
        columns = [1j * z, 1j * e + 2.0 * self.c * z.conjugate(), -e - 2.0j * self.c * z.conjugate(), 0.0]
        rows = [[complex(v).real for v in columns], [complex(v).imag for v in columns], [-1.0, -y, -x, 1.0]]
        return np.array(rows) @ self.turn


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("c", [1.0, 0.3 - 2.0j])
def test_the_straight_lines_of_the_normal_form(c, seed):
    form = NormalForm(c, seed)
    known = np.linalg.solve(form.turn, [1.0, 0.0, 0.0, 1.0])
    scale = np.array([1.0, 0.5, 2.0, 1.0])
    e, x, y, _ = form.turn @ tripling_direction(form, np.zeros(4), known, scale)
    z = x + 1j * y
    assert abs(1j * e * z + c * z.conjugate() ** 2) < 1e-10 * abs(z) ** 2 and abs(z) > 1e-3
    assert abs(abs(e) / abs(z) - abs(c)) < 1e-10


def test_where_nothing_triples_it_is_said():
    form = NormalForm(1.0, 0)
    known = np.linalg.solve(form.turn, [1.0, 0.0, 0.0, 1.0])
    with pytest.raises(SwitchError, match="not three dimensions"):
        tripling_direction(form, 0.1 * known, known, np.ones(4))
    with pytest.raises(SwitchError, match="not decided at second order"):
        tripling_direction(NormalForm(0.0, 0), np.zeros(4), known, np.ones(4))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_sign_of_a_null_vector_is_not_that_of_the_linear_algebra(monkeypatch, sign):
    """A pitchfork in x = y: its branches leave along (1, 1, 0), whose largest entries are equal but for rounding. Oracle: the same
    directions from singular vectors of either sign."""
    svd = np.linalg.svd

    def other(matrix, *arguments, **options):
        left, values, right = svd(matrix, *arguments, **options)
        return sign * left, values, sign * right

    monkeypatch.setattr(np.linalg, "svd", other)
    slanted = GenericProblem(
        lambda y: np.array([y[0] * (y[2] - y[0] ** 2), y[0] - y[1]]),
        lambda y: np.array([[y[2] - 3.0 * y[0] ** 2, 0.0, y[0]], [1.0, -1.0, 0.0]]),
    )
    forward, backward, *_ = branch_directions(slanted, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    assert forward == pytest.approx([0.5**0.5, 0.5**0.5, 0.0], abs=1e-8) and np.array_equal(backward, -forward)
    for shift in (1e-15, -1e-15):
        assert np.array_equal(np.sign(oriented(np.array([-1.0, 1.0 + shift]))), [1.0, -1.0])
