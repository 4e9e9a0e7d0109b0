"""The orbit of an event as each of the two families that meet there has it: what an edge keeps so that its closing can be checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from branches.catalogue.rows import Edge, EventOrbit
from branches.identity import closed_presentations, presentations, segment_images
from branches.stretch import Stretch, embed, solved, stretch_of
from branches.words import PERIODIC, Ends, Word, impacts_per_period
from bvp.cycle import cycle_of
from bvp.kernels.flight import flow_state
from bvp.kernels.segment import STOP
from bvp.multipoint import MultipointProblem, NotConverged

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.events import BranchEvent
    from bvp.system import ImpactSystem

__all__ = ["distance", "event_orbit", "kept_orbit", "orbit_of_event", "presented", "seen_from", "switch_edge", "unknowns_of"]

_LONGEST = 20
"""Segments of an orbit that a segment of a family born from it may span: half a period of a quintupled quarter-period orbit has ten."""

_TURNS = 5
"""Turns of an orbit that a family born from it may close after."""

_SAMPLES = 48
"""States looked at on each flight before the nearest is refined."""


def event_orbit(problem: MultipointProblem, y: np.ndarray) -> EventOrbit:
    """The orbit y of a problem, as an edge keeps it."""
    return kept_orbit(problem.system, stretch_of(problem, y))


def kept_orbit(system: ImpactSystem, stretch: Stretch) -> EventOrbit:
    """An orbit in one presentation, as an edge keeps it."""
    start = system.modes.to_state @ stretch.start
    return EventOrbit(stretch.ends, "".join(stretch.word), tuple(start.tolist()), tuple(map(float, stretch.times)))


def orbit_of_event(branch: Branch, event: BranchEvent) -> EventOrbit:
    """The orbit of a branch's event, as it was saved."""
    columns = branch.points
    start = np.concatenate([columns["start_u"][event.point], columns["start_v"][event.point]])
    times = columns["flight_times"][event.point]
    return EventOrbit(branch.ends, branch.word, tuple(start.tolist()), tuple(times.tolist()))


def seen_from(problem: MultipointProblem, y: np.ndarray, ends: Ends, word: Word) -> EventOrbit | None:
    """The orbit y as an orbit of the problem with other ends and word: started at another of its ends, run over a longer segment or
    several turns, or mirrored; None where it is none."""
    for window in _windows(problem, ends, word):
        stretch = embed(problem, y, window)
        for image in (stretch, stretch.mirrored()) if problem.system.has_odd_symmetry else (stretch,):
            if (image.ends, image.word) == (ends, word):
                return kept_orbit(problem.system, image)
    return None


def _windows(problem: MultipointProblem, ends: Ends, word: Word) -> list[tuple[int, int] | int]:
    """The windows of `branches.stretch.embed` that have ends of these kinds and as many impacts as a word."""
    inner, kinds = len(problem.word), [_kind(end) for end in problem.ends]
    if ends == PERIODIC:
        impacts = impacts_per_period(problem.word, problem.ends)
        return [turns for turns in range(1, _TURNS + 1) if turns * impacts == len(word)]
    if problem.periodic:
        return []
    found: list[tuple[int, int] | int] = []
    for length in range(1, _LONGEST + 1):
        for first in range(4):
            at_stops = sum(kinds[place % 2] == "stop" for place in range(first + 1, first + length))
            same = (kinds[first % 2], kinds[(first + length) % 2]) == (_kind(ends[0]), _kind(ends[1]))
            if same and length * inner + at_stops == len(word):
                found.append((first, first + length))
    return found


def _kind(end: str) -> str:
    return "stop" if end.startswith("stop") else end


