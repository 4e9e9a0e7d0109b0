"""What steps by collocation take: the Gauss points of a step, integrals of the polynomials through them, and room for one step."""

from math import comb
from typing import NamedTuple

import numpy as np

STAGES = 16
"""Gauss points of a step, which a Python function computes the forces of at once."""


class Stages(NamedTuple):
    """S Gauss points in a step from 0 to 1, and D other points where a step is looked at, for n coordinates and C columns."""

    address: int  # of `bvp.kernels.collocation.collocate`; 0: steps are Taylor series
    points: np.ndarray  # (S,)
    integrals: np.ndarray  # (S, S) from 0 to each point, of the polynomials that are 1 at one point each
    double: np.ndarray  # (S, S) the same twice
    legendre: np.ndarray  # (S, S) the shifted Legendre coefficients of these polynomials, in columns
    powers: np.ndarray  # (S, S) [k, p]: the coefficient of x^p in the shifted Legendre polynomial k
    others: np.ndarray  # (D,)
    values: np.ndarray  # (D, S) of these polynomials, at the other points
    areas: np.ndarray  # (D, S) their integrals from 0
    length: np.ndarray  # (3,) of the step; of the next one; of the one that made `before`
    rates: np.ndarray  # (S, n) accelerations at the points
    before: np.ndarray  # (S, n) Legendre coefficients of those of the step before
    states: np.ndarray  # (S, 2 n) at the points
    forces: np.ndarray  # (F, S) and their derivatives (D', S) behind them, at the points
    matrix: np.ndarray  # (S n, S n) of the linear equations
    pivots: np.ndarray  # (S n,) int64
    right: np.ndarray  # (S n, C) right sides and solutions
    moved: np.ndarray  # (S, 2 n, C) columns at the points, but for those of the accelerations
    terms: np.ndarray  # (S, n, C) sources of the columns at the points; C up to the next multiple of four


def make_stages(n, columns, results, collocates):
    """`Stages` for n coordinates, columns of derivatives, and so many results of the forces' function; empty if no step needs them."""
    count = STAGES if collocates else 0
    points, integrals, legendre, powers, others, values, areas = _tables(count) if collocates else _NO_TABLES
    rows, right = count * n, max(columns, 1)
    return Stages(
        0, points, integrals, integrals @ integrals, legendre, powers, others, values, areas, np.zeros(3),
        np.zeros((count, n)), np.zeros((count, n)), np.zeros((count, 2 * n)),
        np.zeros((results if collocates else 0, count)), np.zeros((rows, rows)), np.zeros(rows, dtype=np.int64), np.zeros((rows, right)),
        np.zeros((count, 2 * n, right)), np.zeros((count, n, right + -right % 4)),
    )  # fmt: skip


_NO_TABLES = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))


def _tables(count):
    """What `Stages` has of so many points."""
    points, weights = np.polynomial.legendre.leggauss(count)
    points, weights = 0.5 * (1.0 + points), 0.5 * weights
    legendre = (2.0 * np.arange(count)[:, None] + 1.0) * _legendre(points, count).T * weights
    integrals = _integrated(points, count) @ legendre
    powers = np.zeros((count, count))
    for k in range(count):
        for p in range(k + 1):
            powers[k, p] = (-1) ** (k + p) * comb(k, p) * comb(k + p, p)
    # The ends, where the polynomials are worst, and the middles of some of the gaps between points.
    middles = 0.5 * (points[1:] + points[:-1])
    others = np.concatenate([[0.0], middles[[1, count // 4, count // 2 - 1, count - 1 - count // 4, -2]], [1.0]])
    # By products: sums of Legendre polynomials would lose two digits at the ends.
    values = np.array([[np.prod([(x - b) / (a - b) for b in points if b != a]) for a in points] for x in others])
    return points, integrals, legendre, powers, others, values, _integrated(others, count) @ legendre


def _legendre(x, count):
    """The shifted Legendre polynomials at points of a step, (.., count)."""
    return np.polynomial.legendre.legvander(2.0 * x - 1.0, count - 1)


def _integrated(x, count):
    """Their integrals from 0: (P_(k+1) - P_(k-1))/(2 (2 k + 1))."""
    table = np.polynomial.legendre.legvander(2.0 * x - 1.0, count)
    found = np.empty((len(x), count))
    found[:, 0] = x
    for k in range(1, count):
        found[:, k] = (table[:, k + 1] - table[:, k - 1]) / (2.0 * (2.0 * k + 1.0))
    return found
