"""Test functions of period doubling and Neimark-Sacker beside multipliers of any size."""

import math
from itertools import combinations

import mpmath as mp
import numpy as np
import pytest

from branches.curves.monitor import pair_product
from branches.forced.family import parameter_family
from branches.forced.primitive import full_period
from continuation.location import Location
from tests.branches.forced_systems import absorber_families
from tests.lab.matrices import bounded_product


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
    states, flight_times = np.tile(nodes[:, :size], (times, 1)), np.tile(problem.flight_times(y), times)
    return cover, cover.pack(states, fractions, problem.released_values(y), flight_times)


@pytest.mark.parametrize("times", [1, 2, 8, 11])
def test_the_signs_of_test_functions_do_not_depend_on_the_size_of_multipliers(unstable, times):
    """Oracle: an orbit traversed q times has the q-th powers of the multipliers, so the exact products of 1 + mu and 1 - mu_i mu_j are
    known. The largest one is above 1e8, 1e16, 1e60 and 1e80."""
    _, problem, y = unstable
    powers = problem.multipliers(y) ** times
    pairs = [1.0 - a * b for k, a in enumerate(powers) for b in powers[:k]]
    wide, begun = covered(problem, y, times)
    family = parameter_family(wide)
    step = family.begin(begun)
    values = {test.code: value for test, value in zip(family.tests, step.tests, strict=True)}
    assert math.copysign(1.0, values["NS"]) == math.copysign(1.0, np.prod(pairs).real)
    assert math.copysign(1.0, values["PD"]) == math.copysign(1.0, np.prod(1.0 + powers).real)
    assert max(abs(values["NS"]), abs(values["PD"])) <= 1.0


@pytest.mark.parametrize("factors", [[3.0, -1e-9, 5.0], [1e200, 1e-12, -1e150], [2 + 1j, 2 - 1j, 1e-7], [1e300, 1e300j, -1e300j, -1e-3]])
def test_a_bounded_product_is_small_beside_one_small_factor(factors):
    """Oracle: the sums of products in forty digits."""
    found = bounded_product(factors)
    with mp.workdps(40):
        sums = [mp.mpf(0)] * 5
        for j in range(min(len(factors), 4) + 1):
            for left in combinations(range(len(factors)), j):
                sums[j] += mp.fprod(mp.mpmathify(x) for k, x in enumerate(factors) if k not in left) / math.comb(len(factors), j)
        exact = sums[0].real / mp.sqrt(sum(mp.re(one) ** 2 for one in sums))
    assert found == pytest.approx(float(exact.real), rel=1e-13)


@pytest.mark.parametrize(("which", "code", "wanted"), [(1, "SB", 1), (2, "PD", 2)])
def test_a_zero_that_the_wider_problem_denies_is_no_event(which, code, wanted):
    """Oracle: the Jacobian of the full or double period is singular at these events, and at no orbit beside them."""
    branch = absorber_families()[which]
    family = parameter_family(branch.problem)
    index = next(i for i, test in enumerate(family.tests) if test.code == code)
    places = [event.point for event in branch.events if event.type == code]
    assert len(places) == wanted
    for place in places:
        for point, kept in ((place, True), (place + 3, False), (place - 3, False)):
            at = family.uncorrected(branch.unknowns[point])
            location = Location("zero", "located", 0.0, at, 0.0, at, at)
            assert (family.classify(index, None, at, None, location) is not None) is kept


def test_test_functions_of_curves_are_bounded_beside_huge_multipliers():
    """Oracle: exact signs. Plain products of 1 - mu_i mu_j overflow in the second case."""
    for rest in ((1e100, 2e100, 3e-101, -1e-110), (1e150, 2e150, -4e150, 3e-149), (1e150, 0.5e-150, 3e100)):
        exact = math.prod(1 if mp.mpf(a) * mp.mpf(b) < 1 else -1 for a, b in combinations(rest, 2))
        found = pair_product(rest)
        assert math.copysign(1.0, found) == exact and 0.0 < abs(found) <= 1.0
