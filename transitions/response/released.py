"""Measures of families of free orbits in a parameter: their columns, as those of families in the energy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from branches.harmonics import harmonic_columns
from branches.orbit import Orbit
from branches.released.branch import ReleasedBranch
from branches.tables import Table
from bvp.parameters import ParametricSystem

__all__ = ["free_column", "free_names", "free_table", "limit_values"]

_NAMES = {
    "h": ("energy", "h"),
    "alpha": ("quarter period", r"\alpha"),
    "period": ("period", "T"),
    "frequency": ("frequency", r"2\pi/T"),
    "speed": ("impact speed", "v_-"),
    "multiplier": ("largest multiplier", r"\max|\mu|"),
    "tau": ("trace of the full period", r"\tau"),
    "tau_half": ("trace of the half period", r"\tau_{1/2}"),
}


def free_names(parametric: ParametricSystem, impacts: int) -> dict[str, tuple[str, str]]:
    """What can be drawn of free orbits with so many impacts in the solved segment: words and mathematical symbol of each, by its name."""
    from branches.figures.style import symbol_of

    found = _NAMES | {f"speed:{i}": (f"speed of impact {i}", "v_-") for i in range(1, impacts + 1)}
    for name in parametric.system().coordinates:
        found[f"start:{name}"] = "displacement at the start", symbol_of(name)
        found[f"start:{name}'"] = "velocity at the start", symbol_of(name, velocity=True)
    return found | {name: ("", symbol_of(name)) for name in parametric.names}


def free_column(branch: ReleasedBranch, name: str) -> np.ndarray:
    """A column with a name of `free_names`, (N, c): c curves."""
    columns = branch.columns
    kind, _, part = name.partition(":")
    if name in branch.problem.parametric.names:
        return np.array([[branch.problem.parameters(y)[name]] for y in branch.unknowns])
    if name == "speed":
        return branch.speeds
    if kind == "speed":
        return branch.speeds[:, int(part) - 1 : int(part)]
    if name == "period":
        return branch.periods[:, None]
    if name == "multiplier":
        return branch.largest_multiplier[:, None]
    if kind == "start":
        k = branch.problem.system.coordinates.index(part.rstrip("'"))
        return columns["start_v" if part.endswith("'") else "start_u"][:, k : k + 1]
    return columns[name][:, None]


def limit_values(orbit: Orbit, name: str) -> np.ndarray:
    """The values (c,) of a column at one orbit, such as the impacting one to which a family leads. Parameters have none there."""
    columns = orbit.columns
    if name == "period":
        return np.array([orbit.period])
    if name == "multiplier":
        return np.abs(columns["multipliers"]).max(axis=1, initial=0.0)
    return np.ravel(columns[{"speed": "impact_speeds"}.get(name, name)][0]) if name in (*columns, "speed") else np.zeros(0)


def free_table(branches: Sequence[ReleasedBranch], harmonics: int | None = None) -> Table:
    """The points of some branches as one table; with their harmonics up to a number.

    branch: its number, from 1; point; the parameters, by their names; then the columns of families in the energy, see
    `branches.branch.Branch`.
    """
    table: Table = {
        "branch": np.repeat(np.arange(1, len(branches) + 1), [len(branch) for branch in branches]),
        "point": np.concatenate([np.arange(len(branch)) for branch in branches]),
    }
    for name in branches[0].problem.parametric.names:
        table[name] = np.array([branch.problem.parameters(y)[name] for branch in branches for y in branch.unknowns])
    columns = [{**branch.columns, **({} if harmonics is None else harmonic_columns(branch, harmonics))} for branch in branches]
    for name, first in columns[0].items():
        parts = [column[name] for column in columns]
        same = all(part.shape[1:] == first.shape[1:] for part in parts)
        table[name] = np.concatenate(parts) if same else [row for part in parts for row in part]
    return table
