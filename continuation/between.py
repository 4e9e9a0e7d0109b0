"""Steps between two known steps from one point: where the unknowns are to be expected, and whether a step went over to another family.

Arithmetic on sequences or arrays. Kernels compile the same functions.
"""

from __future__ import annotations

import math
from typing import Any

__all__ = ["ASIDE", "cubic_between", "goes_aside"]

ASIDE = 0.2
"""Relative difference of the direction of the unknowns from that between its neighbours, beyond their own difference."""


def cubic_between(first: Any, slope: Any, last: Any, other: Any, low: Any, high: Any, s: Any, out: Any) -> None:
    """out = the cubic through the unknowns `first` at `low` and `last` at `high`, with their derivatives there, at s."""
    width = high - low
    part = (s - low) / width
    for j in range(len(out)):
        change = part * part * (3.0 - 2.0 * part) * (last[j] - first[j])
        out[j] = first[j] + change + width * part * (1.0 - part) * ((1.0 - part) * slope[j] - part * other[j])


def goes_aside(slope: Any, other: Any, part: Any, found: Any) -> Any:
    """Whether the derivative `found` of the unknowns, at a part of the way between two known ones, is far from both: the step is on another
    family."""
    change = expected = aside = 0.0
    for j in range(len(found)):
        difference = other[j] - slope[j]
        middle = slope[j] + part * difference
        away = found[j] - middle
        change += difference * difference
        expected += middle * middle
        aside += away * away
    return math.sqrt(aside) > math.sqrt(change) + ASIDE * math.sqrt(expected)
