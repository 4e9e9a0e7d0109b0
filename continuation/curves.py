"""Curves in the plane of two parameters: where a surface of solutions has one more property.

A family solves n equations in n + 1 unknowns. With a second parameter released the unknowns are n + 2, and the solutions a surface. A
*condition* singles out a curve on it: a matrix is singular, or a number vanishes. The curve is a `continuation.Problem` as any family.

A matrix B0 + lambda B1 is singular where g = 0 in its bordered systems (Govaerts, Numerical Methods for Bifurcations of Dynamical
Equilibria, SIAM 2000, chapter 3)

    [ B   w ] [ V ]   [ 0 ]         [ B'  v ] [ W ]   [ 0 ]
    [ v'  0 ] [ g ] = [ 1 ]         [ w'  0 ] [ g ] = [ 1 ]         dg = - W' dB V

A pair exp(+-i theta) has the unknown kappa = cos theta, and the matrix of B0 V + B1 V L = 0 with the companion matrix L of
x^2 - 2 kappa x + 1. That is regular where the pair meets at 1 or -1. A tangent carries its curvature and the borders behind it, so that a
step depends on its arguments alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.linalg.lapack import dgesv, dgetrf, dgetrs

from continuation.location import Location
from continuation.problem import EventDetails, Point, Step, TestFunction
from continuation.switching import oriented

__all__ = [
    "Condition", "Corrected", "Curve", "Held", "ITERATIONS", "Linearised", "Monitor", "Null", "ROUNDING", "SETTLED", "ScalarCondition",
    "SingularCondition", "Surface",
]  # fmt: skip

ITERATIONS = 10
"""Most iterations of a step."""

SETTLED = 1e-11
"""Largest Newton update, in units of the unknowns' sizes, that is the last one: the next one is rounding."""

ROUNDING = 1e-9
"""Largest update that can be rounding, where updates do not shrink any more."""

_SHORT = 1e-6
"""Length of a step over which the tangent hardly turns: its curvature is that of the step before."""


class Linearised(NamedTuple):
    """The equations of a surface at the unknowns y (u,).

    residual (n,), jacobian (n, u). parameters: the two of the plane; gradients (2, u): their derivatives. extra: the surface's own data.
    """

    y: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    parameters: np.ndarray
    gradients: np.ndarray
    extra: Any = None


class Surface(Protocol):
    """n equations in u = n + 2 unknowns. Their metric has the coordinates `position` (N,) with the derivatives `directions` (N, u)."""

    size: int

    def linearised(self, y: np.ndarray) -> Linearised: ...

    def worst(self, at: Linearised) -> float:
        """The largest residual, in units of the equations' terms."""
        ...

    def position(self, y: np.ndarray) -> np.ndarray: ...

    def directions(self, y: np.ndarray) -> np.ndarray: ...

    def scales(self, y: np.ndarray) -> np.ndarray:
        """Sizes of the unknowns, (u,)."""
        ...

    def violation(self, y: np.ndarray) -> str | None:
        """Why there is no solution near y; None where nothing is known."""
        ...


class Held(NamedTuple):
    """A condition at a point: its values (1 + e,), their derivatives by the unknowns and its e own ones (1 + e, u + e), the borders
    renewed, and what else the condition has found."""

    values: np.ndarray
    gradient: np.ndarray
    borders: np.ndarray
    extra: Any = None


