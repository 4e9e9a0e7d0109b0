"""Step control in plain Python: the rules of `bvp/core/control.hpp`."""

from __future__ import annotations

import math
from typing import Any

from continuation.control import ACCEPTED, JUMPED, NEAR_BRANCH_POINT, SLOW, TURNED

__all__ = ["arclength_of", "distance", "height", "next_step", "refusal", "watch"]

_LONG_CHORD = 2.0  # a chord longer than this many times its step did not come from following the curve
_CROSSING, _GUARD, _TERMINAL_GUARD, _CHANGE = 0, 1, 2, 3


def distance(a: Any, b: Any) -> Any:
    """Distance of two positions."""
    total = 0.0
    for i in range(len(a)):
        total += (a[i] - b[i]) * (a[i] - b[i])
    return math.sqrt(total)


def height(position: Any, goal: Any, direction: Any) -> Any:
    """How far a position is beyond the plane through `goal` at right angles to `direction`."""
    total = 0.0
    for i in range(len(goal)):
        total += direction[i] * (position[i] - goal[i])
    return total


def arclength_of(chord: Any, turn: Any) -> Any:
    """Arclength of a step from its chord and the cosine of its turn theta: chord (theta/2)/sin(theta/2), as on a circle; of fourth order
    in the step on any smooth curve."""
    half = 0.5 * (1.0 - turn)  # sin(theta/2)^2
    if half > 1e-12:
        sine = math.sqrt(half) if half < 1.0 else 1.0
        return chord * math.asin(sine) / sine
    return chord


def refusal(turn: Any, contraction: Any, chord: Any, ds: Any, control: Any) -> int:
    """Whether a converged step of length ds is to be refused, and why: ACCEPTED, TURNED, SLOW or JUMPED."""
    if not turn >= control.least_turn:
        return TURNED
    if not contraction <= control.slowest:
        return SLOW
    if not chord <= _LONG_CHORD * ds:
        return JUMPED
    return ACCEPTED


def next_step(ds: Any, turn: Any, contraction: Any, control: Any) -> Any:
    """Length of the step after an accepted one of length ds: turn and contraction both go with its square, and are brought to their
    targets."""
    effort = max(control.turn_scale * (1.0 - turn), control.contraction_scale * contraction)
    if effort < control.easy:
        ds *= control.growth
    else:
        ds *= max(0.5, 1.0 / math.sqrt(effort))
    return min(max(ds, control.shortest), control.longest)


def watch(
    kinds: Any, singular: Any, hides: Any, oldest: Any, older: Any, old: Any, new: Any, first: Any, before: Any, last: Any, step: int = 2
) -> bool:
    """Whether a step has to be searched for events, from the test functions at four consecutive points.

    step: which of the three steps between the points, by default the last one. singular: `TestFunction.singular` of each. hides:
    `may_hide`. first, before, last: the arclengths between the points. Where there are fewer points, `oldest` or `older` is nan. Then the
    step is searched, because the bends of its test functions are not known.
    """
    begin = (oldest, older, old)[step]
    end = (older, old, new)[step]
    length = (first, before, last)[step]
    for i in range(len(kinds)):
        a = begin[i]
        b = end[i]
        if a != a or b != b:
            continue
        if kinds[i] == _CHANGE:
            if a != b:
                return True
            continue
        if (a > 0.0) != (b > 0.0):
            if kinds[i] == _CROSSING or a > 0.0:
                return True
            continue
        if kinds[i] != _CROSSING and not a > 0.0:
            if kinds[i] == _TERMINAL_GUARD:
                return True
            continue
        if oldest[i] != oldest[i] or older[i] != older[i] or old[i] != old[i] or new[i] != new[i]:
            return True
        if singular[i] > 0.0 and abs(b) < NEAR_BRANCH_POINT * abs(a):
            return True
        rise = (old[i] - older[i]) / before
        bend = ((new[i] - old[i]) / last - rise) / (before + last)
        beside = (rise - (older[i] - oldest[i]) / first) / (first + before)
        if hides(a, b, length, bend, beside):
            return True
    return False
