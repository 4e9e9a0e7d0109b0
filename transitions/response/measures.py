"""Measures of a followed forced response: its columns, computed when they are asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from branches.events import ids_at_points
from branches.forced.branch import ForcedBranch
from branches.forced.family import ForcedFamily
from branches.harmonics import harmonic_columns
from branches.released.branch import ReleasedBranch
from branches.tables import Table
from bvp.forced import ForcedProblem
from bvp.forcing import split_damping
from bvp.parameters import ParametricSystem
from bvp.simulate import parts_of
from transitions.response.released import free_column, free_names, free_table
from transitions.response.smooth import smooth_measures

__all__ = ["Measures", "column_names", "column_of", "event_columns", "measures_along", "response_table"]


@dataclass(frozen=True, eq=False)
class Measures:
    """What the motion of each of N orbits of period p does in its period.

    Attributes
    ----------
    peaks, rms : (N, n) ndarray
        Largest and root mean square of |u|.
    dissipated : (N, D + S) ndarray
        Energy that each damper and stop takes in a period of the loads, in the order of `bvp.simulate.parts_of`.
    work : (N,) ndarray
        Work of the loads in such a period.
    states : (N, p, 2n) ndarray
        (u, v) at phase 0 of the loads.
    """

    peaks: np.ndarray
    rms: np.ndarray
    dissipated: np.ndarray
    work: np.ndarray
    states: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """Share of each damper and stop in the dissipated energy, (N, D + S); NaN where nothing is dissipated."""
        total = self.dissipated.sum(axis=1, keepdims=True)
        return np.divide(self.dissipated, total, out=np.full_like(self.dissipated, math.nan), where=total > 0.0)


@lru_cache(maxsize=16)
def measures_along(branch: ForcedBranch) -> Measures:
    """The measures of all points of a branch, from exact integrals along the flights."""
    measured = _OrbitMeasures(branch.problem)
    rows = [measured(y, period) for y, period in zip(branch.unknowns, branch.periods.tolist(), strict=True)]
    return Measures(*(np.array(column) for column in zip(*rows, strict=True)))


Row = tuple[np.ndarray, np.ndarray, np.ndarray, float, np.ndarray]
"""Peaks, root mean squares, dissipated energies, work and states of one orbit."""


class _OrbitMeasures:
    """The measures of the orbits of one problem."""

    def __init__(self, problem: ForcedProblem):
        self.problem = problem
        n = problem.degrees_of_freedom
        layout, parametric = problem.parametric.layout, problem.parametric
        moved = parametric.program(problem.released).rows
        self.damping_moves = bool(np.any((moved >= layout.damping.start) & (moved < layout.damping.stop)))
        self.dampers = list(split_damping(problem.system).values())
        stops = problem.modes.contact_stop[problem.contacts[: problem.inner + 1]] if problem.sequence else np.zeros(0, dtype=np.int64)
        self.stop_of_impact = np.eye(len(problem.system.stops))[stops]
        self.pairs = np.triu_indices(n)

    def __call__(self, y: np.ndarray, period: float) -> Row:
        """The measures of one orbit. A period of the orbit is solved once, or by its half."""
        problem, n = self.problem, self.problem.degrees_of_freedom
        p = problem.load_periods
        peaks, totals, more = smooth_measures(problem, y) if problem.is_smooth else self._linear(y)
        parts = 2.0 if problem.half else 1.0
        products = np.zeros((n, n))
        products[self.pairs] = products.T[self.pairs] = totals[n:-n]
        dampers = split_damping(problem.parametric.system(problem.parameters(y))).values() if self.damping_moves else self.dampers
        lost = [float(np.sum(damper * products)) for damper in dampers]
        losses = problem.losses(y) @ self.stop_of_impact if problem.sequence else np.zeros(len(problem.system.stops))
        states = np.array([_state_at(problem, y, k / p, period) for k in range(p)])
        dissipated = np.concatenate([lost, more, losses]) * (parts / p)
        return peaks, np.sqrt(totals[:n] * parts / period), dissipated, float(totals[-n:].sum()) * parts / p, states

    def _linear(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Peaks and integrals of an orbit with linear flights, which has no dampers that are not linear."""
        found, peaks, totals = self.problem.core.measures(np.ascontiguousarray(y))
        if not found:
            raise RuntimeError("the search for the largest displacements of an orbit gave up")
        return peaks, totals, np.zeros(0)


