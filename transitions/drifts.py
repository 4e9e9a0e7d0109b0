"""What a structure is judged by: its displacements, and its drifts - the changes of length across the springs of its coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["drift_rows"]


def drift_rows(system: ImpactSystem, nes: tuple[int, ...] = ()) -> dict[str, np.ndarray]:
    """Rows (n,) of the drifts, by name: u_j - u_i wherever a spring joins two coordinates outside the NES.

    The drift between a coordinate and the ground is its displacement.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> chain = ImpactSystem([[1.0, 0], [0, 1]], [[0, 0], [0, 0]], [[2.0, -1], [-1, 1]], [Stop((1.0, 0), upper=1.0)], ("first", "second"))
    >>> drift_rows(chain)
    {'second - first': array([-1.,  1.])}
    """
    n, names = system.degrees_of_freedom, system.coordinates
    rows = {}
    for j in range(n):
        for i in range(j):
            if system.stiffness[i, j] and i not in nes and j not in nes:
                row = np.zeros(n)
                row[i], row[j] = -1.0, 1.0
                rows[f"{names[j]} - {names[i]}"] = row
    return rows
