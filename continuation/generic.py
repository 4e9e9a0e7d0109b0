"""A problem given by F(y) = 0 and its Jacobian, with dense linear algebra: folds and branch points in n + 1 unknowns."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction
from continuation.switching import oriented

Array = np.ndarray
_EPS = float(np.finfo(float).eps)


class GenericProblem:
    """F(y) = 0 with y in R^(n+1), corrected by Newton's method on the system bordered by the tangent.

    Parameters
    ----------
    function : callable
        F: y (n + 1,) to (n,).
    jacobian : callable
        F': y (n + 1,) to (n, n + 1).
    parameter : int
        Index in y of the reported parameter.
    weights : array_like (n + 1,), optional
        Diagonal of the metric: arclength is measured in sqrt(weights) y. All 1 if not given. For unknowns that sample a
        function, weights of about 1/n keep the arclength independent of n.
    tests : sequence of (TestFunction, callable), optional
        Test functions of the user's own, each called with y and the unit tangent.
    second_derivative : callable, optional
        (y, a, b) to F''(y)[a, b] (n,), used for switching; central differences of the Jacobian if not given.
    maximum_iterations : int
        Newton iterations in a step.

    Raises
    ------
    ValueError
        Weights that are not positive, fewer than one iteration.

    Notes
    -----
    Test function 0, ``SN``: the slope, derivative of the parameter along the arclength. Test function 1, ``BP``: the determinant of the
    Jacobian bordered by the tangent, scaled by the product of all its singular values but the smallest: the smallest one with the sign
    of the determinant. It is as smooth as the determinant near a simple zero and does not overflow. It costs singular values
    at each point, of order n^3, as does the rest.

    Newton stops when the update is at rounding level, or when the residual is and the updates no longer shrink (near a branch
    point, where the matrix is singular). The rounding level of the residual is eps (n + 1) |F'| |y|.

    Examples
    --------
    >>> cubic = GenericProblem(lambda y: np.array([y[0]**3 - y[0] - y[1]]), lambda y: np.array([[3*y[0]**2 - 1, -1.0]]))
    >>> step = cubic.begin(np.array([2.0, 5.0]))
    >>> step.converged, float(round(step.y[0]**3 - step.y[0] - step.y[1], 12))
    (True, 0.0)
    """

    def __init__(
        self,
        function: Callable[[Array], Array],
        jacobian: Callable[[Array], Array],
        *,
        parameter: int = -1,
        weights: Sequence[float] | Array | None = None,
        tests: Sequence[tuple[TestFunction, Callable[[Array, Array], float]]] = (),
        second_derivative: Callable[[Array, Array, Array], Array] | None = None,
        maximum_iterations: int = 12,
    ) -> None:
        if maximum_iterations < 1:
            raise ValueError(f"maximum_iterations = {maximum_iterations!r}: expected 1 or more")
        self._function = function
        self._jacobian = jacobian
        self._parameter = parameter
        self.weights: Array | None = None if weights is None else np.array(weights, dtype=float)
        if self.weights is not None and not np.all((self.weights > 0) & np.isfinite(self.weights)):
            raise ValueError("weights: expected finite positive numbers")
        self._user_tests = tuple(function for _, function in tests)
        self._iterations = maximum_iterations
        self.tests: tuple[TestFunction, ...] = (
            TestFunction("SN", "crossing", label="fold in the parameter", oriented=True),
            TestFunction("BP", "crossing", label="branch point", oriented=True, absorbs=("SN",), singular=1e-5),
            *(test for test, _ in tests),
        )
        if second_derivative is not None:
            self.second_derivative = second_derivative

    def residual(self, y: Array) -> Array:
        """F(y), shape (n,)."""
        with np.errstate(all="ignore"):
            return np.asarray(self._function(y), dtype=float)

    def jacobian(self, y: Array) -> Array:
        """F'(y), shape (n, n + 1)."""
        with np.errstate(all="ignore"):
            return np.asarray(self._jacobian(y), dtype=float)

    def begin(self, y: Array) -> Step:
        """The point of the curve nearest y in the metric, to first order (Gauss-Newton), with its tangent."""
        y = np.array(y, dtype=float)
        matrix = self.jacobian(y)
        if not np.all(np.isfinite(matrix)):
            return Step.failed(y)
        scale = np.ones(y.size) if self.weights is None else 1.0 / np.sqrt(self.weights)
        null = oriented(np.linalg.svd(matrix * scale)[2][-1])
        # Newton on the plane normal to the null vector at y; the vector there orients the tangent.
        return self.step(y, scale * null, 0.0)._replace(turn=1.0)

    def step(self, y: Array, tangent: Array, ds: float) -> Step:
        """The point at the pseudo-arclength ds along the tangent; see `continuation.Problem`."""
        row = tangent if self.weights is None else self.weights * tangent
        size = y.size
        matrix = np.empty((size, size))
        matrix[-1] = row
        right = np.empty(size)
        new = y + ds * tangent
        last = contraction = 0.0
        for iteration in range(1, self._iterations + 1):
            value = self.residual(new)
            matrix[:-1] = self.jacobian(new)
            right[:-1] = value
            right[-1] = row @ (new - y) - ds
            residual = float(np.linalg.norm(value))
            rounding = 4 * _EPS * size * (float(np.linalg.norm(matrix[:-1])) * float(np.linalg.norm(new)) + 1e-300)
            try:
                update = np.linalg.solve(matrix, right)
            except np.linalg.LinAlgError:
                if residual <= rounding and iteration > 1:
                    break
                return Step.failed(y)
            length = float(np.linalg.norm(update))
            if not math.isfinite(length):
                return Step.failed(y)
            floor = 4 * _EPS * (1.0 + float(np.linalg.norm(new)))
            if residual <= rounding and iteration > 1 and length > 0.25 * last:
                break  # nothing left but rounding
            new = new - update
            if last > 0.0 and length > 1e3 * floor:
                contraction = max(contraction, length / last)
            if length <= floor:
                break
            last = length
        else:
            residual = float(np.linalg.norm(self.residual(new)))
            if not residual <= rounding:
                return Step.failed(y)
        matrix[:-1] = self.jacobian(new)
        right = np.zeros(size)
        right[-1] = 1.0
        try:
            new_tangent = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            new_tangent = tangent.copy()  # exactly at a branch point: keep to the branch that is followed
        weights = self.weights
        weighted = new_tangent if weights is None else weights * new_tangent
        length = math.sqrt(float(weighted @ new_tangent))
        if not math.isfinite(length) or length == 0.0:
            return Step.failed(y)
        new_tangent = new_tangent / length
        matrix[-1] = weighted / length
        sign, _ = np.linalg.slogdet(matrix)
        smallest = np.linalg.svd(matrix, compute_uv=False)[-1]
        tests = [float(new_tangent[self._parameter]), float(sign * smallest)]
        tests += [float(test(new, new_tangent)) for test in self._user_tests]
        position = new if weights is None else np.sqrt(weights) * new
        return Step(
            converged=True,
            y=new,
            tangent=new_tangent,
            position=tuple(position.tolist()),
            turn=float(row @ new_tangent),
            contraction=contraction,
            iterations=iteration,
            residual=float(np.linalg.norm(self.residual(new))),
            parameter=float(new[self._parameter]),
            slope=tests[0],
            tests=tests,
        )

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """A fold, a branch point, or an event of the user's test."""
        return EventDetails(self.tests[index].code)

    def failure(self, y: Array, tangent: Array, ds: float) -> str:
        """What Newton's method met in a step that failed."""
        value = self.residual(y + ds * tangent)
        if not np.all(np.isfinite(value)):
            return f"F is not finite at the predicted point {ds:.3g} ahead"
        return f"|F| = {float(np.linalg.norm(value)):.3g} at the predicted point {ds:.3g} ahead"