TESTS = ("SN", "BP", "touch", "speed", "flight", "PD", "NS")
"""Test functions: of fold and branch point, the least clearance, impact speed and flight time, what has the zeros of det(M + 1), M
being the map over the solved segment: PD, or SB of half a period; and of the product of 1 - mu_i mu_j over the pairs of its multipliers."""

_PLACES = np.array([0, 1, 2, 3, 4, 7, 8])
"""Where they are among those of a family; the others are the distances from the bounds of the parameter."""


@lru_cache(maxsize=16)
def tests_of(branch: ForcedBranch) -> np.ndarray:
    """The test functions `TESTS` at each point, (N, 7), in the orientation of growing arclength; NaN where they have no value."""
    family, zero = ForcedFamily(branch.problem), np.zeros(branch.problem.unknowns)
    steps = [family.step(y, np.concatenate([tangent, zero]), 0.0) for y, tangent in zip(branch.unknowns, branch.tangents, strict=True)]
    return np.array([np.asarray(step.tests)[_PLACES] if step.converged else np.full(len(_PLACES), math.nan) for step in steps])


def _state_at(problem: ForcedProblem, y: np.ndarray, fraction: float, period: float) -> np.ndarray:
    """The state (2n,) at a fraction of the period since phase 0; without a clock since the first impact."""
    size, unit = 2 * problem.degrees_of_freedom, 0.5 if problem.half else 1.0
    nodes = problem.nodes(y)
    if not problem.has_clock:
        return nodes[0, :size].copy()
    shifts = math.ceil((nodes[0, size] - fraction) / unit)
    target = fraction + shifts * unit
    i = max(0, int(np.searchsorted(nodes[:, size], target, side="right")) - 1)
    state, _ = problem.fly(nodes[i], (target - nodes[i, size]) * period, i)
    # Of half a period x(t + T/2) = -x(t): an odd number of halves turns the state round.
    return -state if problem.half and shifts % 2 else state


def column_names(parametric: ParametricSystem, impacts: int, free: bool = False) -> dict[str, tuple[str, str]]:
    """What can be drawn of orbits with so many impacts in the solved segment: words and mathematical symbol of each, by its name. free: of
    free orbits."""
    from branches.figures.style import symbol_of
    from transitions.sweep.figure import motion_columns

    if free:
        return free_names(parametric, impacts)
    system = parametric.system()
    k, parts = range(1, impacts + 1), parts_of(system)
    found = motion_columns(system.coordinates, parts)
    found |= {f"rms:{name}": ("root mean square", rf"\mathrm{{rms}}\,{symbol_of(name)}") for name in system.coordinates}
    found |= {f"speed:{i}": (f"speed of impact {i}", "v_-") for i in k} | {f"phase:{i}": (f"phase of impact {i}", r"\omega t") for i in k}
    found |= {"period": ("period", "T"), "multiplier": ("largest multiplier", r"\max|\mu|")}
    found |= {f"share:{part}": (f"share of the dissipation, {part}", "") for part in parts}
    found |= {f"test:{name}": (f"test function, {name}", "") for name in TESTS}
    return found | {name: ("", symbol_of(name)) for name in parametric.names}


def column_of(branch: ForcedBranch, name: str) -> np.ndarray:
    """A column with a name of `column_names`, (N, c): c curves. Without the impact that it names there is none."""
    if isinstance(branch, ReleasedBranch):
        return free_column(branch, name)
    system = branch.problem.system
    kind, _, part = name.partition(":")
    if name in branch.problem.parametric.names:
        return np.array([[branch.problem.parameters(y)[name]] for y in branch.unknowns])
    if name in ("speed", "phase"):
        return branch.speeds if name == "speed" else branch.phases % (2.0 * math.pi)
    if kind in ("speed", "phase"):
        return (branch.speeds if kind == "speed" else branch.phases)[:, int(part) - 1 : int(part)]
    if name == "period":
        return branch.periods[:, None]
    if name == "multiplier":
        return branch.largest_multiplier[:, None]
    if kind == "test":
        return tests_of(branch)[:, TESTS.index(part), None]
    measures = measures_along(branch)
    if kind in ("max", "rms"):
        k = system.coordinates.index(part)
        return (measures.peaks if kind == "max" else measures.rms)[:, k : k + 1]
    if kind == "strobe":
        k = system.coordinates.index(part.rstrip("'")) + (len(system.coordinates) if part.endswith("'") else 0)
        return measures.states[:, :, k]
    if name == "work":
        return measures.work[:, None]
    k = parts_of(system).index(part)
    return (measures.dissipated if kind == "dissipated" else measures.shares)[:, k : k + 1]


