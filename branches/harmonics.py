"""Harmonics along a followed family: columns for tables and files, for families in the energy, in a parameter, and of forced orbits."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from branches.forced.branch import ForcedBranch
from branches.record import HARMONIC
from bvp.harmonics import harmonics
from bvp.multipoint import NotConverged

if TYPE_CHECKING:
    from branches.branch import Branch

__all__ = ["amplitudes_along", "harmonic_columns", "harmonic_notes", "harmonics_in", "with_harmonics"]


@lru_cache(maxsize=16)
def _along(branch: Branch | ForcedBranch, highest: int) -> tuple[np.ndarray, dict[int, str]]:
    """See `amplitudes_along`; and why there are none, by point."""
    found = np.full((len(branch), highest + 1, branch.problem.system.degrees_of_freedom), np.nan)
    failures = {}
    for i in range(len(branch)):
        try:
            y = branch.unknowns[i] if isinstance(branch, ForcedBranch) else branch.orbit(i).solution.y
            found[i] = harmonics(branch.problem, y, highest)
        except (NotConverged, RuntimeError) as error:
            failures[i] = str(error)
    return found, failures


def amplitudes_along(branch: Branch | ForcedBranch, highest: int) -> np.ndarray:
    """The harmonics of each point of a branch, as of `bvp.harmonics.harmonics`: (N, K + 1, n). NaN where `harmonic_notes` says why."""
    return _along(branch, highest)[0]


def harmonic_notes(branch: Branch | ForcedBranch, highest: int) -> list[str]:
    """What is said of points whose path cannot be sampled: none, or a line."""
    failures = _along(branch, highest)[1]
    if not failures:
        return []
    first, why = next(iter(failures.items()))
    points = f"{len(failures)} of {len(branch)} points are not computed, first at point {first}"
    return [f"warning  the harmonics of {points}: {why}"]


def harmonic_columns(branch: Branch | ForcedBranch, highest: int) -> dict[str, np.ndarray]:
    """The same as columns (N,) with the names ``harmonic.COORDINATE.K``."""
    found = amplitudes_along(branch, highest)
    names = branch.problem.system.coordinates
    return {f"{HARMONIC}{name}.{k}": found[:, k, c] for c, name in enumerate(names) for k in range(highest + 1)}


def with_harmonics(branch: Branch, highest: int) -> Branch:
    """A family in the energy with these columns among its points; files of it then have them.

    Parameters
    ----------
    branch : Branch
    highest : int
        Number K of the highest harmonic.

    Examples
    --------
    >>> import saltus
    >>> branch = with_harmonics(saltus.trace("S13O00+", energy=(0.5, 0.6)), 3)
    >>> [name for name in branch.points if name.startswith("harmonic.u1")]
    ['harmonic.u1.0', 'harmonic.u1.1', 'harmonic.u1.2', 'harmonic.u1.3']
    """
    return branch.with_columns(harmonic_columns(branch, highest))


def harmonics_in(branch: Branch) -> dict[str, np.ndarray]:
    """What `with_harmonics` has added to a branch: for each coordinate (N, K + 1); nothing if it has added none."""
    found: dict[str, list[np.ndarray]] = {}
    for name, column in branch.points.items():
        if name.startswith(HARMONIC):
            found.setdefault(name.removeprefix(HARMONIC).rpartition(".")[0], []).append(column)
    return {name: np.column_stack(columns) for name, columns in found.items()}
