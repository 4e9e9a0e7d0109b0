"""The results of a section: the periodic orbits that cross it, its rows as a table, and its record for JSON."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import saltus_core as core

from bvp.simulate import Simulator
from bvp.smooth_flights import flight_of
from transitions.kernels import ROOM
from transitions.section.plane import SectionPlane
from transitions.section.rotation import Rotations
from transitions.section.section import Section

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.catalogue import Catalogue
    from branches.orbit import Orbit
    from branches.tables import Table
    from bvp.closures import Cycle

__all__ = [
    "COLOURS", "IMAGES", "SCHEMA", "OrbitMark", "SectionView", "branch_marks", "catalogue_marks", "crossings_of", "mode_marks",
    "orbit_marks", "view_record", "views_table",
]  # fmt: skip

SCHEMA = 1
PARTS = 16
"""Parts of a period with smooth forces: a flight has so many steps at most."""

COLOURS = ("none", "energy", "lyapunov", "rotation")
IMAGES = ("own", "mirrored", "reversed", "mirrored and reversed")
_SAME = 1e-9  # distance of two crossings of one orbit that is computed twice


@dataclass(frozen=True, eq=False)
class OrbitMark:
    """A periodic orbit on a section: the orbit itself, or its image under the mirror u to -u, the reversal of time, or both, if that is
    another orbit."""

    family: str  # id; a linear mode has its label
    label: str
    stable: int  # 1 elliptic, 0 hyperbolic, -1 undecided
    period: float
    impacts: int  # in a period
    image: str  # one of `IMAGES`
    points: np.ndarray  # (k, 2) its crossings, x and y of the plane

    @property
    def kind(self) -> str:
        """elliptic, hyperbolic or undecided"""
        return {1: "elliptic", 0: "hyperbolic"}.get(self.stable, "undecided")


def crossings_of(plane: SectionPlane, cycle: Cycle) -> tuple[np.ndarray, np.ndarray]:
    """Where a closed orbit crosses u_p = 0 upwards, (k, 2), and downwards, (k, 2), in order of time, in the coordinates of the plane. A
    RuntimeError if the search for a crossing gives up."""
    functional, rows = (of_mode[0] for of_mode in plane.rows(Simulator(plane.system).table.stacked)[:2])
    return _rises(plane, cycle, functional, rows), _rises(plane, cycle, -functional, rows)


def _rises(plane: SectionPlane, cycle: Cycle, functional: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Points (k, 2) at which a functional (3, N) rises through zero along a closed orbit."""
    flight = flight_of(plane.system)
    fastest = float(np.nanmax(plane.system.modes.frequencies))
    parts = 0 if plane.system.smooth_forces is None else PARTS
    size = cycle.after.shape[1]
    functional, rows = np.ascontiguousarray(functional[:, :size]), rows[:, :size]
    last = len(cycle.after) - 1
    points: list[np.ndarray] = []
    sign = 0
    for number, i in enumerate((last, *range(last + 1))):  # the last flight comes first, for the sign at the start of the first one
        pieces = max(1, math.ceil(cycle.duration[i] * fastest / ROOM), math.ceil(parts * cycle.duration[i] / cycle.period))
        step = float(cycle.duration[i]) / pieces
        whole = core.path(flight, np.ascontiguousarray(cycle.after[i]), float(cycle.duration[i]))
        for piece in range(pieces):
            path = core.path(flight, whole.state(step * piece), step)
            times, sign = path.rises(functional, sign)
            if times is None:
                raise RuntimeError("the search for an orbit's crossings of the section gave up")
            points += [rows @ path.state(time) for time in times.tolist()] if number else []
    return np.array(points).reshape(-1, 2)


def orbit_marks(plane: SectionPlane, orbit: Orbit, family: str) -> list[OrbitMark]:
    """The marks of one orbit and of its images that are other orbits; none if it does not cross the section."""
    up, down = crossings_of(plane, orbit.cycle)
    flip, reverse = np.array([-1.0, -1.0]), np.array([1.0, -1.0])
    # The mirror and the reversal of time each turn an upward crossing into a downward one. Both together keep it.
    images = {"own": up, "reversed": reverse * down}
    if plane.system.has_odd_symmetry:
        images |= {"mirrored": flip * down, "mirrored and reversed": flip * reverse * up}
    out: list[OrbitMark] = []
    stable = {True: 1, False: 0, None: -1}[orbit.stable]
    for image in IMAGES:
        points = images.get(image, np.zeros((0, 2)))
        known = [other.points for other in out if len(other.points) == len(points)]
        if len(points) and not any((np.abs(points[:, None] - other).max(axis=-1).min(axis=1) < _SAME).all() for other in known):
            out.append(OrbitMark(family, orbit.label, stable, orbit.period, len(orbit.cycle.times), image, points))
    return out


def mode_marks(plane: SectionPlane) -> list[OrbitMark]:
    """The marks of the linear modes that reach no stop at the energy of the plane. Linear motion beside them is stable."""
    from branches.linear_modes import linear_modes

    system = plane.system
    out = []
    for mode in linear_modes(system):
        shape = system.modes.shapes[:, mode.index]
        if mode.energies[1] <= plane.energy or shape[plane.primary] == 0.0:
            continue
        velocity = np.sign(shape[plane.primary]) * math.sqrt(2.0 * plane.energy) * shape
        point = plane.coordinates(np.zeros((1, 2)), velocity[None])
        out.append(OrbitMark(mode.name, mode.name, 1, 4.0 * mode.alpha, 0, "own", point))
    return out


