"""Long cases of tests/branches/test_free_curves.py."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import backbone
from branches.curves.free_start import released_of
from branches.curves.starting import curve_start
from branches.curves.tracing import follow_curve
from tests.branches import test_free_curves as origin
from tests.branches.curve_oracles import ReferenceBackbone, breaking_turn, double_breaking, internal_resonances
from tests.branches.test_free_curves import (
    FREE,
    breaking,
    distance,
    followed,
    of_type,
    places,
    require_fold_of_the_out_of_phase_backbone,
    require_reference,
    start,
)

branches = origin.branches
one_sided = origin.one_sided


@pytest.mark.parametrize(("name", "low"), [("mu", 0.02), ("sigma", 0.05)])
def test_fold_of_the_out_of_phase_backbone(branches, name, low):
    require_fold_of_the_out_of_phase_backbone(branches, name, low)


def test_curve_of_orbits_without_half_period_symmetry_ends_at_the_double_breaking(branches):
    """The orbits become symmetric there, and the curve of their symmetry breaking would go back as its image."""
    problem, y = released_of(branches["U21-"].orbit(of_type(branches["U21-"], "SB").point), ("energy", "mu"))
    curve = follow_curve(curve_start(problem, y, "SB", ("energy", "mu")), ((0.1, 0.3), FREE))
    (double,) = [event for event in curve.events if event.type == "R2"]
    value, at = double_breaking(double.values["quarter_period"], double.values["mu"], 0.1)
    # The equations of the curve are singular there: the event is located on the curve of the symmetric orbits.
    assert double.status == "located" and double.point in (0, len(curve) - 1)
    assert distance(double.values["mu"], value) < 1e-11 and distance(double.values["energy"], at.h) < 1e-11


def test_doubling_and_grazing_of_a_chain_meet(one_sided):
    """The same point on both curves, a doubling and a grazing of the linear mode: h = w^2 d^2/(2 b^2)."""
    parametric, branch = one_sided
    met = []
    for code in ("PD", "GR"):
        plane, curve, y = start(branch, code, ("energy", "k"), (FREE, (0.5, 0.75)), parametric=parametric)
        run, _ = followed(plane, curve, y)
        met += places(plane, run, "PD-GR")
    assert len(met) == 2 and met[0] == pytest.approx(met[1], rel=1e-11)
    w, _, b = backbone.participation(parametric.system({"k": met[0][0]}))
    assert np.min(np.abs(met[0][1] / (1.1**2 * w**2 / (2.0 * b**2)) - 1.0)) < 1e-11


@pytest.fixture(scope="module")
def broken(branches):
    """The symmetry breaking of the in-phase backbone in mu."""
    plane, curve, y = start(branches["S13O00+"], "SB", ("energy", "mu"), (FREE, (0.02, 1.0)))
    return plane, curve, *followed(plane, curve, y)


def test_symmetry_breaking_of_the_in_phase_backbone_in_mu(broken):
    """It ends at both sides where the impact vanishes on the linear mode, at w2 = 2 w1, and turns in between."""
    plane, curve, run, points = broken
    assert curve.monitor.symmetry == (False, True)
    # Next to the turn the scan of the closed form does not part its two zeros.
    require_reference([values for values in points[1:-1:2] if values["mu"] < 0.3233], breaking)
    resonances = [float(mu) for mu in internal_resonances(sigma="0.1")]
    assert sorted(place[0] for place in places(plane, run, "SB-GR")) == pytest.approx(resonances, rel=1e-12)
    for values in (points[0], points[-1]):
        w, b = ReferenceBackbone(values["mu"], "0.1").modes[0]
        assert values["energy"] == pytest.approx(float(w * w / (2 * b)), rel=1e-12)
    turn, _ = breaking_turn(2.58, 0.323, "0.1")
    assert 0.32 < max(values["mu"] for values in points) <= float(turn) * (1.0 + 1e-12)


def test_the_turn_in_mu_is_a_zero_of_the_slope(broken):
    """Oracle: `breaking_turn`, mu = 0.3233862991330."""
    plane, curve, run, points = broken
    place = int(np.argmax([values["mu"] for values in points]))
    begin = run.points[place - 1].step
    size, low, high = begin.y.size, 0.0, run.points[place + 1].arclength - run.points[place - 1].arclength
    slope = [curve.step(begin.y, begin.tangent, ds).tangent[5] for ds in (low, high)]
    assert slope[0] * slope[1] < 0.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        step = curve.step(begin.y, begin.tangent, middle)
        low, high = (middle, high) if step.tangent[5] * slope[0] > 0.0 else (low, middle)
    turn, at = breaking_turn(2.58, 0.323, "0.1")
    found = plane.values(step.y[:size])
    assert distance(found["mu"], turn) < 1e-13
    assert distance(found["quarter_period"], at.alpha) < 1e-8
