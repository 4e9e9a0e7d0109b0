"""The steps inside a step of a family: where test functions are to be sampled, and the bracket of a zero.

All is the arithmetic of `continuation`, compiled. The bracket closes in as in `continuation.bracketing.bracketed_root`. What cannot be done
here - a step that is refused, a value that is not known - is left to that function.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from branches.kernels.blocks import TestedPoint, WatchedTests, land_tested
from branches.kernels.control import may_hide
from bvp.kernels import multipoint as entry
from bvp.kernels.compiled import inlined, kernel
from bvp.kernels.flight import copy_1
from continuation.between import cubic_between, goes_aside
from continuation.bracketing import MOST_INTERPOLATED, inverse_interpolation, is_slow, next_place
from continuation.resolution import longest_division, nodes_around, scan, second_differences

__all__ = [
    "MOST", "PASSED_OVER", "REFUSED", "BracketWork", "Departure", "Known", "Sought", "make_bracket", "narrow",
    "scan_tests",
]  # fmt: skip

MOST = 40
"""Steps that close in on a zero in one call."""

_next_place = inlined(next_place)
_inverse_interpolation = inlined(inverse_interpolation)
_is_slow = inlined(is_slow)
_cubic_between = inlined(cubic_between)
_goes_aside = inlined(goes_aside)
_may_hide = inlined(may_hide)
_second_differences = inlined(second_differences)
_nodes_around = inlined(nodes_around)
_longest_division = inlined(longest_division)
_scan = inlined(scan)

LANDED, REFUSED, TURNED, PASSED_OVER = range(4)
"""Where a step leads: to an orbit; to none; to one whose tangent is rotated too far; to one of another family."""


class Departure(NamedTuple):
    """An orbit that steps are taken from, and what takes them."""

    compiled: Any  # `CompiledProblem`
    most: int  # iterations of a correction
    watched: WatchedTests
    y: np.ndarray  # (u,)
    tangent: np.ndarray  # (u,) at least
    metric: np.ndarray  # (4, N + 2) scratch, at least


class Known(NamedTuple):
    """A known step from an orbit."""

    length: float
    y: np.ndarray  # (u,)
    tangent: np.ndarray  # (u,) at least; not unit: see `turn`
    turn: float


class BracketWork(NamedTuple):
    """Values of a test function in order of their places, and scratch for u unknowns."""

    places: np.ndarray  # (room,)
    values: np.ndarray  # (room,)
    near: np.ndarray  # (2, u) the unknowns at both ends of the bracket,
    slopes: np.ndarray  # (2, u) and their derivatives by the length of the step
    along: np.ndarray  # (2 u,)
    work: np.ndarray  # (u,)
    interpolated: np.ndarray  # (2, MOST_INTERPOLATED)


def make_bracket(samples, unknowns):
    """A `BracketWork` from pairs of place and value, with room for `MOST` more."""
    places, values = np.zeros((2, len(samples) + MOST))
    if samples:
        places[: len(samples)], values[: len(samples)] = zip(*samples, strict=True)
    square = (2, unknowns)
    return BracketWork(
        places, values, np.zeros(square), np.zeros(square), np.zeros(2 * unknowns), np.zeros(unknowns), np.zeros((2, MOST_INTERPOLATED))
    )


class Sought(NamedTuple):
    """What is sought: a step of given length, or a zero between two samples."""

    length: float  # nan: a zero
    test: int  # number of the test function
    tolerance: float  # width of the final bracket
    least_turn: float  # cosine of the largest rotation of a tangent
    known: int  # samples
    at: int  # the zero is between this sample and the one before it


@inlined
def _put(known, end, samples):
    """Make a known step an end of the bracket."""
    for j in range(samples.work.shape[0]):
        samples.near[end, j] = known.y[j]
        samples.slopes[end, j] = known.tangent[j] / known.turn


@inlined
def _land_between(departure, low, high, s, least_turn, samples, point):
    """Fill the `TestedPoint` of the step of length s, between the ends of the bracket at `low` and `high`.

    Returns LANDED, REFUSED, TURNED or PASSED_OVER."""
    compiled, most, watched, y, tangent, metric = departure
    guess, along, slope = samples.work, samples.along, samples.work
    unknowns = y.shape[0]
    _cubic_between(samples.near[0], samples.slopes[0], samples.near[1], samples.slopes[1], low, high, s, guess)
    # The prediction is y + s (tangent + s/2 curvature).
    for j in range(unknowns):
        along[j] = tangent[j]
        along[unknowns + j] = 2.0 * (guess[j] - y[j] - s * tangent[j]) / (s * s)
    if not land_tested(compiled, most, watched, y, along, s, metric, point):
        return REFUSED
    turn = point.result[entry.TURN]
    if not turn >= least_turn:
        return TURNED
    for j in range(unknowns):
        slope[j] = point.tangent[j] / turn
    if _goes_aside(samples.slopes[0], samples.slopes[1], (s - low) / (high - low), slope):
        return PASSED_OVER
    return LANDED


@inlined
def narrow(departure, low, high, sought, samples, block):
    """Take one step between two known steps from an orbit, or close in on a zero of a test function: these are the ends of the bracket.

    Returns the number of steps taken, in the rows of the block; and LANDED, or why the row after them holds none. The search ends with a
    narrow bracket, an exact zero, a value that is not known, or a step that is refused."""
    places, values = samples.places, samples.values
    count, at = sought.known, sought.at
    first, last = low.length, high.length
    slow = False
    _put(low, 0, samples)
    _put(high, 1, samples)
    for row in range(block.y.shape[0]):
        s = sought.length
        part = 0.5
        if s != s:
            part, least = _next_place(
                _inverse_interpolation, places, values, count, at, sought.tolerance, slow,
                samples.interpolated[0], samples.interpolated[1],
            )  # fmt: skip
            if least > 0.5:
                return row, LANDED
            s = first + part * (last - first)
        point = TestedPoint(block.y[row], block.tangent[row], block.position[row], block.ends[row], block.result[row], block.tests[row])
        answer = _land_between(departure, first, last, s, sought.least_turn, samples, point)
        if answer != LANDED:
            return row, answer
        block.lengths[row, 0] = s
        value = point.tests[sought.test]
        if value != value or value == 0.0 or row + 1 == block.y.shape[0]:
            return row + 1, LANDED
        slow = _is_slow(part, value, values[at - 1], values[at])
        is_beyond = (value > 0.0) == (values[at] > 0.0)
        for i in range(count, at, -1):
            places[i] = places[i - 1]
            values[i] = values[i - 1]
        places[at] = s
        values[at] = value
        count += 1
        end = 1 if is_beyond else 0
        if is_beyond:
            last = s
        else:
            first = s
            at += 1
        copy_1(point.y, samples.near[end])
        copy_1(samples.work, samples.slopes[end])
    return 0, LANDED


@kernel
def scan_tests(sampled, tests, begin, limit, guard, floor):
    """See `continuation.resolution.scan`."""
    return _scan(_longest_division, _may_hide, _nodes_around, _second_differences, sampled, tests, begin, limit, guard, floor)
