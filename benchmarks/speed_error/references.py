"""Reference values in fifty digits: periodic orbits, and damped motions impact by impact. Errors are measured against them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np

from bvp import many_digits
from bvp.many_digits import DIGITS
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem

__all__ = ["DIGITS", "ReferenceOrbit", "ReferenceRun", "reference_orbit", "reference_run", "reciprocal_pair"]

NEAR = 1e-7
"""The safe steps stop when a gap is smaller than this and closing. Newton's method then takes over in fifty digits."""

STEPS = 100_000
"""Most safe steps before an impact."""


@dataclass(frozen=True, eq=False)
class ReferenceOrbit:
    """An orbit in many digits."""

    alpha: Any
    h: Any
    velocities: list[Any]  # (n,) at the start, where u = 0
    times: list[Any]  # of the impacts inside the solved segment
    multipliers: list[Any]  # the nontrivial ones by modulus descending, then by angle; empty for n > 2
    residual: Any  # of the multipoint equations


@dataclass(frozen=True, eq=False)
class ReferenceRun:
    """A motion just after its last impact, in many digits: the time of that impact, the state (u, v), the energy."""

    time: Any
    state: list[Any]
    energy: Any


def reference_orbit(problem: MultipointProblem, y: np.ndarray, alpha: float) -> ReferenceOrbit:
    """Solve in many digits for the orbit next to the double-precision unknowns y, at a quarter period, an exact binary fraction.

    Raises
    ------
    ValueError
        For another start.
    ArithmeticError
        If Newton's method does not converge.
    """
    if problem.ends[0] != "origin":
        raise ValueError(f"orbits in many digits start at the origin; received {problem.ends[0]}")
    found = many_digits.orbit_in_digits(problem, y, alpha)
    with mp.workdps(DIGITS):
        moments = [mp.fsum(found.times[: i + 1]) for i in range(problem.inner)]
        multipliers = reciprocal_pair(found.trace / 2) if problem.half == 2 else []
        velocities = found.modes.velocities(found.states[0])
        return ReferenceOrbit(mp.mpf(float(alpha)), found.energy, velocities, moments, multipliers, found.residual)


def reciprocal_pair(half_trace: Any) -> list[Any]:
    """Roots of x^2 - 2 half_trace x + 1, by modulus descending, then by angle."""
    square = half_trace**2 - 1
    if square < 0:
        imaginary = mp.sqrt(-square)
        return [mp.mpc(half_trace, -imaginary), mp.mpc(half_trace, imaginary)]
    larger = half_trace + mp.sign(half_trace) * mp.sqrt(square)
    return [larger, 1 / larger]


def reference_run(system: ImpactSystem, velocities: np.ndarray, impacts: int) -> ReferenceRun:
    """Simulate a system from u = 0 through a number of impacts, in many digits.

    Between impacts the state is a sum of 2 n exponentials. Safe steps in double precision approach the next impact, and Newton's method
    finds it in many digits. Only a grazing that double precision cannot distinguish from a miss could be resolved wrongly.

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
        If there is no next impact.
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
            t = _impact_time(amounts, exponents, bounds)
            before = vectors * mp.matrix([parts[k] * mp.exp(exponents[k] * t) for k in range(2 * n)])
            x = mp.matrix([mp.re(value) for value in before])
            impulse = jump * (row * x[n:, :])[0]
            for i in range(n):
                x[n + i] -= impulse * push[i]
            now += t
        u, v = x[:n, :], x[n:, :]
        energy = ((v.T * mass * v)[0] + (u.T * stiffness * u)[0]) / 2
        return ReferenceRun(now, list(x), energy)


def _impact_time(amounts: list[Any], exponents: list[Any], bounds: tuple[Any, Any]) -> Any:
    """Time of the next impact of the gap sum(amounts * exp(exponents * t)), by Newton's method in many digits."""
    start, side = _approach(amounts, exponents, (float(bounds[0]), float(bounds[1])))
    t = mp.mpf(start)
    for _ in range(60):
        factors = [mp.exp(d * t) for d in exponents]
        gap = mp.fsum(mp.re(a * e) for a, e in zip(amounts, factors, strict=True)) - bounds[side]
        speed = mp.fsum(mp.re(a * d * e) for a, d, e in zip(amounts, exponents, factors, strict=True))
        change = gap / speed
        t -= change
        if abs(change) < mp.mpf(10) ** (8 - DIGITS):
            return t
    raise ArithmeticError("an impact was not found")


def _approach(amounts: list[Any], exponents: list[Any], bounds: tuple[float, float]) -> tuple[float, int]:
    """Time shortly before the next impact, in double precision, and its side: 0 for the lower bound, 1 for the upper one."""
    a = np.array([complex(x) for x in amounts])
    d = np.array([complex(x) for x in exponents])
    curvature = float(np.sum(np.abs(a) * np.abs(d) ** 2))
    time = 0.0
    for _ in range(STEPS):
        terms = a * np.exp(d * time)
        gap, speed = float(np.sum(terms.real)), float(np.sum((d * terms).real))
        steps = []
        for side, sign in ((0, 1.0), (1, -1.0)):
            room, opening = max(0.0, sign * (gap - bounds[side])), sign * speed
            if room < NEAR and opening < 0.0 and time > 0.0:
                return time, side
            # With |w''| <= curvature the gap stays open for at least this long.
            steps.append((opening + math.sqrt(opening * opening + 2.0 * curvature * room)) / curvature)
        time += min(steps)
    raise ArithmeticError("there is no next impact")
