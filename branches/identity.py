"""Which orbit is which: one presentation of each orbit, however it was reached.

An orbit can be solved between other ends, started at another impact, at its other end, as its mirror image -u, backwards in time, or run
through several times. `canonical_orbit` takes all of these to one presentation, found from the orbit's own symmetries: as a list of
impacts over its period it is compared with its shifts (covers; the half-period symmetry u(t + T/2) = -u(t)) and with its reversals
u(c + s) = e u(c - s), whose instants c are its ends - origin for e = -1, rest or stop for e = +1.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from branches.presentation import SLACK, Presentation, closed_presentation, presentation_between, presentation_of, run_backwards, solved
from branches.sequences import PERIODIC, Ends, ImpactSequence, canonical_sequence, full_sequence, mirror, segments_per_period
from bvp.closures import Cycle, cycle_of
from bvp.multipoint import MultipointProblem, Solution

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = [
    "Mark", "all_presentations", "canonical_orbit", "closed_presentations", "digests", "first_of",
    "is_solved_as_it_is", "mark_of", "pattern_of",
    "presentations", "same_orbit", "same_segment", "segment_images", "symmetries", "cover_of", "with_canonical_sequence",
]  # fmt: skip

SAME = 1e-7
"""Difference of states and times, relative to the largest, below which two orbits are one."""

DIGITS = 6
"""Significant digits of the numbers in a family's hash."""

BORDER = 1e-9
"""Relative distance from a border of rounding within which both roundings name the family."""


class Symmetries(NamedTuple):
    """What maps an orbit to itself.

    cover: how often its primitive orbit is run through. half: whether the primitive orbit has u(t + T/2) = -u(t). reversals: (instant,
    e) in one primitive period, from the orbit's start on, in order of time.
    """

    cover: int
    half: bool
    reversals: tuple[tuple[float, int], ...]


