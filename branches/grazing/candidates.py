"""From a grazing orbit and a choice of the instants that count as impacts to the multipoint problem of a family that meets it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from branches.grazing.touching import Symmetry, Touching, stabiliser
from branches.words import PERIODIC, Ends, Word
from bvp.multipoint import MultipointProblem

__all__ = ["Candidate", "candidate"]

_APART = 1e-7


class Candidate(NamedTuple):
    """A problem that the grazing orbit solves: ends, word, and the orbit as its solution.

    kept: bit mask of the instants that count as impacts. impacts: their number in a period of the candidate. turns: how many periods of
    the candidate the grazing orbit, as it was given, runs through.
    """

    kept: int
    ends: Ends
    word: Word
    start: np.ndarray
    nodes: np.ndarray
    times: np.ndarray
    impacts: int
    turns: int

    def problem(self, orbit: Touching) -> MultipointProblem:
        """The multipoint problem between the ends with the word."""
        return MultipointProblem(orbit.system, self.ends, self.word)


def candidate(orbit: Touching, mask: int) -> Candidate:
    """The problem in which the instants of a set count as impacts, on the shortest segment that its symmetries leave.

    Raises
    ------
    ValueError
        For an orbit without impacts and without reversals.
    """
    kept = stabiliser(orbit, mask)
    turns = sum(symmetry.axis is None and not symmetry.mirrored for symmetry in kept)
    impacts = bin(mask).count("1") // turns
    axes = _axes(orbit, kept)
    if axes:
        return _segment(orbit, mask, axes, impacts, turns)
    inside = [i for i in range(len(orbit.times)) if mask >> i & 1]
    if not inside:
        raise ValueError("an orbit without impacts and without a reversal is no solution of a multipoint problem")
    # A hard impact is the better start.
    begin = next((i for i in inside if not orbit.grazing[i]), inside[0])
    at = inside.index(begin)
    chosen = [inside[(at + j) % len(inside)] for j in range(impacts)]
    period = orbit.period / turns
    stamps = np.array([(orbit.times[i] - orbit.times[begin]) % orbit.period for i in chosen] + [period])
    word = tuple(orbit.letters[i] for i in chosen)
    return Candidate(mask, PERIODIC, word, orbit.after[begin], orbit.after[chosen[1:]], np.diff(stamps), impacts, turns)


def _axes(orbit: Touching, kept: tuple[Symmetry, ...]) -> list[tuple[float, str]]:
    """Axes of reversal over the period, (time, kind), ascending."""
    out = []
    for symmetry in kept:
        if symmetry.axis is not None:
            out += [(symmetry.time, symmetry.axis), (symmetry.time + 0.5 * orbit.period, symmetry.axis)]
    return sorted(out)


def _segment(orbit: Touching, mask: int, axes: list[tuple[float, str]], impacts: int, turns: int) -> Candidate:
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
    word = tuple(orbit.letters[i] for i in inner)
    return Candidate(mask, (ends[0], ends[1]), word, start, orbit.after[inner], np.diff(stamps), impacts, turns)
