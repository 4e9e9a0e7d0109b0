"""Simulation of a system between its stops: damped, forced, with inelastic impacts, chattering, sticking and an energy budget."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import saltus_core

from bvp.checks import finite_numbers, is_finite, require_system
from bvp.closures import contact_of
from bvp.contact_modes import ContactModeTable
from bvp.dense import product
from bvp.forcing import BudgetTerms, Forcing, budget_terms, forcing_of, split_damping
from bvp.interrupts import InterruptHandler, Pace, defer_interrupts
from bvp.kernels import contact_mode as places
from bvp.kernels import motion as kernels
from bvp.kernels.energy_budget import integral_work
from bvp.kernels.extrema import PEAK_ROWS
from bvp.kernels.impact import work_array
from bvp.kernels.sticking import LEVELS
from bvp.motion import STATUS, Batch, EnergyMark, Motion, MotionStatus
from bvp.texts import brief, listed, shown

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["BeyondStop", "LinearRuns", "Simulator", "energies_of", "run_linear", "simulate"]


PASSES = 1 << 14
"""Passes of one of many motions between two questions whether they are interrupted."""


class BeyondStop(ValueError):
    """A start beyond a stop: the message names the stop, its gap and its bounds."""


def energies_of(system: ImpactSystem, states: np.ndarray, modal: np.ndarray | None = None) -> np.ndarray:
    """Energies of states (b, 2n), (u, v), which are also given as modal coordinates if these are known more exactly.

    They are sums over the modes: u . K u would cancel where stiff springs move together, as in a bar, or far from the origin. That of a
    state does not depend on the others."""
    n, squares = system.degrees_of_freedom, system.modes.squares
    if modal is None:
        to_modes = product(system.mass, system.modes.shapes)
        # Sums in the order of the coordinates; that of a matrix product depends on the number of states.
        modal = np.hstack([(part[:, :, None] * to_modes).sum(axis=1) for part in (states[:, :n], states[:, n:])])
    found: np.ndarray = 0.5 * (modal[:, n:] ** 2 + squares * modal[:, :n] ** 2).sum(axis=1)
    smooth = system.smooth_forces
    return found + smooth.energy(states[:, :n]) if smooth is not None and system.has_potential else found


class _End(NamedTuple):
    """A motion as it ended: status of the kernels, time, contact mode and its state, sums and counts as in `Motion`, the marks reached."""

    status: int
    time: float
    mode: int
    z: np.ndarray
    totals: np.ndarray
    impacts: int
    touches: int
    last_impact: float
    clear_from: float
    sticking_time: float
    switch_error: float
    marks: list[tuple[float | None, list[float]]]


_RecordArrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Of each event: kind, contact and mode; time, speed and loss; (u, v) before; state after; sums."""


