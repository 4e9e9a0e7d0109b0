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
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs, dlange, zgecon, zgetrf, zgetrs, zlange

from bvp.checks import EPSILON

if TYPE_CHECKING:
    from bvp.forced import ForcedProblem

__all__ = ["NORMAL_FORMS", "CriticalOrbit", "Criticality", "NormalForms", "criticality", "normal_form"]

NORMAL_FORMS = ("SN", "PD", "SB", "NS")
"""Bifurcations with a coefficient."""

Kind = Literal["supercritical", "subcritical", "degenerate"]

_DIFFERENCES = 1e-6
"""Relative error of derivatives that come from differences."""

_ROUNDS = 8


class Criticality(NamedTuple):
    """The coefficient of a normal form, its estimated error, and what it means.

    Supercritical: what begins at the bifurcation is stable, if no other multiplier is outside the unit circle. Subcritical: it is unstable.
    Degenerate: the error decides the sign. None at SN."""

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
        For another code, and for an NS of an orbit without complex multipliers.
    """
    if code not in NORMAL_FORMS:
        raise ValueError(f"a normal form of SN, PD, SB or NS is known; received {code}")
    if code == "NS" and angle is None:
        angle = _angle(problem, y)
    wanted = complex(1.0) if code == "SN" else complex(-1.0) if angle is None or code != "NS" else cmath.exp(1j * angle)
    form = _NormalForm(NormalForms(problem), np.asarray(y, dtype=float))
    coefficient, error = form.coefficient(code, wanted)
    # The orbit is near the bifurcation: its own multiplier gives another coefficient.
    nearby, _ = form.coefficient(code, form.multiplier(wanted))
    error += abs(nearby - coefficient)
    if code == "SN":
        return Criticality(coefficient, error, None)
    stable = coefficient < 0.0 if code == "NS" else coefficient > 0.0
    return Criticality(coefficient, error, "degenerate" if not abs(coefficient) > error else "supercritical" if stable else "subcritical")


def normal_form(problem: ForcedProblem, y: np.ndarray, code: str, multiplier: complex) -> tuple[float, float]:
    """The coefficient that `criticality` gives, and its error, of an orbit whose critical multiplier is known."""
    return NormalForms(problem).coefficient(np.asarray(y, dtype=float), code, multiplier)


def _angle(problem: ForcedProblem, y: np.ndarray) -> float:
    """The angle of the complex multiplier nearest to the unit circle."""
    found = [value for value in problem.multipliers(y).tolist() if value.imag > 0.0]
    if not found:
        raise ValueError("the orbit has no complex multipliers; expected one at NS")
    return cmath.phase(min(found, key=lambda value: abs(math.log(abs(value)))))


class CriticalOrbit(NamedTuple):
    """What is known of an orbit with a critical multiplier lambda.

    jacobian (.., u): of the equations of the problem, or of the first ones, all but those of the user at least. scale (u,): sizes of the
    unknowns. right (u,), left (..): null vectors of the Jacobian at lambda, right in the unknowns' own units, left by its transpose.
    bend (.., u): F''(y)[right, .].
    """

    jacobian: np.ndarray
    scale: np.ndarray
    right: np.ndarray
    left: np.ndarray
    bend: np.ndarray


class NormalForms:
    """The normal forms of the orbits of a problem, many of them.

    Parameters
    ----------
    problem : ForcedProblem
    """

    def __init__(self, problem: ForcedProblem):
        self.problem = problem
        n, inner, width = problem.degrees_of_freedom, problem.inner, problem.size + 1
        state = np.arange(2 * n + 1)
        places = np.array([*state, problem.size])
        self.columns = np.concatenate([i * width + places for i in range(inner + 1)])
        last = inner * width
        self.rows = np.concatenate([*(i * width + places for i in range(inner)), last + np.arange(2 * n + 2)])
        self.places = self.rows[:, None] * problem.unknowns + self.columns
        self.feedback = np.zeros((len(self.rows), len(self.columns)))
        closing = len(self.rows) - (2 * n + 2) + state[: 2 * n + int(problem.has_clock)]
        self.feedback[closing, state[: len(closing)]] = [*[problem.segment.closing[0]] * (2 * n), 1.0][: len(closing)]
        self.metric = problem.segment.scale[: 2 * n + 1]

    def coefficient(self, y: np.ndarray, code: str, multiplier: complex, orbit: CriticalOrbit | None = None) -> tuple[float, float]:
        """The coefficient that `criticality` gives, and its error, of an orbit y (u,) whose critical multiplier is known."""
        return _NormalForm(self, y, orbit).coefficient(code, complex(multiplier))


class _NormalForm:
    """The linear equations of an orbit at given parameters, with scaled rows and columns."""

    def __init__(self, forms: NormalForms, y: np.ndarray, orbit: CriticalOrbit | None = None):
        self.forms, self.problem, self.y, self.orbit = forms, forms.problem, y, orbit
        jacobian = self.problem.jacobian(y) if orbit is None else orbit.jacobian
        scale = (self.problem.scales(y) if orbit is None else orbit.scale)[forms.columns]
        self.feedback = forms.feedback * scale
        self.matrix = jacobian.ravel()[forms.places] * scale + self.feedback
        self.level = 1.0 / np.max(np.abs(self.matrix) + np.abs(self.feedback), axis=1)
        self.matrix *= self.level[:, None]
        self.feedback *= self.level[:, None]
        self.scale = scale
        self.unit = scale[: len(forms.metric)] / forms.metric

    def transfer(self, multiplier: complex) -> np.ndarray:
        """T(lambda)."""
        found: np.ndarray = self.matrix - (multiplier.real if multiplier.imag == 0.0 else multiplier) * self.feedback
        return found

    def null(self, multiplier: complex) -> tuple[np.ndarray, np.ndarray]:
        """The vectors p and q."""
        if self.orbit is None:
            left, _, right = np.linalg.svd(self.transfer(multiplier))
            q, p = right[-1].conj(), left[:, -1]
        else:
            q = self.orbit.right[self.forms.columns] / self.scale
            p = self.orbit.left[self.forms.rows].conj() / self.level
        start = self.unit * q[: len(self.unit)]
        largest = start[np.argmax(np.abs(start))]
        q = q * (abs(largest) / largest / math.sqrt(np.vdot(start, start).real))
        return p / np.conj(np.vdot(p, self.feedback @ q)), q

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

    def bend(self, q: np.ndarray) -> np.ndarray:
        """B(q, .), to be applied to whole directions."""
        if self.orbit is not None:
            # The known null vector is a multiple of q.
            k = self.forms.columns[np.argmax(np.abs(q))]
            return self.orbit.bend[self.forms.rows] * (self.whole(q)[k] / self.orbit.right[k] * self.level[:, None])
        return self.problem.curvature.second_along(self.y, self.whole(q))[self.forms.rows] * self.level[:, None]

    def third(self, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """C(a, b, c)."""
        found = self.problem.curvature.third_of_states(self.y, self.whole(a), self.whole(b), self.whole(c))
        return self.level * found[self.forms.rows]

    def whole(self, vector: np.ndarray) -> np.ndarray:
        """A scaled vector as a direction of all unknowns; the parameters stay."""
        found = np.zeros(self.problem.unknowns, dtype=vector.dtype)
        found[self.forms.columns] = self.scale * vector
        return found

    def solve(self, multiplier: complex, right: np.ndarray) -> tuple[np.ndarray, float]:
        """The solution of T(lambda) h = right, as a whole direction, and an estimate of the matrix's condition."""
        matrix = self.transfer(multiplier)
        if np.iscomplexobj(matrix) or np.iscomplexobj(right):
            factorise, substitute, size, condition = zgetrf, zgetrs, zlange, zgecon
        else:
            factorise, substitute, size, condition = dgetrf, dgetrs, dlange, dgecon
        factor, pivots, singular = factorise(matrix)
        if singular:
            raise np.linalg.LinAlgError("the multiplier of a term of the normal form is one of the orbit")
        inverse, _ = condition(factor, size("1", matrix))
        return self.whole(substitute(factor, pivots, right)[0]), 1.0 / float(inverse) if inverse > 0.0 else math.inf

    def coefficient(self, code: str, multiplier: complex) -> tuple[float, float]:
        """The coefficient at a multiplier, and its error."""
        p, q = self.null(multiplier)
        level = EPSILON if self.problem.curvature.is_exact else _DIFFERENCES
        bend = self.bend(q)
        squared = bend @ self.whole(q)
        if code == "SN":
            return 0.5 * float(np.vdot(p, squared)), level * float(np.abs(p) @ np.abs(squared))
        if code != "NS":
            bent, condition = self.solve(multiplier * multiplier, -squared)
            terms = [self.third(q, q, q) / 6.0, 0.5 * (bend @ bent)]
            turned: complex = 1.0
            conditions = [1.0, condition]
        else:
            conjugate = q.conj()
            first, of_first = self.solve(complex(abs(multiplier) ** 2), -(bend @ self.whole(conjugate)))
            other, of_other = self.solve(multiplier * multiplier, -squared)
            terms = [0.5 * self.third(q, q, conjugate), bend @ first, 0.5 * (bend.conj() @ other)]
            turned = multiplier.conjugate() / abs(multiplier)
            conditions = [1.0, of_first, of_other]
        sizes = [condition * float(np.abs(p) @ np.abs(term)) for condition, term in zip(conditions, terms, strict=True)]
        return sum(float((turned * np.vdot(p, term)).real) for term in terms), level * sum(sizes)
