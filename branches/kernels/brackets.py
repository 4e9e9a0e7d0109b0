"""Where test functions are to be sampled inside the steps of a family: the arithmetic of `continuation.resolution`, compiled."""

from __future__ import annotations

import math
from typing import Any

from bvp.kernels.compiled import inlined, kernel
from continuation.resolution import longest_division, nodes_around, scan, second_differences

__all__ = ["may_hide", "scan_tests"]


def may_hide(a: Any, b: Any, length: Any, bend: Any, beside: Any) -> bool:
    """Whether a function can pass zero twice inside an interval at whose ends it has the values a and b of one sign.

    bend, beside: its second divided differences over the interval and one neighbouring point, and next to these. The function is
    replaced by the parabola through both ends with the larger bend towards zero, increased by the difference of the two: the error of the
    interpolant. That parabola c (x - p)(q - x) reaches zero where c length^2 = (sqrt(a) + sqrt(b))^2.
    """
    if a < 0.0:
        a, b, bend, beside = -a, -b, -bend, -beside
    bulge = (max(bend, beside) + abs(bend - beside)) * length * length
    if bulge <= a + b:
        return False
    return bulge > a + b + 2.0 * math.sqrt(a * b)


_may_hide = inlined(may_hide)
_second_differences = inlined(second_differences)
_nodes_around = inlined(nodes_around)
_longest_division = inlined(longest_division)
_scan = inlined(scan)


@kernel
def scan_tests(sampled, tests, begin, limit, guard, floor):
    """See `continuation.resolution.scan`."""
    return _scan(_longest_division, _may_hide, _nodes_around, _second_differences, sampled, tests, begin, limit, guard, floor)