def presented(problem: MultipointProblem, y: np.ndarray, ends: Ends, word: Word) -> EventOrbit | None:
    """The orbit y as an orbit of the problem with other ends and word, in whatever presentation: mirrored or run backwards, as
    `seen_from`, started at another impact, or the primitive orbit that it repeats; None where it has none."""
    for image in segment_images(problem, y):
        if (image.ends, tuple(image.word)) == (ends, tuple(word)):
            return kept_orbit(problem.system, image)
    found = seen_from(problem, y, ends, word)
    if found is not None:
        return found
    closed = closed_presentations(problem, y, tuple(word)) if ends == PERIODIC else []
    for stretch in (*closed, *presentations(problem, y)):
        if (stretch.ends, tuple(stretch.word)) == (ends, tuple(word)):
            other = MultipointProblem(problem.system, ends, word)
            try:
                # A part of an orbit of singular equations has the square root of their accuracy.
                return event_orbit(other, solved(other, stretch.unknowns(other)).y)
            except NotConverged:
                return None
    return None


def switch_edge(source: Branch, event: BranchEvent, target: Branch, target_event: str = "") -> Edge:
    """The edge from a BP, SB or PD of one family to the family that was followed from there."""
    y = source.unknowns(event.point)
    seen = seen_from(source.problem, y, target.ends, tuple(target.problem.word))
    return Edge(
        source.id, event.id, event.type, "switch", target.id, event.h, event.alpha, target_event, event.stop, event.note,
        orbit_of_event(source, event), seen,
    )  # fmt: skip


def unknowns_of(problem: MultipointProblem, orbit: EventOrbit) -> np.ndarray:
    """Unknowns of a problem from an orbit that was kept: exact start and flight times, nodes by exact flight."""
    start = problem.modes.from_state @ np.array(orbit.start)
    return problem.shoot(start, np.array(orbit.flight_times))


def distance(problem: MultipointProblem, y: np.ndarray, start: np.ndarray) -> float:
    """How far a state (2 n,), in physical coordinates, is from the orbit y, its mirror image and both run backwards, relative to the
    size of the state. One state of a free motion is the whole of it."""
    modes, half = problem.modes, problem.half
    if problem.inner or problem.periodic or any(kind == STOP for kind in problem.kinds):
        cycle = cycle_of(problem, y)
        begins, durations = cycle.after, cycle.duration
    else:
        # A linear mode: one flight without end.
        begins, durations = problem.start(y)[None], np.array([4.0 * problem.quarter_period(y)])
    signs = (1.0, -1.0) if problem.system.has_odd_symmetry else (1.0,)
    back = np.concatenate([np.ones(half), -np.ones(half)])
    images = [modes.from_state @ (sign * way * start) for sign in signs for way in (np.ones(2 * half), back)]
    size = float(np.linalg.norm(images[0]))
    state = np.empty(2 * half)
    times = np.linspace(0.0, 1.0, _SAMPLES)
    track = np.empty((len(durations), _SAMPLES, 2 * half))
    for i, duration in enumerate(durations):
        for j, part in enumerate(times):
            flow_state(*modes.blocks, begins[i], float(part * duration), track[i, j])
    best = np.inf
    for image in images:
        away = np.linalg.norm(track - image, axis=2)
        for i, j in zip(*_dips(away, track), strict=True):
            t = times[j] * durations[i]
            for _ in range(8):
                flow_state(*modes.blocks, begins[i], float(t), state)
                rate = modes.matrix @ state
                t = min(max(t + rate @ (image - state) / (rate @ rate), 0.0), durations[i])
            flow_state(*modes.blocks, begins[i], float(t), state)
            best = min(best, float(np.linalg.norm(state - image)))
    return best / size


def _dips(away: np.ndarray, track: np.ndarray) -> tuple[np.ndarray, ...]:
    """Where on which flight a distance (m, samples) is least among its neighbours and no larger than the way between samples: (i, j). The
    nearest of all is among them."""
    padded = np.pad(away, ((0, 0), (1, 1)), constant_values=np.inf)
    least = (away <= padded[:, :-2]) & (away <= padded[:, 2:])
    way = np.linalg.norm(np.diff(track, axis=1), axis=2)
    near = away <= 2.0 * np.maximum(np.pad(way, ((0, 0), (1, 0))), np.pad(way, ((0, 0), (0, 1))))
    found = least & near
    found.flat[int(np.argmin(away))] = True
    return np.nonzero(found)
