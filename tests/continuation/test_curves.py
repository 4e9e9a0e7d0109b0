"""Curves in two parameters of algebraic problems whose curves and points are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuation import follow_both_ways
from continuation.control import Settings
from continuation.curves import Curve, Linearised, ScalarCondition, SingularCondition
from continuation.problem import EventDetails, TestFunction
from tests.branches.curve_oracles import ResonantMap, cusp_fold

SETTINGS = Settings(maximum_points=400)


class Plane:
    """F(x, a, b) = 0 with x in R^n: function, its derivatives by (x, a, b)."""

    def __init__(self, size, function, jacobian):
        self.size, self._function, self._jacobian = size, function, jacobian

    def linearised(self, y):
        gradients = np.zeros((2, self.size))
        gradients[0, -2] = gradients[1, -1] = 1.0
        return Linearised(y, self._function(y), self._jacobian(y), y[-2:].copy(), gradients)

    def worst(self, at):
        return float(np.abs(at.residual).max())

    def position(self, y):
        return y

    def directions(self, y):
        return np.eye(self.size)

    def scales(self, y):
        return np.ones(self.size)

    def violation(self, y):
        return None


class Watch:
    """Test functions given by name: each of the point's unknowns, its own ones and what its condition holds."""

    def __init__(self, **functions):
        self._functions = list(functions.values())
        self.tests = tuple(TestFunction(code, "crossing", oriented=code == "cusp") for code in functions)

    def values(self, at, own, held, tangent, scale):
        return [float(function(at, own, held)) for function in self._functions], None

    def classify(self, index, before, at, after, location):
        return None if location.kind in ("pole", "jump") else EventDetails(self.tests[index].code)


def cusp_plane():
    return Plane(
        3,
        lambda y: np.array([y[0] ** 3 - y[2] * y[0] - y[1]]),
        lambda y: np.array([[3.0 * y[0] ** 2 - y[2], -1.0, -y[0]]]),
    )


def cusp_fold_condition():
    def along(at, parts, own):
        v = parts[0]
        return np.array([[6.0 * at.y[0] * v[0], 0.0, -v[0]]])

    return SingularCondition(lambda at: (at.jacobian[:, :1], np.zeros((1, 1))), along, 1.0)


def quadratic(at, own, held):
    null = held.extra
    return null.left[:, 0] @ (null.along[:, :1] @ null.right[:, 0])


@pytest.mark.parametrize("start", [1.0, -1.0])
def test_the_folds_of_the_cusp(start):
    """Oracle: 27 a^2 = 4 b^3 at each point, and the cusp at the origin, from both folds."""
    curve = Curve(cusp_plane(), cusp_fold_condition(), Watch(cusp=quadratic))
    (x, a), _ = cusp_fold(1.0)
    run = follow_both_ways(
        curve, np.array([start * x + 1e-3, start * a, 1.0]), SETTINGS, stop_when=lambda point: abs(point.step.y[2]) > 3.0
    )
    for point in run.points:
        x, a, b = point.step.y
        assert a == pytest.approx(-2.0 * x**3, abs=1e-13) and b == pytest.approx(3.0 * x * x, abs=1e-13)
    (event,) = run.events
    assert event.code == "cusp" and np.abs(event.point.y).max() < 1e-9


class MapPlane(Plane):
    def __init__(self, map_):
        self.map = map_

        def function(y):
            return map_.image(y[:2], y[2], y[3]) - y[:2]

        def jacobian(y):
            return np.column_stack([map_.jacobian(y[:2], y[2], y[3]) - np.eye(2), [0.0, 1.0], [0.0, y[0]]])

        super().__init__(4, function, jacobian)

    def condition(self, multiplier):
        """Singular J - lambda, where at.jacobian has J - 1."""

        def along(at, parts, own):
            seconds = np.zeros((len(parts), 2, 4))
            for second, v in zip(seconds, parts, strict=True):
                second[1, 0] = 2.0 * v[0] + self.map.s * v[1]
                second[1, 1] = self.map.s * v[0]
                second[1, 3] = v[0]
            if len(parts) == 1:
                return seconds[0]
            return seconds.reshape(4, 4)

        return SingularCondition(lambda at: (at.jacobian[:, :2] + np.eye(2), -np.eye(2)), along, multiplier)


