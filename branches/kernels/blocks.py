"""The step along a family of orbits with its test functions, and the advance by many steps in one call.

A block predicts, corrects, judges and measures each step, and chooses the next one. It fulfils the contract of
`continuation.problem.Advance`, and accepts and refuses steps by `continuation.control`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from branches.kernels.control import arclength_of, distance, height, may_hide, next_step, refusal, watch
from branches.kernels.functions import is_orbit
from bvp.kernels import multipoint as entry
from bvp.kernels.compiled import call_at, inlined
from bvp.kernels.flight import set_1
from bvp.kernels.step import Landing, Request
from continuation.control import ACCEPTED, NEAR_GOAL

__all__ = ["Beginning", "Block", "GoalPlane", "TestedPoint", "WatchedTests", "advance", "land_tested"]

_distance = inlined(distance)
_height = inlined(height)
_arclength_of = inlined(arclength_of)
_refusal = inlined(refusal)
_next_step = inlined(next_step)
_may_hide = inlined(may_hide)
_watch = inlined(watch)
_is_orbit = inlined(is_orbit)


class Block(NamedTuple):
    """What is found of each step; row after row, the last one for a step that is tried and not plain. u unknowns, k inner impacts."""

    y: np.ndarray  # (steps + 1, u)
    tangent: np.ndarray  # (steps + 1, 2 u), or 3 u with smooth forces
    position: np.ndarray  # (steps + 1, N + 2)
    ends: np.ndarray  # (steps + 1, k + 1, N)
    result: np.ndarray  # (steps + 1, len(RESULT))
    tests: np.ndarray  # (steps + 1, tests)
    lengths: np.ndarray  # (steps + 1, 2) requested length, arclength


class WatchedTests(NamedTuple):
    """The test functions of a family, as `continuation.control` watches them."""

    kinds: np.ndarray  # of `continuation.control.kinds_of`
    singular: np.ndarray  # size below which a sign is rounding
    targets: np.ndarray  # values of the parameter that are events
    tests: int  # address of `branches.forced.kernels.forced_tests`
    work: Any  # what it needs


class TestedPoint(NamedTuple):
    """Where a step leads: a row of a `Block`."""

    y: np.ndarray  # (u,)
    tangent: np.ndarray  # (2 u,), or 3 u with smooth forces
    position: np.ndarray  # (N + 2,)
    ends: np.ndarray  # (k + 1, N)
    result: np.ndarray  # (len(RESULT),)
    tests: np.ndarray  # (tests,)


class Beginning(NamedTuple):
    """The orbit that a block of steps begins at, and the steps that led there."""

    y: np.ndarray  # (u,)
    tangent: np.ndarray  # (2 u,), or 3 u with smooth forces
    position: np.ndarray  # (N + 2,)
    tests: np.ndarray  # values of the test functions there,
    older: np.ndarray  # one step before,
    oldest: np.ndarray  # and two steps before
    before: float  # length of the last step
    first: float  # and of the one before it


class GoalPlane(NamedTuple):
    """The plane at a `continuation.problem.Goal` at right angles to its direction."""

    position: np.ndarray  # (N + 2,)
    direction: np.ndarray  # (N + 2,); nan: that of the first step


@inlined
def _tried(count, ds, waiting, initial):
    """What `advance_block` returns with a step that is not plain. While steps wait to be judged, that is the first one of the run."""
    if waiting > 0:
        return 0, 1, initial
    return count, 1, ds


@inlined
def land_tested(compiled, most, watched, y, tangent, ds, metric, point):
    """Fill the `TestedPoint` that a step of length ds from an orbit leads to. Returns whether it is an orbit; else
    its test functions are not set.

    compiled: `CompiledProblem`; where its second address is 0, the fold is the only test. most: iterations of the correction."""
    addresses, packed, factor, observed, work = compiled
    new, ahead, position, ends, result, values = point
    full = addresses[1] != 0
    set_1(result, np.nan)
    call_at(addresses[0], (packed, factor, y, tangent, Request(ds, math.nan, most), metric, Landing(new, ahead, result)))
    if result[entry.CONVERGED] != 1.0:
        return False
    for i in range(ends.shape[0]):
        for r in range(ends.shape[1]):
            ends[i, r] = factor.before[i, r]
    if full:
        call_at(addresses[1], (packed, observed, new, ends, work, result))
    for r in range(position.shape[0]):
        position[r] = metric[0, r]
    if not _is_orbit(result):
        return False
    if full:
        call_at(watched.tests, (packed, new, ends, watched.work, result, watched.targets, values))
    else:
        values[0] = result[entry.SLOPE]
    return True


@inlined
def advance(compiled, most, control, watched, beginning, goal, ds, metric, block):
    """Steps from an orbit on, into `block`.

    compiled: `CompiledProblem`; where its second address is 0, the fold is the only test. most: iterations of a correction.
    metric (5, N + 2): scratch. Returns (accepted steps, 1 where the row after them holds a step that is not plain, length of the step to
    take next)."""
    y, tangent, position, tests, older, oldest, before, first = beginning
    way = metric[4]
    for r in range(way.shape[0]):
        way[r] = goal.direction[r]
    height_old = _height(position, goal.position, way)
    # At the beginning of a run the first two steps are judged with the third, which gives their test functions a bend.
    young = before == 0.0 and block.y.shape[0] > 3
    waiting = 0
    initial = ds
    for count in range(block.y.shape[0] - 1):
        reached = TestedPoint(
            block.y[count], block.tangent[count], block.position[count], block.ends[count], block.result[count], block.tests[count]
        )
        if not land_tested(compiled, most, watched, y, tangent, ds, metric, reached):
            return _tried(count, ds, waiting, initial)
        new, ahead, place, _, result, values = reached
        turn = result[entry.TURN]
        contraction = result[entry.CONTRACTION]
        chord = _distance(position, place)
        if _refusal(turn, contraction, chord, ds, control) != ACCEPTED:
            return _tried(count, ds, waiting, initial)
        height_new = _height(place, goal.position, way)
        if height_old < 0.0 and height_new >= 0.0 and _distance(place, goal.position) <= NEAR_GOAL * chord:
            return _tried(count, ds, waiting, initial)
        length = _arclength_of(chord, turn)
        if young and count < 2:
            waiting = count + 1
        else:
            for step in range(2 - waiting, 3):
                if _watch(watched.kinds, watched.singular, _may_hide, oldest, older, tests, values, first, before, length, step):
                    return _tried(count, ds, 2 - step, initial)
            waiting = 0
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
