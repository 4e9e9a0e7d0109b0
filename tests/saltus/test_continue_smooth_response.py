"""`saltus continue --in NAME` with springs that are not linear: starts, files, impacts beside a spring, messages."""

import math

import pytest

from tests.saltus.running import read_json, run

pytestmark = pytest.mark.usefixtures("folder")

DUFFING = """
title = "Duffing oscillator"
[parameters]
F = 7.0
w = 0.99
c = 0.1
p = 3.0
[system]
mass = [[1.0]]
damping = [["c"]]
stiffness = [[1.0]]
[[springs]]
on = "u1"
stiffness = 1.0
power = "p"
[[forces]]
load = [1.0]
amplitude = "F"
frequency = "w"
"""
STOPPED = DUFFING + "[[stops]]\nc = [1.0]\nlower = -1.0\nupper = 1.0\nrestitution = 0.8\n"


DAMPED = """
title = "two dampers that are not linear, and no spring"
[parameters]
w = 2.0
[system]
mass = [[1.0, 0.0], [0.0, 1.0]]
damping = [[0.1, 0.0], [0.0, 0.0]]
stiffness = [[2.0, -1.0], [-1.0, 2.0]]
[[dampers]]
on = "x"
damping = 0.5
power = 3
[[dampers]]
on = "y"
polynomial = [0.3, 0.0, 0.2]
[coordinates]
names = ["x", "y"]
[[forces]]
load = [1.0, 0.0]
amplitude = 0.8
frequency = "w"
"""


@pytest.fixture
def scene(folder):
    def write(text):
        (folder / "scene.toml").write_text(text, encoding="utf-8")
        return "scene.toml"

    return write


def test_a_response_is_followed_written_and_switched(capsys, scene):
    """Oracle: where the symmetry breaks, the other family has a branch point: another problem, with twice the unknowns. It begins at one
    such point, and at the other one it is its own image: it turns there by symmetry, so that no fold is beside this point."""
    words = "continue", "--scene", scene(DUFFING), "--set", "F=3", "--from", "rest", "--in", "w", "--range", "0.85:1.1"
    code, out, err = run(capsys, *words, "--json", "a.json", "--csv", "a.csv", "--plot", "a.png")
    assert code == 0 and "the half-period symmetry breaks" in out, err
    breaks = sorted(event["values"]["w"] for event in read_json("a.json")["branches"][0]["events"] if event["type"] == "SB")
    code, out, err = run(capsys, "continue", "--from", "a.json:SB1", "--json", "b.json")
    assert code == 0 and "the family is its own image from here on" in out, err
    assert len(breaks) == 2 == len(read_json("b.json")["branches"])
    for branch in read_json("b.json")["branches"]:
        points = [(event["type"], event["values"]["w"]) for event in branch["events"] if event["values"]["w"] > breaks[1] - 1e-4]
        assert points == [("BP", pytest.approx(breaks[1], abs=1e-10))]
    code, out, err = run(capsys, "show", "a.json")
    assert code == 0 and "SB1" in out, err


def test_a_power_is_a_parameter(capsys, scene):
    words = "continue", "--scene", scene(DUFFING), "--set", "F=0.3", "--set", "w=2", "--from", "rest", "--in", "p", "--range", "1:4"
    code, out, err = run(capsys, *words)
    assert code == 0 and "p = 1 to 4" in out, err


@pytest.mark.parametrize("stops", ["", "[[stops]]\nc = [1.0, 0.0]\nlower = -0.3\nupper = 0.3\nrestitution = 0.8\n"])
def test_each_damper_has_the_energy_that_it_takes(capsys, scene, stops):
    """Oracle: the simulated motion, whose budget has a sum for each damper and stop; the work of the loads is all that they take."""
    words = "--scene", scene(DAMPED + stops), "--in", "w", "--range", "2:2.1"
    code, _, err = run(capsys, "continue", *words, "--from", "simulate", "--points", 1, "--json", "a.json")
    assert code == 0, err
    point = read_json("a.json")["branches"][0]["points"][0]
    taken = {key: value for key, value in point.items() if key.startswith("dissipated.")}
    assert sum(taken.values()) == pytest.approx(point["work"], rel=1e-12)
    periods = 100
    late = []
    for count in (periods, periods + 1):
        code, _, err = run(capsys, "run", "--scene", "scene.toml", "--duration", repr(count * math.pi), "--json", "r.json")
        assert code == 0, err
        late.append(read_json("r.json")["dissipated"])
    found = {f"dissipated.{part.replace(' ', '_')}": late[1][part] - late[0][part] for part in late[0]}
    assert found == pytest.approx(taken, abs=1e-9)


def test_a_simulation_is_a_start(capsys, scene):
    """Oracle: the same branch from rest; impacts beside the spring are found by the simulation."""
    words = "continue", "--scene", scene(DUFFING), "--set", "F=0.3", "--set", "w=2", "--in", "w", "--range", "1.8:2.2"
    ends = []
    for start in ("rest", "simulate"):
        code, out, err = run(capsys, *words, "--from", start, "--json", "a.json")
        assert code == 0 and "solved over half the period" in out, err
        points = read_json("a.json")["branches"][0]["points"]
        ends.append(sorted((point["w"], point["max.u1"]) for point in (points[0], points[-1])))
    assert "a periodic motion of period 1 with 0 impacts" in out
    assert ends[1] == [pytest.approx(end, rel=1e-9) for end in ends[0]]
    words = "continue", "--scene", scene(STOPPED), "--set", "F=1.5", "--set", "w=1.5", "--in", "w", "--range", "1.4:1.6"
    code, out, err = run(capsys, *words, "--from", "simulate", "--json", "a.json")
    assert code == 0 and "a periodic motion" in out, err
    assert read_json("a.json")["branches"][0]["sequence"]


def test_a_sweep(capsys, scene):
    """Oracle: the response that is followed, by a boundary-value problem."""
    words = "--scene", scene(DUFFING), "--set", "F=0.3", "--in", "w", "--range", "2:2.2"
    code, out, err = run(capsys, "sweep", *words, "--points", 3, "--up", "--json", "s.json", "--plot", "s.png")
    assert code == 0 and not err
    swept = read_json("s.json")["points"]
    assert run(capsys, "continue", *words, "--set", "w=2", "--from", "rest", "--uz", "2.1", "--json", "a.json")[0] == 0
    branch = read_json("a.json")["branches"][0]
    followed = [branch["points"][event["point"]] for event in branch["events"]]
    assert [row["value"] for row in swept] == pytest.approx([row["w"] for row in followed], rel=1e-12)
    for key in ("max.u1", "work", "dissipated.rest"):
        assert [row[key] for row in swept] == pytest.approx([row[key] for row in followed], rel=1e-10)
    code, _, err = run(capsys, "sweep", *words, "--points", 3, "--up", "--over", "a.json", "--y", "max:u1", "--plot", "o.png")
    assert code == 0, err
