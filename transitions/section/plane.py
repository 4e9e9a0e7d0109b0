"""The plane of a Poincare section at one energy: its coordinates, its bounding curve, and starts spread over it.

The section is u_p = 0, u_p' > 0 for the primary coordinate p of a system with two degrees of freedom (Lee et al., Physica D 238 (2009)
1868, Eq. (10)). The other coordinate a gives the plane: x = u_a and y = (M u')_a/m_aa, its momentum over its mass. For a diagonal mass
matrix y is u_a'. In these coordinates each point has one state with u_p' > 0, and the map of a conservative system keeps areas:

    2 h = m_aa y^2 + (m_pp - m_ap^2/m_aa) u_p'^2 + k_aa x^2 + 2 V(x)

V is the energy of the smooth forces. The plane is the interval of x around 0 in which this leaves a velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from bvp.checks import is_finite, reals, require_system
from bvp.dense import product
from bvp.kernels.contact_mode import ContactModes
from bvp.system import ImpactSystem
from bvp.texts import shown

__all__ = ["SectionPlane", "checked_points"]

_FAR = 1e6
"""Distance beyond which no turning point is sought."""

_PLASTIC = 1.32471795724474602596
"""Root of x^3 = x + 1: its powers spread points over a square evenly (Roberts, The unreasonable effectiveness of quasirandom
sequences, 2018)."""


def checked_points(points: Any, what: str) -> np.ndarray:
    """Points or directions as an array (m, 2) of floats; a ValueError for anything else."""
    try:
        array = np.atleast_2d(reals(points))
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"{what} is an array of numbers of shape (m, 2); received {shown(points)}")
    return array


@dataclass(frozen=True, eq=False)
class SectionPlane:
    """The section's plane at one energy.

    Parameters
    ----------
    system : ImpactSystem
        With two degrees of freedom, one of them the primary.
    energy : float
        h > 0 of the states on it.

    Raises
    ------
    ValueError
        For another number of degrees of freedom, a system without primary, an energy that is not above 0, a section that no motion
        reaches, or a section without bounds.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> plane = SectionPlane(vibro_impact_nes(), 0.06)
    >>> plane.reach, float(plane.height(0.0).round(12))
    ((-1.0, 1.0), 1.09544511501)
    >>> u, v = plane.states([[0.5, 0.2]])
    >>> plane.system.energy(u, v).round(15)
    array([0.06])
    """

    system: ImpactSystem
    energy: float

    def __post_init__(self) -> None:
        require_system(self.system, smooth=True)
        n = self.system.degrees_of_freedom
        if n != 2:
            raise ValueError(f"a section is a plane for two degrees of freedom; this system has {n}")
        if self.system.primary is None:
            names = " or ".join(self.system.coordinates)
            raise ValueError(f"a section is taken where the primary coordinate passes zero; expected the scene to name it: LO = {names}")
        if not (is_finite(self.energy) and self.energy > 0.0):
            raise ValueError(f"the energy of a section is a finite number above 0; received {shown(self.energy)}")
        _ = self.reach

    @property
    def primary(self) -> int:
        """Index of the coordinate that is zero on the section."""
        assert self.system.primary is not None
        return self.system.primary

    @property
    def other(self) -> int:
        """Index of the coordinate of the plane."""
        return 1 - self.primary

    @property
    def momentum(self) -> bool:
        """Whether the masses are coupled, so that y is a momentum over a mass and not a velocity."""
        return bool(self.system.mass[0, 1] != 0.0)

    @cached_property
    def _constants(self) -> tuple[float, float, float, float]:
        """m_aa, m_pp - m_ap^2/m_aa, k_aa, m_ap."""
        a, p = self.other, self.primary
        own, coupled = float(self.system.mass[a, a]), float(self.system.mass[a, p])
        return own, float(self.system.mass[p, p]) - coupled * coupled / own, float(self.system.stiffness[a, a]), coupled

    @property
    def scales(self) -> np.ndarray:
        """Half of the range of x, and the largest y, (2,)."""
        low, high = self.reach
        return np.array([0.5 * (high - low), self.height(min(max(0.0, low), high))])

    @cached_property
    def walls(self) -> tuple[float, float]:
        """Bounds of x by the stops: infinite without a stop, lower > upper if no x is inside."""
        low, high = -math.inf, math.inf
        for stop in self.system.stops:
            part = stop.gap[self.other]
            if part != 0.0:
                ends = sorted((stop.lower / part, stop.upper / part))
            else:
                ends = [-math.inf, math.inf] if stop.lower < 0.0 < stop.upper else [math.inf, -math.inf]
            low, high = max(low, ends[0]), min(high, ends[1])
        return low, high

    @cached_property
    def reach(self) -> tuple[float, float]:
        """Least and largest x of the section."""
        name, other = (self.system.coordinates[k] for k in (self.primary, self.other))
        low, high = self.walls
        if not low < high:
            raise ValueError(f"no motion reaches the section {name} = 0: the stops leave no room there")
        begin = min(max(0.0, low), high)
        if not self._left(begin) > 0.0:
            least = self.energy - 0.5 * float(self._left(begin))
            raise ValueError(f"no motion with energy {self.energy:g} reaches the section {name} = 0; expected an energy above {least:.6g}")
        most = self._turns
        low, high = max(low, most[0]), min(high, most[1])
        if math.isinf(low) or math.isinf(high):
            raise ValueError(f"the section {name} = 0 has no bounds: neither a spring nor a stop holds {other} there")
        return low, high

    @cached_property
    def _turns(self) -> tuple[float, float]:
        """Where the springs leave no velocity, below and above the x of `walls` that is nearest to 0; infinite where they always do."""
        stiffness = self._constants[2]
        if self.system.smooth_forces is None:
            most = math.sqrt(2.0 * self.energy / stiffness) if stiffness > 0.0 else math.inf
            return -most, most
        from scipy.optimize import brentq

        begin = min(max(0.0, self.walls[0]), self.walls[1])
        found = []
        for sign in (-1.0, 1.0):
            step = 1e-3
            while self._left(begin + sign * step) > 0.0 and step < _FAR:
                step *= 1.05
            ends = sorted((begin, begin + sign * step))
            found.append(brentq(self._left, *ends, xtol=1e-300, rtol=1e-15) if step < _FAR else sign * math.inf)
        return found[0], found[1]

    def _left(self, x: Any) -> Any:
        """2 h without the energy of the springs at x: twice what is left for velocities, a number or an array."""
        left = 2.0 * self.energy - self._constants[2] * x * x
        if self.system.smooth_forces is None:
            return left
        return left - 2.0 * self.system.smooth_forces.energy(self._displacements(x))

    def _displacements(self, x: Any) -> np.ndarray:
        """u (..., 2) on the section."""
        u = np.zeros((*np.shape(x), 2))
        u[..., self.other] = x
        return u

    def height(self, x: Any) -> Any:
        """Largest y at x: a number or an array."""
        return np.sqrt(np.maximum(self._left(x), 0.0) / self._constants[0])

    def holds(self, points: Any) -> np.ndarray:
        """Whether points (m, 2) lie inside the bounding curve: bool (m,)."""
        points = np.asarray(points, dtype=float)
        low, high = self.reach
        left = self._left(points[:, 0]) - self._constants[0] * points[:, 1] ** 2
        return (points[:, 0] > low) & (points[:, 0] < high) & (left > 0.0)

    def boundary(self, count: int = 400) -> np.ndarray:
        """The bounding curve as a closed polygon: (2 count + 1, 2), along y > 0 and back along y < 0.

        On its arcs u_p' = 0. Elsewhere it runs along the stops."""
        low, high = self.reach
        x = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.linspace(0.0, math.pi, count))
        y = self.height(x)
        return np.concatenate([np.stack([x, y], 1), np.stack([x[::-1], -y[::-1]], 1), [[x[0], y[0]]]])

    def starts(self, count: int) -> np.ndarray:
        """Points spread evenly inside the bounding curve, always the same: (count, 2)."""
        low, high = self.reach
        top = max(self.height(low), self.height(high), self.scales[1])
        found = np.zeros((0, 2))
        first = 0
        while len(found) < count:
            index = np.arange(first, first + 2 * count + 8)
            square = np.stack([(0.5 + index / _PLASTIC) % 1.0, (0.5 + index / _PLASTIC**2) % 1.0], 1)
            points = np.stack([low + (high - low) * square[:, 0], top * (2.0 * square[:, 1] - 1.0)], 1)
            found = np.concatenate([found, points[self.holds(points)]])
            first += len(index)
        return found[:count]

    def states(self, points: Any) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities (m, 2) of points (m, 2) inside the bounding curve.

        Raises
        ------
        ValueError
            For a point outside.
        """
        points = checked_points(points, "starts")
        inside = self.holds(points)
        if not np.all(inside):
            wrong = points[int(np.argmin(inside))].tolist()
            raise ValueError(f"starts are points inside the bounding curve of the section at h = {self.energy:g}; received {wrong}")
        own, joint, _, coupled = self._constants
        x, y = points.T
        u, v = self._displacements(x), np.zeros((len(x), 2))
        v[:, self.primary] = np.sqrt((self._left(x) - own * y * y) / joint)
        v[:, self.other] = y - coupled / own * v[:, self.primary]
        return u, v

    def tangents(self, points: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Derivatives (m, 4) of (u, v) on the energy surface at points (m, 2), along directions (m, 2) of the plane."""
        own, joint, stiffness, coupled = self._constants
        x, y = points.T
        speed = self.states(points)[1][:, self.primary]
        out = np.zeros((len(x), 4))
        out[:, self.other] = directions[:, 0]
        pull, forces = stiffness * x, self.system.smooth_forces
        if forces is not None:
            u = self._displacements(x)
            pull = pull + forces.acting(u, 0.0 * u)[:, self.other]
        out[:, 2 + self.primary] = -(pull * directions[:, 0] + own * y * directions[:, 1]) / (joint * speed)
        out[:, 2 + self.other] = directions[:, 1] - coupled / own * out[:, 2 + self.primary]
        return out

    def rows(self, phases: ContactModes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows on the states z (N,) of each of F contact modes: (F, 3, N) of u_p, u_p', u_p''; (F, 2, N) of x and y; (F, N, N) with
        energy z . quadratic z/2, without that of smooth forces."""
        position, velocity = phases.leave[:, :2], phases.leave[:, 2:]
        own = velocity[:, self.primary]
        functional = np.stack([position[:, self.primary], own, np.einsum("fn,fnk->fk", own, phases.matrix)], axis=1)
        moved = (self.system.mass[self.other][:, None] * velocity).sum(axis=1)
        plane = np.stack([position[:, self.other], moved / self._constants[0]], axis=1)
        parts = ((self.system.stiffness, position), (self.system.mass, velocity))
        potential, kinetic = (np.stack([product(rows.T, matrix, rows) for rows in part]) for matrix, part in parts)
        return functional, plane, potential + kinetic

    def coordinates(self, u: Any, v: Any) -> np.ndarray:
        """x and y of states (m, 2): (m, 2)."""
        return np.stack([np.asarray(u)[:, self.other], product(np.asarray(v), self.system.mass[self.other]) / self._constants[0]], 1)
