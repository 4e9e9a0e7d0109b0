"""Cubic coefficients of normal forms: dense algebra of `bvp.criticality`."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.linear import factorise, inverse_norm, norm_1, substitute


class StateEquations(NamedTuple):
    """The m equations of an orbit by its states, phases and times, with scaled rows and columns."""

    rows: np.ndarray  # (m,) int64 among all equations
    columns: np.ndarray  # (m,) int64 among all unknowns
    closing: np.ndarray  # (m, m) E, which takes the first node to the equations that close the orbit
    metric: np.ndarray  # (2 n + 1,) units of arclength of the first node
    matrix: np.ndarray  # (m, m) G'
    feedback: np.ndarray  # (m, m) E, scaled
    level: np.ndarray  # (m,) what each row is multiplied by
    scale: np.ndarray  # (m,) sizes of the unknowns
    work: np.ndarray  # (m, m) complex scratch
    lines: np.ndarray  # (9, m) complex scratch
    pivots: np.ndarray  # (m,) int64 scratch


@kernel
def set_equations(equations, jacobian, scale):
    """Write matrix, feedback, level and scale for the Jacobian of all equations (.., u), and the sizes of all unknowns (u,)."""
    rows, columns, closing = equations.rows, equations.columns, equations.closing
    matrix, feedback, level = equations.matrix, equations.feedback, equations.level
    size = rows.shape[0]
    for c in range(size):
        equations.scale[c] = scale[columns[c]]
    for r in range(size):
        largest = 0.0
        for c in range(size):
            feedback[r, c] = closing[r, c] * equations.scale[c]
            matrix[r, c] = jacobian[rows[r], columns[c]] * equations.scale[c] + feedback[r, c]
            largest = max(largest, abs(matrix[r, c]) + abs(feedback[r, c]))
        level[r] = 1.0 / largest
        for c in range(size):
            matrix[r, c] *= level[r]
            feedback[r, c] *= level[r]


@inlined
def _normalise(equations, right, left, q, p):
    """q and p: the null vectors, with the lengths that `bvp.criticality.criticality` gives them. Returns q over right."""
    scale, feedback = equations.scale, equations.feedback
    size = scale.shape[0]
    factor = complex(0.0, 0.0)
    largest = 0.0
    total = 0.0
    for r in range(size):
        q[r] = right[equations.columns[r]] / scale[r]
        p[r] = left[equations.rows[r]].conjugate() / equations.level[r]
        if r < equations.metric.shape[0]:
            entry = q[r] * scale[r] / equations.metric[r]
            total += abs(entry) * abs(entry)
            if abs(entry) > largest:
                largest = abs(entry)
                factor = abs(entry) / entry
    factor /= math.sqrt(total)
    for r in range(size):
        q[r] *= factor
    through = complex(0.0, 0.0)
    for r in range(size):
        for c in range(size):
            through += p[r].conjugate() * feedback[r, c] * q[c]
    for r in range(size):
        p[r] /= through.conjugate()
    return factor


@inlined
def _bend(equations, bend, factor, conjugate, x, out):
    """out = B(q, x), or B(q*, x); bend (.., u): the second derivative along the null vector that q is `factor` times."""
    for r in range(out.shape[0]):
        total = complex(0.0, 0.0)
        for c in range(x.shape[0]):
            slope = factor * bend[equations.rows[r], equations.columns[c]]
            total += (slope.conjugate() if conjugate else slope) * equations.scale[c] * x[c]
        out[r] = equations.level[r] * total


@inlined
def _solve(equations, multiplier, x):
    """x = T(multiplier)^-1 x. Returns the condition of T; infinite where it is singular."""
    work, pivots, size = equations.work, equations.pivots, x.shape[0]
    for r in range(size):
        for c in range(size):
            work[r, c] = equations.matrix[r, c] - multiplier * equations.feedback[r, c]
    norm = norm_1(work)
    if factorise(work, pivots) == 0.0:
        return math.inf
    substitute(work, pivots, x)
    return norm * inverse_norm(work, pivots, equations.lines[7:9])


@inlined
def _project(p, term, weight, turned):
    """Re(turned p . term) times a weight, and the sum of the moduli in it."""
    total = complex(0.0, 0.0)
    size = 0.0
    for r in range(p.shape[0]):
        total += p[r].conjugate() * term[r]
        size += abs(p[r]) * abs(term[r])
    return weight * (turned * total).real, weight * size


@kernel
def cubic_coefficient(equations, right, left, bend, cubic, real, imaginary, is_pair):
    """The coefficient of PD and SB, or of NS, and the size of its error in units of rounding.

    right (u,), left (..): null vectors, in the unknowns' own units and by the transpose. bend (.., u): the second derivative of the
    equations along `right`. cubic (u - 1,): the third one along it three times, of NS the last time its conjugate. All are complex.
    real, imaginary: of the multiplier."""
    multiplier = complex(real, imaginary)
    lines, size = equations.lines, equations.scale.shape[0]
    q, p, squared, first, term, other = lines[0], lines[1], lines[2], lines[3], lines[4], lines[5]
    factor = _normalise(equations, right, left, q, p)
    turned = multiplier.conjugate() / abs(multiplier) if is_pair else complex(1.0, 0.0)
    cube = factor * factor * factor.conjugate() if is_pair else factor * factor * factor
    for r in range(size):
        term[r] = equations.level[r] * cubic[equations.rows[r]] * cube
    value, error = _project(p, term, 0.5 if is_pair else 1.0 / 6.0, turned)
    _bend(equations, bend, factor, False, q, squared)
    if is_pair:
        for r in range(size):
            other[r] = q[r].conjugate()
        _bend(equations, bend, factor, False, other, first)
        for r in range(size):
            first[r] = -first[r]
        condition = _solve(equations, complex(abs(multiplier) ** 2, 0.0), first)
        _bend(equations, bend, factor, False, first, term)
        part, size_of_part = _project(p, term, 1.0, turned)
        value += part
        error += condition * size_of_part
    for r in range(size):
        squared[r] = -squared[r]
    condition = _solve(equations, multiplier * multiplier, squared)
    _bend(equations, bend, factor, is_pair, squared, term)
    part, size_of_part = _project(p, term, 0.5, turned)
    return value + part, error + condition * size_of_part
