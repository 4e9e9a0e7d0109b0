"""The matrices that are singular at bifurcations of orbits, with their exact derivatives.

The multipoint problem is linearised with its closing block multiplied by lambda, the parameters being fixed:

    SN  lambda = 1        PD  lambda = -1        NS  lambda = exp(+-i theta)

Of half a period the closing block belongs to N = -(map over T/2). There SN is 1 of N, and SB is -1 of N.
"""

from __future__ import annotations

import numpy as np

from branches.curves.plane import ParameterPlane, closing_block
from bvp.curvature import second_along
from continuation.curves import Linearised, SingularCondition

__all__ = ["MULTIPLIERS", "forced_condition"]

MULTIPLIERS = {"SN": 1.0, "PD": -1.0, "SB": -1.0, "NS": None}
"""lambda of each kind of bifurcation; None: a pair on the unit circle."""


def forced_condition(plane: ParameterPlane, code: str) -> SingularCondition:
    """The condition of a bifurcation of orbits that close after a period, or half of it."""
    problem = plane.problem
    shifted = closing_block(plane)

    def matrices(at: Linearised) -> tuple[np.ndarray, np.ndarray]:
        return at.extra - shifted, shifted

    def along(at: Linearised, direction: np.ndarray) -> np.ndarray:
        found = np.zeros((plane.size, plane.size))
        second = second_along(problem, at.y, direction)
        found[:-2] = second[:-1]
        found[-1] = second[-1]
        return found

    return SingularCondition(matrices, along, MULTIPLIERS[code])
