"""`saltus continue --in NAME` beyond the ends of a file, in one direction, up to an event, and until it is interrupted."""

import csv

import numpy as np
import pytest

from saltus.terminal import ProgressBar
from tests.saltus.running import read_json, refused, run

pytestmark = pytest.mark.usefixtures("folder")

STARTED = ("continue", "--scene", "impact_oscillator", "--set", "s=-0.2", "--from", "simulate", "--start=-0.66,0", "--in", "s")
PD, SN = -0.0685756522788391, -1.78023560132159
"""Design section 9: (w, r, n) = (2.8, 0.8, 1)."""


def values(branch):
    return {event["id"]: event["values"]["s"] for event in branch["events"]}


def require_in_order(branch):
    """Arclength rises, and each event is at its point and in its bracket."""
    arclength = [point["arclength"] for point in branch["points"]]
    assert arclength[0] == 0.0 and np.all(np.diff(arclength) > 0.0)
    for event in branch["events"]:
        assert event["arclength"] == pytest.approx(arclength[event["point"]], abs=1e-9)
        assert event["bracket"][0] - 1e-9 <= event["arclength"] <= event["bracket"][1] + 1e-9
        assert event["values"]["s"] == branch["points"][event["point"]]["s"]


def test_points_are_counted_anew_beyond_an_end(capsys):
    """Oracle: a branch of 10 points and 12 more; its direction."""
    assert run(capsys, *STARTED, "--range=-0.4:0", "--points", "10", "--json", "a.json")[0] == 0
    code, _, err = run(capsys, "continue", "--from", "a.json", "--points", "12", "--direction", "up", "--json", "b.json")
    (first,), (further,) = read_json("a.json")["branches"], read_json("b.json")["branches"]
    assert code == 0 and len(further["points"]) == 10 + 12 - 1, err
    require_in_order(further)
    (low, high), (new_low, new_high) = ([min(p["s"] for p in b["points"]), max(p["s"] for p in b["points"])] for b in (first, further))
    assert low == new_low and high < new_high
    code, out, _ = run(capsys, "continue", "--from", "a.json", "--direction", "down", "--stop-at", "SN", "--range=-3:1", "--json", "c.json")
    (down,) = read_json("c.json")["branches"]
    assert code == 0 and values(down)["SN1"] == pytest.approx(SN, abs=1e-12) and "an event of a type to stop at was reached" in out
    assert max(p["s"] for p in down["points"]) == high


@pytest.mark.parametrize(("way", "other"), [("up", "min"), ("down", "max")])
def test_a_direction_is_that_of_the_first_step(capsys, way, other):
    """Oracle: the parameter of the start bounds the branch before the first fold."""
    code, out, err = run(capsys, *STARTED, "--range=-0.4:0", "--direction", way, "--json", "a.json")
    assert code == 0 and "this direction was not asked for" in out, err
    (branch,) = read_json("a.json")["branches"]
    assert {"min": min, "max": max}[other](point["s"] for point in branch["points"]) == pytest.approx(-0.2, abs=1e-12)


def test_a_family_begins_at_its_event(capsys):
    """Oracle: the words; the event's value."""
    assert run(capsys, *STARTED, "--range=-0.4:0", "--json", "a.json")[0] == 0
    code, out, err = run(capsys, "continue", "--from", "a.json:PD", "--points", "10", "--json", "b.json")
    assert code == 0 and "end    the family begins at PD1 of a.json, s = -0.068575652278" in out, err
    assert "not asked for" not in out
    (branch,) = read_json("b.json")["branches"]
    end = branch["ended"][0]
    assert end["reason"] == "EVENT" and end["text"].startswith("the family begins at PD1 of a.json, s = -0.068575652278")
    code, _, err = run(capsys, "continue", "--from", "b.json", "--points", "10", "--json", "c.json")
    assert code == 0 and read_json("c.json")["branches"][0]["points"][0] == branch["points"][0], err


