"""Long cases of tests/saltus/test_continue_response.py."""

import math
import re

import pytest

from tests.saltus import test_continue_response as origin
from tests.saltus.running import read_json, refused, run
from tests.saltus.test_continue_response import require_no_step_leads_over_a_resonance

pytestmark = origin.pytestmark


@pytest.mark.parametrize("stop", [5.0, 1e3, 1e6])
def test_no_step_leads_over_a_resonance(capsys, stop):
    """Oracle: see `require_no_step_leads_over_a_resonance`."""
    require_no_step_leads_over_a_resonance(capsys, stop)


KEPT = ("continue", "--scene", "damped_impact_oscillator", "--in", "w,A", "--keep", "A = 0.2*w**2")


def test_two_parameters_move_along_an_equation(capsys):
    """Oracle: the response grazes where 0.2 w^2 = sqrt((1 - w^2)^2 + (0.1 w)^2), the amplitude of the closed form at the stop x = 1."""
    code, out, err = run(capsys, *KEPT, "--set", "w=0.5", "--from", "rest", "--range", "0.4:2", "--json", "a.json", "--csv", "a.csv")
    assert code == 0, err
    assert out.startswith("keep   A = 0.05 at w = 0.5, from --keep; the scene has 0.1")
    first = read_json("a.json")["branches"][0]
    assert (first["released"], first["keep"]) == (["w", "A"], ["A = 0.2*w**2"])
    (grazing,) = [event["values"] for event in first["events"] if event["type"] == "GR"]
    a, b = 1.0 - 0.2**2, 0.1**2 - 2.0  # of a w^4 + b w^2 + 1 = 0
    assert grazing["w"] == pytest.approx(math.sqrt((-b - math.sqrt(b * b - 4.0 * a)) / (2.0 * a)), abs=1e-12)
    assert all(point["A"] == pytest.approx(0.2 * point["w"] ** 2, rel=1e-13) for point in first["points"])
    code, out, err = run(capsys, "continue", "--from", "a.json:GR1", "--points", "20", "--json", "b.json")
    assert code == 0 and read_json("b.json")["branches"][0]["keep"] == ["A = 0.2*w**2"], err
    code, out, err = run(capsys, "continue", "--from", "b.json", "--in", "A", "--range", "0.01:0.5", "--points", "20")
    assert code == 0 and "A = " in out, err
    words = "--from", "b.json", "--in", "c,A", "--range", "0.05:0.2", "--points", "20"
    unequal = "--keep: A = c does not hold at the orbit, which has c = 0.1"
    refused(run(capsys, "continue", *words, "--keep", "A = c"), unequal, "expected A = 0.1")


def test_a_ball_that_rests_on_its_table_at_phase_0_is_followed(capsys):
    """Oracle: the table lifts the ball if Gamma is above 1. Rounding leaves the resting ball a little below the table."""
    words = "--set", "Gamma=1.2", "--from", "simulate", "--in", "Gamma", "--range", "0.9:1.5"
    code, out, err = run(capsys, "continue", "--scene", "bouncing_ball", *words)
    assert code == 0, err
    (row,) = (line.split() for line in out.splitlines() if line.startswith("GR"))
    assert float(row[1]) == pytest.approx(1.0, abs=1e-9)


STIFF = """
title = "oscillator with a stop near rest"
source = "a test"
parameters = { m = 2.0, c = 5.0, k = 8000.0, r = 0.7, w = 60.0 }
system = { mass = [["m"]], damping = [["c"]], stiffness = [["k"]] }
stops = [{ c = [1.0], upper = 0.0015, restitution = "r" }]
forces = [{ on = "x", amplitude = 10.0, harmonic = 1 }]
coordinates = { names = ["x"] }
"""


def test_period_doublings_beside_huge_multipliers_are_real(capsys, tmp_path):
    """Multipliers reach 1e44. Oracle: with one degree of freedom the product of the multipliers is below 1 in modulus, so that -1 is the
    largest one at a period doubling; and each is one of the wider problem."""
    (tmp_path / "stiff.toml").write_text(STIFF)
    words = "--scene", str(tmp_path / "stiff.toml"), "--from", "rest", "--in", "w", "--range", "30:120", "--through", "GR,PD"
    code, out, err = run(capsys, "continue", *words)
    # Behind one of the grazings no family is found, which is exit code 1.
    assert code in (0, 1) and "no bifurcation of the wider problem" not in err + out, err
    doublings = [line.split() for line in out.splitlines() if re.match(r"PD\d", line)]
    assert len(doublings) >= 8 and all(abs(float(row[2]) - 1.0) < 1e-6 for row in doublings)
