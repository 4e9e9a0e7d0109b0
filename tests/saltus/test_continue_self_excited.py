"""`saltus continue --in NAME` of systems without periodic loads: the period is free, and the motion feeds itself."""

import csv
import math

import numpy as np
import pytest

from bvp.system import ImpactSystem, Stop
from tests.branches.test_forced_closures import closed_form
from tests.saltus.running import read_branch, refused, run
from transitions.response.free import settle_free

SCENE = """
title = "A self-excited oscillator with a stop"
source = "x'' - c x' + x = g, x <= 1"

[parameters]
c = 0.1
r = 0.6
g = 0.0

[system]
mass = [[1.0]]
damping = [["-c"]]
stiffness = [[1.0]]

[[stops]]
c = [1.0]
upper = 1.0
restitution = "r"

[[forces]]
on = "x"
constant = "g"

[coordinates]
names = ["x"]
LO = "x"

[bounds]
energy = [0.05, 20.0]
quarter_period = 8.0
impacts = 4
"""
SIMULATED = ("continue", "--scene", "scene.toml", "--from", "simulate", "--in", "r", "--range", "0.3:0.8")
DAMPED = ("continue", "--scene", "scene.toml", "--from", "simulate", "--in", "c", "--range=-0.2:0.3", "--set", "c=-0.1")


@pytest.fixture(autouse=True)
def scene(folder):
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")


def test_a_self_excited_motion_is_followed(capsys):
    """Oracle: two equations in thirty digits; the nontrivial multiplier r^2 exp(c T) is below 1, so the motion is stable."""
    code, out, err = run(capsys, *SIMULATED, "--start", "0.5,0", "--json", "a.json", "--csv", "a.csv", "--plot", "a.png", "--y", "period")
    assert code == 0, err
    assert out.startswith("start  a periodic motion with 1 impacts, T = 4.614437763, after 64 impacts")
    assert "branch 1: sequence +; free period;" in out
    found = read_branch("a.json")["points"]
    assert found[0]["r"] == pytest.approx(0.3, abs=1e-10) and found[-1]["r"] == pytest.approx(0.8, abs=1e-10)
    for point in found[::60]:
        speed, period = closed_form(0.1, point["r"], 0.0, point["speed"][0], point["period"])
        assert point["speed"][0] == pytest.approx(speed, rel=1e-11) and point["period"] == pytest.approx(period, rel=1e-11)
        moduli = sorted(math.hypot(*multiplier) for multiplier in point["multipliers"])
        assert moduli == pytest.approx(sorted([1.0, point["r"] ** 2 * math.exp(0.1 * period)]), abs=1e-9)
        assert point["dissipated.stop_a"] == pytest.approx(0.5 * (1.0 - point["r"] ** 2) * speed**2, rel=1e-9)
        assert point["dissipated.rest"] == pytest.approx(-point["dissipated.stop_a"], rel=1e-9)  # what the damper gives
    assert all(point["stable"] for point in found[1:-1])
    code, out, err = run(capsys, "continue", "--from", "a.json", "--in", "c", "--range", "0.09:0.11", "--csv", "b.csv")
    with open("b.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert code == 0 and float(rows[-1]["c"]) == pytest.approx(0.11, abs=1e-10), err
    assert float(rows[-1]["period"]) == pytest.approx(closed_form(0.11, 0.6, 0.0, float(rows[-1]["speed"]), 4.6)[1], rel=1e-11)


def test_a_motion_grows_without_bound_where_the_stop_loses_too_little(capsys):
    """Oracle: far out the stop is at the middle of the vibration: growth by r exp(c T/2) in half a period T = 2 pi/w, w^2 = 1 - c^2/4. The
    steps grow with the motion."""
    grown = tuple("0.82:0.9" if word == "0.3:0.8" else word for word in SIMULATED)
    code, out, _ = run(capsys, *grown, "--start", "0.5,0", "--set", "r=0.84")
    assert code == 0 and "the motion grows without bound, at r = " in out
    limit = math.exp(-0.05 * math.pi / math.sqrt(1.0 - 0.0025))
    assert float(out.partition("without bound, at r = ")[2].split()[0]) == pytest.approx(limit, abs=1e-9)
    assert int(out.partition("free period; ")[2].partition(" points")[0]) < 1500
    code, _, err = run(capsys, *grown, "--start", "0.5,0", "--set", "r=0.9")
    growth = float(err.partition("growth ")[2].partition(" ")[0])
    assert code == 1 and "the motion grows without bound" in err
    assert growth == pytest.approx(math.log(0.9 / limit), rel=1e-2)


def test_a_symmetric_motion_is_solved_over_half_its_period(capsys, folder):
    """Oracle: the flight from (-1, r v) to (1, v), in closed form."""
    (folder / "scene.toml").write_text(SCENE.replace("upper = 1.0", "upper = 1.0\nlower = -1.0"), encoding="utf-8")
    code, out, err = run(capsys, *SIMULATED, "--start", "0.5,0", "--points", "40", "--json", "a.json")
    assert code == 0 and "solved over half of the period" in out, err
    for point in read_branch("a.json")["points"][::10]:
        c, speed, half = 0.05, point["speed"][0], point["period"] / 2.0
        w = math.sqrt(1.0 - c * c)
        a, b = -1.0, (point["r"] * speed + c) / w
        grow, cosine, sine = math.exp(c * half), math.cos(w * half), math.sin(w * half)
        end = grow * (a * cosine + b * sine)
        assert end == pytest.approx(1.0, abs=1e-11)
        assert c * end + grow * w * (b * cosine - a * sine) == pytest.approx(speed, abs=1e-11)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (SIMULATED, "no impacting motion: nothing moves or no stop is reached, after 0 impacts; expected another state in --start"),
        ((*DAMPED, "--start", "0.6,0"), "no impacting motion: nothing moves or no stop is reached"),
        ((*DAMPED, "--start", "0.6,0", "--set", "g=1.5"), "it sticks to + for ever, after 17 impacts"),
    ],
)
def test_what_has_no_periodic_motion_ends_with_1(capsys, words, expected):
    code, out, err = run(capsys, *words)
    assert code == 1 and out == "" and expected in err


