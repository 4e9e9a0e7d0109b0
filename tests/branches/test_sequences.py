"""Impact sequences and their symmetries.

Oracles: the group laws themselves; and, for the full-period sequence, an independent construction that samples a toy
orbit - impacts placed on a time axis and continued by u(s) = -+u(-s) about the ends until the pattern closes.
"""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branches.sequences import (
    PERIODIC,
    SequenceSyntaxError,
    canonical_sequence,
    format_ends,
    full_sequence,
    impacts_per_period,
    mirror,
    parse_ends,
    parse_sequence,
    segments_per_period,
    split_family_id,
    unfolded_sequence,
)

ONE_STOP = st.lists(st.sampled_from(["+", "-"]), max_size=7).map(tuple)
TWO_STOPS = st.lists(st.sampled_from(["a+", "a-", "b+", "b-"]), max_size=7).map(tuple)
SEQUENCES = st.one_of(ONE_STOP, TWO_STOPS)
END = st.sampled_from(["origin", "rest", "stop+", "stop-"])
ENDS = st.tuples(END, END)


def toy_period(sequence, ends):
    """Full-period sequence from impact times alone: reflect the time axis about each end until the pattern repeats."""
    length = 2 * (len(sequence) + 1)
    sign = {"+": 1, "-": -1}
    start = {2 * (k + 1): sign[letter] for k, letter in enumerate(sequence)}
    for place, end in ((0, ends[0]), (length, ends[1])):
        if end.startswith("stop"):
            start[place] = sign[end[-1]]
    factor = [-1 if end == "origin" else 1 for end in ends]
    impacts = dict(start)
    for _ in range(4):  # each pass reflects about both ends, which at least doubles what is covered on either side
        impacts |= {2 * length - time: factor[1] * side for time, side in impacts.items()}
        impacts |= {-time: factor[0] * side for time, side in impacts.items()}
    period = (2 if factor[0] == factor[1] else 4) * length
    assert all(impacts[time + period] == side for time, side in impacts.items() if time + period in impacts)
    return tuple("+" if impacts[time] > 0 else "-" for time in sorted(impacts) if 0 <= time < period), period // length


@given(SEQUENCES, st.one_of(ENDS, st.just(PERIODIC)), st.text("0123456789abcdef", min_size=4, max_size=16))
def test_family_id_round_trip(sequence, ends, digest):
    assert split_family_id(f"{format_ends(ends)}:{''.join(sequence)}:{digest}") == (ends, sequence, digest)


@pytest.mark.parametrize(
    ("read", "texts", "words"),
    [
        (parse_sequence, ("+x-", "+a-", "a", "a++"), 'impact sequence "{}": expected + and -'),
        (parse_ends, ("origin", "origin-wall+", "origin:stop+", "stop-origin", "origin-periodic", ""), "origin-stop"),
        (split_family_id, ("origin-stop+:+-", "a:b:c:d"), 'family id "{}": expected ends:sequence:hash'),
        (split_family_id, ("origin-stop+:+-:xyzw", "origin-stop+:+-:"), 'family id "{}": the hash "'),
    ],
)
def test_bad_texts(read, texts, words):
    for text in texts:
        with pytest.raises(SequenceSyntaxError, match=re.escape(words.format(text))):
            read(text)


@given(SEQUENCES, ENDS)
def test_mirror_and_reversal_are_commuting_involutions(sequence, ends):
    assert mirror(mirror(sequence)) == sequence
    assert mirror(sequence[::-1]) == mirror(sequence)[::-1]
    assert mirror(mirror(ends)) == ends


@given(ONE_STOP, ENDS)
def test_canonical_is_idempotent_and_invariant(sequence, ends):
    best = canonical_sequence(sequence, ends)
    assert canonical_sequence(*best) == best
    assert canonical_sequence(mirror(sequence), mirror(ends)) == best
    assert canonical_sequence(sequence[::-1], ends[::-1]) == best
    assert canonical_sequence(mirror(sequence[::-1]), mirror(ends[::-1])) == best
    assert best[0] in {sequence, mirror(sequence), sequence[::-1], mirror(sequence[::-1])}


@given(ONE_STOP, st.integers(0, 6), st.booleans())
def test_canonical_of_periodic_sequences(sequence, shift, odd_symmetry):
    best = canonical_sequence(sequence, PERIODIC, odd_symmetry=odd_symmetry)
    turned = sequence[shift % max(len(sequence), 1) :] + sequence[: shift % max(len(sequence), 1)]
    assert canonical_sequence(turned, PERIODIC, odd_symmetry=odd_symmetry) == best
    assert canonical_sequence(*best, odd_symmetry=odd_symmetry) == best


def test_without_odd_symmetry_the_mirror_is_another_family():
    upper, lower = (canonical_sequence(("+", "+", side), ("rest", "stop+"), odd_symmetry=False) for side in "+-")
    assert upper != lower
    assert canonical_sequence(("-", "-"), ("rest", "stop-"), odd_symmetry=False) == (("-", "-"), ("rest", "stop-"))
    assert canonical_sequence(("-", "-"), ("rest", "stop-")) == (("+", "+"), ("rest", "stop+"))


@given(ONE_STOP, ENDS)
def test_full_sequence_against_reflected_impact_times(sequence, ends):
    expected, segments = toy_period(sequence, ends)
    assert full_sequence(sequence, ends) == expected
    assert segments_per_period(ends) == segments
    assert impacts_per_period(sequence, ends) == len(expected)


@given(ONE_STOP, st.sampled_from(["rest", "stop+", "stop-"]))
def test_counts_of_a_symmetric_orbit(sequence, last):
    """p = q = inner impacts of the quarter, one more at the quarter for O, none for E: definition of SmnEpp, SmnOpp."""
    half = unfolded_sequence(sequence, ("origin", last), 2)
    assert half[1] == ("origin", "origin")
    assert len(half[0]) == 2 * len(sequence) + (last != "rest")
    assert half[0][: len(sequence)] == sequence
    if last != "rest":
        assert "stop" + half[0][len(sequence)] == last
    assert full_sequence(*half) == full_sequence(sequence, ("origin", last))


@given(ONE_STOP, ENDS, st.integers(1, 5))
def test_covers_of_an_orbit_repeat_its_sequence(sequence, ends, cover):
    segments = segments_per_period(ends)
    longer = unfolded_sequence(sequence, ends, cover if segments == 2 or cover % 2 else 2 * cover)
    full = full_sequence(sequence, ends)
    assert full_sequence(*longer) == full * cover
