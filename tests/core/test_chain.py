"""Chains of flights and saltations: closed orbits, half maps, and their test functions.

Oracles: central differences of flights and impacts with the arrival at the stop solved for; the product of numpy's saltation matrices; 40
digits for the determinants and discriminants of half maps; the same orbit cut into pieces, or with its maps handed over.
"""

import itertools

import mpmath
import numpy as np
import pytest
import saltus_core as core
from scipy.optimize import brentq

from benchmarks.saltation import monodromy, saltation_multipliers
from bvp.closures import cycle_of
from bvp.multipliers import given_chain, system_chain
from bvp.stability import chain_half_map
from bvp.system import ImpactSystem, Stop
from tests.bvp.orbits import chains, collection, cut
from tests.bvp.test_multipliers import attracting_cycle, separation

EPS = np.finfo(float).eps
FORMED, PARTED, FACTORED = range(3)


def arrays(cycle):
    return cycle.before, cycle.after, cycle.duration, cycle.contact


def maps_of(cycle):
    """Maps, rates before and after each node, of a linear system's cycle."""
    flight = core.LinearFlight(*cycle.system.modes.flight, np.ones(cycle.after.shape[1]))
    matrix = cycle.system.modes.matrix
    return np.array([flight.map(t) for t in cycle.duration]), cycle.before @ matrix.T, cycle.after @ matrix.T


def nearest(found, exact):
    """Largest distance of a number from the nearest one of the other list, both ways, relative to the largest number."""
    apart = np.abs(np.subtract.outer(found, exact))
    return max(np.max(np.min(apart, axis=0)), np.max(np.min(apart, axis=1))) / np.max(np.abs(exact))


def test_maps_that_are_handed_over_give_the_same():
    """Oracle: the chain that makes its own maps, of elastic and of lossy cycles."""
    cycles = [cycle_of(orbit.problem, orbit.solution.y) for orbit in [*collection()[::8], *chains()[::3]]]
    for cycle in [*cycles, attracting_cycle()[1]]:
        scale = np.ones(cycle.after.shape[1])
        route, values, trivial, *_ = system_chain(cycle.system, cycle.hit).multipliers(*arrays(cycle), False)
        given = given_chain(cycle.system, cycle.hit).multipliers_of_maps(*maps_of(cycle), cycle.contact, scale)
        assert route == given[0] == FACTORED
        size = np.linalg.norm(monodromy(cycle), 2)
        assert abs(np.sum(values) - np.sum(given[1])) < 1e-11 * size
        assert trivial < 1e-11 * size and given[2] < 1e-10 * size


def test_lossy_cycles_whose_modes_are_coupled():
    """Oracle: numpy's product of saltation matrices. Damping couples the modes: flights have blocks of one and two entries."""
    _, cycle = attracting_cycle()
    assert cycle.system.modes.layout == "coupled"
    chain = system_chain(cycle.system)
    for pieces, product in itertools.product((1, 2, 7), (True, False)):
        route, values, trivial, *_ = chain.multipliers(*arrays(cut(cycle, pieces)), product)
        assert route == (FORMED if product and route == FORMED else FACTORED)
        assert nearest(values, saltation_multipliers(cycle)) < 1e-10 and trivial < 1e-10


def test_every_entry_of_a_saltation():
    """Oracle: central differences of the motion over a period, with restitution and damping: what arrives late is solved for."""
    stops = (Stop((1.0, 0.4), upper=1.0, restitution=0.6),)
    system = ImpactSystem(np.diag([1.0, 0.6]), [[0.02, 0.01], [0.01, 0.05]], [[1.6, -0.6], [-0.6, 0.9]], stops)
    modes, flight = system.modes, core.LinearFlight(*system.modes.flight, np.ones(4))
    gap, bound = modes.contacts.gap[0], modes.contacts.bound[0]
    start = modes.from_state @ np.array([1.0 - 0.4 * 0.3, 0.3, -2.1, 0.7])  # on the stop, moving away

    def impact(z):
        return z - 1.6 * modes.contacts.push[0] * (modes.contacts.rate[0] @ z)

    times = np.linspace(0.05, 30.0, 3000)
    gaps = [gap @ flight.end(start, t) - bound for t in times]
    hit = next(k for k in range(1, len(times)) if gaps[k - 1] < 0.0 < gaps[k])
    total = brentq(lambda t: gap @ flight.end(start, t) - bound, times[hit - 1], times[hit], xtol=1e-15)
    before = flight.end(start, total)
    after = impact(before)

    def motion(z):
        """From z over the impact to a fixed time behind it."""
        t = brentq(lambda t: gap @ flight.end(z, t) - bound, total - 0.05, total + 0.05, xtol=1e-15)
        return flight.end(impact(flight.end(z, t)), total + 0.1 - t)

    step = 1e-5
    differences = np.array([(motion(start + step * e) - motion(start - step * e)) / (2.0 * step) for e in np.eye(4)]).T
    expected = np.linalg.solve(flight.map(0.1), differences)
    # As a closed orbit of one node its nontrivial multipliers are those of the map in the section, here without a closed orbit.
    chain = core.Chain(flight, core.Contacts(*modes.contacts), np.zeros((0, 2)), False, False)
    _, values, _, _, matrix, _ = chain.multipliers(before[None], after[None], np.array([total]), np.array([0]), True)
    flow = modes.matrix @ after
    rest = np.linalg.qr(np.column_stack([flow, np.eye(4)]))[0][:, 1:]
    np.testing.assert_allclose(np.linalg.eigvals(matrix).sum(), np.trace(rest.T @ expected @ rest), atol=1e-7)
    np.testing.assert_allclose(np.sum(values), np.trace(rest.T @ expected @ rest), atol=1e-7)
    np.testing.assert_allclose(np.prod(values), np.linalg.det(rest.T @ expected @ rest), atol=1e-7)


