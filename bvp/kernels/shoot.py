"""The states of a segment by flight from its start, over flight times that are known."""

from bvp.kernels.compiled import kernel
from bvp.kernels.flight import flow_state
from bvp.kernels.restitution import strike

__all__ = ["nodes_by_flight"]


@kernel
def nodes_by_flight(segment, start, times, before, nodes):
    """States after each inner impact into `nodes` (k, N), from the start state (N,) over flight times of which the first k count; `before`
    (N,) is scratch."""
    for r in range(start.shape[0]):
        before[r] = start[r]
    for i in range(nodes.shape[0]):
        flow_state(segment.pairs, segment.mean, segment.delta, segment.matrix, before if i == 0 else nodes[i - 1], times[i], nodes[i])
        strike(segment.gap_rate, segment.push, i, segment.jump[i], nodes[i], nodes[i])
