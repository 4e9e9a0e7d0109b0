"""A scan of starts at the origin for orbits of systems with smooth forces, two degrees of freedom, with one stop or none.

On its way from the origin a motion is slowest where the modal velocity is perpendicular to the acceleration. From start to start the
velocity along that perpendicular changes its sign where it is zero. There the motion reaches rest, and is a quarter of an orbit. The
distance from the origin does the same for half an orbit between two origins, and the velocity along the stop at an impact. Motions are
compared after the same impacts, which a simulation finds.

The scan compares neighbouring angles. It proves nothing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np
import saltus_core as core

from branches.search.starts import ScannedSegment
from bvp.multipoint import observed_of
from bvp.smooth_flights import make_flight
from bvp.system import ImpactSystem

__all__ = ["SmoothSampler"]

SAMPLES = 4
"""Parts of a Taylor step in which an extremum is looked for."""

MOST = 2000
"""Most impacts of a motion."""

PIECES = 40
"""Most pieces in which a long motion is computed."""

FIRST = 1.0 / 1024.0
"""The first piece of a motion that ends after some half-waves. Each further one is twice as long."""

NARROWED = 2
"""Steps in the angle of a start; Newton's method does the rest."""

BEYOND = 1.02
"""How far a motion is computed to find its extremum near a time, beside that time."""

APART = 0.25
"""Largest change of an extremum's time between neighbouring starts, beside the time to the nearest other one."""


class Passed(NamedTuple):
    """A motion from the origin: its impacts, and its extrema in the flights before, between and after them.

    contacts (k,), instants (k,): of the impacts. nodes (k, 4): states after them. times, values: of the extrema of each flight, and what
    changes its sign at an orbit there; of a flight that is not asked for, there are none.
    """

    contacts: list[int]
    instants: np.ndarray
    nodes: np.ndarray
    times: list[np.ndarray]
    values: list[np.ndarray]


