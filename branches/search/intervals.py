"""The complete scan of a curve of starts: all crossings of a far end, and the undecided intervals.

An interval of starts can be as narrow as rounding and still be undecided at one of its flights. The flights before that one are decided,
so the states after their impacts are a short smooth curve. `resumed` returns this curve, which is scanned in place of the interval. Its
states have the rounding errors of every followed state. Along the curve such an error only exchanges starts. Across the curve it shrinks
as fast as motions part. So an orbit through the true curve has a neighbour through this one. Newton's method goes from one to the other,
because it solves for all states at once.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from saltus_core import Curve, FlightRecord, IntervalScan, StartMap, Starts, Verdict

from branches.search.starts import INSET, KINDS, Path, ScannedSegment, StartCurve
from branches.sequences import impacts_per_period, mirror, segments_per_period, unfolded_sequence
from bvp.interrupts import Pace
from bvp.system import ImpactSystem

__all__ = ["EndCrossing", "Limits", "Opening", "first_crossings", "follow_start", "resumed", "scan", "segment_limits", "segments"]

PIECES, PIECES_RESUMED = 32, 2
"""Intervals that each curve is cut into at first; and one that is resumed."""

Limits = Mapping[str, tuple[float, int | None]]
"""For each kind of far end that is searched: longest time and most inner impacts of a segment; None: not bounded."""


def segment_limits(first: str, far: str, quarter_period: float, impacts: int | None) -> tuple[float, int | None]:
    """Longest time and largest number of inner impacts of a segment between two kinds of end; (-1, -1) if there is no such segment."""
    # A segment with the origin at one end only is a quarter of a period; every other segment is half a period.
    quarter = (first == "origin") != (far == "origin")
    time = quarter_period * (1.0 if quarter else 2.0) * (1.0 + 1e-12)
    if impacts is None:
        return time, None
    ends = ("stop+" if first == "stop" else first, "stop+" if far == "stop" else far)
    inner = (2 * impacts - impacts_per_period((), ends)) // segments_per_period(ends)
    return (time, inner) if inner >= 0 else (-1.0, -1)


class EndCrossing(NamedTuple):
    """A start of a curve whose motion crosses a far end.

    kind: "origin", "rest" or "stop". impacts: inside the segment. parameter: of the start. flight: time in the last flight. residual: of
    the end's condition. converged: whether Newton's method converged; if not, the crossing lies between `low` and `high` if it exists.
    """

    kind: str
    impacts: int
    parameter: float
    flight: float
    residual: float
    converged: bool
    low: float
    high: float


class Opening(NamedTuple):
    """An interval of starts that is not decided: lower bound, width, the flight (impacts before it), the reason."""

    parameter: float
    width: float
    flight: int
    reason: Verdict


def segments(
    system: ImpactSystem, curves: list[StartCurve], limits: Limits, budget: int, counts: Counter[str], openings: list[Opening]
) -> Iterator[tuple[ScannedSegment, bool]]:
    """All segments from the starts of some curves to the far ends.

    The search stops when it has followed `budget` starts, including those in `counts`. It adds its numbers to `counts`, and to `openings`
    the intervals that it could not decide.

    Yields
    ------
    segment : ScannedSegment
        In a system with odd symmetry, the segment or its mirror image.
    is_complete : bool
        Whether following the start finds all impacts of the segment.
    """
    longest = max(time for time, _ in limits.values())
    letters = system.modes.contact_letters
    left = deque(curves)
    while left:
        curve = left.popleft()
        crossings, opened, of_scan = scan(curve, limits, max(1, budget - counts["starts"]))
        counts.update(of_scan)
        for opening in opened:
            # An undecided interval is scanned again as a curve of states after its last common impact, where the states lie further apart.
            image = resumed(curve, opening, longest) if counts["starts"] < budget else None
            if image is not None:
                left.append(image)
                counts["resumed"] += 1
                counts["at_grazing" if opening.reason == Verdict.GRAZED else "open"] -= 1
            elif opening.reason != Verdict.GRAZED:
                openings.append(opening._replace(parameter=curve.original(opening.parameter), width=curve.piece[1] * opening.width))
        counts["crossings"] += len(crossings)
        paths = [follow_start(curve, crossing.parameter, crossing.impacts, longest) for crossing in crossings]
        hits = [tuple([letters[c] for c in path.contacts.tolist()]) for path in paths]
        instants = [path.until_last + crossing.flight for path, crossing in zip(paths, crossings, strict=True)]
        sequences = [hit[: crossing.impacts + (crossing.kind == "stop")] for hit, crossing in zip(hits, crossings, strict=True)]
        first, repeated = first_crossings(crossings, instants, sequences, curve.end, curve.high - curve.low)
        counts["repeated"] += len(repeated)
        yield from (_segment(system, curve, crossings[i], paths[i], hits[i]) for i in first)


def _segment(
    system: ImpactSystem, curve: StartCurve, crossing: EndCrossing, path: Path, hit: tuple[str, ...]
) -> tuple[ScannedSegment, bool]:
    """A crossing with the path of its start, and the contacts hit on it, as a segment; and whether the path has all its impacts."""
    sequence = hit[: crossing.impacts]
    is_complete = len(path.nodes) >= crossing.impacts
    far = crossing.kind
    if far == "stop":
        is_complete = is_complete and len(hit) > crossing.impacts
        far += hit[crossing.impacts] if len(hit) > crossing.impacts else "+"
    ends, sign = (curve.end, far), 1.0
    if curve.has_mirror and system.has_odd_symmetry and (mirror(ends), mirror(sequence)) < (ends, sequence):
        (first, last), sequence, sign = mirror(ends), mirror(sequence), -1.0
        ends = first, last
    times = np.concatenate([path.durations, (crossing.flight,)])
    place, low, high = (curve.original(parameter) for parameter in (crossing.parameter, crossing.low, crossing.high))
    return ScannedSegment(ends, sequence, sign * path.start, sign * path.nodes, times, place, low, high, crossing.residual), is_complete


def scan(curve: StartCurve, limits: Limits, budget: int) -> tuple[list[EndCrossing], list[Opening], dict[str, int]]:
    """Crossings and openings of one curve, and counts of starts, intervals and grazings.

    At most `budget` starts are followed. The intervals left then stay open.
    """
    gone, since = lead(curve)
    most = max((curve.most_impacts if impacts is None else impacts for _, impacts in limits.values()), default=0) - gone
    times, impacts = [-1.0] * 4, [0, 0, 0, -1]
    for end, (time, count) in limits.items():
        # Without a bound there is always one impact more to follow, so that a start with too many of them is left open, not dropped.
        left_of_them = (curve.most_impacts + 1 if count is None else count) - gone
        times[int(KINDS[end])] = time - since if left_of_them >= 0 else -1.0
        impacts[int(KINDS[end])] = left_of_them
    found = decide_intervals(curve, times, impacts, math.inf, most, budget, fold=False)
    names = {number: name for name, number in KINDS.items()}
    crossings = [
        EndCrossing(names[x.kind], gone + x.impacts, x.theta, x.flight, x.residual, x.converged, x.low, x.high) for x in found.crossings
    ]
    return crossings, openings_of(found, gone), found.counts


def openings_of(scan: IntervalScan, gone: int) -> list[Opening]:
    """The intervals that a scan leaves open, with the impacts before its starts."""
    return [Opening(opening.theta, opening.width, gone + opening.flight, opening.reason) for opening in scan.openings]


def decide_intervals(
    curve: StartCurve, times: list[float], impacts: list[int], latest: float, most: int, budget: int, *, fold: bool
) -> IntervalScan:
    """The scan of all intervals of a curve.

    times, impacts: for each `FarEnd` the longest time (negative where it is not looked for) and the most inner impacts. latest: time up to
    which flights begin. fold: whether a mirror image stands for states at the lower stop."""
    scan = IntervalScan(curve.starts, times, impacts, fold, max(times), latest, most)
    pace = Pace()
    pieces = PIECES if curve.before is None else PIECES_RESUMED
    edges = np.linspace(curve.low, curve.high, pieces + 1)
    for i, (low, high) in enumerate(pairwise(edges.tolist())):
        root_low, root_high = curve.singular[0] and i == 0, curve.singular[1] and i == pieces - 1
        place = StartMap(low, high, root_low, root_high)
        low += INSET if root_low else 0.0
        high -= INSET if root_high else 0.0
        scan.begin(low, high, place, max(1, budget - scan.counts["starts"]))
        done = False
        while not done:
            with pace:
                done = scan.go(pace.passes)
    return scan


def lead(curve: StartCurve) -> tuple[int, float]:
    """Impacts and time before the starts of a curve, which may be the image of a piece of another."""
    return (0, 0.0) if curve.before is None else (len(curve.before.contacts), float(curve.before.instants[-1]))


def follow_start(curve: StartCurve, parameter: float, impacts: int, longest: float) -> Path:
    """One start of a curve, followed through so many impacts, or fewer where the time ends before.

    Of a curve with motion `before` it, that is part of the path and of its impacts and its time."""
    before, (gone, since) = curve.before, lead(curve)
    impacts -= gone
    flights = curve.starts.follow(parameter, longest - since, math.inf, impacts)
    hit = [flight.contact for flight in flights if flight.contact >= 0]
    inner = min(len(hit), impacts, len(flights) - 1)
    start, contacts = flights[0].state, np.array(hit, dtype=np.int64)
    nodes = np.array([flight.state for flight in flights[1 : inner + 1]]).reshape(inner, 4)
    durations = np.array([flight.duration for flight in flights[:inner]])
    instants = np.array([flight.time for flight in flights[1 : inner + 1]])
    if before is None:
        return Path(start, contacts, nodes, durations, instants)
    return Path(
        before.start,
        np.append(before.contacts, contacts),
        np.vstack([before.nodes[:-1], start[None], nodes]),
        np.append(before.durations, durations),
        np.append(before.instants, before.instants[-1] + instants),
    )


NARROW = 1e-12
"""Intervals wider than this, as a part of the curve or of 1, are open for another reason than rounding."""

OVERLAP = 5e-15
"""How far the image goes on beyond the interval on either side, in the parameter of either: that much rounding can move it."""

STRETCHED = 10.0
"""Images that are not this much longer than their interval, as a part of their states, are as narrow as it."""


def resumed(curve: StartCurve, opening: Opening, longest: float) -> StartCurve | None:
    """The states after the last decided impact of an open interval of a curve, as a curve of starts; `longest`: time from the first start.

    It is None where the interval is open for another reason than rounding, so that its image would be so as well.
    """
    gone, since = lead(curve)
    flight = opening.flight - gone
    if flight < 1 or opening.reason == Verdict.ENDLESS or opening.width > NARROW * max(1.0, abs(opening.parameter)):
        return None
    half = 0.5 * opening.width
    middle = opening.parameter + half
    samples: list[list[FlightRecord]] = []
    for parameter in (opening.parameter, middle, opening.parameter + opening.width):
        samples.append(curve.starts.follow(parameter, longest - since, math.inf, flight))
        if len(samples[-1]) <= flight:
            return None
    hits = [[record.contact for record in sample[:flight]] for sample in samples]
    if hits[0] != hits[1] or hits[2] != hits[1]:
        return None
    low, here, high = (sample[flight] for sample in samples)
    state, rate = here.state, here.derivative
    bend = (high.derivative - low.derivative) / opening.width
    # By this parameter the state moves as fast as it is large, as the kernels expect of starts: their rounding is the parameter's.
    scale = float(np.max(np.abs(state)) / np.max(np.abs(rate)))
    if STRETCHED * scale > 1.0:
        return None
    reach = (half + OVERLAP * max(1.0, abs(middle))) / scale + OVERLAP
    coefficients = [state.tolist(), (scale * rate).tolist(), (0.5 * scale * scale * bend).tolist()]
    starts = Starts(curve.starts.system, coefficients, Curve.QUADRATIC, hits[1][-1])
    path = follow_start(curve, middle, opening.flight, longest)
    if not path.instants[-1] < longest:
        return None
    before = path._replace(contacts=path.contacts[: opening.flight])
    piece = (curve.original(middle), curve.piece[1] * scale)
    return replace(curve, starts=starts, low=-reach, high=reach, singular=(False, False), before=before, piece=piece)


SAME_START = 1e-11
"""Largest difference of two starts that are one start, relative to the length of the curve. A later crossing of one start repeats the
first one."""


def first_crossings(
    crossings: list[EndCrossing], instants: list[float], sequences: list[tuple[str, ...]], start: str, span: float
) -> tuple[list[int], list[int]]:
    """Indices of the crossings of a curve that are the first of their start, and of those that repeat it in a k-fold cover of its segment.

    `instants`: time from the start to each. `sequences`: impacts from the start to each, that at a far stop included. `start`: the end that
    the curve is of. `span`: its length.
    """
    first: list[int] = []
    repeated: list[int] = []
    groups: list[list[int]] = []
    for i in sorted(range(len(crossings)), key=lambda i: crossings[i].parameter):
        near = groups and crossings[i].parameter - crossings[groups[-1][-1]].parameter <= SAME_START * span
        if near and crossings[i].converged and crossings[groups[-1][-1]].converged:
            groups[-1].append(i)
        else:
            groups.append([i])
    for group in groups:
        group.sort(key=lambda i: instants[i])
        kept: list[int] = []
        for i in group:
            if any(_repeats(instants[i], sequences[i], crossings[j].kind, instants[j], sequences[j], start) for j in kept):
                repeated.append(i)
            else:
                kept.append(i)
        first += kept
    return sorted(first), repeated


def _repeats(instant: float, sequence: tuple[str, ...], far: str, period: float, first: tuple[str, ...], start: str) -> bool:
    """Whether a crossing is the first one again, after several segments between the start and that far end.

    The sequences are compared, too: if motions part fast, other orbits have the same start and time within rounding."""
    count = round(instant / period)
    if count < 2 or abs(instant - count * period) > 1e-6 * period:
        return False
    inner, end = (first[:-1], far + first[-1]) if far == "stop" else (first, far)
    expected = unfolded_sequence(inner, (start, end), count)[0]
    return sequence[: len(expected)] == expected and len(sequence) - len(expected) in (0, 1)
