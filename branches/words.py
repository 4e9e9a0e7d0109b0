"""Words of impacts: which stops a solved segment hits, in which order, and what its symmetries make of that.

A **word** is a tuple of contact letters, one for each impact strictly inside the segment, in order of time: `+` and `-` for
the two sides of a single stop, `a+`, `a-`, `b+`, ... where there are several. The **ends** of the segment are kept apart from
it, as a pair of `origin`, `rest`, `stop+`, `stop-` (`stopa+`, ... where there are several stops), or `("periodic", "periodic")`
for an orbit that closes on itself without a reversal.

About an end the orbit continues as its own reversal, s being the time from the end:

    origin         u(s) = -u(-s)   the word continues reversed and mirrored
    rest           u(s) =  u(-s)   the word continues reversed
    stop           u(s) =  u(-s)   the end's own impact, then the word reversed

With e = -1 at an origin and +1 elsewhere this gives u(2 tau + s) = e_first e_last u(s) for a segment of length tau: ends of
equal e close after two segments, others after four. A family is known by the smallest image of its word and ends under the
symmetries of the equations: mirror (where the stops are symmetric), and reversal with exchange of the ends.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from branches.word_text import (
    PERIODIC,
    Ends,
    Word,
    WordSyntaxError,
    check_ends,
    format_ends,
    format_word,
    join_family_id,
    parse_ends,
    parse_word,
    split_family_id,
)

__all__ = [
    "PERIODIC",
    "Ends",
    "Word",
    "WordSyntaxError",
    "canonical",
    "end_letter",
    "exchange",
    "format_ends",
    "format_word",
    "full_word",
    "impacts_per_period",
    "join_family_id",
    "mirror",
    "mirror_ends",
    "parity",
    "parse_ends",
    "parse_word",
    "primitive",
    "reverse",
    "segments_per_period",
    "split_family_id",
    "unfold",
]

_SWAP = {"+": "-", "-": "+"}


def mirror(word: Iterable[str]) -> Word:
    """The word of the mirrored orbit -u: each contact becomes the opposite side of its stop.

    Examples
    --------
    >>> mirror(("+", "+", "-"))
    ('-', '-', '+')
    """
    return _mirrored(tuple(word))


@lru_cache(maxsize=16384)
def _mirrored(word: Word) -> Word:
    return tuple(letter[:-1] + _SWAP[letter[-1]] for letter in word)


def reverse(word: Iterable[str]) -> Word:
    """The word of the orbit run backwards in time."""
    return tuple(word)[::-1]


def exchange(ends: Ends) -> Ends:
    """The ends in the other order, as the reversed segment has them."""
    return ends[1], ends[0]


def mirror_ends(ends: Ends) -> Ends:
    """The ends of the mirrored orbit: stop+ and stop- change places, origin, rest and periodic stay."""
    first, last = (end[:-1] + _SWAP[end[-1]] if end.startswith("stop") else end for end in ends)
    return first, last


def end_letter(end: str) -> str | None:
    """The contact letter of a stop end, None for the other ends.

    Examples
    --------
    >>> end_letter("stop+"), end_letter("stopb-"), end_letter("rest")
    ('+', 'b-', None)
    """
    return end.removeprefix("stop") if end.startswith("stop") else None


def canonical(word: Iterable[str], ends: Ends, *, odd_symmetry: bool = True, reversible: bool = True) -> tuple[Word, Ends]:
    """The smallest image of word and ends under the symmetries of the equations.

    Ends are compared before words, in the order of their text (`origin` < `rest` < `stop+` < `stop-`; `+` < `-`), so a segment
    with one origin end starts there and one with one stop end ends at its upper side.

    Parameters
    ----------
    word, ends
        The segment; for periodic ends the word of the whole period, of which all rotations are images as well.
    odd_symmetry
        Whether -u is a motion whenever u is (each stop two-sided with equal gaps, no constant load): allows the mirror.
    reversible
        Whether motions can be run backwards (no damping, elastic stops): allows the reversal. Only periodic ends exist without.

    Raises
    ------
    ValueError
        For ends that do not exist, for an origin end without odd symmetry, and for a reversing end without reversibility.

    Examples
    --------
    >>> canonical(("+", "-"), ("stop-", "origin"))
    (('+', '-'), ('origin', 'stop+'))
    """
    check_ends(ends)
    if "origin" in ends and not odd_symmetry:
        raise ValueError("an origin end needs odd symmetry: each stop two-sided with equal gaps and no constant load")
    if ends != PERIODIC and not reversible:
        raise ValueError(f"ends {format_ends(ends)} need a reversible system (no damping, elastic stops), expected periodic")
    return _smallest(tuple(word), (ends[0], ends[1]), odd_symmetry, reversible)


@lru_cache(maxsize=16384)
def _smallest(word: Word, ends: Ends, odd_symmetry: bool, reversible: bool) -> tuple[Word, Ends]:
    """See `canonical`; a search asks for the same words at each energy."""
    images = [(ends, word)]
    if odd_symmetry:
        images += [(mirror_ends(e), mirror(w)) for e, w in images]
    if reversible:
        images += [(exchange(e), reverse(w)) for e, w in images]
    if ends == PERIODIC:
        images = [(e, w[k:] + w[:k]) for e, w in images for k in range(max(len(w), 1))]
    smallest_ends, smallest_word = min(images)
    return smallest_word, smallest_ends


def segments_per_period(ends: Ends) -> int:
    """How many images of the segment make up one period: 1 (periodic), 2 (ends of one kind of reversal) or 4.

    Examples
    --------
    >>> segments_per_period(("origin", "stop+")), segments_per_period(("rest", "stop+"))
    (4, 2)
    """
    check_ends(ends)
    if ends == PERIODIC:
        return 1
    return 4 if (ends[0] == "origin") != (ends[1] == "origin") else 2


def parity(ends: Ends) -> str | None:
    """The index E or O of a symmetric orbit with these ends (O: an impact at the quarter period), None for other orbits.

    Examples
    --------
    >>> parity(("origin", "stop-")), parity(("rest", "origin")), parity(("origin", "origin"))
    ('O', 'E', None)
    """
    if segments_per_period(ends) != 4:
        return None
    return "E" if "rest" in ends else "O"


def unfold(word: Iterable[str], ends: Ends, count: int) -> tuple[Word, Ends]:
    """The segment that `count` successive segments make together, continued by reversal at each end.

    Returns
    -------
    word, ends
        The impacts strictly inside the longer segment and its own two ends.

    Raises
    ------
    ValueError
        For periodic ends, which have no reversal, and for a count below 1.

    Examples
    --------
    >>> unfold((), ("origin", "stop+"), 3)
    (('+',), ('origin', 'stop-'))
    """
    check_ends(ends)
    if ends == PERIODIC:
        raise ValueError("a segment with periodic ends has no reversal to continue by; repeat its word instead")
    if count < 1:
        raise ValueError(f"number of segments is {count}, expected 1 or more")
    word = tuple(word)
    inside: list[str] = []
    mirrored = False
    for k in range(count):
        piece = word if k % 2 == 0 else reverse(word)
        inside += mirror(piece) if mirrored else piece
        last = ends[(k + 1) % 2]
        if mirrored:
            last = mirror_ends((last, last))[0]
        if k + 1 < count:
            letter = end_letter(last)
            if letter is not None:
                inside.append(letter)
            mirrored ^= last == "origin"
    return tuple(inside), (ends[0], last)


def full_word(word: Iterable[str], ends: Ends) -> Word:
    """The word of the whole period, from the first end on (whose own impact, if it is a stop, comes first).

    Examples
    --------
    >>> format_word(full_word(("+",), ("origin", "stop-")))
    '+-+-+-'
    >>> format_word(full_word(("+", "-"), ("origin", "origin")))
    '+-+-'
    """
    count = segments_per_period(ends)
    if count == 1:
        return tuple(word)
    letter = end_letter(ends[0])
    return (() if letter is None else (letter,)) + unfold(word, ends, count)[0]


def impacts_per_period(word: Iterable[str], ends: Ends) -> int:
    """The number of impacts in one period.

    Examples
    --------
    >>> impacts_per_period(("+",), ("origin", "stop-"))
    6
    """
    count = segments_per_period(ends)
    at_ends = sum(end_letter(end) is not None for end in ends)
    return count * len(tuple(word)) + count // 2 * at_ends


def primitive(word: Iterable[str]) -> tuple[Word, int]:
    """The shortest word whose repetition the cyclic word of a period is, and how often it is repeated.

    One turn says that the orbit is run through once. More turns only allow a repetition: an orbit of twice the period can
    repeat the word of the orbit that it doubled, so states decide where this gives more than 1.

    Examples
    --------
    >>> primitive(("+", "-", "+", "-"))
    (('+', '-'), 2)
    """
    word = tuple(word)
    for length in range(1, len(word) + 1):
        turns, rest = divmod(len(word), length)
        if rest == 0 and word[:length] * turns == word:
            return word[:length], turns
    return (), 1
