"""Normal-form coefficients of bifurcations of forced orbits: whether what begins there is stable.

They are those of the map from one period, or half of one, to the next, of the node where the segment starts, z_0 = (u, v, s). With impacts
this is the map from the state after the first impact to the state after its repetition, without impacts the map at phase 0. The map is not
formed. With F(y) = G(y) - E y, where E takes z_0 to the closing equations, an orbit of the map is a sequence with G(y_i) = E y_(i+1).
So y_i = y + zeta_i q + zeta_i^2 h/2 + ... is an orbit where zeta_(i+1) = f(zeta_i) is the normal form, and each power of zeta gives a
linear equation with the matrix T(lambda) = G' - lambda E.

References
----------
Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, Springer (3rd ed., 2004), sections 4 and 5.4.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from bvp.checks import EPSILON
from bvp.kernels.normal_form import StateEquations, cubic_coefficient, set_equations

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem

__all__ = ["NORMAL_FORMS", "Criticality", "NormalForms", "criticality"]

NORMAL_FORMS = ("SN", "PD", "SB", "NS")
"""Bifurcations with a coefficient."""

Kind = Literal["supercritical", "subcritical", "degenerate"]

_DIFFERENCES = 1e-6
"""Relative error of derivatives that come from differences."""

_ROUNDS = 8
_CONDITION = 1e3
"""How many roundings the null vectors are known to."""

_SEVERAL = math.sqrt(_CONDITION * EPSILON)
"""Largest singular value, beside the largest of all, that is zero: a fold of several parts at once is located to the root of rounding."""


def shaken(vector: np.ndarray, level: float) -> np.ndarray:
    """A null vector with errors of a level, beside its largest entry, in all its entries: also in those that a symmetry or a linear flight
    makes zero, whose products would otherwise show no error. What a coefficient changes by is its error."""
    found: np.ndarray = vector + level * float(np.abs(vector).max()) * np.cos(np.arange(1.0, len(vector) + 1.0))
    return found


class Criticality(NamedTuple):
    """The coefficient of a normal form, its estimated error, and what it means.

    Supercritical: what begins at the bifurcation is stable, if no other multiplier is outside the unit circle. Subcritical: it is unstable.
    Degenerate: the error decides the sign; at SN no digit is known, as at a 1:1 resonance. None at other SN."""

    coefficient: float
    error: float
    kind: Kind | None


def criticality(problem: ForcedProblem, y: np.ndarray, code: str, angle: float | None = None) -> Criticality:
    """The normal-form coefficient of an orbit at a bifurcation.

    T(lambda) has the null vector q. Its start (u, v, s) has unit length in the metric of the family, and its largest entry there is
    positive. The transpose has the null vector p, with p . E q = 1. With the second and third derivatives B and C of the equations the
    coefficients are

        SN  zeta + a zeta^2:                 a = p . B(q, q)/2
        PD, SB  -zeta + c zeta^3:            c = p . (C(q, q, q) + 3 B(q, h))/6,  T(1) h = -B(q, q)
        NS  zeta (e^(i angle) + d |zeta|^2): Re(e^(-i angle) d),  d = p . (C(q, q, q*) + 2 B(q, h) + B(q*, g))/2,
                                             T(1) h = -B(q, q*),  T(e^(2 i angle)) g = -B(q, q)

    The sign, besides that of a, does not depend on the metric or on the start. With c > 0 the orbits of PD and SB are supercritical, with
    Re(e^(-i angle) d) < 0 the torus of NS is.

    Parameters
    ----------
    problem : ForcedProblem
        Of a full period, or of half of one, where a multiplier -1 of the half map is SB.
    y : ndarray (u,)
        The orbit at the bifurcation.
    code : str
        SN, PD, SB or NS.
    angle : float, optional
        That of the multiplier of NS, in (0, pi); by default that of the complex multiplier nearest to the unit circle.

    Raises
    ------
    ValueError
        For another code, for an NS of an orbit without complex multipliers, and where several multipliers are at one place.
    """
    if code not in NORMAL_FORMS:
        raise ValueError(f"a normal form of SN, PD, SB or NS is known; received {code}")
    if code == "NS" and angle is None:
        angle = _angle(problem, y)
    wanted = complex(1.0) if code == "SN" else complex(-1.0) if angle is None or code != "NS" else cmath.exp(1j * angle)
    equations = _OrbitEquations(problem, np.asarray(y, dtype=float))
    if problem.has_clock and equations.has_several(wanted):
        raise ValueError("several multipliers are there: the normal form has a coefficient of each product of their directions")
    coefficient, error = equations.coefficient(code, wanted)
    # The orbit is near the bifurcation: its own multiplier gives another coefficient.
    nearby, _ = equations.coefficient(code, equations.multiplier(wanted))
    error += abs(nearby - coefficient)
    if code == "SN":
        return Criticality(coefficient, error, None if abs(coefficient) > 2.0 * error else "degenerate")
    stable = coefficient < 0.0 if code == "NS" else coefficient > 0.0
    return Criticality(coefficient, error, "degenerate" if not abs(coefficient) > error else "supercritical" if stable else "subcritical")


def _angle(problem: ForcedProblem, y: np.ndarray) -> float:
    """The angle of the complex multiplier nearest to the unit circle."""
    found = [value for value in problem.multipliers(y).tolist() if value.imag > 0.0]
    if not found:
        raise ValueError("the orbit has no complex multipliers; expected one at NS")
    return cmath.phase(min(found, key=lambda value: abs(math.log(abs(value)))))


class NormalForms:
    """The normal forms of orbits of a problem.

    The equations are those of an orbit that is open: the clock at its end is one more unknown, behind all others, with an equation of its
    own (`bvp.curvature.Curvature`). So E is constant. Null vectors are those of all these equations and unknowns.

    Parameters
    ----------
    problem : ForcedProblem
    """

    def __init__(self, problem: ForcedProblem):
        self.problem = problem
        n, nodes, clock = problem.degrees_of_freedom, (problem.inner + 1) * (problem.size + 1), int(problem.has_clock)
        columns, rows = np.arange(nodes + clock), np.arange(nodes + clock)
        columns[nodes:], rows[nodes:] = problem.unknowns, problem.unknowns - 1
        size, state = nodes + clock, np.arange(2 * n)
        feedback = np.zeros((size, size))
        feedback[nodes - 2 * n - 1 + state, 1 + state] = problem.closing[0]
        if clock:
            feedback[nodes, 0] = 1.0
        # Without a clock the first unknown is a duration, which has no part in the start.
        metric = np.array([problem.units[2 * n] if clock else math.inf, *problem.units[: 2 * n]])
        self.equations = StateEquations(
            rows, columns, feedback, metric, np.zeros((size, size)), np.zeros((size, size)),
            np.zeros(size), np.zeros(size), np.zeros((size, size), complex), np.zeros((9, size), complex), np.zeros(size, np.int64),
        )  # fmt: skip

    @property
    def rounding(self) -> float:
        """Relative error of null vectors, and of the derivatives along them."""
        return _CONDITION * EPSILON if self.problem.curvature.is_exact else _DIFFERENCES

    def set(self, y: np.ndarray) -> None:
        """Write the equations of an orbit."""
        curvature = self.problem.curvature
        set_equations(self.equations, curvature.open_jacobian(y), curvature.opened(self.problem.scales(y), 1.0))

    def cubic(self, y: np.ndarray, right: np.ndarray, left: np.ndarray, code: str, multiplier: complex) -> tuple[float, float]:
        """The coefficient of PD, SB or NS of an orbit, and its error. right, left: null vectors at the multiplier, in the unknowns' own
        units and by the transpose."""
        self.set(y)
        value, error = self._cubic(y, right, left, code, multiplier)
        scale = self.problem.curvature.opened(self.problem.scales(y), 1.0)
        scale = np.where(scale > 0.0, scale, 1.0)
        moved = self._cubic(y, shaken(right / scale, self.rounding) * scale, shaken(left, self.rounding), code, multiplier)
        return value, error + abs(moved[0] - value)

    def cubic_of_pencil(self, y: np.ndarray, right: np.ndarray, left: np.ndarray, code: str, multiplier: complex) -> tuple[float, float]:
        """The same from null vectors of the equations of a closed orbit, in which what closes it is multiplied by the multiplier."""
        if self.problem.has_clock:
            slope = self.problem.curvature.open_jacobian(y)[:-1, -1]
            right, left = np.append(right, multiplier * right[0]), np.append(left[: len(slope)], -(slope[: len(left)] @ left[: len(slope)]))
        return self.cubic(y, right, left, code, multiplier)

    def _cubic(self, y: np.ndarray, right: np.ndarray, left: np.ndarray, code: str, multiplier: complex) -> tuple[float, float]:
        """The coefficient, and its error by rounding of the terms, for the equations that are set."""
        curvature = self.problem.curvature
        bend = curvature.open_second(y, right)
        cubic = curvature.open_third(y, right, right, right.conj() if code == "NS" else right)
        arrays = [np.asarray(array, dtype=complex) for array in (right, left, bend, cubic)]
        value, size = cubic_coefficient(self.equations, *arrays, multiplier.real, multiplier.imag, code == "NS")
        return value, size * (EPSILON if curvature.is_exact else _DIFFERENCES)


class _OrbitEquations:
    """The linear equations of an orbit at given parameters, with scaled rows and columns."""

    def __init__(self, problem: ForcedProblem, y: np.ndarray):
        self.forms, self.problem, self.y = NormalForms(problem), problem, y
        self.equations = self.forms.equations
        self.forms.set(y)

    def transfer(self, multiplier: complex) -> np.ndarray:
        """T(lambda)."""
        found: np.ndarray = self.equations.matrix - multiplier * self.equations.feedback
        return found.real if multiplier.imag == 0.0 else found

    def has_several(self, multiplier: complex) -> bool:
        """Whether T(lambda) has several null vectors; a 1:1 resonance has one, a large multiplier makes others small."""
        left, values, right = np.linalg.svd(self.transfer(multiplier))
        feedback = left[:, -2:].conj().T @ self.equations.feedback @ right[-2:].conj().T
        return bool(values[-2] < min(_SEVERAL * values[0], 1e-3 * np.linalg.norm(feedback, -2)))

    def null(self, multiplier: complex) -> tuple[np.ndarray, np.ndarray]:
        """The vectors p and q."""
        left, _, right = np.linalg.svd(self.transfer(multiplier))
        q, p = right[-1].conj(), left[:, -1]
        metric = self.equations.metric
        start = self.equations.scale[: len(metric)] / metric * q[: len(metric)]
        largest = start[np.argmax(np.abs(start))]
        q = q * (abs(largest) / largest / np.linalg.norm(start))
        return p / np.conj(np.vdot(p, self.equations.feedback @ q)), q

    def multiplier(self, near: complex) -> complex:
        """The multiplier of the orbit near a number, by Newton's method with null vectors."""
        found = near
        for _ in range(_ROUNDS):
            p, q = self.null(found)
            change = complex(np.vdot(p, self.transfer(found) @ q))
            found += change if near.imag else change.real
            if abs(change) < 4.0 * EPSILON:
                break
        return found

    def coefficient(self, code: str, multiplier: complex) -> tuple[float, float]:
        """The coefficient at a multiplier, and its error."""
        p, q = self.null(multiplier)
        equations, curvature = self.equations, self.problem.curvature
        right = np.zeros(self.problem.unknowns + self.problem.has_clock, q.dtype)
        left = np.zeros(self.problem.unknowns - 1 + self.problem.has_clock, p.dtype)
        right[equations.columns], left[equations.rows] = equations.scale * q, equations.level * p.conj()
        if code != "SN":
            return self.forms.cubic(self.y, right, left, code, multiplier)
        squared = equations.level * (curvature.open_second(self.y, right) @ right)[equations.rows]
        level = EPSILON if curvature.is_exact else _DIFFERENCES
        value = 0.5 * float(np.vdot(p, squared))
        right[equations.columns] = equations.scale * shaken(q, self.forms.rounding)
        moved = equations.level * (curvature.open_second(self.y, right) @ right)[equations.rows]
        other = 0.5 * float(np.vdot(shaken(p, self.forms.rounding), moved))
        return value, level * float(np.abs(p) @ np.abs(squared)) + abs(other - value)