def symmetries(cycle: Cycle, tolerance: float = SAME) -> Symmetries:
    """The symmetries of an orbit, from its impacts.

    Parameters
    ----------
    cycle : Cycle
    tolerance : float
        Relative difference of states and flight times that counts as none.
    """
    shifts = _Shifts(cycle, tolerance)
    count, half, odd = shifts.count, cycle.after.shape[1] // 2, cycle.system.has_odd_symmetry
    # The flight times tell most reversals apart, all at once: row j of `index` numbers the flights from j on.
    index = (np.arange(count)[:, None] + np.arange(count)) % count
    backwards = np.all(np.abs(cycle.duration[index] - cycle.duration[::-1]) <= shifts.longest, axis=1)
    length = shifts.length()
    period = cycle.period * length / count
    instants = cycle.times[:length]
    found = []
    for j in (j for j in range(length) if backwards[j]):
        for e in (-1, 1) if odd else (1,):
            flip = np.repeat([float(e), -float(e)], half)
            if shifts.close(cycle.after[(j - np.arange(count)) % count], flip * cycle.before):
                middle = 0.5 * (instants[0] + instants[j])
                found += [(float(c % period), e) for c in (middle, middle + 0.5 * period)]
    # An instant at the very start may come out at the end of the period by rounding.
    found = sorted((0.0 if period - c < SLACK * period else c, e) for c, e in found)
    return Symmetries(count // length, shifts.has_half(length), tuple(found))


class _Shifts:
    """Which shifts of its impacts map an orbit to itself, or to its mirror image."""

    def __init__(self, cycle: Cycle, tolerance: float = SAME) -> None:
        half = cycle.after.shape[1] // 2
        self.cycle = cycle
        self.count = len(cycle.duration)
        self.longest = tolerance * float(cycle.duration.max())
        sizes = np.abs(cycle.after)
        self.sizes = tolerance * np.repeat([sizes[:, :half].max(), sizes[:, half:].max()], half)

    def close(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether states are the same."""
        return bool((np.abs(a - b) <= self.sizes).all())

    def shifted(self, by: int, sign: int) -> bool:
        """Whether the orbit is `sign` times itself so many impacts later."""
        cycle = self.cycle
        later = np.concatenate([cycle.duration[by:], cycle.duration[:by]])
        if (np.abs(later - cycle.duration) > self.longest).any():
            return False
        return self.close(np.concatenate([cycle.after[by:], cycle.after[:by]]), sign * cycle.after)

    def length(self) -> int:
        """Impacts in the primitive period."""
        count = self.count
        return next(d for d in range(1, count + 1) if count % d == 0 and (d == count or self.shifted(d, 1)))

    def has_half(self, length: int) -> bool:
        """Whether the primitive orbit has u(t + T/2) = -u(t)."""
        return self.cycle.system.has_odd_symmetry and length % 2 == 0 and self.shifted(length // 2, -1)


def is_solved_as_it_is(problem: MultipointProblem, y: np.ndarray) -> bool:
    """Whether an orbit is run through once, between neighbouring ones of its reversals, and on itself only where it has none."""
    found = symmetries(cycle_of(problem, y))
    both = len({e for _, e in found.reversals}) == 2
    return found.cover == 1 and not (both and problem.quarters == 2) and not (found.reversals and problem.periodic)


def presentations(problem: MultipointProblem, y: np.ndarray) -> list[Presentation]:
    """All presentations of an orbit, or of the primitive one that it repeats, that have its canonical ends and sequence.

    Images under mirror and reversal in time count as the same orbit. There are several where the sequence is its own image.
    """
    cycle, found = _primitive(cycle_of(problem, y))
    if found.reversals:
        return with_canonical_sequence(problem.system, _with_mirrored(problem.system, _between_reversals(cycle, found)))
    sequence, _ = canonical_sequence(cycle.letters, PERIODIC, odd_symmetry=problem.system.has_odd_symmetry)
    return _closed(cycle, sequence)


def with_canonical_sequence(system: ImpactSystem, images: Iterable[Presentation]) -> list[Presentation]:
    """Those of an orbit's presentations that have its canonical ends and sequence."""
    images = list(images)
    sequence, ends = canonical_sequence(images[0].sequence, images[0].ends, odd_symmetry=system.has_odd_symmetry)
    return [image for image in images if image.ends == ends and image.sequence == sequence]


def all_presentations(problem: MultipointProblem, y: np.ndarray) -> list[Presentation]:
    """All presentations of an orbit, or of the primitive one that it repeats: from each instant of reversal to the next, from each impact
    where it has none, forwards and backwards in time, and mirrored where the system has odd symmetry."""
    cycle, found = _primitive(cycle_of(problem, y))
    if found.reversals:
        return _with_mirrored(problem.system, _between_reversals(cycle, found))
    return _closed(cycle)


def closed_presentations(problem: MultipointProblem, y: np.ndarray, sequence: ImpactSequence | None = None) -> list[Presentation]:
    """The orbit closed on itself: from each impact, forwards and backwards, and mirrored where the system has odd symmetry; those with a
    sequence, where one is given."""
    return _closed(cycle_of(problem, y), sequence)


def _with_mirrored(system: ImpactSystem, images: Iterable[Presentation]) -> list[Presentation]:
    images = list(images)
    return images + [image.mirrored() for image in images] if system.has_odd_symmetry else images


def segment_images(problem: MultipointProblem, y: np.ndarray) -> Iterator[Presentation]:
    """The solved segment as it stands, mirrored where the system has odd symmetry, run backwards, and both; of a closed orbit, those from
    all its impacts. All `all_presentations` of an orbit that is primitive and has no more reversals than its ends."""
    if problem.periodic:
        yield from closed_presentations(problem, y)
        return
    own = presentation_of(problem, y)
    for presentation in (own, run_backwards(problem.system, own, problem)):
        yield presentation
        if problem.system.has_odd_symmetry:
            yield presentation.mirrored()


def _primitive(cycle: Cycle) -> tuple[Cycle, Symmetries]:
    """The primitive orbit of an orbit, and its symmetries."""
    found = symmetries(cycle)
    length = len(cycle.duration) // found.cover
    if found.cover > 1:
        before, after, duration, contact = (part[:length] for part in (cycle.before, cycle.after, cycle.duration, cycle.contact))
        cycle = Cycle(cycle.system, before, after, duration, contact, cycle.lead)
    return cycle, found


def _between_reversals(cycle: Cycle, found: Symmetries) -> Iterator[Presentation]:
    """From each instant of reversal to the next, and back."""
    instants = list(found.reversals)
    instants.append((instants[0][0] + cycle.period, instants[0][1]))
    slack = SLACK * cycle.period
    times = cycle.times

    def kind(instant: float, e: int) -> str:
        if e < 0:
            return "origin"
        distance = np.abs((times - instant + 0.5 * cycle.period) % cycle.period - 0.5 * cycle.period)
        return "stop" if np.min(distance) <= slack else "rest"

    for (first, e), (last, f) in itertools.pairwise(instants):
        forward = presentation_between(cycle, first, last, (kind(first, e), kind(last, f)))
        yield forward
        yield run_backwards(cycle.system, forward)


def _closed(cycle: Cycle, sequence: ImpactSequence | None = None) -> list[Presentation]:
    """The orbit from each impact, forwards and backwards in time, and mirrored: those with a sequence, where one is given."""
    wanted = None if sequence is None else {sequence, mirror(sequence)}
    images = []
    for backwards in (False, True):
        letters = cycle.letters[::-1] if backwards else cycle.letters
        for first in range(len(letters)):
            if wanted is None or letters[first:] + letters[:first] in wanted:
                images.append(closed_presentation(cycle, first=first, backwards=backwards))
    images = _with_mirrored(cycle.system, images)
    return images if sequence is None else [image for image in images if image.sequence == sequence]


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
    found = MultipointProblem(problem.system, best.ends, best.sequence)
    return found, solved(found, best.unknowns(found)).y


def first_of(presentations: Sequence[Presentation]) -> Presentation:
    """The canonical one of an orbit's `presentations`."""
    best = presentations[0]
    for other in presentations[1:]:
        if _comes_before(other, best):
            best = other
    return best


def _comes_before(a: Presentation, b: Presentation) -> bool:
    """Order by whether there are more impacts in the first half than in the second, then by flight times, then by start states;
    differences of rounding's size count as none."""
    if a.leans != b.leans:
        return b.leans
    for x, y in ((a.times, b.times), (-a.start, -b.start)):
        apart = np.flatnonzero(np.abs(x - y) > SAME * np.max(np.abs(x)))
        if apart.size:
            return bool(x[apart[0]] < y[apart[0]])
    return False


def same_orbit(
    a: tuple[MultipointProblem, np.ndarray], b: tuple[MultipointProblem, np.ndarray], tolerance: float = SAME
) -> bool:
    """Whether two solutions are one orbit: exchanged ends, mirror image, reversal in time, another start, or multiple covers allowed.

    Parameters
    ----------
    a, b : (problem, y)
    tolerance : float
        Of states and times, relative to the largest.
    """
    return _is_among(presentation_of(*canonical_orbit(*a)), presentations(*b), tolerance)


def same_segment(
    a: tuple[MultipointProblem, np.ndarray], b: tuple[MultipointProblem, np.ndarray], tolerance: float = SAME
) -> bool:
    """`same_orbit` for two orbits that each stand between neighbouring reversals of theirs: one can then only be the other one's mirror
    image, or run from its other end, and no symmetry has to be looked for.

    Parameters
    ----------
    a, b : (problem, y)
        With ends that are not periodic.
    tolerance : float
        Of states and times, relative to the largest.
    """
    forward = presentation_of(*b)
    images = [forward, run_backwards(b[0].system, forward, b[0])]
    if b[0].system.has_odd_symmetry:
        images += [image.mirrored() for image in images]
    return _is_among(presentation_of(*a), images, tolerance)


def _is_among(presentation: Presentation, images: Iterable[Presentation], tolerance: float) -> bool:
    """Whether a presentation is one of several."""
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
    if not _may_repeat(problem.ends, problem.sequence):
        return 1
    shifts = _Shifts(cycle_of(problem, solution.y))
    length = shifts.length()
    return 2 if length == shifts.count and problem.quarters == 2 and shifts.has_half(length) else shifts.count // length


@lru_cache(maxsize=4096)
def _may_repeat(ends: Ends, sequence: ImpactSequence) -> bool:
    """Whether the impacts of a period, by their contacts alone, are those of a shorter one run through again, or of its mirror image."""
    letters = full_sequence(sequence, ends)
    count = len(letters)
    if any(count % d == 0 and letters[d:] + letters[:d] == letters for d in range(1, count)):
        return True
    # Of a quarter the second half period is the image of the first in any case: its problem solves such an orbit once.
    half = count // 2
    return segments_per_period(ends) == 2 and count % 2 == 0 and letters[half:] + letters[:half] == mirror(letters)


class Mark(NamedTuple):
    """An orbit of a family that identifies it: what kind of point it is, and numbers that no presentation changes.

    kind: "GR", "SN" or "EP". h: energy. alpha: quarter period. pattern: of the impacts in the period, see `mark_of`.
    """

    kind: str
    h: float
    alpha: float
    pattern: float


def mark_of(kind: str, problem: MultipointProblem, y: np.ndarray) -> Mark:
    """The mark of an orbit.

    Notes
    -----
    At the grazing of a linear mode many families begin with one energy and one period, also with one sequence: their impacts come at
    different instants. The pattern, a mean over all pairs of impacts of a function of their distance in time (and of whether the
    same side is hit), does not change under a shift, reversal or mirror, and is continuous.
    """
    cycle = cycle_of(problem, y)
    pattern = pattern_of(problem.system, cycle.times / cycle.period, cycle.contact)
    return Mark(kind, problem.energy(y), problem.quarter_period(y), pattern)


def pattern_of(system: ImpactSystem, parts: np.ndarray, contact: np.ndarray) -> float:
    """A number for the instants of an orbit's impacts that no shift, reversal or mirror changes.

    Parameters
    ----------
    system : ImpactSystem
    parts : (m,) float
        The instants as parts of the period.
    contact : (m,) int
        Contacts hit (rows of the contact arrays of `Modes`).
    """
    phase = 2.0 * np.pi * parts
    stop, side = system.modes.contact_stop[contact], system.modes.contact_side[contact]
    same_side = np.where(stop[:, None] == stop, 2.0 + side[:, None] * side, 1.0)
    return float(np.mean(same_side * np.exp(np.cos(phase[:, None] - phase))))


def digests(marks: Iterable[Mark]) -> tuple[str, ...]:
    """Hashes that name a family with these marks, the proper one first.

    The numbers of the first mark are rounded to six digits and hashed. Rounding has borders, wherever one puts them: a number within
    1e-9 of one has both roundings, and each of the hashes that come of that, and those of further marks, names the family too.
    """
    out: dict[str, None] = {}
    for mark in marks:
        numbers = mark[1:]
        texts = [dict.fromkeys(_rounded(number * (1.0 + shift)) for shift in (0.0, -BORDER, BORDER)) for number in numbers]
        for parts in itertools.product(*texts):
            text = ":".join((mark.kind, *parts))
            out[hashlib.sha256(text.encode()).hexdigest()[:8]] = None
    return tuple(out)


def _rounded(number: float) -> str:
    return f"{number:.{DIGITS - 1}e}"
