"""What Python asks about the path of a single flight, of any kind: its state, its rate, and where a gap turns."""

from bvp.kernels import smooth  # noqa: F401  a kind of flight
from bvp.kernels.compiled import kernel
from bvp.kernels.extrema import crossing_times, rises
from bvp.kernels.flights import path_state, rate


@kernel
def state_at(flight, z, t, out):
    """See `bvp.kernels.flights.path_state`."""
    path_state(flight, z, t, out)


@kernel
def motion_at(flight, z, t, out, change):
    """The state on the path at a time, and its rate."""
    path_state(flight, z, t, out)
    rate(flight, out, change)


@kernel
def turning_times(flight, rows, z, duration, times, work):
    """The times in (0, duration) at which a gap turns: see `bvp.kernels.extrema.crossing_times`. rows (3, N): its derivatives in flight
    without smooth forces."""
    return crossing_times(flight, rows[0], rows[1], rows[2], z, duration, times, work)


@kernel
def rising_times(flight, rows, z, duration, sign, times, work):
    """See `bvp.kernels.extrema.rises`. rows (3, N): a functional and its derivatives, as in `turning_times`."""
    return rises(flight, rows[0], rows[1], rows[2], z, duration, sign, times, work)
