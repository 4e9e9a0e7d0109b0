"""The stability of orbits. An orbit is called stable or unstable only if the numbers show it beyond their errors.

A reversible orbit between two ends has the half map phi = [[a, b], [c, d]], equation (13), symplectic. With nu the
eigenvalues of b'c, the return map there and back has the traces 2 + 4 nu, and 1 + nu are the eigenvalues of d'a: the orbit is
stable where every nu lies in (-1, 0), and near the limits nu and 1 + nu are small numbers with small errors, not differences
of large ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import saltus_core as core

from bvp.checks import EPSILON
from bvp.closures import ORIGIN, cycle_of
from bvp.multipliers import floquet_multipliers, given_chain, linearised_flights, nearest_grazing, pairs_of, system_chain
from bvp.multipoint import MultipointProblem, Solution

__all__ = [
    "DECISION", "ERROR_FACTOR", "Stability", "balance", "chain_half_map", "decide", "half_map_multipliers", "half_map_of", "roundings",
    "stability", "verdict",
]  # fmt: skip

ERROR_FACTOR = 64.0
"""Rounding errors, in units of eps, that one flight with its impact, and the solution itself, add to an entry of the half map."""

DECISION = {1: True, 0: False, -1: None}
"""What `verdict` says of one orbit."""


@dataclass(frozen=True, eq=False)
class Stability:
    """Stability of an orbit.

    Parameters
    ----------
    tau : (n - 1,) complex or float
        Traces lambda + 1/lambda of the full-period map, one for each pair of multipliers; NaN where they are unbounded.
    tau_half : (n - 1,) complex or float, or None
        The same of the half-period map composed with u -> -u, for an orbit solved as a quarter; None for others.
    stable : bool or None
        None if the errors are too large for a decision.
    krein : (n - 1,) int
        Krein signatures of the pairs of the map that tau_half, or where there is none tau, belongs to: the sign of i x* J x for
        the eigenvector x of the multiplier with positive imaginary part; 0 where the pair is not elliptic or the sign not
        decided, and for periodic closures, where no reversal gives it.
    nu : (n - 1,) complex or float
        Eigenvalues of b'c, sorted by real part; NaN for periodic closures.
    error : (n - 1,) float
        Bound of the error of nu; for periodic closures, of tau.
    note : str
        What is wrong, in words; empty where nothing is.
    """

    tau: np.ndarray
    tau_half: np.ndarray | None
    stable: bool | None
    krein: np.ndarray
    nu: np.ndarray
    error: np.ndarray
    note: str = ""


def velocity_scale(problem: MultipointProblem, solution: Solution) -> float:
    """What `balance` asks for: sqrt(2 h) over the largest modal displacement at the impacts and the ends; of an orbit without impacts, its
    frequency: at its ends it can be at rest or at the origin."""
    if not problem.hit:
        return math.pi / (2.0 * problem.quarter_period(solution.y))
    displacements = np.vstack([problem.start(solution.y), solution.ends])[:, : problem.half]
    return math.sqrt(2.0 * problem.energy(solution.y)) / float(np.max(np.abs(displacements)))


def balance(problem: MultipointProblem, rate: np.ndarray | float) -> tuple[Any, Any, Any, Any]:
    """Factors of a, b, c, d that take their units out, for an orbit whose velocities are `rate` times its displacements.

    At an origin the perturbation that its reversal keeps is a velocity and the one turned round a displacement; at a rest or stop
    end it is the other way about.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> balance(MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ()), 2.0)
    (2.0, 1.0, 1.0, 0.5)
    """
    start, end = problem.kinds
    kept_start, turned_start = (rate, 1.0) if start == ORIGIN else (1.0, rate)
    kept_end, turned_end = (rate, 1.0) if end == ORIGIN else (1.0, rate)
    return kept_start / kept_end, turned_start / kept_end, kept_start / turned_end, turned_start / turned_end


def roundings(impacts: np.ndarray | float, pivot: np.ndarray | float) -> np.ndarray:
    """Rounding error of a number of size 1 that is computed along a segment, for a solution with a given smallest pivot.

    Examples
    --------
    >>> float(roundings(0, -0.5)) == 3.0 * ERROR_FACTOR * EPSILON
    True
    """
    with np.errstate(divide="ignore"):
        return ERROR_FACTOR * EPSILON * (np.asarray(impacts) + 1.0 + 1.0 / np.abs(pivot))


def decide(
    a: np.ndarray | float,
    b: np.ndarray | float,
    c: np.ndarray | float,
    d: np.ndarray | float,
    magnified: np.ndarray | float,
    impacts: np.ndarray | float,
    pivot: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Stability of orbits with two degrees of freedom from the entries of their half maps: 1 stable, 0 unstable, -1 undecided.

    Parameters
    ----------
    a, b, c, d : float or (N,) float
        The half map, in units that balance it: multiplied by `balance`.
    magnified : float or (N,) float
        Largest factor by which an impact magnifies rounding.
    impacts : int or (N,) int
        Inner impacts of the segment.
    pivot : float or (N,) float
        The smallest pivot of the equations that were solved, relative to its column (`branching` of a solution, of either sign).

    Notes
    -----
    Each entry of the balanced map is right to e = 64 eps (k + 1 + 1/|pivot|) magnified max|entries|: rounding enters once a flight, the
    solution is known to rounding over the smallest pivot - next to a branch point it slides towards the other family -, and an impact
    at an angle to the stop divides both by the sine of that angle. Stable where b c < 0 and a d > 0, each by more than its error:
    |b c| > e (|b| + |c|) + e^2, |a d| likewise; unstable where one of them is as surely of the other sign.

    Examples
    --------
    >>> decide(np.array([0.5, 1.5, 1.0]), np.array([1.0, 1.0, 1e-17]), np.array([-0.5, 0.5, -1.0]), 1.0, 1.0, 0)
    array([ 1,  0, -1], dtype=int8)
    """
    a, b, c, d = (np.asarray(x, dtype=float) for x in (a, b, c, d))
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        size = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.maximum(np.abs(c), np.abs(d)))
        error = roundings(impacts, pivot) * magnified * size
        below, below_error = b * c, error * (np.abs(b) + np.abs(c)) + error * error
        above, above_error = a * d, error * (np.abs(a) + np.abs(d)) + error * error
        return verdict(*(np.asarray(x)[..., None] for x in (below, below_error, above, above_error)))


