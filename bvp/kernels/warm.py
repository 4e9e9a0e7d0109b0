"""Compile the kernels that look at an orbit, and keep them on disk (see `branches.kernels.warm`)."""

from __future__ import annotations

import os
from typing import Any

__all__ = ["kept", "stored", "warm"]


def kept(*, discovery: bool = False) -> bool:
    """Whether the kernels were compiled before, here or elsewhere on this machine, and are on disk; those of `discovery` too, if asked."""
    from bvp.kernels.scan import scan
    from bvp.kernels.stability import orbit_stability

    kernels = [scan, orbit_stability]
    if discovery:
        from bvp.kernels.intervals import scan_interval

        kernels = [scan_interval, orbit_stability]
    return all(stored(kernel) for kernel in kernels)


def stored(kernel: Any) -> bool:
    """Whether compiled code of a kernel is on disk."""
    folder, name = kernel.stats.cache_path, kernel.py_func.__name__
    if folder is None or not os.path.isdir(folder):
        return False
    return any(f".{name}-" in entry or entry.startswith(f"{name}-") for entry in os.listdir(folder))


def warm() -> None:
    """Compile admissibility, half map and multipliers, by asking for them once."""
    import numpy as np

    from bvp.kernels.observe import planar_orbit_observe
    from bvp.kernels.result import RESULT
    from bvp.kernels.stability import orbit_stability
    from bvp.multipoint import MultipointProblem
    from bvp.system import vibro_impact_nes

    problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    y = np.array([0.8, 0.6, 1.7])
    ends = np.ones((1, 4))
    result = np.zeros(len(RESULT))
    orbit_stability(*problem._packed, y, ends, problem._period, result)
    planar_orbit_observe(*problem._packed, problem._watched, problem._bounds, y, ends, problem._work, result)
