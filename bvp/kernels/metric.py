"""The coordinates in which arclength is measured: (start state / sqrt(2 h), log h, log alpha)."""

import math
from typing import NamedTuple

import numpy as np

from bvp.kernels.arrays import set_1
from bvp.kernels.compiled import inlined, part
from bvp.kernels.segment import start_state, total_time

__all__ = ["Metric", "constraint_row", "locate", "metric_direction"]


class Metric(NamedTuple):
    """Where the family is, and how it moves, in (start state / sqrt(2 h), log h, log alpha)."""

    position: np.ndarray  # (N + 2,)
    direction: np.ndarray  # (N + 2,)


@inlined
def locate(segment, y, out):
    """(start state / sqrt(2 h), log h, log alpha) and (h, alpha)."""
    size = segment.matrix.shape[1]
    start_state(segment.start_map, segment.start_offset, y, out[:size])
    energy = 0.0
    for r in range(size):
        energy += 0.5 * segment.weights[r] * out[r] * out[r]
    alpha = total_time(segment.matrix, segment.start_map, segment.shape, y) / segment.shape[2]
    speed = math.sqrt(2.0 * energy)
    for r in range(size):
        out[r] /= speed
    out[size] = math.log(energy)
    out[size + 1] = math.log(alpha) if alpha > 0.0 else -math.inf
    return energy, alpha


@inlined
def metric_direction(segment, y, position, energy, alpha, tangent, out):
    """Change of `locate` along `tangent`; returns (d h, length)."""
    size = segment.matrix.shape[1]
    s = segment.start_map.shape[1]
    speed = math.sqrt(2.0 * energy)
    change = 0.0
    for r in range(size):
        total = 0.0
        for j in range(s):
            total += segment.start_map[r, j] * tangent[j]
        out[r] = total / speed
        change += segment.weights[r] * position[r] * speed * total
    for r in range(size):
        out[r] -= position[r] * change / (2.0 * energy)
    out[size] = change / energy
    out[size + 1] = total_time(segment.matrix, segment.start_map, segment.shape, tangent) / segment.shape[2] / alpha
    length = 0.0
    for r in range(size + 2):
        length += out[r] * out[r]
    return change, math.sqrt(length)


@part
def constraint_row(segment, y, energy, alpha, position, direction, row):
    """Row r with r . dy = <direction, change of `locate` along dy>: the pseudo-arclength condition in the unknowns."""
    size = segment.matrix.shape[1]
    s = segment.start_map.shape[1]
    speed = math.sqrt(2.0 * energy)
    along = 0.0
    for r in range(size):
        along += direction[r] * position[r]
    set_1(row, 0.0)
    radial = direction[size] / energy - along / (2.0 * energy)
    for j in range(s):
        total = 0.0
        for r in range(size):
            total += segment.start_map[r, j] * (direction[r] / speed + radial * segment.weights[r] * position[r] * speed)
        row[j] = total
    at = s
    for _ in range(segment.shape[0] + 1):
        row[at] = direction[size + 1] / segment.shape[2] / alpha
        at += size + 1
