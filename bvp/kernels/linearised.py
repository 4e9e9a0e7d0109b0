"""The flights of an orbit, linearised, for the chains of the core."""

from bvp.kernels import smooth  # noqa: F401  a kind of flight
from bvp.kernels.compiled import kernel
from bvp.kernels.flights import flight_map, rate


@kernel
def linearise(flight, after, duration, before, maps, coming, leaving):
    """maps (F, N, N) of the flights from the first F nodes over `duration` (F,), and the rates before and after each node (P, N)."""
    for i in range(duration.shape[0]):
        flight_map(flight, after[i], duration[i], maps[i])
    for j in range(after.shape[0]):
        rate(flight, before[j], coming[j])
        rate(flight, after[j], leaving[j])
