"""Floquet multipliers by their routes: the formed product, the saddle-point matrix, and numpy's product of saltation matrices.

Oracles: 40 digits; finite differences of the numpy event-driven flow; powers of the multipliers of one turn for orbits run through several
times; determinants (Liouville: exp(T tr B) prod r^2); a self-excited impact oscillator worked out by hand.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks import backbone
from benchmarks.saltation import monodromy, reduced_monodromy, saltation_matrix, saltation_multipliers
from bvp.closures import Cycle, cycle_of
from bvp.multipliers import floquet_multipliers, nearest_grazing, saddle_point_multipliers, sort_multipliers
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.flow_twin import Twin
from tests.bvp.high_precision import Exact
from tests.bvp.orbits import backbone_segment, chain, chains, collection, cut
from tests.hard.digits import Closed
from tests.lab.limits import FORMED_LIMIT, GRADE

EPS = np.finfo(float).eps


def cycles():
    return [(orbit, cycle_of(orbit.problem, orbit.solution.y)) for orbit in collection() + chains()]


def separation(values):
    """Smallest distance between two multipliers, relative to the larger: the inverse of their sensitivity."""
    return min(
        (abs(a - b) / max(abs(a), abs(b)) for i, a in enumerate(values) for b in values[:i]),
        default=1.0,
    )


def difference_monodromy(twin, x, period, step=1e-6):
    """Central differences of the flow over a period."""
    columns = []
    for j in range(len(x)):
        shift = np.zeros(len(x))
        shift[j] = step
        columns.append((twin.run(x + shift, period)[0] - twin.run(x - shift, period)[0]) / (2.0 * step))
    return np.array(columns).T


def test_both_routes_agree():
    """To the rounding of the formed product, |M| eps, where no two multipliers are close."""
    compared = 0
    for orbit, cycle in cycles():
        found = saddle_point_multipliers(cycle)
        other = saltation_multipliers(cycle)
        size = np.linalg.norm(monodromy(cycle), 2)
        assert found.reliable and found.note == "", orbit.name
        assert abs(np.sum(found.values) - np.sum(other)) < 1e-10 * size, orbit.name
        if separation(found.values) > 1e-2 and size < 1e6:
            assert np.max(np.abs(found.values - other)) < 1e-9 * size, orbit.name
            compared += 1
    assert compared > 20


def test_against_differences_of_the_flow():
    """Monodromy, and both routes' multipliers, against central differences of the run over a period."""
    compared = 0
    for orbit, cycle in cycles()[::8]:
        system = orbit.problem.system
        size = np.linalg.norm(monodromy(cycle), 2)
        if size > 1e3 or np.min(cycle.duration) < 0.1:
            continue
        twin = Twin(system)
        half = 0.5 * cycle.duration[0]
        x = twin.flow(system.modes.to_state @ cycle.after[0], half)
        matrix = difference_monodromy(twin, x, cycle.period)
        columns = [twin.flow(e, half) for e in np.eye(len(x))]
        flow = np.array(columns).T
        expected = flow @ system.modes.to_state @ monodromy(cycle) @ system.modes.from_state @ np.linalg.inv(flow)
        assert np.max(np.abs(matrix - expected)) < 1e-6 * np.max(np.abs(expected)) * size, orbit.name
        trace = np.trace(matrix) - (orbit.problem.size - 2 * orbit.problem.pairs)
        assert abs(trace - saddle_point_multipliers(cycle).trace) < 1e-6 * size**2, orbit.name
        compared += 1
    assert compared >= 4


def test_cycles_that_begin_at_a_cut_are_turned_to_an_impact():
    orbit = collection()[0]
    cycle = cut(cycle_of(orbit.problem, orbit.solution.y), 4)
    whole = saddle_point_multipliers(cycle)
    arrays = [np.roll(x, -2, axis=0) for x in (cycle.before, cycle.after, cycle.duration, cycle.contact)]
    rolled = Cycle(cycle.system, *arrays, cycle.lead)
    assert np.max(np.abs(saddle_point_multipliers(rolled).values - whole.values)) < 1e-12


