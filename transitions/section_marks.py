"""Where periodic orbits cross a section: those of a catalogue's families, and the linear modes that reach no stop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from branches.linear_modes import linear_modes
from bvp.damped import Mover
from bvp.kernels.flight import flow_state
from transitions.kernels.section import ROOM, rises
from transitions.section_plane import SectionPlane

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.orbit import Orbit
    from bvp.cycle import Cycle

__all__ = ["IMAGES", "Mark", "branch_marks", "catalogue_marks", "crossings_of", "mode_marks", "orbit_marks"]

IMAGES = ("own", "mirrored", "reversed", "mirrored and reversed")
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Mark:
    """A periodic orbit on a section.

    Attributes
    ----------
    family, label : str
        Id and label; a linear mode has its label for both.
    stable : int
        1 elliptic, 0 hyperbolic, -1 undecided.
    period : float
    impacts : int
        In a period.
    image : str
        One of `IMAGES`: the orbit itself, or its image under the mirror u to -u, the reversal of time, or both, where that is another one.
    points : (k, 2) ndarray
        Its crossings, x and y of the plane.
    """

    family: str
    label: str
    stable: int
    period: float
    impacts: int
    image: str
    points: np.ndarray

    @property
    def kind(self) -> str:
        """elliptic, hyperbolic or undecided"""
        return {1: "elliptic", 0: "hyperbolic"}.get(self.stable, "undecided")


def crossings_of(plane: SectionPlane, cycle: Cycle) -> tuple[np.ndarray, np.ndarray]:
    """Where a closed orbit crosses u_p = 0 upwards, (k, 2), and downwards, (k, 2), in order of time, in the coordinates of the plane.

    Raises
    ------
    RuntimeError
        Where the search for a crossing gives up.
    """
    return _passages(plane, cycle, 1.0), _passages(plane, cycle, -1.0)


def _passages(plane: SectionPlane, cycle: Cycle, side: float) -> np.ndarray:
    functional, rows = (of_phase[0] for of_phase in plane.rows(Mover(plane.system).table.stacked)[:2])
    functional = side * functional
    blocks = plane.system.modes.blocks
    fastest = float(np.nanmax(plane.system.modes.frequencies))
    last = len(cycle.after) - 1
    times, scratch, state = np.empty(ROOM), np.empty(cycle.after.shape[1]), np.empty(cycle.after.shape[1])
    points: list[np.ndarray] = []
    sign = 0
    for turn, i in enumerate((last, *range(last + 1))):  # the last flight first, for the sign with which the first one begins
        pieces = max(1, math.ceil(cycle.duration[i] * fastest / ROOM))
        step = float(cycle.duration[i]) / pieces
        for piece in range(pieces):
            begin = np.empty_like(state)
            flow_state(*blocks, np.ascontiguousarray(cycle.after[i]), step * piece, begin)
            found, sign = rises(*blocks, *functional, begin, step, sign, times, scratch)
            if found < 0:
                raise RuntimeError("the search for an orbit's crossings of the section gave up")
            for time in times[:found] if turn else ():
                flow_state(*blocks, begin, float(time), state)
                points.append(rows @ state)
    return np.array(points).reshape(-1, 2)


def orbit_marks(plane: SectionPlane, orbit: Orbit, family: str) -> list[Mark]:
    """The marks of one orbit and of its images that are other orbits; none where it does not cross the section."""
    up, down = crossings_of(plane, orbit.cycle)
    flip, reverse = np.array([-1.0, -1.0]), np.array([1.0, -1.0])
    # The mirror and the reversal of time each make an upward crossing a downward one; both together do not.
    images = {"own": up, "reversed": reverse * down}
    if plane.system.has_odd_symmetry:
        images |= {"mirrored": flip * down, "mirrored and reversed": flip * reverse * up}
    out: list[Mark] = []
    stable = {True: 1, False: 0, None: -1}[orbit.stable]
    for image in IMAGES:
        points = images.get(image)
        if points is None or not len(points) or any(_same(points, other.points) for other in out):
            continue
        out.append(Mark(family, orbit.label, stable, orbit.period, len(orbit.cycle.times), image, points))
    return out


def _same(points: np.ndarray, others: np.ndarray) -> bool:
    """Whether two sets of points are the same."""
    if len(points) != len(others):
        return False
    apart = np.abs(points[:, None] - others[None]).max(axis=-1)
    return bool((apart.min(axis=1) < _SAME).all())


def mode_marks(plane: SectionPlane) -> list[Mark]:
    """The marks of the linear modes that reach no stop at the energy of the plane: linear motion beside them is stable."""
    system = plane.system
    out = []
    for mode in linear_modes(system):
        shape = system.modes.shapes[:, mode.index]
        if mode.energies[1] <= plane.energy or shape[plane.primary] == 0.0:
            continue
        velocity = np.sign(shape[plane.primary]) * math.sqrt(2.0 * plane.energy) * shape
        point = plane.coordinates(np.zeros((1, 2)), velocity[None])
        out.append(Mark(mode.name, mode.name, 1, 4.0 * mode.alpha, 0, "own", point))
    return out


def catalogue_marks(plane: SectionPlane, catalogue: Catalogue) -> list[Mark]:
    """The linear modes that reach no stop, and every orbit that the families of a catalogue have at the energy of the plane, those with few
    crossings first.

    Raises
    ------
    ValueError
        For a catalogue of another system.
    """
    marks = mode_marks(plane)
    for row in catalogue.families(energy=plane.energy):
        branch = catalogue.branch(row.id)
        if branch.system.describe() != plane.system.describe():
            raise ValueError(f"{catalogue.path} belongs to another system than the section")
        marks += branch_marks(plane, branch)
    return sorted(marks, key=lambda mark: len(mark.points))


def branch_marks(plane: SectionPlane, branch: Branch) -> list[Mark]:
    """The marks of all orbits that a branch has at the energy of the plane."""
    return [mark for orbit in branch.orbits_at(energy=plane.energy) for mark in orbit_marks(plane, orbit, branch.id)]
