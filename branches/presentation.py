"""Presentations of a periodic orbit (the segments of its period that a multipoint problem can solve), its symmetries, its canonical one.

One orbit can be solved between different ends, started at different times, as its mirror image -u, backwards in time, or run through more
than once. Each presentation holds the unknowns of the multipoint problem that has its ends and its impact sequence. `canonical_orbit` takes
all of these to one.

The symmetries are found from the impacts of a period. These are compared with their shifts (covers; the half-period symmetry
u(t + T/2) = -u(t)) and with their reversals u(c + s) = e u(c - s). The instants c of the reversals are the orbit's ends: an origin for
e = -1, a rest or a stop for e = +1.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from functools import lru_cache, reduce
from typing import NamedTuple

import numpy as np

from branches.sequences import PERIODIC, Ends, ImpactSequence, canonical_sequence, full_sequence, mirror, segments_per_period
from bvp.closures import ORIGIN, STOP, Cycle, cycle_of
from bvp.dense import product
from bvp.functions import cos, exp
from bvp.multipoint import MultipointProblem, Solution
from bvp.smooth_cycles import covers, is_without_impacts, reversal_instants, start_instants, states_at
from bvp.system import ImpactSystem

__all__ = [
    "Presentation", "Symmetries", "all_presentations", "canonical_orbit", "closed_presentation", "closed_presentations", "cover_of",
    "embed", "first_of", "is_solved_as_it_is", "pattern_of", "presentation_of", "presentations", "run_backwards", "same_orbit",
    "segment_images", "solved", "starts_of", "symmetries", "with_canonical_sequence",
]  # fmt: skip

SLACK = 1e-9
"""Part of the period within which an impact is at an end."""

SAME = 1e-7
"""Difference of states and times, relative to the largest, below which two orbits are one."""


class Presentation(NamedTuple):
    """A presentation of an orbit: its ends, inner contacts, start state, the states after its inner impacts, flight times.

    For periodic ends, `sequence` covers the full period and begins with the impact at the start; `nodes` are the states after the others.
    """

    ends: Ends
    sequence: ImpactSequence
    start: np.ndarray
    nodes: np.ndarray
    times: np.ndarray

    @property
    def quarter_period(self) -> float:
        """A quarter of the period of the orbit."""
        return 0.25 * segments_per_period(self.ends) * float(np.sum(self.times))

    @property
    def leans(self) -> bool:
        """Whether more impacts lie inside its first half than inside its second; False for periodic ends."""
        if self.ends == PERIODIC:
            return False
        instants = np.cumsum(self.times)
        middle, slack = 0.5 * instants[-1], SLACK * instants[-1]
        return bool(np.sum(instants[:-1] < middle - slack) > np.sum(instants[:-1] > middle + slack))

    def unknowns(self, problem: MultipointProblem) -> np.ndarray:
        """The presentation as unknowns of a problem with its ends and sequence."""
        return problem.pack(self.start, self.nodes, self.times)

    def mirrored(self) -> Presentation:
        """The presentation of -u."""
        first, last = mirror(self.ends)
        return Presentation((first, last), mirror(self.sequence), -self.start, -self.nodes, self.times)


def presentation_of(problem: MultipointProblem, y: np.ndarray) -> Presentation:
    """The presentation that the unknowns of a problem are."""
    return Presentation(problem.ends, problem.sequence, problem.start(y), problem.impact_states(y), problem.whole_flight_times(y))


def presentation_between(cycle: Cycle, first: float, last: float, kinds: tuple[str, str]) -> Presentation:
    """The presentation of an orbit between two instants at which it reverses.

    Parameters
    ----------
    cycle : Cycle
        The orbit's period.
    first, last : float
        Times from the orbit's start, 0 <= first < last.
    kinds : (str, str)
        "origin", "rest" or "stop", with or without the contact's letter, which is read from the orbit.
    """
    after = cycle.after[cycle.contact >= 0]
    count = len(after)
    periods = range(-1, 2 + math.ceil(last / cycle.period))  # the impact of a stop at the start ends the period
    instants = np.concatenate([cycle.times[cycle.contact >= 0] + k * cycle.period for k in periods])
    slack = SLACK * cycle.period
    inner = [i for i in range(len(instants)) if first + slack < instants[i] < last - slack]
    nearest = [int(np.argmin(np.abs(instants - time))) % count if count else -1 for time in (first, last)]
    ends = ["stop" + cycle.letters[i] if kind.startswith("stop") else kind for kind, i in zip(kinds, nearest, strict=True)]
    if ends[0].startswith("stop"):
        start = after[nearest[0]]
    else:
        u, v = cycle.sample(np.array([first]))
        start = product(cycle.system.modes.from_state, np.concatenate([u[0], v[0]]))
    stamps = np.concatenate([[first], instants[inner], [last]])
    sequence = tuple(cycle.letters[i % count] for i in inner)
    return Presentation((ends[0], ends[1]), sequence, start, after[[i % count for i in inner]], np.diff(stamps))


def closed_presentation(cycle: Cycle, cover: int = 1, first: int = 0, *, backwards: bool = False, mirrored: bool = False) -> Presentation:
    """The full period as it closes on itself from one of its impacts: a cover of it, backwards in time, or the mirror image.

    Without impacts it begins at one of the maxima that `bvp.smooth_cycles` finds."""
    if is_without_impacts(cycle):
        sign = -1.0 if mirrored else 1.0
        instants = start_instants(cycle, sign)
        if len(instants) <= first:
            raise RuntimeError("no maximum of the sum of the modal displacements was found, at which the closed orbit would begin")
        start = sign * states_at(cycle, instants[first : first + 1])[0]
        if backwards:
            start[len(start) // 2 :] *= -1.0
        return Presentation(PERIODIC, (), start, np.empty((0, len(start))), np.array([cover * cycle.period]))
    after, duration, letters = cycle.after, cycle.duration, cycle.letters
    if backwards:
        flip = np.repeat([1.0, -1.0], after.shape[1] // 2)
        after, duration, letters = (cycle.before * flip)[::-1], _from(duration[::-1], 1), letters[::-1]
    nodes = np.concatenate([_from(after, first)] * cover)
    sequence = (letters[first:] + letters[:first]) * cover
    image = Presentation(PERIODIC, sequence, nodes[0], nodes[1:], np.concatenate([_from(duration, first)] * cover))
    return image.mirrored() if mirrored else image


def starts_of(cycle: Cycle, sign: float = 1.0) -> int:
    """The number of instants at which a closed orbit, or with sign -1 its mirror image, can start: its impacts or its maxima."""
    return len(cycle.letters) or len(start_instants(cycle, sign))


def _from(rows: np.ndarray, first: int) -> np.ndarray:
    """The rows from one on, and then those before it."""
    return np.concatenate([rows[first:], rows[:first]])


def run_backwards(system: ImpactSystem, presentation: Presentation, problem: MultipointProblem | None = None) -> Presentation:
    """A presentation between two reversals, run from its last end to its first.

    `problem`, if it is at hand, has the presentation's ends and sequence.
    """
    if problem is None:
        problem = _problem_between(system, presentation.ends, presentation.sequence)
    flip = np.repeat([1.0, -1.0], problem.half)
    arrivals = problem.end_states(presentation.unknowns(problem)) * flip
    ends = (presentation.ends[1], presentation.ends[0])
    return Presentation(ends, presentation.sequence[::-1], arrivals[-1], arrivals[-2::-1], presentation.times[::-1])


@lru_cache(maxsize=256)
def _problem_between(system: ImpactSystem, ends: Ends, sequence: ImpactSequence) -> MultipointProblem:
    """A problem for its flights: to make one takes longer than these."""
    return MultipointProblem(system, ends, sequence)


def embed(problem: MultipointProblem, y: np.ndarray, window: tuple[int, int] | int) -> Presentation:
    """The orbit y over a window of its time: (first, last) in solved segments, or a number of periods that close on themselves."""
    cycle = cycle_of(problem, y)
    if isinstance(window, int):
        return closed_presentation(cycle, window)
    length = float(np.sum(problem.flight_times(y)))
    kinds = (problem.ends[window[0] % 2], problem.ends[window[1] % 2])
    return presentation_between(cycle, window[0] * length, window[1] * length, kinds)


def solved(problem: MultipointProblem, y: np.ndarray) -> Solution:
    """The solution at unknowns that another presentation gave.

    It is not corrected where its residual allows: at a branch point the equations are singular, and Newton would move it. Else it is
    corrected at its energy.

    Raises
    ------
    NotConverged
        Where it cannot be corrected.
    """
    uncorrected = problem.step(y, np.zeros(2 * problem.unknowns), 0.0, maximum=0)
    return problem.solve(y, energy=problem.energy(y)) if uncorrected is None else uncorrected


class Symmetries(NamedTuple):
    """What maps an orbit to itself.

    cover: how often its primitive orbit is run through. half: whether the primitive orbit has u(t + T/2) = -u(t). reversals: (instant,
    e) in one primitive period, from the orbit's start on, in order of time.
    """

    cover: int
    half: bool
    reversals: tuple[tuple[float, int], ...]

    @property
    def order(self) -> int:
        """How many symmetries the orbit has, itself and its mirror image taken as two."""
        return self.cover * (1 + self.half) * max(1, len(self.reversals))


def symmetries(cycle: Cycle, tolerance: float = SAME) -> Symmetries:
    """The symmetries of an orbit, from its impacts.

    Parameters
    ----------
    cycle : Cycle
    tolerance : float
        Relative difference of states and flight times that counts as none.
    """
    if is_without_impacts(cycle):
        cover, half = covers(cycle, tolerance)
        primitive = (1.0 - SLACK) * cycle.period / cover
        return Symmetries(cover, half, tuple(pair for pair in reversal_instants(cycle, tolerance) if pair[0] < primitive))
    count, dof = len(cycle.duration), cycle.after.shape[1] // 2
    length, half = _shifts(cycle, tolerance)
    time, state = _differences(cycle, tolerance)
    # The flight times exclude most reversals, all at once: row j of `index` numbers the flights from j on.
    index = (np.arange(count)[:, None] + np.arange(count)) % count
    backwards = np.all(np.abs(cycle.duration[index] - cycle.duration[::-1]) <= time, axis=1)
    period = cycle.period * length / count
    instants = cycle.times[:length]
    found = []
    for j in (j for j in range(length) if backwards[j]):
        for e in (-1, 1) if cycle.system.has_odd_symmetry else (1,):
            flip = np.repeat([float(e), -float(e)], dof)
            if (np.abs(cycle.after[(j - np.arange(count)) % count] - flip * cycle.before) <= state).all():
                middle = 0.5 * (instants[0] + instants[j])
                found += [(float(c % period), e) for c in (middle, middle + 0.5 * period)]
    # An instant at the very start may come out at the end of the period by rounding.
    found = sorted((0.0 if period - c < SLACK * period else c, e) for c, e in found)
    return Symmetries(count // length, half, tuple(found))


def _differences(cycle: Cycle, tolerance: float) -> tuple[float, np.ndarray]:
    """Differences of flight times, and of the entries of a state (N,), that count as none."""
    dof = cycle.after.shape[1] // 2
    sizes = np.abs(cycle.after)
    return tolerance * float(cycle.duration.max()), tolerance * np.repeat([sizes[:, :dof].max(), sizes[:, dof:].max()], dof)


def _shifts(cycle: Cycle, tolerance: float = SAME) -> tuple[int, bool]:
    """How many impacts the primitive orbit has, and whether it has u(t + T/2) = -u(t)."""
    count, durations = len(cycle.duration), cycle.duration.tolist()
    time, state = _differences(cycle, tolerance)

    def is_itself(by: int, sign: float) -> bool:
        """Whether the orbit is `sign` times itself so many impacts later."""
        if abs(durations[by] - durations[0]) > time:
            return False
        later = np.concatenate([cycle.duration[by:], cycle.duration[:by]])
        if (np.abs(later - cycle.duration) > time).any():
            return False
        return bool((np.abs(np.concatenate([cycle.after[by:], cycle.after[:by]]) - sign * cycle.after) <= state).all())

    length = next((d for d in range(1, count) if count % d == 0 and is_itself(d, 1.0)), count)
    return length, cycle.system.has_odd_symmetry and length % 2 == 0 and is_itself(length // 2, -1.0)


def presentations(problem: MultipointProblem, y: np.ndarray) -> list[Presentation]:
    """`all_presentations` of an orbit that have its canonical ends and sequence; several where the sequence is its own image."""
    return with_canonical_sequence(problem.system, all_presentations(problem, y, canonical=True))


def with_canonical_sequence(system: ImpactSystem, images: Iterable[Presentation]) -> list[Presentation]:
    """Those of an orbit's presentations that have its canonical ends and sequence."""
    images = list(images)
    sequence, ends = canonical_sequence(images[0].sequence, images[0].ends, odd_symmetry=system.has_odd_symmetry)
    return [image for image in images if image.ends == ends and image.sequence == sequence]


