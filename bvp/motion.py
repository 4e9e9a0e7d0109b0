"""The result of a simulation: its events, its dense output and its energy budget."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bvp.checks import finite_numbers, read_only
from bvp.interrupts import Pace
from bvp.kernels import contact_mode as places
from bvp.kernels import motion as kernels
from bvp.kernels.contact_mode import ContactModes, flight_of
from bvp.kernels.energy_budget import integral_work
from bvp.kernels.extrema import PEAK_ROWS, peak_flight
from bvp.kernels.impact import work_array
from bvp.kernels.motion import Flights, sample, spent, states_after
from bvp.texts import brief, listed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bvp.forcing import Forcing
    from bvp.kernels.smooth_motion import SmoothModes
    from bvp.system import ImpactSystem

__all__ = ["STATUS", "Batch", "ContactInterval", "EnergyMark", "EventKind", "Motion", "MotionStatus", "StopEvents"]


class MotionStatus(Enum):
    """How a motion ended. The value is a text for the user."""

    DURATION_REACHED = "the duration was reached"
    IMPACTS_FULL = "the most impacts allowed have happened; allow more impacts to run on"
    SIMULTANEOUS = (
        "two stops are hit at the same instant and their impulses interact; the outcome is not defined by restitution"
    )
    INTERRUPTED = "the run was interrupted; run on from the final state"
    OUTSIDE = "the start lies beyond a stop; start with every gap coordinate within its bounds"
    PIERCED = (
        "rounding has carried a gap beyond its stop by more than the contact tolerance; the results hold up to there, and a start from "
        "that state moved into its bounds goes on"
    )
    UNDECIDED = "contacts are made and lost again without time passing; change the state at which the motion stopped a little"
    EXHAUSTED = "the search for the next impact gave up; ask for a shorter duration"
    UNRESOLVED = (
        "the smooth forces grow beyond what the steps of a flight can follow; the results hold up to there: look at the forces at the "
        "last state"
    )


STATUS = {
    kernels.REACHED: MotionStatus.DURATION_REACHED,
    kernels.MOST: MotionStatus.IMPACTS_FULL,
    kernels.INTERACTING: MotionStatus.SIMULTANEOUS,
    kernels.STARTED_OUTSIDE: MotionStatus.OUTSIDE,
    kernels.PIERCED: MotionStatus.PIERCED,
    kernels.CYCLING: MotionStatus.UNDECIDED,
    kernels.GAVE_UP: MotionStatus.EXHAUSTED,
    kernels.UNRESOLVED: MotionStatus.UNRESOLVED,
}
"""Status of each final return value of the kernels. The other values ask for another call."""


class EventKind(Enum):
    """What happened at an event of a motion."""

    START = places.START
    IMPACT = places.IMPACT
    TOUCH = places.TOUCHED
    STICK = places.STICK
    RELEASE = places.RELEASE
    BREAK = places.BREAK
    PIECE = places.PIECE
    CHATTER = places.CHATTER


@dataclass(frozen=True)
class EnergyMark:
    """The moment at which a fraction of the initial energy is gone: time (None where it is not reached) and what each damper and stop has
    dissipated until then."""

    fraction: float
    time: float | None
    dissipated: Mapping[str, float]


@dataclass(frozen=True)
class ContactInterval:
    """A part of the motion in one contact mode: begin, end, and the letters of the contacts that stick (none in free flight)."""

    begin: float
    end: float
    sticking: tuple[str, ...]


@brief
@dataclass(frozen=True, eq=False)
class Motion:
    """A simulated motion: k events, each at the beginning of a flight (row 0 is the start). The arrays are read-only.

    Attributes
    ----------
    system : ImpactSystem
    status : MotionStatus
    duration : float
        Time reached.
    kinds : (k,) int64 ndarray
        Values of `EventKind`. CHATTER marks the time from which bounces are summed as a series, and STICK the time when they end.
    times : (k,) ndarray
    contacts : (k,) int64 ndarray
        Index into `Modes.contact_letters`, -1 for none.
    speeds, losses : (k,) ndarray
        Speed of approach across the gap and energy lost, at impacts and when a contact begins to stick.
    before : (k, 2n) ndarray
        (u, v) just before each event.
    sums : (k, D + S + 1) ndarray
        Up to each event: energy dissipated by each of D dampers and S stops, work done by the loads.
    totals : (D + S + 1,) ndarray
        The same over the full motion.
    parts : tuple of D + S str
        Names of the dampers, then "stop a", "stop b", ...
    impacts, touches : int
    last_impact : float or None
        Time of the last impact.
    clear_from : float or None
        Time after which no impact is possible, by proof; None if there is no proof.
    sticking_time : float
        Time with a sticking contact.
    switch_error : float
        Largest error, in time, of the ends of chattering.
    initial_energy, energy : float
        At time 0 and at `duration`.
    marks : tuple of EnergyMark
    start, final : (2n,) ndarray
        (u, v).
    """

    system: ImpactSystem
    forcing: Forcing
    status: MotionStatus
    duration: float
    kinds: np.ndarray
    times: np.ndarray
    contacts: np.ndarray
    speeds: np.ndarray
    losses: np.ndarray
    before: np.ndarray
    sums: np.ndarray
    totals: np.ndarray
    parts: tuple[str, ...]
    impacts: int
    touches: int
    last_impact: float | None
    clear_from: float | None
    sticking_time: float
    switch_error: float
    initial_energy: float
    energy: float
    marks: tuple[EnergyMark, ...]
    start: np.ndarray
    final: np.ndarray
    numbers: np.ndarray
    """(k, 3) kind, contact and contact mode of each event."""
    states: np.ndarray
    """(k, N) state of its contact mode in which each flight begins."""
    contact_modes: ContactModes | SmoothModes
    """The contact modes that `numbers` counts."""
    plot: ClassVar[Callable[..., Axes]]
    """The package `saltus` adds it."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, field.name, read_only(value))

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        parts = listed([f"{name} {energy:.4g}" for name, energy in self.dissipated.items()])
        title = f"Motion to time {self.duration:.10g}: {self.impacts} impacts; {self.status.value}"
        energies = f"{self.initial_energy:.6g} at the start, {self.energy:.6g} at the end, balance error {self.balance_error:.1e}"
        return title, [("energy", energies), ("dissipated", parts)]

    @property
    def work(self) -> float:
        """Work done by the loads."""
        return float(self.totals[-1])

    @property
    def dissipated(self) -> dict[str, float]:
        """Energy dissipated by each damper and stop."""
        return dict(zip(self.parts, self.totals[:-1].tolist(), strict=True))

    @property
    def balance(self) -> float:
        """Initial energy + work - dissipated - present energy: 0 but for rounding."""
        return float(np.sum([self.initial_energy, self.work, *(-self.totals[:-1]), -self.energy]))

    @property
    def balance_error(self) -> float:
        """|balance| over the initial energy, or over the energy that came in where there was none."""
        incoming = self.initial_energy if self.initial_energy > 0.0 else max(abs(self.work), self.totals[:-1].sum(), abs(self.energy))
        return abs(self.balance) / incoming if incoming > 0.0 else abs(self.balance)

    @property
    def turnover(self) -> float:
        """The largest of the energies that passed through: the initial one, the work of the loads, what was dissipated. Rounding goes with
        it, not with an initial energy that is small beside it."""
        return max(self.initial_energy, abs(self.work), float(self.totals[:-1].sum()))

    @cached_property
    def after(self) -> np.ndarray:
        """(u, v) just after each event, (k, 2n)."""
        out = np.empty((len(self.times), len(self.start)))
        states_after(self.contact_modes, self.numbers, self.states, out)
        return read_only(out)

    @cached_property
    def stop_events(self) -> StopEvents:
        """Its impacts and touches alone."""
        rows = np.flatnonzero((self.kinds == EventKind.IMPACT.value) | (self.kinds == EventKind.TOUCH.value))
        letters = self.system.modes.contact_letters
        return StopEvents(
            times=self.times[rows],
            contacts=tuple(letters[c] for c in self.contacts[rows]),
            touches=self.kinds[rows] == EventKind.TOUCH.value,
            speeds=self.speeds[rows],
            losses=self.losses[rows],
            before=self.before[rows],
            after=self.after[rows],
        )

    @cached_property
    def peaks(self) -> np.ndarray:
        """Largest |u| of each coordinate, (n,); RuntimeError where the search for them gives up."""
        peaks = np.abs(self.start[: self.system.degrees_of_freedom])
        modes, durations = self.contact_modes, np.diff(np.append(self.times, self.duration))
        size = modes.matrix.shape[1]
        scratch = np.zeros((PEAK_ROWS, 1, size)), np.zeros((2, 1)), work_array(size, 1)
        flights = [flight_of.kinds[type(modes)].function(modes, f) for f in range(len(modes.pairs))]
        for f, state, duration in zip(self.numbers[:, 2].tolist(), self.states, durations.tolist(), strict=True):
            if not peak_flight(flights[f], modes.leave[f], state, duration, peaks, peaks[:0], *scratch):
                raise RuntimeError("the search for the largest displacements gave up; run a shorter duration")
        return read_only(peaks)

    def flights(self, part: slice) -> Flights:
        """Begins, numbers and states of some of the flights, and the end of the last of them, as the kernels take them."""
        end = float(self.times[part.stop]) if part.stop < len(self.times) else self.duration
        return Flights(self.times[part], self.numbers[part], self.states[part], end)

    @cached_property
    def contact_intervals(self) -> tuple[ContactInterval, ...]:
        """The motion as intervals of free flight and of sticking."""
        letters = self.system.modes.contact_letters
        sticking = np.asarray(self.contact_modes.sticking)[self.numbers[:, 2]]
        for row in np.flatnonzero(self.kinds == EventKind.CHATTER.value):
            sticking[row] = sticking[row - 1]
        first = np.flatnonzero(np.concatenate([[True], sticking[1:] != sticking[:-1]]))
        ends = [*self.times[first[1:]].tolist(), self.duration]
        return tuple(
            ContactInterval(float(self.times[k]), end, tuple(letter for c, letter in enumerate(letters) if int(sticking[k]) >> c & 1))
            for k, end in zip(first, ends, strict=True)
        )

    def sample(self, times: Any) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities at any times of the motion, after the event at the time of an event.

        From a CHATTER event to the next one, while bounces are summed, the gap counts as closed; the bounces that are left out rise by
        speed^2/(2 |w''|) at most, with the speed after the impact before.

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
            For a time outside the motion.
        """
        wanted = self._times(times)
        out = np.empty((len(wanted), len(self.start)))
        z = np.empty(self.contact_modes.matrix.shape[1])
        for part in Pace().blocks(len(wanted)):
            sample(self.contact_modes, self.times, self.numbers, self.states, wanted[part], z, out[part])
        if np.count_nonzero(self.times == 0.0) == 1:
            # Beside a load the state of a contact mode is a difference, which rounds: rest would have an energy.
            out[wanted == 0.0] = self.start
        n = self.system.degrees_of_freedom
        return out[:, :n], out[:, n:]

    def spent(self, times: Any) -> np.ndarray:
        """What each damper and stop has dissipated, and the work of the loads, up to any times: (j, D + S + 1)."""
        wanted = self._times(times)
        out = np.empty((len(wanted), len(self.totals)))
        products = len(self.contact_modes.weight)
        work, integral = integral_work(self.contact_modes.matrix.shape[1], products), np.empty(products)
        for part in Pace().blocks(len(wanted)):
            spent(self.contact_modes, self.times, self.numbers, self.states, self.sums, wanted[part], work, integral, out[part])
        return out

    def _times(self, times: Any) -> np.ndarray:
        wanted = finite_numbers(times, "times", None)
        wrong = ~((wanted >= 0.0) & (wanted <= self.duration))
        if np.any(wrong):
            raise ValueError(f"the motion covers times 0 to {self.duration:g}; received {wanted[wrong][0]:g}")
        return wanted


@brief
@dataclass(frozen=True, eq=False)
class Batch:
    """What is left of many motions, b of them: arrays of length b.

    Attributes
    ----------
    status : tuple of MotionStatus
        Of each motion.
    duration, last_impact, clear_from, sticking_time, initial_energy, energy : (b,) ndarray
        As in `Motion`; NaN where there is none.
    impacts, touches : (b,) int64 ndarray
    totals : (b, D + S + 1) ndarray
        Dissipated by each damper and stop, and the work of the loads.
    marks : (b, Q, D + S + 2) ndarray
        Time of each mark and the totals there; NaN where it is not reached.
    final : (b, 2n) ndarray
    peaks : (b, n) ndarray or None
    parts : tuple of D + S str
    fractions : (Q,) ndarray
    """

    status: tuple[MotionStatus, ...]
    duration: np.ndarray
    impacts: np.ndarray
    touches: np.ndarray
    last_impact: np.ndarray
    clear_from: np.ndarray
    sticking_time: np.ndarray
    initial_energy: np.ndarray
    energy: np.ndarray
    totals: np.ndarray
    marks: np.ndarray
    final: np.ndarray
    peaks: np.ndarray | None
    parts: tuple[str, ...]
    fractions: np.ndarray

    @property
    def balance(self) -> np.ndarray:
        """Initial energy + work - dissipated - present energy, (b,)."""
        return self.initial_energy + self.totals[:, -1] - self.totals[:, :-1].sum(axis=1) - self.energy


@brief
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
