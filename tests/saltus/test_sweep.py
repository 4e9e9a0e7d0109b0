"""`saltus sweep`: options, files, messages, exit codes."""

import csv
import json

import numpy as np
import pytest

from saltus.__main__ import main

SCENE = """
title = "an oscillator with a stop"

[parameters]
A = 0.2
w = 1.0
c = 0.1
r = 0.8
s = 1.0

[system]
mass = [[1.0]]
damping = [["c"]]
stiffness = [[1.0]]

[[stops]]
c = [1.0]
upper = "s"
restitution = "r"

[[forces]]
on = "u1"
amplitude = "A"
harmonic = 1

[bounds]
energy = [0.05, 10.0]
quarter_period = 5.0
impacts = 5
"""
SHORT = ["--points", "4", "--transient", "150", "--record", "6"]


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "oscillator.toml").write_text(SCENE, encoding="utf-8")
    return "oscillator.toml"


def run(*words):
    return main(["sweep", *map(str, words)])


def test_both_ways_by_default_and_all_files(scene, capsys):
    """Oracle: the linear response A/c below the grazing; CSV, JSON, NPZ have the same numbers."""
    files = ["--json", "a.json", "--csv", "a.csv", "--npz", "a.npz", "--mat", "a.mat", "--plot", "a.png"]
    assert run("--scene", scene, "--in", "A", "--range", "0.05:0.2", *SHORT, *files) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].split() == ["sweep", "A", "from", "to", "values", "period", "impacts", "exponent"]
    data = json.loads(open("a.json", encoding="utf-8").read())
    rows = data["points"]
    assert data["parameter"] == "A" and data["range"] == [0.05, 0.2] and data["transient"] == 150 and data["parts"][-1] == "stop a"
    assert [row["direction"] for row in rows] == ["up"] * 4 + ["down"] * 4
    assert abs(rows[0]["max.u1"] - 0.5) < 1e-3 and rows[0]["impacts"] == 0.0 and rows[3]["impacts"] > 0.0
    with open("a.csv", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert float(lines[3]["exponent"]) == rows[3]["exponent"]
    arrays = np.load("a.npz")
    assert arrays["value"].tolist() == [row["value"] for row in rows] and len(arrays["strobe_u.u1"]) == 48
    assert json.loads(str(arrays["about"]))["coordinates"] == ["u1"]


def test_one_way_from_two_starts(scene, capsys):
    starts = ["--start", "0,0", "--start", "0.5,-.1"]
    assert run("--scene", scene, "--in", "w", "--range", "0.9:1.1", "--down", *starts, *SHORT, "--csv", "-") == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert [(row["direction"], row["start"]) for row in rows] == [("down", "1")] * 4 + [("down", "2")] * 4
    assert float(rows[0]["value"]) == float(rows[0]["frequency"]) == 1.1


def test_a_sticking_motion_has_no_exponent_but_a_mark(scene, capsys):
    """JSON has no infinity: null, and `vanishing`."""
    command = ["--scene", scene, "--in", "r", "--range", "0:0.1", "--up", "--set", "s=-0.5", "--set", "A=0.2", *SHORT, "--json", "-"]
    assert run(*command) == 0
    row = json.loads(capsys.readouterr().out)["points"][0]
    assert row["exponent"] is None and row["vanishing"] == 1 and row["sticking"] > 0.0


def test_the_model_is_explained(scene, capsys):
    assert run("--scene", scene, "--in", "A", "--range", "0.05:0.06", "--up", "--model", *SHORT) == 0
    assert "harmonic -> each load" in capsys.readouterr().out


def test_states_that_were_moved_are_reported(scene, capsys):
    assert run("--scene", scene, "--in", "s", "--range=-1.5:1", "--down", "--points", "2", "--transient", "50", "--record", "3") == 0
    assert "moved    at 1 values the new stop was beyond the state" in capsys.readouterr().out


def test_a_range_need_not_contain_the_present_value(scene):
    assert run("--scene", scene, "--in", "A", "--range", "0.01:0.02", "--up", *SHORT) == 0


def test_a_simulation_that_ends_is_reported_and_the_rest_written(scene, capsys, tmp_path):
    """Two masses that hit two stops at once, which act on each other: exit code 1, and empty rows."""
    text = """
[parameters]
A = 0.0
w = 1.0

[system]
mass = [[1.0, 0.0], [0.0, 1.0]]
stiffness = [[0.0, 0.0], [0.0, 0.0]]

[[stops]]
c = [1.0, 0.0]
lower = -1.0
restitution = 0.9

[[stops]]
c = [1.0, 1.0]
lower = -1.0
restitution = 0.9

[[forces]]
on = "u2"
amplitude = "A"
harmonic = 1

[bounds]
energy = [0.05, 10.0]
quarter_period = 5.0
impacts = 5
"""
    (tmp_path / "corner.toml").write_text(text, encoding="utf-8")
    command = ["--scene", "corner.toml", "--in", "w", "--range", "1:2", "--points", "2", "--up", "--start=0,0,-1,0", "--json", "a.json"]
    assert run(*command) == 1
    assert "2 of 2 values have no result: two stops are hit at the same instant" in capsys.readouterr().err
    rows = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))["points"]
    assert all(row["ended"] == "simultaneous" and row["exponent"] is None and row["strobe_u.u1"] == [] for row in rows)
