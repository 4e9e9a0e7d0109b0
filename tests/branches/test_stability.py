"""What is said of the points: tau, stability, multipliers, quality.

Oracles: tau_half of the closed form in forty digits; the monodromy formed in numpy where there is no closed form.
"""

import numpy as np
import pytest

from benchmarks.backbone import Backbone
from branches.orbit import orbit_columns
from bvp.multipliers import saddle_point_multipliers
from tests.branches.traced import monodromy, spread, traced


@pytest.mark.parametrize(("mu", "sigma"), [(0.1, 0.1), (0.37, 0.81), (1.7, 0.05)])
def test_stability_of_the_backbone_next_to_its_changes(mu, sigma):
    """Oracle: closed form: points a part in 1e6, 1e8, 1e10 from the fold, on both sides, are decided, and rightly."""
    branch = traced("S11O00-", mu, sigma, 0.05, 100.0)
    backbone = Backbone(mu, sigma)
    fold = next(event for event in branch.events if event.type == "SN")
    alpha, _ = backbone.where_tau_half_is(2.0 if backbone.tau_half(fold.alpha) > 0 else -2.0, fold.alpha * 0.999, fold.alpha * 1.001)
    guess = branch.unknowns(fold.point)
    for apart in (1e-6, 1e-8, 1e-10):
        for side in (-1, 1):
            solution = branch.problem.solve(guess, quarter_period=alpha * (1.0 + side * apart))
            said = int(orbit_columns(branch.problem, [solution])["stable"][0])
            true = backbone.stable(solution["quarter_period"])
            assert said == int(true), (apart, side)


def test_near_period_multiplication_the_orbit_is_decided():
    """Oracle: closed form: at tau_half = 1e-6, tau + 2 = 1e-12 and the orbit is stable."""
    branch = traced("S11O00-")
    doubling = next(event for event in branch.events if event.type == "PD")
    alpha, _ = Backbone().where_tau_half_is(1e-6, doubling.alpha * 0.99, doubling.alpha * 1.01)
    solution = branch.problem.solve(branch.unknowns(doubling.point), quarter_period=alpha)
    columns = orbit_columns(branch.problem, [solution])
    assert abs(columns["tau_half"][0] - 1e-6) < 1e-12 and columns["stable"][0] == 1
    assert abs(columns["tau"][0] + 2.0) < 1e-11


@pytest.mark.parametrize("name", ["S73O33-", "U8353-", "S11E11+@h=3.0"])
def test_columns_are_those_of_the_saddle_point_matrix(name):
    """Oracle: `saddle_point_multipliers` on the unfolded orbit, and the determinant and trace of the numpy monodromy."""
    branch = traced(name)
    for i in spread(branch, 12):
        orbit = branch.orbit(i)
        found = saddle_point_multipliers(orbit.cycle)
        largest = np.abs(found.values[0])
        # rounding moves a multiplier by eps times its square, and a nearly double one by eps over the distance of the two
        error = 1e-9 + 1e-15 * largest + 2e-15 / np.abs(found.values[0] - found.values[1])
        assert np.max(np.abs(found.values / branch.points["multipliers"][i] - 1.0)) < error
        assert abs(np.trace(monodromy(orbit)) - 2.0 - branch.points["tau"][i]) < 1e-9 * max(1.0, largest)
        assert bool(branch.points["reliable"][i]) is found.reliable


def test_what_is_unbounded_is_not_given():
    """Oracle: at grazing the impact has no speed, and multipliers and tau have no bound: they are NaN, stability is not decided."""
    for name in ("S13O00+", "S11O00-", "S73O33-"):
        branch = traced(name)
        p = branch.points
        at = [event.point for event in branch.events if event.type == "GR" and "vanishes" in event.note]
        assert at
        for i in at:
            assert np.isnan(p["tau"][i]) and np.all(np.isnan(p["multipliers"][i])) and p["stable"][i] == -1 and not p["reliable"][i]
        assert not np.any(np.isnan(np.delete(p["tau"], at)))


def test_larger_multipliers_come_first():
    """Oracle: the record's order: by modulus descending, then by angle; pairs of an elliptic orbit are conjugate."""
    branch = traced("S13O00+")
    multipliers = branch.points["multipliers"][1:]
    stable = branch.points["stable"][1:]
    assert np.all(np.abs(multipliers[:, 0]) >= np.abs(multipliers[:, 1]) - 1e-12)
    elliptic = multipliers[stable == 1]
    assert np.max(np.abs(np.abs(elliptic) - 1.0)) < 1e-7 and np.max(np.abs(elliptic[:, 0] - elliptic[:, 1].conj())) < 1e-7
