"""Impact sequences of the families at which a family of orbits without a reversal can begin."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product, starmap

from branches.sequences import Ends, ImpactSequence, canonical_sequence, mirror

__all__ = ["QUARTER", "Sequences", "parent_sequences"]


Sequences = dict[tuple[ImpactSequence, Ends], None]

QUARTER = 4
"""Most impacts in a quarter period of the most symmetric families that are given."""


def parent_sequences(sequence: ImpactSequence, letters: tuple[str, ...], *, odd_symmetry: bool) -> tuple[Sequences, Sequences]:
    """The sequences and ends of families with a reversal at which a family of closed orbits can begin, the likeliest first.

    Where the last reversal breaks, the full period has the same sequence. Where an impact grazes, it can have one impact less or more, or
    several, because a touch recurs in each quarter of a period.

    Parameters
    ----------
    sequence, letters
        Of the full period of the closed orbits; all contacts of the system.
    odd_symmetry
        As for `branches.sequences.canonical_sequence`.

    Returns
    -------
    near, symmetric
        Those with one impact more or less at most, and those of quarter periods.

    Examples
    --------
    >>> near, symmetric = parent_sequences(("+", "-"), ("+", "-"), odd_symmetry=True)
    >>> list(near)[:3]
    [((), ('origin', 'stop+')), ((), ('stop+', 'stop-')), (('+',), ('origin', 'origin'))]
    """
    count, far_ends = len(sequence), ("rest", *(f"stop{letter}" for letter in letters)) if odd_symmetry else ()
    without = [sequence[:i] + sequence[i + 1 :] for i in range(count)]
    more = [(*sequence[:i], letter, *sequence[i:]) for i in range(count) for letter in letters]
    near = (segment for cycle in dict.fromkeys([sequence, *without, *more]) for segment in _segments(cycle, odd_symmetry=odd_symmetry))
    quarters = (hits for most in range(min(count // 4 + 1, QUARTER) + 1) for hits in product(letters, repeat=most))
    symmetric = ((hits, ("origin", far)) for hits, far in product(quarters, far_ends))
    canonical = partial(canonical_sequence, odd_symmetry=odd_symmetry)
    return dict.fromkeys(starmap(canonical, near)), dict.fromkeys(starmap(canonical, symmetric))


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
