"""Root of a function in a bracket, with few evaluations: each can be a corrected point of a family."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import chain
from typing import NamedTuple

__all__ = ["RootBracket", "StepRefused", "bracketed_root"]

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
    samples = sorted([*known, (low, value_low), (high, value_high)])
    at = samples.index((high, value_high))  # the bracket is between this sample and the one before it
    slow, refusals = False, 0
    refused: dict[float, str] = {}
    while True:
        (low, value_low), (high, value_high) = samples[at - 1 : at + 1]
        width = high - low
        # The ends of the bracket may be nearer to the root than this part of it.
        least = max(0.5 * tolerance, 2 * math.ulp(max(abs(low), abs(high)))) / width
        interrupted = ""
        if least > 0.5:
            break
        fraction = 0.5 if slow else (_inverse_interpolation(samples, at) - low) / width
        if not -least <= fraction <= 1.0 + least:
            fraction = 0.5
        fraction = min(max(fraction, least), 1 - least)
        places: Iterable[float] = (fraction,)
        if refusals < _REFUSALS or width > coarse:
            nearby = (fraction + sign * factor * least for sign in (1.0, -1.0) for factor in _BESIDE)
            places = chain(places, (part for part in nearby if least <= part <= 1.0 - least), _OTHER_PLACES)
        for part in places:
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
        samples.insert(at, (trial, value))
        if (value > 0) == (value_high > 0):
            left, replaced = part, value_high
        else:
            left, replaced = 1 - part, value_low
            at += 1
        slow = left > 0.5 and abs(value) > _SLOW * abs(replaced)
    root, value = min(samples[at - 1 : at + 1], key=lambda sample: abs(sample[1]))
    return RootBracket(root, value, low, high, interrupted)


def _inverse_interpolation(samples: list[tuple[float, float]], at: int) -> float:
    """Where a function is zero between sample at - 1 and sample `at`, (place, value) each: the place as a polynomial of the value, by
    Neville's scheme, through these two and up to two more on either side, neither too near to the others nor beyond an extremum."""
    low, high = chosen = samples[at - 1 : at + 1]
    least, rise = _APART * (high[0] - low[0]), high[1] - low[1]
    for last, way, beyond in ((low, -rise, reversed(samples[: at - 1])), (high, rise, iter(samples[at + 1 :]))):
        wanted = len(chosen) + 2
        while len(chosen) < wanted and (sample := next(beyond, None)) and (sample[1] - last[1]) * way > 0.0:
            if abs(sample[0] - last[0]) > least:
                chosen.append(sample)
                last = sample
    places, values = (list(numbers) for numbers in zip(*chosen, strict=True))
    for k in range(1, len(places)):
        for i in range(len(places) - k):
            places[i] = (values[i + k] * places[i] - values[i] * places[i + 1]) / (values[i + k] - values[i])
    return places[0]
