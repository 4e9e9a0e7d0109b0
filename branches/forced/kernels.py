"""Compiled code for families of forced orbits: their test functions, and the advance by many steps in one call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from branches.kernels.blocks import advance
from branches.kernels.brackets import narrow
from bvp.kernels import multipoint as entry
from bvp.kernels.compiled import kernel
from bvp.kernels.stroboscopic import Stroboscopic, stroboscopic_tests

__all__ = ["PLAIN", "ForcedWork", "advance_forced_block", "forced_tests", "narrow_forced_bracket"]

PLAIN = 9
"""Test functions that every forced family has, before those of values that are asked for."""

_CLEAR = 1e3
"""Clearances and speeds, in units of arclength, from which on they are replaced by this value."""


class ForcedWork(NamedTuple):
    """What the test functions need besides the orbit."""

    flights: np.ndarray  # (k + 1, N, N) derivatives of the flights of the last orbit, of its problem's `Factor`
    map: Stroboscopic
    limits: np.ndarray  # (2,) lowest and highest value of the parameter
    neutral: int  # 1: pairs of multipliers have the product 1 all along the family, or one that no orbit changes


@kernel
def forced_tests(segment, y, ends, work, result, targets, out):
    """Fold, branch point, grazing in its three ways, the bounds of the parameter, det(M + 1) and the product of 1 - mu_i mu_j for the
    stroboscopic map M, both bounded (`bvp.kernels.stroboscopic`), and the distances of the parameter from the targets, into out."""
    value = result[entry.ENERGY]
    out[0] = result[entry.SLOPE]
    out[1] = result[entry.BRANCHING]
    out[2] = min(result[entry.CLEARANCE] / segment.scale[0], _CLEAR)
    out[3] = min(result[entry.SPEED] / segment.scale[segment.flight.enter.shape[0] // 2], _CLEAR)
    out[4] = result[entry.FLIGHT] / result[entry.QUARTER_PERIOD]
    out[5] = value - work.limits[0] if work.limits[0] > -math.inf else 1.0
    out[6] = work.limits[1] - value if work.limits[1] < math.inf else 1.0
    stroboscopic_tests(segment, y, work.flights, ends, work.map, out[7:PLAIN])
    if work.neutral == 1:
        out[8] = math.nan
    for i in range(targets.shape[0]):
        out[PLAIN + i] = value - targets[i]


@kernel
def advance_forced_block(compiled, most, control, watched, beginning, goal, ds, metric, block):
    """See `branches.kernels.blocks.advance`."""
    return advance(compiled, most, control, watched, beginning, goal, ds, metric, block)


@kernel
def narrow_forced_bracket(departure, low, high, sought, samples, block):
    """See `branches.kernels.brackets.narrow`."""
    return narrow(departure, low, high, sought, samples, block)
