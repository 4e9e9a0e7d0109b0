"""Fixed points of a section's map: the periodic orbits that cross the section once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from transitions.section import follow
from transitions.section_plane import SectionPlane, checked_points

__all__ = ["FixedPoint", "fixed_points", "return_map"]

GUESSES = 600
"""Starts of Newton's method, spread over the section."""

_ROUNDS = 25
_CONVERGED = 1e-12
_SAME, _SINGULAR = 1e-7, 1e-13


@dataclass(frozen=True)
class FixedPoint:
    """A fixed point of the section's map: its place in the plane, the period of its orbit, and the trace of the map's derivative.

    The map of a conservative system keeps areas, so that the point is elliptic where |trace| < 2, and hyperbolic where it is above."""

    x: float
    y: float
    period: float
    trace: float

    @property
    def elliptic(self) -> bool:
        """Whether nearby orbits go round it."""
        return abs(self.trace) < 2.0

    @property
    def place(self) -> str:
        """Its coordinates as text, those within rounding of zero as 0."""
        return f"({round(self.x, 9) + 0.0:.6g}, {round(self.y, 9) + 0.0:.6g})"

    @property
    def kind(self) -> str:
        """elliptic or hyperbolic"""
        return "elliptic" if self.elliptic else "hyperbolic"


def return_map(plane: SectionPlane, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The next crossings (m, 2) of points (m, 2) inside the bounding curve, the derivatives (m, 2, 2) of the map, and the times (m,).

    NaN for a motion that does not come back."""
    columns = []
    for direction in np.eye(2):
        found = follow(plane, points, 2, directions=np.tile(direction, (len(points), 1)))
        columns.append(np.exp(found.growths[:, 1, None]) * found.tangents[:, 1])
    return found.points[:, 1], np.stack(columns, axis=-1), found.times[:, 1]


def fixed_points(plane: SectionPlane, guesses: np.ndarray | None = None) -> list[FixedPoint]:
    """Fixed points of the map, by Newton's method from guesses (m, 2), by default from starts spread over the section.

    Elliptic ones first, then by x and y. Strongly unstable ones draw few guesses and may not be found.

    Raises
    ------
    ValueError
        For a system that loses energy: its sections have no such map. For guesses that are no points.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> for point in fixed_points(SectionPlane(vibro_impact_nes(), 0.05)):
    ...     print(f"{point.y:.6f} {point.period:.6f} {point.kind}")
    -0.649548 5.367781 elliptic
    0.760320 7.354699 elliptic
    """
    why = plane.system.why_not_conservative()
    if why is not None:
        raise ValueError(f"a section's map is that of one energy, and {why}")
    points = plane.starts(GUESSES) if guesses is None else checked_points(guesses, "guesses")
    points = points[plane.holds(points)]
    found: list[FixedPoint] = []
    for _ in range(_ROUNDS):
        if not len(points):
            break
        images, derivatives, times = return_map(plane, points)
        matrices = derivatives - np.eye(2)
        with np.errstate(divide="ignore", invalid="ignore"):
            determinants = matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
            missing = images - points
            steps = np.stack(
                [
                    matrices[:, 1, 1] * missing[:, 0] - matrices[:, 0, 1] * missing[:, 1],
                    matrices[:, 0, 0] * missing[:, 1] - matrices[:, 1, 0] * missing[:, 0],
                ],
                axis=1,
            ) / -determinants[:, None]
        size = np.abs(steps).max(axis=1)
        done = np.isfinite(size) & (size < _CONVERGED) & (np.abs(missing).max(axis=1) < _CONVERGED * np.abs(derivatives).max(axis=(1, 2)))
        for point, derivative, time in zip(points[done], derivatives[done], times[done], strict=True):
            trace = float(np.trace(derivative))
            near = max(_SAME, _SINGULAR / max(abs(trace - 2.0), 1e-12))  # Newton's matrix has the determinant 2 - trace
            if all(np.hypot(point[0] - other.x, point[1] - other.y) > near for other in found):
                found.append(FixedPoint(float(point[0]), float(point[1]), float(time), trace))
        going = np.isfinite(size) & ~done
        points = points[going] + steps[going]
        points = points[plane.holds(points)]
    return sorted(found, key=lambda point: (not point.elliptic, round(point.x, 9), point.y))
