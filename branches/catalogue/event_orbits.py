"""The orbit of an event as each of two families has it. An edge stores both, so that `check` can verify that the families meet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from branches.catalogue.rows import Edge, EventOrbit
from branches.identity import closed_presentations, presentations, segment_images
from branches.presentation import Presentation, embed, presentation_of, solved
from branches.sequences import PERIODIC, Ends, ImpactSequence, impacts_per_period
from bvp.cycle import cycle_of
from bvp.kernels.flight import flow_state
from bvp.kernels.segment import STOP
from bvp.multipoint import MultipointProblem, NotConverged

if TYPE_CHECKING:
    from branches.branch import Branch
    from branches.events import BranchEvent
    from bvp.system import ImpactSystem

__all__ = ["distance_from_orbit", "event_orbit", "kept_orbit", "orbit_of_event", "presented", "seen_from", "switch_edge", "unknowns_of"]

_LONGEST = 20
"""Most segments of an orbit in one segment of an emanating family: half a period of a 5:1 resonance has ten quarter periods."""

_COVERS = 5
"""An orbit of an emanating family is at most a 5-fold cover of the orbit at which it starts."""

_SAMPLES = 48
"""States on each flight among which the nearest is searched before it is refined."""


def event_orbit(problem: MultipointProblem, y: np.ndarray) -> EventOrbit:
    """The orbit y of a problem, as an edge stores it."""
    return kept_orbit(problem.system, presentation_of(problem, y))


def kept_orbit(system: ImpactSystem, presentation: Presentation) -> EventOrbit:
    """One presentation of an orbit, as an edge stores it."""
    start = system.modes.to_state @ presentation.start
    return EventOrbit(presentation.ends, "".join(presentation.sequence), tuple(start.tolist()), tuple(map(float, presentation.times)))


def orbit_of_event(branch: Branch, event: BranchEvent) -> EventOrbit:
    """The orbit of a branch's event, from the branch's point."""
    columns = branch.points
    start = np.concatenate([columns["start_u"][event.point], columns["start_v"][event.point]])
    times = columns["flight_times"][event.point]
    return EventOrbit(branch.ends, branch.sequence, tuple(start.tolist()), tuple(times.tolist()))


def seen_from(problem: MultipointProblem, y: np.ndarray, ends: Ends, sequence: ImpactSequence) -> EventOrbit | None:
    """The orbit y as an orbit of the problem with other ends and impact sequence: from another of its ends, over a longer segment or
    several periods, or mirrored. None if it is not such an orbit."""
    for window in _windows(problem, ends, sequence):
        presentation = embed(problem, y, window)
        for image in (presentation, presentation.mirrored()) if problem.system.has_odd_symmetry else (presentation,):
            if (image.ends, image.sequence) == (ends, sequence):
                return kept_orbit(problem.system, image)
    return None


def _windows(problem: MultipointProblem, ends: Ends, sequence: ImpactSequence) -> list[tuple[int, int] | int]:
    """The windows of `branches.presentation.embed` with ends of these kinds and as many impacts as a sequence."""
    inner, kinds = len(problem.word), [_kind(end) for end in problem.ends]
    if ends == PERIODIC:
        impacts = impacts_per_period(problem.word, problem.ends)
        return [k for k in range(1, _COVERS + 1) if k * impacts == len(sequence)]
    if problem.periodic:
        return []
    found: list[tuple[int, int] | int] = []
    for length in range(1, _LONGEST + 1):
        for first in range(4):
            at_stops = sum(kinds[place % 2] == "stop" for place in range(first + 1, first + length))
            same = (kinds[first % 2], kinds[(first + length) % 2]) == (_kind(ends[0]), _kind(ends[1]))
            if same and length * inner + at_stops == len(sequence):
                found.append((first, first + length))
    return found


def _kind(end: str) -> str:
    return "stop" if end.startswith("stop") else end


def presented(problem: MultipointProblem, y: np.ndarray, ends: Ends, sequence: ImpactSequence) -> EventOrbit | None:
    """The orbit y as an orbit of the problem with other ends and impact sequence, in any presentation: mirrored or run backwards, as
    `seen_from`, from another impact, or the primitive orbit that it covers. None if there is none."""
    for image in segment_images(problem, y):
        if (image.ends, tuple(image.sequence)) == (ends, tuple(sequence)):
            return kept_orbit(problem.system, image)
    found = seen_from(problem, y, ends, sequence)
    if found is not None:
        return found
    closed = closed_presentations(problem, y, tuple(sequence)) if ends == PERIODIC else []
    for presentation in (*closed, *presentations(problem, y)):
        if (presentation.ends, tuple(presentation.sequence)) == (ends, tuple(sequence)):
            other = MultipointProblem(problem.system, ends, sequence)
            try:
                # A part of an orbit of singular equations has the square root of their accuracy.
                return event_orbit(other, solved(other, presentation.unknowns(other)).y)
            except NotConverged:
                return None
    return None


def switch_edge(source: Branch, event: BranchEvent, target: Branch, target_event: str = "") -> Edge:
    """The edge from a BP, SB or PD of one family to the family that emanates there."""
    y = source.unknowns(event.point)
    seen = seen_from(source.problem, y, target.ends, tuple(target.problem.word))
    return Edge(
        source.id, event.id, event.type, "switch", target.id, event.h, event.alpha, target_event, event.stop, event.note,
        orbit_of_event(source, event), seen,
    )  # fmt: skip


def unknowns_of(problem: MultipointProblem, orbit: EventOrbit) -> np.ndarray:
    """Unknowns of a problem from a stored orbit: its start and flight times, and nodes by exact flight."""
    start = problem.modes.from_state @ np.array(orbit.start)
    return problem.shoot(start, np.array(orbit.flight_times))


def distance_from_orbit(problem: MultipointProblem, y: np.ndarray, start: np.ndarray) -> float:
    """The distance of a state (2 n,), in physical coordinates, from the orbit y, its mirror image and both run backwards, relative to the
    size of the state. A state determines the whole motion."""
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
            flow_state(modes.flight, begins[i], float(part * duration), track[i, j])
    best = np.inf
    for image in images:
        away = np.linalg.norm(track - image, axis=2)
        for i, j in zip(*_dips(away, track), strict=True):
            t = times[j] * durations[i]
            for _ in range(8):
                flow_state(modes.flight, begins[i], float(t), state)
                rate = modes.matrix @ state
                t = min(max(t + rate @ (image - state) / (rate @ rate), 0.0), durations[i])
            flow_state(modes.flight, begins[i], float(t), state)
            best = min(best, float(np.linalg.norm(state - image)))
    return best / size


def _dips(away: np.ndarray, track: np.ndarray) -> tuple[np.ndarray, ...]:
    """Flights and samples (i, j) at which a distance (m, samples) has a minimum that is not larger than the path between samples, and the
    least of all."""
    padded = np.pad(away, ((0, 0), (1, 1)), constant_values=np.inf)
    least = (away <= padded[:, :-2]) & (away <= padded[:, 2:])
    way = np.linalg.norm(np.diff(track, axis=1), axis=2)
    near = away <= 2.0 * np.maximum(np.pad(way, ((0, 0), (1, 0))), np.pad(way, ((0, 0), (0, 1))))
    found = least & near
    found.flat[int(np.argmin(away))] = True
    return np.nonzero(found)
