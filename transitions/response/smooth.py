"""Measures of a forced orbit with smooth forces, from the polynomials of its flights."""

from __future__ import annotations

import math

import numpy as np

from bvp.forced import ForcedProblem
from bvp.kernels.sources import ORDER
from bvp.simulate import smooth_dampers
from bvp.smooth_flights import loaded_steps

__all__ = ["smooth_measures"]

_nodes, _weights = np.polynomial.legendre.leggauss(ORDER + 2)
_PLACES, _WEIGHTS = 0.5 * (1.0 + _nodes), 0.5 * _weights
"""Gauss's rule on a step: exact for products of two polynomials."""

_POWERS = _PLACES[:, None] ** np.arange(ORDER + 1)

_NONE_LEFT = 1e-18
"""Part of a polynomial below which a last coefficient is left out."""


def smooth_measures(problem: ForcedProblem, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Peaks and integrals over the solved segment of an orbit.

    Parameters
    ----------
    problem : ForcedProblem
        With smooth forces.
    y : (u,) float

    Returns
    -------
    peaks : (n,) ndarray
        Largest displacements, at the zeros of the velocities' polynomials.
    totals : (R,) ndarray
        Integrals of the squares of displacements (n), of the products of two velocities, row by row of the upper triangle, and of the
        powers of the loads (n).
    lost : (S,) ndarray
        Energies that the dampers take which are not linear, those of `bvp.simulate.smooth_dampers`.

    Raises
    ------
    RuntimeError
        If a flight cannot be computed.
    """
    n, size = problem.degrees_of_freedom, 2 * problem.degrees_of_freedom
    parameters = problem.parameters(y)
    entries, layout = problem.parametric.entries(parameters), problem.parametric.layout
    base = float(entries[layout.frequency][0])
    harmonics = np.array(layout.harmonics, dtype=float)
    dampers = smooth_dampers(problem.system)
    forces = problem.parametric.system(parameters).smooth_forces if dampers else None
    peaks, lost = np.zeros(n), np.zeros(len(dampers))
    upper = np.triu_indices(n)
    totals = np.zeros(2 * n + len(upper[0]))
    for i, (node, duration) in enumerate(zip(problem.nodes(y), problem.flight_times(y).tolist(), strict=True)):
        times, coefficients = loaded_steps(problem, node, duration, i)
        lengths = np.diff(times)
        scaled = coefficients * lengths[:, None, None] ** np.arange(ORDER + 1)[:, None]
        states = np.einsum("pk,skr->spr", _POWERS, scaled)
        at = times[:-1, None] + lengths[:, None] * _PLACES
        angles = 2.0 * math.pi * problem.load_periods * node[size] + base * at
        u, v = states[..., :n], states[..., n:]
        load = entries[layout.constant] + np.zeros_like(u)
        for k, cosine, sine in zip(harmonics, entries[layout.cosine].reshape(-1, n), entries[layout.sine].reshape(-1, n), strict=True):
            load += np.cos(k * angles)[..., None] * cosine + np.sin(k * angles)[..., None] * sine
        weights = lengths[:, None, None] * _WEIGHTS[:, None]
        totals[:n] += np.sum(weights * u * u, axis=(0, 1))
        totals[n:-n] += np.sum(weights * v[..., upper[0]] * v[..., upper[1]], axis=(0, 1))
        totals[-n:] += np.sum(weights * load * v, axis=(0, 1))
        if forces is not None:
            taken = np.sum(weights * forces.values(u, v) * (v @ forces.directions.T), axis=(0, 1))
            lost += [sum(work for work, name in zip(taken, forces.dampers, strict=True) if name == damper) for damper in dampers]
        peaks = np.maximum(peaks, [_peak(scaled[:, :, c]) for c in range(n)])
    return peaks, totals, lost


def _peak(rows: np.ndarray) -> float:
    """Largest modulus of polynomials (S, K + 1) on [0, 1]."""
    found = float(max(np.abs(rows[:, 0]).max(), np.abs(rows.sum(axis=1)).max()))
    bounds = np.abs(rows).sum(axis=1)
    for k in np.argsort(-bounds):
        if bounds[k] <= found:
            break
        slope = rows[k, 1:] * np.arange(1, rows.shape[1])
        kept = np.flatnonzero(np.abs(slope) > _NONE_LEFT * np.abs(slope).max())
        if not len(kept):
            continue
        zeros = np.roots(slope[kept[-1] :: -1])
        places = zeros.real[(np.abs(zeros.imag) < 1e-6) & (zeros.real > 0.0) & (zeros.real < 1.0)]
        values = np.polynomial.polynomial.polyval(places, rows[k])
        found = max(found, float(np.abs(values).max(initial=0.0)))
    return found
