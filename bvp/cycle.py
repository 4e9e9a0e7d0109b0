"""The whole period of a solved orbit as a list of impacts and free flights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bvp.checks import reals
from bvp.frozen import changeable
from bvp.kernels.flight import flow_state, sample_flights
from bvp.kernels.segment import count_impacts, unfold
from bvp.multipoint import MultipointProblem
from bvp.shown import shown
from bvp.system import ImpactSystem

__all__ = ["Cycle", "cycle_of"]


@dataclass(frozen=True, eq=False)
class Cycle:
    """A closed orbit, impact by impact.

    Parameters
    ----------
    system : ImpactSystem
    before, after : (P, N) float
        Modal states at each impact, in order of time from the orbit's start.
    duration : (P,) float
        Free time after each impact; the last one leads to the first.
    contact : (P,) int
        Contact hit (row of the contact arrays of `Modes`); -1 for a plain cut of a flight.
    lead : float
        Time from the orbit's start to the first impact.
    """

    system: ImpactSystem
    before: np.ndarray
    after: np.ndarray
    duration: np.ndarray
    contact: np.ndarray
    lead: float

    @cached_property
    def period(self) -> float:
        """T."""
        return float(np.sum(self.duration))

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the impacts in [0, T), (P,)."""
        return self.lead + np.concatenate([[0.0], np.cumsum(self.duration[:-1])])

    @cached_property
    def letters(self) -> tuple[str, ...]:
        """Contact letters in order of time."""
        letters = self.system.modes.contact_letters
        return tuple([letters[c] for c in self.contact.tolist()])

    @property
    def speeds(self) -> np.ndarray:
        """Speeds of approach at the impacts, (P,)."""
        modes = self.system.modes
        return modes.contact_side[self.contact] * np.einsum("ij,ij->i", modes.contact_rate[self.contact], self.before)

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities at any times.

        Parameters
        ----------
        times : (m,) float
            From the orbit's start; the orbit is periodic. At an impact the velocity is the one after it.

        Returns
        -------
        u, v : (m, n) float

        Raises
        ------
        ValueError, TypeError
            For times that are not finite numbers in one row.
        """
        modes = self.system.modes
        try:
            times = np.atleast_1d(reals(times))
        except (TypeError, ValueError):
            raise TypeError(f"times are numbers; received {shown(times)}") from None
        if times.ndim != 1:
            raise ValueError(f"times are a list of numbers; received an array of shape {times.shape}")
        if not np.isfinite(times).all():
            k = int(np.flatnonzero(~np.isfinite(times))[0])
            raise ValueError(f"times are finite; number {k + 1} of {times.size} is {times[k]}")
        n = self.system.degrees_of_freedom
        states = np.empty((times.size, 2 * n))
        # The flight that the orbit starts in began before its start.
        begins = np.concatenate([[self.times[-1] - self.period], self.times])
        flights = np.concatenate([self.after[-1:], self.after])
        sample_flights(modes.flight, begins, flights, np.mod(times, self.period), states)
        physical = states @ modes.to_state.T
        return physical[:, :n], physical[:, n:]

    def cut(self, pieces: int) -> Cycle:
        """The same orbit with each flight cut into `pieces` of equal duration by plain nodes (contact -1)."""
        if pieces == 1:
            return self
        modes = self.system.modes
        count, size = self.after.shape
        before = np.empty((count * pieces, size))
        after = np.empty((count * pieces, size))
        duration = np.repeat(self.duration / pieces, pieces)
        contact = np.full(count * pieces, -1, dtype=np.int64)
        for i in range(count):
            at = i * pieces
            contact[at] = self.contact[i]
            before[at], after[at] = self.before[i], self.after[i]
            for j in range(1, pieces):
                flow_state(modes.flight, self.after[i], float(j * duration[at]), after[at + j])
                before[at + j] = after[at + j]
        return Cycle(self.system, before, after, duration, contact, self.lead)


def cycle_of(problem: MultipointProblem, y: np.ndarray) -> Cycle:
    """The whole period of the solution y of a multipoint problem, unfolded by the reversals of its ends.

    Parameters
    ----------
    problem : MultipointProblem
    y : (u,) float

    Returns
    -------
    Cycle
    """
    count = int(count_impacts(problem.segment.shape))
    size = problem.size
    before = np.empty((count, size))
    after = np.empty((count, size))
    duration = np.empty(count)
    row = np.empty(count, dtype=np.int64)
    y = changeable(y)
    _, lead = unfold(problem.segment, y, problem.end_states(y), before, after, duration, row, np.empty((2, size)))
    modes = problem.system.modes
    contact = problem.contacts[row].copy()
    mirrored = problem.segment.bound[row] * np.einsum("ij,ij->i", problem.segment.gap[row], before) < 0.0
    contact[mirrored] = modes.contact_opposite[contact[mirrored]]
    return Cycle(problem.system, before, after, duration, contact, float(lead))
