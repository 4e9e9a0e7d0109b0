"""Multipliers of conservative orbits with the large ones split off.

Oracle: the closed form of orbits with one impact a half period, in 50 digits, raised to a power where the orbit is run round several times.
"""

import itertools

import numpy as np
import pytest

from benchmarks import backbone
from bvp import multipliers
from bvp.closures import Cycle, cycle_of
from bvp.multipliers import floquet_multipliers, saddle_point_multipliers
from bvp.system import ImpactSystem, Stop
from tests.bvp.orbits import backbone_segment, chain, cut
from tests.bvp.test_multipliers import separation
from tests.hard.digits import Closed


@pytest.fixture
def alone(monkeypatch):
    """No other route steps in."""

    def fail(_):
        raise AssertionError("the multipliers did not part")

    monkeypatch.setattr(multipliers, "saddle_point_multipliers", fail)


def turned(system, alpha, cover):
    """A backbone orbit run round several times."""
    problem, y = backbone_segment(system, alpha)
    one = cycle_of(problem, problem.solve(y, quarter_period=alpha).y)
    parts = [np.concatenate([part] * cover) for part in (one.before, one.after, one.duration, one.contact)]
    return Cycle(system, *parts, one.lead)


def made_orbits(seed, n, cover):
    """Backbone orbits of chains, to be run round, with multipliers that lie apart: (system, alpha, size of the largest one). Double
    precision decides which."""
    random = np.random.default_rng(seed)
    while True:
        system, alpha = chain(random, n, grounded=True), random.uniform(0.2, 3.0)
        if backbone.half_period_sum(system, alpha) > 0.05 and backbone.is_physical(system, alpha, 400):
            values = np.linalg.eigvals(np.array(Closed(system, alpha).half_map().tolist(), float)) ** 2
            values = np.delete(values, np.argsort(np.abs(values - 1.0))[:2]) ** cover
            if separation(values) > 1e-2:
                yield system, alpha, np.max(np.abs(values))


MADE = {}


def random_orbits(*key):
    """The same orbits again for each test, made once."""
    made, more = MADE.setdefault(key, ([], made_orbits(*key)))
    for k in itertools.count():
        if k == len(made):
            made.append(next(more))
        yield made[k]


def random_orbit(seed, n, cover, low, high):
    """The first one with its largest multiplier between two sizes, run round, and its multipliers to the last digit."""
    system, alpha = next((system, alpha) for system, alpha, size in random_orbits(seed, n, cover) if low < size < high)
    return turned(system, alpha, cover), Closed(system, alpha).multipliers() ** cover


def error(found, exact):
    """Largest difference of a multiplier from the nearest one of the other list, relative to itself."""
    apart = np.abs(np.divide.outer(found, exact) - 1.0)
    return max(np.max(np.min(apart, axis=0)), np.max(np.min(apart, axis=1)))


CASES = [
    (3, 1, 6.0, 1e3), (3, 1, 1e3, 1e8), (3, 5, 6.0, 1e3), (3, 5, 1e3, 1e8), (3, 5, 1e8, 1e16), (4, 2, 6.0, 1e3), (4, 2, 1e3, 1e8),
    (5, 5, 6.0, 1e3), (5, 5, 1e3, 1e8), (5, 5, 1e8, 1e16), (6, 1, 6.0, 1e3), (6, 1, 1e3, 1e8), (8, 5, 6.0, 1e3), (8, 5, 1e3, 1e8),
    (8, 5, 1e8, 1e16), (8, 20, 6.0, 1e3), (8, 20, 1e3, 1e8), (8, 20, 1e8, 1e16),
]  # fmt: skip


@pytest.mark.rounding
@pytest.mark.parametrize("n, cover, low, high", CASES)
def test_each_multiplier_keeps_its_digits(alone, n, cover, low, high):
    """Relative to itself, from 1e-16 to 1e16: pairs on the unit circle beside large ones, quadruples, pairs of several sizes. Rounding at
    each impact, and no more than the sweeps lose to the rounding of the orbit itself."""
    cycle, exact = random_orbit(n + cover, n, cover, low, high)
    found = floquet_multipliers(cycle)
    assert found.reliable and found.sweeps > 0 and found.values.shape == exact.shape
    assert error(found.values, exact) < 5e-15 * len(cycle.contact) + 4.0 * error(saddle_point_multipliers(cycle).values, exact)
    assert found.pairing < 1e-13 * len(cycle.contact)
    pieces = cut(cycle, 5)
    # Each piece rounds by itself. A product of matrices is a sum of 2 n products, whose rounding errors add up.
    assert error(floquet_multipliers(pieces).values, exact) < 2.0 * error(found.values, exact) + 1e-14 * n * len(pieces.contact)


@pytest.mark.parametrize("n, alpha, sizes", [(3, 1.3, {32: 6.8e3}), (5, 1.2, {32: 7.4e3}), (12, 1.05, {1: 46.5, 6: 1e10})])
def test_chains_of_unequal_masses(alone, n, alpha, sizes):
    """A first mass between two stops; a quadruple at n = 3; up to twenty multipliers on the unit circle, too near each other to be
    distinguished, and products of pairs instead."""
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stop = Stop(tuple(np.eye(n)[0]), -1.0, 1.0)
    system = ImpactSystem(np.diag(np.linspace(1.0, 0.5, n)), np.zeros((n, n)), stiffness, (stop,))
    once = Closed(system, alpha).multipliers()
    for cover, largest in sizes.items():
        cycle, exact = turned(system, alpha, cover), once**cover
        found = floquet_multipliers(cycle)
        assert found.reliable and found.sweeps > 0 and abs(exact[0]) > 0.9 * largest
        apart = np.array([np.sort(np.abs(exact - value))[1] > 1e-2 * abs(value) for value in exact])
        assert np.sum(apart) >= 4
        assert all(np.min(np.abs(found.values / value - 1.0)) < 5e-15 * len(cycle.contact) for value in exact[apart])
        assert abs(np.prod(found.values) - 1.0) < 1e-14 * n * len(cycle.contact) and found.pairing < 1e-13


def test_an_orbit_that_does_not_close_is_not_reliable():
    """States off by 1e-4: the trivial directions say so."""
    cycle, exact = random_orbit(1, 4, 2, 10.0, 1e3)
    after = cycle.after.copy()
    after[0] *= 1.0001
    broken = Cycle(cycle.system, cycle.before, after, cycle.duration * 1.0002, cycle.contact, cycle.lead)
    assert floquet_multipliers(cycle).reliable
    found = floquet_multipliers(broken)
    assert not found.reliable and "trivial directions" in found.note
