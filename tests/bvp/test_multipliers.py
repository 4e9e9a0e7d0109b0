"""Floquet multipliers by two routes.

Oracles: finite differences of the numpy event-driven flow; powers of the multipliers of one turn for orbits run through several
times; determinants (Liouville: exp(T tr B) prod r^2); a self-excited impact oscillator worked out by hand.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks import backbone
from benchmarks.saltation import monodromy, saltation_matrix, saltation_multipliers
from bvp.closures import Cycle, cycle_of
from bvp.multipliers import nearest_grazing, saddle_point_multipliers, sort_multipliers
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.flow_twin import Twin
from tests.bvp.orbits import backbone_segment, chains, collection

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
        assert found.quality.reliable and found.note == "", orbit.name
        assert abs(np.sum(found.values) - np.sum(other)) < 1e-10 * size, orbit.name
        if separation(found.values) > 1e-2 and size < 1e6:
            assert np.max(np.abs(found.values - other)) < 1e-9 * size, orbit.name
            compared += 1
    assert compared > 20


def test_against_differences_of_the_flow():
    """Monodromy, and both routes' multipliers, against central differences of the run over a period."""
    compared = 0
    for orbit, cycle in cycles()[::4]:
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
        trace = np.trace(matrix) - 2.0
        assert abs(trace - saddle_point_multipliers(cycle).trace) < 1e-6 * size**2, orbit.name
        compared += 1
    assert compared >= 8


def test_cycles_that_begin_at_a_cut_are_turned_to_an_impact():
    orbit = collection()[0]
    cycle = cycle_of(orbit.problem, orbit.solution.y).cut(4)
    whole = saddle_point_multipliers(cycle)
    arrays = [np.roll(x, -2, axis=0) for x in (cycle.before, cycle.after, cycle.duration, cycle.contact)]
    rolled = Cycle(cycle.system, *arrays, cycle.lead)
    assert np.max(np.abs(saddle_point_multipliers(rolled).values - whole.values)) < 1e-12


@pytest.mark.parametrize("impacts, alpha", [(2, 1.2), (4, 1.2), (9, 1.2), (12, 1.25), (40, 1.25), (11, 0.9), (30, 0.7)])
def test_several_turns_have_the_powers_of_one(impacts, alpha):
    """Multipliers of the orbit run `impacts` times round are powers; far beyond 1e16 the pair still has product 1."""
    system = vibro_impact_nes()
    problem, y = backbone_segment(system, alpha)
    one = saddle_point_multipliers(cycle_of(problem, y)).values
    problem, y = backbone_segment(system, alpha, impacts=impacts)
    found = saddle_point_multipliers(cycle_of(problem, y))
    expected = sort_multipliers(one**impacts)
    growth = max(1.0, abs(one[0] / (one[0] - one[1])))
    assert np.max(np.abs(found.values / expected - 1.0)) < 100 * EPS * impacts * growth * 10
    assert found.quality.pairing < 1e-10
    if impacts == 40:
        assert abs(found.values[0]) > 1e40 and abs(found.values[1]) < 1e-40


def test_large_multipliers_keep_their_pairs():
    """Primitive orbits with multipliers from 1e8 to 1e20: the pair's product to 1e-6 (1e-11 in fact), which the formed product
    loses."""
    large = [(orbit, cycle) for orbit, cycle in cycles() if abs(saddle_point_multipliers(cycle).values[0]) > 1e8]
    assert len(large) >= 3
    lost = 0
    for orbit, cycle in large:
        found = saddle_point_multipliers(cycle)
        assert abs(np.prod(found.values) - 1.0) < 1e-6, orbit.name
        assert found.quality.pairing < 1e-11 and found.quality.reliable, orbit.name
        first = complex(orbit.solution["larger_real"], orbit.solution["larger_imaginary"])
        second = complex(orbit.solution["smaller_real"], orbit.solution["smaller_imaginary"])
        assert abs(first / found.values[0] - 1.0) < 1e-9 and abs(second / found.values[1] - 1.0) < 1e-9
        lost += abs(np.prod(saltation_multipliers(cycle)) - 1.0) > 1e-6
    assert lost > 0