class SmoothSampler:
    """Scans one system from the origin to a far end of one kind: "origin", "rest" or "stop".

    quarter_period: the longest. impacts: numbers of impacts inside the segment; None: all. half_waves: of absorber and primary; a motion
    without impacts is computed until one of their velocities has changed its sign more often.
    """

    def __init__(
        self,
        system: ImpactSystem,
        end: str,
        quarter_period: float,
        impacts: Collection[int] | None = None,
        half_waves: tuple[int, int] | None = None,
    ):
        self.end = end
        self.longest = quarter_period * (2.0 if end == "origin" else 1.0)
        self.impacts = impacts
        self.modes = system.modes
        self.flight = make_flight(system)
        self.simulator = None
        if system.stops:
            from bvp.simulate import Simulator

            self.simulator = Simulator(system)
        self.half_waves = None if system.stops else half_waves
        self.velocities = observed_of(system).rows[-2:, :3].copy()

    def segments(self, energy: float, angles: int, part: float = 1.0) -> Iterator[ScannedSegment]:
        """The segment of each change of sign between neighbouring angles, as many in half a turn, in order of the angles. The other half
        turn is the mirror image. part: of the longest quarter period."""
        grid = (np.arange(angles + 1) + 0.5) * (math.pi / angles)
        longest = part * self.longest
        before = self.passed(energy, grid[0], longest)
        for low, high in zip(grid[:-1], grid[1:], strict=True):
            after = self.passed(energy, high, longest)
            for k in range(min(len(before.times), len(after.times))):
                if before.contacts[: k + self.hits] != after.contacts[: k + self.hits]:
                    break
                for i, j in _pairs(before.times[k], after.times[k]):
                    if before.values[k][i] * after.values[k][j] <= 0.0:
                        ends = ((one, p.times[k][m], p.values[k][m]) for one, p, m in ((low, before, i), (high, after, j)))
                        segment = self._narrowed(energy, before.contacts[: k + self.hits], k, *ends)
                        if segment is not None:
                            yield segment
            before = after

    @property
    def hits(self) -> int:
        """Impacts at the far end: 1 or 0."""
        return int(self.end == "stop")

    def passed(self, energy: float, angle: float, longest: float) -> Passed:
        """The motion of a start for a time: where it is slowest (nearest to the origin, for the far end "origin"; at a stop), and what
        changes its sign at an orbit."""
        state = math.sqrt(2.0 * energy) * np.array([0.0, 0.0, math.cos(angle), math.sin(angle)])
        contacts, instants, before, nodes, until = self._impacts(state, longest)
        times, values = [], []
        if self.end == "stop":
            for k, contact in enumerate(contacts):
                row, (_, _, v, w) = self.modes.contacts.gap[contact], before[k]
                wanted = self.impacts is None or k in self.impacts
                times.append(instants[k : k + wanted])
                values.append(np.full(int(wanted), (row[0] * w - row[1] * v) / math.hypot(row[0], row[1])))
            return Passed(contacts, instants, nodes, times, values)
        begins = np.append(0.0, instants)
        for k, (begin, end, start) in enumerate(zip(begins, np.append(instants, until), [state, *nodes], strict=True)):
            if self.impacts is None or k in self.impacts:
                found = self._extrema(start, end - begin)
                times.append(begin + found[0])
                values.append(found[1])
            else:
                times.append(np.zeros(0))
                values.append(np.zeros(0))
        return Passed(contacts, instants, nodes, times, values)

    def _impacts(self, state: np.ndarray, longest: float) -> tuple[list[int], np.ndarray, np.ndarray, np.ndarray, float]:
        """The contacts, instants, states before and after of the impacts of a motion, and the time up to which it is known. A motion that
        is pressed against a stop is known up to there."""
        if self.simulator is None:
            return [], np.zeros(0), np.zeros((0, 4)), np.zeros((0, 4)), longest
        from bvp.motion import EventKind

        most = MOST if self.impacts is None else max(self.impacts) + 1
        u, v = np.split(self.modes.to_state @ state, 2)
        motion = self.simulator.run(u, v, longest, most)
        kinds = motion.kinds[1:]
        others = np.flatnonzero(~np.isin(kinds, [kind.value for kind in (EventKind.IMPACT, EventKind.TOUCH, EventKind.PIECE)]))
        count = int(others[0]) if len(others) else len(kinds)
        until = float(motion.times[1 + count]) if len(others) else motion.duration
        rows = 1 + np.flatnonzero(kinds[:count] == EventKind.IMPACT.value)
        before, after = (states[rows] @ self.modes.from_state.T for states in (motion.before, motion.after))
        return motion.contacts[rows].tolist(), motion.times[rows], before, after, until

    def _extrema(self, state: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
        """The times (k,) at which a flight is slowest, or nearest to the origin, and what changes its sign at an orbit (k,)."""
        times: list[np.ndarray] = []
        values: list[np.ndarray] = []
        gone = 0.0
        piece = longest if self.half_waves is None else longest * FIRST
        waves = np.zeros(2)
        for _ in range(PIECES):
            left = min(piece, longest - gone)
            state = np.ascontiguousarray(state)
            while (slowest := core.slowest_instants(self.flight, state, left, self.end == "origin", SAMPLES)) is None:
                left *= 0.5
                if left < 1e-6 * longest:
                    return np.concatenate([*times, np.zeros(0)]), np.concatenate([*values, np.zeros(0)])
            times.append(gone + slowest[0])
            values.append(slowest[1])
            gone += left
            if gone >= longest * (1.0 - 1e-12):
                break
            if self.half_waves is not None:
                path = core.path(self.flight, state, left)
                turns = [path.crossings(rows) for rows in self.velocities]
                waves += [0 if times is None else len(times) for times in turns]
                if np.any(waves > self.half_waves):
                    break
                piece = 2.0 * left
            state = slowest[2]
        return np.concatenate(times), np.concatenate(values)

    def _narrowed(
        self, energy: float, contacts: list[int], k: int, first: tuple[float, ...], last: tuple[float, ...]
    ) -> ScannedSegment | None:
        """The segment after k impacts between two starts (angle, time, value), by some steps of the rule of false position; None if the
        start that it leads to has other impacts."""
        low, high = first[0], last[0]
        middle = first
        for _ in range(NARROWED):
            part = first[2] / (first[2] - last[2]) if first[2] != last[2] else 0.5
            angle, guess = (first[m] + part * (last[m] - first[m]) for m in range(2))
            passed = self.passed(energy, angle, BEYOND * guess)
            if passed.contacts[: len(contacts)] != contacts or k >= len(passed.times) or not len(passed.times[k]):
                break
            m = int(np.argmin(np.abs(passed.times[k] - guess)))
            middle = angle, float(passed.times[k][m]), float(passed.values[k][m])
            if middle[2] * first[2] > 0.0:
                first = middle
            else:
                last = middle
        angle, time, value = min((first, last, middle), key=lambda one: abs(one[2]))
        start = math.sqrt(2.0 * energy) * np.array([0.0, 0.0, math.cos(angle), math.sin(angle)])
        found, instants, _, nodes, _ = self._impacts(start, BEYOND * time)
        if found[: len(contacts)] != contacts:
            return None
        letters = tuple(self.modes.contact_letters[contact] for contact in contacts)
        durations = np.diff([0.0, *instants[:k], time])
        end = "stop" + letters[k] if self.hits else self.end
        return ScannedSegment(("origin", end), letters[:k], start, nodes[:k], durations, angle, low, high, abs(value))


def _pairs(first: np.ndarray, second: np.ndarray) -> Iterator[tuple[int, int]]:
    """Indices of the extrema of two neighbouring starts that belong together, by their times."""
    if not len(first) or not len(second):
        return
    spacing = np.diff(first, prepend=-np.inf, append=np.inf)
    for i, time in enumerate(first):
        j = int(np.argmin(np.abs(second - time)))
        if abs(second[j] - time) <= APART * min(spacing[i], spacing[i + 1]):
            yield i, j