def test_the_step_agrees():
    """The compiled two-degree-of-freedom form within the step is the same reduction; large multipliers keep their pairs."""
    large = 0
    for orbit in collection():
        found = saddle_point_multipliers(cycle_of(orbit.problem, orbit.solution.y))
        size = max(1.0, np.max(np.abs(found.values)))
        assert abs(orbit.solution["trace"] - found.trace) < 1e-12 * size * (10 + orbit.problem.inner), orbit.name
        assert abs(orbit.solution["determinant"] - 1.0) < 1e-11, orbit.name
        assert orbit.solution["singular"] == 0.0
        if abs(found.values[0]) > 1e8:
            pair = [complex(orbit.solution[f"{which}_real"], orbit.solution[f"{which}_imaginary"]) for which in ("larger", "smaller")]
            assert np.max(np.abs(pair / found.values - 1.0)) < 1e-9
            large += 1
    assert large >= 3


def test_trivial_directions_are_those_of_the_monodromy():
    """M f = f and grad H M = grad H, formed here, and the quality says no worse."""
    for orbit, cycle in cycles():
        system = orbit.problem.system
        matrix = monodromy(cycle)
        flow = system.modes.matrix @ cycle.after[0]
        gradient = np.concatenate([system.modes.squares, np.ones(orbit.problem.half)]) * cycle.after[0]
        size = np.linalg.norm(matrix, 2)
        assert np.linalg.norm(matrix @ flow - flow) < 1e-12 * size * np.linalg.norm(flow) * len(cycle.contact)
        assert np.linalg.norm(gradient @ matrix - gradient) < 1e-12 * size * np.linalg.norm(gradient) * len(cycle.contact)
        found = saddle_point_multipliers(cycle)
        assert 0.0 <= found.trivial < 1e-11 * size * len(cycle.contact)


def test_an_orbit_that_does_not_close_is_not_reliable():
    """States off by 1e-4: the trivial directions say so."""
    orbit = collection()[0]
    cycle = cycle_of(orbit.problem, orbit.solution.y)
    after = cycle.after.copy()
    after[0] *= 1.0001
    broken = Cycle(cycle.system, cycle.before, after, cycle.duration * 1.0002, cycle.contact, cycle.lead)
    found = saddle_point_multipliers(broken)
    assert not found.reliable and "trivial directions" in found.note


def self_excited(growth, restitution):
    """x'' - 2 g x' + x = 0 with a stop at x <= 1: its orbit with one impact a period, by hand.

    From x = 1, x' = -r v: x(t) = exp(g t)(cos w t - (r v + g) sin w t / w), w^2 = 1 - g^2; period t and v from x(t) = 1, x'(t) = v.
    Returns (system, v, t).
    """
    w = math.sqrt(1.0 - growth * growth)

    def flight(v, t):
        c, s, e = math.cos(w * t), math.sin(w * t), math.exp(growth * t)
        start = -restitution * v
        x = e * (c + (start - growth) * s / w)
        return x, e * (start * c + (growth * start - 1.0) * s / w)

    def speed(t):
        # x(t) = 1 solved for v
        c, s, e = math.cos(w * t), math.sin(w * t), math.exp(growth * t)
        return -(((1.0 / e - c) * w / s) + growth) / restitution

    times = np.linspace(0.2, 2.0 * math.pi - 0.2, 4000) / w
    mismatch = [flight(speed(t), t)[1] - speed(t) for t in times]
    for a, b, ma, mb in zip(times[:-1], times[1:], mismatch[:-1], mismatch[1:], strict=True):
        if ma * mb < 0 and abs(ma) < 10 and speed(a) > 0:
            t = brentq(lambda t: flight(speed(t), t)[1] - speed(t), a, b, xtol=1e-15)
            v = speed(t)
            if max(flight(v, s)[0] for s in np.linspace(1e-3, t - 1e-3, 500)) < 1.0:
                system = ImpactSystem([[1.0]], [[-2.0 * growth]], [[1.0]], (Stop((1.0,), upper=1.0, restitution=restitution),))
                return system, v, t
    raise AssertionError("no orbit")


@pytest.mark.parametrize("growth, restitution", [(0.05, 0.8), (0.023, 0.9), (0.2, 0.5)])
def test_self_excited_oscillator_by_hand(growth, restitution):
    """One degree of freedom, r < 1: one multiplier, r^2 exp(2 g T), from Liouville's formula as the other one is 1."""
    system, v, t = self_excited(growth, restitution)
    modes = system.modes
    before = modes.from_state @ np.array([1.0, v])
    after = modes.from_state @ np.array([1.0, -restitution * v])
    cycle = Cycle(system, before[None], after[None], np.array([t]), np.array([0]), 0.0)
    expected = restitution**2 * math.exp(2.0 * growth * t)
    for pieces in (1, 3, 20):
        for route in (floquet_multipliers, saddle_point_multipliers):
            found = route(cut(cycle, pieces))
            assert found.values.shape == (1,)
            assert abs(found.values[0] - expected) < 1e-11
        assert found.pairing is None and found.reliable and found.trivial < 1e-11
    assert abs(saltation_multipliers(cycle)[0] - expected) < 1e-11
    assert abs(np.linalg.det(monodromy(cycle)) - expected) < 1e-12