def test_cuts_change_nothing():
    """Oracle: the same orbit in one piece; sections at cuts lie across the flow."""
    for orbit in [*collection()[::9], *chains()[::4]]:
        cycle = cycle_of(orbit.problem, orbit.solution.y)
        chain = system_chain(cycle.system, cycle.hit)
        whole = chain.multipliers(*arrays(cycle), False)[1]
        if separation(whole) < 1e-2 or np.max(np.abs(whole)) > 1e6:
            continue
        for pieces, product in itertools.product((3, 8), (True, False)):
            values = chain.multipliers(*(np.roll(part, 1, axis=0) for part in arrays(cut(cycle, pieces))), product)[1]
            assert nearest(values, whole) < 1e-9, orbit.name


def test_half_maps_of_maps_that_are_handed_over():
    """Oracle: the chain that makes its own maps."""
    for orbit in [*collection()[::5], *chains()[::3]]:
        problem, y = orbit.problem, orbit.solution.y
        phi, magnified = chain_half_map(problem, orbit.solution)
        modes = problem.system.modes
        flight = core.LinearFlight(*modes.flight, np.ones(problem.size))
        states, ends = np.vstack([problem.start(y), problem.nodes(y)]), np.array(orbit.solution.ends)
        before, after = np.vstack([states[:1], ends]), np.vstack([states, ends[-1:]])
        maps = np.array([flight.map(t) for t in problem.flight_times(y)])
        reach = np.sqrt(2.0 * problem.energy(y))
        kinds = tuple(map(int, problem.kinds))
        found, other = given_chain(problem.system).half_map_of_maps(
            kinds, problem.held, maps, before @ modes.matrix.T, after @ modes.matrix.T, problem.contacts, reach
        )
        assert abs(other / magnified - 1.0) < 1e-12
        np.testing.assert_allclose(found, phi, rtol=0, atol=1e-13 * magnified * np.max(np.abs(phi)))


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_bases_of_a_section_are_turned_one_way(n):
    """Orthonormal, perpendicular to a direction, and with it of one orientation whatever that is: no determinant taken with them changes
    its sign between two orbits but through zero."""
    rng = np.random.default_rng(n)
    signs = set()
    for direction in rng.normal(size=(40, n)):
        basis = core.section_basis(direction, np.eye(n))
        np.testing.assert_allclose(basis @ basis.T, np.eye(n - 1), rtol=0, atol=1e-14)
        np.testing.assert_allclose(basis @ direction, 0.0, rtol=0, atol=1e-13)
        signs.add(float(np.sign(np.linalg.det(np.vstack([direction, basis])))))
    assert len(signs) == 1


def symplectic(random, m, grade=1.0):
    """A random symplectic matrix: products of shears and a scaling."""

    def shear():
        part = random.normal(size=(m, m))
        return part + part.T

    one, none = np.eye(m), np.zeros((m, m))
    scale = np.diag(grade ** random.uniform(-1.0, 1.0, m))
    parts = [np.block([[one, shear()], [none, one]]), np.block([[one, none], [shear(), one]])]
    return parts[0] @ parts[1] @ np.block([[scale, none], [none, np.linalg.inv(scale)]])


