"""Settings of a run, and step control: it accepts or rejects a step, chooses the next length, and selects steps to search for events.

The rules are those of the compiled core (`bvp/core/control.hpp`), where a problem that advances in compiled code uses them, too: pure
functions of numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import saltus_core

from bvp.functions import cos

if TYPE_CHECKING:
    from continuation.problem import TestFunction

__all__ = [
    "ACCEPTED", "BLOCK", "Control", "JUMPED", "NEAR_BRANCH_POINT", "NEAR_GOAL", "NOT_CONVERGED", "SLOW", "Settings", "SettingsError",
    "TURNED", "arclength_of", "control_of", "distance", "height", "kinds_of", "may_hide", "next_step", "refusal", "watch",
]  # fmt: skip

ACCEPTED, NOT_CONVERGED, SLOW, TURNED, JUMPED = range(5)
"""Verdicts on a step, in the order of `continuation.problem.Tally`."""

NEAR_BRANCH_POINT = 0.1
"""A test function for branch points falls below this part of its size before, if a branch point is near."""

BLOCK = 256
"""Largest number of steps in one call of a problem's `advance`. An interrupt loses at most these steps."""

NEAR_GOAL = 2.0
"""A point that has just passed the goal, nearer to it than this many chords, may be the goal itself: the family may close."""

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


def control_of(settings: Settings) -> Control:
    """The settings as the functions here use them."""
    return Control(
        float(cos(settings.maximum_turn)),
        float(settings.maximum_contraction),
        2.0 / settings.target_turn**2,  # turn angle^2 ~ 2 (1 - cosine)
        1.0 / settings.target_contraction,
        float(settings.maximum_growth),
        1.0 / settings.maximum_growth**2,
        float(settings.minimum_step),
        float(settings.maximum_step),
    )


def kinds_of(tests: Sequence[TestFunction]) -> list[int]:
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


def distance(a: Any, b: Any) -> float:
    """Distance of two positions, sequences or arrays."""
    found: float = saltus_core.distance(a, b)
    return found


def height(position: Any, goal: Any, direction: Any) -> float:
    """How far a position is beyond the plane through `goal` at right angles to `direction`."""
    found: float = saltus_core.height(position, goal, direction)
    return found


def arclength_of(chord: float, turn: float) -> float:
    """Arclength of a step from its chord and the cosine of its turn theta: chord (theta/2)/sin(theta/2), as on a circle; of fourth order
    in the step on any smooth curve."""
    found: float = saltus_core.arclength_of(chord, turn)
    return found


def refusal(turn: float, contraction: float, chord: float, ds: float, control: Control) -> int:
    """Whether a converged step of length ds is to be refused, and why: ACCEPTED, TURNED, SLOW or JUMPED."""
    found: int = saltus_core.refusal(turn, contraction, chord, ds, control)
    return found


def next_step(ds: float, turn: float, contraction: float, control: Control) -> float:
    """Length of the step after an accepted one of length ds: turn and contraction both go with its square, and are brought to their
    targets."""
    found: float = saltus_core.next_step(ds, turn, contraction, control)
    return found


def may_hide(a: float, b: float, length: float, bend: float, beside: float) -> bool:
    """Whether a function can pass zero twice inside an interval at whose ends it has the values a and b of one sign.

    bend, beside: its second divided differences over the interval and one neighbouring point, and next to these."""
    found: bool = saltus_core.may_hide(a, b, length, bend, beside)
    return found


def watch(
    kinds: Sequence[int], singular: Sequence[float], points: Sequence[Sequence[float]], lengths: Sequence[float], step: int = 2
) -> bool:
    """Whether a step has to be searched for events, from the test functions at four consecutive points.

    step: which of the three steps between the points, by default the last one. singular: `TestFunction.singular` of each. lengths: the
    arclengths between the points. Where there are fewer points, the first values are nan. Then the step is searched, because the bends of
    its test functions are not known.
    """
    found: bool = saltus_core.watch(kinds, singular, *points, *lengths, step)
    return found


class SettingsError(ValueError):
    """A setting has a value that cannot be used; the message names the field."""


@dataclass(frozen=True)
class Settings:
    """How a family is followed.

    Lengths are arclengths in the problem's own metric; the defaults suit families that are of order 1 to 10 long there.

    ====================== ========= =====================================================================
    field                  default   meaning
    ====================== ========= =====================================================================
    initial_step           0.02      length of the first step
    minimum_step           1e-7      a step refused at this length ends the family
    maximum_step           0.2       no step is longer
    target_turn            0.1       angle in radians between successive tangents that the steps aim at
    maximum_turn           0.4       a step whose tangent rotates by more radians is refused
    target_contraction     0.05      contraction of the corrector that the steps aim at
    maximum_contraction    0.5       a step whose corrector contracts no better is refused
    maximum_growth         2.0       a step is at most this many times as long as the one before
    maximum_points         1000      points in total, event points and the start counted; reaching it is an end
    location_tolerance     1e-10     width in arclength of the interval in which an event is bracketed
    coincidence_tolerance  1e-6      events nearer than this may be one event; also how near to its start a family closes
    ====================== ========= =====================================================================

    Raises
    ------
    SettingsError
        A value is no finite number, is out of range, or contradicts another; the message names the fields.

    Examples
    --------
    >>> Settings(maximum_step=0.5).initial_step
    0.02
    >>> Settings(minimum_step=0.1)
    Traceback (most recent call last):
    ...
    continuation.control.SettingsError: minimum_step = 0.1 is larger than initial_step = 0.02; make it smaller
    """

    initial_step: float = 0.02
    minimum_step: float = 1e-7
    maximum_step: float = 0.2
    target_turn: float = 0.1
    maximum_turn: float = 0.4
    target_contraction: float = 0.05
    maximum_contraction: float = 0.5
    maximum_growth: float = 2.0
    maximum_points: int = 1000
    location_tolerance: float = 1e-10
    coincidence_tolerance: float = 1e-6

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise SettingsError(f"{field.name} = {value!r}: expected a finite number")
            if not value > 0:
                raise SettingsError(f"{field.name} = {value!r}: expected a number above 0")
        if int(self.maximum_points) != self.maximum_points:
            raise SettingsError(f"maximum_points = {self.maximum_points!r}: expected an integer")
        if not self.maximum_turn < math.pi / 2:
            raise SettingsError(f"maximum_turn = {self.maximum_turn!r}: expected an angle below pi/2 radians")
        if not self.maximum_contraction < 1:
            raise SettingsError(f"maximum_contraction = {self.maximum_contraction!r}: expected a number below 1")
        if not self.maximum_growth > 1:
            raise SettingsError(f"maximum_growth = {self.maximum_growth!r}: expected a number above 1")
        for small, large in (
            ("minimum_step", "initial_step"),
            ("initial_step", "maximum_step"),
            ("target_turn", "maximum_turn"),
            ("target_contraction", "maximum_contraction"),
            ("location_tolerance", "coincidence_tolerance"),
        ):
            if getattr(self, small) > getattr(self, large):
                raise SettingsError(
                    f"{small} = {getattr(self, small)!r} is larger than {large} = {getattr(self, large)!r}; make it smaller"
                )