def all_presentations(problem: MultipointProblem, y: np.ndarray, *, canonical: bool = False) -> list[Presentation]:
    """All presentations of an orbit, or of the primitive one that it repeats.

    They go from each instant of reversal to the next, or from each impact where there is no reversal; forwards and backwards in time, and
    mirrored where the system has odd symmetry. `canonical`: those without the canonical sequence may be missing.
    """
    cycle = cycle_of(problem, y)
    found = symmetries(cycle)
    if found.cover > 1 and is_without_impacts(cycle):
        start = states_at(cycle, np.zeros(1))
        cycle = Cycle(cycle.system, start, start, np.array([cycle.period / found.cover]), np.array([-1]), 0.0)
    elif found.cover > 1:
        once = slice(len(cycle.duration) // found.cover)
        cycle = Cycle(cycle.system, cycle.before[once], cycle.after[once], cycle.duration[once], cycle.contact[once], cycle.lead)
    if not found.reversals:
        odd = cycle.system.has_odd_symmetry
        return closed_presentations(cycle, canonical_sequence(cycle.letters, PERIODIC, odd_symmetry=odd)[0] if canonical else None)
    kinds = []
    for instant, e in found.reversals:
        distance = np.abs((cycle.times[cycle.contact >= 0] - instant + 0.5 * cycle.period) % cycle.period - 0.5 * cycle.period)
        kinds.append((instant, "origin" if e < 0 else "stop" if np.min(distance, initial=np.inf) <= SLACK * cycle.period else "rest"))
    images = []
    for (first, kind), (last, other) in itertools.pairwise([*kinds, (kinds[0][0] + cycle.period, kinds[0][1])]):
        forward = presentation_between(cycle, first, last, (kind, other))
        images += [forward, run_backwards(cycle.system, forward)]
    return _with_mirrored(cycle.system, images)


def closed_presentations(cycle: Cycle, sequence: ImpactSequence | None = None) -> list[Presentation]:
    """The orbit closed on itself: from each impact, forwards and backwards, and mirrored where the system has odd symmetry; with a
    `sequence` those alone that have it."""
    images = []
    for mirrored, back in itertools.product((False, True)[: 1 + cycle.system.has_odd_symmetry], (False, True)):
        letters = cycle.letters[::-1] if back else cycle.letters
        letters = mirror(letters) if mirrored else letters
        for i in range(starts_of(cycle, -1.0 if mirrored else 1.0)):
            if sequence is None or letters[i:] + letters[:i] == sequence:
                images.append(closed_presentation(cycle, first=i, backwards=back, mirrored=mirrored))
    return images


def segment_images(problem: MultipointProblem, y: np.ndarray, sequence: ImpactSequence | None = None) -> list[Presentation]:
    """The solved segment and the same run backwards, and both mirrored where the system has odd symmetry; of a closed orbit its
    `closed_presentations`, with a `sequence` those alone that have it.

    These are `all_presentations` of an orbit that is primitive and has no more reversals than its ends.
    """
    if problem.periodic:
        return closed_presentations(cycle_of(problem, y), sequence)
    own = presentation_of(problem, y)
    return _with_mirrored(problem.system, [own, run_backwards(problem.system, own, problem)])


def _with_mirrored(system: ImpactSystem, images: list[Presentation]) -> list[Presentation]:
    return images + [image.mirrored() for image in images] if system.has_odd_symmetry else images


def is_solved_as_it_is(problem: MultipointProblem, y: np.ndarray) -> bool:
    """Whether an orbit is run through once, between neighbouring ones of its reversals, and on itself only where it has none."""
    found = symmetries(cycle_of(problem, y))
    if found.cover > 1 or (found.reversals and problem.periodic):
        return False
    # Both kinds of reversals lie a quarter period apart.
    return problem.quarters != 2 or len({e for _, e in found.reversals}) < 2


def canonical_orbit(problem: MultipointProblem, y: np.ndarray) -> tuple[MultipointProblem, np.ndarray]:
    """The one presentation of an orbit, or of the primitive orbit that it repeats.

    Parameters
    ----------
    problem : MultipointProblem
    y : (u,) float
        A solution of it.

    Returns
    -------
    problem, y
        With the ends that the orbit's reversals have (a quarter where it has both kinds), periodic ends only where it has none. Sequence
        and ends are canonical, see `branches.sequences.canonical_sequence`. Among equal sequences it is one with no more impacts in its
        first half than in its second (p <= q), then the one whose flight times, then start state, come first.

    Examples
    --------
    >>> from bvp.system import vibro_impact_nes
    >>> problem = MultipointProblem(vibro_impact_nes(), ("stop-", "origin"), ())
    >>> solution = problem.solve(problem.pack([0.1, -0.9, 0.5, 0.5], [], [1.7]), quarter_period=1.7)
    >>> canonical_orbit(problem, solution.y)[0].ends
    ('origin', 'stop+')
    """
    best = first_of(presentations(problem, y))
    found = MultipointProblem(problem.system, best.ends, best.sequence, problem.pieces)
    return found, solved(found, best.unknowns(found)).y


def first_of(presentations: Sequence[Presentation]) -> Presentation:
    """The canonical one of an orbit's `presentations`."""
    return reduce(lambda best, other: other if _comes_before(other, best) else best, presentations)


def _comes_before(a: Presentation, b: Presentation) -> bool:
    """Order by whether more impacts lie in the first half than in the second, then by flight times, then by start states."""
    if a.leans != b.leans:
        return b.leans
    for x, y in ((a.times, b.times), (-a.start, -b.start)):
        apart = np.flatnonzero(np.abs(x - y) > SAME * np.max(np.abs(x)))
        if apart.size:
            return bool(x[apart[0]] < y[apart[0]])
    return False


def same_orbit(
    a: tuple[MultipointProblem, np.ndarray],
    b: tuple[MultipointProblem, np.ndarray],
    tolerance: float = SAME,
    *,
    between_reversals: bool = False,
) -> bool:
    """Whether two solutions are one orbit: exchanged ends, mirror image, reversal in time, another start, or multiple covers allowed.

    Parameters
    ----------
    a, b : (problem, y)
    tolerance : float
        Of states and times, relative to the largest.
    between_reversals : bool
        Whether both are solved between neighbouring reversals. Then no symmetry has to be looked for: one can only be the other one's
        mirror image, or run from its other end.
    """
    images: Iterable[Presentation]
    if between_reversals:
        presentation, images = presentation_of(*a), segment_images(*b)
    else:
        presentation, images = presentation_of(*canonical_orbit(*a)), presentations(*b)
    size = max(float(np.max(np.abs(part))) for part in (presentation.start, presentation.nodes) if part.size)
    longest = float(np.max(presentation.times))
    return any(
        (image.ends, image.sequence) == (presentation.ends, presentation.sequence)
        and (np.abs(image.times - presentation.times) <= tolerance * longest).all()
        and (np.abs(image.start - presentation.start) <= tolerance * size).all()
        and (np.abs(image.nodes - presentation.nodes) <= tolerance * size).all()
        for image in images
    )


def cover_of(problem: MultipointProblem, solution: Solution) -> int:
    """How often the solved orbit repeats itself: k for the k-fold cover of its primitive orbit, with k = 2 also if the solved half is half
    a period of an orbit with half-period symmetry (a quarter problem solves that one)."""
    if problem.is_smooth and not problem.sequence and STOP not in problem.kinds:
        if problem.inner == 0 and not problem.periodic:
            return _cover_without_impacts(problem, solution)
        cover, half = covers(cycle_of(problem, solution.y), SAME)
        return 2 if cover == 1 and problem.quarters == 2 and half else cover
    if not _may_repeat(problem.ends, problem.sequence):
        return 1
    cycle = cycle_of(problem, solution.y)
    length, half = _shifts(cycle)
    cover = len(cycle.duration) // length
    return 2 if cover == 1 and problem.quarters == 2 and half else cover


def _cover_without_impacts(problem: MultipointProblem, solution: Solution) -> int:
    """The same for a smooth orbit without impacts: its motion is at an end of the segment's kind after a k-th part of the time, too."""
    time, half = float(problem.flight_times(solution.y)[0]), problem.half
    # Both ends can be at the origin, so what counts as none is measured along the way.
    along = [problem.path_state(solution.y, time * part) for part in (0.0871, 0.1913, 0.3171, 0.4379)]
    size = np.max(np.abs([problem.start(solution.y), solution.ends[0], *along]), axis=0)
    between_origins = problem.kinds == (ORIGIN, ORIGIN)
    parts = 1 + int(max(solution["waves_absorber"], solution["waves_primary"]))
    for k in range(parts, 1, -1):
        state = np.abs(problem.path_state(solution.y, time / k))
        at_origin = (state[:half] <= SAME * size[:half].max()).all()
        at_rest = (state[half:] <= SAME * size[half:].max()).all()
        if (at_origin and between_origins) or (at_rest and (k == 2 if between_origins else k % 2 == 1)):
            return k
    return 1


@lru_cache(maxsize=4096)
def _may_repeat(ends: Ends, sequence: ImpactSequence) -> bool:
    """Whether the impacts of a period, by their contacts alone, repeat those of a shorter one, or alternate with their mirror image."""
    letters = full_sequence(sequence, ends)
    count, half = len(letters), len(letters) // 2
    if any(count % d == 0 and letters[d:] + letters[:d] == letters for d in range(1, count)):
        return True
    # For a quarter, the second half period is the mirror image of the first in any case.
    return segments_per_period(ends) == 2 and count % 2 == 0 and letters[half:] == mirror(letters[:half])


def pattern_of(system: ImpactSystem, parts: np.ndarray, contact: np.ndarray) -> float:
    """A number for the instants of an orbit's impacts: a mean over all pairs of a function of their distance in time, and of whether the
    same side is hit. It is continuous, and no shift, reversal or mirror changes it.

    Parameters
    ----------
    system : ImpactSystem
    parts : (m,) float
        The instants as parts of the period.
    contact : (m,) int
        Contacts hit (rows of the contact arrays of `Modes`); -1 for the cut of an orbit without impacts, which has the number 0.
    """
    if np.all(contact < 0):
        return 0.0
    phase = 2.0 * np.pi * parts
    stop, side = system.modes.contact_stop[contact], system.modes.contacts.side[contact]
    same_side = np.where(stop[:, None] == stop, 2.0 + side[:, None] * side, 1.0)
    return float(np.mean(same_side * exp(cos(phase[:, None] - phase))))
