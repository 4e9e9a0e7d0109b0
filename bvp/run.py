"""Run a system from a state: every impact until a duration, with dense output that is as exact as the flight."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.impact import checked_state, contact_index
from bvp.kernels import impact as impact_kernels
from bvp.kernels import run as kernels

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Run", "RunStatus", "run"]


class RunStatus(Enum):
    """How a run ended; the value says it in words."""

    DURATION_REACHED = "the duration was reached"
    IMPACTS_FULL = "max_impacts impacts and touches were recorded; give a larger max_impacts to run on"
    CHATTERING = (
        "the bounces have become smaller than the contact tolerance: chattering comes to rest on a stop; the run ends here"
    )
    STICKING = "the motion is pressed against a stop and stays on it; the run ends where it sticks"
    SIMULTANEOUS = (
        "two stops are hit at the same instant and their impulses interact; the outcome is not defined by restitution"
    )
    OUTSIDE = "the start lies beyond a stop; start with every gap coordinate within its bounds"
    EXHAUSTED = "the search for the next impact gave up; ask for a shorter duration"


_STATUS = {
    kernels.REACHED: RunStatus.DURATION_REACHED,
    kernels.FULL: RunStatus.IMPACTS_FULL,
    kernels.CHATTERING: RunStatus.CHATTERING,
    kernels.STICKING: RunStatus.STICKING,
    kernels.SIMULTANEOUS: RunStatus.SIMULTANEOUS,
    kernels.STARTED_OUTSIDE: RunStatus.OUTSIDE,
    kernels.GAVE_UP: RunStatus.EXHAUSTED,
}


@dataclass(frozen=True, eq=False)
class Run:
    """What a run recorded: k events (impacts, and touches where `touches` is true).

    Attributes
    ----------
    system : ImpactSystem
    status : RunStatus
    duration : float
        Time reached.
    times : (k,) ndarray
    contacts : tuple of k str
        Letters of the contacts hit, as in `Modes.contact_letters`.
    touches : (k,) bool ndarray
        True where w turned within the contact tolerance of the bound and went on without an impact.
    speeds : (k,) ndarray
        Speed of w at the impact, along the side of the contact: >= 0, and 0 for a touch.
    before, after : (k, 2n) ndarray
        (u, v) just before and just after each event.
    start, final : (2n,) ndarray
        (u, v) at time 0 and at `duration`.
    """

    system: ImpactSystem
    status: RunStatus
    duration: float
    times: np.ndarray
    contacts: tuple[str, ...]
    touches: np.ndarray
    speeds: np.ndarray
    before: np.ndarray
    after: np.ndarray
    start: np.ndarray
    final: np.ndarray
    flight_states: np.ndarray
    """(k + 1, 2n) states of the modes in which the flights begin."""

    def sample(self, times: Any) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities at any times of the run, after the impact at the time of an impact.

        Parameters
        ----------
        times : (j,) array_like
            Within 0 and `duration`.

        Returns
        -------
        u, v : (j, n) ndarray

        Raises
        ------
        ValueError
            For a time outside the run.

        Examples
        --------
        >>> from bvp.system import ImpactSystem, Stop
        >>> ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), 0.0, 1.0)])
        >>> u, v = run(ball, [0.5], [1.0], 3.0).sample([0.25, 0.5, 1.0])
        >>> u[:, 0], v[:, 0]
        (array([0.75, 1.  , 0.5 ]), array([ 1., -1., -1.]))
        """
        wanted = np.atleast_1d(np.asarray(times, dtype=float))
        if wanted.ndim != 1:
            raise ValueError(f"times is a list of times; received shape {wanted.shape}")
        wrong = ~((wanted >= 0.0) & (wanted <= self.duration))
        if np.any(wrong):
            raise ValueError(f"the run covers times 0 to {self.duration:g}; received {wanted[wrong][0]:g}")
        modes = self.system.modes
        begins = np.concatenate([[0.0], self.times])
        out = np.empty((len(wanted), len(modes.matrix)))
        kernels.sample(*modes.blocks, begins, self.flight_states, wanted, out)
        state = out @ modes.to_state.T
        n = self.system.degrees_of_freedom
        return state[:, :n], state[:, n:]


def run(system: ImpactSystem, u: Any, v: Any, duration: float, max_impacts: int = 10_000, leaving: str | None = None) -> Run:
    """Run a system from the state (u, v), impact after impact.

    Parameters
    ----------
    system : ImpactSystem
    u, v : (n,) array_like
        Displacements and velocities at time 0.
    duration : float
        Time to run, >= 0.
    max_impacts : int
        Most events recorded; the run ends when they are full.
    leaving : str, optional
        Letter of the contact that the start is on exactly, after its impact. A start within the contact tolerance of a stop
        is on it without being told.

    Returns
    -------
    Run
        `status` says how it ended; no ending is an exception, whatever the restitution.

    Raises
    ------
    ValueError
        For a state of the wrong length or not finite, a negative duration, a max_impacts below 0, an unknown contact.

    Examples
    --------
    >>> from bvp.system import ImpactSystem, Stop
    >>> ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), 0.0, 1.0)])
    >>> flight = run(ball, [0.5], [1.0], 3.0)
    >>> flight.times, flight.contacts, flight.status.name
    (array([0.5, 1.5, 2.5]), ('+', '-', '+'), 'DURATION_REACHED')
    """
    modes = system.modes
    start = checked_state(system, u, v)
    if not (isinstance(duration, (int, float, np.number)) and 0.0 <= duration < np.inf):
        raise ValueError(f"duration is a finite time of 0 or more; received {duration!r}")
    if isinstance(max_impacts, bool) or not isinstance(max_impacts, (int, np.integer)) or max_impacts < 0:
        raise ValueError(f"max_impacts is a whole number of 0 or more; received {max_impacts!r}")
    size, room = len(start), int(max_impacts)
    times, contacts, touches = np.zeros(room), np.zeros(room, dtype=np.int64), np.zeros(room, dtype=np.int64)
    before, after = np.zeros((room, size)), np.zeros((room, size))
    z = modes.from_state @ start
    first = z.copy()
    work = impact_kernels.work_array(size, len(modes.contact_side))
    status, count, reached = kernels.run(
        *modes.blocks,
        *modes.contacts,
        modes.contact_push,
        modes.contact_restitution,
        contact_index(system, leaving),
        float(duration),
        times,
        contacts,
        touches,
        before,
        after,
        z,
        work,
    )
    hit = contacts[:count]
    touched = touches[:count] != 0
    rates = np.einsum("kN,kN->k", modes.contact_rate[hit], before[:count])
    return Run(
        system=system,
        status=_STATUS[status],
        duration=float(reached),
        times=times[:count].copy(),
        contacts=tuple(modes.contact_letters[c] for c in hit),
        touches=touched,
        speeds=np.where(touched, 0.0, modes.contact_side[hit] * rates),
        before=before[:count] @ modes.to_state.T,
        after=after[:count] @ modes.to_state.T,
        start=start,
        final=modes.to_state @ z,
        flight_states=np.vstack([first, after[:count]]),
    )
