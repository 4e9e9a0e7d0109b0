"""Orbits between two ends by their middles: half of each is followed from either end, and both halves meet at an impact.

Every orbit with an impact inside its segment, or at an end of it, has a last impact before the middle of the segment's time. There the
image of the starts at one end meets the mirror image of the starts at the other one. Motions part as they go on,
so half the time takes far fewer starts. Seen from the other end, the same orbit has another last impact before the middle. So each orbit is
met twice, which checks the search, unless no impact is between the middle and one of the ends.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from saltus_core import Arcs, MeetingSearch, Verdict, stop_arcs

from branches.search.intervals import SAME_START, EndCrossing, decide_intervals, first_crossings, lead, openings_of, resumed, segment_limits
from branches.search.known import Boxes, are_known
from branches.search.starts import ScannedSegment, StartCurve, curves
from branches.sequences import Ends, ImpactSequence, mirror
from bvp.system import ImpactSystem

__all__ = ["met_segments", "nothing_new"]

KINDS = ("origin", "rest", "stop")

PART = 0.51
"""Part of the longest time up to which flights begin that are followed."""

STOP_ARCS = 16
"""Arcs of the starts at a stop."""

BUDGET = 100_000
"""Starts that one search follows at most. A search that needs more is left to the complete scan."""

MOST = 20_000
"""Meetings of one search."""

TIED = 1e-9
"""Difference of times, and of starts as a part of their curve, that rounding may have made."""

TURNED = 1e-6
"""Difference of the flight times of one orbit from both its ends, if these are one start."""

Limits = dict[tuple[str, str], tuple[float, int]]
"""Longest time and most inner impacts of a segment between two kinds of end; (-1, -2) where none is looked for."""


def nothing_new(
    system: ImpactSystem, energy: float, wanted: Sequence[str], quarter_period: float, impacts: int, known: Boxes
) -> Counter[str] | None:
    """The counts of a search by meetings, if it shows that all orbits at an energy, within bounds, are those of known families; else None.

    Every known family must have its orbit among those that are met. wanted, counts: as of `met_segments`."""
    segments, counts = met_segments(system, energy, wanted, quarter_period, impacts)
    if segments is None:
        return None
    limits = _limits(wanted, quarter_period, impacts)
    return counts if are_known(segments, known, limits.__getitem__, odd_symmetry=system.has_odd_symmetry) else None


def met_segments(
    system: ImpactSystem, energy: float, wanted: Sequence[str], quarter_period: float, impacts: int
) -> tuple[list[ScannedSegment] | None, Counter[str]]:
    """All segments with impacts between pairs of ends at an energy, within bounds, without k-fold covers.

    wanted: the pairs, among them those of the more symmetric orbits (`branches.search.orbit_search.CLASSES`).

    Returns
    -------
    segments : list of ScannedSegment or None
        Without start and nodes. A segment between two ends of one kind is there from both. None if anything is not decided.
    counts : Counter
        Of the intervals, and of the pairs of arcs.
    """
    counts: Counter[str] = Counter()
    limits = _limits(wanted, quarter_period, impacts)
    try:
        roots = [curve for kind in KINDS for curve in curves(system, kind, energy)]
    except ValueError:  # the starts at rest or at a stop are not bounded
        return None, counts
    left = deque(enumerate(roots))
    images: list[_Image] = []
    arcs: list[Arcs] = []
    while left:
        root, curve = left.popleft()
        number = len(images)
        images.append(_Image(root, curve, *lead(curve)))
        from_here = [limit for (kind, _), limit in limits.items() if kind == _kind(curve)]
        longest, most = max(time for time, _ in from_here), max(inner for _, inner in from_here)
        gone, since = images[-1].gone, images[-1].since
        if longest < 0.0:
            continue
        if curve.before is None and _kind(curve) == "stop":
            edges = np.linspace(curve.low, curve.high, STOP_ARCS + 1).tolist()
            arcs.append(stop_arcs(curve.starts, edges, system.has_odd_symmetry, number))
        # Of a segment to a stop, that impact can be the one more where the halves meet.
        beyond = most + 1 - gone
        if beyond < 1 or since > PART * longest:
            continue
        scan = decide_intervals(
            curve, [-1.0, -1.0, -1.0, longest - since], [0, 0, 0, beyond - 1], PART * longest - since, beyond,
            max(1, BUDGET - counts["starts"]), fold=system.has_odd_symmetry,
        )  # fmt: skip
        counts.update(scan.counts)
        if counts["budget"]:
            return None, counts
        arcs.append(scan.take_arcs(number, gone, since))
        for opening in openings_of(scan, gone):
            image = resumed(curve, opening, longest)
            if image is not None:
                left.append((root, image))
                counts["resumed"] += 1
                counts["at_grazing" if opening.reason == Verdict.GRAZED else "open"] -= 1
            elif opening.reason != Verdict.GRAZED:
                return None, counts
    if not arcs:
        return [], counts
    found = _meet(images, arcs, limits, system.has_odd_symmetry, counts)
    halves = None if found is None else _paired(images, len(roots), found, limits)
    return None if halves is None else _segments(system, roots, halves), counts


def _kind(curve: StartCurve) -> str:
    return curve.end.rstrip("+-")


class _Image(NamedTuple):
    """A curve that was scanned: number of the curve of starts that it is an image of, or is; impacts and time before it."""

    root: int
    curve: StartCurve
    gone: int
    since: float


def _limits(wanted: Sequence[str], quarter_period: float, impacts: int) -> Limits:
    limits: Limits = {}
    for i, j in product(range(3), repeat=2):
        first, last = KINDS[min(i, j)], KINDS[max(i, j)]
        time, inner = segment_limits(first, last, quarter_period, impacts) if f"{first}-{last}" in wanted else (-1.0, None)
        limits[KINDS[i], KINDS[j]] = (time, inner) if inner is not None and inner >= 0 else (-1.0, -2)
    return limits


class _Found(NamedTuple):
    """M meetings, from both curves: parameters, impacts and numbers of the curves (M, 2); flight times and contacts of the impacts from the
    first curve to the meeting, and then of those from the second, as far as they are not gone before the starts (M, K)."""

    start: np.ndarray
    impacts: np.ndarray
    curve: np.ndarray
    durations: np.ndarray
    contacts: np.ndarray


def _meet(images: list[_Image], arcs: list[Arcs], limits: Limits, fold: bool, counts: Counter[str]) -> _Found | None:
    """The meetings of arcs; None if a pair is undecided."""
    kinds = [_kind(image.curve) for image in images]
    times, inner = (np.array([[limits[a, b][i] for b in kinds] for a in kinds]) for i in (0, 1))
    gone = [image.gone for image in images]
    search = MeetingSearch([image.curve.starts for image in images], gone, times, inner, fold, MOST)
    search.run(arcs)
    counts.update(search.counts)
    if counts["undecided"]:
        return None
    start, impacts, curve, durations, contacts = search.meetings()
    return _Found(start, impacts.astype(int), curve.astype(int), durations, contacts.astype(int))


class _Half(NamedTuple):
    """A motion from a start to the meeting: number of the curve of starts, the parameter on it, flight times and contacts."""

    root: int
    start: float
    times: list[float]
    contacts: list[int]


Met = tuple[_Half, _Half]
"""The halves of a segment."""


def _paired(images: list[_Image], count: int, found: _Found, limits: Limits) -> list[Met] | None:
    """The halves of each orbit, once, from the two meetings that it has; None if one is missing. count: of the curves of starts.

    An orbit whose ends are one has a reversal between them. It is twice a segment that is met by itself, and is left out."""
    gone, since, root = (np.array([image[i] for image in images]) for i in (2, 3, 0))
    place, scale = np.array([image.curve.piece for image in images]).T
    span = np.array([image.curve.high - image.curve.low for image in images[:count]])
    curve, impacts, size = found.curve, found.impacts.copy(), len(found.start)
    start = place[curve] + scale[curve] * found.start
    # Times from either end to the meeting, and to the last impact before it.
    until = np.cumsum(np.concatenate([np.zeros((size, 1)), found.durations], axis=1), axis=1)
    rows = np.arange(size)
    first, last = impacts[:, 0] - gone[curve[:, 0]], impacts.sum(axis=1) - gone[curve].sum(axis=1)
    time = since[curve] + np.stack([until[rows, first], until[rows, last] - until[rows, first]], axis=1)
    total, before = time.sum(axis=1), time[:, 1] - found.durations[rows, last - 1]
    kinds = [_kind(image.curve) for image in images]
    longest = np.array([[limits[a, b][0] for b in kinds] for a in kinds])[curve[:, 0], curve[:, 1]]
    in_middle = (time[:, 0] <= time[:, 1] + TIED) & (2.0 * before <= total + TIED) & (total <= longest)
    # No impact is between the middle and the second end, so that nothing is met from there.
    alone = (impacts[:, 1] == 1) & (np.array([kind != "stop" for kind in kinds])[curve[:, 1]])
    ends = root[curve]
    turned = (ends[:, 0] > ends[:, 1]) | ((ends[:, 0] == ends[:, 1]) & (start[:, 0] > start[:, 1]))
    for array in (ends, start, impacts):
        array[turned] = array[turned, ::-1]
    is_one = (ends[:, 0] == ends[:, 1]) & (np.abs(start[:, 0] - start[:, 1]) <= TIED * span[ends[:, 0]])
    for row in np.flatnonzero(in_middle & is_one).tolist():
        if not _is_turned(*_halves(images, found, row)):
            return None
    rows = np.flatnonzero(in_middle & ~is_one)
    rows = rows[np.lexsort((start[rows, 0] + math.sqrt(0.5) * start[rows, 1], impacts[rows].sum(axis=1), ends[rows, 1], ends[rows, 0]))]
    here, there = rows[1:], rows[:-1]
    near = (np.abs(total[here] - total[there]) <= TIED) & (impacts[here].sum(axis=1) == impacts[there].sum(axis=1))
    near &= np.all((ends[here] == ends[there]) & (np.abs(start[here] - start[there]) <= TIED * span[ends[here]]), axis=1)
    begin = np.flatnonzero(np.append(True, ~near)) if len(rows) else rows
    sizes = np.diff(np.append(begin, len(rows)))
    twice = begin[sizes == 2]
    if np.any(sizes != np.where(alone[rows[begin]], 1, 2)) or np.any(impacts[rows[twice], 0] == impacts[rows[twice + 1], 0]):
        return None
    return [_halves(images, found, row) for row in rows[begin].tolist()]


def _halves(images: list[_Image], found: _Found, row: int) -> Met:
    """The halves of a meeting."""
    halves, place = [], 0
    for side in (0, 1):
        root, curve, gone, _ = images[found.curve[row, side]]
        flights = slice(place, place + int(found.impacts[row, side]) - gone)
        place = flights.stop
        times, contacts = found.durations[row, flights].tolist(), found.contacts[row, flights].tolist()
        if curve.before is not None:
            times, contacts = curve.before.durations.tolist() + times, curve.before.contacts.tolist() + contacts
        halves.append(_Half(root, curve.original(float(found.start[row, side])), times, contacts))
    return halves[0], halves[1]


def _is_turned(one: _Half, two: _Half) -> bool:
    """Whether two halves from one start are one motion, as far as both go."""
    common = slice(min(len(one.times), len(two.times)))
    apart = max((abs(a - b) for a, b in zip(one.times, two.times, strict=False)), default=0.0)
    return one.contacts[common] == two.contacts[common] and apart <= TURNED


class _View(NamedTuple):
    """A segment seen from one of its ends: the ends, the stops hit with that at the far end, flight times."""

    ends: Ends
    hits: ImpactSequence
    times: list[float]

    @property
    def sequence(self) -> ImpactSequence:
        return self.hits[:-1] if self.ends[1].startswith("stop") else self.hits


def _view(letters: Sequence[str], roots: list[StartCurve], one: _Half, two: _Half) -> _View:
    """The segment of two halves, seen from the start of the first. The second one may be mirrored."""
    first, far = roots[one.root].end, roots[two.root].end
    hits, back = tuple(letters[contact] for contact in one.contacts), tuple(letters[contact] for contact in two.contacts)
    if (hits or (first[4:],))[-1] != (back or (far[4:],))[-1]:
        back, far = mirror(back), mirror((far,))[0]
    # The impact where the halves meet is in both, or at an end.
    hits = hits + back[-2::-1] if back else hits[:-1]
    return _View((first, far), hits + (far[4:],) if far.startswith("stop") else hits, one.times + two.times[::-1])


def _segments(system: ImpactSystem, roots: list[StartCurve], orbits: list[Met]) -> list[ScannedSegment]:
    """The segments of orbits, from their first end, or from both if these are of one kind; without k-fold covers."""
    letters = system.modes.contact_letters
    covers: set[int] = set()
    for number, curve in enumerate(roots):
        # The segments from this curve, by their starts. Where starts are one, all but one segment may be covers.
        seen = sorted((half.start, i, half is met[1]) for i, met in enumerate(orbits) for half in met if half.root == number)
        close = [b[0] - a[0] <= SAME_START * (curve.high - curve.low) for a, b in pairwise(seen)]
        seen = [place for place, *near in zip(seen, [False, *close], [*close, False], strict=False) if any(near)]
        views = [_view(letters, roots, *(orbits[i][::-1] if turned else orbits[i])) for _, i, turned in seen]
        crossings = [
            EndCrossing(view.ends[1].rstrip("+-"), len(view.sequence), start, view.times[-1], 0.0, True, start, start)
            for view, (start, *_) in zip(views, seen, strict=True)
        ]
        times, hits = [sum(view.times) for view in views], [view.hits for view in views]
        covers |= {seen[i][1] for i in first_crossings(crossings, times, hits, curve.end, curve.high - curve.low)[1]}
    out = []
    for i, (one, two) in enumerate(orbits):
        if i not in covers:
            order = KINDS.index(_kind(roots[one.root])) - KINDS.index(_kind(roots[two.root]))
            if order <= 0:
                out.append(_segment(system, _view(letters, roots, one, two), one.start))
            if order >= 0:
                out.append(_segment(system, _view(letters, roots, two, one), two.start))
    return out


_NONE = np.zeros(0)


def _segment(system: ImpactSystem, view: _View, start: float) -> ScannedSegment:
    ends, sequence = view.ends, view.sequence
    if system.has_odd_symmetry and (mirror(ends), mirror(sequence)) < (ends, sequence):
        ends, sequence = (mirror(ends)[0], mirror(ends)[1]), mirror(sequence)
    return ScannedSegment(ends, sequence, _NONE, _NONE, np.array(view.times), start, start, start, 0.0)