def test_the_step_agrees():
    """The compiled two-degree-of-freedom form within the step is the same reduction."""
    for orbit in collection():
        found = saddle_point_multipliers(cycle_of(orbit.problem, orbit.solution.y))
        size = max(1.0, np.max(np.abs(found.values)))
        assert abs(orbit.solution["trace"] - found.trace) < 1e-12 * size * (10 + orbit.problem.inner), orbit.name
        assert abs(orbit.solution["determinant"] - 1.0) < 1e-11, orbit.name
        assert orbit.solution["singular"] == 0.0


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
        assert 0.0 <= found.quality.trivial < 1e-11 * size * len(cycle.contact)


def test_an_orbit_that_does_not_close_is_not_reliable():
    """States off by 1e-4: the trivial directions say so."""
    orbit = collection()[0]
    cycle = cycle_of(orbit.problem, orbit.solution.y)
    after = cycle.after.copy()
    after[0] *= 1.0001
    broken = Cycle(cycle.system, cycle.before, after, cycle.duration * 1.0002, cycle.contact, cycle.lead)
    found = saddle_point_multipliers(broken)
    assert not found.quality.reliable and "trivial directions" in found.note


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
        found = saddle_point_multipliers(cycle, pieces=pieces)
        assert found.values.shape == (1,)
        assert abs(found.values[0] - expected) < 1e-11
        assert found.quality.pairing is None and found.quality.reliable and found.quality.trivial < 1e-11
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
    found = saddle_point_multipliers(cycle)
    assert found.values.shape == (3,) and found.quality.reliable and found.quality.pairing is None
    assert np.max(np.abs(found.values)) < 1.0
    assert np.max(np.abs(found.values - saltation_multipliers(cycle))) < 1e-9
    for pieces in (3, 20, 100):
        assert np.max(np.abs(saddle_point_multipliers(cycle, pieces=pieces).values - found.values)) < 1e-9
    loss = np.trace(np.linalg.solve(system.mass, system.damping))
    restitution = system.stops[0].restitution
    expected = math.exp(-loss * cycle.period) * restitution ** (2 * len(cycle.contact))
    assert abs(np.linalg.det(monodromy(cycle)) / expected - 1.0) < 1e-9
    assert abs(np.prod(found.values) / expected - 1.0) < 1e-9
    x = twin.flow(system.modes.to_state @ cycle.after[0], 0.3 * cycle.duration[0])
    values = np.linalg.eigvals(difference_monodromy(twin, x, cycle.period))
    values = np.delete(values, np.argmin(np.abs(values - 1.0)))
    assert np.max(np.abs(sort_multipliers(values) - found.values)) < 1e-6


def test_saltation_matrix_against_differences_and_with_a_flipped_sign():
    """A perturbed state carried to the stop, over it, and back in time; the matrix without, or minus, its jump term is noticed."""
    system = vibro_impact_nes(0.3, 0.5, lam=0.1, rho=0.7)
    twin = Twin(system)
    modes = system.modes
    before = np.array([0.8, -0.2, 0.9, 0.4])
    contact = 1
    c = np.array(system.stops[0].gap)

    def over(x):
        """From near the stop at time 0: to the stop, the impact, and back to time 0."""
        t = 0.0
        for _ in range(50):
            z = twin.flow(x, t)
            t -= (c @ z[:2] - 1.0) / (c @ z[2:])
        return twin.flow(twin.impact(twin.flow(x, t), contact), -t)

    columns = [(over(before + h) - over(before - h)) / 2e-6 for h in 1e-6 * np.eye(4)]
    expected = np.array(columns).T
    matrix = modes.to_state @ saltation_matrix(system, contact, modes.from_state @ before) @ modes.from_state
    assert np.max(np.abs(matrix - expected)) < 1e-8
    impact = np.array([twin.impact(e, contact) for e in np.eye(4)]).T
    assert np.max(np.abs(impact - expected)) > 0.1
    assert np.max(np.abs(2.0 * impact - matrix - expected)) > 0.1
    flipped = Twin(system, restitution_sign=-1.0)
    assert np.max(np.abs(np.array([flipped.impact(e, contact) for e in np.eye(4)]).T + matrix - impact - expected)) > 0.1


