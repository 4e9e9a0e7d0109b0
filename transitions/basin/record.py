"""Basins of attraction as data: the grid, the attractor of each start, the attractors, and the saddles between them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from branches.tables import Table
from bvp.contact_sequence import joined_sequence
from bvp.forced import ForcedProblem
from bvp.texts import brief
from transitions.basin.grid import StartGrid, state_names

__all__ = [
    "IMPOSSIBLE", "SIMULATION_ENDED", "UNDECIDED", "Attractor", "AttractorKind", "Basin", "FamilyOrbit", "Saddle", "basin_record",
    "basin_table",
]  # fmt: skip

UNDECIDED, IMPOSSIBLE = -1, -2
"""In place of the number of an attractor: the start was not assigned; it is beyond a stop."""

SIMULATION_ENDED = "the simulation ended"
"""Beginning of the reason of a start that could not be followed on."""


class AttractorKind(Enum):
    """What kind of motion an attractor is. The value says it in words."""

    PERIODIC = "periodic"
    STICKING = "permanent sticking"
    TORUS = "torus"
    CHAOS = "chaos"
    UNBOUNDED = "unbounded"


@brief
@dataclass(frozen=True, eq=False)
class Attractor:
    """An attractor of forced motion.

    Attributes
    ----------
    kind : AttractorKind
    family : str
        Of a solved periodic motion `closure:sequence`, or the id of its family in a file of responses.
    branch : int
        Number of the branch in this file, from 1; 0 if it is not known.
    period : int
        In periods of the loads; 0 if there is none.
    sequence : str
        Contacts of the impacts of a period, from phase 0.
    states : (p, 2n) ndarray
        (u, v) at phase 0 of the loads: in each of the p periods; of a torus and of chaos thousands of points.
    sticking : tuple of str
        Contacts that stick all the time.
    multipliers : (2n,) complex ndarray
        Of the stroboscopic map over the period, by descending modulus; empty without a period.
    exponent : float
        Largest Lyapunov exponent, per unit of time; NaN if it is unbounded.
    problem, unknowns : ForcedProblem and (u,) ndarray, or None
        The solved orbit.
    note : str
        Why a periodic motion was not solved.
    mirror : int
        Index of the attractor of the basin that is its mirror image x(t) -> -x(t + pi/w), its own if it is symmetric; -1 if there is none.
    """

    kind: AttractorKind
    family: str
    period: int
    sequence: str
    states: np.ndarray
    sticking: tuple[str, ...]
    multipliers: np.ndarray
    exponent: float
    branch: int = 0
    problem: ForcedProblem | None = None
    unknowns: np.ndarray | None = None
    note: str = ""
    mirror: int = -1

    @property
    def largest_multiplier(self) -> float:
        """Largest modulus of the multipliers; NaN without a period."""
        return float(np.abs(self.multipliers).max()) if len(self.multipliers) else math.nan

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        return f"Attractor {self.family}, {self.kind.value}", [("period", f"{self.period} of the loads")] if self.period else []


@dataclass(frozen=True, eq=False)
class FamilyOrbit:
    """A periodic orbit of a family.

    Attributes
    ----------
    family, branch
        As of `Attractor`.
    states : (p, 2n) ndarray
        (u, v) at phase 0, in each period of the loads; NaN where a stop comes to rest in summed bounces.
    multipliers : (2n,) complex ndarray
        Of the full period.
    problem, unknowns : ForcedProblem, (u,) ndarray
    """

    family: str
    branch: int
    states: np.ndarray
    multipliers: np.ndarray
    problem: ForcedProblem
    unknowns: np.ndarray

    @property
    def period(self) -> int:
        """In periods of the loads."""
        return self.problem.load_periods

    @property
    def sequence(self) -> str:
        """Contacts of the impacts of the orbit, as of the problem that is solved."""
        return joined_sequence(self.problem.sequence)


@brief
class Saddle(FamilyOrbit):
    """An unstable periodic orbit. Its states are those at the phase of the starts."""

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        return f"Saddle {self.family}", [("period", f"{self.period} of the loads")]


@brief
@dataclass(frozen=True, eq=False)
class Basin:
    """The basins of a grid of N starts, of a system with n coordinates.

    Attributes
    ----------
    grid : StartGrid
    attractors : tuple of Attractor
        By descending number of starts.
    attractor : (N,) int64 ndarray
        Index of the attractor of each start; UNDECIDED or IMPOSSIBLE. `grid.image` makes a picture of it.
    periods, impacts : (N,) int64 ndarray
        Periods of the loads and impacts until the start was assigned.
    saddles : tuple of Saddle
    positions : tuple of (p, 2n) ndarray
        The states of each attractor at the phase of the starts; NaN where their simulation ends before.
    undecided : mapping of str to int
        How many starts were not assigned, by the reason.
    frequency : float
        Base frequency of the loads.
    saddles_from : str
        Where saddles were looked for: "file", "boundary", or "part of the boundary" if that took too long.
    """

    grid: StartGrid
    attractors: tuple[Attractor, ...]
    attractor: np.ndarray
    periods: np.ndarray
    impacts: np.ndarray
    saddles: tuple[Saddle, ...]
    positions: tuple[np.ndarray, ...]
    undecided: Mapping[str, int]
    frequency: float
    saddles_from: str = "boundary"

    def __len__(self) -> int:
        return len(self.attractor)

    @property
    def counts(self) -> np.ndarray:
        """Starts of each attractor, (A,)."""
        return np.bincount(self.attractor[self.attractor >= 0], minlength=len(self.attractors))

    @property
    def possible(self) -> int:
        """Number of starts that are beyond no stop."""
        return int(np.sum(self.attractor != IMPOSSIBLE))

    @property
    def shares(self) -> np.ndarray:
        """Part of the possible starts of each attractor, (A,)."""
        return self.counts / max(1, self.possible)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        title = f"Basin of {len(self)} starts over {self.grid.x.name} and {self.grid.y.name}, {len(self.attractors)} attractors"
        rows = [(f"A{k + 1}", f"{found.family}, {self.shares[k]:.1%}") for k, found in enumerate(self.attractors)]
        return title, rows


def basin_record(basin: Basin) -> dict[str, Any]:
    """A basin as plain data for JSON; attractors count from 1."""
    from branches.tables import plain

    grid = basin.grid

    def axis(one: Any) -> dict[str, Any]:
        return {"name": one.name, "range": [one.low, one.high], "count": one.count}

    def orbit(one: Attractor | Saddle, id: str) -> dict[str, Any]:
        names = {"id": id, "family": one.family, "branch": one.branch or None, "period": one.period, "sequence": one.sequence}
        return {**names, "multipliers": plain(one.multipliers)}

    attractors = [
        {
            **orbit(found, f"A{k + 1}"),
            "kind": found.kind.value,
            "sticking": list(found.sticking),
            "solved": found.problem is not None,
            "starts": int(basin.counts[k]),
            "share": float(basin.shares[k]),
            "exponent": found.exponent if math.isfinite(found.exponent) else None,
            "states": plain(found.states) if found.period else [],
            "positions": plain(basin.positions[k]) if found.period else [],
            "mirror": f"A{found.mirror + 1}" if found.mirror >= 0 else None,
            "note": found.note or None,
        }
        for k, found in enumerate(basin.attractors)
    ]
    saddles = [{**orbit(found, f"S{k + 1}"), "positions": plain(found.states)} for k, found in enumerate(basin.saddles)]
    return {
        "kind": "basin",
        "coordinates": list(grid.coordinates),
        "x": axis(grid.x),
        "y": axis(grid.y),
        "fixed": {name: value for name, value in zip(state_names(grid.coordinates), grid.base.tolist(), strict=True) if name not in
                  (grid.x.name, grid.y.name)},
        "phase": grid.phase,
        "frequency": basin.frequency,
        "starts": basin.possible,
        "impossible": len(basin) - basin.possible,
        "undecided": dict(basin.undecided),
        "attractors": attractors,
        "saddles_from": basin.saddles_from,
        "saddles": saddles,
    }  # fmt: skip


def basin_table(basin: Basin) -> Table:
    """A row for each start: start_u.NAME, start_v.NAME, the state; attractor: its number from 1, 0 undecided, -1 beyond a stop; periods and
    impacts until it was assigned."""
    states, n = basin.grid.states, len(basin.grid.coordinates)
    table: Table = {}
    for part, first in (("u", 0), ("v", n)):
        for k, name in enumerate(basin.grid.coordinates):
            table[f"start_{part}.{name}"] = states[:, first + k]
    table["attractor"] = basin.attractor + 1
    table["periods"] = basin.periods
    table["impacts"] = basin.impacts
    return table
