"""Curves with known answers, which the tests of the engine follow."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from continuation import EventDetails, GenericProblem, Location, Point, Step, TestFunction

PARAMETER = 1  # y = (x, a) in the plane curves


def plane_curve(function: Callable, derivative: Callable, **options) -> GenericProblem:
    """F(x, a) = 0 with the derivatives (F_x, F_a)."""
    return GenericProblem(lambda y: np.array([function(*y)]), lambda y: np.array([derivative(*y)]), parameter=PARAMETER, **options)


def circle(**options) -> GenericProblem:
    return plane_curve(lambda x, a: x * x + a * a - 1, lambda x, a: (2 * x, 2 * a), **options)


def ellipse(long: float, short: float) -> GenericProblem:
    return plane_curve(lambda x, a: (x / long) ** 2 + (a / short) ** 2 - 1, lambda x, a: (2 * x / long**2, 2 * a / short**2))


def pitchfork() -> GenericProblem:
    """x (a - x^2) = 0: branches x = 0 and a = x^2, branch point at the origin."""
    return plane_curve(lambda x, a: x * (a - x * x), lambda x, a: (a - 3 * x * x, x))


def imperfect_pitchfork(imperfection: float) -> GenericProblem:
    """x (a - x^2) + e = 0: a = x^2 - e/x, fold at x = -(e/2)^(1/3) with a = 3 (e/2)^(2/3); no branch point."""
    return plane_curve(lambda x, a: x * (a - x * x) + imperfection, lambda x, a: (a - 3 * x * x, x))


def transcritical() -> GenericProblem:
    """x (a - x) = 0: branches x = 0 and x = a."""
    return plane_curve(lambda x, a: x * (a - x), lambda x, a: (a - 2 * x, x))


def cubic() -> GenericProblem:
    """x^3 - x - a = 0: folds at x = -+1/sqrt(3), a = +-2/(3 sqrt 3)."""
    return plane_curve(lambda x, a: x**3 - x - a, lambda x, a: (3 * x * x - 1, -1.0))


def hyperbola(gap: float) -> GenericProblem:
    """x^2 - a^2 = gap^2: two branches that come within 2 gap of one another and turn by a right angle there."""
    return plane_curve(lambda x, a: x * x - a * a - gap * gap, lambda x, a: (2 * x, -2 * a))


def parallel_lines(gap: float) -> GenericProblem:
    """x (x - gap) = 0."""
    return plane_curve(lambda x, a: x * (x - gap), lambda x, a: (2 * x - gap, 0.0))


def root_end() -> GenericProblem:
    """x = 1 + sqrt(a), which ends at a = 0."""
    return plane_curve(lambda x, a: x - 1 - np.sqrt(a), lambda x, a: (1.0, -0.5 / np.sqrt(a)))


def bratu(second_difference: np.ndarray) -> GenericProblem:
    """u'' + lam e^u = 0 at inner nodes, for a matrix of the second derivative that knows the zero ends; y = (u, lam)."""
    n = len(second_difference)

    def function(y: np.ndarray) -> np.ndarray:
        return second_difference @ y[:-1] + y[-1] * np.exp(y[:-1])

    def jacobian(y: np.ndarray) -> np.ndarray:
        exponential = np.exp(y[:-1])
        return np.column_stack((second_difference + np.diag(y[-1] * exponential), exponential))

    return GenericProblem(function, jacobian, weights=[1 / n] * n + [1.0])


def central_differences(intervals: int) -> np.ndarray:
    """Second derivative on (0, 1) by three points."""
    n = intervals - 1
    return (np.diag(np.ones(n - 1), 1) - 2 * np.eye(n) + np.diag(np.ones(n - 1), -1)) * float(intervals) ** 2


def chebyshev(degree: int) -> np.ndarray:
    """Second derivative on (0, 1) by collocation at Chebyshev's points (Trefethen, Spectral Methods in MATLAB, ch. 6)."""
    x = np.cos(np.pi * np.arange(degree + 1) / degree)
    ends = np.where((np.arange(degree + 1) % degree) == 0, 2.0, 1.0) * (-1.0) ** np.arange(degree + 1)
    differences = x[:, None] - x[None, :]
    matrix = np.outer(ends, 1 / ends) / (differences + np.eye(degree + 1))
    matrix -= np.diag(matrix.sum(axis=1))
    return 4 * (matrix @ matrix)[1:-1, 1:-1]


