"""Recognition of scanned segments that are orbits of known families, before they are solved.

A known family has an orbit at an energy between the energies of two neighbouring points of it. The flight times of that orbit are in a box
around those of the two points. A complete scan finds the orbit. So if only one orbit of the scan is in the box, it is the family's.
Where two orbits could be confused, nothing is recognised, and the segments are solved.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from branches.sequences import Ends, ImpactSequence, canonical_sequence, mirror

if TYPE_CHECKING:
    from branches.search.starts import ScannedSegment

__all__ = ["Boxes", "Kind", "are_known", "boxes_between", "recognised"]

Kind = tuple[Ends, ImpactSequence]
"""Canonical ends and sequence."""

Boxes = Mapping[Kind, np.ndarray]
"""For each kind of orbit the boxes (m, 2, k + 1) of flight times that contain an orbit of a known family: lowest and highest times."""

Limit = Callable[[tuple[str, str]], tuple[float, int]]

_OWN, _OTHERS, _ROUNDING = 0.5, 0.1, 1e-6
"""Margin of a box around the flight times of two points: parts of the difference of that time, of the largest difference, and of the
longest time. Steps turn by a twentieth, so that the family leaves its chord by a hundredth of its length."""

_SAME = 1e-6
"""Largest difference of the flight times of one orbit from its two ends, relative to the longest."""


def boxes_between(times: Mapping[Kind, Sequence[np.ndarray]]) -> Boxes:
    """The boxes of the flight times of families between those of two neighbouring points, for each kind a list of `times` (2, k + 1)."""
    pairs = [pair for some in times.values() for pair in some]
    if not pairs:
        return {}
    # All at once, one beside the other: a search has few families of each kind, and many kinds.
    widths = [pair.shape[1] for pair in pairs]
    first = np.cumsum([0, *widths[:-1]])
    every = np.concatenate(pairs, axis=1)
    low, high = every.min(axis=0), every.max(axis=0)
    apart = high - low
    largest, longest = np.maximum.reduceat(apart, first), np.maximum.reduceat(high, first)
    margin = _OWN * apart + np.repeat(_OTHERS * largest + _ROUNDING * longest, widths)
    boxes, begin = np.stack([low - margin, high + margin]), 0
    found = {}
    for kind, some in times.items():
        end = begin + len(some) * some[0].shape[1]
        found[kind] = boxes[:, begin:end].reshape(2, len(some), -1).swapaxes(0, 1)
        begin = end
    return found


def recognised(segments: Sequence[ScannedSegment], known: Boxes, *, odd_symmetry: bool) -> set[int]:
    """Indices of the segments of one complete scan that are orbits of known families.

    An orbit with two ends of one kind is found from both. It is recognised if both segments are there and agree.
    """
    return _matched(segments, known, odd_symmetry)[0]


def are_known(segments: Sequence[ScannedSegment], known: Boxes, limit: Limit, *, odd_symmetry: bool) -> bool:
    """Whether segments are the orbits of known families and no others: each is recognised, and each family has its orbit among them.

    limit: of two kinds of end, the longest time and the most inner impacts of the segments. A family may have its orbit beyond it."""
    found, met = _matched(segments, known, odd_symmetry)
    if len(found) < len(segments):
        return False
    for (ends, sequence), boxes in known.items():
        longest, most = limit((ends[0].rstrip("+-"), ends[1].rstrip("+-")))
        has_segment = met.get((ends, sequence), np.zeros(len(boxes), dtype=bool))
        if len(sequence) <= most and np.any(~has_segment & (boxes[:, 1].sum(axis=1) <= longest)):
            return False
    return True


def _matched(segments: Sequence[ScannedSegment], known: Boxes, odd_symmetry: bool) -> tuple[set[int], dict[Kind, np.ndarray]]:
    """Indices of the segments that are recognised; and for each kind that segments have, whether each box has a segment."""
    groups: dict[Kind, list[tuple[int, bool, np.ndarray]]] = {}
    for index, segment in enumerate(segments):
        kind, forwards, backwards = _directions(segment.ends, segment.sequence, odd_symmetry)
        if kind in known:
            group = groups.setdefault(kind, [])
            if forwards:
                group.append((index, False, segment.flight_times))
            if backwards:
                group.append((index, True, segment.flight_times[::-1]))
    found: set[int] = set()
    has_segment: dict[Kind, np.ndarray] = {}
    for kind, group in groups.items():
        boxes, times = known[kind], np.array([times for *_, times in group])
        inside = np.logical_and.reduce((boxes[:, :1] <= times) & (times <= boxes[:, 1:]), axis=2)
        has_segment[kind] = np.logical_or.reduce(inside, axis=1)
        first, last = (end.rstrip("+-") for end in kind[0])
        in_box = [[row for row, is_inside in zip(group, rows, strict=True) if is_inside] for rows in inside.tolist()]
        met = [{index for index, *_ in rows} for rows in in_box]
        for here, rows in zip(met, in_box, strict=True):
            # A family that passes an orbit of more symmetry has each orbit twice, as two images: two boxes hold the same one.
            if len(here) == 1 + (first == last) and all(there == here or here.isdisjoint(there) for there in met):
                if first != last or _is_one_orbit(rows):
                    found |= here
    return found, has_segment


def _is_one_orbit(rows: Sequence[tuple[int, bool, np.ndarray]]) -> bool:
    """Whether two segments are one orbit from its two ends: run through in the same direction, they have the same flight times."""
    return any(
        index != other and not backwards and turned and np.abs(a - b).max() <= _SAME * a.max()
        for index, backwards, a in rows
        for other, turned, b in rows
    )


@lru_cache(maxsize=16384)
def _directions(ends: Ends, sequence: ImpactSequence, odd_symmetry: bool) -> tuple[Kind, bool, bool]:
    """The canonical ends and sequence of a segment, and whether it has them forwards, and backwards; or its mirror image does."""
    first, canonical = canonical_sequence(sequence, ends, odd_symmetry=odd_symmetry)[::-1]
    images = [(ends, sequence), ((ends[1], ends[0]), sequence[::-1])]
    ways = [image == (first, canonical) or (odd_symmetry and tuple(map(mirror, image)) == (first, canonical)) for image in images]
    return (first, canonical), ways[0], ways[1]