def test_multipliers_notice_a_flipped_saltation(monkeypatch):
    """The agreement of the two routes is lost when the sign of the saltation's jump term is turned."""
    import benchmarks.saltation as module

    orbit = collection()[0]
    cycle = cycle_of(orbit.problem, orbit.solution.y)
    right = saltation_matrix

    def wrong(system, contact, before):
        modes = system.modes
        r = 1.0 + modes.contact_restitution[contact]
        impact = np.eye(before.size) - r * np.outer(modes.contact_push[contact], modes.contact_rate[contact])
        return 2.0 * impact - right(system, contact, before)

    before = abs(np.sum(saltation_multipliers(cycle)) - saddle_point_multipliers(cycle).trace)
    monkeypatch.setattr(module, "saltation_matrix", wrong)
    after = abs(np.sum(saltation_multipliers(cycle)) - saddle_point_multipliers(cycle).trace)
    assert before < 1e-9 and after > 1e-3


def test_grazing_is_said_and_gives_no_numbers():
    """An impact at zero speed: multipliers NaN, not reliable, the note names the impact; and no saltation matrix."""
    system = vibro_impact_nes()
    problem, y = backbone_segment(system, 1.0)
    cycle = cycle_of(problem, y)
    before, after = cycle.before.copy(), cycle.after.copy()
    push, rate = system.modes.contact_push, system.modes.contact_rate
    contact = int(cycle.contact[1])
    before[1] -= push[contact] * (rate[contact] @ before[1])
    after[1] = before[1]
    grazing = Cycle(system, before, after, cycle.duration, cycle.contact, cycle.lead)
    assert nearest_grazing(grazing)[0] == 1
    found = saddle_point_multipliers(grazing)
    assert np.all(np.isnan(found.values)) and not found.quality.reliable
    assert "impact 2 of 2 grazes" in found.note
    with pytest.raises(ValueError, match="zero speed"):
        saltation_matrix(system, contact, np.zeros(4))


@pytest.mark.parametrize("distance", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7])
def test_towards_grazing(distance):
    """Out-of-phase backbone near its grazing end, where cos(w_2 alpha) -> 0: tau times the squared speed tends to a constant, and
    multipliers up to 1e13 keep their pair."""
    system = vibro_impact_nes()
    w, _, _ = backbone.participation(system)
    alpha = np.pi / 2 / w[1] - distance
    problem, y = backbone_segment(system, alpha)
    cycle = cycle_of(problem, problem.solve(y, quarter_period=alpha).y)
    found = saddle_point_multipliers(cycle)
    assert found.quality.pairing < 1e-6 and found.quality.reliable
    assert found.trace * cycle.speeds[0] ** 2 == pytest.approx(0.45407, rel=3e-3 + 3 * distance)


def test_refusals():
    orbit = collection()[0]
    cycle = cycle_of(orbit.problem, orbit.solution.y)
    with pytest.raises(ValueError, match="1 or more pieces"):
        saddle_point_multipliers(cycle, pieces=0)
    smooth = Cycle(cycle.system, cycle.before[:1], cycle.after[:1], cycle.duration[:1], np.array([-1]), 0.0)
    with pytest.raises(ValueError, match="without impacts"):
        saddle_point_multipliers(smooth)


def test_order_of_multipliers():
    values = np.array([0.5, 1j, 2.0, -1j, -1.0])
    assert list(sort_multipliers(values)) == [2.0, -1j, 1j, -1.0, 0.5]
