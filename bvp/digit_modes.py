"""The modes of an undamped system, free flight and elastic impacts in fifty digits."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import mpmath as mp

from bvp.system import ImpactSystem

__all__ = ["DIGITS", "DigitModes", "digit_modes", "dot"]

DIGITS = 50
"""Decimal digits of the arithmetic."""


class DigitModes:
    """Modes of an undamped system in many digits; a modal state is a list of n displacements and n velocities.

    Parameters
    ----------
    system : ImpactSystem
        Conservative; its numbers are taken as the binary fractions that they are.

    Attributes
    ----------
    squares : list of n mpf
        Of the frequencies, ascending; exactly 0 for a rigid-body mode, negative where the stiffness is.
    shapes : (n, n) mp.matrix
        Mass-normalised, one a column.
    gaps : list of (list of n mpf)
        c . phi_k for each stop.
    lengths : list of mpf
        Squares of the lengths of these rows.
    """

    def __init__(self, system: ImpactSystem) -> None:
        reason = system.why_not_conservative()
        if reason is not None:
            raise ValueError(f"periodic orbits in many digits need a conservative system: {reason}")
        with mp.workdps(DIGITS):
            self.mass = mp.matrix(system.mass.tolist())
            lower = mp.cholesky(self.mass)
            inverse = lower**-1
            squares, vectors = mp.eigsy(inverse * mp.matrix(system.stiffness.tolist()) * inverse.T)
            self.size = len(squares)
            # Of a rigid-body mode the rounded matrices leave a trace of stiffness, which counts for nothing in double precision either.
            self.squares = [mp.mpf(0) if double == 0.0 else square for square, double in zip(squares, system.modes.squares, strict=True)]
            self.shapes = inverse.T * vectors
            self.gaps = [
                [mp.fsum(mp.mpf(float(c)) * self.shapes[i, k] for i, c in enumerate(stop.gap)) for k in range(self.size)]
                for stop in system.stops
            ]
            self.lengths = [dot(row, row) for row in self.gaps]

    def state(self, displacements: Any, velocities: Any) -> list[Any]:
        """Modal state with displacements and velocities (n,)."""
        moments = [self.shapes.T * (self.mass * mp.matrix([mp.mpf(float(x)) for x in part])) for part in (displacements, velocities)]
        return [*moments[0], *moments[1]]

    def velocities(self, z: list[Any]) -> list[Any]:
        """Velocities u' (n,) of a modal state."""
        return list(self.shapes * mp.matrix(z[self.size :]))

    def energy(self, z: list[Any]) -> Any:
        """h."""
        n = self.size
        return sum((z[n + k] ** 2 + square * z[k] ** 2 for k, square in enumerate(self.squares)), mp.mpf(0)) / 2

    def flight(self, time: Any) -> list[tuple[Any, Any, Any]]:
        """cos(w t), sin(w t)/w and w sin(w t) of each mode, for `flow`."""
        out = []
        for square in self.squares:
            w = mp.sqrt(abs(square))
            c, s = mp.cos_sin(w * time) if square >= 0 else (mp.cosh(w * time), mp.sinh(w * time))
            over = s / w if w else time
            out.append((c, over, square * over))
        return out

    def flow(self, z: list[Any], flight: list[tuple[Any, Any, Any]]) -> list[Any]:
        """The state after a free flight."""
        n = self.size
        places = [c * z[k] + over * z[n + k] for k, (c, over, _) in enumerate(flight)]
        return places + [c * z[n + k] - times * z[k] for k, (c, _, times) in enumerate(flight)]

    def rate(self, z: list[Any]) -> list[Any]:
        """Velocities and accelerations of the modes."""
        n = self.size
        return z[n:] + [-square * z[k] for k, square in enumerate(self.squares)]

    def gap(self, stop: int, z: list[Any]) -> Any:
        """The gap coordinate."""
        return dot(self.gaps[stop], z)

    def speed(self, stop: int, z: list[Any]) -> Any:
        """The rate of the gap coordinate."""
        return dot(self.gaps[stop], z[self.size :])

    def impact(self, stop: int, z: list[Any]) -> list[Any]:
        """The state after an elastic impact."""
        n, b = self.size, self.gaps[stop]
        push = 2 * self.speed(stop, z) / self.lengths[stop]
        return z[:n] + [p - push * x for p, x in zip(z[n:], b, strict=True)]


def dot(a: list[Any], b: list[Any]) -> Any:
    """Sum of products, as far as the shorter list goes."""
    return sum((x * y for x, y in zip(a, b, strict=False)), mp.mpf(0))


@lru_cache(maxsize=4)
def digit_modes(system: ImpactSystem) -> DigitModes:
    """The modes of a system, computed once."""
    return DigitModes(system)
