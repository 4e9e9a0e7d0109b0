"""Neimark-Sacker bifurcations beside multipliers so large that rounding decides the sign of their test function."""

import math

import numpy as np
import pytest

from branches.forced.family import parameter_family
from branches.forced.primitive import full_period
from tests.branches.forced_systems import absorber_families


@pytest.fixture(scope="module")
def unstable():
    """The response of the absorber with two impacts, and the full period of its most unstable orbit without a slow impact."""
    branch = absorber_families()[0]
    large = np.where(np.isfinite(branch.largest_multiplier) & (branch.speeds.min(axis=1) > 0.2), branch.largest_multiplier, 0.0)
    return branch, *full_period(branch.problem, branch.unknowns[int(np.argmax(large))])


def covered(problem, y, times):
    """An orbit, traversed so often: its problem and its unknowns."""
    size = 2 * problem.degrees_of_freedom
    cover = problem.sibling([*problem.sequence] * times, load_periods=times * problem.load_periods)
    nodes = problem.nodes(y)
    fractions = np.concatenate([(nodes[:, size] + k) / times for k in range(times)])
    return cover, cover.pack(np.tile(nodes[:, :size], (times, 1)), fractions, [y[size + 1]], np.tile(problem.flight_times(y), times))


@pytest.mark.parametrize("times", [1, 2, 8])
def test_its_sign_is_known_as_long_as_the_multipliers_have_digits(unstable, times):
    """Oracle: an orbit traversed q times has the q-th powers of the multipliers, so the exact product of 1 - mu_i mu_j is known."""
    _, problem, y = unstable
    powers = problem.multipliers(y) ** times
    pairs = [1.0 - a * b for k, a in enumerate(powers) for b in powers[:k]]
    wide, begun = covered(problem, y, times)
    family = parameter_family(wide)
    step = family.begin(begun)
    value = step.tests[[test.code for test in family.tests].index("NS")]
    assert math.copysign(1.0, value) == math.copysign(1.0, np.prod(pairs).real)