class Condition(Protocol):
    """1 + e equations with e unknowns of their own."""

    own: int

    def first(self, at: Linearised, own: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Borders at a point near the curve."""
        ...

    def held(self, at: Linearised, own: np.ndarray, borders: np.ndarray, scale: np.ndarray) -> Held: ...


class ScalarCondition:
    """A number that vanishes: `function` gives it and its derivatives (u,)."""

    own = 0

    def __init__(self, function: Callable[[Linearised], tuple[float, np.ndarray]]):
        self._function = function

    def first(self, at: Linearised, own: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """See `Condition`: no borders."""
        return np.zeros(0)

    def held(self, at: Linearised, own: np.ndarray, borders: np.ndarray, scale: np.ndarray) -> Held:
        """See `Condition`."""
        value, gradient = self._function(at)
        return Held(np.array([value]), gradient[None, :], borders)


class Null(NamedTuple):
    """Null vectors of a pencil at the unknowns y (u,): right (d m, d) in units of the unknowns' sizes, left (d m, d); shifted (m, m), B1 in
    the same units; along (d m, u), the derivatives of the whole matrix times the first null vector."""

    y: np.ndarray
    right: np.ndarray
    left: np.ndarray
    shifted: np.ndarray
    along: np.ndarray


class SingularCondition:
    """A matrix B0 + lambda B1 that is singular.

    Parameters
    ----------
    matrices : callable
        Gives B0 and B1, (m, m) each. The columns are unknowns of the surface, the first m of them.
    along : callable
        ``along(at, parts, own)`` (d m, u): the derivatives by the unknowns of the whole matrix times a vector with d parts (d, m). own: the
        unknowns of the condition.
    multiplier : float or None
        lambda; None: a pair exp(+-i theta), whose cosine is an unknown.
    """

    def __init__(
        self,
        matrices: Callable[[Linearised], tuple[np.ndarray, np.ndarray]],
        along: Callable[[Linearised, np.ndarray, np.ndarray], np.ndarray],
        multiplier: float | None,
    ):
        self._matrices, self._whole_slopes, self.multiplier = matrices, along, multiplier
        self.own = 0 if multiplier is not None else 1
        self.order = 1 + self.own

    def matrix(self, at: Linearised, own: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The matrix that is singular, in units of the unknowns, and B1."""
        fixed, shifted = self._matrices(at)
        m = len(fixed)
        fixed, shifted = fixed * scale[:m], shifted * scale[:m]
        if self.multiplier is not None:
            return fixed + self.multiplier * shifted, shifted
        whole = np.empty((2 * m, 2 * m))
        whole[:m, :m], whole[:m, m:] = fixed, shifted
        whole[m:, :m], whole[m:, m:] = -shifted, fixed + 2.0 * own[0] * shifted
        return whole, shifted

    def first(self, at: Linearised, own: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """See `Condition`: the singular vectors of the smallest singular values."""
        left, _, right = np.linalg.svd(self.matrix(at, own, scale)[0])
        return np.concatenate([left[:, -self.order :].T.ravel(), right[-self.order :].ravel()])

    def held(self, at: Linearised, own: np.ndarray, borders: np.ndarray, scale: np.ndarray) -> Held:
        """See `Condition`."""
        matrix, shifted = self.matrix(at, own, scale)
        size, d = len(matrix), self.order
        w, v = borders[: size * d].reshape(d, size).T, borders[size * d :].reshape(d, size).T
        bordered = np.zeros((size + d, size + d))
        bordered[:size, :size], bordered[:size, size:], bordered[size:, :size] = matrix, w, v.T
        wanted = np.zeros((size + d, d))
        wanted[size:] = np.eye(d)
        factor, pivots, _ = dgetrf(bordered)
        right = dgetrs(factor, pivots, wanted)[0]
        left = dgetrs(factor, pivots, wanted, trans=1)[0][:size]
        values, first = right[size:, 0], right[:size, 0]
        m = len(shifted)
        slopes = self._whole_slopes(at, first.reshape(d, m) * scale[:m], own)
        gradient = -left.T @ slopes
        if self.own:
            turned = np.concatenate([np.zeros(m), 2.0 * (shifted @ first[m:])])
            gradient = np.column_stack([gradient, -left.T @ turned])
        renewed = np.concatenate([_orthonormal(left).T.ravel(), _orthonormal(right[:size]).T.ravel()])
        return Held(values, gradient, renewed, Null(at.y, right[:size], left, shifted, slopes))


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    """The columns made orthonormal, in their order and orientation."""
    first = columns[:, 0] / math.sqrt(float(columns[:, 0] @ columns[:, 0]))
    if columns.shape[1] == 1:
        return first[:, None]
    second = columns[:, 1] - first * (first @ columns[:, 1])
    return np.column_stack([first, second / math.sqrt(float(second @ second))])


class Monitor(Protocol):
    """The test functions of a curve."""

    tests: tuple[TestFunction, ...]

    def values(self, at: Linearised, own: np.ndarray, held: Held, tangent: np.ndarray, scale: np.ndarray) -> tuple[Sequence[float], Any]:
        """Their values, and data of the point."""
        ...

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None: ...


class Corrected(NamedTuple):
    """A point of a curve as a step finds it: its unknowns y (m,), the equations of the surface there, the condition and the unit tangent
    along (m,) before the last update, the sizes of the unknowns of the surface, and what a `Step` has of the corrector."""

    y: np.ndarray
    at: Linearised
    held: Held
    along: np.ndarray
    scale: np.ndarray
    turn: float
    contraction: float
    iterations: int
    residual: float


class Curve:
    """A curve as a `continuation.Problem`. Its unknowns are those of the surface, then those of the condition.

    Parameters
    ----------
    surface : Surface
    condition : Condition
    monitor : Monitor
    """

    def __init__(self, surface: Surface, condition: Condition, monitor: Monitor):
        self.surface, self.condition, self.monitor = surface, condition, monitor
        self.tests = monitor.tests

    def begin(self, y: np.ndarray) -> Step:
        """See `continuation.Problem`."""
        u = self.surface.size
        scale = self.surface.scales(y[:u])
        try:
            at = self.surface.linearised(y[:u])
            borders = self.condition.first(at, y[u:], scale)
            held = self.condition.held(at, y[u:], borders, scale)
            matrix = self._matrix(at, held)[:-1] * self._sizes(scale)
            null = oriented(np.linalg.svd(matrix)[2][-1]) * self._sizes(scale)
        except (np.linalg.LinAlgError, ValueError):
            return Step.failed(y)
        way = self._directions(y) @ null
        return self.step(y, self.directed(null / math.sqrt(float(way @ way)), borders), 0.0)._replace(turn=1.0)

    def directed(self, along: np.ndarray, borders: np.ndarray) -> np.ndarray:
        """The tangent of a step from a unit vector (m,) and the borders of the condition; its curvature is not known."""
        return np.concatenate([along, np.zeros(along.size), borders])

    def step(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Step:
        """See `continuation.Problem`."""
        u, m = self.surface.size, y.size
        found = self.corrected(y, tangent, ds)
        if found is None:
            return Step.failed(y)
        new, at, held, along = found[:4]
        values, extra = self.monitor.values(at, new[u:], held, along, found.scale)
        if ds == 0.0:
            bent = np.zeros(m)
        elif abs(ds) < _SHORT:
            bent = tangent[m : 2 * m]
        else:
            bent = (along - tangent[:m]) / ds
        return Step(
            converged=True,
            y=new,
            tangent=np.concatenate([along, bent, held.borders]),
            position=(*self.surface.position(new[:u]).tolist(), *new[u:].tolist()),
            turn=found.turn,
            contraction=found.contraction,
            iterations=found.iterations,
            residual=found.residual,
            parameter=float(at.parameters[0]),
            slope=float(at.gradients[0] @ along[:u]),
            tests=list(values),
            extra=extra,
        )

    def corrected(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Corrected | None:
        """The point of a step; None where Newton's method fails."""
        u, m = self.surface.size, y.size
        along, borders = tangent[:m], tangent[2 * m :]
        scale = self.surface.scales(y[:u])
        sizes, metric = self._sizes(scale), self._directions(y)
        direction = metric @ along
        row = direction @ metric
        new = y + ds * (along + 0.5 * ds * tangent[m : 2 * m])
        right = np.zeros((m, 2))
        right[-1, 1] = 1.0
        last, contraction = math.inf, 0.0
        iteration = 0
        for iteration in range(1, ITERATIONS + 1):  # noqa: B007
            at = self.surface.linearised(new[:u])
            held = self.condition.held(at, new[u:], borders, scale)
            matrix = self._matrix(at, held)
            matrix[-1] = row
            right[: len(at.residual), 0], right[len(at.residual) : -1, 0] = at.residual, held.values
            right[-1, 0] = row @ (new - y) - ds
            _, _, solved, singular = dgesv(matrix * sizes, right)
            update = solved[:, 0]
            length = float(np.abs(update).max())
            if singular or not math.isfinite(length):
                return None
            settled = length <= SETTLED or (length <= ROUNDING and length > 0.25 * last)
            if not settled and last < math.inf and length > ROUNDING:
                contraction = max(contraction, length / last)
            new = new - update * sizes
            last = length
            if settled:
                break
        else:
            return None
        turned = solved[:, 1] * sizes
        way = self._directions(new) @ turned
        size = math.sqrt(float(way @ way))
        turn = float(direction @ way) / size
        if not math.isfinite(turn):
            return None
        at = self.surface.linearised(new[:u])
        worst = self.surface.worst(at)
        if not math.isfinite(worst):  # the last update left what the surface can have
            return None
        return Corrected(new, at, held, turned / size, scale, turn, contraction, iteration, worst)

    def classify(self, index: int, before: Point, at: Step, after: Point, location: Location) -> EventDetails | None:
        """See `continuation.Problem`."""
        return self.monitor.classify(index, before, at, after, location)

    def failure(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> str:
        """Where steps fail."""
        u = self.surface.size
        there = y[:u] + ds * tangent[:u]
        why = self.surface.violation(there)
        values = ", ".join(f"{value:.6g}" for value in self.surface.linearised(y[:u]).parameters)
        return f"at ({values})" + (f": {why}" if why else "")

    def residual(self, y: np.ndarray) -> np.ndarray:
        """See `continuation.Problem`: with borders of the point itself, the condition is zero up to its sign."""
        at, held = self._at(y)
        return np.concatenate([at.residual, held.values])

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """See `continuation.Problem`."""
        return self._matrix(*self._at(y))[:-1]

    def _at(self, y: np.ndarray) -> tuple[Linearised, Held]:
        u = self.surface.size
        scale = self.surface.scales(y[:u])
        at = self.surface.linearised(y[:u])
        return at, self.condition.held(at, y[u:], self.condition.first(at, y[u:], scale), scale)

    def _matrix(self, at: Linearised, held: Held) -> np.ndarray:
        """The derivatives of all equations, with a row to be filled behind them."""
        n, u, own = len(at.residual), self.surface.size, self.condition.own
        matrix = np.zeros((u + own, u + own))
        matrix[:n, :u] = at.jacobian
        matrix[n : n + 1 + own] = held.gradient
        return matrix

    def _sizes(self, scale: np.ndarray) -> np.ndarray:
        return np.concatenate([scale, np.ones(self.condition.own)]) if self.condition.own else scale

    def _directions(self, y: np.ndarray) -> np.ndarray:
        """Derivatives of the position by all unknowns; those of the condition are coordinates of their own."""
        u, own = self.surface.size, self.condition.own
        plain = self.surface.directions(y[:u])
        if not own:
            return plain
        whole = np.zeros((len(plain) + own, u + own))
        whole[: len(plain), :u] = plain
        whole[len(plain) :, u:] = np.eye(own)
        return whole
