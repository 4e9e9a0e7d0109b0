"""Where a family that is known by points reaches an energy or a quarter period, by linear interpolation."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from branches.name_errors import PIN_TOLERANCE

__all__ = ["Crossing", "Track", "crossings", "nearest_crossing", "reaches"]

_ROUNDED = 1e-5
"""How far outside a family, relatively, an orbit is that is named by the printed digits of the family's end."""

Track = Sequence[tuple[float, float, str]]
"""h, alpha and label of the points of a family, in their order."""

Crossing = tuple[float, float]
"""h and alpha of an orbit."""


def reaches(ends: tuple[float, float], value: float) -> bool:
    """Whether a range holds a value, or ends so near to it that printed digits do not tell them apart.

    Examples
    --------
    >>> reaches((0.118507810594, 14.5537010891), 0.1185078), reaches((0.118507810594, 14.5537010891), 14.56)
    (True, False)
    """
    return ends[0] * (1.0 - _ROUNDED) <= value <= ends[1] * (1.0 + _ROUNDED)


def crossings(track: Track, key: int, value: float, fits: Callable[[str], bool] | None = None) -> list[Crossing]:
    """Where a track reaches a value of h (key 0) or alpha (key 1), between points of which one has a label that fits.

    Examples
    --------
    >>> crossings([(1.0, 2.0, "S13O00+"), (3.0, 1.0, "S13O00+")], 0, 2.0)
    [(2.0, 1.5)]
    >>> crossings([(1.0, 2.0, "S13O00+"), (3.0, 1.0, "S13O00+")], 0, 3.0)
    [(3.0, 1.0), (3.0, 1.0)]
    """
    out = []
    for one, other in zip(track, [*track[1:], track[-1]], strict=True):
        before, after = one[:2][key] - value, other[:2][key] - value
        if before * after > 0.0 and abs(before) > _ROUNDED * value:
            continue
        if fits is not None and not (fits(one[2]) or fits(other[2])):
            continue
        part = before / (before - after) if before * after <= 0.0 and before != after else 0.0
        out.append((one[0] + part * (other[0] - one[0]), one[1] + part * (other[1] - one[1])))
    return out


def nearest_crossing(
    track: Track, h: float | None, alpha: float | None, fits: Callable[[str], bool] | None = None
) -> tuple[float, Crossing] | None:
    """The orbit at an energy, a quarter period, or an energy with the quarter period nearest to one: how far that is off, relatively, and
    the orbit; None where there is none, or none within `PIN_TOLERANCE`.

    Raises
    ------
    ValueError
        Without h and alpha.
    """
    if h is None and alpha is None:
        raise ValueError("neither h nor alpha is given, expected one or both")
    best: tuple[float, Crossing] | None = None
    for crossing in crossings(track, 1, alpha, fits) if h is None and alpha is not None else crossings(track, 0, h or 0.0, fits):
        miss = abs(crossing[1] / alpha - 1.0) if h is not None and alpha is not None else 0.0
        if miss < (best[0] if best else PIN_TOLERANCE):
            best = (miss, crossing)
    return best
