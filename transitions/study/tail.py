"""What dampers still take, up to infinite time, where no impact is possible any more: a quadratic form of the state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["spent_to_rest"]


def spent_to_rest(system: ImpactSystem, dampers: Mapping[str, Any], state: np.ndarray) -> dict[str, float] | None:
    """The energy that each damper takes from a state on, in free motion to infinite time.

    x' = A x; the integral of v'C v is x'P x with A'P + P A = -[0 0; 0 C] (Lyapunov).

    Parameters
    ----------
    system : ImpactSystem
    dampers : mapping of str to (n, n) array_like
        Parts of the damping matrix.
    state : (2n,) ndarray
        (u, v).

    Returns
    -------
    dict of str to float, or None
        None where not all of the motion comes to rest.

    Examples
    --------
    All of the energy:

    >>> from bvp.system import vibro_impact_nes
    >>> system = vibro_impact_nes(lam=0.1)
    >>> round(spent_to_rest(system, {"all": system.damping}, np.array([0.0, 0.0, 0.0, 2.0]))["all"], 12)
    2.0
    """
    from scipy.linalg import solve_continuous_lyapunov

    n = system.degrees_of_freedom
    inverse = np.linalg.inv(system.mass)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ system.stiffness, -inverse @ system.damping]])
    rates = np.linalg.eigvals(matrix)
    if not np.all(rates.real < -1e-9 * np.abs(rates).max()):
        return None
    out = {}
    for name, damper in dampers.items():
        taken = np.zeros((2 * n, 2 * n))
        taken[n:, n:] = 0.5 * (np.asarray(damper) + np.asarray(damper).T)
        out[name] = float(state @ solve_continuous_lyapunov(matrix.T, -taken) @ state) if np.any(taken) else 0.0
    return out
