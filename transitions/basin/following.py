"""Many starts under periodic loads, followed until they are caught by a known attractor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bvp.forcing import Force
from bvp.interrupts import Pace
from bvp.kernels import contact_mode as entry
from bvp.kernels import motion as motion_kernels
from bvp.system import ImpactSystem
from transitions.basin import kernels
from transitions.basin.kernels import CAUGHT, ENDED, LEFT, OPEN, Known
from transitions.sweep import kernels as period_kernels
from transitions.sweep.forced import Carried, ForcedMotion, carried_into, harmonics_of

__all__ = ["CAUGHT", "ENDED", "LEFT", "OPEN", "Followed", "StartFollower", "nothing_known"]


@dataclass(frozen=True, eq=False)
class Followed:
    """What became of B starts.

    Attributes
    ----------
    states : (B, 2n) ndarray
        The last state at phase 0.
    sticking : (B,) int64 ndarray
        Bits of the contacts that stick there.
    outcome : (B,) int64 ndarray
        OPEN: all periods are over; CAUGHT; LEFT: beyond all bounds; ENDED: the simulation could not go on.
    row : (B,) int64 ndarray
        Row of `Known` that caught it, or -1.
    reason : (B,) int64 ndarray
        Where it is ENDED, the reason of `bvp.kernels.motion.move`.
    periods, impacts : (B,) int64 ndarray
    stuck : (B,) bool ndarray
        Whether a stop has stuck.
    """

    states: np.ndarray
    sticking: np.ndarray
    outcome: np.ndarray
    row: np.ndarray
    reason: np.ndarray
    periods: np.ndarray
    impacts: np.ndarray
    stuck: np.ndarray


def nothing_known(width: int) -> Known:
    """`Known` without rows, for states (width,)."""
    return Known(
        np.zeros((0, width)), np.zeros((0, width, width)), np.zeros(0), np.zeros(0), np.zeros((0, 2), dtype=np.int64)
    )  # fmt: skip


class StartFollower(ForcedMotion):
    """Follows many starts of one system, one after the other, as `ForcedMotion` follows one.

    Parameters
    ----------
    system : ImpactSystem
    forces : sequence of loads
        Harmonic with a common base frequency, and constant.

    Attributes
    ----------
    scale : (2n,) ndarray
        Factors with which differences of states are distances: w for displacements, 1 for velocities.
    """

    def __init__(self, system: ImpactSystem, forces: Sequence[Force]) -> None:
        super().__init__(system, forces, Carried(np.zeros(2 * system.degrees_of_freedom)))
        self.forces = tuple(forces)
        self._multiples = np.array(harmonics_of(forces)[1], dtype=float)
        self.scale = np.repeat([2.0 * math.pi / self.period, 1.0], system.degrees_of_freedom)

    def follow(
        self,
        states: np.ndarray,
        most: int,
        known: Known | None = None,
        *,
        sticking: np.ndarray | None = None,
        phase: float = 0.0,
        bound: float = math.inf,
    ) -> Followed:
        """Follow starts (B, 2n) from a phase of the loads on, for so many periods after the first phase 0 at most.

        sticking: bits of the contacts that stick, (B,); by default none. bound: of each displacement and velocity."""
        count, width = np.shape(states)
        n = width // 2
        starts = kernels.Starts(
            states=np.array(states, dtype=float),
            sticking=np.zeros(count, dtype=np.int64) if sticking is None else np.array(sticking, dtype=np.int64),
            energies=np.array(self.system.energy(states[:, :n], states[:, n:]), dtype=float).reshape(count),
            angles=self._multiples * phase,
            outcome=np.zeros((count, 5), dtype=np.int64),
            numbers=np.zeros(kernels.NUMBERS, dtype=np.int64),
            nearness=np.zeros(1),
        )
        given = known or nothing_known(width)
        first = (2.0 * math.pi - phase) / (2.0 * math.pi) * self.period if phase else 0.0
        strobes = period_kernels.Strobes(np.zeros((1, width)), np.zeros(1), np.zeros(1, dtype=np.int64))
        impacts = period_kernels.Impacts(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2 * width)))
        self._forced = self._forced._replace(motion=self._forced.motion._replace(peaks=np.zeros(0)))
        pace = Pace()
        while True:
            motion = self._forced.motion
            motion.counts[entry.PASSES] = pace.passes
            with pace:
                code = kernels.follow_starts(
                    self._modes, self._carry, self.period, first, int(most), float(bound), starts, given, self._forced, strobes, impacts,
                    self._work,
                )  # fmt: skip
            if code == motion_kernels.NEW_MODE:
                self.simulator.table.add(int(motion.counts[entry.PENDING]))
                self._renew()
            elif code != motion_kernels.PAUSED:
                break
        outcome, second = starts.outcome[:, 0], starts.outcome[:, 1]
        return Followed(
            states=starts.states,
            sticking=starts.sticking,
            outcome=outcome.copy(),
            row=np.where(outcome == CAUGHT, second, -1),
            reason=np.where(outcome == ENDED, second, -1),
            periods=starts.outcome[:, 2].copy(),
            impacts=starts.outcome[:, 3].copy(),
            stuck=starts.outcome[:, 4] > 0,
        )

    def bits(self, letters: Sequence[str]) -> int:
        """The bits of contacts with these letters."""
        return sum(1 << c for c, letter in enumerate(self._letters) if letter in letters)

    def carried_state(self, state: np.ndarray, sticking: int) -> Carried:
        """A state (2n,) in which these contacts stick, moved onto their bounds where rounding has left it beside them."""
        return carried_into(self.system, Carried(state, self.named(sticking)))[0]
