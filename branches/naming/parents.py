"""Impact sequences of the families at which a family of orbits without a reversal can begin."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations_with_replacement, product

from branches.sequences import Ends, ImpactSequence, canonical_sequence, mirror, segments_per_period

__all__ = ["SHORT", "Sequences", "parent_sequences"]


Sequences = dict[tuple[ImpactSequence, Ends], None]

SHORT = {4: 4, 2: 3}
"""Most impacts in a quarter and in half a period of the short families that are given."""


def parent_sequences(sequence: ImpactSequence, letters: tuple[str, ...], which: str, *, odd_symmetry: bool) -> Sequences:
    """The sequences and ends of families with a reversal at which a family of closed orbits can begin.

    Where the last reversal breaks, the full period has the same sequence. Where an impact grazes, it can have one impact less or more. In
    a short family a touch recurs in each quarter or half of a period, and the closed orbits can have several of its periods.

    Parameters
    ----------
    sequence, letters
        Of the full period of the closed orbits; all contacts of the system.
    which : str
        "near": at most one impact more or less; "short": all of quarter and half periods with few impacts.
    odd_symmetry
        As for `branches.sequences.canonical_sequence`.

    Examples
    --------
    >>> list(parent_sequences(("+", "-"), ("+", "-"), "near", odd_symmetry=True))[:3]
    [((), ('origin', 'stop+')), ((), ('stop+', 'stop-')), (('+',), ('origin', 'origin'))]
    """
    if which == "near":
        count = len(sequence)
        fewer = [sequence[:i] + sequence[i + 1 :] for i in range(count)]
        more = [(*sequence[:i], letter, *sequence[i:]) for i in range(count) for letter in letters]
        cycles = dict.fromkeys([sequence, *fewer, *more])
        found = [segment for cycle in cycles for segment in _segments(cycle, odd_symmetry=odd_symmetry)]
    else:
        kinds = (*(("origin",) if odd_symmetry else ()), "rest", *(f"stop{letter}" for letter in letters))
        pairs = [(ends, segments_per_period(ends)) for ends in combinations_with_replacement(kinds, 2)]
        numbers = [(ends, most) for ends, parts in pairs for most in range(min(len(sequence) // parts + 1, SHORT[parts]) + 1)]
        found = [(hits, ends) for ends, most in numbers for hits in product(letters, repeat=most)]
    return dict.fromkeys(canonical_sequence(hits, ends, odd_symmetry=odd_symmetry) for hits, ends in found)


def _segments(cycle: ImpactSequence, *, odd_symmetry: bool) -> Iterator[tuple[ImpactSequence, Ends]]:
    """The parts of a cyclic sequence between two neighbouring axes of one reversal, and between axes of both kinds.

    Places are counted in half steps: an even one is that of an impact."""
    count, places = len(cycle), range(len(cycle))
    turned = [tuple(cycle[(place - i) % count] for i in places) for place in places]
    images = ((False, cycle), (True, mirror(cycle)))[: 1 + odd_symmetry]
    axes = {(place, origin) for origin, image in images for place in places if turned[place] == image}

    def end(place: int, origin: bool) -> str:
        return "origin" if origin else f"stop{cycle[place // 2 % count]}" if place % 2 == 0 else "rest"

    for place, origin in sorted(axes):
        for length, other in ((count // 2, not origin), (count, origin)):
            far = place + length
            if (far % count, other) in axes and (length == count or count % 2 == 0):
                inside = range(place // 2 + 1, (far + 1) // 2)
                yield tuple(cycle[i % count] for i in inside), (end(place, origin), end(far, other))
