"""Labels and names.

Oracles: the labels printed in Lee et al., Physica D 238 (2009) 1868, and what the notation says about them; round trips and
equivalences as properties; for covers, counts taken from the sequence of impacts itself.
"""

import dataclasses
import re

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from branches import sequences
from branches.naming.labels import (
    ImpossibleLabelError,
    Label,
    LabelSyntaxError,
    Name,
    canonical_label,
    latex,
    most_alike,
    parse,
    parse_name,
)
from branches.naming.matching import cover_label, fits_otherwise, matches, nearest_labels, reference_point_of, remark_on_name, roots


def parity(ends):
    """The letter O or E of a symmetric label: whether the quarter ends at an impact."""
    return "E" if "rest" in ends else "O"


HALF_WAVES = st.integers(1, 120)
IMPACTS = st.integers(0, 120)
SIGN = st.sampled_from("+-")


@st.composite
def complete_labels(draw):
    kind = draw(st.sampled_from("SUL"))
    sign = draw(SIGN)
    if kind == "L":
        m = draw(HALF_WAVES)
        return Label("L", m, m, sign=sign)
    if kind == "U":
        p, q = draw(IMPACTS), draw(IMPACTS)
        assume(p + q > 0)
        return Label("U", draw(HALF_WAVES), draw(HALF_WAVES), None, p, q, sign)
    parity = draw(st.sampled_from("EO"))
    p = draw(IMPACTS)
    assume(parity == "O" or p)
    return Label("S", 2 * draw(HALF_WAVES) - 1, 2 * draw(HALF_WAVES) - 1, parity, p, p, sign)


@st.composite
def patterns_of(draw, label):
    """What is left when a label is cut off at one of the places where the notation allows it."""
    if label.kind == "L":
        return Label("L", label.m, label.n, sign=draw(st.sampled_from([None, label.sign])))
    cut = draw(st.integers(0, 3))
    parity = label.parity if cut else None
    p, q = (label.p, label.q) if cut >= 2 else (None, None)
    sign = label.sign if cut == 3 or (draw(st.booleans()) and (label.kind == "U" or parity)) else None
    return Label(label.kind, label.m, label.n, parity, p, q, sign)


PATTERNS = complete_labels().flatmap(patterns_of)


@given(complete_labels().flatmap(lambda label: st.tuples(st.just(label), patterns_of(label))))
def test_a_shortened_label_matches_the_whole_one(pair):
    label, pattern = pair
    assert matches(pattern, label) and matches(pattern, canonical_label(label))
    assert matches(label, label) and label.is_complete
    assert pattern.is_complete == (pattern == label)


@given(complete_labels(), complete_labels())
def test_complete_labels_match_only_their_equivalents(one, other):
    assert matches(one, other) == (canonical_label(one) == canonical_label(other))
    assert canonical_label(canonical_label(one)) == canonical_label(one)


@given(complete_labels())
def test_a_changed_field_does_not_match(label):
    changes = [{"sign": "-" if label.sign == "+" else "+"}]
    if label.kind != "L":
        changes += [{"m": label.m + 2}, {"n": label.n + 2}]
    assert not any(matches(dataclasses.replace(label, **change), label) for change in changes)


PUBLISHED = {
    "S13O00+": ("S", 1, 3, "O", 0, 0, "+"),
    "S73O33-": ("S", 7, 3, "O", 3, 3, "-"),
    "S95E22-": ("S", 9, 5, "E", 2, 2, "-"),
    "S31O11-": ("S", 3, 1, "O", 1, 1, "-"),
    "U8353-": ("U", 8, 3, None, 5, 3, "-"),
    "U(15)578-": ("U", 15, 5, None, 7, 8, "-"),
    "U2201+": ("U", 2, 2, None, 0, 1, "+"),
    "L11+": ("L", 1, 1, None, None, None, "+"),
}


@pytest.mark.parametrize(("text", "fields"), PUBLISHED.items())
def test_published_labels(text, fields):
    assert parse(text) == Label(*fields)
    assert str(parse(text)) == text


