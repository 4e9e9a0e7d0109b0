"""`saltus curve` of a self-excited motion, whose period is free: curves, their continuation, switching and families from their points."""

import pytest

from tests.branches.self_excited import VALUES, exact_point
from tests.saltus.running import read_json, refused, run

SCENE = """
title = "A self-excited oscillator with an absorber"
source = "a negative damper, and one stop"

[parameters]
mu = 0.1
sigma = 0.1
lam = 0.05
c = 0.005
rho = 0.7

[system]
mass = [["mu", 0.0], [0.0, 1.0]]
damping = [["c", "-c"], ["-c", "c - lam"]]
stiffness = [["sigma", "-sigma"], ["-sigma", "1 + sigma"]]

[[stops]]
c = [1.0, -1.0]
upper = 1.0
restitution = "rho"

[coordinates]
names = ["u1", "u2"]
LO = "u2"
NES = "u1"

[bounds]
energy = [0.05, 1.0e4]
quarter_period = 10.0
impacts = 16
"""
SIMULATED = ("--from", "simulate", "--start=1.2814,0.2824,-0.6351,0.1168")
RANGE = ("--in", "lam,rho", "--range", "0:0.5,0.1:0.95")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The response over lam, and its curve of folds."""
    from saltus.__main__ import main

    folder = tmp_path_factory.mktemp("curves")
    scene, response, fold = folder / "scene.toml", folder / "response.json", folder / "fold.json"
    scene.write_text(SCENE, encoding="utf-8")
    assert main(["continue", "--scene", str(scene), *SIMULATED, "--in", "lam", "--range", "0.001:0.3", "--json", str(response)]) == 0
    assert main(["curve", f"{response}:SN1", *RANGE, "--json", str(fold)]) == 0
    return {"response": response, "fold": fold}


def test_a_fold_and_the_torus_that_begins_on_it(files, folder, capsys):
    """Oracle: forty digits; both curves have the 1:1 resonance, to 1e-9."""
    fold = read_json(files["fold"])["curves"][0]
    code, out, err = run(capsys, "curve", f"{files['fold']}:R1-1", "--to", "NS", "--range", "0:0.5,0.1:0.95", "--json", "ns.json")
    assert code == 0, err
    torus = read_json("ns.json")["curves"][0]
    places = [[event["values"]["lam"], event["values"]["rho"]] for one in (fold, torus) for event in one["events"] if event["type"] == "R1"]
    assert len(places) == 2 and places[0] == pytest.approx(places[1], abs=1e-9)
    for one, kind in ((fold, "SN"), (torus, "NS")):
        point = one["points"][len(one["points"]) // 2]
        lam, rho = point["parameters"]
        period = point["unknowns"][0]  # of one flight; then come the state, lam and rho
        assert lam == pytest.approx(exact_point(kind, VALUES | {"lam": lam, "rho": rho}, period, 1, "lam")[0], rel=1e-11)


def test_bad_input(files, folder, capsys):
    """Contract: the line names what is missing."""
    refused(run(capsys, "chart", "--in", "lam,rho", "--from", str(files["response"])), "has no responses to periodic loads", "saltus curve")
    refused(run(capsys, "curve", f"{files['response']}:SN1", "--in", "lam,w", "--range", "0:1,0:1"), "unknown parameter w")
