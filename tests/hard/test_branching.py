"""Hard cases of branching: both multipliers through +1 and -1 at once, a pitchfork from its side, a family at its own multiple cover."""

import math

import numpy as np
import pytest

from benchmarks.backbone import Backbone
from branches.tracing import follow_family
from tests.branches.traced import traced
from tests.bvp.orbits import backbone_segment
from tests.hard.cases import hard, largest
from tests.hard.test_resonance import symmetric

CLOSED_FORM = "closed form in 40 digits"
FREQUENCY = math.sqrt((0.8 + 0.3) / 0.5)
"""Of two equal masses that move against each other, in `symmetric`."""


def family_of_three(impacts):
    problem, y = backbone_segment(symmetric(), 1.4, impacts=impacts)
    return follow_family(problem, problem.solve(y, quarter_period=1.4).y, energy=(0.2, 100.0))


@pytest.mark.parametrize("impacts", [0, 1], ids=["quarter", "half"])
@hard(
    "symmetric double crossing of +1, and of -1: two equal masses on a third, whose motion against each other resonates",
    source="closed form: alpha = pi/(2 w) and 3 pi/(4 w), which the families born there keep, or twice it, throughout",
    limit=1e-10,
    what="quarter periods of the events, and of the families born, relative",
)
def test_both_multipliers_cross_at_once(impacts):
    """At +1 the determinant of the whole period's equations has a double zero; between two ends the one of each reversal is left."""
    branch = family_of_three(impacts)
    worst = 0.0
    for alpha, code, cover in ((math.pi / 2.0 / FREQUENCY, "BP", 1), (3.0 * math.pi / 4.0 / FREQUENCY, "PD", 2)):
        met = [e for e in branch.events if e.type == code and abs(e.alpha / alpha - 1.0) < 1e-6]
        assert len(met) == (2 if impacts and code == "PD" else 1), (code, [(e.type, e.alpha) for e in branch.events])
        worst = largest(worst, *(abs(e.alpha / alpha - 1.0) for e in met))
        for event in met:
            born = branch.switch(event, energy=(0.2, 200.0))
            assert born
            for family in born:
                inner = family.points["alpha"][np.abs(family.points["h"] / event.h - 1.0) > 1e-6]
                worst = largest(worst, np.max(np.abs(inner / (cover * alpha) - 1.0)))
                assert np.max(inner) > 0.0 and family.points["h"].max() > event.h * 1.0002
    return worst


@hard(
    "a pitchfork approached from its side branch: the families of U1301+ back to S13O00+",
    source=CLOSED_FORM,
    limit=1e-8,
    what="energy and quarter period of the branch point, relative",
)
def test_a_pitchfork_from_its_side():
    """The side branch passes its pitchfork, where its equations are singular, and goes on as its own image."""
    parent = traced("S13O00+")
    event = next(e for e in parent.events if e.type == "SB")
    backbone = Backbone()
    alpha, h = backbone.where_tau_half_is(-2.0, event.alpha * 0.999, event.alpha * 1.001)
    worst = 0.0
    for born in parent.switch(event, energy=(0.05, 100.0)):
        again = born.trace(len(born) // 2, energy=(0.05, 100.0))
        met = [e for e in again.events if e.type == "BP"]
        assert len(met) == 1 and not any(e.type == "SN" and abs(e.h / h - 1.0) < 1e-4 for e in again.events)
        worst = largest(worst, abs(met[0].h / h - 1.0), abs(met[0].alpha / alpha - 1.0))
        sides = again.points["arclength"] - met[0].arclength
        assert sides.min() < -0.1 and sides.max() > 0.1
        back = again.switch(met[0], energy=(0.05, 100.0))
        assert any(family.problem.ends == ("origin", "stop+") or "S13O00+" in family.label or family.cover for family in back)
    return worst


@hard(
    "families reached at their own multiple cover: the 3-, 4- and 5-fold covers of S11O00-, from the families that leave them",
    source=CLOSED_FORM,
    limit=1e-7,
    what="energy and quarter period of the crossing, relative",
)
def test_a_family_at_its_own_multiple_cover():
    parent = traced("S11O00-")
    backbone = Backbone()
    worst, count = 0.0, 0
    for event in [e for e in parent.events if e.type == "RT" and e.h < 0.1]:
        p, q = event.p_q
        tau = 2.0 * math.cos(2.0 * math.pi * p / q)
        half = math.copysign(math.sqrt(2.0 + tau), backbone.tau_half(event.alpha))
        alpha, h = backbone.where_tau_half_is(half, event.alpha * 0.9999, event.alpha * 1.0001)
        worst = largest(worst, abs(event.alpha / alpha - 1.0))
        for born in parent.switch(event, energy=(0.05, 10.0)):
            again = born.trace(min(len(born) - 2, 40), energy=(0.05, 10.0))
            (met,) = [e for e in again.events if e.type == "BP" and abs(e.h / h - 1.0) < 1e-5]
            worst = largest(worst, abs(met.h / h - 1.0), abs(met.alpha / (q * alpha) - 1.0))
            count += 1
    assert count >= 8
    return worst
