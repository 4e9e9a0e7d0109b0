"""Fixed points of a section's map, and rotation numbers: turns of an orbit around an elliptic fixed point per crossing.

A fixed point is a periodic orbit that crosses the section once. A rotation number is a mean over the crossings with the weight
exp(-1/(t (1 - t))), which converges faster than any power on a curve (Das, Sander, Saiki, Yorke, Nonlinearity 30 (2017) 4111). On a chaotic
orbit it does not settle; the numbers of both halves of the orbit show this.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from transitions.section.plane import SectionPlane, checked_points
from transitions.section.section import Section, follow_crossings
from transitions.sweep.returns import weighted_mean

__all__ = ["FixedPoint", "Rotations", "about_point", "fixed_points", "return_map", "rotations"]

GUESSES = 600
"""Starts of Newton's method, spread over the section."""

SETTLED = 1e-4
"""Largest difference of the numbers of both halves of an orbit, in rotations. With a larger one the orbit has no rotation number."""

FEWEST = 20
"""Least number of crossings for a rotation number."""

_ROUNDS = 25
_CONVERGED = 1e-12
_SAME, _SINGULAR = 1e-7, 1e-13
_JUMP = 0.8 * math.pi


@dataclass(frozen=True)
class FixedPoint:
    """A fixed point of the section's map: its place in the plane, the period of its orbit, and the trace of the map's derivative.

    The map of a conservative system keeps areas. So the point is elliptic for |trace| < 2 and hyperbolic for |trace| > 2."""

    x: float
    y: float
    period: float
    trace: float

    @property
    def elliptic(self) -> bool:
        """Whether nearby orbits go around it."""
        return abs(self.trace) < 2.0

    @property
    def place(self) -> str:
        """Its coordinates as text; a value within rounding of zero is 0."""
        return f"({round(self.x, 9) + 0.0:.6g}, {round(self.y, 9) + 0.0:.6g})"

    @property
    def kind(self) -> str:
        """elliptic or hyperbolic"""
        return "elliptic" if self.elliptic else "hyperbolic"


