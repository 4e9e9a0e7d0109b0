"""Cuts: nodes inside smooth flights, or at the start of a closed orbit without impacts, where nothing is hit.

A flight along which perturbations grow loses as many digits of its end. So it is solved in pieces of equal time, equation (45), and the
states at the cuts between them are unknowns.
"""

from bvp.kernels.compiled import chosen, inlined
from bvp.kernels.loads import LoadedFlight
from bvp.kernels.smooth_loads import SmoothLoadedFlight


@chosen
def is_smooth(flight):
    """Whether a flight has smooth forces: it is a series in time, which takes longer and has an error."""


@is_smooth.of(LoadedFlight)
@inlined
def is_exact(flight):
    """See `is_smooth`: linear flights are exact."""
    return False


@is_smooth.of(SmoothLoadedFlight)
@inlined
def is_series(flight):
    """See `is_smooth`."""
    return True