def attracting_cycle():
    """A two-degree-of-freedom oscillator with negative damping and a lossy stop, run onto its cycle by the numpy flow."""
    system = ImpactSystem(
        np.diag([1.0, 0.6]), [[-0.2, 0.0], [0.0, 0.1]], [[1.6, -0.6], [-0.6, 0.9]], (Stop((1.0, 0.0), upper=1.0, restitution=0.6),)
    )
    twin = Twin(system)
    x = np.array([0.0, 0.0, 1.0, 0.0])
    _, events = twin.run(x, 5e3, None, 300)
    states = np.array([event[2] for event in events])
    for impacts in (1, 2, 3, 4):
        if np.max(np.abs(states[-1] - states[-1 - impacts])) < 1e-12:
            times = np.array([event[0] for event in events[-impacts - 1 :]])
            last = events[-impacts:]
            before = np.array([system.modes.from_state @ event[2] for event in last])
            after = np.array([system.modes.from_state @ event[3] for event in last])
            duration = np.roll(np.diff(times), -1)
            return twin, Cycle(system, before, after, duration, np.array([event[1] for event in last]), 0.0)
    raise AssertionError("no cycle")


def test_lossy_cycle_of_two_degrees_of_freedom():
    """2n - 1 multipliers, none trivial: both routes, differences of the flow, Liouville's determinant, cuts."""
    twin, cycle = attracting_cycle()
    system = cycle.system
    found = floquet_multipliers(cycle)
    assert found.values.shape == (3,) and found.reliable and found.pairing is None
    assert np.max(np.abs(found.values - saddle_point_multipliers(cycle).values)) < 1e-10
    assert np.max(np.abs(found.values)) < 1.0
    assert np.max(np.abs(found.values - saltation_multipliers(cycle))) < 1e-9
    for pieces in (3, 20, 100):
        assert np.max(np.abs(saddle_point_multipliers(cut(cycle, pieces)).values - found.values)) < 1e-9
    loss = np.trace(np.linalg.solve(system.mass, system.damping))
    restitution = system.stops[0].restitution
    expected = math.exp(-loss * cycle.period) * restitution ** (2 * len(cycle.contact))
    assert abs(np.linalg.det(monodromy(cycle)) / expected - 1.0) < 1e-9
    assert abs(np.prod(found.values) / expected - 1.0) < 1e-9
    x = twin.flow(system.modes.to_state @ cycle.after[0], 0.3 * cycle.duration[0])
    values = np.linalg.eigvals(difference_monodromy(twin, x, cycle.period))
    values = np.delete(values, np.argmin(np.abs(values - 1.0)))
    assert np.max(np.abs(sort_multipliers(values) - found.values)) < 1e-6


def nearest(found, exact):
    """Largest distance of a number from the nearest one of the other list, both ways, relative to the largest number."""
    apart = np.abs(np.subtract.outer(found, exact))
    return max(np.max(np.min(apart, axis=0)), np.max(np.min(apart, axis=1))) / np.max(np.abs(exact))


@pytest.mark.rounding
def test_no_route_loses_a_digit():
    """Oracle: the product of flights and saltation matrices of the orbit in 60 digits. Each multiplier relative to the largest, to rounding
    times the impacts and the condition. In the median what is formed has no larger error than the saddle-point matrix: of one orbit alone
    either error can happen to be small."""
    formed, errors = 0, []
    for orbit in [*chains()[::3], *collection()[::8]]:
        cycle = cycle_of(orbit.problem, orbit.solution.y)
        exact = Exact(orbit.problem, orbit.solution).multipliers()
        values = [route(cycle) for route in (floquet_multipliers, saddle_point_multipliers)]
        assert all(found.values.shape == exact.shape == (2 * orbit.problem.pairs,) for found in values)
        if separation(exact) < 1e-3:
            continue  # two multipliers that are close move by the root of a perturbation
        first, second = (nearest(found.values, exact) for found in values)
        size = np.linalg.norm(values[0].matrix, 2)
        condition = np.linalg.cond(np.linalg.eig(values[0].matrix)[1]) / abs(orbit.solution["branching"])
        assert first < 1e-15 * len(cycle.contact) * condition * max(size / np.max(np.abs(exact)), 1.0), orbit.name
        errors.append((first, second))
        formed += values[0].sweeps == 0
    formed_error, saddle_error = np.median(errors, axis=0)
    assert formed > 8 and formed_error < 4.0 * saddle_error


