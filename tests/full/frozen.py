"""The frozen record of the shipped catalogue, one line a family, and what differs from it.

    python -m tests.full.frozen FILE            write the record of a catalogue to standard output
    python -m tests.full.frozen FILE OTHER      list what two catalogues differ in, event by event

A line has the id, the label, the number of points, the number of events of each type, and the sums of log h and of log alpha over the
events; the changes of label (LB) have sums of their own. The sums do not depend on the end that a family was followed from, and a relative
change of one h or alpha is the change of a sum.

With other elementary functions (another C library's, or its baseline) the same build had the same families and events, and no h or alpha
changed by more than 1e-9, but those of 9 of the 1008 changes of label, by up to 2e-8: such a change is not a plain zero of a function.
"""

import math
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import NamedTuple

from branches.catalogue import Catalogue

__all__ = ["FILE", "Line", "differences", "read", "record", "unlike"]

FILE = Path(__file__).with_name("frozen_lee2009.txt")

ACCURACY = {"LB": 1e-7}
"""Relative difference of h or alpha that is one, of these types of events."""

OTHERWISE = 1e-9
"""Of the others."""


class Line(NamedTuple):
    """A family of the record."""

    id: str
    label: str
    points: int
    events: str  # such as "GR2 RT1 SN1"
    h: float  # sum of log h over the events that are no changes of label
    alpha: float  # and of log alpha
    label_h: float = 0.0  # the same over the changes of label
    label_alpha: float = 0.0

    @classmethod
    def of(cls, row, events):
        types = " ".join(f"{kind}{count}" for kind, count in sorted(Counter(event.type for event in events).items()))
        groups = [event for event in events if event.type != "LB"], [event for event in events if event.type == "LB"]
        sums = (math.fsum(math.log(getattr(event, name)) for event in group) for group in groups for name in ("h", "alpha"))
        return cls(row.id, row.label, row.points, types, *sums)

    def __str__(self):
        labels = [f"{self.label_h:.9g}", f"{self.label_alpha:.9g}"] if "LB" in self.events else []
        return "\t".join([*map(str, self[:4]), f"{self.h:.12g}", f"{self.alpha:.12g}", *labels])

    def is_near(self, other):
        """Whether the sums are those of another line, to the accuracies and the digits of the record."""
        limits = [OTHERWISE] * 2 + [ACCURACY["LB"]] * 2
        return all(abs(a - b) <= limit + 1e-11 * abs(b) for a, b, limit in zip(self[4:], other[4:], limits, strict=True))


def record(path):
    """Return the lines of a catalogue, in the order of their ids."""
    with Catalogue(path) as catalogue:
        return [Line.of(row, catalogue.events(row.id)) for row in sorted(catalogue.families(), key=lambda row: row.id)]


def read(path=FILE):
    """Return the lines of a record that was written."""
    rows = (text.split("\t") for text in path.read_text(encoding="utf-8").splitlines())
    return [Line(id, label, int(points), events, *map(float, sums)) for id, label, points, events, *sums in rows]


def unlike(found, frozen):
    """Return a sentence for each family that differs from the frozen one: in its id, label, events, or in the h or alpha of an event."""
    found, frozen = ({line.id: line for line in lines} for lines in (found, frozen))
    out = [f"{id} is not there; frozen: {frozen[id]}" for id in sorted(frozen.keys() - found.keys())]
    out += [f"{id} is new: {found[id]}" for id in sorted(found.keys() - frozen.keys())]
    for id in sorted(found.keys() & frozen.keys()):
        mine, other = found[id], frozen[id]
        if (mine.label, mine.events) != (other.label, other.events):
            out.append(f"{id}: {mine.label} {mine.events}; frozen: {other.label} {other.events}")
        elif not mine.is_near(other):
            apart = ", ".join(f"{a - b:.1e}" for a, b in zip(mine[4:], other[4:], strict=True))
            out.append(f"{id}: sums of log h and log alpha over {mine.events} differ by {apart} (the last two: over LB)")
    return out


def differences(path, other):
    """Return a sentence for each difference of two catalogues. Each event is compared with the nearest one of its type."""
    out = []
    with Catalogue(path) as first, Catalogue(other) as second:
        ids = [{row.id for row in catalogue.families()} for catalogue in (first, second)]
        for place, alone in ((path, ids[0] - ids[1]), (other, ids[1] - ids[0])):
            out += [f"{id} is only in {place}" for id in sorted(alone)]
        for id in sorted(ids[0] & ids[1]):
            one, two = (_by_type(catalogue.events(id)) for catalogue in (first, second))
            for kind in sorted({*one, *two}):
                if len(one[kind]) != len(two[kind]):
                    out.append(f"{id}: {len(one[kind])} {kind} and {len(two[kind])}: {one[kind]} and {two[kind]}")
                    continue
                for a in one[kind]:
                    b = min(two[kind], key=lambda b, a=a: _apart(a, b))
                    two[kind].remove(b)
                    if _apart(a, b) > ACCURACY.get(kind, OTHERWISE):
                        here, there = (f"h = {h:.12g}, alpha = {alpha:.12g}" for h, alpha in (a, b))
                        out.append(f"{id}: {kind} at {here} and {there}: {_apart(a, b):.1e} apart")
    return out


def _by_type(events):
    found = defaultdict(list)
    for event in events:
        found[event.type].append((event.h, event.alpha))
    return found


def _apart(one, other):
    return max(abs(math.log(a / b)) for a, b in zip(one, other, strict=True))


if __name__ == "__main__":
    if len(sys.argv) == 2:
        print("\n".join(map(str, record(sys.argv[1]))))
    else:
        print("\n".join(differences(*sys.argv[1:3])) or "no differences")
