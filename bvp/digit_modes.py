"""The modes of an undamped system, free flight and elastic impacts in fifty digits."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import mpmath as mp

from bvp.system import ImpactSystem

__all__ = ["DIGITS", "DigitModes", "digit_modes"]

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
    frequencies : list of n mpf
        Exactly 0 for a rigid-body mode.
    shapes : (n, n) mp.matrix
        Mass-normalised, one a column.
    gaps : list of (list of n mpf)
        c . phi_k for each stop.
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
            rigid = mp.mpf(10) ** (10 - DIGITS) * max(abs(square) for square in squares)
            if any(square < -rigid for square in squares):
                raise ValueError("periodic orbits in many digits need a stiffness that is nowhere negative")
            self.size = len(squares)
            self.frequencies = [mp.sqrt(square) if square > rigid else mp.mpf(0) for square in squares]
            self.shapes = inverse.T * vectors
            self.gaps = [
                [mp.fsum(mp.mpf(float(c)) * self.shapes[i, k] for i, c in enumerate(stop.gap)) for k in range(self.size)]
                for stop in system.stops
            ]

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
        return mp.fsum(z[n + k] ** 2 + (w * z[k]) ** 2 for k, w in enumerate(self.frequencies)) / 2

    def flow(self, z: list[Any], time: Any) -> list[Any]:
        """The state after a free flight."""
        n = self.size
        places, speeds = [], []
        for k, w in enumerate(self.frequencies):
            c, s = mp.cos_sin(w * time)
            places.append(c * z[k] + (s / w if w else time) * z[n + k])
            speeds.append(c * z[n + k] - w * s * z[k])
        return places + speeds

    def rate(self, z: list[Any]) -> list[Any]:
        """Velocities and accelerations of the modes."""
        n = self.size
        return z[n:] + [-w * w * z[k] for k, w in enumerate(self.frequencies)]

    def gap(self, stop: int, z: list[Any]) -> Any:
        """The gap coordinate."""
        return mp.fsum(b * q for b, q in zip(self.gaps[stop], z, strict=False))

    def speed(self, stop: int, z: list[Any]) -> Any:
        """The rate of the gap coordinate."""
        return mp.fsum(b * p for b, p in zip(self.gaps[stop], z[self.size :], strict=True))

    def impact(self, stop: int, z: list[Any]) -> list[Any]:
        """The state after an elastic impact."""
        n, b = self.size, self.gaps[stop]
        push = 2 * self.speed(stop, z) / mp.fsum(x * x for x in b)
        return z[:n] + [p - push * x for p, x in zip(z[n:], b, strict=True)]


@lru_cache(maxsize=4)
def digit_modes(system: ImpactSystem) -> DigitModes:
    """The modes of a system, computed once."""
    return DigitModes(system)
