"""Root of a function in a bracket, with few evaluations: each can be a corrected point of a family.

The other functions are arithmetic on sequences or arrays. Kernels compile the same functions.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable
from itertools import chain
from typing import Any, NamedTuple

__all__ = ["MOST_INTERPOLATED", "RootBracket", "StepRefused", "bracketed_root", "inverse_interpolation", "is_slow", "next_place"]

MOST_INTERPOLATED = 6
"""Samples that are interpolated, at most."""

_ROUNDING = 2.0**-51
"""Least distance of two places, as a part of their size."""

_SLOW = 0.1  # bisection follows where neither the bracket is halved nor the value at an end goes down to this part
_APART = 0.05  # least distance of samples that are interpolated, as a part of the bracket
_OTHER_PLACES = (0.5, 0.25, 0.75, 0.1, 0.9, 0.03, 0.97)  # tried in a bracket whose best place, and what is near it, is refused
_BESIDE = (0.99, 8.0, 64.0, 512.0, 4096.0, 32768.0)
"""Distances from a root that is refused, in smallest useful ones. With the first on either side the bracket is narrow enough."""
_REFUSALS = 3  # after so many at the best place, a bracket that is narrow enough is accepted without a value at its root


class StepRefused(RuntimeError):
    """A step inside an accepted step cannot be taken; the message says why."""


class RootBracket(NamedTuple):
    """The best argument `root` with its `value`, in [`low`, `high`]; `interrupted` says why the search stopped early."""

    root: float
    value: float
    low: float
    high: float
    interrupted: str = ""


def bracketed_root(
    function: Callable[[float], float],
    low: float,
    value_low: float,
    high: float,
    value_high: float,
    tolerance: float,
    coarse: float = 0.0,
    known: Iterable[tuple[float, float]] = (),
) -> RootBracket:
    """Root of a function in a bracket by inverse interpolation of up to fifth order, and bisection where that is slow.

    Both ends close in, so the final bracket is an error bar. A function that changes sign by a jump or a pole is bracketed
    too; its `value` then shows it.

    Parameters
    ----------
    function : callable
        Takes a float, gives a float. It may raise `StepRefused`; then other places in the bracket are tried.
    low, high, value_low, value_high : float
        Ends of the bracket, low < high, and the function there, of different sign (one may be 0).
    tolerance, coarse : float
        Width of the final bracket, and of one that does where the function cannot be evaluated at the best places inside.
    known : iterable of (float, float)
        Places outside the bracket, with the values of the function there.

    Raises
    ------
    ValueError
        The values have the same sign, or one is nan.

    Examples
    --------
    >>> found = bracketed_root(lambda x: x * x - 2, 0.0, -2.0, 2.0, 2.0, 1e-12)
    >>> abs(found.root - 2**0.5) < 1e-12, found.low <= 2**0.5 <= found.high
    (True, True)
    """
    if value_low == 0:
        return RootBracket(low, 0.0, low, low)
    if value_high == 0:
        return RootBracket(high, 0.0, high, high)
    if not (value_low < 0 < value_high or value_high < 0 < value_low):
        raise ValueError(f"expected values of different sign at the ends of the bracket, got {value_low!r} and {value_high!r}")
    places, values = (list(column) for column in zip(*sorted([*known, (low, value_low), (high, value_high)]), strict=True))
    at = bisect_left(places, high)  # the bracket is between this sample and the one before it
    scratch = [0.0] * MOST_INTERPOLATED, [0.0] * MOST_INTERPOLATED
    slow, refusals = False, 0
    refused: dict[float, str] = {}
    while True:
        low, high = places[at - 1 : at + 1]
        width = high - low
        interrupted = ""
        fraction, least = next_place(inverse_interpolation, places, values, len(places), at, tolerance, slow, *scratch)
        if least > 0.5:
            break
        parts: Iterable[float] = (fraction,)
        if refusals < _REFUSALS or width > coarse:
            nearby = (fraction + sign * factor * least for sign in (1.0, -1.0) for factor in _BESIDE)
            parts = chain(parts, (part for part in nearby if least <= part <= 1.0 - least), _OTHER_PLACES)
        for part in parts:
            trial = low + part * width
            reason = next((text for place, text in refused.items() if abs(place - trial) < 0.25 * tolerance), "")
            if not reason:
                try:
                    value = function(trial)
                    break
                except StepRefused as error:
                    reason = refused[trial] = str(error)
            refusals += not interrupted
            interrupted = reason
        else:
            break
        if value == 0:
            return RootBracket(trial, 0.0, trial, trial)
        is_beyond = (value > 0) == (values[at] > 0)
        slow = is_slow(part, value, values[at - 1], values[at])
        places.insert(at, trial)
        values.insert(at, value)
        at += not is_beyond
    best = at - 1 if abs(values[at - 1]) <= abs(values[at]) else at
    return RootBracket(places[best], values[best], places[at - 1], places[at], interrupted)


def next_place(
    interpolate: Any, places: Any, values: Any, count: Any, at: Any, tolerance: Any, slow: Any, x: Any, v: Any
) -> tuple[Any, Any]:
    """Where to look next for a zero between samples `at` - 1 and `at` of `count`, as a part of the bracket; and the least part that is of
    use. If that is above 0.5, the bracket is narrow enough.

    interpolate: `inverse_interpolation`. slow: whether to bisect. x, v (MOST_INTERPOLATED,): scratch."""
    low = places[at - 1]
    high = places[at]
    width = high - low
    # The ends of the bracket may be nearer to the root than this part of it.
    least = max(0.5 * tolerance, _ROUNDING * max(abs(low), abs(high))) / width
    if least > 0.5:
        return 0.5, least
    fraction = 0.5
    if not slow:
        fraction = (interpolate(places, values, count, at, x, v) - low) / width
        if not -least <= fraction <= 1.0 + least:
            fraction = 0.5
    return min(max(fraction, least), 1.0 - least), least


def is_slow(part: Any, value: Any, value_low: Any, value_high: Any) -> Any:
    """Whether to bisect next, from the value at a part of a bracket and those at its ends: neither was the bracket halved, nor did the
    value at an end go down much."""
    if (value > 0.0) == (value_high > 0.0):
        return part > 0.5 and abs(value) > _SLOW * abs(value_high)
    return 1.0 - part > 0.5 and abs(value) > _SLOW * abs(value_low)


def inverse_interpolation(places: Any, values: Any, count: Any, at: Any, x: Any, v: Any) -> Any:
    """Where a function is zero between sample at - 1 and sample `at`: the place as a polynomial of the value, by Neville's scheme, through
    these two and up to two more on either side, neither too near to the others nor beyond an extremum. x, v: scratch."""
    x[0], x[1] = places[at - 1], places[at]
    v[0], v[1] = values[at - 1], values[at]
    least = _APART * (x[1] - x[0])
    rise = v[1] - v[0]
    size = 2
    for side in range(2):
        last = side
        wanted = size + 2
        i = at + 1 if side == 1 else at - 2
        while size < wanted and 0 <= i < count and (values[i] - v[last]) * (rise if side == 1 else -rise) > 0.0:
            if abs(places[i] - x[last]) > least:
                x[size] = places[i]
                v[size] = values[i]
                last = size
                size += 1
            i += 1 if side == 1 else -1
    for k in range(1, size):
        for i in range(size - k):
            x[i] = (v[i + k] * x[i] - v[i] * x[i + 1]) / (v[i + k] - v[i])
    return x[0]
