"""Many plain steps along a family in one compiled call, n = 2: predict, correct, look, judge, measure, choose the next step.

The duties are those of `continuation.problem.Advance`. The judgement is that of `continuation.control` and `event_functions`, compiled.
"""

import math
from typing import NamedTuple

import numpy as np

from branches.kernels.event_functions import common_tests, is_orbit, two_dof_tests
from bvp.kernels.compiled import call_at, kernel, part
from bvp.kernels.flight import set_1
from bvp.kernels.multipoint import CONTRACTION, CONVERGED, SLOPE, TURN
from bvp.kernels.step import Landing, Request
from continuation.control import ACCEPTED, NEAR_GOAL, arclength_of, distance, height, may_hide, next_step, refusal, watch

__all__ = ["Beginning", "Block", "Goal", "WatchedTests", "advance_block"]

_distance = part(distance)
_height = part(height)
_arclength_of = part(arclength_of)
_refusal = part(refusal)
_next_step = part(next_step)
_may_hide = part(may_hide)
_watch = part(watch)
_is_orbit = part(is_orbit)
_common_tests = part(common_tests)
_two_dof_tests = part(two_dof_tests)


class Block(NamedTuple):
    """What is found of each step; row after row, the last one for a step that is tried and not plain. u unknowns, k inner impacts."""

    y: np.ndarray  # (steps + 1, u)
    tangent: np.ndarray  # (steps + 1, 2 u)
    position: np.ndarray  # (steps + 1, N + 2)
    ends: np.ndarray  # (steps + 1, k + 1, N)
    result: np.ndarray  # (steps + 1, len(RESULT))
    tests: np.ndarray  # (steps + 1, tests)
    lengths: np.ndarray  # (steps + 1, 2) length asked for, arclength


class WatchedTests(NamedTuple):
    """The test functions of a family, as `continuation.control` watches them."""

    kinds: np.ndarray  # of `continuation.control.kinds_of`
    singular: np.ndarray  # size below which a sign is rounding
    limits: np.ndarray  # (3,) bounds of the energy's logarithm, and of the quarter period's
    targets: np.ndarray  # traces at which periods multiply


class Beginning(NamedTuple):
    """The orbit that a block of steps begins at, and the steps that led there."""

    y: np.ndarray  # (u,)
    tangent: np.ndarray  # (2 u,)
    position: np.ndarray  # (N + 2,)
    tests: np.ndarray  # values of the test functions there,
    older: np.ndarray  # one step before,
    oldest: np.ndarray  # and two steps before
    before: float  # length of the last step
    first: float  # and of the one before it


class Goal(NamedTuple):
    """Where the family closes on itself: see `continuation.problem.Advance`."""

    position: np.ndarray  # (N + 2,)
    direction: np.ndarray  # (N + 2,); nan: that of the first step


@kernel
def advance_block(compiled, most, control, watched, beginning, goal, ds, metric, block):
    """Steps from an orbit on, into `block`.

    compiled: `CompiledProblem`; where its second address is 0, the fold is the only test. most: iterations of a correction.
    metric (5, N + 2): scratch. Returns (accepted steps, 1 where the row after them holds a step that is not plain, length of the step to
    take next)."""
    addresses, packed, factor, observed, work, period = compiled
    y, tangent, position, tests, older, oldest, before, first = beginning
    kinds, singular, limits, targets = watched
    full = addresses[1] != 0
    way = metric[4]
    for r in range(way.shape[0]):
        way[r] = goal.direction[r]
    height_old = _height(position, goal.position, way)
    for count in range(block.y.shape[0] - 1):
        result = block.result[count]
        set_1(result, np.nan)
        new = block.y[count]
        ahead = block.tangent[count]
        call_at(addresses[0], (packed, factor, y, tangent, Request(ds, math.nan, most), metric, Landing(new, ahead, result)))
        if result[CONVERGED] != 1.0:
            return count, 1, ds
        ends = block.ends[count]
        for i in range(ends.shape[0]):
            for r in range(ends.shape[1]):
                ends[i, r] = factor.before[i, r]
        if full:
            call_at(addresses[1], (packed, observed, new, ends, work, result))
            call_at(addresses[2], (packed, new, ends, period, result))
        place = block.position[count]
        for r in range(place.shape[0]):
            place[r] = metric[0, r]
        if not _is_orbit(result):
            return count, 1, ds
        values = block.tests[count]
        if full:
            _common_tests(result, limits[0], limits[1], limits[2], values)
            _two_dof_tests(result, packed.shape[2], targets, values)
        else:
            values[0] = result[SLOPE]
        turn = result[TURN]
        contraction = result[CONTRACTION]
        chord = _distance(position, place)
        if _refusal(turn, contraction, chord, ds, control) != ACCEPTED:
            return count, 1, ds
        height_new = _height(place, goal.position, way)
        if height_old < 0.0 and height_new >= 0.0 and _distance(place, goal.position) <= NEAR_GOAL * chord:
            return count, 1, ds
        length = _arclength_of(chord, turn)
        if _watch(kinds, singular, _may_hide, oldest, older, tests, values, first, before, length):
            return count, 1, ds
        block.lengths[count, 0] = ds
        block.lengths[count, 1] = length
        ds = _next_step(ds, turn, contraction, control)
        if height_new != height_new and count == 0:
            for r in range(way.shape[0]):
                way[r] = place[r] - goal.position[r]
            height_new = _height(place, goal.position, way)
        first = before
        before = length
        height_old = height_new
        oldest = older
        older = tests
        tests = values
        position = place
        tangent = ahead
        y = new
    return block.y.shape[0] - 1, 0, ds