@brief
class Simulator:
    """Runs motions of one system under given loads; contact modes are made when a motion first needs them, and kept.

    Parameters
    ----------
    system : ImpactSystem
    forces : Constant, Harmonic, Record or a list of them, optional
    dampers : mapping of str to (n, n) array_like, optional
        Parts of the damping matrix, which they sum to; by default "gaps" and "rest" (`bvp.forcing.split_damping`).

    Raises
    ------
    ValueError
        For loads of another length, for dampers that do not sum to the damping matrix.
    """

    def __init__(self, system: ImpactSystem, forces: Any = None, dampers: Mapping[str, Any] | None = None) -> None:
        require_system(system, smooth=True)
        self.system = system
        self.forcing = forcing_of(forces, system.degrees_of_freedom)
        self.dampers = split_damping(system, dampers)
        parts = self.dampers | {name: np.zeros_like(system.damping) for name in smooth_dampers(system)}
        self.terms = budget_terms(parts, self.forcing, len(system.stops))
        self.table = _table(system, self.forcing, self.terms)
        self.parts = parts_of(system, self.dampers)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        return f"Simulator of a system with {self.system.degrees_of_freedom} degrees of freedom", [("parts", listed(self.parts))]

    def log(self, room: int) -> places.Log:
        """An empty record of so many events."""
        n, size = self.system.degrees_of_freedom, self.table.stacked.matrix.shape[1]
        return places.Log(
            np.zeros((room, 3), dtype=np.int64),
            np.zeros((room, 3)),
            np.zeros((room, 2 * n)),
            np.zeros((room, size)),
            np.zeros((room, len(self.parts) + 1)),
        )

    def scratch(self, before: np.ndarray) -> places.Scratch:
        """Arrays for the kernels; `before` is kept from call to call."""
        modes = self.table.stacked
        n, size = self.system.degrees_of_freedom, modes.matrix.shape[1]
        width = 2 * n + len(self.parts) + 2
        return places.Scratch(
            table=np.zeros((LEVELS, width)),
            values=np.zeros(width),
            before=before,
            kept=np.zeros(size),
            peak=np.zeros((PEAK_ROWS, 1, size)),
            edge=np.zeros((2, 1)),
            work=work_array(size, len(modes.restitution)),
            integral=integral_work(size, len(modes.weight)),
            out=np.zeros(len(modes.weight)),
            impulses=np.zeros((len(modes.restitution), len(modes.restitution) + 1)),
        )

    def run(
        self,
        u: Any,
        v: Any,
        duration: float,
        max_impacts: int = 10_000_000,
        leaving: str | None = None,
        marks: Sequence[float] = (0.5, 0.85, 0.9, 0.99),
        on_progress: Callable[[float], object] | None = None,
    ) -> Motion:
        """The motion from (u, v). `duration`, `max_impacts`, `leaving`, `marks` and `on_progress` are as for `simulate`. A start beyond
        a stop raises `BeyondStop`."""
        system, start = self.system, checked_state(self.system, u, v)
        fractions = _checked(duration, max_impacts, marks)
        contact = -1 if leaving is None else contact_of(system, leaving)
        # The simulator returns at each new contact mode, and now and then to report progress; then it is called again.
        with defer_interrupts() as interrupt:
            initial = float(self._energies_at_start(start[None])[0])
            run = self._run_linear if system.smooth_forces is None else self._run_smooth
            end, record = run(start, initial, contact, float(duration), int(max_impacts), fractions, on_progress, interrupt)
            modes = self.table.stacked
            unreached: tuple[None, list[float]] = (None, [])
            reached = [*end.marks, *[unreached] * (len(fractions) - len(end.marks))]
            last = np.pad(end.z, (0, modes.matrix.shape[1] - len(end.z)))
            final = product(modes.leave[end.mode], last)
            numbers, columns, before, states, sums = record
            motion = Motion(
                system=system,
                forcing=self.forcing,
                status=STATUS.get(end.status, MotionStatus.INTERRUPTED),
                duration=float(duration) if end.status == kernels.REACHED else end.time,
                kinds=numbers[:, 0],
                times=columns[:, 0].copy(),  # contiguous, however many there are: kernels are compiled for one kind
                contacts=numbers[:, 1],
                speeds=columns[:, 1],
                losses=columns[:, 2],
                before=before,
                sums=sums,
                totals=end.totals,
                parts=self.parts,
                impacts=end.impacts,
                touches=end.touches,
                last_impact=end.last_impact if end.impacts else None,
                clear_from=None if math.isnan(end.clear_from) else end.clear_from,
                sticking_time=end.sticking_time,
                switch_error=end.switch_error,
                initial_energy=initial,
                energy=float(energies_of(system, final[None], product(modes.to_modes[end.mode], last)[None])[0]),
                marks=tuple(
                    EnergyMark(float(fraction), time, dict(zip(self.parts, spent[:-1], strict=True)))
                    if time is not None
                    else EnergyMark(float(fraction), None, {})
                    for fraction, (time, spent) in zip(fractions, reached, strict=True)
                ),
                start=start,
                final=final,
                numbers=numbers,
                states=states,
                contact_modes=modes,
            )
        if interrupt.came:
            error = KeyboardInterrupt()
            error.motion = motion  # type: ignore[attr-defined]
            raise error
        if motion.status is MotionStatus.OUTSIDE:
            gaps = [(float(np.dot(stop.gap, motion.start[: len(stop.gap)])), stop) for stop in self.system.stops]
            w, stop = max(gaps, key=lambda pair: max(pair[0] - pair[1].upper, pair[1].lower - pair[0]))
            raise BeyondStop(f"the start lies beyond stop {stop.name}: its gap is {w:g}, expected {stop.lower:g} to {stop.upper:g}")
        return motion

    def _run_linear(
        self, start: np.ndarray, initial: float, contact: int, duration: float, max_impacts: int, fractions: np.ndarray,
        on_progress: Callable[[float], object] | None, interrupt: InterruptHandler,
    ) -> tuple[_End, _RecordArrays]:  # fmt: skip
        """A motion without smooth forces, by the compiled core."""
        motion, pace, pieces = saltus_core.Motion(self.table.core, start, initial, contact, fractions), Pace(), []
        while True:
            with pace:
                status = motion.move(duration, max_impacts, pace.passes)
            pieces.append(motion.record())
            if on_progress is not None:
                on_progress(motion.time)
            if status == kernels.NEW_MODE:
                self.table.add(motion.wanted)
            elif status != kernels.PAUSED or interrupt.came:
                break
        end = _End(
            status, motion.time, motion.mode, motion.state(), motion.sums(), motion.impacts, motion.touches, motion.last_impact,
            motion.clear_from, motion.sticking_time, motion.switch_error,
            [(None if math.isnan(time) else time, list(spent)) for time, spent in motion.marks()],
        )  # fmt: skip
        every = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
        rows, mode = len(every["kinds"]), every["modes"]
        states = np.zeros((rows, self.table.stacked.matrix.shape[1]))
        sizes = np.array([len(one["matrix"]) for one in self.table.modes.values()])
        begins = np.cumsum(sizes[mode]) - sizes[mode]
        for f in np.unique(mode).tolist():
            of = np.flatnonzero(mode == f)
            states[of, : sizes[f]] = every["states"][begins[of, None] + np.arange(sizes[f])]
        numbers = np.empty((rows, 3), dtype=np.int64)  # kernels take this kind of integers alone
        numbers[:] = np.stack([every["kinds"], every["contacts"], mode], axis=1)
        columns = np.stack([every["times"], every["speeds"], every["losses"]], axis=1)
        return end, (numbers, columns, every["before"].reshape(rows, -1), states, every["sums"].reshape(rows, -1))

    def _run_smooth(
        self, start: np.ndarray, initial: float, contact: int, duration: float, max_impacts: int, fractions: np.ndarray,
        on_progress: Callable[[float], object] | None, interrupt: InterruptHandler,
    ) -> tuple[_End, _RecordArrays]:  # fmt: skip
        """A motion with smooth forces, by kernels; these return when their log is full, too."""
        state = self.state(len(fractions) if initial > 0.0 else 0, 0)
        counts, clock, sums, marked = state.counts, state.clock, state.sums, state.marks
        counts[places.LEAVING] = counts[places.CONTACT] = contact
        clock[places.INITIAL] = initial
        marked[:, 0] = fractions[: len(marked)]
        state.x[: len(start)] = start
        before = start.copy()
        pieces: list[places.Log] = []
        room, scratch = 256, self.scratch(before)
        pace = Pace()
        while True:
            modes = self.table.stacked
            size = modes.matrix.shape[1]
            if counts[places.PENDING] >= 0:
                state, scratch = state._replace(z=np.zeros(size)), self.scratch(before)
            log = self.log(room)
            counts[places.EVENTS], counts[places.PASSES] = 0, pace.passes
            with pace:
                status = kernels.move(modes, duration, max_impacts, state, log, scratch)
            pieces.append(places.Log(*(array[: counts[places.EVENTS]].copy() for array in log)))
            if on_progress is not None:
                on_progress(float(clock[places.TIME]))
            if status == kernels.NEW_MODE:
                self.table.add(int(counts[places.PENDING]))
            elif status not in (kernels.FULL, kernels.PAUSED) or interrupt.came:
                break
            elif status == kernels.FULL:
                room = min(2 * room, 1 << 16)
        size = self.table.stacked.matrix.shape[1]
        states = np.vstack([np.pad(piece.states, ((0, 0), (0, size - piece.states.shape[1]))) for piece in pieces])
        numbers, columns, before_, sums_ = (
            np.concatenate([getattr(piece, key) for piece in pieces]) for key in ("numbers", "values", "before", "sums")
        )
        end = _End(
            status, float(clock[places.TIME]), int(counts[places.MODE]), state.z, sums.sum(axis=1), int(counts[places.IMPACTS]),
            int(counts[places.TOUCHES]), float(clock[places.LAST_IMPACT]),
            float(clock[places.CLEAR_TIME]) if counts[places.CLEAR] else math.nan, float(clock[places.STICKING_TIME]),
            float(clock[places.SWITCH_ERROR]), [(float(row[1]), row[2:].tolist()) for row in marked[: counts[places.MARK]]],
        )  # fmt: skip
        return end, (numbers, columns, before_, states, sums_)

    def state(self, marks: int, peaks: int) -> places.MotionState:
        """A motion at time 0 with room for so many marks and peaks; its state of the contact mode is still empty."""
        loads, parts = len(self.forcing.loads), len(self.parts)
        return places.MotionState(
            z=np.zeros(0),
            x=np.zeros(2 * self.system.degrees_of_freedom + 2 * loads),
            counts=np.zeros(places.COUNTS, dtype=np.int64),
            clock=np.zeros(places.CLOCK),
            angles=np.zeros((loads, 2)),
            sums=np.zeros((parts + 1, 2)),
            marks=np.zeros((marks, parts + 3)),
            peaks=np.zeros(peaks),
        )

    def _energies_at_start(self, starts: np.ndarray) -> np.ndarray:
        """Energies of starts (b, 2n); a ValueError for one that has none."""
        n, smooth = self.system.degrees_of_freedom, self.system.smooth_forces
        energies = energies_of(self.system, starts)
        for start, energy in zip(starts, energies.tolist(), strict=True):
            if not math.isfinite(energy):
                why = None if smooth is None else smooth.why_no_energy(start[:n])
                raise ValueError(f"the energy at the start is {energy}, expected a finite number{f': {why}' if why else ''}")
        return energies

    def run_many(
        self,
        states: Any,
        duration: float,
        max_impacts: int = 10_000_000,
        marks: Sequence[float] = (0.5, 0.9, 0.99),
        with_peaks: bool = False,
        threads: int = 1,
    ) -> Batch:
        """Motions from many states, without a record of their events.

        Parameters
        ----------
        states : (b, 2n) array_like
            (u, v) of each start.
        duration, max_impacts, marks
            As in `run`.
        with_peaks : bool
            Whether to find the largest displacements.
        threads : int
            Threads that share the motions of a linear system, as far as there are processors. The results do not depend on it.

        Raises
        ------
        ValueError
            As `run`, and for states of another shape.
        """
        n, parts = self.system.degrees_of_freedom, len(self.parts)
        starts = np.ascontiguousarray(finite_numbers(states, "states", None, 2 * n))
        fractions = _checked(duration, max_impacts, marks)
        initial = self._energies_at_start(starts)
        if self.system.smooth_forces is None:
            most = np.full(len(starts), int(max_impacts), dtype=np.int64)
            summary, starts, modal = run_linear(
                self.table, starts, initial, most, float(duration), fractions, with_peaks=with_peaks, threads=threads
            )[:3]
        else:
            summary, modal = self._run_many_smooth(starts, initial, float(duration), int(max_impacts), fractions, with_peaks)
        return Batch(
            status=tuple(STATUS[int(reason)] for reason in summary[:, 0]),
            duration=summary[:, 1],
            impacts=summary[:, 2].astype(np.int64),
            touches=summary[:, 3].astype(np.int64),
            last_impact=summary[:, 4],
            clear_from=summary[:, 5],
            sticking_time=summary[:, 6],
            initial_energy=initial,
            energy=energies_of(self.system, starts, modal),
            totals=summary[:, 9 : 10 + parts],
            marks=summary[:, 10 + parts : summary.shape[1] - n * with_peaks].reshape(len(starts), len(fractions), parts + 2),
            peaks=summary[:, -n:] if with_peaks else None,
            final=starts,
            parts=self.parts,
            fractions=fractions,
        )

    def _run_many_smooth(
        self, starts: np.ndarray, initial: np.ndarray, duration: float, max_impacts: int, fractions: np.ndarray, with_peaks: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Motions with smooth forces: their summary, and the final states in modal coordinates. The columns are those of `run_linear`, but
        7 is the initial energy, and 8 is not used. The starts become final states."""
        n, parts = self.system.degrees_of_freedom, len(self.parts)
        summary = np.zeros((len(starts), 9 + (parts + 1) + len(fractions) * (parts + 2) + n * with_peaks))
        summary[:, 7] = initial
        state, modal = self.state(len(fractions), n if with_peaks else 0), np.zeros_like(starts)
        counts, batch = state.counts, kernels.BatchArrays(starts, fractions, summary, modal)
        first, log, reason, pace = 0, self.log(0), kernels.NEW_MODE, Pace()
        while True:
            modes = self.table.stacked
            if reason == kernels.NEW_MODE:
                state, scratch = state._replace(z=np.zeros(modes.matrix.shape[1])), self.scratch(np.zeros(2 * n))
            counts[places.PASSES] = pace.passes
            with pace:
                reason, first = kernels.many(modes, batch, duration, max_impacts, first, state, log, scratch)
            if reason == kernels.NEW_MODE:
                self.table.add(int(counts[places.PENDING]))
            elif reason != kernels.PAUSED:
                return summary, modal


class LinearRuns(NamedTuple):
    """Results of b motions of a linear system.

    summary (b, ..): reason, time reached, impacts, touches, last impact (NaN: none), clear from (NaN: not proven), time sticking,
    whether infinite time has passed, the contact mode it waits for, the sums of D dampers, S stops and work, time and sums of each mark
    (NaN: not reached), and the peaks if they are wanted. final, modal (b, 2n): final states as (u, v), and in modal coordinates."""

    summary: np.ndarray
    final: np.ndarray
    modal: np.ndarray


def run_linear(
    table: ContactModeTable,
    starts: np.ndarray,
    energies: np.ndarray,
    most: np.ndarray,
    duration: float,
    fractions: np.ndarray,
    *,
    restitution: np.ndarray | None = None,
    leaving: np.ndarray | None = None,
    with_peaks: bool = False,
    to_rest: bool = False,
    threads: int = 1,
) -> LinearRuns:
    """Run motions of a linear system without a record of their events.

    Parameters
    ----------
    table : ContactModeTable
    starts : (b, 2n) ndarray
        (u, v) of each start.
    energies, most : (b,) ndarray
        The energy of each start, and the number of impacts at which each motion ends.
    duration : float
    fractions : (Q,) ndarray
        Of the initial energy, ascending.
    restitution : (b,) ndarray, optional
        In place of that of all stops.
    leaving : (b,) ndarray of int, optional
        The contact that each start is on after its impact, or -1.
    with_peaks : bool
        Whether to find the largest displacements.
    to_rest : bool
        Where no impact is possible any more and all motion decays, the dissipation counts to infinite time.
    threads : int
        The results do not depend on it.
    """
    count, n, parts = len(starts), starts.shape[1] // 2, len(table.terms.dampers) + len(table.system.stops) + 1
    summary = np.full((count, 9 + parts + len(fractions) * (1 + parts) + n * with_peaks), np.nan)
    final, modal = np.zeros_like(starts), np.zeros_like(starts)
    changed = np.full(count, np.nan) if restitution is None else np.ascontiguousarray(restitution, dtype=float)
    on = np.full(count, -1, dtype=np.int64) if leaving is None else np.ascontiguousarray(leaving, dtype=np.int64)
    rows = np.arange(count)
    while len(rows):
        saltus_core.run_batch(
            table.core, starts, energies, changed, on, most, rows, duration, fractions, with_peaks, to_rest, PASSES, threads,
            summary, final, modal,
        )
        rows = rows[summary[rows, 0] == kernels.NEW_MODE]
        for sticking in np.unique(summary[rows, 8]).astype(np.int64).tolist():
            table.add(sticking)
    return LinearRuns(summary, final, modal)


def simulate(
    system: ImpactSystem,
    u: Any,
    v: Any,
    duration: float,
    max_impacts: int = 10_000_000,
    leaving: str | None = None,
    *,
    forces: Any = None,
    dampers: Mapping[str, Any] | None = None,
    marks: Sequence[float] = (0.5, 0.85, 0.9, 0.99),
    on_progress: Callable[[float], object] | None = None,
) -> Motion:
    """The motion of a system from the state (u, v): flights, impacts, chattering, sticking, and where the energy goes.

    Parameters
    ----------
    system : ImpactSystem
    u, v : (n,) array_like
        Displacements and velocities at time 0.
    duration : float
        Time to run, >= 0.
    max_impacts : int
        Most impacts; the motion ends there.
    leaving : str, optional
        Letter of the contact that the start is on exactly, after its impact. A start within the contact tolerance of a stop
        is on it in any case.
    forces : Constant, Harmonic, Record or a list of them, optional
        Loads f(t) (`bvp.forcing`).
    dampers : mapping of str to (n, n) array_like, optional
        Named parts that sum to the damping matrix. The dissipation of each is reported. By default: the dampers across gaps, and the rest.
    marks : sequence of float
        Fractions of the initial energy. The motion records when each of them is dissipated.
    on_progress : callable, optional
        Called a few times a second with the time that the motion has reached.

    Returns
    -------
    Motion
        `status` says how it ended. Only a start beyond a stop, or one whose energy is not finite, raises an exception.

    Raises
    ------
    KeyboardInterrupt
        With the motion up to there as its attribute `motion`.
    ValueError
        For a start beyond a stop or without a finite energy, a state or a load of the wrong length or not finite, a negative duration, a
        max_impacts below 0, an unknown contact, marks outside (0, 1), dampers that do not sum to the damping matrix.

    Examples
    --------
    A ball between two walls, without gravity:

    >>> from bvp.system import ImpactSystem, Stop
    >>> free = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), 0.0, 1.0)])
    >>> motion = simulate(free, [0.5], [1.0], 3.0)
    >>> motion.stop_events.times, motion.stop_events.contacts, motion.status.name
    (array([0.5, 1.5, 2.5]), ('+', '-', '+'), 'DURATION_REACHED')
    >>> u, v = motion.sample([0.25, 0.5, 1.0])
    >>> u[:, 0], v[:, 0]
    (array([0.75, 1.  , 0.5 ]), array([ 1., -1., -1.]))

    A ball that falls from height 1/2 with g = 1 and keeps half its speed at each impact. It comes to rest at t = 1 + 2 v r/(g (1 - r)) = 3.

    >>> from bvp.forcing import Constant
    >>> ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=0.5)])
    >>> motion = simulate(ball, [0.5], [0.0], 5.0, forces=Constant([-1.0]))
    >>> round(motion.contact_intervals[1].begin, 12), motion.contact_intervals[1].sticking, motion.balance_error < 1e-15
    (3.0, ('-',), True)
    """
    return Simulator(system, forces, dampers).run(u, v, duration, max_impacts, leaving, marks, on_progress)


def parts_of(system: ImpactSystem, dampers: Mapping[str, Any] | None = None) -> tuple[str, ...]:
    """Names of the parts that dissipate energy: the dampers, by default those of `split_damping`, those not linear, then the stops."""
    named = split_damping(system) if dampers is None else dampers
    return (*named, *smooth_dampers(system), *(f"stop {stop.name}" for stop in system.stops))


def smooth_dampers(system: ImpactSystem) -> tuple[str, ...]:
    """Names of the dampers that are not linear."""
    return () if system.smooth_forces is None else tuple(dict.fromkeys(filter(None, system.smooth_forces.dampers)))


def _table(system: ImpactSystem, forcing: Forcing, terms: BudgetTerms) -> ContactModeTable:
    """The contact modes of a system. A ValueError if its springs have no energy."""
    if system.smooth_forces is None:
        return ContactModeTable(system, forcing, terms)
    if system.smooth_forces.potential is None:
        raise ValueError(f"the energy of the motion is not known: {system.smooth_forces.why_no_potential}")
    from bvp.smooth_motion import SmoothModeTable

    return SmoothModeTable(system, forcing, terms)


def checked_state(system: ImpactSystem, u: Any, v: Any) -> np.ndarray:
    """(u, v) as one finite array of length 2n; ValueError else."""
    n = system.degrees_of_freedom
    return np.concatenate([finite_numbers(u, "u", n), finite_numbers(v, "v", n)])


def _checked(duration: Any, max_impacts: Any, marks: Sequence[float]) -> np.ndarray:
    """The marks, ascending, where all three are as they should be; ValueError else."""
    if not (is_finite(duration) and duration >= 0.0):
        raise ValueError(f"duration is a finite time of 0 or more; received {shown(duration)}")
    if isinstance(max_impacts, bool) or not isinstance(max_impacts, (int, np.integer)) or not 0 <= max_impacts < 1 << 63:
        raise ValueError(f"max_impacts is an integer of 0 or more; received {shown(max_impacts)}")
    fractions = np.unique(finite_numbers(marks, "marks", None))
    if not np.all((fractions > 0.0) & (fractions < 1.0)):
        raise ValueError(f"marks are fractions of the initial energy between 0 and 1; received {list(marks)}")
    return fractions
