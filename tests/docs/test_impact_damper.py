"""The numbers of docs/tutorial/impact_damper.md. Oracles: the closed form of one impact a half period, and its formed saltation product."""

import re
from pathlib import Path

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

import saltus
from benchmarks.backbone import OneImpact
from tests.saltus.running import read_json, run

PAGE = (Path(__file__).parents[2] / "docs" / "tutorial" / "impact_damper.md").read_text(encoding="utf-8")
SYSTEM = saltus.load_scene("impact_damper").system
TOUCH = 0.5 * np.pi
"""Quarter period of the mode, which begins both families where it touches the stop."""
DOWN = (2.3 * TOUCH, 2.99 * TOUCH)
"""Quarter periods between which the energy of the family of the three-fold cover falls and rises again."""


def energy(alpha):
    return float(OneImpact(SYSTEM).two_sided(alpha)[0])


def lowest(low, high):
    """The quarter period of least energy."""
    return minimize_scalar(energy, bounds=(low, high), method="bounded", options={"xatol": 1e-9}).x


def trace(alpha):
    """Trace of the nontrivial multipliers of half a period: below -2 a symmetry is broken, above 2 the orbits are behind a fold."""
    _, _, v = OneImpact(SYSTEM).two_sided(alpha)
    start = np.array([0.0, 0.0, *map(float, v)])
    inverse, row = np.linalg.inv(SYSTEM.mass), np.array(SYSTEM.stops[0].gap)
    flow = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ SYSTEM.stiffness, np.zeros((2, 2))]])
    quarter = expm(flow * alpha)
    before = quarter @ start
    kick = np.eye(2) - 2.0 * np.outer(inverse @ row, row) / (row @ inverse @ row)
    reset = np.block([[np.eye(2), np.zeros((2, 2))], [np.zeros((2, 2)), kick]])
    speed = row @ before[2:]
    saltation = reset + np.outer(flow @ reset @ before - reset @ flow @ before, [*row, 0.0, 0.0]) / speed
    return -np.trace(quarter @ saltation @ quarter) - 2.0


def test_the_family_of_the_mode():
    """Oracle: the closed form: it touches at h = 1/2, and its energy is least at the saddle-node, beyond which |trace| < 2."""
    fold = lowest(0.5 * TOUCH, 0.99 * TOUCH)
    assert abs(energy(TOUCH * (1.0 - 1e-9)) - 0.5) < 1e-6 and "begin where the container reaches it, at h = 1/2" in PAGE
    assert f"saddle-node at h = {energy(fold):.5g} on it is stable" in PAGE
    assert trace(1.01 * fold) > 2.0 and all(abs(trace(alpha)) < 2.0 for alpha in np.linspace(0.05, 0.99 * fold, 50))


def test_the_family_of_the_three_fold_cover():
    """Oracle: the closed form; the edges of stability, where the trace is 2 or -2."""
    assert abs(energy(3.0 * TOUCH * (1.0 - 1e-9)) - 0.5) < 1e-6 and "h = 1/2, too" in PAGE and "alpha = 3 pi/2" in PAGE
    fold = lowest(*DOWN)
    places = np.linspace(1.68, fold - 1e-3, 200)
    values = [trace(alpha) for alpha in places]
    edges = [
        brentq(lambda alpha: trace(alpha) + 2.0, a, b)
        for a, b, one, other in zip(places[:-1], places[1:], values[:-1], values[1:], strict=True)
        if (one + 2.0) * (other + 2.0) < 0.0
    ]
    assert trace(fold + 1e-2) > 2.0 and max(values) < 2.0 and len(edges) == 3
    third, second, first = (f"{energy(alpha):.5g}" for alpha in edges)
    words = f"falls to {energy(fold):.5g}, its saddle-node, and rises again. It is stable from there to h = {first}, and from {second}"
    assert f"{words} to {third}." in " ".join(PAGE.split())


def test_both_starts_lead_to_one_family(capsys, tmp_path):
    """Oracle: the id, and the energy of the saddle-node; the command lines are those of the page."""
    ids = []
    for words in re.findall(r"^saltus (continue .*--energy.*)$", PAGE, re.MULTILINE):
        code, _, err = run(capsys, *words.split(), "--json", tmp_path / "a.json")
        assert code == 0, err
        data = read_json(tmp_path / "a.json")
        ids.append(data["branch"]["id"])
    assert len(ids) == 2 and len(set(ids)) == 1
