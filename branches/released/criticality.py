"""Whether what begins at a bifurcation of free orbits is stable, and how its energy changes: docs/theory.md, section 21.

The orbit is solved over the segment of the orbits that begin there. There the event is a branch point of equations whose second and third
derivatives are exact, and the reduced equation of Lyapunov and Schmidt follows from these.

References
----------
K. R. Meyer, Trans. AMS 149 (1970) 95. A. Vanderbauwhede, SIAM J. Math. Anal. 21 (1990) 954.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from branches.events import FREE_NORMAL_FORMS
from branches.orbit import Orbit
from branches.presentation import canonical_orbit, is_solved_as_it_is
from branches.released.presentation import embedded_orbit, released_orbit
from bvp.checks import EPSILON, InvalidSystem
from bvp.closures import EndsError, cycle_of
from bvp.criticality import Criticality, shaken
from bvp.multipliers import floquet_multipliers
from bvp.multipoint import MultipointProblem, Solution
from bvp.orbits import RESULT_INDEX
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.stability import half_map_of
from bvp.system import ImpactSystem

__all__ = ["CriticalEquations", "critical_nu", "free_criticality", "free_criticality_of", "reduced_equation"]

_SINGULAR = 1e-5
"""A matrix is singular at a located event where its smallest singular value is below this part of the next one."""

_ITERATIONS = 3
"""Of the null vectors: an error is multiplied by the square of `_SINGULAR` by each."""

_SYMMETRIC = 1e-5
"""Largest part of a term that a symmetry excludes."""

_ZERO = 1e-10
"""A second derivative by the unknowns in their own units that is rounding."""

_STEP = 1e-2
"""Largest step of differences of the forces, in units of the displacements."""

_DIFFERENCES = 1e-6
"""Relative error of derivatives that come from differences."""

_BESIDE = 1e-5
"""Distance along the family, in units of the unknowns, over which the change of a multiplier is measured."""

_REAL = 1e-3
"""Largest imaginary part of a number that is real but for rounding."""

_ALIKE = 1e-2
"""Distance of the trace of a pair from 2 below which its half-period trace is near 2 or -2."""

_AGREED = 0.1
"""Largest relative difference of that change over twice the distance."""


class Reduced(NamedTuple):
    """Along the family that begins, the parameter is that of the event plus coefficient x^2; error: of the coefficient."""

    coefficient: float
    error: float


class _Parent(NamedTuple):
    """The orbit at the event, between its own reversals: in the unknowns of its family, and as an orbit of the system there."""

    problem: ReleasedProblem
    y: np.ndarray
    plain: MultipointProblem
    at: np.ndarray


def free_criticality(orbit: Orbit, code: str) -> Criticality | None:
    """Whether what begins at an event of a family in the energy is stable.

    Parameters
    ----------
    orbit : Orbit
        At the event, such as ``branch.orbit(event.point)``.
    code : {"SN", "SB", "PD"}

    Returns
    -------
    Criticality or None
        The coefficient a: the energy is h + a x^2 + ... along the fold, or along the orbits that begin at SB and PD. x is the distance from
        the orbit at the event in the metric of the family, at the start of the segment over which those orbits are solved. At a PD of an
        orbit that is solved as a quarter two families begin, and the coefficient is that of the one that reverses about the start.
        Supercritical: a stable family begins, if no other multiplier leaves the unit circle. Subcritical: none is stable. None where the
        orbit has no such bifurcation, or its equations cannot be reduced.

    Raises
    ------
    ValueError
        For another code.
    """
    if code not in FREE_NORMAL_FORMS:
        raise ValueError(f"a normal form of {', '.join(FREE_NORMAL_FORMS)} is known; received {code}")
    try:
        problem = _problem_of(orbit.problem)
    except (EndsError, InvalidSystem, RuntimeError):
        return None
    return free_criticality_of(problem, problem.of_orbit(orbit.problem, orbit.solution.y), code)


def free_criticality_of(problem: ReleasedProblem, y: np.ndarray, code: str) -> Criticality | None:
    """The same for an event of a family in a parameter.

    Parameters
    ----------
    problem : ReleasedProblem
        Its first released parameter takes the place of the energy. Without released parameters the family is one in the energy.
    y : (u,) ndarray
        The orbit at the event.
    code : {"SN", "SB", "PD"}
    """
    if code not in FREE_NORMAL_FORMS:
        raise ValueError(f"a normal form of {', '.join(FREE_NORMAL_FORMS)} is known; received {code}")
    try:
        return _criticality(problem, y, code)
    except (EndsError, InvalidSystem, RuntimeError, np.linalg.LinAlgError):
        return None


def _criticality(problem: ReleasedProblem, y: np.ndarray, code: str) -> Criticality | None:
    if code == "SN":
        found = reduced_equation(problem, y, fold=True)
        return None if found is None else Criticality(found.coefficient, found.error, None)
    plain, at = problem.orbit_problem(y)
    if not is_solved_as_it_is(plain, at):
        plain, at = canonical_orbit(plain, at)
        problem, y = released_orbit(problem, problem.parameters(y), plain, at)
    parent = _Parent(problem, y, plain, at)
    if plain.quarters == 1 and code == "PD":
        return _both_doublings(parent)
    for window, level in _windows(plain, code):
        matrix = _embedded(parent, window)
        if matrix.is_singular:
            found, side = _breaking(matrix), _unstable_side(parent, level)
            return (
                None if found is None or side == 0 else _named(found, found.coefficient * side > 0.0, abs(found.coefficient) > found.error)
            )
    return None


def _named(found: Reduced, stable: bool, known: bool) -> Criticality:
    return Criticality(found.coefficient, found.error, "degenerate" if not known else "supercritical" if stable else "subcritical")


def _both_doublings(parent: _Parent) -> Criticality | None:
    """At a double period the half map turns its plane by a quarter: the multiplier -1 of the full period does not leave the circle. Two
    families begin. On one side of the event one of them is stable, and on different sides none is."""
    both = []
    for window in ((0, 4), (1, 5)):
        matrix = _embedded(parent, window)
        found = _breaking(matrix) if matrix.is_singular else None
        if found is None:
            return None
        both.append(found)
    first, second = both
    return _named(first, first.coefficient * second.coefficient > 0.0, all(abs(one.coefficient) > one.error for one in both))


def reduced_equation(problem: ReleasedProblem, y: np.ndarray, fold: bool = False) -> Reduced | None:
    """The coefficient of what begins at a branch point at which a symmetry breaks, or of a fold.

    Parameters
    ----------
    problem : ReleasedProblem
        Of the orbits that begin, with the event as an orbit that has more symmetry.
    y : (u,) ndarray
    fold : bool
    """
    matrix = CriticalEquations(problem, y)
    if not matrix.is_singular:
        return None
    return matrix.fold() if fold else _breaking(matrix)


def _windows(plain: MultipointProblem, code: str) -> Sequence[tuple[tuple[int, int] | int, int]]:
    """Over what the orbits that begin are solved, and the nu of the critical pair (`bvp.stability`)."""
    if plain.periodic:
        return [(2, -1)] if code == "PD" else []
    half: list[tuple[tuple[int, int] | int, int]] = [((0, 2), -1), ((1, 3), -1)]
    if code == "PD":
        return half
    return [*half, (1, 0)] if plain.quarters == 1 else [(1, 0)]


def _problem_of(plain: MultipointProblem) -> ReleasedProblem:
    """The problem of a family in the energy."""
    system = plain.system
    if system.smooth_forces is None:  # given by numbers, so that no expressions are loaded
        system = ImpactSystem(system.mass, system.damping, system.stiffness, system.stops)
    return ReleasedProblem(ParametricSystem.of(system), plain.ends, plain.sequence, (), ())


def _embedded(parent: _Parent, window: tuple[int, int] | int) -> CriticalEquations:
    """The equations of the orbit over a window of its time."""
    problem, y = embedded_orbit(parent.problem, parent.problem.parameters(parent.y), parent.plain, parent.at, window)
    return CriticalEquations(problem, y)


class CriticalEquations:
    """The equations at an orbit, with the parameter of the family fixed in a last row. Columns are in units of the unknowns, and rows have
    length 1. A ValueError for closed orbits without impacts: lengths at the start of their family are not known."""

    def __init__(self, problem: ReleasedProblem, y: np.ndarray):
        if problem.starts_rising:
            raise EndsError("closed orbits without impacts start at another instant here than their family in the energy")
        self.problem, self.y = problem, y
        jacobian, scale = problem.jacobian(y), problem.scales(y)
        self.scale = np.where(scale > 0.0, scale, 1.0)
        self.n = problem.degrees_of_freedom
        last = np.zeros((1, problem.unknowns))
        if problem.released:
            last[0, problem.place] = 1.0
        else:
            gradient, self.energy = _energy_slopes(problem, problem.states(y)[0])
            problem.states(last[0])[0] = gradient
        matrix = np.vstack([jacobian, last]) * self.scale
        lengths = np.linalg.norm(matrix, axis=1)
        self.level = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
        self.matrix = matrix * self.level[:, None]
        self.left, self.right, least = _null_vectors(self.matrix)
        size = len(self.matrix)
        bordered = np.zeros((size + 1, size + 1))
        bordered[:size, :size], bordered[:size, size], bordered[size, :size] = self.matrix, self.left, self.right
        self._inverse = np.linalg.inv(bordered)
        # Without the null vectors the matrix is as regular as the bordered one.
        norm, of_inverse = (float(np.linalg.norm(part, 1)) for part in (bordered, self._inverse))
        self.is_singular = least < _SINGULAR / of_inverse
        self.condition = norm * of_inverse
        self.v = self.scale * self.right / self._length(self.scale * self.right)

    def _length(self, v: np.ndarray) -> float:
        """The length of a direction at the start of the segment, in the metric of the family in the energy, at fixed energy."""
        system, n = self.problem.system, self.n
        start = self.problem.states(self.y)[0]
        twice = 2.0 * float(system.energy(start[:n], start[n:]))
        state = system.modes.from_state @ self.problem.states(v)[0]
        time, change = float(np.sum(self.problem.flight_times(self.y))), float(np.sum(self.problem.flight_times(v)))
        return math.sqrt(float(state @ state) / twice + (change / time) ** 2)

    @property
    def rounding(self) -> float:
        """The relative error of the derivatives that were computed."""
        return EPSILON * self.condition if self.problem.curvature.is_exact else _DIFFERENCES

    @cached_property
    def bend(self) -> np.ndarray:
        """The second derivative along the null vector, with the last row, (u, u), in scaled rows."""
        return self._bend(self.v)

    def _bend(self, v: np.ndarray) -> np.ndarray:
        """The same along a direction."""
        found = np.zeros((len(v), len(v)))
        found[:-1] = self.problem.curvature.second_along(self.y, v)
        if not self.problem.released:
            self.problem.states(found[-1])[0] = self.energy @ self.problem.states(v)[0]
        return found * self.level[:, None]

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The solution without part along the null vector, up to the part of the right side that has none."""
        found: np.ndarray = self._inverse[:-1, :-1] @ right
        return self.scale * found

    def _shaken(self) -> tuple[np.ndarray, np.ndarray]:
        """The null vectors as far as they are known: see `bvp.criticality.shaken`."""
        return shaken(self.left, self.rounding), shaken(self.v / self.scale, self.rounding) * self.scale

    def fold(self) -> Reduced:
        """p = p_0 + a x^2 along the family."""
        squared = self.bend @ self.v
        last = float(self.left[-1] * self.level[-1])
        value = 0.5 * float(self.left @ squared)
        left, v = self._shaken()
        error = self.rounding * float(np.abs(self.left) @ np.abs(squared)) + abs(0.5 * float(left @ self._bend(v) @ v) - value)
        return Reduced(value / last, error / abs(last))

    def cubic(self) -> Reduced | None:
        """W F'''[V, V, V]/6 + W F''[V, H]/2 with B H = -F''[V, V]; None where W F''[V, V] is not zero."""
        left, v, bend = self.left, self.v, self.bend
        squared = bend @ v
        size = float(np.abs(left) @ np.abs(bend) @ np.abs(v))
        shortest = float(np.linalg.norm(v / self.scale))
        if abs(float(left @ squared)) > _SYMMETRIC * size + _ZERO * shortest**2:
            return None
        cubed, bent = self._cubic_terms(bend, v)
        value = float(left @ (cubed + 0.5 * (bend @ bent)))
        error = self.rounding * float(np.abs(left) @ (np.abs(cubed) + np.abs(bend) @ np.abs(bent)))
        left, v = self._shaken()
        bend = self._bend(v)
        cubed, bent = self._cubic_terms(bend, v)
        return Reduced(value, error + abs(float(left @ (cubed + 0.5 * (bend @ bent))) - value))

    def _cubic_terms(self, bend: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The term of third derivatives along V, over 6, and H."""
        cubed = np.append(self.problem.curvature.third(self.y, v, v, v), 0.0) * self.level
        return cubed / 6.0, self.solve(-(bend @ v))

    def slope(self, way: np.ndarray) -> tuple[float, float]:
        """W F''[V, .] along a direction in which the orbits keep their symmetry, and its error."""
        left, bend = self.left, self.bend
        return float(left @ bend @ way), self.rounding * float(np.abs(left) @ np.abs(bend) @ np.abs(way))


def _null_vectors(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The singular vectors of the smallest singular value of a matrix that is nearly singular, left and right, and this value: by inverse
    iteration, which takes a tenth of the time of all singular values. The inverse is hardly more than the product of these vectors."""
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:  # a pivot is zero
        vectors, values, rows = np.linalg.svd(matrix)
        return vectors[:, -1], rows[-1], float(values[-1])
    left, size = np.cos(np.arange(1.0, len(matrix) + 1.0)), 1.0
    for _ in range(_ITERATIONS):
        right = inverse @ left
        left = inverse.T @ (right / math.sqrt(float(right @ right)))
        size = math.sqrt(float(left @ left))
        left = left / size
    return left, right / math.sqrt(float(right @ right)), 1.0 / size


def _energy_slopes(problem: ReleasedProblem, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first and second derivatives of H at a state, (2 n,) and (2 n, 2 n); with forces that are Python functions from differences."""
    system, n = problem.system, problem.degrees_of_freedom
    second = np.zeros((2 * n, 2 * n))
    second[:n, :n], second[n:, n:] = system.stiffness, system.mass
    first = second @ state
    smooth = system.smooth_forces
    if smooth is not None:
        if smooth.is_called:
            slopes = smooth.acting(state[:n], np.zeros(n))
            bends = _differences(lambda u: smooth.acting(u, np.zeros(n)), state[:n])
        else:
            slopes, bends = smooth.energy_slopes(state[:n])
        first[:n] += slopes
        second[:n, :n] += bends
    return first, second


def _differences(function: Callable[[np.ndarray], np.ndarray], u: np.ndarray) -> np.ndarray:
    """The derivatives of a function, (n, n), from differences with two steps."""
    steps = _STEP * (float(np.max(np.abs(u))) or 1.0) * np.array([1.0, 0.5])
    first, second = (np.array([function(u + way) - function(u - way) for way in step * np.eye(len(u))]) / (2.0 * step) for step in steps)
    return np.asarray((4.0 * second - first) / 3.0)


def _breaking(matrix: CriticalEquations) -> Reduced | None:
    """a = -(W F'''[V, V, V]/6 + W F''[V, H]/2) / (W F''[V, y'])."""
    found = matrix.cubic()
    if found is None or abs(matrix.left[-1]) > _SYMMETRIC:
        return None
    forced = np.zeros(len(matrix.left))
    forced[-1] = matrix.level[-1]
    slope, slope_error = matrix.slope(matrix.solve(forced))
    if not abs(slope) > slope_error:
        return None
    coefficient = -found.coefficient / slope
    return Reduced(coefficient, (found.error + abs(coefficient) * slope_error) / abs(slope))


def _unstable_side(parent: _Parent, level: int) -> int:
    """On which side of the event the critical pair of the parent is off the unit circle: 1 above it in the parameter, -1 below, 0 not
    known."""
    problem, y = parent.problem, parent.y
    scale = problem.scales(y)
    scale = np.where(scale > 0.0, scale, 1.0)
    way = np.linalg.svd(problem.jacobian(y) * scale)[2][-1] * scale
    changes = []
    for part in (_BESIDE, 2.0 * _BESIDE):
        (ahead, above), (behind, below) = (critical_nu(problem, y + sign * part * way, level) for sign in (1.0, -1.0))
        if above == below:
            return 0
        changes.append((ahead - behind) / (above - below))
    first, second = changes
    if not (math.isfinite(first) and abs(first - second) < _AGREED * abs(first)):
        return 0
    return int(math.copysign(1.0, first)) * (1 if level == 0 else -1)


def critical_nu(problem: ReleasedProblem, y: np.ndarray, level: int) -> tuple[float, float]:
    """The distance from a level of the nu nearest to it, NaN where that is no real pair; and the parameter. The orbit is beside an event at
    this level."""
    if problem.released:
        parameter = float(y[problem.place])
        plain, at = problem.orbit_problem(y)
    else:
        plain = problem.structure
        states = problem.states(y) @ plain.modes.from_state.T
        at = plain.pack(states[0], states[1:], problem.flight_times(y))
        parameter = float(plain.energy(at))
    if plain.periodic:
        values = floquet_multipliers(cycle_of(plain, at)).values
        apart = (values + 1.0 / values - 2.0) / 4.0 - level
    else:
        solution = Solution(at, np.zeros(2 * at.size), np.zeros(0), plain.end_states(at), np.full(len(RESULT_INDEX), math.nan))
        phi, m = half_map_of(plain, solution)[0], plain.pairs
        apart = np.linalg.eigvals(phi[:m, m:].T @ phi[m:, :m] if level == 0 else phi[m:, m:].T @ phi[:m, :m])
    return _real(apart[int(np.argmin(np.abs(apart)))]), parameter


def _real(value: complex) -> float:
    return float(value.real) if abs(value.imag) <= _REAL * abs(value) else math.nan