def response_table(branches: Sequence[ForcedBranch], harmonics: int | None = None, *, events: bool = True) -> Table:
    """The points of some branches as one table; with their harmonics up to a number. events: with the columns of the events.

    branch: its number, from 1; point; the parameters, by their names; period; arclength; stable; phase, speed: of each impact; max.NAME,
    rms.NAME; harmonic.NAME.K; dissipated.PART, share.PART; work; test.NAME of `TESTS`; multipliers; residual; event, coefficient: see
    `event_columns`. Of free orbits: see `free_table`, and the columns of events.
    """
    free = [branch for branch in branches if isinstance(branch, ReleasedBranch)]
    table = free_table(free, harmonics) if free else _table_of_responses(branches, harmonics)
    more = event_columns(branches) if events else {}
    return table | {name: column for name, column in more.items() if name not in table}  # a parameter can have such a name


def event_columns(branches: Sequence[ForcedBranch]) -> Table:
    """The events at the points of some branches.

    event: the id of the event at a point, empty where there is none; several ids are separated by spaces. coefficient: of the normal form
    there, NaN where none is known; of several the first.
    """
    names = [ids_at_points(((event.point, event.id) for event in branch.events), len(branch)) for branch in branches]
    coefficients = [np.full(len(branch), math.nan) for branch in branches]
    for branch, values in zip(branches, coefficients, strict=True):
        for event in branch.events:
            if event.coefficient is not None and math.isnan(values[event.point]):
                values[event.point] = event.coefficient
    return {"event": np.array([id for ids in names for id in ids], dtype=str), "coefficient": np.concatenate(coefficients)}


def _table_of_responses(branches: Sequence[ForcedBranch], harmonics: int | None) -> Table:
    """The columns of points that are not free orbits."""
    first = branches[0]
    coordinates, parts = first.problem.system.coordinates, parts_of(first.problem.system)
    measures = [measures_along(branch) for branch in branches]
    parameters = [[branch.problem.parameters(y) for y in branch.unknowns] for branch in branches]

    def joined(columns: list[np.ndarray]) -> np.ndarray:
        return np.concatenate(columns)

    table: Table = {
        "branch": np.repeat(np.arange(1, len(branches) + 1), [len(branch) for branch in branches]),
        "point": joined([np.arange(len(branch)) for branch in branches]),
    }
    for name in first.problem.parametric.names:
        table[name] = np.array([values[name] for part in parameters for values in part])
    table["period"] = joined([branch.periods for branch in branches])
    table["arclength"] = joined([branch.arclength for branch in branches])
    table["stable"] = joined([branch.stable for branch in branches])
    table["phase"] = [row for branch in branches for row in branch.phases]
    table["speed"] = [row for branch in branches for row in branch.speeds]
    for k, name in enumerate(coordinates):
        table[f"max.{name}"] = joined([found.peaks[:, k] for found in measures])
        table[f"rms.{name}"] = joined([found.rms[:, k] for found in measures])
    if harmonics is not None:
        content = [harmonic_columns(branch, harmonics) for branch in branches]
        table |= {name: joined([columns[name] for columns in content]) for name in content[0]}
    for k, part in enumerate(parts):
        table[f"dissipated.{part.replace(' ', '_')}"] = joined([found.dissipated[:, k] for found in measures])
        table[f"share.{part.replace(' ', '_')}"] = joined([found.shares[:, k] for found in measures])
    table["work"] = joined([found.work for found in measures])
    tests = joined([tests_of(branch) for branch in branches])
    for k, name in enumerate(TESTS):
        table[f"test.{name}"] = tests[:, k]
    table["multipliers"] = joined([branch.multipliers for branch in branches])
    table["residual"] = joined([branch.residual for branch in branches])
    return table
