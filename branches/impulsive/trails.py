"""The impulsive motion at many energies, event by event, with the derivatives of all that is measured with respect to log h."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from branches.discovery.scope import require_two_degrees
from branches.impulsive.start import check_system, impulsive_state
from bvp.kernels import trail as kernel
from bvp.kernels.impact import work_array

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Trails", "Traces"]

_LARGEST = 1 << 20


@dataclass(frozen=True, eq=False)
class Traces:
    """Events of M motions, E at most; those beyond `count` mean nothing.

    count : (M,) events, -1 where the motion could not be followed.
    kind : (M, E) the contact hit, or `bvp.kernels.trail.ZERO` (the gap coordinate passes zero) or `TURN` (its velocity does).
    time, miss, gap : (M, E) time; what is transverse to the end set - the other displacement at a ZERO (end origin), the other velocity
    at a TURN (rest) and at an impact (stop) -; the gap coordinate. passing : (M, E) square of the rate at which what tells the event
    passes zero, zero where two events of a kind meet, such as an impact and a turning point at grazing. time_slope, miss_slope,
    gap_slope, passing_slope: their derivatives by log h.
    """

    count: np.ndarray
    kind: np.ndarray
    time: np.ndarray
    time_slope: np.ndarray
    miss: np.ndarray
    miss_slope: np.ndarray
    gap: np.ndarray
    gap_slope: np.ndarray
    passing: np.ndarray
    passing_slope: np.ndarray

    def rows(self, which: np.ndarray | slice) -> Traces:
        """Those of some of the motions."""
        return Traces(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


class Trails:
    """Follows the impulsive start of a system for a time.

    Parameters
    ----------
    system : ImpactSystem
        Two degrees of freedom, one stop with equal gaps on both sides, undamped and elastic, absorber and primary named.
    longest : float

    Raises
    ------
    ValueError
        For another system.
    """

    def __init__(self, system: ImpactSystem, longest: float):
        check_system(system)
        require_two_degrees(system, "periodic impulsive orbits are found by one scan over energy on")
        if len(system.stops) != 1 or not system.has_odd_symmetry:
            raise ValueError("periodic impulsive orbits need one stop with equal gaps on both sides: they pass through the origin")
        self.system = system
        self.longest = longest
        self.modes = modes = system.modes
        row = modes.contact_gap[0]
        rows = [row]
        for _ in range(3):
            rows.append(rows[-1] @ modes.matrix)
        self.functional = np.ascontiguousarray(rows)
        across = np.array([-row[1], row[0]]) / math.hypot(row[0], row[1])
        self.across_displacement = np.concatenate([across, np.zeros(2)])
        self.across_velocity = np.concatenate([np.zeros(2), across])
        self.room = 64

    def start(self, energy: float) -> np.ndarray:
        """Start state of the modes (4,)."""
        return self.modes.from_state @ np.concatenate(impulsive_state(self.system, energy))

    def _follow(self, levels: np.ndarray, longest: float) -> tuple[np.ndarray, ...]:
        modes = self.modes
        unit = self.start(1.0)
        starts = np.exp(0.5 * levels)[:, None] * unit
        changes = 0.5 * starts
        while True:
            shape = (len(levels), self.room)
            kind = np.zeros(shape, dtype=np.int64)
            time, shift = np.zeros(shape), np.zeros(shape)
            state, change = np.zeros((*shape, 4)), np.zeros((*shape, 4))
            count = np.zeros(len(levels), dtype=np.int64)
            kernel.trail(
                *modes.blocks, *modes.contacts, modes.contact_push, modes.contact_restitution, self.functional, starts, changes,
                float(longest), kind, time, shift, state, change, count, work_array(4, len(modes.contact_side)),
            )  # fmt: skip
            if not np.any(count == kernel.FULL) or self.room >= _LARGEST:
                return kind, time, shift, state, change, np.where(count < 0, -1, count)
            self.room *= 2

    def at(self, levels: np.ndarray) -> Traces:
        """The motions at log h = `levels` (M,)."""
        kind, time, shift, state, change, count = self._follow(levels, self.longest)
        rows = np.array([self.across_displacement, self.across_velocity, *self.functional[:3]])
        values, slopes = state @ rows.T, change @ rows.T
        passing, turning = np.where(kind == kernel.ZERO, 0, 1)[..., None], np.where(kind == kernel.TURN, 4, 3)[..., None]
        rate, rate_slope = _pick(values, turning), _pick(slopes, turning)
        return Traces(
            count, kind, time, shift, _pick(values, passing), _pick(slopes, passing), values[..., 2], slopes[..., 2], rate**2,
            2.0 * rate * rate_slope,
        )  # fmt: skip

    def segment(self, level: float, event: int) -> tuple[np.ndarray, tuple[str, ...], np.ndarray, np.ndarray]:
        """The motion up to an event: its start (4,), the contacts hit before (k), the states after them (k, 4), and the times of
        flight (k + 1,)."""
        kind, time, _, state, _, count = self._follow(np.array([level]), self.longest)
        if count[0] <= event:
            raise ValueError(f"the motion has {count[0]} events; there is no event {event}")
        modes = self.modes
        hits = np.flatnonzero(kind[0, :event] >= 0)
        contacts = kind[0, hits]
        before = state[0, hits]
        speed = np.einsum("ij,ij->i", modes.contact_rate[contacts], before)
        after = before - ((1.0 + modes.contact_restitution[contacts]) * speed)[:, None] * modes.contact_push[contacts]
        stamps = np.concatenate([[0.0], time[0, hits], [time[0, event]]])
        return self.start(math.exp(level)), tuple(modes.contact_letters[c] for c in contacts), after, np.diff(stamps)


def _pick(values: np.ndarray, which: np.ndarray) -> np.ndarray:
    return np.take_along_axis(values, which, axis=2)[..., 0]
