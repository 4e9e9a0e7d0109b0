"""A grazing orbit over its full period: its impacts, its touches of stops, its symmetries, and the problems that it solves.

At grazing, an impact of zero speed and a touch are the same motion: each grazing instant may count as an impact or not. Each choice keeps
some of the symmetries. It gives a candidate: the multipoint problem of a family that may meet others at the orbit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product as every
from typing import NamedTuple

import numpy as np
import saltus_core as core

from branches.presentation import closed_presentation, pattern_of
from branches.sequences import PERIODIC, Ends, ImpactSequence
from bvp.closures import Cycle, cycle_of
from bvp.dense import inner, product
from bvp.multipoint import MultipointProblem
from bvp.smooth_flights import flight_of, modal_energies
from bvp.system import ImpactSystem

__all__ = ["EVERY", "Candidate", "Symmetry", "Touching", "candidate", "mode_label", "mode_name", "mode_of", "touching"]

CONTACT = 1e-8
"""Largest distance of a touch from its stop, as a part of the largest gap, and largest speed of an impact of zero speed, as a part of
sqrt(2h). Events are located far better, and other turning points are far away."""

_SAME = 1e-7
"""States, as parts of the largest, and times, as parts of the period, that are the same."""

_FAR = 1e5
"""A turning point that is so many times farther from a stop than the largest distance of a touch is none."""

_ALONE = 1e-6
"""Amplitude of the other modes, as a part of the largest, below which one mode moves alone."""

EVERY = 12
"""Most grazing instants, or pairs of them, of which all sets are tried."""

_APART = 1e-7
"""Difference of instants, as a part of the period, that are different."""


class Symmetry(NamedTuple):
    """A symmetry of a grazing orbit.

    image: the instant to which each instant goes. axis: "origin" or "rest" of a reversal, None for a shift in time. time: of the axis in
    [0, T/2), with the other one half a period later; or the shift.
    """

    image: tuple[int, ...]
    axis: str | None
    time: float
    mirrored: bool

    def move(self, mask: int) -> int:
        """The image of a set of instants; sets are bit masks."""
        return sum(1 << j for i, j in enumerate(self.image) if mask >> i & 1)


@dataclass(frozen=True, eq=False)
class Touching:
    """A grazing orbit, instant by instant.

    period: T. times (P,): instants of impact or touch in [0, T), ascending. contact (P,): contact hit or touched there (row of the contact
    arrays of `Modes`). before, after (P, N): modal states there, equal at a touch. grazing (P,): where the speed is zero. kept: bit mask of
    the instants that count as impacts in the family that led to this orbit.
    """

    system: ImpactSystem
    period: float
    times: np.ndarray
    contact: np.ndarray
    before: np.ndarray
    after: np.ndarray
    grazing: np.ndarray
    kept: int

    @property
    def hard(self) -> int:
        """Bit mask of the impacts with nonzero approach speed."""
        return sum(1 << i for i in np.flatnonzero(~self.grazing).tolist())

    @property
    def is_linear(self) -> bool:
        """Whether it is a linear motion that touches stops."""
        return not self.hard and self.system.smooth_forces is None

    @cached_property
    def letters(self) -> tuple[str, ...]:
        """Contact letters, one for each instant."""
        return tuple(self.system.modes.contact_letters[c] for c in self.contact)

    @property
    def stops(self) -> tuple[str, ...]:
        """Letters of the contacts that are grazed."""
        return tuple(dict.fromkeys(letter for letter, graze in zip(self.letters, self.grazing, strict=True) if graze))

    @property
    def h(self) -> float:
        """Energy."""
        return float(modal_energies(self.system, self.after[0]))

    def mark(self) -> tuple[float, float, float] | None:
        """Energy, quarter period and pattern of all instants (`branches.presentation.pattern_of`).

        They are the same for every family that reaches the orbit with this period. None if not all choices of the grazing instants are
        tried, and for linear motion, because each family that begins there is connected to it by itself."""
        if np.sum(self.grazing) > EVERY or self.is_linear:
            return None
        return self.h, 0.25 * self.period, pattern_of(self.system, self.times / self.period, self.contact)

    def state(self, time: float) -> np.ndarray:
        """Modal state (N,) at a time, after the impact if there is one."""
        local = time % self.period
        i = int(np.searchsorted(self.times, local, side="right")) - 1
        elapsed = local - self.times[i] if i >= 0 else local + self.period - self.times[-1]
        state: np.ndarray = core.path(flight_of(self.system), self.after[i].copy(), float(elapsed)).state(float(elapsed))
        return state

    def at(self, time: float) -> int | None:
        """The instant at a time, if there is one."""
        apart = np.abs((self.times - time + 0.5 * self.period) % self.period - 0.5 * self.period)
        i = int(np.argmin(apart))
        return i if apart[i] < _SAME * self.period else None

    def repeated(self, cover: int) -> Touching:
        """The same orbit over several periods."""
        count = len(self.times)
        kept = sum(self.kept << k * count for k in range(cover))
        times = np.concatenate([self.times + k * self.period for k in range(cover)])
        contact, grazing = np.tile(self.contact, cover), np.tile(self.grazing, cover)
        before, after = np.tile(self.before, (cover, 1)), np.tile(self.after, (cover, 1))
        return Touching(self.system, cover * self.period, times, contact, before, after, grazing, kept)

    @cached_property
    def symmetries(self) -> tuple[Symmetry, ...]:
        """All symmetries, the identity first: shifts in time, as they are or mirrored, and reversals about origin and rest axes."""
        count, half = len(self.times), self.after.shape[1] // 2
        # Velocities by sqrt(2 h): the orbit may be at rest at all instants.
        size = np.repeat([np.max(np.abs(self.after[:, :half])), np.sqrt(2.0 * self.h)], half)
        flip = np.repeat([-1.0, 1.0], half)
        signs = (1.0, -1.0) if self.system.has_odd_symmetry else (1.0,)
        numbers = np.arange(count)
        gaps, slack = np.diff(np.append(self.times, self.times[0] + self.period)), _SAME * self.period
        # The gaps exclude most symmetries, all at once: a row of these numbers the instants of the image.
        shifts, turns = (numbers[:, None] + numbers) % count, (numbers[:, None] - numbers) % count
        may_shift = (np.abs(gaps[shifts] - gaps) <= slack).all(axis=1)
        may_turn = (np.abs(gaps[turns - 1] - gaps) <= slack).all(axis=1)

        def same(a: np.ndarray, b: np.ndarray) -> bool:
            return bool(np.all(np.abs(a - b) <= _SAME * size))

        out = []
        for d in np.flatnonzero(may_shift):
            shifted = shifts[d]
            for sign in signs:
                if (self.grazing[shifted] == self.grazing).all() and same(self.after[shifted], sign * self.after):
                    shift = float(self.times[d] - self.times[0])
                    out.append(Symmetry(tuple(shifted.tolist()), None, shift, sign < 0.0))
        for c in np.flatnonzero(may_turn):
            turned = turns[c]
            for kind, turn in (("origin", flip), ("rest", -flip))[2 - len(signs) :]:
                if (self.grazing[turned] == self.grazing).all() and same(self.after[turned], turn * self.before):
                    axis = 0.5 * float(self.times[0] + self.times[c]) % (0.5 * self.period)
                    out.append(Symmetry(tuple(turned.tolist()), kind, axis, kind == "origin"))
        out.sort(key=lambda item: (item.image != tuple(range(count)), item.axis is not None))
        return tuple(out)

    def smallest(self, mask: int) -> int:
        """The representative of a set of instants among its images."""
        return min(symmetry.move(mask) for symmetry in self.symmetries)

    def choices(self) -> Iterator[int]:
        """Sets of instants that may count as impacts, one of each class under the symmetries: all hard impacts, and any grazing instants.

        If more than `EVERY` instants graze, only sets that keep a reversal are tried. If a reversal leaves more than `EVERY` pairs, only
        sets that differ from the set kept in at most two of them.
        """
        free = np.flatnonzero(self.grazing).tolist()
        if len(free) <= EVERY:
            groups = [[1 << i for i in free]]
        else:
            groups = [sorted({1 << i | 1 << image[i] for i in free}) for image in self._reversals()]
        seen: set[int] = set()
        for parts in groups:
            if len(parts) <= EVERY:
                sets = [self.hard | sum(chosen) for chosen in every(*((0, part) for part in reversed(parts)))]
            else:
                sets = [self.kept ^ part ^ other for i, part in enumerate(parts) for other in (0, *parts[:i])]
            # The smallest image of each set; all sets at once.
            masks = np.array(sets, dtype=np.int64 if len(self.times) < 63 else object)
            smallest = masks.copy()
            for symmetry in self.symmetries:
                moved = np.zeros_like(masks)
                for i, j in enumerate(symmetry.image):
                    moved |= (masks >> i & 1) << j
                smallest = np.minimum(smallest, moved)
            for mask in smallest.tolist():
                if mask not in seen:
                    seen.add(mask)
                    yield mask

    def _reversals(self) -> list[tuple[int, ...]]:
        """Reversals as permutations, one of each class of those that a symmetry carries into each other."""
        out, known = [], set()
        for reversal in self.symmetries:
            if reversal.axis is None or reversal.image in known:
                continue
            out.append(reversal.image)
            for symmetry in self.symmetries:
                carried = {symmetry.image[i]: symmetry.image[j] for i, j in enumerate(reversal.image)}
                known.add(tuple(carried[i] for i in range(len(carried))))
        return out


def touching(problem: MultipointProblem, y: np.ndarray) -> Touching:
    """The grazing orbit y of a multipoint problem over its full period, with all touches and impacts of zero speed."""
    cycle = cycle_of(problem, y)
    modes = problem.system.modes
    speed = np.sqrt(2.0 * problem.energy(y))
    reach = float(np.max(np.abs(modes.contacts.bound[np.isfinite(modes.contacts.bound)])))
    slow = np.abs(cycle.speeds) < CONTACT * speed * float(np.max(np.linalg.norm(modes.contacts.rate, axis=1)))
    impacts = (array[cycle.contact >= 0] for array in (cycle.times, cycle.contact, cycle.before, cycle.after))
    rows = [
        (float(time % cycle.period), int(contact), before, after, bool(graze), True)
        for time, contact, before, after, graze in zip(*impacts, slow, strict=True)
    ]
    for i, duration in enumerate(cycle.duration):
        for contact, time, state in _touches(problem.system, cycle.after[i], float(duration), CONTACT * reach):
            apart = min(time, duration - time)
            beside = {int(cycle.contact[i]) if time < duration - time else int(cycle.contact[(i + 1) % len(cycle.contact)])}
            if apart > _SAME * cycle.period or contact not in beside:
                rows.append((float((cycle.times[i] + time) % cycle.period), contact, state, state, True, False))
    rows.sort(key=lambda row: row[0])
    return Touching(
        problem.system,
        cycle.period,
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows]),
        np.array([row[3] for row in rows]),
        np.array([row[4] for row in rows]),
        sum(1 << i for i, row in enumerate(rows) if row[5]),
    )


def _touches(system: ImpactSystem, z: np.ndarray, duration: float, tolerance: float) -> Iterator[tuple[int, float, np.ndarray]]:
    """(contact, time, state) of the turning points of each gap along a flight that are at a stop."""
    contacts, path = system.modes.contacts, core.path(flight_of(system), np.ascontiguousarray(z), float(duration))
    for contact, rows in enumerate(_derivatives(system)):
        side, bound = float(contacts.side[contact]), float(contacts.bound[contact])
        gap, speed = rows[:2]
        turns = path.crossings(rows[1:])
        for time in turns.tolist() if turns is not None else ():
            state, change = path.motion(time)
            # A gap hardly changes beside its turning point.
            if abs(bound - inner(gap, state)) > _FAR * tolerance:
                continue
            for _ in range(3):
                bend = inner(speed, change)
                if bend != 0.0:
                    time -= inner(speed, state) / bend
                state, change = path.motion(time)
            distance = side * (bound - inner(gap, state))
            if abs(distance) < tolerance and side * inner(speed, change) < 0.0:
                yield contact, time, state


@lru_cache(maxsize=16)
def _derivatives(system: ImpactSystem) -> np.ndarray:
    """The gap of each contact and its first three derivatives without smooth forces, as functionals of a state, (contacts, 4, N)."""
    contacts, matrix = system.modes.contacts, system.modes.matrix
    rows = zip(contacts.gap, contacts.rate, contacts.acceleration, strict=True)
    return np.array([(gap, rate, bend, product(bend, matrix)) for gap, rate, bend in rows])


class Candidate(NamedTuple):
    """A multipoint problem that the grazing orbit solves: ends and sequence, and the orbit as its solution.

    impacts: in a period of the candidate. cover: the given grazing orbit is the cover-fold cover of the candidate.
    """

    ends: Ends
    sequence: ImpactSequence
    start: np.ndarray
    nodes: np.ndarray
    times: np.ndarray
    impacts: int
    cover: int


def candidate(orbit: Touching, mask: int) -> Candidate:
    """The problem in which the instants of a set count as impacts, on the shortest segment that its symmetries leave.

    Raises ValueError for a linear orbit without impacts and without reversals."""
    kept = tuple(symmetry for symmetry in orbit.symmetries if symmetry.move(mask) == mask)
    cover = sum(symmetry.axis is None and not symmetry.mirrored for symmetry in kept)
    impacts = bin(mask).count("1") // cover
    reversals = [symmetry for symmetry in kept if symmetry.axis is not None]
    axes = sorted((item.time + half * orbit.period, item.axis or "") for item in reversals for half in (0.0, 0.5))
    if axes:
        return _segment(orbit, mask, axes, impacts, cover)
    inside = [i for i in range(len(orbit.times)) if mask >> i & 1]
    if not inside and orbit.system.smooth_forces is None:
        raise ValueError("a linear orbit without impacts and without a reversal is not a solution of a multipoint problem")
    if not inside:
        gaps = np.diff(np.append(orbit.times, orbit.times[0] + orbit.period))
        cycle = Cycle(orbit.system, orbit.before, orbit.after, gaps, np.full(len(gaps), -1), float(orbit.times[0]))
        image = closed_presentation(cycle)
        return Candidate(PERIODIC, (), image.start, image.nodes, image.times / cover, 0, cover)
    # A hard impact is the better start.
    begin = next((i for i in inside if not orbit.grazing[i]), inside[0])
    at = inside.index(begin)
    chosen = [inside[(at + j) % len(inside)] for j in range(impacts)]
    period = orbit.period / cover
    stamps = np.array([(orbit.times[i] - orbit.times[begin]) % orbit.period for i in chosen] + [period])
    sequence = tuple(orbit.letters[i] for i in chosen)
    return Candidate(PERIODIC, sequence, orbit.after[begin], orbit.after[chosen[1:]], np.diff(stamps), impacts, cover)


def _segment(orbit: Touching, mask: int, axes: list[tuple[float, str]], impacts: int, cover: int) -> Candidate:
    """Between two neighbouring axes, from an origin if there is one, near the start of the orbit as it was given."""
    period = orbit.period

    def late(axis: tuple[float, str]) -> float:
        return (axis[0] + _APART * period) % period

    origins = [axis for axis in axes if axis[1] == "origin"]
    first = min(origins or axes, key=late)
    place = axes.index(first)
    last = axes[(place + 1) % len(axes)]
    length = (last[0] - first[0]) % period
    if length < _APART * period:
        length = period
    slack = _APART * period
    ends, instants = [], []
    for time, kind in (first, last):
        i = orbit.at(time)
        counts = i is not None and mask >> i & 1 == 1
        ends.append("stop" + orbit.letters[i] if i is not None and counts and kind == "rest" else kind)
        instants.append(i if counts else None)
    offsets = (orbit.times - first[0]) % period
    inner = sorted((i for i in range(len(offsets)) if mask >> i & 1 and slack < offsets[i] < length - slack), key=lambda i: offsets[i])
    begin = instants[0]
    start = orbit.state(first[0]) if begin is None else orbit.after[begin]
    stamps = np.concatenate([[0.0], offsets[inner], [length]])
    sequence = tuple(orbit.letters[i] for i in inner)
    return Candidate((ends[0], ends[1]), sequence, start, orbit.after[inner], np.diff(stamps), impacts, cover)


def mode_of(orbit: Touching) -> int | None:
    """Index of the one mode that a grazing orbit without hard impacts is the motion of; None where several modes move."""
    modes = orbit.system.modes
    n = len(modes.frequencies)
    energies = 0.5 * (modes.squares * orbit.after[0, :n] ** 2 + orbit.after[0, n:] ** 2)
    k = int(np.argmax(energies))
    return k if np.sum(energies) - energies[k] < _ALONE**2 * energies[k] else None


def mode_label(system: ImpactSystem, index: int) -> str:
    """L11+ where absorber and primary move the same way in a linear mode, L11- where not; "" for systems without two such masses."""
    if system.degrees_of_freedom != 2 or system.absorber is None or system.primary is None:
        return ""
    shape = system.modes.shapes[:, index]
    return "L11+" if shape[system.absorber] * shape[system.primary] > 0.0 else "L11-"


def mode_name(system: ImpactSystem, index: int) -> str:
    """The `mode_label` of a linear mode; L1, L2, ... by rising frequency where it has none."""
    return mode_label(system, index) or f"L{index + 1}"
