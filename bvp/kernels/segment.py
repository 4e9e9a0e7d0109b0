"""What the kernels know of a multipoint problem: its flights' modes, its contacts, its two ends."""

from typing import NamedTuple

import numpy as np

from bvp.kernels.compiled import inlined, part, sized

__all__ = ["ORIGIN", "PERIODIC", "REST", "STOP", "Segment", "pack", "sized_rows", "start_state", "total_time", "unpack"]

ORIGIN, REST, STOP, PERIODIC = 0, 1, 2, 3
"""Kinds of an end."""


class Segment(NamedTuple):
    """What the kernels know of a problem. N = 2 n entries a state, k inner impacts. Row k of the node arrays is the
    impact at the far end or, for a periodic orbit, the closing one; row k + 1 is the impact at the start (zero where there is none)."""

    pairs: np.ndarray
    mean: np.ndarray
    delta: np.ndarray
    matrix: np.ndarray
    gap: np.ndarray  # (k + 2, N) rows g of the contacts hit
    gap_rate: np.ndarray  # (k + 2, N) rows g B
    push: np.ndarray  # (k + 2, N) directions of the impulses
    jump: np.ndarray  # (k + 2,) 1 + restitution
    bound: np.ndarray  # (k + 2,)
    side: np.ndarray  # (k + 2,) +1 upper, -1 lower
    start_map: np.ndarray  # (N, s) Z
    start_offset: np.ndarray  # (N,) c
    end_map: np.ndarray  # (c, N) L
    end_offset: np.ndarray  # (c,) l
    weights: np.ndarray  # (N,) H = sum(weights z^2)/2
    shape: np.ndarray  # (5,) int64: inner impacts k; periodic 0/1; quarter periods solved 1, 2 or 4; kind of start; kind of end


@inlined
def start_state(start_map, start_offset, y, out):
    """out = Z s + c."""
    for r in range(out.shape[0]):
        total = start_offset[r]
        for j in range(start_map.shape[1]):
            total += start_map[r, j] * y[j]
        out[r] = total


@inlined
def total_time(matrix, start_map, shape, y):
    """Sum of the flight times in the unknowns y, or in a change of them."""
    total = 0.0
    at = start_map.shape[1]
    for _ in range(shape[0] + 1):
        total += y[at]
        at += matrix.shape[1] + 1
    return total


@part
def unpack(pairs, rows, scalars, start_map, shape):
    """The `Segment` whose arrays stand in the rows of one array and the entries of another (see `pack`)."""
    size = rows.shape[1]
    nodes = shape[0] + 2
    blocks = pairs.shape[0]
    at = 3 * nodes + size
    closers = rows.shape[0] - at - 2
    side = 2 * blocks + 2 * nodes
    return Segment(
        pairs,
        scalars[:blocks],
        scalars[blocks : 2 * blocks],
        rows[3 * nodes : at],
        rows[:nodes],
        rows[nodes : 2 * nodes],
        rows[2 * nodes : 3 * nodes],
        scalars[2 * blocks : 2 * blocks + nodes],
        scalars[2 * blocks + nodes : side],
        scalars[side : side + nodes],
        start_map,
        rows[at],
        rows[at + 2 : at + 2 + closers],
        scalars[side + nodes :],
        rows[at + 1],
        shape,
    )


@part
def sized_rows(segment):
    """The same segment, known to be of states of four entries."""
    return Segment(
        sized(segment.pairs, 2),
        segment.mean,
        segment.delta,
        sized(segment.matrix, 4),
        sized(segment.gap, 4),
        sized(segment.gap_rate, 4),
        sized(segment.push, 4),
        segment.jump,
        segment.bound,
        segment.side,
        segment.start_map,
        sized(segment.start_offset, 4),
        sized(segment.end_map, 4),
        segment.end_offset,
        sized(segment.weights, 4),
        segment.shape,
    )


def pack(segment):
    """(pairs, rows, scalars, start_map, shape): few arrays, for calls that should cost little."""
    rows = np.vstack(
        [
            segment.gap,
            segment.gap_rate,
            segment.push,
            segment.matrix,
            segment.start_offset[None],
            segment.weights[None],
            segment.end_map,
        ]
    )
    scalars = np.concatenate(
        [segment.mean, segment.delta, segment.jump, segment.bound, segment.side, segment.end_offset]
    )
    return segment.pairs, np.ascontiguousarray(rows), scalars, segment.start_map, segment.shape
