"""Base frequencies at which the response without impacts has no bound: a load has the frequency of an undamped mode."""

from __future__ import annotations

import math

import numpy as np

from bvp.forced import ForcedProblem

__all__ = ["RESONANCE", "is_driven", "resonances_around"]

RESONANCE = "the response is unbounded here: the load has the frequency of an undamped mode"

_SINGULAR = 1e-9
"""Singular value of a dynamic stiffness, and part of a load, that count as zero beside the largest."""

_NEUTRAL = 1e-12
"""Largest damping of a mode, beside its frequency, that counts as none."""


def resonances_around(problem: ForcedProblem, value: float) -> tuple[float, float]:
    """The base frequencies next to a value at which a load has the frequency of an undamped mode; infinite where there are none, and where
    the released parameter is not the base frequency itself, and beside smooth forces, which change the frequency of a mode that grows."""
    parametric, name = problem.parametric, problem.released[0]
    here = parametric.entries(problem.values)[parametric.layout.frequency][0]
    slope = parametric.derivatives(problem.values, [name])[parametric.layout.frequency][0, 0]
    moved = parametric.program(problem.released).rows
    is_base = slope == 1.0 and here == problem.values[name] and not np.any(moved < parametric.layout.stiffness.stop)
    if problem.sequence or problem.is_smooth or not problem.has_clock or not is_base:
        return -math.inf, math.inf
    modes = problem.system.modes
    rates = np.linalg.eigvals(modes.flight.matrix)
    free = np.abs(rates.imag)[(np.abs(rates.real) <= _NEUTRAL * np.abs(rates.imag)) & (rates.imag > 0.0)]
    found = np.unique(np.divide.outer(free, np.array(parametric.layout.harmonics, dtype=float)))
    found = found[[is_driven(problem, float(frequency)) for frequency in found]] if len(found) else found
    return max(found[found < value], default=-math.inf), min(found[found > value], default=math.inf)


def is_driven(problem: ForcedProblem, frequency: float) -> bool:
    """Whether a load has no bounded steady response at a base frequency."""
    layout, entries, system = problem.parametric.layout, problem.parametric.entries(problem.values), problem.system
    loads = entries[layout.cosine].reshape(-1, system.degrees_of_freedom) - 1j * entries[layout.sine].reshape(-1, system.degrees_of_freedom)
    for k, load in zip(layout.harmonics, loads, strict=True):
        nu = k * frequency
        dynamic = system.stiffness + 1j * nu * system.damping - nu * nu * system.mass
        left, sizes, _ = np.linalg.svd(dynamic)
        weak = left[:, sizes <= _SINGULAR * max(np.abs(dynamic.real).max(), np.abs(system.stiffness).max())]
        if np.abs(weak.conj().T @ load).max(initial=0.0) > _SINGULAR * np.abs(load).max():
            return True
    return False
