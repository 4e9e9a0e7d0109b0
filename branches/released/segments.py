"""Free orbits over other segments of their time, in the unknowns of their problems: what `branches.presentation.embed` does from a whole
period, for an orbit whose impacts and ends are known. No system is made for it, so it is cheap enough for each point of a curve."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from branches.sequences import PERIODIC, Ends, ImpactSequence, mirror
from bvp.released import ReleasedProblem

__all__ = ["Segment", "changed", "segment_of"]


class Segment(NamedTuple):
    """A segment of a free orbit.

    ends, sequence : as of `bvp.released.ReleasedProblem`
    after, before : (k + 1, 2 n) states (u, v) where each flight begins, and where it ends before an impact
    times : (k + 1,) flight times
    parameters : (m,) released parameters
    """

    ends: Ends
    sequence: ImpactSequence
    after: np.ndarray
    before: np.ndarray
    times: np.ndarray
    parameters: np.ndarray

    def unknowns(self, problem: ReleasedProblem) -> np.ndarray:
        """It as unknowns of a problem with its ends and sequence."""
        return problem.pack(self.after, np.zeros(len(self.after)), self.parameters, self.times)

    def problem(self, other: ReleasedProblem, y: np.ndarray) -> ReleasedProblem:
        """The problem of its ends and sequence, at the parameters of y and else as another problem."""
        return other.sibling(self.sequence, ends=self.ends, values=other.parameters(y))

    def backwards(self) -> Segment:
        """The orbit run backwards, from the far end to the start."""
        turn = np.repeat([1.0, -1.0], self.after.shape[1] // 2)
        return self._replace(
            ends=(self.ends[1], self.ends[0]),
            sequence=(*self.sequence[:1], *self.sequence[:0:-1]) if self.ends == PERIODIC else self.sequence[::-1],
            after=(self.before * turn)[::-1],
            before=(self.after * turn)[::-1],
            times=self.times[::-1],
        )

    def image(self) -> Segment:
        """The segment that follows: what the reversal of the far end makes of this one, run from there."""
        back = self.backwards()
        return back.mirrored() if self.ends[1] == "origin" else back

    def mirrored(self) -> Segment:
        """The segment of -u."""
        first, last = mirror(self.ends)
        return self._replace(ends=(first, last), sequence=mirror(self.sequence), after=-self.after, before=-self.before)

    def joined(self, other: Segment) -> Segment:
        """This segment and the one that follows. An end that is no stop between them is inside a flight."""
        ends = self.ends[0], other.ends[1]
        if self.ends[1].startswith("stop"):
            sequence = (*self.sequence, self.ends[1].removeprefix("stop"), *other.sequence)
            parts = [np.concatenate(pair) for pair in zip(self[2:5], other[2:5], strict=True)]
            return Segment(ends, sequence, parts[0], parts[1], parts[2], self.parameters)
        after = np.concatenate([self.after, other.after[1:]])
        before = np.concatenate([self.before[:-1], other.before])
        times = np.concatenate([self.times[:-1], [self.times[-1] + other.times[0]], other.times[1:]])
        return Segment(ends, (*self.sequence, *other.sequence), after, before, times, self.parameters)

    def twice(self) -> Segment:
        """Two segments between reversals of one kind; two periods of a closed orbit."""
        if self.ends == PERIODIC:
            parts = [np.concatenate([part, part]) for part in self[2:5]]
            return Segment(PERIODIC, self.sequence * 2, parts[0], parts[1], parts[2], self.parameters)
        return self.joined(self.image())

    def closed(self) -> Segment:
        """A segment that is a whole period, closed on itself. It begins with an impact."""
        if self.ends[0].startswith("stop"):
            return self._replace(ends=PERIODIC, sequence=(self.ends[0].removeprefix("stop"), *self.sequence))
        times = np.append(self.times[1:-1], self.times[-1] + self.times[0])
        return self._replace(ends=PERIODIC, after=self.after[1:], before=np.concatenate([self.before[1:-1], self.before[:1]]), times=times)

    def begun_at(self, impact: int) -> Segment:
        """A closed segment, begun at another one of its impacts."""
        parts = [np.roll(part, -impact, axis=0) for part in self[2:5]]
        return Segment(PERIODIC, self.sequence[impact:] + self.sequence[:impact], parts[0], parts[1], parts[2], self.parameters)

    def opened(self, problem: ReleasedProblem, turn: int) -> Segment:
        """A closed segment, run from a reversal to the same one a period later. Reversed, impact i is impact turn - i. problem: that of the
        segment."""
        count = len(self.sequence)
        if turn % 2 and count % 2 == 0:
            begun = self.begun_at((turn + 1) // 2 % count)
            middle = _flown(problem, begun, count - 1)
            half = 0.5 * begun.times[-1:]
            end = _kind(problem, middle)
            return begun._replace(
                ends=(end, end),
                after=np.vstack([middle, begun.after]),
                before=np.vstack([begun.before[-1:], begun.before[:-1], middle]),
                times=np.concatenate([half, begun.times[:-1], half]),
            )
        begun = self.begun_at((turn if turn % 2 == 0 else turn + count) // 2 % count)
        end = "stop" + begun.sequence[0]
        return begun._replace(ends=(end, end), sequence=begun.sequence[1:])

    def stopped(self, far: bool) -> Segment:
        """A segment whose impact beside an end at rest has no speed, with this stop as its end. far: its far end, else its start."""
        if not far:
            return self.backwards().stopped(True).backwards()
        end = self.ends[0], "stop" + self.sequence[-1]
        return Segment(end, self.sequence[:-1], self.after[:-1], self.before[:-1], self.times[:-1], self.parameters)

    def resting(self, far: bool) -> Segment:
        """The opposite: an end at a stop without speed as an impact, and a flight without duration to an end at rest."""
        if not far:
            return self.backwards().resting(True).backwards()
        last = self.before[-1:]
        parts = [np.vstack([self.after, last]), np.vstack([self.before, last]), np.append(self.times, 0.0)]
        sequence = (*self.sequence, self.ends[1].removeprefix("stop"))
        return Segment((self.ends[0], "rest"), sequence, parts[0], parts[1], parts[2], self.parameters)

    def half(self, problem: ReleasedProblem, change: Segment | None = None) -> Segment:
        """The first half of a segment whose orbit reverses in its middle, too, or that runs twice; of a change of it (`changed`) the change
        of that. problem: that of the segment."""
        part = self if change is None else change
        middle, odd = divmod(len(self.sequence), 2)
        if self.ends == PERIODIC:
            return self._replace(
                sequence=self.sequence[:middle], after=part.after[:middle], before=part.before[:middle], times=part.times[:middle],
                parameters=part.parameters,
            )  # fmt: skip
        first = slice(0, middle + 1)
        after, before, times = part.after[first], part.before[first].copy(), part.times[first].copy()
        if odd:
            end = "stop" + self.sequence[middle]
        else:
            state = _flown(problem, self, middle)
            before[-1] = state if change is None else _flown_change(problem, self, change, middle)
            times[-1] *= 0.5
            end = _kind(problem, state)
        return Segment((self.ends[0], end), self.sequence[:middle], after, before, times, part.parameters)

    def mean(self, other: Segment) -> Segment:
        """The mean of two segments with the same ends and sequence."""
        parts = [0.5 * (one + two) for one, two in zip(self[2:5], other[2:5], strict=True)]
        return self._replace(after=parts[0], before=parts[1], times=parts[2])


def _flown(problem: ReleasedProblem, segment: Segment, flight: int) -> np.ndarray:
    """The state in the middle of a flight, (2 n,)."""
    node = np.concatenate([segment.after[flight], [0.0], segment.parameters])
    return problem.fly(node, 0.5 * float(segment.times[flight]), min(flight, problem.inner))[0]


def _flown_change(problem: ReleasedProblem, segment: Segment, change: Segment, flight: int) -> np.ndarray:
    """The change of the state in the middle of a flight, (2 n,)."""
    node = np.concatenate([segment.after[flight], [0.0], segment.parameters])
    place = problem.flown(node, 0.5 * float(segment.times[flight]), min(flight, problem.inner))
    moved = place.slopes @ np.concatenate([change.after[flight], [0.0], change.parameters]) + place.rates * 0.5 * change.times[flight]
    found: np.ndarray = moved[: len(segment.after[flight])]
    return found


def _kind(problem: ReleasedProblem, state: np.ndarray) -> str:
    """The end inside a flight that a state is."""
    n = len(state) // 2
    units = problem.units[: 2 * n]
    sizes = np.abs(state / np.where(units > 0.0, units, 1.0))
    return "origin" if sizes[:n].max() < sizes[n:].max() else "rest"


def segment_of(problem: ReleasedProblem, y: np.ndarray) -> Segment:
    """The segment that a problem solves, from its unknowns (u,)."""
    states, times, values = problem.states(y).copy(), problem.flight_times(y).copy(), problem.released_values(y).copy()
    return Segment(problem.ends, tuple(problem.sequence), states, problem.end_states(y), times, values)


def changed(problem: ReleasedProblem, y: np.ndarray, way: np.ndarray) -> Segment:
    """The derivatives of the segment along a direction (u,), in the form of a segment. What makes another segment of it, `half` but for its
    argument, is linear: it makes the change of that one."""
    nodes, changes, moved = problem.nodes(y), problem.nodes(way), problem.flight_times(way)
    before = np.empty_like(problem.states(y))
    for i, time in enumerate(problem.flight_times(y).tolist()):
        place = problem.flown(nodes[i], time, i)
        before[i] = (place.slopes @ changes[i] + place.rates * moved[i])[: problem.size]
    states, values = problem.states(way).copy(), problem.released_values(way).copy()
    return Segment(problem.ends, tuple(problem.sequence), states, before, moved.copy(), values)
