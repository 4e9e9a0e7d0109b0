"""Extents of linear functionals along a motion: largest absolute values, their flights, and integrals of the squares."""

from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import kernel
from bvp.kernels.contact_mode import flight_of
from bvp.kernels.energy_budget import Products, integrals
from bvp.kernels.extrema import peak_flight

__all__ = ["ExtentsScratch", "extents_of_motion"]


class ExtentsScratch(NamedTuple):
    """Arrays to write into, which need not be kept."""

    peak: np.ndarray  # scratch, edge and work of `bvp.kernels.extrema.peak_flight`
    edge: np.ndarray
    work: np.ndarray
    integral: np.ndarray  # of `bvp.kernels.energy_budget.integral_work`
    squares: np.ndarray  # (R,)
    before: np.ndarray  # (R,)


@kernel
def extents_of_motion(modes, flights, rows, weight, scratch, best, where, total):
    """Largest values best (R,), the indices where (R,) of their flights, and the integrals total (R,) of the squares, over flights.

    rows (F, 2 R, N): the functionals and their rates, in each contact mode; weight (R,): ones. Returns False if the search for a peak
    gave up."""
    begins, numbers, states, end = flights
    before = scratch.before
    count = best.shape[0]
    for k in range(begins.shape[0]):
        f = numbers[k, 2]
        flight = (begins[k + 1] if k + 1 < begins.shape[0] else end) - begins[k]
        own = flight_of(modes, f)
        for c in range(count):
            before[c] = best[c]
        if not peak_flight(own, rows[f], states[k], flight, best, scratch.peak, scratch.edge, scratch.work):
            return False
        values = rows[f, :count]
        integrals(own, Products(values, values, weight), states[k], flight, scratch.integral, scratch.squares)
        for c in range(count):
            if best[c] > before[c]:
                where[c] = k
            total[c] += scratch.squares[c]
    return True
