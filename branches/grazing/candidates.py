"""From a grazing orbit to the multipoint problem of a family that meets it: by a choice of the impacts, or with two impacts exchanged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from branches.grazing.touching import Symmetry, Touching, stabiliser
from branches.sequences import PERIODIC, Ends, ImpactSequence
from bvp.multipoint import MultipointProblem

__all__ = ["Candidate", "CannotMerge", "candidate", "merged"]

_APART = 1e-7


class Candidate(NamedTuple):
    """A problem that the grazing orbit solves: ends, sequence, and the orbit as its solution.

    kept: bit mask of the instants that count as impacts. impacts: their number in a period of the candidate. cover: how many periods of
    the candidate the grazing orbit, as it was given, runs through.
    """

    kept: int
    ends: Ends
    sequence: ImpactSequence
    start: np.ndarray
    nodes: np.ndarray
    times: np.ndarray
    impacts: int
    cover: int

    def problem(self, orbit: Touching) -> MultipointProblem:
        """The multipoint problem between the ends with the sequence."""
        return MultipointProblem(orbit.system, self.ends, self.sequence)


def candidate(orbit: Touching, mask: int) -> Candidate:
    """The problem in which the instants of a set count as impacts, on the shortest segment that its symmetries leave.

    Raises
    ------
    ValueError
        For an orbit without impacts and without reversals.
    """
    kept = stabiliser(orbit, mask)
    cover = sum(symmetry.axis is None and not symmetry.mirrored for symmetry in kept)
    impacts = bin(mask).count("1") // cover
    axes = _axes(orbit, kept)
    if axes:
        return _segment(orbit, mask, axes, impacts, cover)
    inside = [i for i in range(len(orbit.times)) if mask >> i & 1]
    if not inside:
        raise ValueError("an orbit without impacts and without a reversal is no solution of a multipoint problem")
    # A hard impact is the better start.
    begin = next((i for i in inside if not orbit.grazing[i]), inside[0])
    at = inside.index(begin)
    chosen = [inside[(at + j) % len(inside)] for j in range(impacts)]
    period = orbit.period / cover
    stamps = np.array([(orbit.times[i] - orbit.times[begin]) % orbit.period for i in chosen] + [period])
    sequence = tuple(orbit.letters[i] for i in chosen)
    return Candidate(mask, PERIODIC, sequence, orbit.after[begin], orbit.after[chosen[1:]], np.diff(stamps), impacts, cover)


def _axes(orbit: Touching, kept: tuple[Symmetry, ...]) -> list[tuple[float, str]]:
    """Axes of reversal over the period, (time, kind), ascending."""
    out = []
    for symmetry in kept:
        if symmetry.axis is not None:
            out += [(symmetry.time, symmetry.axis), (symmetry.time + 0.5 * orbit.period, symmetry.axis)]
    return sorted(out)


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
    return Candidate(mask, (ends[0], ends[1]), sequence, start, orbit.after[inner], np.diff(stamps), impacts, cover)


_SHORT = 1e-8
_SAME = 1e-8


class CannotMerge(ValueError):
    """Impacts that merge without a family behind; the message says why."""


def merged(problem: MultipointProblem, y: np.ndarray) -> tuple[MultipointProblem, np.ndarray, tuple[str, str]] | None:
    """The family behind a flight that has vanished: the two impacts around it in the other order.

    Returns
    -------
    problem, y, stops
        The problem with the other order, the orbit as its solution, the two contacts; None where no flight has vanished between impacts
        at different contacts.

    Raises
    ------
    CannotMerge
        Where the order matters, because the impulse of one stop changes the speed at the other, or where an impact comes to an end.
    """
    times = problem.flight_times(y)
    flight = int(np.argmin(times))
    if times[flight] > _SHORT * float(np.sum(times)):
        return None
    sequence, states, start = list(problem.sequence), problem.nodes(y), problem.start(y)
    if problem.periodic:
        # Impacts are numbered from the start, and turned so that the start is another one than the two.
        turned = [(i + flight - 1) % len(sequence) for i in range(len(sequence))]
        sequence, states, times = [sequence[i] for i in turned], np.vstack([start, states])[turned], times[turned]
        i = 1
    else:
        i = flight - 1
    if i < 0 or i + 1 >= len(sequence):
        raise CannotMerge("an impact comes to an end of the solved segment: it and its image cannot change their order")
    here, there = sequence[i], sequence[i + 1]
    if here == there:
        return None
    before = _after_impact(problem, here, states[i])
    between = _after_impact(problem, there, before)
    if not np.allclose(_after_impact(problem, here, between), states[i + 1], rtol=0.0, atol=_SAME * float(np.max(np.abs(states)))):
        raise CannotMerge(f"impacts at {here} and {there} act on each other, so that at one instant their order would matter")
    states = states.copy()
    states[i] = between
    sequence[i], sequence[i + 1] = there, here
    other = MultipointProblem(problem.system, problem.ends, sequence)
    y = other.pack(states[0], states[1:], times) if problem.periodic else other.pack(start, states, times)
    return other, y, (here, there)


def _after_impact(problem: MultipointProblem, letter: str, z: np.ndarray) -> np.ndarray:
    """The state after an elastic impact, from the one before it or the other way round."""
    modes = problem.modes
    c = modes.contact_letters.index(letter)
    return z - (1.0 + modes.contact_restitution[c]) * modes.contact_push[c] * float(modes.contact_rate[c] @ z)
