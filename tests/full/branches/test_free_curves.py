"""Long cases of tests/branches/test_free_curves.py."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import backbone
from branches.curves.free_start import released_of
from branches.curves.starting import curve_start
from branches.curves.tracing import follow_curve
from tests.branches import test_free_curves as origin
from tests.branches.curve_oracles import double_breaking
from tests.branches.test_free_curves import FREE, distance, followed, of_type, places, require_fold_of_the_out_of_phase_backbone, start

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