def test_short_names_and_patterns():
    assert parse("S11-") == parse("S11O00-") and parse("S13+") == parse("S13O00+")
    assert parse("S13") == Label("S", 1, 3)
    assert matches(parse("S13"), parse("S13+")) and matches(parse("S13"), parse("S13E11-"))
    assert not matches(parse("S13+"), parse("S13O11+"))
    assert matches(parse("U21"), parse("U2101+")) and not matches(parse("U21"), parse("S31O11+"))
    assert matches(parse("U21-"), parse("U2101-")) and not matches(parse("U21-"), parse("U2101+"))
    assert matches(parse("S73O"), parse("S73O33-")) and not matches(parse("S73E"), parse("S73O33-"))
    assert matches(parse("U8353"), parse("U8353-")) and not matches(parse("U8353-"), parse("U8353"))
    for minus in "\N{MINUS SIGN}\N{EN DASH}\N{SUPERSCRIPT MINUS}":
        assert parse("U8353" + minus) == parse("U8353-")
    assert parse("S13\N{SUPERSCRIPT PLUS SIGN}") == parse("S13+")


@pytest.mark.parametrize(
    ("read", "text", "position", "expected"),
    [
        (parse, "", 1, "S (symmetric)"),
        (parse, "T13", 1, "S (symmetric)"),
        (parse, "s13", 1, "S (symmetric)"),
        (parse, " S13", 1, "S (symmetric)"),
        (parse, "S", 2, "half-waves m"),
        (parse, "S1", 3, "half-waves n"),
        (parse, "S1x", 3, "half-waves n"),
        (parse, "S13X00+", 4, "O or E"),
        (parse, "S13000+", 4, "O or E"),
        (parse, "S13O0", 6, "impacts q"),
        (parse, "S13O0+", 6, "impacts q"),
        (parse, "S13Ox", 5, "impacts p"),
        (parse, "S13O00*", 7, "a sign + or -"),
        (parse, "S13O00+ ", 8, "the end"),
        (parse, "S13O00+-", 8, "the end"),
        (parse, "U835", 5, "impacts q"),
        (parse, "U83E53-", 4, "impacts p"),
        (parse, "U15578-", 6, "a sign + or -"),
        (parse, "U(15", 5, "a digit or )"),
        (parse, "U()", 3, "a digit"),
        (parse, "U(05)", 3, "leading zeros"),
        (parse, "U(1234567890)1", 12, "at most 9 digits"),
        (parse, "L1", 3, "half-waves n"),
        (parse, "L11E", 4, "a sign + or -"),
        (parse, "S03X", 4, "O or E"),
        (parse, "S\N{ARABIC-INDIC DIGIT ONE}3", 2, "half-waves m"),
        (parse_name, "S13+@", 6, "h=.. or alpha=.."),
        (parse_name, "S13+@x=1", 6, "h=.. or alpha=.."),
        (parse_name, "S13+@h=", 8, "positive number"),
        (parse_name, "S13+@h=-1", 8, "positive number"),
        (parse_name, "S13+@h=0", 8, "positive number"),
        (parse_name, "S13+@h=1e999", 8, "positive number"),
        (parse_name, "S13+@h=nan", 8, "positive number"),
        (parse_name, "S13+@h=1,h=2", 10, "alpha=.."),
        (parse_name, "S13+@h=1;alpha=2", 9, "a comma or the end"),
        (parse_name, "S13+@h=1,alpha=2,", 17, "the end of the name"),
        (parse_name, "S13+ @h=1", 5, "@ or the end of the name"),
        (parse_name, "S13X@h=1", 4, "O or E"),
        (parse_name, "origin-wall:+:0123", 1, "family id"),
        (parse_name, "origin-stop+:+:0123,h=1", 1, "family id"),
        (parse_name, "origin-stop+:+:0123@h=1,", 25, "alpha=.."),
    ],
)
def test_syntax_errors_point_at_the_character(read, text, position, expected):
    with pytest.raises(LabelSyntaxError, match=re.escape(expected)) as caught:
        read(text)
    error = caught.value
    assert (error.text, error.position) == (text, position)
    assert error.caret.splitlines() == [text, " " * (position - 1) + "^"] or not text
    assert "\n" not in str(error) and f"character {position}" in str(error) and isinstance(error, ValueError)


