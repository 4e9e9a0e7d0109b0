"""Rotation numbers of the orbits of a section: turns about an elliptic fixed point at each crossing.

The mean is taken with the weight exp(-1/(t (1 - t))) over the crossings, which converges faster than any power on a curve (Das, Sander,
Saiki, Yorke, Nonlinearity 30 (2017) 4111); on a chaotic orbit it does not settle, which is seen by comparing both halves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from transitions.section import Section
from transitions.section_fixed import FixedPoint, fixed_points

__all__ = ["Rotations", "about_point", "rotations"]

SETTLED = 1e-4
"""Difference of the numbers of both halves of an orbit, in turns, above which it has none."""

FEWEST = 20
"""Crossings that a rotation number is told from, at least."""

_JUMP = 0.8 * math.pi


@dataclass(frozen=True, eq=False)
class Rotations:
    """Rotation numbers (m,) in [0, 1) of the orbits of a section, NaN where there is none, and about which fixed point each is: the index
    in `centres`, -1 where the orbit goes round none of them.

    Turns are counted from +y to +x, as free oscillations turn in a plane of displacement and velocity; whole turns do not show."""

    numbers: np.ndarray
    about: np.ndarray
    centres: tuple[FixedPoint, ...]


def rotations(section: Section, centres: Sequence[FixedPoint] | None = None) -> Rotations:
    """Rotation numbers of the orbits of a section.

    Parameters
    ----------
    section : Section
    centres : sequence of FixedPoint, optional
        By default all elliptic fixed points of the map. An orbit that goes round several is told about the one round which it goes most
        evenly.

    Raises
    ------
    ValueError
        For a system that loses energy.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> from transitions.section import section
    >>> found = rotations(section(vibro_impact_nes(), 0.04, starts=[[0.0, 0.7], [0.0, -0.6]], crossings=400))
    >>> found.numbers.round(5), [found.centres[i].y > 0.0 for i in found.about]
    (array([0.37016, 0.72984]), [True, False])
    """
    if centres is None:
        centres = [point for point in fixed_points(section.plane) if point.elliptic]
    low, high = section.plane.reach
    scale = np.array([0.5 * (high - low), section.plane.height(min(max(0.0, low), high))])
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
    """The fixed point that Newton's method finds from a place in the plane.

    Raises
    ------
    ValueError
        Where it finds none, or one that is not elliptic.
    """
    found = fixed_points(section.plane, np.array([place]))
    asked = f"({place[0]:g}, {place[1]:g})"
    if not found or not found[0].elliptic:
        known = [point for point in fixed_points(section.plane) if point.elliptic]
        near = sorted(known, key=lambda point: math.hypot(point.x - place[0], point.y - place[1]))
        listed = f"; nearest: {near[0].place}" if near else "; the section has none"
        raise ValueError(f"no elliptic fixed point is found from {asked} at h = {section.plane.energy:g}{listed}")
    return found[0]


def _turning(points: np.ndarray) -> tuple[float, float] | None:
    """The rotation number of points (k, 2) about the origin, NaN where it does not settle, and how much the steps differ in angle; None
    where the points do not go round it."""
    if len(points) < FEWEST or not np.abs(points).max() > 1e-9 or _widest_gap(_angles(points)) >= math.pi:
        return None
    # A curve makes the same turns about all points inside; far off its middle the angle says little about the place on it.
    found = [step for middle in (np.zeros(2), points.mean(axis=0)) if (step := _mean_step(_angles(points - middle))) is not None]
    turns, spread = min(found, key=lambda step: (math.isnan(step[0]), step[1]))
    if math.isnan(turns):
        return math.nan, spread
    if abs(turns - round(turns)) * (len(points) - 1) < 0.5:
        return None  # points on a crescent that bends round the origin come and go
    return float(np.mod(turns, 1.0)), spread


def _mean_step(angles: np.ndarray) -> tuple[float, float] | None:
    """Mean step of angles in turns, NaN where it does not settle, and the range of the steps; None where they leave half the circle."""
    if _widest_gap(angles) >= math.pi:
        return None
    # On a curve round the origin the step is a continuous function of the angle: so each step is told from its neighbours in angle.
    steps = np.mod(np.diff(angles), 2.0 * math.pi)
    order = np.argsort(angles[:-1], kind="stable")
    steps[order] = np.unwrap(steps[order])
    closed = np.append(steps[order], steps[order[0]])
    spread = float(np.ptp(steps))
    half = len(steps) // 2
    if np.abs(np.diff(closed)).max() > _JUMP or abs(_mean(steps[:half]) - _mean(steps[half:])) > SETTLED * 2.0 * math.pi:
        return math.nan, spread
    return _mean(steps) / (2.0 * math.pi), spread


def _angles(points: np.ndarray) -> np.ndarray:
    """Angles from +y to +x."""
    return np.arctan2(points[:, 0], points[:, 1])


def _widest_gap(angles: np.ndarray) -> float:
    """Width of the widest range of the circle without an angle."""
    ordered = np.sort(np.mod(angles, 2.0 * math.pi))
    return float(np.diff(np.append(ordered, ordered[0] + 2.0 * math.pi)).max())


def _mean(values: np.ndarray) -> float:
    t = (np.arange(len(values)) + 0.5) / len(values)
    weights = np.exp(-1.0 / (t * (1.0 - t)))
    return float(weights @ values / weights.sum())