class Line:
    """The line y = s itself with test functions of s: whatever the engine makes of it has an exact answer.

    Parameters
    ----------
    tests : pairs of a Test and a function of s
    broken : function of s that is true where the corrector fails
    classify : as in a problem; by default an event is what its test says
    turn : function of (s, s + ds) that gives the cosine of the turn
    """

    def __init__(
        self,
        *tests: tuple[TestFunction, Callable[[float], float]],
        broken: Callable[[float], bool] = lambda s: False,
        classify: Callable | None = None,
        turn: Callable[[float, float], float] = lambda s, end: 1.0,
        contraction: Callable[[float], float] = lambda ds: 0.0,
    ) -> None:
        self.tests = tuple(test for test, _ in tests)
        self._functions = [function for _, function in tests]
        self._broken = broken
        self._classify = classify
        self._turn = turn
        self._contraction = contraction
        self.steps = 0

    def begin(self, y: np.ndarray) -> Step:
        return self.step(y, np.array([1.0]), 0.0)

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        self.steps += 1
        end = float(y[0] + ds * tangent[0])
        sense = float(tangent[0])
        values = [function(end) * (sense if test.oriented else 1.0) for test, function in zip(self.tests, self._functions, strict=True)]
        return Step(
            converged=not self._broken(end),
            y=np.array([end]),
            tangent=tangent,
            position=(end,),
            turn=self._turn(float(y[0]), end),
            contraction=self._contraction(ds),
            iterations=1,
            residual=0.0,
            parameter=end,
            slope=sense,
            tests=np.array(values),
            extra={"at": end},
        )

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        if self._classify is not None:
            return self._classify(index, before, at, after, location)
        return EventDetails(self.tests[index].code)

    def residual(self, y: np.ndarray) -> np.ndarray:
        return np.empty(0)

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        return np.empty((0, 1))

    def failure(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> str:
        return f"the line is broken after {y[0]:.3f}"


def parts(items) -> tuple[list, list, list]:
    """Points, events and ends of what `follow` gives."""
    points, events, ends = [], [], []
    for item in items:
        (points if isinstance(item, Point) else events if hasattr(item, "code") else ends).append(item)
    return points, events, ends


def is_close(a: float, b: float, tolerance: float) -> bool:
    return math.isclose(a, b, rel_tol=0.0, abs_tol=tolerance)


class Ring(Line):
    """The unit circle in closed form, with test functions of the angle, which may be any function of period 2 pi."""

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        if len(y) == 1:  # an angle to begin with
            y = np.array([math.cos(y[0]), math.sin(y[0])])
            tangent = np.array([-y[1], y[0]])
        sense = 1.0 if y[0] * tangent[1] - y[1] * tangent[0] > 0 else -1.0
        turn = math.asin(ds)
        angle = math.atan2(y[1], y[0]) + sense * turn
        point = np.array([math.cos(angle), math.sin(angle)])
        values = [function(angle) * (sense if test.oriented else 1.0) for test, function in zip(self.tests, self._functions, strict=True)]
        new_tangent = sense * np.array([-point[1], point[0]])
        return Step(True, point, new_tangent, tuple(point), math.cos(turn), 0.0, 1, 0.0, angle, sense, values)


class Eight(Line):
    """x = sin t, a = 2 sin t cos t, followed with growing t: through the origin twice, with tangents 53 degrees apart."""

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        start = math.atan2(y[0], math.copysign(math.sqrt(1 - y[0] ** 2), tangent[0]))
        t = start
        for _ in range(8):
            velocity = np.array([math.cos(t), 2 * math.cos(2 * t)])
            point = np.array([math.sin(t), math.sin(2 * t)])
            t -= (float(tangent @ (point - y)) - ds) / float(tangent @ velocity)
        point = np.array([math.sin(t), math.sin(2 * t)])
        new = np.array([math.cos(t), 2 * math.cos(2 * t)])
        new /= np.linalg.norm(new)
        return Step(True, point, new, tuple(point), float(new @ tangent), 0.0, 1, 0.0, float(point[1]), float(new[1]), [])