@pytest.mark.parametrize("n", [2, 5, 12])
def test_many_impacts_of_many_masses(n):
    """Oracle: powers of the closed form's multipliers, in 50 digits, of a chain that is run round 32 times: 64 impacts."""
    random, cover = np.random.default_rng(n), 32
    while True:
        system = chain(random, n, grounded=True)
        alpha = random.uniform(0.1, 0.4)
        if backbone.half_period_sum(system, alpha) > 0.05 and backbone.is_physical(system, alpha, 400):
            exact = Closed(system, alpha).multipliers()
            if np.max(np.abs(exact)) < 1.0 + 1e-9 and separation(exact) > 1e-2 and separation(exact**cover) > 1e-3:
                break
    problem, y = backbone_segment(system, alpha)
    one = cycle_of(problem, problem.solve(y, quarter_period=alpha).y)
    cycle = Cycle(system, *(np.concatenate([part] * cover) for part in (one.before, one.after, one.duration, one.contact)), one.lead)
    found = floquet_multipliers(cycle)
    assert found.sweeps == 0 and found.reliable and len(cycle.contact) == 64
    assert nearest(found.values, exact**cover) < 1e-14 * cover * np.linalg.cond(np.linalg.eig(found.matrix)[1])
    assert nearest(found.values, saddle_point_multipliers(cycle).values) < 1e-11


def test_the_formed_product_agrees_where_it_is_used():
    """Oracle: the saddle-point matrix: values in the same order, trivial directions, pairs; cuts of flights change nothing."""
    kinds = set()
    for _, cycle in cycles():
        found, other = floquet_multipliers(cycle), saddle_point_multipliers(cycle)
        kinds.add(found.sweeps == 0)
        assert found.reliable and found.pairing < 1e-9 and found.matrix.shape == other.matrix.shape
        if found.sweeps:
            assert np.max(np.abs(other.values)) ** 2 > 0.99 * GRADE
            if cycle.system.degrees_of_freedom == 2:
                assert np.array_equal(found.values, other.values)
            elif separation(other.values) > 1e-2:
                # Either route rounds two factors a node, in each of their rows.
                limit = 4.0 * EPS * cycle.after.size * np.linalg.cond(np.linalg.eig(found.matrix)[1])
                assert np.max(np.abs(found.values / other.values - 1.0)) < limit
            continue
        assert found.trivial < 1e-11 * len(cycle.contact) and abs(found.trace - other.trace) < 1e-11
        if separation(other.values) > 1e-2:
            limit = 1e-12 * np.linalg.cond(np.linalg.eig(found.matrix)[1])
            assert np.max(np.abs(found.values - other.values)) < limit
            assert np.max(np.abs(floquet_multipliers(cut(cycle, 5)).values - found.values)) < limit
    assert kinds == {False, True}


def of_norm(squares, gap, norm, power):
    """The backbone orbit near the grazing of the mode with frequency 1 whose map has that norm: (cycle, exact multipliers, norm found).
    The norm grows like the inverse of the distance from the grazing, to a power."""
    n = len(squares)
    system = ImpactSystem(np.eye(n), np.zeros((n, n)), np.diag(squares), (Stop(gap, -1.0, 1.0),))

    def at(apart):
        alpha = 0.5 * math.pi - apart
        problem, y = backbone_segment(system, alpha)
        cycle = cycle_of(problem, problem.solve(y, quarter_period=alpha).y)
        return cycle, alpha, float(np.linalg.norm(reduced_monodromy(cycle)))

    first = 1e-4
    cycle, alpha, found = at(first * (at(first)[2] / norm) ** (1.0 / power))
    return cycle, Closed(system, alpha).multipliers(), found