def verdict(nu: Any, error: Any, rest: Any, rest_error: Any, krein: Any = 0) -> np.ndarray:
    """Stability from one number nu for each pair of multipliers: the one decision for all kinds of orbits.

    A pair lambda, 1/lambda has the trace lambda + 1/lambda = 2 + 4 nu. It lies on the unit circle where -1 < nu < 0.

    Here nu, rest = 1 + nu (known apart from nu where that is near -1, in any order) and the bounds of their errors are arrays (..., m), and
    `krein` holds the signatures of the pairs, +1 or -1 where they are known, else 0. Returns 1 (stable), 0 (unstable) or -1 (undecided).

    Notes
    -----
    Unstable: some nu is not real, above 0 or below -1, by more than its error. Stable: all nu lie inside by more than their errors, and two
    that are nearer to each other than their errors have the same Krein signature (Krein's theorem: Yakubovich & Starzhinskii, Linear
    Differential Equations with Periodic Coefficients, 1975, ch. III).

    Examples
    --------
    >>> [int(verdict([nu], [1e-9], [1.0 + nu], [1e-9])) for nu in (-0.5, 0.1, -1e-12)]
    [1, 0, -1]
    """
    nu, error, rest, rest_error = (np.asarray(x) for x in (nu, error, rest, rest_error))
    krein = np.broadcast_to(krein, nu.shape)
    known = np.all(np.isfinite(error) & np.isfinite(rest_error), axis=-1)
    outside = np.any((np.abs(nu.imag) > error) | (nu.real > error) | (rest.real < -rest_error), axis=-1)
    inside = np.all((nu.real < -error) & (rest.real > rest_error), axis=-1)
    for i in range(nu.shape[-1]):
        for j in range(i):
            near = np.abs(nu[..., i] - nu[..., j]) <= error[..., i] + error[..., j]
            inside = inside & ~(near & (krein[..., i] * krein[..., j] != 1))
    return np.where(known & outside, 0, np.where(known & inside, 1, -1)).astype(np.int8)


