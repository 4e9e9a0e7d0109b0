"""How long a motion that starts on a periodic orbit keeps the impact sequence of that orbit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

__all__ = ["Leaving", "leaving"]


class Leaving(NamedTuple):
    """Where a motion leaves the impact sequence of its orbit: number of the impact (from 1), its time, its stop, and that of the orbit."""

    impact: int
    time: float
    stop: str
    expected: str


def leaving(orbit: Sequence[tuple[float, str]], impacts: Sequence[tuple[float, str]]) -> Leaving | None:
    """The first impact of a motion at another stop than that of the orbit; None where there is none.

    Parameters
    ----------
    orbit : sequence of (float, str)
        Times and stops of the impacts in one period, from the start of the motion on. An impact at time 0 is the last one of the period:
        the motion starts behind it.
    impacts : sequence of (float, str)
        Of the motion.

    Examples
    --------
    >>> leaving([(1.0, "+"), (3.0, "-")], [(1.0, "+"), (1.9, "+"), (2.5, "-")])
    Leaving(impact=2, time=1.9, stop='+', expected='-')
    >>> leaving([(0.0, "+"), (3.0, "-")], [(2.8, "-"), (5.0, "+"), (7.0, "-")])
    """
    cycle = [stop for time, stop in orbit if time > 0.0] + [stop for time, stop in orbit if time <= 0.0]
    for k, (time, stop) in enumerate(impacts):
        expected = cycle[k % len(cycle)] if cycle else "none"
        if stop != expected:
            return Leaving(k + 1, time, stop, expected)
    return None