def test_an_interrupted_run_writes_what_it_has(capsys, monkeypatch):
    """Oracle: the exit code 130; the points reported before, and the rest of their block; the family goes on from the file."""

    came = []

    def interrupt(self, count, more=""):
        if self._things == "points" and count >= 50 and not came:
            came.append(count)
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(ProgressBar, "update", interrupt)
        code, out, err = run(capsys, *STARTED, "--range=-3:1", "--json", "a.json", "--csv", "a.csv")
    assert code == 130 and err == "saltus: interrupted, with the points that were computed so far\n"
    (branch,) = read_json("a.json")["branches"]
    assert 50 <= len(branch["points"]) < 200 and {end["reason"] for end in branch["ended"]} == {"INTERRUPTED"}
    require_in_order(branch)
    assert "the run was interrupted here" in out and "wrote  a.csv" in out
    code, _, err = run(capsys, "continue", "--from", "a.json", "--json", "b.json")
    assert code == 0 and values(read_json("b.json")["branches"][0])["PD1"] == pytest.approx(PD, abs=1e-12), err


DOMAIN = """
title = "An oscillator with a load"
source = "x'' + 0.1 x' + x = 0.3 cos(1.6 t)"

[parameters]
a = 0.8
w = 1.6
b = 1.0

[system]
mass = [[{mass}]]
damping = [[0.1]]
stiffness = [[1.0]]

[[stops]]
c = [1.0]
upper = -0.1
restitution = {restitution}

[[forces]]
on = "x"
amplitude = "0.3*b"
harmonic = 1

[coordinates]
names = ["x"]
LO = "x"

[bounds]
energy = [0.05, 20.0]
quarter_period = 8.0
impacts = 4
"""


@pytest.mark.parametrize(
    ("name", "texts", "bound", "words"),
    [("a", ("1.0", '"a"'), 1.0, "a leaves its domain here"), ("a", ("1.0", '"1.25*a"'), 0.8 / 0.8, "restitution lies in [0, 1]")],
)
def test_a_family_ends_where_the_system_ends(capsys, folder, name, texts, bound, words):
    """Oracle: see `require_a_family_ends_where_the_system_ends`."""
    require_a_family_ends_where_the_system_ends(capsys, folder, name, texts, bound, words)


def require_a_family_ends_where_the_system_ends(capsys, folder, name, texts, bound, words):
    """Oracle: restitution 1."""
    text = DOMAIN.format(mass=texts[0], restitution=texts[1])
    if "1.25" in texts[1]:
        text, bound = text.replace("a = 0.8", "a = 0.6"), 0.8
    if "/b" not in texts[1]:
        text = text.replace("0.3*b", "0.3").replace("b = 1.0\n", "")
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    words_of = "continue", "--scene", "scene.toml", "--from", "simulate", "--start=-0.5,0", "--in", name, "--range", "0.1:1.3"
    code, out, err = run(capsys, *words_of, "--direction", "up", "--csv", "a.csv")
    assert code == 0 and words in out, (out, err)
    with open("a.csv", encoding="utf-8") as file:
        *_, last = csv.DictReader(file)
    assert float(last[name]) == pytest.approx(bound, abs=1e-7)


CASES = [
    (("--frequency", "index"), ["--frequency belongs to families in the energy"]),
    (("--energy", "1:2"), ["--energy belongs to families in the energy"]),
    (("--stop-at", "RT"), ["--stop-at RT: a response has no such event; expected one of SN, BP"]),
    (("--stop-at", "XX"), ["'XX'", "SN"]),
    (("--direction", "left"), ["'left'", "up, down, both"]),
]


@pytest.mark.parametrize(("words", "expected"), CASES)
def test_options_that_a_response_has_not_are_refused(capsys, words, expected):
    refused(run(capsys, *STARTED, "--range=-0.4:0", *words), *expected)


def test_starts_that_a_response_has_not_are_refused(capsys, folder):
    refused(run(capsys, "continue", "--scene", "absorber", "--from", "mode:1", "--in", "w", "--range", "0.7:2"), "mode:1", "--from rest")
    assert run(capsys, *STARTED, "--range=-0.4:0", "--json", "a.json")[0] == 0
    refused(run(capsys, "continue", "--from", "a.json:PD", "--direction", "up"), "--direction up: families lead away from the event PD")
    refused(run(capsys, "continue", "--from", "none.json:GR1", "--uz", "0.3"), "no file none.json; expected a JSON file")
    refused(run(capsys, "continue", "S13O00+", "--stop-at", "UZ"), "--stop-at UZ: values are marked along a response")


def test_the_model_of_a_response_is_printed(capsys):
    code, out, _ = run(capsys, *STARTED, "--range=-0.4:0", "--points", "3", "--model")
    assert code == 0 and "model  periodic loads -> the period is a multiple of theirs" in out
