"""The id of a curve, and whether one curve contains another."""

from __future__ import annotations

import hashlib

import numpy as np

from branches.curves.record import BifurcationCurve
from branches.forced.identity import invariants

__all__ = ["canonical_names", "curve_id", "curve_numbers"]

_DIGITS = 6
"""Significant digits of the numbers in a hash: events are located to 1e-10."""

_EXTREME_DIGITS = 3
"""The same of the extremes of a closed curve without events, which lie between its points."""

_ZERO = 1e-9
"""A number that counts as zero."""


def canonical_names(curve: BifurcationCurve) -> tuple[str, str]:
    """The two parameters in the order of the alphabet."""
    first, second = sorted(curve.names)
    return first, second


def curve_id(curve: BifurcationCurve) -> str:
    """The id of a curve, `code:names:hash`, such as "PD:s,w:1b4d6a7c".

    The hash is that of its points of codimension two and its ends, rounded to six digits. It depends neither on the point that the curve
    was started from, nor on its direction and its steps, but on the ranges in which it was followed.
    """
    names = canonical_names(curve)
    order = [curve.names.index(name) for name in names]
    marks = [f"{event.type} {_rounded(curve.parameters[event.point, order], _DIGITS)}" for event in curve.events]
    if not marks and curve.closed:
        low, high = (_extremes(curve, sign)[order] for sign in (-1.0, 1.0))
        marks = [f"closed {_rounded(low, _EXTREME_DIGITS)} {_rounded(high, _EXTREME_DIGITS)}"]
    elif not marks:
        marks = [_rounded(curve.parameters[place, order], _DIGITS) for place in (0, -1)]
    text = "\n".join((curve.code, ",".join(names), *sorted(marks)))
    return f"{curve.code}:{','.join(names)}:{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def _extremes(curve: BifurcationCurve, sign: float) -> np.ndarray:
    """The largest value of each parameter along a closed curve, or the least one (sign -1): that of the cubic polynomials with the values
    and slopes of its points, beside the point that has the largest one."""
    count, u, found = len(curve) - 1, curve.plane.size, np.empty(2)
    for k in range(2):
        values = curve.parameters[:, k]
        best = int(np.argmax(sign * values[:count]))
        found[k] = values[best]
        for i in ((best - 1) % count, best):
            length = float(curve.arclength[i + 1] - curve.arclength[i])
            rows = [curve.plane.linearised(curve.unknowns[j, :u]).gradients[k] for j in (i, i + 1)]
            first, last = (length * float(row @ curve.tangents[j, :u]) for row, j in zip(rows, (i, i + 1), strict=True))
            change = float(values[i + 1] - values[i])
            cubic = np.array([first + last - 2.0 * change, 3.0 * change - 2.0 * first - last, first, values[i]])
            turns = [at.real for at in np.roots(np.polyder(cubic)) if at.imag == 0.0 and 0.0 < at.real < 1.0]
            found[k] = sign * max(sign * value for value in (found[k], *np.polyval(cubic, turns)))
    return found


def _rounded(values: np.ndarray, digits: int) -> str:
    return " ".join(f"{0.0 if abs(value) < _ZERO else value:.{digits - 1}e}" for value in values.tolist())


def curve_numbers(curve: BifurcationCurve) -> np.ndarray:
    """Numbers of the orbits of a curve that no image of them changes, (N, 6): both parameters in the order of the alphabet, then the
    others of `branches.forced.identity.invariants`."""
    u, order = curve.plane.size, [curve.names.index(name) for name in canonical_names(curve)]
    numbers = [invariants(curve.plane.problem, y[:u])[1:] for y in curve.unknowns]
    return np.column_stack([curve.parameters[:, order], np.array(numbers)])
