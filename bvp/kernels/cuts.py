"""Cuts: nodes inside smooth flights, or at the start of a closed orbit without impacts, where nothing is hit.

A flight along which perturbations grow loses as many digits of its end. So it is solved in pieces of equal time, equation (45), and the
states at the cuts between them are unknowns.
"""

from bvp.kernels.compiled import chosen, inlined
from bvp.kernels.flight import Flight
from bvp.kernels.loads import LoadedFlight
from bvp.kernels.smooth import SmoothFlight
from bvp.kernels.smooth_loads import SmoothLoadedFlight


@chosen
def is_cut(flight, side, i):
    """Whether node i is a cut, where no side of a stop is hit."""


@is_cut.of(Flight)
@is_cut.of(LoadedFlight)
@inlined
def is_never_cut(flight, side, i):
    """See `is_cut`: linear flights are exact."""
    return False


@is_cut.of(SmoothFlight)
@is_cut.of(SmoothLoadedFlight)
@inlined
def is_smooth_cut(flight, side, i):
    """See `is_cut`."""
    return side[i] == 0.0
