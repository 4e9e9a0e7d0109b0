"""Hard cases of the multipliers: many cuts, sizes from 1e-12 to 1e12 together, a lost trivial multiplier, and the edge of stability."""

import mpmath as mp
import numpy as np
import pytest

from benchmarks import backbone
from benchmarks.backbone import Backbone
from benchmarks.saltation import monodromy, saltation_multipliers
from branches.orbit import Orbit, orbit_columns
from bvp.closures import Cycle, cycle_of
from bvp.multipliers import saddle_point_multipliers
from bvp.system import vibro_impact_nes
from saltus.commands.orbit import orbit_lines
from tests.branches.traced import traced
from tests.bvp.orbits import backbone_segment, chain, chains, collection, cut
from tests.bvp.test_multipliers import separation
from tests.hard.cases import hard, largest
from tests.hard.digits import Closed

CLOSED_FORM = "closed form in 50 digits"


@pytest.mark.parametrize("pieces", [3, 20, 100])
@hard(
    "each flight cut into 3, 20, 100 pieces (orbits of 2 to 6 masses, multipliers from 1 to 1e20)",
    source="the same orbits, not cut; the product of a pair is 1",
    limit=1e-9,
    what="trace, pairs, and each multiplier that stands apart, relative",
)
def test_cuts_change_nothing(pieces):
    """Close pairs are compared by their sum and product."""
    worst, compared = 0.0, 0
    for orbit in collection() + chains():
        cycle = cycle_of(orbit.problem, orbit.solution.y)
        full, pieced = saddle_point_multipliers(cycle), saddle_point_multipliers(cut(cycle, pieces))
        assert pieced.values.shape == full.values.shape and pieced.reliable, orbit.name
        worst = largest(worst, abs(pieced.trace - full.trace) / np.max(np.abs(full.values)), pieced.pairing)
        if separation(full.values) > 1e-2:
            worst = largest(worst, np.max(np.abs(pieced.values / full.values - 1.0)))
            compared += 1
    assert compared > 30
    return worst


def mixed_cycle():
    """Three masses whose one-impact orbit has a real pair and one on the unit circle, run round until the real pair is 1e12 and 1e-12."""
    rng = np.random.default_rng(3)
    while True:
        system = chain(rng, 3, grounded=True)
        alpha = rng.uniform(0.2, 3.0)
        if backbone.half_period_sum(system, alpha) < 0.05 or not backbone.is_physical(system, alpha, 400):
            continue
        exact = Closed(system, alpha).multipliers()
        if abs(exact[0]) > 3.0 and abs(abs(exact[1]) - 1.0) < 1e-9 and abs(exact[1].imag) > 0.2:
            break
    cover = round(12.0 / np.log10(abs(exact[0])))
    problem, y = backbone_segment(system, alpha)
    one = cycle_of(problem, problem.solve(y, quarter_period=alpha).y)
    parts = [np.concatenate([part] * cover) for part in (one.before, one.after, one.duration, one.contact)]
    return Cycle(system, *parts, one.lead), exact**cover


@hard(
    "1e12, 1e-12 and a pair on the unit circle together (3 masses)",
    source=CLOSED_FORM,
    limit=1e-12,
    what="each multiplier, relative to itself",
)
def test_large_and_small_together():
    """The product of saltation matrices loses the small ones: the case is hard."""
    cycle, exact = mixed_cycle()
    found = saddle_point_multipliers(cycle)
    assert 1e11 < abs(exact[0]) < 1e13 and 1e-13 < abs(exact[-1]) < 1e-11
    assert found.reliable
    assert np.max(np.abs(saltation_multipliers(cycle)[-1] / exact[-1] - 1.0)) > 1e-3
    matched = [min(abs(value / other - 1.0) for other in exact) for value in found.values]
    paired = [min(abs(other / value - 1.0) for value in found.values) for other in exact]
    return largest(*matched, *paired)


@hard(
    "multipliers of 1e49: the product of saltation matrices has lost the trivial multiplier 1",
    source=CLOSED_FORM,
    limit=1e-12,
    what="both multipliers, relative to themselves",
)
def test_the_trivial_multiplier_is_lost():
    """Forty half periods of the backbone. The quality tells the loss as numpy has it, and the program says it in words."""
    system, alpha, impacts = vibro_impact_nes(), 1.25, 40
    problem, y = backbone_segment(system, alpha, impacts=impacts)
    solution = problem.solve(y, quarter_period=alpha * impacts)
    cycle = cycle_of(problem, solution.y)
    found = saddle_point_multipliers(cycle)
    matrix = monodromy(cycle)
    flow = system.modes.matrix @ cycle.after[0]
    assert min(abs(np.linalg.eigvals(matrix) - 1.0)) > 0.9
    lost = np.linalg.norm(matrix @ flow - flow) / np.linalg.norm(flow)
    assert lost > 1.0 and found.trivial > 1e-3 * lost
    assert any("loses the trivial multiplier" in line for line in orbit_lines(Orbit(problem, solution), ""))
    alone, y = backbone_segment(system, 1.7)
    calm = Orbit(alone, alone.solve(y, quarter_period=1.7))
    assert not any("loses" in line for line in orbit_lines(calm, ""))
    with mp.workdps(60):
        half = Closed(system, alpha).tau_half()
        root = (half + mp.sign(half) * mp.sqrt(half * half - 4)) / 2
        exact = [root ** (2 * impacts), root ** (-2 * impacts)]
        return float(largest(*(abs(mp.mpf(float(a.real)) / b - 1) for a, b in zip(found.values, exact, strict=True))))


@hard(
    "decided stability where |tau| - 2 is 1e-10, at the fold, the period doubling and the symmetry breaking of the backbones",
    source="tau_half of the closed form in 40 digits",
    limit=1e-12,
    what="tau_half, absolute; the answer itself is right",
)
def test_stability_is_decided_next_to_its_limit():
    """At 1e-12 it may be left open, but is never wrong."""
    worst = 0.0
    backbone_digits = Backbone()
    for name, kind in (("S11O00-", "SN"), ("S11O00-", "PD"), ("S13O00+", "SB")):
        branch = traced(name)
        event = next(e for e in branch.events if e.type == kind)
        limit = 0.0 if kind == "PD" else 2.0 if backbone_digits.tau_half(event.alpha) > 0 else -2.0
        for margin in (1e-10, 1e-12):
            # tau = tau_half^2 - 2: the margin of |tau| is 4 times that of tau_half at +-2, and the square of tau_half at 0.
            offsets = (margin**0.5, -(margin**0.5)) if kind == "PD" else (0.25 * margin, -0.25 * margin)
            for offset in offsets:
                alpha, _ = backbone_digits.where_tau_half_is(limit + offset, event.alpha * 0.99, event.alpha * 1.01)
                solution = branch.problem.solve(branch.unknowns(event.point), quarter_period=alpha)
                columns = orbit_columns(branch.problem, [solution])
                exact = backbone_digits.tau_half(solution["quarter_period"])
                said = int(columns["stable"][0])
                assert said == int(abs(exact) < 2) or (said == -1 and margin < 1e-11), (name, kind, margin, offset)
                worst = largest(worst, float(abs(mp.mpf(float(columns["tau_half"][0])) - exact)))
    return worst