@pytest.mark.rounding
@pytest.mark.parametrize("norm", [0.99 * FORMED_LIMIT, 1.01 * FORMED_LIMIT])
@pytest.mark.parametrize("squares, gap", [([1.0, 4.0], (0.3, 1.0)), ([1.0, 4.0], (1.0, 0.5)), ([1.0, 4.0, 2.0], (0.3, 1.0, 0.0))])
def test_both_sides_of_the_norm_at_which_the_product_is_left(squares, gap, norm):
    """Oracle: the closed form in 50 digits. Frequencies 1 and 2: next to the grazing the map is as large as the inverse v of the impact
    speed, but its multipliers stay below 4. It is u g'/v and a rest, where g . u is of the size of v. Rounding of u and g changes the
    multipliers by eps |M|, once for each coordinate at each impact."""
    cycle, exact, size = of_norm(squares, gap, norm, 1)
    assert abs(size / norm - 1.0) < 5e-3 and np.max(np.abs(exact)) < 4.0 and separation(exact) > 0.1
    found = floquet_multipliers(cycle)
    assert found.reliable and (found.sweeps == 0) is (norm < FORMED_LIMIT)
    for values in (found.values, saddle_point_multipliers(cycle).values):
        assert nearest(values, exact) < 2 * len(squares) * len(cycle.contact) * EPS * size


@pytest.mark.rounding
@pytest.mark.parametrize("norm", [0.99 * FORMED_LIMIT, 1.01 * FORMED_LIMIT])
@pytest.mark.parametrize("squares, gap", [([1.0, 2.0], (1.0, 0.5)), ([1.0, 2.0, 3.0], (1.0, 0.5, 0.3))])
def test_small_multipliers_beside_large_ones_are_not_from_the_product(squares, gap, norm):
    """Oracle: the closed form in 50 digits, with a pair of the size of |M| = 1e7 and its inverse. Each is right relative to itself, to the
    rounding of the state over the speeds at the impact, which are small. The formed product has lost the small one."""
    cycle, exact, size = of_norm(squares, gap, norm, 2)
    assert abs(size / norm - 1.0) < 5e-3 and abs(exact[0]) > 0.5 * size
    found = floquet_multipliers(cycle)
    assert found.reliable and found.sweeps > 0
    place, speed = np.split(cycle.before[0], 2)
    limit = 2 * len(squares) * len(cycle.contact) * EPS * np.linalg.norm(place) / np.linalg.norm(speed)
    assert max(np.min(np.abs(found.values / value - 1.0)) for value in exact) < limit < 1e-9
    assert np.min(np.abs(saltation_multipliers(cycle) / exact[-1] - 1.0)) > 10.0 * limit


def test_grazing_is_said_and_gives_no_numbers():
    """An impact at zero speed: multipliers NaN, not reliable, the note names the impact; and no saltation matrix."""
    system = vibro_impact_nes()
    problem, y = backbone_segment(system, 1.0)
    cycle = cycle_of(problem, y)
    before, after = cycle.before.copy(), cycle.after.copy()
    push, rate = system.modes.contacts.push, system.modes.contacts.rate
    contact = int(cycle.contact[1])
    before[1] -= push[contact] * (rate[contact] @ before[1])
    after[1] = before[1]
    grazing = Cycle(system, before, after, cycle.duration, cycle.contact, cycle.lead)
    assert nearest_grazing(grazing)[0] == 1
    found = floquet_multipliers(grazing)
    assert np.all(np.isnan(found.values)) and not found.reliable
    assert "impact 2 of 2 grazes" in found.note
    with pytest.raises(ValueError, match="zero speed"):
        saltation_matrix(system, contact, np.zeros(4))
    smooth = Cycle(system, cycle.before[:1], cycle.after[:1], cycle.duration[:1], np.array([-1]), 0.0)
    with pytest.raises(ValueError, match="without impacts"):
        floquet_multipliers(smooth)


def test_of_impacts_equally_near_to_grazing_the_first_counts():
    """Oracle: both impacts of a symmetric orbit have one angle; a rounding of either one changes nothing."""
    problem, y = backbone_segment(vibro_impact_nes(), 0.9)
    cycle = cycle_of(problem, y)
    for change in np.eye(2):
        before = cycle.before * (1.0 - 4.0 * EPS * change)[:, None]
        assert nearest_grazing(Cycle(cycle.system, before, cycle.after, cycle.duration, cycle.contact, cycle.lead))[0] == 0


def test_order_of_multipliers():
    """Oracle: the order by hand. The largest modulus overflows."""
    values = np.array([np.nan, 0.0, 0.5, 1j, 2.0, -1j, -1.0, 1.5e308 * (1 + 1j)])
    found = sort_multipliers(values)
    assert found[:-1].tolist() == [values[-1], 2.0, -1j, 1j, -1.0, 0.5, 0.0] and np.isnan(found[-1])