def return_map(plane: SectionPlane, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The next crossings (m, 2) of points (m, 2) inside the bounding curve, the derivatives (m, 2, 2) of the map, and the times (m,).

    NaN for a motion that does not return."""
    columns = []
    for direction in np.eye(2):
        found = follow_crossings(plane, points, 2, directions=np.tile(direction, (len(points), 1)))
        columns.append(np.exp(found.growths[:, 1, None]) * found.tangents[:, 1])
    return found.points[:, 1], np.stack(columns, axis=-1), found.times[:, 1]


def fixed_points(plane: SectionPlane, guesses: np.ndarray | None = None) -> list[FixedPoint]:
    """Fixed points of the map, by Newton's method from guesses (m, 2), by default from starts spread over the section.

    Elliptic points come first, then they are sorted by x and y. Few guesses converge to a strongly unstable point, so it can be missed. A
    ValueError for a system that loses energy, because its section has no such map, and for guesses that are no points.

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
            (a, b), (c, d) = matrices.transpose(1, 2, 0)
            missing = images - points
            x, y = missing.T
            steps = np.stack([b * y - d * x, c * x - a * y], axis=1) / (a * d - b * c)[:, None]
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


@dataclass(frozen=True, eq=False)
class Rotations:
    """Rotation numbers of the orbits of a section.

    The direction is from +y to +x, as free oscillations turn in a plane of displacement and velocity. Complete rotations are left out.
    """

    numbers: np.ndarray  # (m,) in [0, 1); NaN if the orbit has none
    about: np.ndarray  # (m,) index in `centres` of the point that the orbit goes around; -1 if it goes around none of them
    centres: tuple[FixedPoint, ...]


def rotations(section: Section, centres: Sequence[FixedPoint] | None = None) -> Rotations:
    """Rotation numbers of the orbits of a section; a ValueError for a system that loses energy.

    The centres are by default all elliptic fixed points of the map. If an orbit goes around several, the number belongs to the one that it
    goes around most evenly.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> from transitions.section.section import section
    >>> found = rotations(section(vibro_impact_nes(), 0.04, starts=[[0.0, 0.7], [0.0, -0.6]], crossings=400))
    >>> found.numbers.round(5), [found.centres[i].y > 0.0 for i in found.about]
    (array([0.37016, 0.72984]), [True, False])
    """
    if centres is None:
        centres = [point for point in fixed_points(section.plane) if point.elliptic]
    scale = section.plane.scales
    numbers = np.full(len(section.counts), math.nan)
    about = np.full(len(section.counts), -1)
    for m, count in enumerate(section.counts.tolist()):
        points = section.points[m, :count] / scale
        least = math.inf
        for k, centre in enumerate(centres):
            found = _turning(points - np.array([centre.x, centre.y]) / scale)
            if found is not None and found[1] < least:
                about[m], numbers[m], least = k, found[0], found[1]
    return Rotations(numbers, about, tuple(centres))


def about_point(section: Section, place: tuple[float, float]) -> FixedPoint:
    """The elliptic fixed point that Newton's method finds from a place in the plane; a ValueError if it finds no such point."""
    found = fixed_points(section.plane, np.array([place]))
    asked = f"({place[0]:g}, {place[1]:g})"
    if not found or not found[0].elliptic:
        known = [point for point in fixed_points(section.plane) if point.elliptic]
        near = sorted(known, key=lambda point: math.hypot(point.x - place[0], point.y - place[1]))
        listed = f"; nearest: {near[0].place}" if near else "; the section has none"
        raise ValueError(f"no elliptic fixed point is found from {asked} at h = {section.plane.energy:g}{listed}")
    return found[0]


def _turning(points: np.ndarray) -> tuple[float, float] | None:
    """The rotation number of points (k, 2) around the origin, NaN if it does not settle, and the range of the steps in angle. None if the
    points do not go around the origin."""
    if len(points) < FEWEST or not np.abs(points).max() > 1e-9 or _widest_gap(_angles(points)) >= math.pi:
        return None
    # A curve makes the same rotations around all points inside. Seen from its middle, the angle is evenly spread along it.
    found = [step for middle in (np.zeros(2), points.mean(axis=0)) if (step := _mean_step(_angles(points - middle))) is not None]
    rotations, spread = min(found, key=lambda step: (math.isnan(step[0]), step[1]))
    if math.isnan(rotations):
        return math.nan, spread
    if abs(rotations - round(rotations)) * (len(points) - 1) < 0.5:
        return None  # points on a crescent around the origin go back and forth
    return float(np.mod(rotations, 1.0)), spread


def _mean_step(angles: np.ndarray) -> tuple[float, float] | None:
    """Mean step of angles in rotations, NaN if it does not settle, and the range of the steps. None if half of the circle is empty."""
    if _widest_gap(angles) >= math.pi:
        return None
    # On a curve around the origin the step is a continuous function of the angle. So each step is unwrapped beside its neighbours in angle.
    steps = np.mod(np.diff(angles), 2.0 * math.pi)
    order = np.argsort(angles[:-1], kind="stable")
    steps[order] = np.unwrap(steps[order])
    closed = np.append(steps[order], steps[order[0]])
    spread = float(np.ptp(steps))
    half = len(steps) // 2
    if np.abs(np.diff(closed)).max() > _JUMP or abs(weighted_mean(steps[:half]) - weighted_mean(steps[half:])) > SETTLED * 2.0 * math.pi:
        return math.nan, spread
    return weighted_mean(steps) / (2.0 * math.pi), spread


def _angles(points: np.ndarray) -> np.ndarray:
    """Angles from +y to +x."""
    return np.arctan2(points[:, 0], points[:, 1])


def _widest_gap(angles: np.ndarray) -> float:
    """Width of the widest range of the circle without an angle."""
    ordered = np.sort(np.mod(angles, 2.0 * math.pi))
    return float(np.diff(np.append(ordered, ordered[0] + 2.0 * math.pi)).max())
