"""The settings of a run: step control, limits and tolerances; checked when made."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields


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
    maximum_turn           0.4       a step whose tangent turns by more radians is refused
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
    continuation.settings.SettingsError: minimum_step = 0.1 is larger than initial_step = 0.02; make it smaller
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
            raise SettingsError(f"maximum_points = {self.maximum_points!r}: expected a whole number")
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
