"""Long cases of tests/saltus/test_continue_smooth_response.py."""

import pytest

from tests.saltus import test_continue_smooth_response as origin
from tests.saltus.running import read_json, run
from tests.saltus.test_continue_smooth_response import STOPPED

pytestmark = origin.pytestmark
scene = origin.scene


def test_impacts_begin_where_the_response_grazes(capsys, scene):
    """Oracle: the family with impacts begins a step from the touch of the response."""
    words = "continue", "--scene", scene(STOPPED), "--set", "F=0.3", "--set", "w=1.2", "--from", "rest", "--in", "w", "--range", "1:2"
    code, out, err = run(capsys, *words, "--through", "GR", "--points", "60", "--json", "a.json")
    assert code == 0 and "a new impact becomes possible" in out, err
    branches = read_json("a.json")["branches"]
    grazing = next(event for event in branches[0]["events"] if event["type"] == "GR")
    behind = next(branch for branch in branches if branch["sequence"])
    assert behind["points"][0]["w"] == pytest.approx(grazing["values"]["w"], abs=2e-3)


def test_a_free_family_is_followed_in_a_stiffness(capsys, recwarn):
    """Oracle: without the cubic spring (k3 -> 0.1 is near) the quarter period is nearly that of the mode, pi/2; it falls with k3."""
    words = "continue", "--scene", "duffing_pair", "--from", "mode:1", "--in", "k3", "--keep", "energy=0.5", "--range", "0.1:1"
    code, out, err = run(capsys, *words, "--csv", "a.csv")
    arithmetic = [one for one in recwarn.list if issubclass(one.category, RuntimeWarning)]
    assert code == 0 and "k3 = 0.1 to 1" in out and not arithmetic, err
    rows = [line.split(",") for line in open("a.csv", encoding="utf-8").read().splitlines()]
    place = rows[0].index("alpha")
    alphas = [float(row[place]) for row in rows[1:]]
    assert alphas == sorted(alphas, reverse=True) and 1.55 < alphas[0] < 1.5708 and alphas[-1] == pytest.approx(1.473671404, abs=1e-8)