def half_map_of(problem: MultipointProblem, solution: Solution) -> tuple[np.ndarray, float]:
    """phi (2 m, 2 m) between the ends, and the largest factor by which an impact magnifies rounding.

    Raises
    ------
    ValueError
        For a periodic closure, which has no ends.
    """
    if problem.periodic:
        raise ValueError("a periodic closure has no half map; its multipliers decide its stability")
    if problem.half == 2 and math.isfinite(solution["magnified"]):
        entries = [[solution["a"], solution["b"]], [solution["c"], solution["d"]]]
        return np.array(entries), solution["magnified"]
    return chain_half_map(problem, solution)


def chain_half_map(problem: MultipointProblem, solution: Solution) -> tuple[np.ndarray, float]:
    """The same along the chain of the orbit's flights and impacts."""
    size, k = problem.size, problem.inner
    states, first = np.empty((k + 1, size)), problem.parameters + 1
    states[0] = problem.start(solution.y)
    states[1:] = solution.y[first : first + k * (size + 1)].reshape(k, size + 1)[:, :size]
    times, ends = problem.flight_times(solution.y), solution.ends
    kinds, held, contact = tuple(map(int, problem.kinds)), problem.held, problem.contacts
    if problem.is_smooth:
        linear = linearised_flights(problem.orbits.flight, np.vstack([states[:1], ends]), np.vstack([states, ends[-1:]]), times)
        reach = math.sqrt(2.0 * problem.energy(solution.y))
        phi, magnified = given_chain(problem.system).half_map_of_maps(kinds, held, *linear, contact, reach)
    else:
        phi, magnified = system_chain(problem.system).half_map(kinds, held, states, times, ends, contact)
    return phi, magnified


def half_map_multipliers(problem: MultipointProblem, solution: Solution) -> tuple[np.ndarray, float]:
    """The nontrivial multipliers (2 m,) of the full period of an orbit between two ends, by modulus descending, and how far the half map is
    from a symplectic one, relative to the square of its largest entry.

    With the blocks of the half map the map there and back is [[d'a + b'c, 2 d'b], [2 a'c, a'd + c'b]]. Of a
    quarter it is the map of half a period composed with u -> -u."""
    phi, _ = half_map_of(problem, solution)
    m = len(phi) // 2
    rate = np.sqrt(velocity_scale(problem, solution))
    scale = np.concatenate([np.full(m, rate), np.full(m, 1.0 / rate)])
    start, end = (scale if kind == ORIGIN else 1.0 / scale for kind in problem.kinds)
    phi = phi * start[None, :] / end[:, None]
    values, defect = core.half_map_multipliers(np.ascontiguousarray(phi), problem.quarters == 1)
    return values, defect


def stability(problem: MultipointProblem, solution: Solution) -> Stability:
    """Traces, stability and Krein signatures of a solved orbit.

    Notes
    -----
    `verdict` decides. Between two ends nu are the eigenvalues of b'c and 1 + nu those of d'a. Their errors are those of the entries, as in
    `decide`, times the condition number of each eigenvalue. A pair nu has the eigenvector (x, -2i a'c x / sin theta), cos theta = 1 + 2 nu,
    so its Krein signature is the sign of x'a'c x. For a periodic closure nu follows from the multipliers, without signatures. An orbit
    without nontrivial multipliers, as with one degree of freedom, is stable: the motions next to it are the other orbits of its family.
    """
    m = problem.pairs
    if m == 0:
        none = np.zeros(0)
        return Stability(none, none if problem.quarters == 1 else None, True, none.astype(int), none, none)
    if problem.periodic:
        return _periodic(problem, solution)
    phi, magnified = half_map_of(problem, solution)
    if not np.all(np.isfinite(phi)):
        nothing = np.full(m, math.nan)
        quarter = nothing if problem.quarters == 1 else None
        note = "an impact grazes: the half map is unbounded"
        return Stability(nothing, quarter, None, np.zeros(m, int), nothing, nothing, note)
    factors = balance(problem, velocity_scale(problem, solution))
    blocks = (phi[:m, :m], phi[:m, m:], phi[m:, :m], phi[m:, m:])
    a, b, c, d = (block * factor for block, factor in zip(blocks, factors, strict=True))
    entry_error = float(roundings(problem.inner, solution["branching"])) * magnified * float(np.max(np.abs([a, b, c, d])))
    nu, vectors, error = _eigenvalues(_product(b, c), b, c, entry_error)
    above, _, above_error = _eigenvalues(_product(d, a), a, d, entry_error)
    krein = _krein(_product(a, c), vectors, nu, entry_error * (_norm(a) + _norm(c)) + entry_error**2)
    stable = DECISION[int(verdict(nu, error, above, above_error, krein))]
    if problem.half == 2 and problem.drifts:
        stable = True  # the only pair is that of the translation
    traces = 2.0 + 4.0 * nu
    if problem.quarters == 1:
        return Stability(traces * traces - 2.0, traces, stable, krein, nu, error)
    return Stability(traces, None, stable, krein, nu, error)


