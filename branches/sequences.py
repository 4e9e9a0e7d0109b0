"""Impact sequences: the stops that a segment hits, in order of time, and their images under the symmetries.

A **sequence** is a tuple of contact letters, one for each impact strictly inside the segment, in order of time: `+` and `-` for
the two sides of a single stop, `a+`, `a-`, `b+`, ... where there are several. The **ends** of the segment are kept apart from
it, as a pair of `origin`, `rest`, `stop+`, `stop-` (`stopa+`, ... where there are several stops), or `("periodic", "periodic")`
for an orbit that closes on itself without a reversal.

About an end the orbit continues as its own reversal, s being the time from the end:

    origin         u(s) = -u(-s)   the sequence continues reversed and mirrored
    rest           u(s) =  u(-s)   the sequence continues reversed
    stop           u(s) =  u(-s)   the end's own impact, then the sequence reversed

With e = -1 at an origin and +1 elsewhere this gives u(2 tau + s) = e_first e_last u(s) for a segment of length tau: ends of
equal e close after two segments, others after four. A family is known by the smallest image of its sequence and ends under the
symmetries of the equations: mirror (where the stops are symmetric), and reversal with exchange of the ends.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

__all__ = [
    "Ends", "PERIODIC", "ImpactSequence", "SequenceSyntaxError", "canonical_sequence", "format_ends", "full_sequence", "impacts_per_period",
    "mirror", "parse_ends", "parse_sequence", "segments_per_period", "split_family_id", "unfolded_sequence",
]  # fmt: skip

ImpactSequence = tuple[str, ...]
Ends = tuple[str, str]

PERIODIC: Ends = ("periodic", "periodic")
"""The ends of an orbit that closes on itself, without any reversal."""

_END = r"(origin|rest|stop[a-z]?[+-])"
_ENDS = re.compile(_END + "-" + _END)
_HASH = re.compile(r"[0-9a-f]{4,64}")


class SequenceSyntaxError(ValueError):
    """A sequence, a pair of ends or a family id that cannot be read; the message is one line."""


def parse_sequence(text: str) -> ImpactSequence:
    """Read a sequence such as `+-+` or `a+b-`.

    Examples
    --------
    >>> parse_sequence("+-+"), parse_sequence("a+b-"), parse_sequence("")
    (('+', '-', '+'), ('a+', 'b-'), ())
    """
    if not re.fullmatch(r"[+-]*|([a-z][+-])*", text):
        raise SequenceSyntaxError(f'impact sequence "{text}": expected + and -, each after its stop\'s letter if there are several stops')
    return tuple(re.findall(r"[a-z]?[+-]", text))


def parse_ends(text: str) -> Ends:
    """Read a pair of ends such as `origin-stop+`, or `periodic`.

    Raises
    ------
    SequenceSyntaxError
        Where the text is neither.

    Examples
    --------
    >>> parse_ends("stop+-stop-"), parse_ends("periodic")
    (('stop+', 'stop-'), ('periodic', 'periodic'))
    """
    if text == "periodic":
        return PERIODIC
    found = _ENDS.fullmatch(text)
    if found is None:
        raise SequenceSyntaxError(
            f'ends "{text}": expected two of origin, rest, stop+, stop- joined by "-", such as origin-stop+, or periodic'
        )
    return found.group(1), found.group(2)


def format_ends(ends: Ends) -> str:
    """The ends as text, e.g. `origin-stop+`; what `parse_ends` reads.

    Examples
    --------
    >>> format_ends(("origin", "stop+"))
    'origin-stop+'
    """
    return "periodic" if ends == PERIODIC else "-".join(ends)


def split_family_id(text: str) -> tuple[Ends, ImpactSequence, str]:
    """Take a family id `ends:sequence:hash` apart.

    Raises
    ------
    SequenceSyntaxError
        Where a part is missing or cannot be read.

    Examples
    --------
    >>> split_family_id("origin-stop+:+-:03fa9c1e")
    (('origin', 'stop+'), ('+', '-'), '03fa9c1e')
    """
    parts = text.split(":")
    if len(parts) != 3:
        raise SequenceSyntaxError(f'family id "{text}": expected ends:sequence:hash, such as origin-stop+:+-:03fa9c1e')
    ends, sequence, digest = parse_ends(parts[0]), parse_sequence(parts[1]), parts[2]
    if not _HASH.fullmatch(digest):
        raise SequenceSyntaxError(f'family id "{text}": the hash "{digest}" is not of 4 to 64 characters 0-9 and a-f')
    return ends, sequence, digest


_SWAP = str.maketrans("+-", "-+")


@lru_cache(maxsize=16384)
def mirror(letters: tuple[str, ...]) -> tuple[str, ...]:
    """The sequence, or the ends, of the mirrored orbit -u: each contact becomes the opposite side of its stop.

    Examples
    --------
    >>> mirror(("+", "+", "-")), mirror(("origin", "stop+"))
    (('-', '-', '+'), ('origin', 'stop-'))
    """
    return tuple(letter.translate(_SWAP) for letter in letters)


@lru_cache(maxsize=16384)
def canonical_sequence(sequence: ImpactSequence, ends: Ends, *, odd_symmetry: bool = True) -> tuple[ImpactSequence, Ends]:
    """The smallest image of sequence and ends under the symmetries of the equations: reversal, and the mirror.

    Ends are compared before sequences, in the order of their text (`origin` < `rest` < `stop+` < `stop-`; `+` < `-`), so a segment
    with one origin end starts there and one with one stop end ends at its upper side. A search asks for the same sequences at each
    energy, so results are cached.

    Parameters
    ----------
    sequence, ends
        The segment; for periodic ends the sequence of the full period, of which all rotations are images as well.
    odd_symmetry
        Whether -u is a motion whenever u is (each stop two-sided with equal gaps, no constant load): allows the mirror.

    Examples
    --------
    >>> canonical_sequence(("+", "-"), ("stop-", "origin"))
    (('+', '-'), ('origin', 'stop+'))
    """
    images: list[Any] = [(ends, sequence), ((ends[1], ends[0]), sequence[::-1])]
    if odd_symmetry:
        images += [(mirror(e), mirror(s)) for e, s in images]
    if ends == PERIODIC:
        images = [(e, s[k:] + s[:k]) for e, s in images for k in range(max(len(s), 1))]
    smallest_ends, smallest_sequence = min(images)
    return smallest_sequence, smallest_ends


def segments_per_period(ends: Ends) -> int:
    """How many images of the segment make up one period: 1 (periodic), 2 (ends of one kind of reversal) or 4.

    Examples
    --------
    >>> segments_per_period(("origin", "stop+")), segments_per_period(("rest", "stop+"))
    (4, 2)
    """
    if ends == PERIODIC:
        return 1
    return 4 if (ends[0] == "origin") != (ends[1] == "origin") else 2


def unfolded_sequence(sequence: ImpactSequence, ends: Ends, count: int) -> tuple[ImpactSequence, Ends]:
    """The segment that `count` successive segments make together, continued by reversal at each end.

    Returns
    -------
    sequence, ends
        The impacts strictly inside the longer segment and its own two ends.

    Examples
    --------
    >>> unfolded_sequence((), ("origin", "stop+"), 3)
    (('+',), ('origin', 'stop-'))
    """
    inside: list[str] = []
    mirrored = False
    for k in range(count):
        piece = sequence if k % 2 == 0 else sequence[::-1]
        inside += mirror(piece) if mirrored else piece
        last = (mirror(ends) if mirrored else ends)[(k + 1) % 2]
        if k + 1 < count:
            if last.startswith("stop"):
                inside.append(last.removeprefix("stop"))
            mirrored ^= last == "origin"
    return tuple(inside), (ends[0], last)


def full_sequence(sequence: ImpactSequence, ends: Ends) -> ImpactSequence:
    """The sequence of the full period, from the first end on (whose own impact, if it is a stop, comes first).

    Examples
    --------
    >>> full_sequence(("+",), ("origin", "stop-"))
    ('+', '-', '+', '-', '+', '-')
    >>> full_sequence(("+", "-"), ("origin", "origin"))
    ('+', '-', '+', '-')
    """
    count = segments_per_period(ends)
    if count == 1:
        return sequence
    return ((ends[0].removeprefix("stop"),) if ends[0].startswith("stop") else ()) + unfolded_sequence(sequence, ends, count)[0]


def impacts_per_period(sequence: ImpactSequence, ends: Ends) -> int:
    """The number of impacts in one period.

    Examples
    --------
    >>> impacts_per_period(("+",), ("origin", "stop-"))
    6
    """
    count = segments_per_period(ends)
    return count * len(sequence) + count // 2 * sum(end.startswith("stop") for end in ends)


