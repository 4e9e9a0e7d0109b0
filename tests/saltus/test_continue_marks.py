"""`saltus continue --in NAME --uz`: values of the parameter, of other parameters and of measures are marked."""

import math

import numpy as np
import pytest

from tests.saltus.running import read_branch, refused, run

pytestmark = pytest.mark.usefixtures("folder")

LINEAR = ("continue", "--scene", "damped_impact_oscillator", "--set", "d=50", "--from", "rest", "--in", "w", "--range", "0.4:2")


def marks(branch):
    return [event for event in branch["events"] if event["type"] == "UZ"]


def test_values_of_a_measure_are_marked(capsys):
    """Oracle: the amplitude 0.1/sqrt((1 - w^2)^2 + 0.01 w^2) of the closed form is 0.3 at two frequencies, and its rms 0.2 at two."""
    code, out, err = run(capsys, *LINEAR, "--uz", "max:x=0.3", "--uz", "1.2,1.5", "--uz", "rms:x=0.2", "--json", "a.json")
    assert code == 0 and "max:x = 0.3" in out, err
    branch = read_branch("a.json")
    found = {}
    for event in marks(branch):
        found.setdefault(event["note"].partition(" =")[0], []).append(event["values"]["w"])
        point = branch["points"][event["point"]]
        assert point["w"] == event["values"]["w"] and event["bracket"][0] <= event["arclength"] <= event["bracket"][1]
    assert sorted(found["w"]) == pytest.approx([1.2, 1.5], abs=1e-12)
    for column, value in (("max:x", 0.3), ("rms:x", 0.2 * math.sqrt(2.0))):
        b, c = 0.01 - 2.0, 1.0 - (0.1 / value) ** 2  # of w^4 + b w^2 + c = 0
        exact = [math.sqrt((-b + sign * math.sqrt(b * b - 4.0 * c)) / 2.0) for sign in (-1.0, 1.0)]
        assert sorted(found[column]) == pytest.approx(exact, abs=1e-11)
    arclength = [point["arclength"] for point in branch["points"]]
    assert np.all(np.diff(arclength) > 0.0) and [event["id"] for event in marks(branch)] == [f"UZ{k}" for k in range(1, 7)]
    assert all(point["residual"] < 1e-12 for point in branch["points"])


def test_a_released_parameter_and_a_saved_branch_are_marked(capsys):
    """Oracle: A = 0.2 w^2; a value is marked once."""
    words = "--in", "w,A", "--keep", "A = 0.2*w**2", "--range", "0.5:0.8", "--set", "w=0.6"
    shared = "continue", "--scene", "damped_impact_oscillator", "--from", "rest", *words
    code, _, err = run(capsys, *shared, "--uz", "A=0.1", "--json", "a.json")
    assert code == 0, err
    (event,) = marks(read_branch("a.json"))
    assert event["values"]["w"] == pytest.approx(math.sqrt(0.5), abs=1e-11)
    again = "continue", "--from", "a.json", "--uz", "A=0.1", "--uz", "0.55,0.9", "--range", "0.5:0.95", "--json", "b.json"
    assert run(capsys, *again)[0] == 0
    assert [event["values"]["w"] for event in marks(read_branch("b.json"))] == pytest.approx([0.55, math.sqrt(0.5), 0.9], abs=1e-11)


@pytest.mark.parametrize("below", [0.0, 1e-8, 1e-6])
def test_a_measure_that_turns_beside_a_value(capsys, below):
    """Oracle: the closed form has its largest amplitude 1/sqrt(0.9975) at w^2 = 0.995. A little below it two frequencies have one
    amplitude, and it touches the largest one."""
    value = (1.0 - below) / math.sqrt(1.0 - 0.0025)
    words = "--uz", f"max:x={value!r}", "--uz", f"rms:x={1.001 * value / math.sqrt(2.0)!r}", "--json", "a.json"
    code, _, err = run(capsys, *LINEAR, *words)
    assert code == 0, err
    found = sorted(event["values"]["w"] for event in marks(read_branch("a.json")))
    root = math.sqrt(max((0.1 / value) ** 2 - 0.01 * 0.9975, 0.0)) if below else 0.0
    exact = [math.sqrt(0.995 - root), math.sqrt(0.995 + root)] if below else [math.sqrt(0.995)]
    assert found == pytest.approx(exact, abs=1e-9 if below else 1e-6)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("max:y=0.3", ["--uz: unknown column 'max:y'; nearest: max:x"]),
        ("1,x", ["received '1,x', expected values X1,X2,.. of the parameter, or COLUMN=X1,X2,.."]),
        ("max:x=", ["received 'max:x='"]),
        ("max:x=nan", ["received 'max:x=nan'"]),
    ],
)
def test_bad_input(capsys, value, expected):
    refused(run(capsys, *LINEAR, "--uz", value), *expected)


def notes(out):
    return [line for line in out.splitlines() if " of --uz " in line]


def test_values_that_no_family_has_are_told(capsys):
    """Oracle: the closed form of the amplitude, 0.1/sqrt((1 - w^2)^2 + 0.01 w^2), at both ends of the range and at its largest."""
    code, out, err = run(capsys, *LINEAR, "--uz", "5,1.2,0.4", "--uz", "max:x=7,0.3", "--csv", "a.csv")
    assert code == 0, err
    least = 0.1 / math.hypot(1.0 - 4.0, 0.2)
    first, second = notes(out)
    assert first == "note   w = 5 of --uz is not on the families followed: w = 0.4 to 2"
    head, _, span = second.partition(": max:x = ")
    assert head == "note   max:x = 7 of --uz is not on the families followed"
    low, high = map(float, span.split(" to "))
    assert low == pytest.approx(least, rel=1e-7) and high == pytest.approx(1.0 / math.sqrt(0.9975), rel=1e-2)


def test_values_between_two_families_and_behind_an_event_are_told(capsys):
    """Oracle: the response without impacts of the absorber ends at two grazings. Between them there is none of it."""
    words = "continue", "--scene", "absorber", "--from", "rest", "--in", "w", "--range", "0.7:2.2"
    code, out, err = run(capsys, *words, "--uz", "1,0.71", "--uz", "2.2", "--stop-at", "GR")
    assert code == 0, err
    assert notes(out) == ["note   w = 1 of --uz is not on the families followed: w = 0.7 to 0.73306435, 1.3633103 to 2.2"]


def test_values_that_a_conservative_family_does_not_reach_are_told(capsys):
    words = "continue", "S11-", "--in", "mu", "--range", "0.08:0.12", "--keep", "energy=0.8"
    code, out, err = run(capsys, *words, "--uz", "3", "--uz", "alpha=50")
    assert code == 0, err
    first, second = notes(out)
    assert first == "note   mu = 3 of --uz is not on the families followed: mu = 0.08 to 0.12"
    assert second.startswith("note   alpha = 50 of --uz is not on the families followed: alpha = ")