def test_bad_input(capsys, folder):
    refused(run(capsys, *SIMULATED, "--start", "0.5,0", "--phase", "1"), "--phase counts in periodic loads, and the scene has none")
    refused(run(capsys, *SIMULATED, "--start", "1.5,0"), "the start lies beyond stop", "expected -inf to 1")
    rest = tuple("rest" if word == "simulate" else word for word in SIMULATED)
    refused(run(capsys, *rest), "--from rest is the response to periodic loads, and the scene's loads are constant", "--from simulate")
    refused(run(capsys, *SIMULATED, "--set", "c=0", "--set", "r=1", "--range", "0:1"), "--from simulate needs periodic loads or losses")
    spring = '[[springs]]\non = "x"\npolynomial = [0.0, 0.0, 1.0]\n[coordinates]\nnames = ["x"]\n'
    free = SCENE.partition("[[stops]]")[0].replace("r = 0.6\ng = 0.0\n", "") + spring
    (folder / "scene.toml").write_text(free, encoding="utf-8")
    refused(run(capsys, *DAMPED, "--start", "0.5,0"), "starts at impacts, and the scene has no stops; expected [[stops]]", "or saltus run")


def test_motions_that_do_not_settle_are_reported_with_their_rate():
    """Oracle: two uncoupled self-excited oscillators of incommensurate frequencies make a torus; their common motion returns never."""
    stops = [Stop((1.0, 0.0), upper=1.0, restitution=0.6), Stop((0.0, 1.0), upper=1.0, restitution=0.6)]
    system = ImpactSystem(np.eye(2), -0.1 * np.eye(2), np.diag([1.0, 2.0]), stops)
    found = settle_free(system, [], [0.5, 0.4], [0.0, 0.0])
    assert found.kind.name == "NOT_CONVERGED"
    assert found.text.startswith("it has not settled (after 16384 impacts; a return after ")
    assert found.text.endswith("it converges slowly, or it is a torus or chaos") and found.distance > 1e-6


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_motion_without_a_frequency_settles_in_each_unit_of_time(unit):
    """Oracle: x'' = x'/10 between stops at -1 and 1, r = 0.9: after impacts v = 0.9 (v + 0.2) = 1.8, and T = 20 ln(2/1.8)."""
    system = ImpactSystem([[1.0]], [[-0.1 / unit]], [[0.0]], [Stop((1.0,), lower=-1.0, upper=1.0, restitution=0.9)])
    found = settle_free(system, [], [0.0], [1.0 / unit])
    assert found.period_of_loads == pytest.approx(20.0 * math.log(2.0 / 1.8) * unit, rel=1e-9)
