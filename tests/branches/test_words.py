"""Words of impacts and their symmetries.

Oracles: the group laws themselves; and, for the full-period sequence, an independent construction that samples a toy
orbit - impacts placed on a time axis and continued by u(s) = -+u(-s) about the ends until the pattern closes.
"""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from branches.sequences import (
    PERIODIC,
    SequenceSyntaxError,
    canonical_sequence,
    format_ends,
    format_sequence,
    full_sequence,
    impacts_per_period,
    join_family_id,
    mirror,
    mirror_ends,
    parse_ends,
    parse_sequence,
    segments_per_period,
    split_family_id,
    unfolded_sequence,
)

ONE_STOP = st.lists(st.sampled_from(["+", "-"]), max_size=7).map(tuple)
TWO_STOPS = st.lists(st.sampled_from(["a+", "a-", "b+", "b-"]), max_size=7).map(tuple)
WORDS = st.one_of(ONE_STOP, TWO_STOPS)
END = st.sampled_from(["origin", "rest", "stop+", "stop-"])
ENDS = st.tuples(END, END)


def rotations(sequence):
    return {sequence[k:] + sequence[:k] for k in range(max(len(sequence), 1))}


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


@given(WORDS)
def test_text_round_trip(sequence):
    assert parse_sequence(format_sequence(sequence)) == sequence


@given(ENDS)
def test_ends_round_trip(ends):
    assert parse_ends(format_ends(ends)) == ends
    assert parse_ends(format_ends(PERIODIC)) == PERIODIC


@given(WORDS, ENDS, st.text("0123456789abcdef", min_size=4, max_size=16))
def test_family_id_round_trip(sequence, ends, digest):
    assert split_family_id(join_family_id(ends, sequence, digest)) == (ends, sequence, digest)


@pytest.mark.parametrize(
    ("text", "position"), [("+x-", "character 2"), ("+a-", "character 2"), ("a", "character 1"), ("a++", "character 3")]
)
def test_bad_word_points_at_the_character(text, position):
    with pytest.raises(SequenceSyntaxError, match=position):
        parse_sequence(text)


@pytest.mark.parametrize("text", ["origin", "origin-wall+", "origin:stop+", "stop-origin", "origin-periodic", ""])
def test_bad_ends(text):
    with pytest.raises(SequenceSyntaxError, match="origin-stop"):
        parse_ends(text)


@pytest.mark.parametrize("text", ["origin-stop+:+-", "origin-stop+:+-:xyzw", "origin-stop+:+-:", "a:b:c:d"])
def test_bad_family_id(text):
    with pytest.raises(SequenceSyntaxError):
        split_family_id(text)


@given(WORDS, ENDS)
def test_mirror_and_reversal_are_commuting_involutions(sequence, ends):
    assert mirror(mirror(sequence)) == sequence
    assert mirror(sequence[::-1]) == mirror(sequence)[::-1]
    assert mirror_ends(mirror_ends(ends)) == ends


@given(ONE_STOP, ENDS)
def test_canonical_is_idempotent_and_invariant(sequence, ends):
    best = canonical_sequence(sequence, ends)
    assert canonical_sequence(*best) == best
    assert canonical_sequence(mirror(sequence), mirror_ends(ends)) == best
    assert canonical_sequence(sequence[::-1], ends[::-1]) == best
    assert canonical_sequence(mirror(sequence[::-1]), mirror_ends(ends[::-1])) == best
    assert best[0] in {sequence, mirror(sequence), sequence[::-1], mirror(sequence[::-1])}


@given(ONE_STOP, st.integers(0, 6), st.booleans(), st.booleans())
def test_canonical_of_periodic_words(sequence, shift, odd_symmetry, reversible):
    best = canonical_sequence(sequence, PERIODIC, odd_symmetry=odd_symmetry, reversible=reversible)
    turned = sequence[shift % max(len(sequence), 1) :] + sequence[: shift % max(len(sequence), 1)]
    assert canonical_sequence(turned, PERIODIC, odd_symmetry=odd_symmetry, reversible=reversible) == best
    assert canonical_sequence(*best, odd_symmetry=odd_symmetry, reversible=reversible) == best


def test_without_odd_symmetry_the_mirror_is_another_family():
    upper, lower = (canonical_sequence(("+", "+", side), ("rest", "stop+"), odd_symmetry=False) for side in "+-")
    assert upper != lower
    assert canonical_sequence(("-", "-"), ("rest", "stop-"), odd_symmetry=False) == (("-", "-"), ("rest", "stop-"))
    assert canonical_sequence(("-", "-"), ("rest", "stop-")) == (("+", "+"), ("rest", "stop+"))


def test_refusals():
    with pytest.raises(ValueError, match="odd symmetry"):
        canonical_sequence((), ("origin", "rest"), odd_symmetry=False)
    with pytest.raises(ValueError, match="reversible"):
        canonical_sequence((), ("rest", "rest"), reversible=False)
    with pytest.raises(ValueError, match="expected two of origin"):
        canonical_sequence((), ("origin", "periodic"))
    with pytest.raises(ValueError, match="no reversal"):
        unfolded_sequence(("+",), PERIODIC, 2)
    with pytest.raises(ValueError, match="is 0, expected 1"):
        unfolded_sequence(("+",), ("rest", "rest"), 0)


def test_one_sided_irreversible_periodic_words_keep_their_direction():
    clockwise = canonical_sequence(("a+", "b+", "c+"), PERIODIC, odd_symmetry=False, reversible=False)
    assert clockwise != canonical_sequence(("c+", "b+", "a+"), PERIODIC, odd_symmetry=False, reversible=False)
    assert clockwise == canonical_sequence(("b+", "c+", "a+"), PERIODIC, odd_symmetry=False, reversible=False)


@given(ONE_STOP, ENDS)
def test_full_word_against_reflected_impact_times(sequence, ends):
    expected, segments = toy_period(sequence, ends)
    assert full_sequence(sequence, ends) == expected
    assert segments_per_period(ends) == segments
    assert impacts_per_period(sequence, ends) == len(expected)


@given(ONE_STOP, ENDS)
def test_full_word_is_invariant_under_its_reversals(sequence, ends):
    full = full_sequence(sequence, ends)
    for end in ends:
        image = mirror(full[::-1]) if end == "origin" else full[::-1]
        assert image in rotations(full)
    if segments_per_period(ends) == 4:
        half = len(full) // 2
        assert full[half:] == mirror(full[:half])


@given(ONE_STOP, ENDS)
def test_full_word_is_the_same_from_either_end(sequence, ends):
    full, other = full_sequence(sequence, ends), full_sequence(sequence[::-1], ends[::-1])
    assert other in rotations(full) | rotations(mirror(full))


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
def test_turns_of_an_orbit_repeat_its_word(sequence, ends, turns):
    segments = segments_per_period(ends)
    longer = unfolded_sequence(sequence, ends, turns if segments == 2 or turns % 2 else 2 * turns)
    full = full_sequence(sequence, ends)
    assert full_sequence(*longer) == full * turns
