"""Extents of linear functionals along a motion: largest absolute values, their flights, and integrals of the squares."""

from bvp.kernels.compiled import kernel
from bvp.kernels.contact_mode import flight_of
from bvp.kernels.energy_budget import integrals
from bvp.kernels.extrema import peak_flight

__all__ = ["extents_of_motion"]


@kernel
def extents_of_motion(
    phases, begins, numbers, states, end, rows, weight, scratch, edge, work, integral_work, squares, before, best, where, total
):
    """Largest values best (R,), the indices where (R,) of their flights, and the integrals total (R,) of the squares, over flights as in
    `motion.sample`.

    rows (F, 2 R, N): the functionals and their rates, in each contact mode; weight (R,): ones; scratch to before: arrays to write into.
    Returns False if the search for a peak gave up."""
    count = best.shape[0]
    for k in range(begins.shape[0]):
        f = numbers[k, 2]
        flight = (begins[k + 1] if k + 1 < begins.shape[0] else end) - begins[k]
        own = flight_of(phases, f)
        for c in range(count):
            before[c] = best[c]
        if not peak_flight(own, rows[f], states[k], flight, best, scratch, edge, work):
            return False
        values = rows[f, :count]
        integrals(own, values, values, weight, states[k], flight, integral_work, squares)
        for c in range(count):
            if best[c] > before[c]:
                where[c] = k
            total[c] += squares[c]
    return True
