"""What is an orbit of a family, and the noise of its slope."""

from __future__ import annotations

from typing import Any

from bvp.orbits import RESULT_INDEX

__all__ = ["CONDITION_NOISE", "TANGENT_NOISE", "is_orbit"]

_CONVERGED, _RESIDUAL, _GAVE_UP = (RESULT_INDEX[name] for name in ("converged", "residual", "gave_up"))

_ACCURATE = 1e-12
"""Scaled residual below which a solution is an orbit."""

TANGENT_NOISE = 2e-13
"""Noise of the slope, as a part of the energy, times the square of the smallest pivot over the steepness: the direction of the tangent is
uncertain by as much. The steepness is the change of the scaled unknowns for a unit of arclength."""

CONDITION_NOISE = 5e-17
"""Noise of the slope, as a part of the energy, times the square of the conditioning over the steepness, at most."""


def is_orbit(result: Any) -> bool:
    """Whether the step converged accurately and no search of its observation gave up."""
    return result[_CONVERGED] == 1.0 and result[_RESIDUAL] < _ACCURATE and not result[_GAVE_UP] == 1.0
