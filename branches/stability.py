"""What is said of the points of a family: label, multipliers, tau, stable or not, quality - as columns, for many points at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from branches.family import label_text
from branches.steps import Solutions
from bvp.closures import cycle_of
from bvp.kernels import multipoint as kernel
from bvp.multipliers import PAIRING_LIMIT, TRIVIAL_LIMIT, saddle_point_multipliers
from bvp.multipoint import RESULT_INDEX, MultipointProblem, Solution
from bvp.stability import balance, decide, roundings, stability

__all__ = ["Described", "describe", "impact_speeds"]

GRAZING = 1e-8
"""An impact slower than this, relative to sqrt(2 h), grazes: multipliers are unbounded there and given as NaN."""

AGREED = 1e-6
"""How well the traces of the half map and of the saddle-point matrix agree, relative, where both are to be trusted."""

FAR = 4.0
"""|tau| beyond which an orbit is unstable where two methods agree so on it, though beside a grazing the rounding of the largest entry of
the half map covers the smaller ones."""


@dataclass(frozen=True, eq=False)
class Described:
    """Columns by name, each of length N (see `branches.branch.Branch.points`)."""

    columns: dict[str, np.ndarray]


def describe(problem: MultipointProblem, solutions: Sequence[Solution], arclength: np.ndarray | None = None) -> Described:
    """Columns for the points of one family.

    Parameters
    ----------
    problem : MultipointProblem
    solutions : sequence of N Solution
    arclength : (N,) float, optional
        0 by default.

    Returns
    -------
    Described
    """
    count = len(solutions)
    n, size = problem.half, problem.size
    modes = problem.modes
    stacked = Solutions.stacked(solutions)
    results, unknowns, ends = stacked.result, stacked.y, stacked.ends

    def entry(name: str) -> np.ndarray:
        return results[:, RESULT_INDEX[name]]

    starts = unknowns[:, : problem.parameters] @ problem.segment.start_map.T + problem.segment.start_offset
    physical = starts @ modes.to_state.T
    last = problem.parameters + problem.inner * (size + 1) + 1
    times = unknowns[:, problem.parameters : last : size + 1]
    period = 4.0 * entry("quarter_period")
    labels = np.array([label_text(problem, result) for result in results])
    waves = entry("waves_absorber").astype(int)
    at_origin = problem.kinds[0] == kernel.ORIGIN
    speeds = impact_speeds(problem, starts, ends)
    slowest = np.min(np.abs(speeds), axis=1) if speeds.shape[1] else np.full(count, np.inf)
    grazing = slowest < GRAZING * np.sqrt(2.0 * entry("energy"))
    columns = {
        "h": entry("energy"),
        "alpha": entry("quarter_period"),
        "frequency": 2.0 * np.pi / period,
        "frequency_index": np.where(waves > 0, waves, 1) * 2.0 * np.pi / period,
        "arclength": np.zeros(count) if arclength is None else np.asarray(arclength, float),
        "label": labels,
        "half_waves": np.where(waves > 0, waves, 1),
        "residual": entry("residual"),
        "start_u": physical[:, :n],
        "start_v": physical[:, n:],
        "velocities": physical[:, n:].copy() if at_origin else np.full((count, n), np.nan),
        "flight_times": times,
        "impact_speeds": speeds,
    }
    if n == 2:
        columns.update(_two_dof(problem, results, grazing, np.concatenate([starts[:, None], ends], axis=1)))
    else:
        columns.update(_general(problem, solutions, grazing))
    return Described(columns)


def impact_speeds(problem: MultipointProblem, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Speeds of approach at the impacts of the segment in order of time, the ends' own included.

    Parameters
    ----------
    problem : MultipointProblem
    starts : (N, 2 n) float
        States at the start of the segment.
    ends : (N, k + 1, 2 n) float
        States at the end of each flight.

    Returns
    -------
    (N, number of impacts) float
    """
    segment = problem.segment
    columns = []
    if problem.kinds[0] == kernel.STOP:
        columns.append(-segment.side[problem.inner + 1] * (starts @ segment.gap_rate[problem.inner + 1]))
    hits = problem.inner + (problem.kinds[1] in (kernel.STOP, kernel.PERIODIC))
    for i in range(hits):
        columns.append(segment.side[i] * (ends[:, i] @ segment.gap_rate[i]))
    return np.array(columns).T if columns else np.zeros((len(ends), 0))


