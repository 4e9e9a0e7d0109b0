"""Saddles of the potential: equilibria of a system with smooth forces beyond which its potential falls off; and its other ends.

A family can end there. Its orbits dwell near the saddle ever longer, their energy tends to that of the saddle, and beyond it no motion
comes to rest. Farther out a potential can have a limit, which is a saddle at infinity, or no values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from bvp.multipoint import MultipointProblem
    from bvp.system import ImpactSystem

__all__ = ["REACHED", "Saddle", "approached", "farther_out"]

NEAR = 0.01
"""Distance of an orbit from a saddle, beside the size of the motion, below which the orbit approaches it."""

REACHED = 1e-7
"""The same where the energies of orbit and saddle differ by rounding only, since they differ by the square of it."""

_DOUBLINGS = 30
"""So often a displacement is doubled where the potential's limit is sought: farther out energies are rounding."""

_LEVEL = 1e-6
"""Relative change of the potential, as its displacement is doubled, below which it has its limit, to five digits."""

_ROUNDS = 30
_STEP = 1e-6
_SETTLED = 1e-9


class Saddle(NamedTuple):
    """An equilibrium at displacements (n,), with its energy h."""

    system: ImpactSystem
    displacement: np.ndarray
    h: float

    def distance(self, problem: MultipointProblem, y: np.ndarray) -> float:
        """Distance from the orbit y, at its nearest end of a flight, beside the size of the motion, in places and velocities."""
        u, v = np.split(_turns(problem, y), 2, axis=1)
        mass = self.system.mass
        size = float(self.displacement @ mass @ self.displacement)
        if self.system.has_odd_symmetry:  # the image of a saddle under u -> -u is one too
            u = np.where((u @ mass @ self.displacement < 0.0)[:, None], -u, u)
        beside = u - self.displacement
        apart = np.sum((beside @ mass) * beside, axis=1) / size + np.sum((v @ mass) * v, axis=1) / (2.0 * abs(self.h))
        return float(np.sqrt(np.min(apart)))

    def __str__(self) -> str:
        return f"the equilibrium {_place(self.system, self.displacement)} of energy h = {self.h:.10g}, where the potential falls off"


def _saddle_near(system: ImpactSystem, u: np.ndarray) -> Saddle | None:
    """The saddle to which Newton's method for the forces leads from displacements u (n,); None if it leads to none."""
    forces = system.smooth_forces
    if forces is None:
        return None
    n = system.degrees_of_freedom
    rest = np.zeros(n)

    def force(at: np.ndarray) -> np.ndarray:
        return np.asarray(system.stiffness @ at + forces.acting(at, rest))

    def stiffness(at: np.ndarray) -> np.ndarray:
        ahead = _STEP * max(1e-6, float(np.max(np.abs(at)))) * np.eye(n)
        return np.stack([(force(at + one) - force(at - one)) / (2.0 * np.max(one)) for one in ahead], axis=1)

    at, size = np.array(u, float), float(np.max(np.abs(u)))
    change = np.inf
    with np.errstate(all="ignore"):
        for _ in range(_ROUNDS):
            try:
                move = np.linalg.solve(stiffness(at), -force(at))
            except np.linalg.LinAlgError:
                return None
            change = float(np.max(np.abs(move)))
            if not change < 10.0 * size:
                return None
            at = at + move
            if change <= _SETTLED * size:
                break
        if not change <= _SETTLED * size or not np.max(np.abs(at)) > 1e-3 * size:
            return None
        tangent = stiffness(at)
        energy = float(system.energy(at, rest))
        if not energy > 0.0 or not np.min(np.linalg.eigvalsh(0.5 * (tangent + tangent.T))) < 0.0:
            return None
    return Saddle(system, at, energy)


def _place(system: ImpactSystem, at: np.ndarray) -> str:
    """Displacements (n,) in words."""
    return ", ".join(f"{name} = {x:.6g}" for name, x in zip(system.coordinates, at.tolist(), strict=True))


def _turns(problem: MultipointProblem, y: np.ndarray) -> np.ndarray:
    """The states (m, 2 n) of the orbit y at the ends of its flights."""
    return np.vstack([problem.start(y), problem.end_states(y)]) @ problem.system.modes.to_state.T


def _is_finite(u: np.ndarray) -> bool:
    """Whether the flight to a place was computed."""
    return bool(np.all(np.isfinite(u)))


def farther_out(problem: MultipointProblem, y: np.ndarray) -> str:
    """Why orbits larger than y do not turn, in words: the potential ends just beyond it, or levels off there. Empty for neither."""
    system, h = problem.system, problem.energy(y)
    rest = np.zeros(problem.half)
    with np.errstate(all="ignore"):
        for u in filter(_is_finite, _turns(problem, y)[:, : problem.half] if problem.is_smooth else ()):
            inside, outside = 1.0, 1.0 + NEAR
            if not np.isfinite(system.energy(outside * u, rest)):
                while inside < (middle := 0.5 * (inside + outside)) < outside:
                    inside, outside = (middle, outside) if np.isfinite(system.energy(middle * u, rest)) else (inside, middle)
                return f"its orbits approach {_place(system, inside * u)}, beyond which the potential has no values"
            levels = np.array([system.energy(2.0**k * u, rest) for k in range(_DOUBLINGS)])
            level = int(np.argmax(np.append(np.diff(levels), 0.0) <= _LEVEL * h))  # the first that rises no more
            if 0.0 <= levels[level] - levels[0] < NEAR * h and 0.0 <= levels[level] - h < NEAR * h and level < _DOUBLINGS - 1:
                reached = f"the energy h = {levels[level]:.5g}, at which the potential levels off"
                return f"its orbits approach {reached} beyond {_place(system, u)}"
    return ""


def approached(problem: MultipointProblem, y: np.ndarray) -> Saddle | None:
    """The saddle that the orbit y approaches, if there is one."""
    if not problem.is_smooth:
        return None
    system, n = problem.system, problem.half
    farthest = max(_turns(problem, y), key=lambda state: float(state[:n] @ system.mass @ state[:n]))
    saddle = _saddle_near(system, farthest[:n])
    return saddle if saddle is not None and saddle.distance(problem, y) < NEAR else None
