"""The parameter of a start as a function of x in [0, 1]: linear, or quadratic at an end where everything goes with the square root of the
distance."""

import math

from bvp.kernels.compiled import kernel

__all__ = ["place", "unplace"]


@kernel
def place(low, high, kind, x):
    """Parameter of the start at x in [0, 1], and its derivative. kind: 0 linear, 1 quadratic at the low end, 2 at the high end, 3 both."""
    span = high - low
    if kind == 0:
        return low + span * x, span
    if kind == 1:
        return low + span * x * x, 2.0 * span * x
    if kind == 2:
        return high - span * (1.0 - x) * (1.0 - x), 2.0 * span * (1.0 - x)
    s = math.sin(0.5 * math.pi * x)
    return low + span * s * s, 0.5 * math.pi * span * math.sin(math.pi * x)


@kernel
def unplace(low, high, kind, theta):
    """x of a parameter, the inverse of `place`."""
    part = (theta - low) / (high - low)
    if kind == 0:
        return part
    if kind == 1:
        return math.sqrt(max(part, 0.0))
    if kind == 2:
        return 1.0 - math.sqrt(max((high - theta) / (high - low), 0.0))
    if part < 0.5:
        return 2.0 / math.pi * math.asin(math.sqrt(max(part, 0.0)))
    return 1.0 - 2.0 / math.pi * math.asin(math.sqrt(max((high - theta) / (high - low), 0.0)))
