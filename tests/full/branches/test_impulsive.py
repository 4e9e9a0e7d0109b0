"""Long cases of tests/branches/test_impulsive.py."""

import numpy as np
import pytest

from branches.search.impulsive_motions import impulsive_state
from bvp.simulate import Simulator
from tests.branches.test_impulsive import (
    SYSTEM,
    at_energy,
    listed,
    require_families_through_the_listed_orbits_have_these_events_and_no_others,
    require_orbits_near_the_longest_quarter_period,
)


@pytest.mark.parametrize(("mu", "sigma"), [(0.1, 0.1), (0.37, 0.81)])
def test_families_through_the_listed_orbits_have_these_events_and_no_others(mu, sigma):
    """Oracle: see `require_families_through_the_listed_orbits_have_these_events_and_no_others`."""
    require_families_through_the_listed_orbits_have_these_events_and_no_others(mu, sigma)


def dense(low, high, longest, count):
    """Energies and times at which the impulsive motion passes the origin, from a fine grid of energies: crossings of the gap coordinate
    through zero are matched between neighbours by their place among the impacts, and changes of sign of the other displacement kept."""
    zeros, before, simulator = [], {}, Simulator(SYSTEM)
    times = np.linspace(1e-9, longest, 3000)
    for h in np.geomspace(low, high, count):
        u, v = impulsive_state(SYSTEM, h)
        motion = simulator.run(u, v, longest)
        states, _ = motion.sample(times)
        met = motion.stop_events
        gap, other = states[:, 0] - states[:, 1], states[:, 0] + states[:, 1]
        here = {}
        for i in np.flatnonzero((gap[:-1] > 0.0) != (gap[1:] > 0.0)):
            part = gap[i] / (gap[i] - gap[i + 1])
            time = times[i] + part * (times[i + 1] - times[i])
            hits = met.contacts[: int(np.searchsorted(met.times, time))]
            here[(hits, sum(key[0] == hits for key in here))] = (time, other[i] + part * (other[i + 1] - other[i]), h)
        for key, (time, residual, _) in here.items():
            if key in before and abs(before[key][0] - time) < 0.1 and before[key][1] * residual < 0.0:
                zeros.append((0.5 * (before[key][2] + h), time))
        before = here
    return zeros


def test_a_dense_scan_finds_the_same():
    """Oracle: 1450 energies. Each of its zeros is a listed orbit after one or more half periods (two quarters of a symmetric one), and
    each listed orbit is among them."""
    low, high, alpha = 1.5, 3.2, 3.4
    found = listed(low, high, alpha)
    zeros = dense(low, high, 2.0 * alpha, 1450)
    assert zeros and found.complete
    for h, time in zeros:
        orbit = at_energy(found, h)
        halves = time / (2.0 * orbit.alpha)
        assert abs(orbit.h / h - 1.0) < 1e-3 and abs(halves - round(halves)) < 0.02, (h, time)
    for orbit in found.orbits:
        assert any(abs(h / orbit.h - 1.0) < 1e-3 and abs(time - 2.0 * orbit.alpha) < 0.02 for h, time in zeros), orbit.label


@pytest.mark.parametrize(
    ("low", "high", "quarter_period", "longer"), [(0.05, 100.0, 5.1, 5.6), (100.0, 400.0, 5.0, 5.3), (0.3, 0.6, 20.0, 21.0)]
)
def test_orbits_near_the_longest_quarter_period(low, high, quarter_period, longer):
    """Oracle: see `require_orbits_near_the_longest_quarter_period`."""
    require_orbits_near_the_longest_quarter_period(low, high, quarter_period, longer)
