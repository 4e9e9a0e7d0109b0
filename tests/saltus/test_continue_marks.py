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