def _two_dof(
    problem: MultipointProblem, results: np.ndarray, grazing: np.ndarray, states: np.ndarray
) -> dict[str, np.ndarray]:
    """Two degrees of freedom: everything is in the results already; `states` (N, k + 2, 4) give the units of the half map."""

    def entry(name: str) -> np.ndarray:
        return results[:, RESULT_INDEX[name]]

    a, b, c, d = (entry(name) for name in "abcd")
    trace = entry("trace")
    determinant = entry("determinant")
    multipliers = np.empty((len(results), 2), complex)
    multipliers[:, 0] = entry("larger_real") + 1j * entry("larger_imaginary")
    multipliers[:, 1] = entry("smaller_real") + 1j * entry("smaller_imaginary")
    pairing = np.abs(determinant - 1.0)
    trivial = entry("trivial")
    tau_half = np.full(len(results), np.nan)
    if problem.quarters == 4:
        tau = trace
        error = roundings(problem.inner, entry("branching")) * (1.0 + np.abs(trace)) + trivial + pairing
        stable = np.where(np.abs(tau) < 2.0 - error, 1, np.where(np.abs(tau) > 2.0 + error, 0, -1))
        agreed = np.ones(len(results), bool)
    else:
        half = 2.0 + 4.0 * b * c
        if problem.quarters == 1:
            tau_half = half
            tau = half * half - 2.0
        else:
            tau = half
        sizes = np.max(np.abs(states), axis=1)
        rate = np.max(sizes[:, 2:], axis=1) / np.max(sizes[:, :2], axis=1)
        factors = balance(problem, rate)
        a, b, c, d = (value * factor for value, factor in zip((a, b, c, d), factors, strict=True))
        stable = decide(a, b, c, d, entry("magnified"), problem.inner, entry("branching"))
        agreed = np.abs(tau - trace) <= AGREED * (1.0 + np.abs(tau))
        stable = np.where((stable < 0) & agreed & (np.abs(tau) > FAR), 0, stable)
    bounded = ~grazing & np.isfinite(trace)
    largest = np.maximum(1.0, np.abs(multipliers[:, 0]))
    reliable = bounded & agreed & (trivial < TRIVIAL_LIMIT * largest) & (pairing < PAIRING_LIMIT)
    return {
        "multipliers": np.where(bounded[:, None], multipliers, np.nan),
        "tau": np.where(bounded, tau, np.nan),
        "tau_half": np.where(bounded, tau_half, np.nan),
        "stable": np.where(bounded, stable, -1).astype(np.int8),
        "trivial": np.where(bounded, trivial, np.nan),
        "pairing": np.where(bounded, pairing, np.nan),
        "reliable": reliable,
    }


def _general(problem: MultipointProblem, solutions: Sequence[Solution], grazing: np.ndarray) -> dict[str, np.ndarray]:
    """More degrees of freedom: orbit by orbit."""
    count, size = len(solutions), problem.size
    columns: dict[str, np.ndarray] = {
        "multipliers": np.full((count, size - 2), np.nan, complex),
        "tau": np.full(count, np.nan),
        "tau_half": np.full(count, np.nan),
        "stable": np.full(count, -1, np.int8),
        "trivial": np.full(count, np.nan),
        "pairing": np.full(count, np.nan),
        "reliable": np.zeros(count, bool),
    }
    for i, solution in enumerate(solutions):
        if grazing[i]:
            continue
        found = saddle_point_multipliers(cycle_of(problem, solution.y))
        columns["multipliers"][i] = found.values
        columns["trivial"][i] = found.quality.trivial
        columns["pairing"][i] = found.quality.pairing
        columns["reliable"][i] = found.quality.reliable
        found_stable = stability(problem, solution).stable
        columns["stable"][i] = -1 if found_stable is None else int(found_stable)
    return columns
