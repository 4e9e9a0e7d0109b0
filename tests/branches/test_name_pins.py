"""Which pin belongs to a name, and which orbits it may choose.

Oracles: the equivalences of labels (p and q exchanged, short names), and what is left open.
"""

import pytest

from branches.naming.labels import parse
from branches.naming.matching import fits_otherwise, reference_point_of, remark_on_name

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