def _eigenvalues(
    matrix: np.ndarray, p: np.ndarray, q: np.ndarray, entry_error: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues by real part, real parts of unit eigenvectors, error bounds, of a product of p and q with entries right to
    `entry_error`."""
    m = matrix.shape[0]
    spread = m * entry_error * (_norm(p) + _norm(q) + m * entry_error)
    if m == 1:
        return matrix[0], np.ones((1, 1)), np.array([spread])
    values, vectors, _, condition = core.eigensystem(matrix)
    if not np.any(values.imag):
        values = values.real
    order = np.lexsort((values.imag, values.real))
    return values[order], vectors[:, order], spread * condition[order]


def _product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """p'q, in the same order on every machine."""
    total: np.ndarray = sum(np.multiply.outer(p[k], q[k]) for k in range(len(p)))
    return total


def _norm(matrix: np.ndarray) -> float:
    """The largest singular value."""
    return float(np.max(core.singular_values(np.ascontiguousarray(matrix))))


def _krein(form: np.ndarray, vectors: np.ndarray, nu: np.ndarray, error: float) -> np.ndarray:
    """Signs of x'a'c x for the elliptic pairs."""
    m = nu.size
    signs = np.zeros(m, dtype=int)
    for j in range(m):
        if abs(np.imag(nu[j])) > 0.0 or not -1.0 < np.real(nu[j]) < 0.0:
            continue
        value = math.fsum((np.multiply.outer(vectors[:, j], vectors[:, j]) * form).ravel().tolist())
        if abs(value) > m * error:
            signs[j] = 1 if value > 0.0 else -1
    return signs


def _periodic(problem: MultipointProblem, solution: Solution) -> Stability:
    """By the multipliers of the full period."""
    m = problem.pairs
    cycle = cycle_of(problem, solution.y)
    multipliers = floquet_multipliers(cycle)
    none = np.zeros(m, dtype=int)
    unknown = np.full(m, math.nan)
    if not np.all(np.isfinite(multipliers.values)):
        return Stability(unknown, None, None, none, unknown, unknown, multipliers.note)
    impacts = len(cycle.contact)
    spread = float(roundings(impacts, solution["branching"])) / nearest_grazing(cycle)[1] * _norm(multipliers.matrix)
    if m == 1:
        tau, error = np.array([multipliers.trace]), np.array([2.0 * spread])
    else:
        # d(lambda + 1/lambda) = (1 - 1/lambda^2) d lambda
        traces = [(value + 1.0 / value, value) for value, _ in pairs_of(multipliers.values)]
        traces = [(trace.real if value.imag == 0.0 else trace, value) for trace, value in traces]
        tau, values = np.array(sorted(traces, key=lambda pair: (np.real(pair[0]), np.imag(pair[0])))).T
        bound = 2 * m * spread * _condition(multipliers.matrix)
        error = np.abs(1.0 - values**-2) * bound + bound * bound
    stable = DECISION[int(verdict((tau - 2.0) / 4.0, error / 4.0, (tau + 2.0) / 4.0, error / 4.0))]
    return Stability(tau, None, stable, none, unknown, error, multipliers.note)


def _condition(matrix: np.ndarray) -> float:
    """That of the unit eigenvectors of a matrix."""
    _, real, imaginary, _ = core.eigensystem(matrix)
    sizes = core.singular_values(np.block([[real, -imaginary], [imaginary, real]]))
    return float(np.max(sizes) / np.min(sizes)) if np.min(sizes) > 0.0 else math.inf
