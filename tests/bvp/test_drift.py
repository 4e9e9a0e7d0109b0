"""The energy of many impacts does not drift: roundings go to either side, whatever the system, and however its numbers were rounded."""

import math

import numpy as np
import pytest

from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes

pytestmark = pytest.mark.rounding

EPSILON = float(np.finfo(float).eps)


def limit(impacts):
    """Of a balance, relative to the initial energy.

    A flight and an impact make some ten roundings, each of either sign and of half a unit in the last place at most: 1.2 eps in the mean
    square. Over N impacts their sum is 1.2 eps sqrt(N), and 7 times that at most. The energies at both ends add some more. A number that is
    off to one side by a tenth of eps exceeds this in 10,000 impacts.
    """
    return EPSILON * (8.0 * math.sqrt(impacts) + 16.0)


def systems(seed, count):
    """Random systems that lose little at each impact, with the energies of their impulsive starts."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        mu, sigma = 10.0 ** rng.uniform(-2.0, 0.5), rng.uniform(0.01, 3.0)
        lam, rho = rng.choice([0.0, 1e-6, 1e-5, 1e-4, 1e-3]), rng.choice([1.0, 0.9999, 0.999, 0.99])
        yield vibro_impact_nes(mu, sigma, lam, rho), rng.uniform(1.0, 300.0)


def check_two_masses(count):
    """How many of so many systems have 10,000 impacts."""
    full = 0
    for system, energy in systems(1, count):
        motion = simulate(system, [0.0, 0.0], [0.0, math.sqrt(2.0 * energy)], 1e5, max_impacts=10_000)
        assert motion.balance_error < limit(motion.impacts), (system, energy, motion.impacts)
        assert not motion.totals.any() or system.why_not_conservative()
        full += motion.impacts == 10_000
    return full


def test_of_two_masses():
    """Oracle: initial energy = dissipated + present, over 10,000 impacts; a conservative one dissipates exactly 0."""
    assert check_two_masses(30) > 9


@pytest.mark.parametrize("lam", [0.0, 1e-6, 1e-4])
@pytest.mark.parametrize("n", [3, 4, 5])
def test_of_chains(n, lam):
    """Oracle: as above, for 5000 impacts of chains whose one damper couples all modes, and of those without it."""
    rng = np.random.default_rng(n)
    links = rng.uniform(0.2, 2.0, n)
    stiffness = np.diag(links + np.append(links[1:], 0.0)) - np.diag(links[1:], 1) - np.diag(links[1:], -1)
    damping = np.zeros((n, n))
    damping[0, 0] = lam
    gap = (*(0.0,) * (n - 2), -1.0, 1.0)
    system = ImpactSystem(np.diag(rng.uniform(0.2, 2.0, n)), damping, stiffness, (Stop(gap, -1.0, 1.0, restitution=0.9999),))
    motion = simulate(system, np.zeros(n), 5.0 * rng.normal(size=n), 1e5, max_impacts=5000)
    assert motion.impacts > 1000 and motion.balance_error < limit(motion.impacts)
