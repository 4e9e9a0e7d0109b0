"""Where a motion met its stops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["StopEvents"]


@dataclass(frozen=True, eq=False)
class StopEvents:
    """Impacts and touches of a motion, k of them in order of time.

    Attributes
    ----------
    times : (k,) ndarray
    contacts : tuple of k str
        Letters of the contacts, as in `Modes.contact_letters`.
    touches : (k,) bool ndarray
        True where w turned within the contact tolerance of the bound and went on without an impact.
    speeds, losses : (k,) ndarray
        Speed of w towards the stop, >= 0, and energy lost; 0 for a touch.
    before, after : (k, 2n) ndarray
        (u, v) just before and just after.
    """

    times: np.ndarray
    contacts: tuple[str, ...]
    touches: np.ndarray
    speeds: np.ndarray
    losses: np.ndarray
    before: np.ndarray
    after: np.ndarray

    def __len__(self) -> int:
        return len(self.times)
