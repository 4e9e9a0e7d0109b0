"""The impulsive start: no displacement, and no velocity but that of the oscillator (the primary mass)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from branches.search.scope import require_conservative

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["check_system", "impulsive_state", "oscillator_period"]


def check_system(system: ImpactSystem) -> tuple[int, int]:
    """Indices of the absorber and the primary.

    Raises
    ------
    ValueError
        Where the system does not name them, or loses energy.
    """
    if system.absorber is None or system.primary is None:
        raise ValueError(
            "an impulsive orbit starts with the velocity of the primary alone, and this system names no absorber and primary "
            "(in a scene NES and LO under [coordinates])"
        )
    require_conservative(system, "impulsive orbits at an energy")
    return system.absorber, system.primary


def impulsive_state(system: ImpactSystem, energy: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and velocities (n,) with all of the energy in the velocity of the primary, which is positive.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> impulsive_state(vibro_impact_nes(), 2.0)
    (array([0., 0.]), array([0., 2.]))
    """
    _, primary = check_system(system)
    velocity = np.zeros(system.degrees_of_freedom)
    velocity[primary] = math.sqrt(2.0 * energy / system.mass[primary, primary])
    return np.zeros(system.degrees_of_freedom), velocity


def oscillator_period(system: ImpactSystem) -> float:
    """Period of the primary on its own spring to the ground (the row sum of the stiffness), as if no absorber were there. A primary
    without such a spring has none; then it is the period of the slowest mode that vibrates.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> oscillator_period(vibro_impact_nes(mu=0.1, sigma=0.1)) / (2.0 * math.pi)
    1.0
    """
    _, primary = check_system(system)
    ground = float(np.sum(system.stiffness[primary]))
    if ground > 1e-12 * float(np.max(np.abs(system.stiffness[primary]))):
        return 2.0 * math.pi * math.sqrt(float(system.mass[primary, primary]) / ground)
    frequencies = system.modes.frequencies
    return 2.0 * math.pi / float(np.min(frequencies[frequencies > 0.0]))