def trace(at, own=None, held=None):
    return at.jacobian[0, 0] + at.jacobian[1, 1] + 2.0


@pytest.mark.parametrize("s", [-1.0, 0.5])
@pytest.mark.parametrize(("code", "multiplier"), [("SN", 1.0), ("PD", -1.0), ("NS", None)])
def test_the_curves_of_the_resonant_map(s, code, multiplier):
    """Oracle: the closed forms at each point, with the points of codimension two to 1e-9."""
    map_ = ResonantMap(s)
    plane = MapPlane(map_)
    own = {"R1": lambda at, own, held: own[0] - 1.0, "R2": lambda at, own, held: own[0] + 1.0}
    own |= {"R3": lambda at, own, held: own[0] + 0.5, "R4": lambda at, own, held: own[0]}
    watch = Watch(**own) if code == "NS" else Watch(flip=lambda at, own, held: trace(at))
    curve = Curve(plane, plane.condition(multiplier), watch)
    b = {-1.0: -0.9, 0.5: 0.6}[s] if code == "NS" else 0.5
    x, a = map_.point(code, b)
    start = [x, 0.0, a, b, *([1.0 + 0.5 * s * x] if code == "NS" else [])]
    run = follow_both_ways(curve, np.array(start) + 1e-4, SETTINGS, stop_when=lambda point: abs(point.step.y[3]) > 40.0)
    assert len(run.points) > 20
    for point in run.points:
        x, y, a, b = point.step.y[:4]
        assert (x, a) == pytest.approx(map_.point(code, b), abs=1e-11) and abs(y) < 1e-12
    wanted = {"NS": ("1:1", "1:2", "1:3", "1:4"), "SN": ("SN+PD",), "PD": ("SN+PD",)}[code]
    found = [event.point.y[[0, 2, 3]] for event in run.events]
    for kind in wanted:
        place = map_.codimension_two(kind)
        assert min(np.abs(one - place).max() for one in found) < 1e-9


def test_a_scalar_condition_and_a_curve_that_closes():
    """Oracle: z = 0 on the unit sphere is a circle of length 2 pi."""
    plane = Plane(3, lambda y: np.array([y @ y - 1.0]), lambda y: 2.0 * y[None, :])
    circle = Curve(plane, ScalarCondition(lambda at: (at.y[0], np.array([1.0, 0.0, 0.0]))), Watch())
    run = follow_both_ways(circle, np.array([0.1, 0.9, 0.1]), SETTINGS)
    assert run.closed
    assert run.points[-1].arclength == pytest.approx(2.0 * math.pi, rel=1e-4)
    assert max(abs(point.step.y[0]) for point in run.points) < 1e-14


def test_derivatives_of_the_conditions():
    """Oracle: differences. The gradient of a condition is that of its values at fixed borders."""
    plane = MapPlane(ResonantMap(-1.0))
    random = np.random.default_rng(5)
    for multiplier in (1.0, -1.0, None):
        condition = plane.condition(multiplier)
        own = np.array([0.3] * condition.own)
        y = random.normal(size=4)
        scale = np.ones(4)
        borders = condition.first(plane.linearised(y), own, scale)
        held = condition.held(plane.linearised(y), own, borders, scale)
        whole, step = np.concatenate([y, own]), 1e-6
        for k in range(len(whole)):
            ahead, back = whole.copy(), whole.copy()
            ahead[k] += step
            back[k] -= step
            values = [condition.held(plane.linearised(one[:4]), one[4:], borders, scale).values for one in (ahead, back)]
            assert held.gradient[:, k] == pytest.approx((values[0] - values[1]) / (2.0 * step), rel=1e-6, abs=1e-7)
