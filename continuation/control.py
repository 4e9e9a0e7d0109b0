"""Step control and the watch on the test functions, once: the engine calls these functions as they stand, and a problem that marches
in compiled code compiles the very same ones.

So each is a pure function of numbers and sequences (lists, tuples or arrays alike), uses nothing but `math`, and calls no other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from continuation.problem import Test
    from continuation.settings import Settings

__all__ = [
    "ACCEPTED",
    "BLOCK",
    "Control",
    "JUMPED",
    "NEAR_GOAL",
    "SLOW",
    "TURNED",
    "arclength_of",
    "control_of",
    "distance",
    "height",
    "kinds_of",
    "next_step",
    "refusal",
    "watch",
]

ACCEPTED, TURNED, SLOW, JUMPED = 0, 1, 2, 3
"""What `refusal` says of a step."""

BLOCK = 64
"""Most steps that a problem is asked to march before the engine looks up: an interruption loses no more than these."""

NEAR_GOAL = 2.0
"""A point that has just passed the goal, nearer to it than this many chords, is looked at for the closure of the family."""

_LONG_CHORD = 2.0  # a chord longer than this many times its step did not come from following the curve
_CROSSING, _GUARD, _TERMINAL_GUARD, _CHANGE = 0, 1, 2, 3


class Control(NamedTuple):
    """What of `Settings` is used at every step, as it is used there."""

    least_turn: float
    slowest: float
    turn_scale: float
    contraction_scale: float
    growth: float
    easy: float
    shortest: float
    longest: float
    dip_ratio: float


def control_of(settings: Settings) -> Control:
    """The settings as the functions here use them."""
    return Control(
        math.cos(settings.maximum_turn),
        float(settings.maximum_contraction),
        2.0 / settings.target_turn**2,  # turn angle^2 ~ 2 (1 - cosine)
        1.0 / settings.target_contraction,
        float(settings.maximum_growth),
        1.0 / settings.maximum_growth**2,
        float(settings.minimum_step),
        float(settings.maximum_step),
        float(settings.dip_ratio),
    )


def kinds_of(tests: Sequence[Test]) -> list[int]:
    """What `watch` looks for in each test function.

    Raises
    ------
    ValueError
        A kind that is not known.
    """
    known = {"crossing": _CROSSING, "guard": _GUARD, "change": _CHANGE}
    kinds = []
    for number, test in enumerate(tests):
        if test.kind not in known:
            raise ValueError(f"test function {number} ({test.code}): kind {test.kind!r}, expected crossing, guard or change")
        kinds.append(_TERMINAL_GUARD if test.kind == "guard" and test.terminal else known[test.kind])
    return kinds


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


def watch(kinds: Any, older: Any, old: Any, new: Any, before: Any, last: Any, dip_ratio: Any, places: Any) -> int:
    """Look for events in the test functions at the last three points, `before` and `last` being the arclengths between these.

    Each entry of `places` becomes nan: nothing; inf: an event for certain; else the place (0..1) in the last interval of the extremum of
    the parabola through the three values, where that dips towards zero. `older` is nan where there are two points only. Returns how many
    test functions ask for a look.
    """
    count = 0
    for i in range(len(kinds)):
        a = old[i]
        b = new[i]
        place = math.nan
        falling = False
        if kinds[i] == _CROSSING:
            if (a > 0.0) != (b > 0.0):
                if a == a and b == b:
                    place = math.inf
            else:
                falling = (a < older[i]) == (a > 0.0)  # in size
        elif kinds[i] == _CHANGE:
            if a != b and a == a and b == b:
                place = math.inf
        elif b <= 0.0:
            if a > 0.0 or (a == a and kinds[i] == _TERMINAL_GUARD):
                place = math.inf
        else:
            falling = 0.0 < a < older[i]
        if falling and a != 0.0 and before > 0.0:
            rise_before = (a - older[i]) / before
            rise_last = (b - a) / last
            curvature = (rise_last - rise_before) / (before + last)
            slope_end = rise_last + last * curvature
            slope = rise_before + before * curvature
            if (slope_end > 0.0) == (a > 0.0) and slope * slope_end < 0.0 and curvature != 0.0:
                extremum = a - slope * slope / (4.0 * curvature)
                if extremum / a < dip_ratio * min(1.0, b / a):
                    place = -slope / (2.0 * curvature) / last
        places[i] = place
        if place == place:
            count += 1
    return count