@pytest.mark.parametrize("m", [1, 2, 3, 5])
@pytest.mark.parametrize("quarters", [1, 2])
def test_test_functions_of_half_maps(m, quarters):
    """Oracle: equation (35) in 40 digits."""
    random = np.random.default_rng(m)
    targets = np.array([-2.0, 0.0, 1.0])
    for grade in (1.0, 30.0):
        phi = symplectic(random, m, grade)
        found = core.half_map_tests(phi, True, False, 2.0, quarters, m > 1, 0.5, 0.3, targets)
        with mpmath.workdps(40):
            a, b, c, d = (mpmath.matrix(part.tolist()) for part in (phi[:m, :m], phi[:m, m:], phi[m:, :m], phi[m:, m:]))
            product, one = 4 * b.T * c, mpmath.eye(m)
            expected = [mpmath.det(part) / 2 for part in (b, a, d)]
            expected += [mpmath.det(product + 2 * one) / 4] if quarters == 1 else []
            if m > 1:
                nu = mpmath.eig(b.T * c, left=False, right=False)
                parts = [(x - y) ** 2 / ((1 + x * x) * (1 + y * y)) for x, y in itertools.combinations(nu, 2)]
                expected.append(mpmath.fprod(parts).real)
            expected += [mpmath.det(product + (2 - mpmath.mpf(target)) * one) / 4 for target in targets]
            expected = np.array([float(value) for value in expected])
        size = np.max(np.abs(phi)) ** (2 * m)
        assert found.shape == expected.shape
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-13 * size)


def test_what_rounding_can_make_is_no_test_function():
    """A block whose determinant is below the noise of the entries, an entry that is no number, an orbit at a branch point."""
    phi = symplectic(np.random.default_rng(0), 2)
    tests = core.half_map_tests(phi, True, False, 1.0, 2, True, 1.0, 0.3, np.zeros(0))
    assert np.all(np.isfinite(tests))
    small = phi.copy()
    small[0, 2:] = 1e-15 * small[1, 2:]
    assert np.isnan(core.half_map_tests(small, True, False, 1.0, 2, True, 1.0, 0.3, np.zeros(0))[0])
    assert np.isnan(core.half_map_tests(phi, True, False, 1.0, 2, True, 1.0, 0.0, np.zeros(0))[:3]).all()
    small[1, 1] = np.inf
    assert np.isnan(core.half_map_tests(small, True, False, 1.0, 2, True, 1.0, 0.3, np.zeros(0))).all()


def test_arrays_that_do_not_fit_are_refused():
    orbit = collection()[0]
    cycle = cycle_of(orbit.problem, orbit.solution.y)
    chain = system_chain(cycle.system)
    before, after, duration, contact = arrays(cycle)
    with pytest.raises(ValueError, match="received 3 entries of a state; expected 4"):
        chain.multipliers(before[:, :3], after, duration, contact)
    with pytest.raises(ValueError, match="entries of contact"):
        chain.multipliers(before, after, duration, contact[1:])
    with pytest.raises(ValueError, match="a contact that the system does not have"):
        chain.multipliers(before, after, duration, contact + 7)
    with pytest.raises(ValueError, match="without nodes"):
        chain.multipliers(before[:0], after[:0], duration[:0], contact[:0])
    with pytest.raises(ValueError, match="makes its own maps"):
        chain.multipliers_of_maps(*maps_of(cycle), contact, np.ones(4))
    with pytest.raises(ValueError, match="a half map is square"):
        core.half_map_tests(np.ones((3, 3)), True, False, 1.0, 2, True, 1.0, 0.3, np.zeros(0))


@pytest.mark.parametrize("m", [1, 2, 4])
@pytest.mark.parametrize("turned", [False, True])
def test_multipliers_of_half_maps(m, turned):
    """Oracle: R phi^-1 R phi in 40 digits, R = diag(1, -1); applied twice where half of the period is turned. How far a matrix is from a
    symplectic one."""
    phi = symplectic(np.random.default_rng(m), m)
    values, defect = core.half_map_multipliers(phi, turned)
    with mpmath.workdps(40):
        exact, mirror = mpmath.matrix(phi.tolist()), mpmath.diag([1] * m + [-1] * m)
        back = mirror * exact**-1 * mirror * exact
        exact = np.array([complex(value) for value in mpmath.eig(back * back if turned else back, left=False, right=False)])
    assert nearest(values, exact) < 1e-11 and defect < 1e-15
    assert np.all(np.diff(np.abs(values)) < 1e-9 * np.abs(values[:-1]))
    for entry in ((0, 0), (0, m), (m, m), (m, 0)):
        wrong = phi.copy()
        wrong[entry] += 0.01
        assert core.half_map_multipliers(wrong, turned)[1] > 1e-6
