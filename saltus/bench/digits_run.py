"""A damped motion in fifty digits, impact by impact: what the errors of long runs are measured against.

Between impacts the state is a sum of four exponentials (2 n in general). The next impact is approached in double precision in steps that a
bound on the second derivative of the gap makes safe, then found by Newton's method in many digits: only a grazing that double precision
cannot tell from a miss could be taken wrongly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np

from bvp.system import ImpactSystem
from saltus.bench.digits import DIGITS

__all__ = ["DigitRun", "run_in_digits"]

_NEAR = 1e-7
_STEPS = 100_000


@dataclass(frozen=True, eq=False)
class DigitRun:
    """Where a motion is after its last impact, in many digits.

    Attributes
    ----------
    time : mpf
        Of the last impact.
    state : list of 2 n mpf
        (u, v) just after it.
    energy : mpf
        Then.
    """

    time: Any
    state: list[Any]
    energy: Any


def run_in_digits(system: ImpactSystem, velocities: np.ndarray, impacts: int) -> DigitRun:
    """Run a system from u = 0 through a number of impacts.

    Parameters
    ----------
    system : ImpactSystem
        With one two-sided stop, without a rigid-body mode.
    velocities : (n,) float
        At time 0.
    impacts : int

    Raises
    ------
    ArithmeticError
        Where no impact comes.
    """
    n = system.degrees_of_freedom
    (stop,) = system.stops
    with mp.workdps(DIGITS):
        mass, damping, stiffness = (mp.matrix(part.tolist()) for part in (system.mass, system.damping, system.stiffness))
        inverse = mass**-1
        matrix = mp.zeros(2 * n)
        matrix[:n, n:] = mp.eye(n)
        matrix[n:, :n] = -inverse * stiffness
        matrix[n:, n:] = -inverse * damping
        exponents, vectors = mp.eig(matrix)
        back = vectors**-1
        row = mp.matrix([[mp.mpf(float(c)) for c in stop.gap]])
        across = row * vectors[:n, :]
        push = inverse * row.T
        jump = (1 + mp.mpf(float(stop.restitution))) / (row * push)[0]
        bounds = (mp.mpf(float(stop.lower)), mp.mpf(float(stop.upper)))
        x = mp.matrix([mp.mpf(0)] * n + [mp.mpf(float(v)) for v in velocities])
        now = mp.mpf(0)
        for _ in range(impacts):
            parts = back * x
            amounts = [across[k] * parts[k] for k in range(2 * n)]
            time, side = _approach(amounts, exponents, (float(bounds[0]), float(bounds[1])))
            t = mp.mpf(time)
            for _ in range(60):
                turns = [mp.exp(d * t) for d in exponents]
                gap = mp.fsum(mp.re(a * e) for a, e in zip(amounts, turns, strict=True)) - bounds[side]
                speed = mp.fsum(mp.re(a * d * e) for a, d, e in zip(amounts, exponents, turns, strict=True))
                change = gap / speed
                t -= change
                if abs(change) < mp.mpf(10) ** (8 - DIGITS):
                    break
            else:
                raise ArithmeticError("an impact was not found")
            turned = mp.matrix([parts[k] * mp.exp(exponents[k] * t) for k in range(2 * n)])
            x = mp.matrix([mp.re(value) for value in vectors * turned])
            kick = jump * (row * x[n:, :])[0]
            for i in range(n):
                x[n + i] -= kick * push[i]
            now += t
        u, v = x[:n, :], x[n:, :]
        energy = ((v.T * mass * v)[0] + (u.T * stiffness * u)[0]) / 2
        return DigitRun(now, list(x), energy)


def _approach(amounts: list[Any], exponents: list[Any], bounds: tuple[float, float]) -> tuple[float, int]:
    """Time shortly before the next impact, in double precision, and the side: 0 the lower one, 1 the upper one."""
    a = np.array([complex(x) for x in amounts])
    d = np.array([complex(x) for x in exponents])
    curvature = float(np.sum(np.abs(a) * np.abs(d) ** 2))
    time = 0.0
    for _ in range(_STEPS):
        turns = a * np.exp(d * time)
        gap, speed = float(np.sum(turns.real)), float(np.sum((d * turns).real))
        steps = []
        for side, sign in ((0, 1.0), (1, -1.0)):
            room, opening = max(0.0, sign * (gap - bounds[side])), sign * speed
            if room < _NEAR and opening < 0.0 and time > 0.0:
                return time, side
            steps.append((opening + math.sqrt(opening * opening + 2.0 * curvature * room)) / curvature)
        time += min(steps)
    raise ArithmeticError("no impact comes")
