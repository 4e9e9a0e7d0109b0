"""A forced motion from period to period of its loads: states at phase 0, impacts, growth of a tangent vector, peaks and dissipation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bvp.entries import base_frequency
from bvp.forcing import Force, Harmonic, Record
from bvp.interrupts import Pace
from bvp.kernels import contact_mode as entry
from bvp.kernels import motion as motion_kernels
from bvp.kernels.contact_mode import ContactModes
from bvp.motion import STATUS, MotionStatus
from bvp.simulate import BeyondStop, Simulator, checked_state
from bvp.system import ImpactSystem
from transitions.sweep import kernels

__all__ = ["NO_PERIOD", "Carried", "ForcedMotion", "ImpactRecord", "PeriodRecord", "carried_into", "harmonics_of", "require_inside"]

NO_PERIOD = "a forced motion is followed from period to period of its loads"
"""Beginning of the messages about loads without a period."""


def harmonics_of(forces: Sequence[Force]) -> tuple[float, tuple[int, ...]]:
    """The base frequency w of some loads, and the multiple of w that each has; 0 for a constant load.

    Raises
    ------
    ValueError
        If no load is harmonic, if one is a record, if the frequencies are incommensurate.

    Examples
    --------
    >>> from bvp.forcing import Constant
    >>> harmonics_of([Harmonic(2.0, [1.0]), Constant([0.5]), Harmonic(3.0, [0.1])])
    (1.0, (2, 0, 3))
    """
    if any(isinstance(force, Record) for force in forces):
        raise ValueError(f"{NO_PERIOD}, and a record has none; expected harmonic and constant loads")
    frequencies = [force.frequency for force in forces if isinstance(force, Harmonic)]
    if not frequencies:
        raise ValueError(f"{NO_PERIOD}, and no load is periodic; expected a load with amplitude and frequency")
    base, multiples = base_frequency(frequencies)
    rest = iter(multiples)
    return float(base), tuple(next(rest) if isinstance(force, Harmonic) else 0 for force in forces)


@dataclass(frozen=True, eq=False)
class Carried:
    """A state at phase 0 of the loads, as it is carried from one value of a parameter to the next.

    Attributes
    ----------
    state : (2n,) ndarray
        (u, v).
    sticking : tuple of str
        Letters of the contacts that stick.
    tangent : (2n,) ndarray or None
        A tangent vector, (du, dv); None: any.
    """

    state: np.ndarray
    sticking: tuple[str, ...] = ()
    tangent: np.ndarray | None = None


def require_inside(system: ImpactSystem, u: Any, v: Any) -> np.ndarray:
    """(u, v) as an array (2n,); `BeyondStop` if a gap lies beyond a bound by more than rounding."""
    state = checked_state(system, u, v)
    for stop in system.stops:
        w = float(np.dot(stop.gap, state[: len(stop.gap)]))
        if not _rounded(stop.lower, w) <= w <= _rounded(stop.upper, w):
            raise BeyondStop(f"the start lies beyond stop {stop.name}: its gap is {w:g}, expected {stop.lower:g} to {stop.upper:g}")
    return state


def _rounded(bound: float, w: float) -> float:
    """The bound, or w where they differ by rounding."""
    return w if abs(bound - w) <= 1e-12 * max(abs(bound), 1.0) else bound


def carried_into(system: ImpactSystem, carried: Carried) -> tuple[Carried, float]:
    """A state moved to where a system allows it, and the largest distance by which a gap was moved.

    Sticking contacts get the gap of their bound and no velocity across it. Gaps beyond a bound get the bound. Displacements
    and velocities move along M^-1 c, as at an impact, so that nothing moves which the stops do not move."""
    modes, n = system.modes, system.degrees_of_freedom
    state = carried.state.copy()
    sides, bounds, stops = modes.contacts.side, modes.contacts.bound, modes.contact_stop
    rows = np.array([system.stops[stop].gap for stop in stops]).reshape(-1, n)
    letters = tuple(modes.contact_letters)
    closed = [letters.index(letter) for letter in carried.sticking if letter in letters]
    before = rows @ state[:n]
    for _ in range(motion_kernels.LIFTS):
        beyond = [c for c in range(len(sides)) if c not in closed and sides[c] * (rows[c] @ state[:n] - bounds[c]) > 0.0]
        moved = closed + [c for c in beyond if not any(stops[c] == stops[k] for k in closed)]
        if not moved:
            break
        own = rows[moved]
        push = np.linalg.lstsq(own @ np.linalg.solve(system.mass, own.T), np.eye(len(moved)), rcond=None)[0]
        along = np.linalg.solve(system.mass, own.T) @ push
        state[:n] += along @ (bounds[moved] - own @ state[:n])
        if closed:
            first = along[:, : len(closed)] if len(moved) == len(closed) else _along(system, rows[closed])
            state[n:] -= first @ (rows[closed] @ state[n:])
        if not beyond:
            break
    distance = float(np.abs(rows @ state[:n] - before).max(initial=0.0))
    return Carried(state, tuple(letters[c] for c in closed), carried.tangent), distance


def _along(system: ImpactSystem, rows: np.ndarray) -> np.ndarray:
    """M^-1 c' (c M^-1 c')^-1 of gap rows c (k, n)."""
    inverse = np.linalg.solve(system.mass, rows.T)
    return np.linalg.solve(rows @ inverse, inverse.T).T


@dataclass(frozen=True, eq=False)
class ImpactRecord:
    """The k impacts of some periods, in order of time. Bounces that are summed to their end are not among them.

    Attributes
    ----------
    contacts : (k,) int64 ndarray
        Index into `Modes.contact_letters`.
    periods : (k,) int64 ndarray
        Number of the period, from 0.
    times : (k,) ndarray
        Since that period began at phase 0.
    speeds : (k,) ndarray
        Speed of approach.
    before, after : (k, 2n) ndarray
        (u, v).
    """

    contacts: np.ndarray
    periods: np.ndarray
    times: np.ndarray
    speeds: np.ndarray
    before: np.ndarray
    after: np.ndarray

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True, eq=False)
class PeriodRecord:
    """What was recorded over P periods; fewer where the motion could not go on.

    Attributes
    ----------
    states : (P, 2n) ndarray
        (u, v) at the end of each.
    growths : (P,) ndarray
        Logarithm of the growth of the tangent vector, whose size is that of (w du, dv); -inf where it vanished.
    kept : (P,) int64 ndarray
        Bits of the contacts that stick throughout the period.
    impacts : ImpactRecord
    count : int
        Number of impacts.
    totals : (D + S + 1,) ndarray
        Energy dissipated by each damper and stop, and work of the loads, over all periods.
    peaks : (n,) ndarray or None
        Largest |u|, if wanted.
    sticking_time : float
    status : MotionStatus
    """

    states: np.ndarray
    growths: np.ndarray
    kept: np.ndarray
    impacts: ImpactRecord
    count: int
    totals: np.ndarray
    peaks: np.ndarray | None
    sticking_time: float
    status: MotionStatus


class ForcedMotion:
    """A motion under periodic loads that begins at phase 0.

    Parameters
    ----------
    system : ImpactSystem
    forces : sequence of loads
        Harmonic with a common base frequency, and constant.
    start : Carried
    phase : float
        Phase w t of the start, in [0, 2 pi). The first period is then shorter, and is not recorded.

    Attributes
    ----------
    period : float
        2 pi/w.
    released : tuple of str
        Sticking contacts of the start that the loads pull open at once.
    parts : tuple of str
        Names of the dampers and stops, as in `Motion`.

    Raises
    ------
    ValueError
        As `harmonics_of` and `Simulator`.
    """

    def __init__(self, system: ImpactSystem, forces: Sequence[Force], start: Carried, *, phase: float = 0.0) -> None:
        self.system = system
        frequency, multiples = harmonics_of(forces)
        self.period = 2.0 * math.pi / frequency
        self.simulator = Simulator(system, list(forces))
        self.parts = self.simulator.parts
        n = system.degrees_of_freedom
        self._letters = tuple(system.modes.contact_letters)
        angles = np.array(multiples) * phase
        sticking, self.released = self._kept(start, angles)
        state = self.simulator.state(0, 0)
        state.counts[entry.LEAVING] = -1
        state.counts[entry.PENDING] = sticking
        state.x[: 2 * n] = start.state
        state.angles[:, 0] = angles
        state.clock[entry.INITIAL] = system.energy(start.state[:n], start.state[n:])
        tangent = np.ones(2 * n) if start.tangent is None else start.tangent.copy()
        self._forced = kernels.Forced(
            state._replace(z=np.zeros(0)), np.zeros(0), tangent, np.zeros(kernels.PLACES, dtype=np.int64), np.zeros(kernels.CLOCKS)
        )
        self._forced.places[kernels.KEPT] = sticking
        self._before = start.state.copy()
        self._first = (2.0 * math.pi - phase) / frequency if phase else None
        self._renew()

    def _kept(self, start: Carried, angles: np.ndarray) -> tuple[int, tuple[str, ...]]:
        """Bits of the sticking contacts of the start whose contact force presses, and the letters of the others."""
        released: list[str] = []
        closed = [self._letters.index(letter) for letter in start.sticking]
        while closed:
            sticking = sum(1 << c for c in closed)
            if sticking not in self.simulator.table.modes:
                self.simulator.table.add(sticking)
            constant = self.simulator.forcing.frequency == 0.0
            cosine = np.where(constant, self.simulator.forcing.levels[0, :, 0], np.cos(angles))
            y = np.stack([cosine, np.where(constant, 0.0, np.sin(angles))], axis=1).ravel()
            mode, z = self.simulator.table.modes[sticking], self.simulator.table.entered(sticking, np.concatenate([start.state, y]))
            forces = mode["gap"][closed] @ z
            worst = int(np.argmin(forces))
            if forces[worst] >= 0.0:
                return sticking, tuple(released)
            released.append(self._letters[closed.pop(worst)])
        return 0, tuple(released)

    def _renew(self) -> None:
        """Arrays for the contact modes that there are now. A state keeps its place, and its padding grows."""
        self._modes: ContactModes = self.simulator.table.stacked
        n, size = self.system.degrees_of_freedom, self._modes.matrix.shape[1]
        begin = np.zeros(size)
        begin[: len(self._forced.begin)] = self._forced.begin
        z = np.zeros(size)
        self._forced = self._forced._replace(motion=self._forced.motion._replace(z=z), begin=begin)
        state, image, velocity = np.zeros((3, size))
        log, scratch = self.simulator.log(kernels.EVENTS_AT_ONCE), self.simulator.scratch(self._before)
        self._work = kernels.PeriodWork(state, image, velocity, np.zeros(2 * n), log, scratch)
        self._carry = np.array([self._carry_matrix(int(sticking), f) for f, sticking in enumerate(self._modes.sticking)])

    def _carry_matrix(self, sticking: int, f: int) -> np.ndarray:
        """(N, 2n): from (u, v) to the state of contact mode f, without loads and without what its sticking stops take away.

        The last bounces before a contact sticks take a gap w to 0. On the way dampers C change the momentum of the other coordinates by
        C U w, with the U of equation (6)."""
        n, modes = self.system.degrees_of_freedom, self.system.modes
        enter = self._modes.enter[f][:, : 2 * n].copy()
        closed = [c for c in range(len(modes.contacts.side)) if sticking >> c & 1]
        if closed:
            rows = np.array([self.system.stops[modes.contact_stop[c]].gap for c in closed])
            lift = _along(self.system, rows)
            kept = np.eye(n) - lift @ rows
            enter[:, :n] = enter[:, :n] @ kept + enter[:, n:] @ kept @ np.linalg.solve(self.system.mass, self.system.damping @ lift @ rows)
        return enter

    def advance(self, periods: int, *, impacts: bool = False, peaks: bool = False) -> PeriodRecord:
        """Follow the motion for so many periods, from the end of the last call. `impacts`: record the impacts. `peaks`: find the largest
        displacements, which takes about as long again."""
        if self._first is not None:
            first, self._first = self._first, None
            begun = self._follow(first, 1, False, False)
            if begun.status is not MotionStatus.DURATION_REACHED:
                return begun
        return self._follow(self.period, periods, impacts, peaks)

    def _follow(self, period: float, periods: int, impacts: bool, peaks: bool) -> PeriodRecord:
        n = self.system.degrees_of_freedom
        forced = self._forced = self._forced._replace(motion=self._forced.motion._replace(peaks=np.zeros(n if peaks else 0)))
        strobes = kernels.Strobes(np.zeros((periods, 2 * n)), np.zeros(periods), np.zeros(periods, dtype=np.int64))
        motion = forced.motion
        forced.places[kernels.DONE] = forced.places[kernels.FOUND] = 0
        started = motion.sums.sum(axis=1), int(motion.counts[entry.IMPACTS]), float(motion.clock[entry.STICKING_TIME])
        room = 4 * kernels.EVENTS_AT_ONCE if impacts else 0
        record = kernels.Impacts(np.zeros((room, 2), dtype=np.int64), np.zeros((room, 2)), np.zeros((room, 4 * n)))
        pieces: list[kernels.Impacts] = []
        pace = Pace()
        while True:
            motion = self._forced.motion
            motion.counts[entry.PASSES] = pace.passes
            with pace:
                code = kernels.follow_periods(self._modes, self._carry, period, self._forced, strobes, record, self._work)
            if code == motion_kernels.NEW_MODE:
                self.simulator.table.add(int(motion.counts[entry.PENDING]))
                self._renew()
            elif code == motion_kernels.FULL:
                pieces.append(self._taken(record))
            elif code != motion_kernels.PAUSED:
                break
        pieces.append(self._taken(record))
        done = int(forced.places[kernels.DONE])
        numbers, values, states = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        found = ImpactRecord(numbers[:, 0], numbers[:, 1], values[:, 0], values[:, 1], states[:, : 2 * n], states[:, 2 * n :])
        return PeriodRecord(
            states=strobes.states[:done],
            growths=strobes.growths[:done],
            kept=strobes.kept[:done],
            impacts=found,
            count=int(motion.counts[entry.IMPACTS]) - started[1],
            totals=motion.sums.sum(axis=1) - started[0],
            peaks=motion.peaks.copy() if len(motion.peaks) else None,
            sticking_time=float(motion.clock[entry.STICKING_TIME]) - started[2],
            status=STATUS[int(code)],
        )

    def _taken(self, record: kernels.Impacts) -> kernels.Impacts:
        """A copy of the impacts recorded, whose rows are then free."""
        found = int(self._forced.places[kernels.FOUND])
        self._forced.places[kernels.FOUND] = 0
        return kernels.Impacts(*(array[:found].copy() for array in record))

    def named(self, sticking: int) -> tuple[str, ...]:
        """Letters of the contacts of the bits of `sticking`."""
        return tuple(letter for c, letter in enumerate(self._letters) if sticking >> c & 1)

    def monodromy(self, periods: int) -> np.ndarray:
        """Derivative of so many stroboscopic maps along a periodic motion of that period, (2n, 2n): one pass for each tangent vector."""
        columns = []
        for direction in np.eye(2 * self.system.degrees_of_freedom):
            self._forced.tangent[:] = direction
            growth = float(self.advance(periods).growths.sum())
            columns.append(math.exp(growth) * self._forced.tangent)
        return np.array(columns).T

    def renew_tangent(self) -> None:
        """Begin with another tangent vector if the last one vanished."""
        if not np.any(self._forced.tangent) or not np.isfinite(self._forced.tangent).all():
            self._forced.tangent[:] = 1.0

    @property
    def carried(self) -> Carried:
        """The state at the end of the last period, phase 0."""
        motion = self._forced.motion
        f = int(motion.counts[entry.MODE])
        tangent = self._forced.tangent.copy()
        usable = bool(np.any(tangent) and np.isfinite(tangent).all())
        return Carried(self._modes.leave[f] @ motion.z, self.named(int(self._modes.sticking[f])), tangent if usable else None)