def branch_marks(plane: SectionPlane, branch: Branch) -> list[OrbitMark]:
    """The marks of all orbits that a branch has at the energy of the plane."""
    return [mark for orbit in branch.orbits_at(energy=plane.energy) for mark in orbit_marks(plane, orbit, branch.id)]


def catalogue_marks(plane: SectionPlane, catalogue: Catalogue) -> list[OrbitMark]:
    """The marks of the linear modes that reach no stop, and of all orbits that a catalogue has at the energy of the plane. Marks with few
    crossings come first. A ValueError for a catalogue of another system."""
    if catalogue.system.describe() != plane.system.describe():
        raise ValueError(f"{catalogue.path} belongs to another system than the section")
    marks = mode_marks(plane)
    for row in catalogue.families(energy=plane.energy):
        marks += branch_marks(plane, catalogue.branch(row.id))
    return sorted(marks, key=lambda mark: len(mark.points))


@dataclass(frozen=True, eq=False)
class SectionView:
    """A section, the periodic orbits marked on it, and the rotation numbers of its orbits (None if not requested)."""

    section: Section
    marks: tuple[OrbitMark, ...] = ()
    rotations: Rotations | None = None

    def values(self, colour: str) -> np.ndarray | None:
        """The values that colour the orbits: their Lyapunov exponents or rotation numbers, (m,); or the energy at each crossing, (m, k).
        None for colour "none"."""
        if colour == "rotation":
            assert self.rotations is not None
            return self.rotations.numbers
        return {"energy": self.section.energies, "lyapunov": self.section.exponents}.get(colour)


def views_table(views: Sequence[SectionView]) -> Table:
    """The data as one table, a row for each point.

    kind: point (of an orbit), mark (of a periodic orbit) or boundary; section: the energy h of the section; orbit: number of the orbit or
    mark, -1 on the boundary; crossing: number of the crossing; time, x, y, energy at the crossing; impacts: all of the orbit;
    lyapunov, rotation: of the orbit; family, label, image, stable (1, 0, -1 undecided): of the mark.
    """
    parts = [part for view in views for part in _parts(view)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _parts(view: SectionView) -> Iterator[dict[str, np.ndarray]]:
    """Columns of the orbits, of each mark, and of the boundary."""
    section = view.section
    orbit, crossing = np.nonzero(~np.isnan(section.times))
    numbers = np.full(len(section.counts), math.nan) if view.rotations is None else view.rotations.numbers
    yield _rows(
        view, "point", section.points[orbit, crossing], orbit=orbit, crossing=crossing, time=section.times[orbit, crossing],
        energy=section.energies[orbit, crossing], impacts=section.impacts[orbit], lyapunov=section.exponents[orbit],
        rotation=numbers[orbit],
    )  # fmt: skip
    for k, mark in enumerate(view.marks):
        yield _rows(
            view, "mark", mark.points, orbit=k, crossing=np.arange(len(mark.points)), energy=section.plane.energy,
            family=mark.family, label=mark.label, image=mark.image, stable=mark.stable,
        )  # fmt: skip
    yield _rows(view, "boundary", section.plane.boundary())


def _rows(view: SectionView, kind: str, points: np.ndarray, **columns: Any) -> dict[str, np.ndarray]:
    """Columns of some rows. A column that is not given is empty."""
    given: dict[str, Any] = {
        "kind": kind, "section": view.section.plane.energy, "orbit": -1, "crossing": -1, "time": math.nan, "x": points[:, 0],
        "y": points[:, 1], "energy": math.nan, "impacts": -1, "lyapunov": math.nan, "rotation": math.nan, "family": "", "label": "",
        "image": "", "stable": -1, **columns,
    }  # fmt: skip
    return {name: np.array(np.broadcast_to(values, (len(points),))) for name, values in given.items()}


def view_record(view: SectionView) -> dict[str, Any]:
    """The data of one section for JSON: null for what does not exist."""
    section, rotations = view.section, view.rotations
    plane = section.plane
    none = np.full(len(section.counts), math.nan)
    numbers, about = (none, none) if rotations is None else (rotations.numbers, rotations.about)
    orbits = [
        {
            "times": section.times[m, :count].tolist(),
            "points": section.points[m, :count].tolist(),
            "energies": section.energies[m, :count].tolist(),
            "impacts": int(section.impacts[m]),
            "end": section.ends[m].name.lower(),
            "sticking_time": float(section.sticking_times[m]),
            "lyapunov": _number(section.exponents[m]),
            "rotation": _number(numbers[m]),
            "about": int(about[m]) if about[m] >= 0 else None,
        }
        for m, count in enumerate(section.counts.tolist())
    ]
    centres = () if rotations is None else rotations.centres
    return {
        "energy": plane.energy,
        "energy_drift": section.drift,
        "points": len(section),
        "impacts": int(section.impacts.sum()),
        "ends": {end.name.lower(): count for end, count in Counter(section.ends).items()},
        "fixed_points": [{"x": p.x, "y": p.y, "period": p.period, "trace": p.trace, "kind": p.kind} for p in centres],
        "boundary": plane.boundary().tolist(),
        "marks": [
            {
                "family": mark.family,
                "label": mark.label or None,
                "kind": mark.kind,
                "period": mark.period,
                "image": mark.image,
                "points": mark.points.tolist(),
            }
            for mark in view.marks
        ],
        "orbits": orbits,
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
