"""One motion of any system between its stops: damped, forced, with inelastic impacts, chattering and sticking, and where its energy goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import checked_damper
from bvp.forcing import Forcing, forcing_of
from bvp.impact import checked_state, contact_index
from bvp.kernels import motion as kernels
from bvp.kernels.chatter import LEVELS
from bvp.kernels.impact import work_array
from bvp.kernels.integral import integral_work
from bvp.phases import PhaseTable, meters_of
from bvp.shares import absorber_energy, split_damping

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["Batch", "EventKind", "Mark", "Motion", "MotionStatus", "Mover", "Stretch", "run"]


class MotionStatus(Enum):
    """How a motion ended; the value says it in words."""

    DURATION_REACHED = "the duration was reached"
    IMPACTS_FULL = "the most impacts allowed have happened; allow more impacts to run on"
    SIMULTANEOUS = (
        "two stops are hit at the same instant and their impulses interact; the outcome is not defined by restitution"
    )
    OUTSIDE = "the start lies beyond a stop; start with every gap coordinate within its bounds"
    UNDECIDED = "contacts are made and lost again without time passing; change the state at which the motion stopped a little"
    EXHAUSTED = "the search for the next impact gave up; ask for a shorter duration"


_STATUS = {
    kernels.REACHED: MotionStatus.DURATION_REACHED,
    kernels.MOST: MotionStatus.IMPACTS_FULL,
    kernels.INTERACTING: MotionStatus.SIMULTANEOUS,
    kernels.STARTED_OUTSIDE: MotionStatus.OUTSIDE,
    kernels.CYCLING: MotionStatus.UNDECIDED,
    kernels.GAVE_UP: MotionStatus.EXHAUSTED,
}


class EventKind(Enum):
    """What happened at an event of a motion."""

    START = kernels.START
    IMPACT = kernels.IMPACT
    TOUCH = kernels.TOUCHED
    STICK = kernels.STICK
    RELEASE = kernels.RELEASE
    BREAK = kernels.BREAK
    PIECE = kernels.PIECE


@dataclass(frozen=True)
class Mark:
    """The moment at which a fraction of the initial energy is gone: time (None where it is not reached) and what each damper and stop has
    dissipated until then."""

    fraction: float
    time: float | None
    dissipated: Mapping[str, float]


@dataclass(frozen=True)
class Stretch:
    """A part of the motion with the same contacts held: begin, end, and their letters (none in free flight)."""

    begin: float
    end: float
    held: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Motion:
    """What a motion recorded: k events, each the begin of a flight (row 0 is the start).

    Attributes
    ----------
    system : ImpactSystem
    status : MotionStatus
    duration : float
        Time reached.
    kinds : (k,) int64 ndarray
        Values of `EventKind`.
    times : (k,) ndarray
    contacts : (k,) int64 ndarray
        Index into `Modes.contact_letters`, -1 for none.
    speeds, losses : (k,) ndarray
        Speed of approach across the gap and energy lost, at impacts and where a contact begins to be held.
    before : (k, 2n) ndarray
        (u, v) just before each event.
    sums : (k, D + S + 1) ndarray
        Up to each event: energy dissipated by each of D dampers and S stops, work done by the loads.
    totals : (D + S + 1,) ndarray
        The same over the whole motion.
    parts : tuple of D + S str
        Names of the dampers, then "stop a", "stop b", ...
    impacts, touches : int
    last_impact : float or None
        Time of the last impact.
    clear_from : float or None
        Time from which it is proven that no impact is possible any more; None where it is not.
    held_time : float
        Time with a contact held.
    switch_error : float
        Largest error, in time, of the ends of chattering.
    initial_energy, energy : float
        At time 0 and at `duration`.
    marks : tuple of Mark
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
    held_time: float
    switch_error: float
    initial_energy: float
    energy: float
    marks: tuple[Mark, ...]
    start: np.ndarray
    final: np.ndarray
    numbers: np.ndarray
    """(k, 3) kind, contact and phase of each event."""
    states: np.ndarray
    """(k, N) state of its phase in which each flight begins."""
    mover: Mover

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

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """The motion as stretches of free flights and of contacts held."""
        letters = self.system.modes.contact_letters
        held = [self.mover.table.phases[f].held for f in self.numbers[:, 2]]
        out: list[Stretch] = []
        for k, bits in enumerate(held):
            names = tuple(letter for c, letter in enumerate(letters) if bits >> c & 1)
            end = float(self.times[k + 1]) if k + 1 < len(held) else self.duration
            if out and out[-1].held == names:
                out[-1] = Stretch(out[-1].begin, end, names)
            else:
                out.append(Stretch(float(self.times[k]), end, names))
        return tuple(out)

    def sample(self, times: Any) -> tuple[np.ndarray, np.ndarray]:
        """Displacements and velocities at any times of the motion, after the event at the time of an event.

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
        phases = self.mover.table.stacked
        kernels.sample(phases, self.times, self.numbers, self.states, wanted, np.empty(phases.matrix.shape[1]), out)
        n = self.system.degrees_of_freedom
        return out[:, :n], out[:, n:]

    def spent(self, times: Any) -> np.ndarray:
        """What each damper and stop has dissipated, and the work of the loads, up to any times: (j, D + S + 1)."""
        wanted = self._times(times)
        out = np.empty((len(wanted), len(self.totals)))
        phases = self.mover.table.stacked
        kernels.spent(phases, self.times, self.numbers, self.states, self.sums, wanted, self.mover.integral_work(), np.empty(len(phases.weight)), out)
        return out

    def shares(self, times: Any) -> tuple[np.ndarray, np.ndarray]:
        """Energy of the absorber, and of the rest, at any times: (j,) each; ValueError where the system names no absorber."""
        mass, stiffness = absorber_energy(self.system)
        u, v = self.sample(times)
        absorber = 0.5 * (np.einsum("ji,ik,jk->j", v, mass, v) + np.einsum("ji,ik,jk->j", u, stiffness, u))
        return absorber, self.system.energy(u, v) - absorber

    def _times(self, times: Any) -> np.ndarray:
        wanted = np.atleast_1d(np.asarray(times, dtype=float))
        if wanted.ndim != 1:
            raise ValueError(f"times is a list of times; received shape {wanted.shape}")
        wrong = ~((wanted >= 0.0) & (wanted <= self.duration))
        if np.any(wrong):
            raise ValueError(f"the motion covers times 0 to {self.duration:g}; received {wanted[wrong][0]:g}")
        return wanted


@dataclass(frozen=True, eq=False)
class Batch:
    """What is left of many motions, b of them: arrays of length b.

    Attributes
    ----------
    status : tuple of MotionStatus
        Of each motion.
    duration, last_impact, clear_from, held_time, initial_energy, energy : (b,) ndarray
        As in `Motion`; NaN where there is none.
    impacts, touches : (b,) int64 ndarray
    totals : (b, D + S + 1) ndarray
        Dissipated by each damper and stop, and the work of the loads.
    marks : (b, Q, D + S + 2) ndarray
        Time of each mark and the totals there; NaN where it is not reached.
    final : (b, 2n) ndarray
    parts : tuple of D + S str
    fractions : (Q,) ndarray
    """

    status: tuple[MotionStatus, ...]
    duration: np.ndarray
    impacts: np.ndarray
    touches: np.ndarray
    last_impact: np.ndarray
    clear_from: np.ndarray
    held_time: np.ndarray
    initial_energy: np.ndarray
    energy: np.ndarray
    totals: np.ndarray
    marks: np.ndarray
    final: np.ndarray
    parts: tuple[str, ...]
    fractions: np.ndarray

    @property
    def balance(self) -> np.ndarray:
        """Initial energy + work - dissipated - present energy, (b,)."""
        return self.initial_energy + self.totals[:, -1] - self.totals[:, :-1].sum(axis=1) - self.energy


class Mover:
    """Runs motions of one system under given loads; phases of contact are made when a motion first needs them, and kept.

    Parameters
    ----------
    system : ImpactSystem
    forces : Constant, Harmonic, Record or a list of them, optional
    dampers : mapping of str to (n, n) array_like, optional
        Parts of the damping matrix, which they sum to; by default "gaps" and "rest" (`bvp.shares.split_damping`).

    Raises
    ------
    ValueError
        For loads of another length, for dampers that do not sum to the damping matrix.
    """

    def __init__(self, system: ImpactSystem, forces: Any = None, dampers: Mapping[str, Any] | None = None) -> None:
        self.system = system
        self.forcing = forcing_of(forces, system.degrees_of_freedom)
        self.dampers = split_damping(system) if dampers is None else checked_damper(system.damping, dampers)
        self.meters = meters_of(self.dampers, self.forcing, len(system.stops))
        self.table = PhaseTable(system, self.forcing, self.meters)
        self.parts = (*self.dampers, *(f"stop {stop.name}" for stop in system.stops))

    def integral_work(self) -> np.ndarray:
        """Scratch array for the integrals."""
        return integral_work(self.table.stacked.matrix.shape[1], len(self.meters.weight))

    def run(
        self,
        u: Any,
        v: Any,
        duration: float,
        max_impacts: int = 10_000_000,
        leaving: str | None = None,
        marks: Sequence[float] = (0.5, 0.85, 0.9, 0.99),
    ) -> Motion:
        """The motion from (u, v); see `run`."""
        system = self.system
        start = checked_state(system, u, v)
        fractions = self._checked(duration, max_impacts, marks)
        contact = contact_index(system, leaving)
        n, parts = system.degrees_of_freedom, len(self.parts)
        initial = system.energy(start[:n], start[n:])
        counts, clock = np.zeros(kernels.COUNTS, dtype=np.int64), np.zeros(kernels.CLOCK)
        counts[kernels.LEAVING] = counts[kernels.CONTACT] = contact
        clock[kernels.INITIAL] = initial
        turns = np.zeros((len(self.forcing.loads), 2))
        sums, marked = np.zeros((parts + 1, 2)), np.zeros((len(fractions) if initial > 0.0 else 0, parts + 3))
        marked[:, 0] = fractions[: len(marked)]
        x = np.concatenate([start, np.zeros(2 * len(self.forcing.loads))])
        table, values = np.zeros((LEVELS, 2 * n + parts + 2)), np.zeros(2 * n + parts + 2)
        before, out = start.copy(), np.zeros(len(self.meters.weight))
        pieces: list[kernels.Log] = []
        room, z = 256, np.zeros(0)
        while True:
            phases = self.table.stacked
            size = phases.matrix.shape[1]
            if counts[kernels.PENDING] >= 0:
                z = np.zeros(size)
            log = kernels.Log(
                np.zeros((room, 3), dtype=np.int64), np.zeros((room, 3)), np.zeros((room, 2 * n)), np.zeros((room, size)), np.zeros((room, parts + 1))
            )  # fmt: skip
            counts[kernels.EVENTS] = 0
            status = kernels.move(
                phases, float(duration), int(max_impacts), z, x, counts, clock, turns, sums, marked, table, values, before, log,
                work_array(size, len(phases.restitution)), self.integral_work(), out,
            )  # fmt: skip
            pieces.append(kernels.Log(*(array[: counts[kernels.EVENTS]] for array in log)))
            if status == kernels.NEW_PHASE:
                self.table.add(int(counts[kernels.PENDING]))
            elif status != kernels.FULL:
                break
            room = min(2 * room, 1 << 16)
        phases = self.table.stacked
        size = phases.matrix.shape[1]
        states = np.vstack([np.pad(piece.states, ((0, 0), (0, size - piece.states.shape[1]))) for piece in pieces])
        numbers, values_, before_, sums_ = (np.concatenate([getattr(piece, key) for piece in pieces]) for key in ("numbers", "values", "before", "sums"))
        final = phases.leave[counts[kernels.PHASE]] @ np.pad(z, (0, size - len(z)))
        return Motion(
            system=system,
            forcing=self.forcing,
            status=_STATUS[status],
            duration=float(duration) if status == kernels.REACHED else float(clock[kernels.TIME]),
            kinds=numbers[:, 0],
            times=values_[:, 0],
            contacts=numbers[:, 1],
            speeds=values_[:, 1],
            losses=values_[:, 2],
            before=before_,
            sums=sums_,
            totals=sums.sum(axis=1),
            parts=self.parts,
            impacts=int(counts[kernels.IMPACTS]),
            touches=int(counts[kernels.TOUCHES]),
            last_impact=float(clock[kernels.LAST_IMPACT]) if counts[kernels.IMPACTS] else None,
            clear_from=float(clock[kernels.CLEAR_TIME]) if counts[kernels.CLEAR] else None,
            held_time=float(clock[kernels.HELD_TIME]),
            switch_error=float(clock[kernels.SWITCH_ERROR]),
            initial_energy=initial,
            energy=system.energy(final[:n], final[n:]),
            marks=tuple(
                Mark(float(fraction), *_mark(marked[k], self.parts) if k < counts[kernels.MARK] else (None, {}))
                for k, fraction in enumerate(fractions)
            ),
            start=start,
            final=final,
            numbers=numbers,
            states=states,
            mover=self,
        )


    def _checked(self, duration: Any, max_impacts: Any, marks: Sequence[float]) -> np.ndarray:
        """The marks, ascending, where all three are as they should be; ValueError else."""
        if not (isinstance(duration, (int, float, np.number)) and 0.0 <= duration < np.inf):
            raise ValueError(f"duration is a finite time of 0 or more; received {duration!r}")
        if isinstance(max_impacts, bool) or not isinstance(max_impacts, (int, np.integer)) or max_impacts < 0:
            raise ValueError(f"max_impacts is a whole number of 0 or more; received {max_impacts!r}")
        fractions = np.unique(np.asarray(marks, dtype=float))
        if not np.all((fractions > 0.0) & (fractions < 1.0)):
            raise ValueError(f"marks are fractions of the initial energy between 0 and 1; received {list(marks)}")
        return fractions

    def run_many(
        self, states: Any, duration: float, max_impacts: int = 10_000_000, marks: Sequence[float] = (0.5, 0.9, 0.99)
    ) -> Batch:
        """Motions from many states, without a record of their events.

        Parameters
        ----------
        states : (b, 2n) array_like
            (u, v) of each start.
        duration, max_impacts, marks
            As in `run`.

        Raises
        ------
        ValueError
            As `run`, and for states of another shape.
        """
        system = self.system
        n, parts = system.degrees_of_freedom, len(self.parts)
        starts = np.array(states, dtype=float, order="C")
        if starts.ndim != 2 or starts.shape[1] != 2 * n or not np.all(np.isfinite(starts)):
            raise ValueError(f"states is an array of finite numbers of shape (b, {2 * n}); received shape {starts.shape}")
        fractions = self._checked(duration, max_impacts, marks)
        summary = np.zeros((len(starts), 9 + (parts + 1) + len(fractions) * (parts + 2)))
        summary[:, 7] = system.energy(starts[:, :n], starts[:, n:])
        counts, clock = np.zeros(kernels.COUNTS, dtype=np.int64), np.zeros(kernels.CLOCK)
        turns, sums = np.zeros((len(self.forcing.loads), 2)), np.zeros((parts + 1, 2))
        x, width = np.zeros(2 * n + 2 * len(self.forcing.loads)), 2 * n + parts + 2
        first = 0
        while True:
            phases = self.table.stacked
            size = phases.matrix.shape[1]
            log = kernels.Log(*(np.zeros((0, k), dtype=kind) for k, kind in ((3, np.int64), (3, float), (2 * n, float), (size, float), (parts + 1, float))))
            reason, first = kernels.many(
                phases, starts, float(duration), int(max_impacts), first, fractions, np.zeros(size), x, counts, clock, turns, sums,
                np.zeros((len(fractions), parts + 3)), np.zeros((LEVELS, width)), np.zeros(width), np.zeros(2 * n), log,
                work_array(size, len(phases.restitution)), self.integral_work(), np.zeros(len(self.meters.weight)), summary,
            )  # fmt: skip
            if reason != kernels.NEW_PHASE:
                break
            self.table.add(int(counts[kernels.PENDING]))
        return Batch(
            status=tuple(_STATUS[int(reason)] for reason in summary[:, 0]),
            duration=summary[:, 1],
            impacts=summary[:, 2].astype(np.int64),
            touches=summary[:, 3].astype(np.int64),
            last_impact=summary[:, 4],
            clear_from=summary[:, 5],
            held_time=summary[:, 6],
            initial_energy=summary[:, 7],
            energy=np.atleast_1d(system.energy(starts[:, :n], starts[:, n:])),
            totals=summary[:, 9 : 10 + parts],
            marks=summary[:, 10 + parts :].reshape(len(starts), len(fractions), parts + 2),
            final=starts,
            parts=self.parts,
            fractions=fractions,
        )


def _mark(row: np.ndarray, parts: tuple[str, ...]) -> tuple[float, dict[str, float]]:
    """Time and dissipation of a row of marks."""
    return float(row[1]), dict(zip(parts, row[2:-1].tolist(), strict=True))


def run(
    system: ImpactSystem,
    u: Any,
    v: Any,
    duration: float,
    *,
    forces: Any = None,
    dampers: Mapping[str, Any] | None = None,
    max_impacts: int = 10_000_000,
    leaving: str | None = None,
    marks: Sequence[float] = (0.5, 0.85, 0.9, 0.99),
) -> Motion:
    """The motion of a system from the state (u, v): flights, impacts, chattering, sticking, and where the energy goes.

    Parameters
    ----------
    system : ImpactSystem
    u, v : (n,) array_like
        Displacements and velocities at time 0.
    duration : float
        Time to run, >= 0.
    forces : Constant, Harmonic, Record or a list of them, optional
        Loads f(t) (`bvp.forcing`).
    dampers : mapping of str to (n, n) array_like, optional
        Named parts that sum to the damping matrix, whose dissipation is told apart; by default those across gaps and the rest.
    max_impacts : int
        Most impacts; the motion ends there.
    leaving : str, optional
        Letter of the contact that the start is on exactly, after its impact.
    marks : sequence of float
        Fractions of the initial energy: the time at which that much is dissipated is found.

    Returns
    -------
    Motion
        `status` says how it ended; no ending is an exception, whatever the restitution.

    Raises
    ------
    ValueError
        For a state or a load of the wrong length or not finite, a negative duration, a max_impacts below 0, an unknown contact, marks
        outside (0, 1), dampers that do not sum to the damping matrix.

    Examples
    --------
    A ball that falls from height 1/2, g = 1, and keeps half its speed: it rests at t = 1 + 2 v r/(g (1 - r)) = 3.

    >>> from bvp.forcing import Constant
    >>> from bvp.system import ImpactSystem, Stop
    >>> ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=0.5)])
    >>> motion = run(ball, [0.5], [0.0], 5.0, forces=Constant([-1.0]))
    >>> round(motion.stretches[1].begin, 12), motion.stretches[1].held, motion.balance_error < 1e-15
    (3.0, ('-',), True)
    """
    return Mover(system, forces, dampers).run(u, v, duration, max_impacts, leaving, marks)
