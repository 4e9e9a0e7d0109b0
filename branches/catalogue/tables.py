"""Tables of points and orbits, for export."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from branches.export.table_files import Table

if TYPE_CHECKING:
    from branches.catalogue.rows import FamilyRow
    from branches.catalogue.store import CatalogueStore
    from branches.orbit import Orbit

__all__ = ["DEFAULT_COLUMNS", "POINT_NAMES", "orbit_rows", "orbit_samples", "points_table"]

POINT_NAMES = (
    "family", "point", "label", "h", "alpha", "frequency", "frequency_index", "half_waves", "arclength", "stable", "tau", "tau_half",
    "velocities", "multipliers", "residual", "trivial", "pairing", "reliable", "start_u", "start_v", "flight_times", "impact_speeds",
)  # fmt: skip

DEFAULT_COLUMNS = POINT_NAMES[:15]

_RAGGED = ("flight_times", "impact_speeds")
"""Columns whose rows differ in length from family to family."""


def points_table(catalogue: CatalogueStore, families: Sequence[FamilyRow], columns: Sequence[str] = DEFAULT_COLUMNS) -> Table:
    """The points of families, one family after the other.

    Parameters
    ----------
    catalogue : CatalogueStore
    families : sequence of FamilyRow
    columns : sequence of str
        From `POINT_NAMES`: those of `branches.branch.Branch.points`, the family's id, and the index of the point.

    Returns
    -------
    Table
    """
    parts: dict[str, list[np.ndarray]] = {name: [] for name in columns}
    for row in families:
        points = dict(catalogue.points(row.id))
        points["family"] = np.full(row.points, row.id)
        points["point"] = np.arange(row.points)
        for name in columns:
            parts[name].append(points[name])
    table: Table = {}
    for name, arrays in parts.items():
        if name in _RAGGED:
            table[name] = [row for array in arrays for row in array]
        else:
            table[name] = np.concatenate(arrays) if arrays else np.empty(0)
    return table


def orbit_rows(found: Sequence[tuple[str, Orbit]]) -> Table:
    """A row for each orbit: its properties, its start, and its impacts over a period.

    Parameters
    ----------
    found : sequence of (str, Orbit)
        With the ids of their families.
    """
    orbits = [orbit for _, orbit in found]
    states = [np.concatenate(orbit.sample(np.zeros(1)), axis=1)[0] for orbit in orbits]
    n = orbits[0].system.degrees_of_freedom if orbits else 0
    starts = np.array(states).reshape(len(orbits), 2 * n)
    multipliers = [orbit.multipliers for orbit in orbits]
    return {
        "family": np.array([id for id, _ in found], dtype=str),
        "label": np.array([orbit.label for orbit in orbits], dtype=str),
        "h": np.array([orbit.h for orbit in orbits]),
        "alpha": np.array([orbit.alpha for orbit in orbits]),
        "stable": np.array([-1 if orbit.stable is None else int(orbit.stable) for orbit in orbits], dtype=np.int8),
        "tau": np.array([orbit.tau for orbit in orbits]),
        "tau_half": np.array([orbit.tau_half for orbit in orbits]),
        "multipliers": np.array(multipliers, complex).reshape(len(orbits), len(multipliers[0]) if orbits else 0),
        "residual": np.array([orbit.residual for orbit in orbits]),
        "start_u": starts[:, :n],
        "start_v": starts[:, n:],
        "impact_times": [np.array([impact.time for impact in orbit.impacts]) for orbit in orbits],
        "impact_speeds": [np.array([impact.speed for impact in orbit.impacts]) for orbit in orbits],
        "impact_stops": np.array([" ".join(impact.stop for impact in orbit.impacts) for orbit in orbits], dtype=str),
    }


def orbit_samples(found: Sequence[tuple[str, Orbit]], count: int) -> Table:
    """The motion of each orbit over one period, one orbit after the other: time, displacements u and velocities v.

    Parameters
    ----------
    found : sequence of (str, Orbit)
        With the ids of their families.
    count : int
        Number of evenly spaced times for each orbit, both ends included.
    """
    times, u, v = [], [], []
    for _, orbit in found:
        t = np.linspace(0.0, orbit.period, count)
        at = orbit.sample(t)
        times.append(t)
        u.append(at[0])
        v.append(at[1])
    repeated = np.repeat(np.arange(len(found)), count)
    ids = np.array([id for id, _ in found], dtype=str)
    energies, quarters = (np.array([getattr(orbit, name) for _, orbit in found]) for name in ("h", "alpha"))
    return {
        "orbit": repeated,
        "family": ids[repeated],
        "label": np.array([orbit.label for _, orbit in found], dtype=str)[repeated],
        "h": energies[repeated],
        "alpha": quarters[repeated],
        "time": np.concatenate(times) if times else np.empty(0),
        "u": np.concatenate(u) if u else np.empty((0, 0)),
        "v": np.concatenate(v) if v else np.empty((0, 0)),
    }
