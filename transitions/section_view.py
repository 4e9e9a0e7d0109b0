"""A section with what is shown on it, and its data: rows of a table, and a record for JSON."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from transitions.section import Section
from transitions.section_marks import Mark
from transitions.section_rotation import Rotations

if TYPE_CHECKING:
    from branches.export.table_files import Table

__all__ = ["COLOURS", "SCHEMA", "SectionView", "view_record", "views_table"]

SCHEMA = 1
COLOURS = ("none", "energy", "lyapunov", "rotation")


@dataclass(frozen=True, eq=False)
class SectionView:
    """A section, the periodic orbits marked on it, and the rotation numbers of its orbits where they were asked for."""

    section: Section
    marks: tuple[Mark, ...] = ()
    rotations: Rotations | None = None

    def values(self, colour: str) -> np.ndarray | None:
        """What colours the orbits, (m,): their Lyapunov exponents or rotation numbers; or the energy at each crossing, (m, k); None for
        colour "none"."""
        if colour == "energy":
            return self.section.energies
        if colour == "lyapunov":
            return self.section.exponents
        if colour == "rotation":
            assert self.rotations is not None
            return self.rotations.numbers
        return None


def views_table(views: Sequence[SectionView]) -> Table:
    """The data as one table, a row a point.

    kind: point (of an orbit), mark (of a periodic orbit) or boundary; section: the energy h of the section; orbit: number of the orbit or
    mark, -1 on the boundary; crossing: number of the crossing; time, x, y, energy at the crossing; impacts: of the orbit in all;
    lyapunov, rotation: of the orbit; family, label, image, stable (1, 0, -1 undecided): of the mark.
    """
    parts = [part for view in views for part in (_points(view), *(_mark(view, k) for k in range(len(view.marks))), _boundary(view))]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _rows(view: SectionView, kind: str, points: np.ndarray, **columns: Any) -> dict[str, np.ndarray]:
    """Columns of some rows; what is not given does not exist there."""
    count = len(points)
    given: dict[str, Any] = {
        "orbit": -1, "crossing": -1, "time": math.nan, "energy": math.nan, "impacts": -1, "lyapunov": math.nan, "rotation": math.nan,
        "family": "", "label": "", "image": "", "stable": -1, **columns,
    }  # fmt: skip
    given |= {"kind": kind, "section": view.section.plane.energy, "x": points[:, 0], "y": points[:, 1]}
    order = ("kind", "section", "orbit", "crossing", "time", "x", "y", "energy", "impacts", "lyapunov", "rotation", "family", "label")
    return {name: np.array(np.broadcast_to(given[name], (count,))) for name in (*order, "image", "stable")}


def _points(view: SectionView) -> dict[str, np.ndarray]:
    section = view.section
    orbit, crossing = np.nonzero(~np.isnan(section.times))
    turning = np.full(len(section.counts), math.nan) if view.rotations is None else view.rotations.numbers
    return _rows(
        view, "point", section.points[orbit, crossing], orbit=orbit, crossing=crossing, time=section.times[orbit, crossing],
        energy=section.energies[orbit, crossing], impacts=section.impacts[orbit], lyapunov=section.exponents[orbit],
        rotation=turning[orbit],
    )  # fmt: skip


def _mark(view: SectionView, k: int) -> dict[str, np.ndarray]:
    mark = view.marks[k]
    return _rows(
        view, "mark", mark.points, orbit=k, crossing=np.arange(len(mark.points)), energy=view.section.plane.energy,
        family=mark.family, label=mark.label, image=mark.image, stable=mark.stable,
    )  # fmt: skip


def _boundary(view: SectionView) -> dict[str, np.ndarray]:
    return _rows(view, "boundary", view.section.plane.boundary())


def view_record(view: SectionView) -> dict[str, Any]:
    """The data of one section for JSON: null for what does not exist."""
    section, turning = view.section, view.rotations
    plane = section.plane
    orbits = []
    for m, count in enumerate(section.counts.tolist()):
        about = -1 if turning is None else int(turning.about[m])
        orbits.append(
            {
                "times": section.times[m, :count].tolist(),
                "points": section.points[m, :count].tolist(),
                "energies": section.energies[m, :count].tolist(),
                "impacts": int(section.impacts[m]),
                "end": section.ends[m].name.lower(),
                "sticking_time": float(section.held_times[m]),
                "lyapunov": _number(section.exponents[m]),
                "rotation": None if turning is None else _number(turning.numbers[m]),
                "about": None if about < 0 else about,
            }
        )
    centres = () if turning is None else turning.centres
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