@given(st.text("SULEO0123456789()+-@=,.:halp ", max_size=14))
def test_any_text_is_read_or_refused_in_one_line(text):
    for read in (parse, parse_name):
        try:
            again = read(text)
        except (LabelSyntaxError, ImpossibleLabelError) as error:
            assert "\n" not in str(error)
        else:
            assert read(str(again)) == again


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("S13E01+", "second quarter as in its first, here 0 and 1"),
        ("S13O12", "second quarter as in its first, here 1 and 2"),
        ("S03O00+", "NES has 0 half-waves"),
        ("U10", "LO has 0 half-waves"),
        ("S13E00+", "no impact at all"),
        ("U2100-", "no impact at all"),
        ("S11E00+", "in systems without stops such as S11+"),
        ("L13+", "differ"),
        ("S23O11+", "m and n are odd, here 2 and 3"),
        ("S14", "m and n are odd"),
    ],
)
def test_impossible_labels(text, reason):
    with pytest.raises(ImpossibleLabelError, match=reason) as caught:
        parse(text)
    assert "\n" not in str(caught.value) and str(caught.value).startswith(f"{text} cannot be the label of a periodic orbit: ")
    assert not isinstance(caught.value, LabelSyntaxError)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (("X", 1, 1), "kind of a label is 'X', expected S, U or L"),
        (("U", 1, 1, "E", 1, 1, "+"), "parity of a U label is 'E', expected E or O for S, none for U and L"),
        (("S", 1, 1, "A", 1, 1, "+"), "parity of a S label is 'A'"),
        (("S", 1, 1, "O", 1, None, "+"), "impacts p, q of a S label are 1, None: expected both or none"),
        (("S", 1, 1, None, 1, 1, "+"), "for S only with E or O"),
        (("L", 1, 1, None, 1, 1, "+"), "none for L"),
        (("S", 1, 1, "O", 1, 1, "*"), "sign of a label is '*', expected + or -"),
        (("S", -1, 1), "m of a label is -1, expected an integer, 0 or more"),
        (("S", 1.0, 1), "m of a label is 1.0"),
    ],
)
def test_fields_that_make_no_label(fields, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        Label(*fields)


@pytest.mark.parametrize(
    ("suffix", "values"),
    [
        ("@h=1.9458,alpha=4.9065", (1.9458, 4.9065)),
        ("@alpha=4.9065,h=1.9458", (1.9458, 4.9065)),
        ("@alpha=4.9065", (None, 4.9065)),
        ("@h=1e-3", (1e-3, None)),
        ("", (None, None)),
    ],
)
def test_names(suffix, values):
    assert parse_name("U8353-" + suffix) == Name(parse("U8353-"), None, *values)
    for family in ("origin-stop+::03fa9c1e", "rest-rest:+-+:0123", "periodic:a+b-:ffff0000ffff"):
        name = parse_name(family + suffix)
        assert name == Name(None, family, *values) == parse_name(str(name))
    assert parse_name("U8353-,alpha=4.9065") == Name(parse("U8353-"), None, None, 4.9065)


POSITIVE = st.floats(min_value=1e-300, max_value=1e300)


@given(st.one_of(complete_labels(), PATTERNS), st.one_of(st.none(), POSITIVE), st.one_of(st.none(), POSITIVE))
def test_name_round_trip(label, h, alpha):
    name = Name(label, None, h, alpha)
    assert parse_name(str(name)) == name and parse(str(label)) == label


def test_latex():
    assert latex(parse("S13+")) == r"$\mathrm{S13O00}^{+}$" and latex(parse("S13+"), short=True) == r"$\mathrm{S13}^{+}$"
    assert latex(parse("U(15)578-")) == r"$\mathrm{U(15)578}^{-}$"
    assert latex(parse("U21")) == r"$\mathrm{U21}$"
    assert latex(parse("S73O33-"), short=True) == r"$\mathrm{S73O33}^{-}$"
    assert latex(parse("S13O00"), short=True) == r"$\mathrm{S13O00}$"


@given(complete_labels())
@settings(max_examples=20, deadline=None)
def test_latex_is_mathtext(label):
    from matplotlib.mathtext import MathTextParser

    assert MathTextParser("path").parse(latex(label)).width > 0


def test_nearest():
    existing = [parse("S73O33-"), parse("S13O00+"), parse("U8353-")]
    assert most_alike("U8535-", existing, 1) == ("U8353-",)
    assert most_alike("S13E11+", existing)[0] == "S13O00+" and len(most_alike("x", existing * 2)) == 3
    assert most_alike("S13", []) == ()


@given(st.lists(st.sampled_from("+-"), max_size=5).map(tuple), st.sampled_from(["rest", "stop+"]), st.integers(1, 6))
def test_covers_of_symmetric_orbits_against_their_impacts(sequence, last, count):
    """The impacts in the two quarters of a k-fold cover, read off the sequence of the impacts of the orbit itself."""
    ends = ("origin", last)
    assume(sequence or last != "rest")
    label = Label("S", 3, 5, parity(ends), len(sequence), len(sequence), "-")
    longer = cover_label(label, count)
    if count % 2:
        quarter, long_ends = sequences.unfolded_sequence(sequence, ends, count)
        assert (longer.kind, longer.parity, longer.p, longer.q) == ("S", parity(long_ends), len(quarter), len(quarter))
    else:
        quarter, _ = sequences.unfolded_sequence(sequence, ends, count)
        assert (longer.kind, longer.p, longer.q) == ("U", len(quarter), len(quarter))
    assert (longer.m, longer.n, longer.sign) == (3 * count, 5 * count, "-")


@given(IMPACTS, IMPACTS, st.integers(1, 7), SIGN)
def test_covers_of_unsymmetric_orbits_against_impact_times(p, q, count, sign):
    """Impacts placed at fractions of the period: p in (0, 1/4), q in (1/4, 1/2), the second half by reversal, then repeated."""
    assume(p + q > 0)
    half = [(k + 1) / (p + 1) for k in range(p)] + [1 + (k + 1) / (q + 1) for k in range(q)]
    period = half + [4 - time for time in half]
    times = [time + 4 * k for k in range(count) for time in period]
    longer = cover_label(Label("U", 3, 2, None, p, q, sign), count)
    assert (longer.m, longer.n) == (3 * count, 2 * count)
    assert longer.p == sum(time < count for time in times)
    assert longer.q == sum(count < time < 2 * count for time in times)
    assert longer.sign == (None if sign == "-" and count % 2 == 0 else sign)


SMALL = st.one_of(
    st.builds(
        lambda m, n, parity, p, sign: Label("S", 2 * m + 1, 2 * n + 1, parity, p + (parity == "E"), p + (parity == "E"), sign),
        st.integers(0, 2), st.integers(0, 2), st.sampled_from("EO"), st.integers(0, 3), SIGN,
    ),
    st.builds(
        lambda m, n, p, q, sign: Label("U", m, n, None, p, q + 1, sign),
        st.integers(1, 4), st.integers(1, 4), st.integers(0, 3), st.integers(0, 3), SIGN,
    ),
)  # fmt: skip


@given(SMALL, st.integers(2, 4))
def test_roots_find_what_was_turned(label, count):
    longer = cover_label(label, count)
    for sign in (longer.sign,) if longer.sign else ("+", "-"):
        whole = Label(longer.kind, longer.m, longer.n, longer.parity, longer.p, longer.q, sign)
        assert (canonical_label(label), count) in roots(whole)
        assert all(matches(cover_label(root, times), whole) and root.m * times == whole.m for root, times in roots(whole))


def test_nearest_labels_are_near_in_the_grammar():
    """Oracle: the fields by hand; U3401, which the paper prints and nothing has, beside the labels with one impact that exist, each of
    them once; what a label leaves open tells nothing apart."""
    one_impact = ["U1101+", "U2101-", "U2201+", "U3210-", "U4401+", "U4410+", "U4401-"]
    others = ["U3411-", "U3402+", "S33O11-", "S35O00+", "U3412-"]
    assert set(nearest_labels(parse("U3401"), one_impact + others, 3)) == {"U4401+", "U4401-", "U3201-"}
    assert nearest_labels(parse("U3421-"), one_impact + others, 1) == ("U3412-",)
    assert nearest_labels(parse("U8353+"), ["U8353-", "U8344+", "U6353+"], 2) == ("U8335-", "U6335+")
    # Without stops a printed S33+ has no impacts. It is listed as it is printed, not as short for S33O00+.
    assert set(nearest_labels(parse("S13+"), ["S33+", "S35+"], 2)) == {"S33+", "S35+"}
    assert nearest_labels(parse("S13O00-"), ["S13O00+", "S13E11-", "U1301-"], 1) == ("S13O00+",)
    assert nearest_labels(parse("U21"), ["U2144+", "U2201+"], 1)[0] == "U2144+"
    assert nearest_labels(parse("U21"), []) == ()


@given(complete_labels(), st.lists(complete_labels(), min_size=1, max_size=6))
def test_a_label_that_exists_is_the_nearest(label, others):
    (found,) = nearest_labels(label, [str(other) for other in (*others, label)], 1)
    assert canonical_label(parse(found)) == canonical_label(label)


def test_labels_without_roots():
    assert roots(parse("S73O33-")) == roots(parse("S13+")) == roots(parse("L33+")) == ()
    assert roots(parse("S33O11-")) == ((parse("S11-"), 3),)
    assert cover_label(parse("L11+"), 3) == parse("L11+")
    with pytest.raises(ValueError, match="complete label"):
        cover_label(parse("U21"), 2)


PINS = {name: {"h": float(i + 1), "alpha": 1.0} for i, name in enumerate(["U8353-", "S13+", "U21+", "U21-", "S73O33-", "U2201+", "U2201-"])}


@pytest.mark.parametrize(
    ("name", "of"),
    [
        ("U8353-", "U8353-"), ("U8335-", "U8353-"), ("U8353", "U8353-"), ("U8335", "U8353-"), ("S13O00+", "S13+"), ("S73O33", "S73O33-"),
        ("U21+", "U21+"), ("U21", None), ("U2201", None), ("U8353+", None), ("U83-", None), ("S73", None),
    ],
)  # fmt: skip
def test_pin_of(name, of):
    """Oracle: equivalent labels, and those that lack nothing but a sign that is not in doubt."""
    assert reference_point_of(name, parse(name), PINS) == PINS.get(of)


def test_an_id_has_its_own_pin_only():
    """Oracle: the text."""
    name = "origin-stop+:-:0123abcd"
    assert reference_point_of(name, None, PINS) is None
    assert reference_point_of(name, None, {**PINS, name: {"h": 2.0}}) == {"h": 2.0}
    assert reference_point_of("U8353-", parse("U8353-"), {name: {"h": 2.0}}) is None


@pytest.mark.parametrize(
    ("asked", "label", "expected"),
    [
        ("U(15)578-", "U(14)587-", True),
        ("U(15)578-", "U(14)586-", False),
        ("S31O11-", "S33O11-", True),
        ("S31O11-", "S33E11-", False),
        ("S31O11-", "S33O22-", False),
        ("U21+", "U1101+", True),
        ("U21+", "S13O00+", False),
        ("U4520-", "U3502+", True),
    ],
)
def test_fits_otherwise(asked, label, expected):
    """Oracle: kind, parity and impacts; half-waves and sign may differ, and so may what is left open."""
    assert fits_otherwise(parse(asked), parse(label)) == expected


def test_note():
    """Oracle: words where the labels differ, none where they are equivalent or nothing was asked for."""
    assert remark_on_name(parse("U21+"), parse("U1101+")).startswith("U21+ is the scene's name")
    for asked, label in ((parse("U8353-"), "U8335-"), (parse("U21"), "U2101-"), (None, "U1101+")):
        assert remark_on_name(asked, parse(label)) == ""
