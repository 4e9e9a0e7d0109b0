"""Families of more than two degrees of freedom: their test functions, and the events that these mark.

Oracles: determinants and eigenvalues of the half map by mpmath; the functions for two degrees of freedom; the closed form of one impact a
half period in 50 digits; multipliers from the saddle-point matrix on both sides of an event; multipliers of a period on a fine grid.
"""

import cmath
import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import mpmath
import numpy as np
import pytest

from benchmarks.saltation import saltation_multipliers
from branches.family import RESONANCES, SETTINGS, Family, multiplication
from branches.linear_modes import beginnings, linear_modes
from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.multipliers import floquet_multipliers, pairs_of, saddle_point_multipliers
from bvp.multipoint import MultipointProblem
from bvp.stability import half_map_of, stability
from bvp.system import ImpactSystem, Stop
from tests.bvp.orbits import backbone_segment, chain, chains, collection
from tests.hard.digits import Closed
from tests.lab.limits import COMMON


def expected_tests(problem, solution, targets):
    """The test functions after the common ones, from the definition."""
    phi = half_map_of(problem, solution)[0]
    m = problem.pairs
    speeds = solution["speeds"]
    with mpmath.workdps(40):
        a, b, c, d = (mpmath.matrix(block.tolist()) for block in (phi[:m, :m], phi[:m, m:], phi[m:, :m], phi[m:, m:]))
        product = b.T * c
        out = [speeds * mpmath.det(block) for block in (b, a, d)]
        if problem.quarters == 1:
            out.append(speeds**2 * mpmath.det(4 * product + 2 * mpmath.eye(m)))
        nu = list(mpmath.eig(product, left=False, right=False)) if m > 1 else [product[0]]
        factors = [(nu[i] - nu[j]) ** 2 / (1 + nu[i] ** 2) / (1 + nu[j] ** 2) for i in range(m) for j in range(i)]
        out.append(mpmath.re(mpmath.fprod(factors)))
        out += [speeds**2 * mpmath.det(4 * product + (2 - mpmath.mpf(target)) * mpmath.eye(m)) for target in targets]
        return np.array([float(value) for value in out]), float(max(abs(x) for x in nu))


def test_values_are_those_of_the_definition():
    """Oracle: determinants and eigenvalues in 40 digits. Chains with and without a rigid-body mode."""
    compared = 0
    for orbit in chains():
        family = Family(orbit.problem)
        step = family.begin(orbit.solution.y)
        expected, largest = expected_tests(orbit.problem, step.extra, family._targets)
        found = np.array(step.tests[COMMON:])
        assert len(found) == len(expected) == len(family.tests) - COMMON
        if largest < 1e3:
            size = np.abs(expected) + 0.01 * np.max(np.abs(expected))
            known = np.isfinite(found)
            assert np.max(np.abs(found - expected)[known] / size[known]) < 1e-8, orbit.name
            assert np.all(np.abs(expected[~known]) < 1e-13 * size[~known]), orbit.name
            compared += np.sum(known)
    assert compared > 150


def test_they_are_those_of_two_degrees_of_freedom():
    """Oracle: the same orbits by the special functions, from the entries of the half map in place of determinants."""
    compared = 0
    for orbit in collection():
        problem = orbit.problem
        general = MultipointProblem(problem.system, problem.ends, problem.sequence)
        general._two_dof = False
        special, other = Family(problem), Family(general)
        codes = [test.code for test in other.tests]
        at = codes.index("NS")
        kept = [value for i, value in enumerate(other.begin(orbit.solution.y).tests) if i != at]
        assert codes[:at] + codes[at + 1 :] == [test.code for test in special.tests]
        values = special.begin(orbit.solution.y).tests
        if np.max(np.abs(values[COMMON:])) < 1e6:
            np.testing.assert_allclose(kept, values, rtol=1e-12, atol=1e-12)
            compared += 1
    assert compared > 20


def closed(orbit):
    """The periodic closure of a symmetric orbit, and its unknowns."""
    cycle = cycle_of(orbit.problem, orbit.solution.y)
    problem = MultipointProblem(orbit.problem.system, ("periodic", "periodic"), cycle.letters)
    return problem, problem.pack(cycle.after[0], cycle.after[1:], cycle.duration)


def test_periodic_closures():
    """Oracle: the traces of the same orbits by their half maps. Where u(t + T/2) = -u(t) the first function is a root of 2 + tau."""
    compared = 0
    for orbit in [*chains(), *collection()[::4]]:
        if orbit.problem.pairs < orbit.problem.half - 1:
            continue  # it drifts
        problem, y = closed(orbit)
        step = Family(problem).begin(y)
        tau = stability(orbit.problem, orbit.solution).tau
        if not step.converged or np.max(np.abs(tau)) > 30.0:
            continue
        speeds, nu = step.extra["speeds"], 0.25 * (tau - 2.0)
        found = np.array(step.tests[COMMON:])
        states = cycle_of(problem, y).after
        if len(states) % 2 == 0 and np.abs(states + np.roll(states, len(states) // 2, axis=0)).max() < 1e-9 * np.abs(states).max():
            found[0] *= found[0] / speeds
        levels = [-2.0, *(multiplication(p, q) for p, q in RESONANCES)]
        expected = [speeds * np.prod(tau - level).real for level in levels]
        size = [speeds * np.prod(1.0 + np.abs(tau - level)) for level in levels]
        assert np.max(np.abs(np.delete(found, 1) - expected) / size) < 1e-7, orbit.name
        pairs = [(nu[i] - nu[j]) ** 2 / (1 + nu[i] ** 2) / (1 + nu[j] ** 2) for i in range(len(nu)) for j in range(i)]
        assert abs(found[1] - np.prod(pairs).real) < 1e-7, orbit.name
        compared += 1
    assert compared >= 15


def test_resonances_of_periodic_closures():
    """Oracle: multipliers from the saddle-point matrix at the events."""
    found = set()
    for orbit in [chains()[i] for i in (5, 6, 15)]:
        problem, y = closed(orbit)
        assert problem.periodic and problem.pairs == problem.half - 1
        branch = follow_family(problem, y, energy=(0.2 * orbit.energy, 5.0 * orbit.energy), settings=replace(SETTINGS, maximum_points=300))
        for event in (event for event in branch.events if event.type == "RT"):
            values = saddle_point_multipliers(cycle_of(problem, branch.orbit(event.point).solution.y)).values
            p, q = event.p_q
            assert np.min(np.abs(values - cmath.exp(2j * math.pi * p / q))) < 1e-6, event.p_q
            found.add((p, q))
    assert found == set(RESONANCES)


def test_what_rounding_decides_is_not_defined():
    """Oracle: where the half map is singular all along the family, b of a chain that drifts and is not reduced, nothing is said."""
    system = chain(np.random.default_rng(300), 3)
    problem, y = backbone_segment(system, 0.2, impacts=1)
    reduced = Family(problem).begin(y).tests[COMMON:]
    problem = MultipointProblem(system, problem.ends, problem.sequence)
    problem.held, problem.free, problem.pairs = np.eye(3), np.zeros((0, 3)), 2
    tests = Family(problem).begin(y).tests[COMMON:]
    assert math.isnan(tests[0]) and math.isfinite(tests[1]) and math.isfinite(tests[2])
    assert np.all(np.isfinite(reduced))


SYSTEMS = {
    "three masses": (303, 3, True),
    "three that drift": (300, 3, False),
    "four masses": (403, 4, True),
    "five that drift": (502, 5, False),
}


@cache
def backbone_family(name):
    seed, n, grounded = SYSTEMS[name]
    problem, y = backbone_segment(chain(np.random.default_rng(seed), n, grounded), 0.2)
    return follow_family(problem, y, energy=(0.05, 100.0))


def closed_traces(problem, alpha):
    """The traces lambda + 1/lambda of the pairs of the half map composed with u -> -u, without those that are 2 or -2 for all alpha. The
    map has 50 digits, its eigenvalues those of double precision: their sides of a level are asked for."""
    values = np.linalg.eigvals(np.array(Closed(problem.system, alpha).half_map().tolist(), complex)).tolist()
    trivial = [1.0, 1.0] + [-1.0, -1.0] * (problem.half - 1 - problem.pairs)
    for limit in trivial:
        values.remove(min(values, key=lambda x: abs(x - limit)))
    return np.array([value + 1.0 / value for value in values])


@pytest.mark.parametrize("name", ["three masses", "four masses"])
def test_a_resonance_has_its_multiplier(name):
    """Oracle: see `require_a_resonance_has_its_multiplier`."""
    require_a_resonance_has_its_multiplier(name)


def require_a_resonance_has_its_multiplier(name):
    """Oracle: the closed form: at a p:q resonance one multiplier is exp(2 pi i p/q), at a doubling -1. One event of each."""
    branch = backbone_family(name)
    found = {tuple(event.p_q or (1, 2)): event for event in branch.events if event.type in ("RT", "PD")}
    for (p, q), event in found.items():
        root = cmath.exp(2j * math.pi * p / q)
        values = np.array([x for x in Closed(branch.system, event.alpha).multipliers()])
        assert np.min(np.abs(values - root)) < 1e-7, (event.type, event.p_q, event.alpha)
    assert found.keys() == {(1, 2), *RESONANCES}


@pytest.mark.parametrize("name", ["three masses", "three that drift"])
def test_no_resonance_is_lost(name):
    """Oracle: see `require_no_resonance_is_lost`."""
    require_no_resonance_is_lost(name)


def require_no_resonance_is_lost(name):
    """Oracle: the sign of the product of the pairs' distances from each level, by the closed form over the family's range of alpha."""
    branch = backbone_family(name)
    alphas = branch.points["alpha"]
    events = np.array([event.alpha for event in branch.events])
    grid = np.linspace(np.min(alphas), np.max(alphas), 60)[1:-1]
    traces = [closed_traces(branch.problem, alpha) for alpha in grid]
    for p, q in RESONANCES:
        for level in (2.0 * math.cos(math.pi * p / q), -2.0 * math.cos(math.pi * p / q)):
            signs = np.array([np.sign(np.prod(trace - level).real) for trace in traces])
            for k in np.flatnonzero(signs[1:] != signs[:-1]):
                near = (events > grid[k]) & (events < grid[k + 1])
                assert any(branch.events[i].p_q == [p, q] for i in np.flatnonzero(near)), (p, q, grid[k])
    assert sum(event.type == "RT" for event in branch.events) >= 8


FINER = 20
"""Intervals of the fine grid in each step of a run."""


def traces_between(branch, k):
    """The traces lambda + 1/lambda of all pairs at orbits between the points k and k + 1, both included.

    The steps start at a point that is no event: at a branch point the tangent can be that of the other family."""
    first, last = (k + 1, k) if k in {event.point for event in branch.events} else (k, k + 1)
    begin, end = branch.orbit(first).solution, branch.orbit(last).solution
    length = branch.points["arclength"][k + 1] - branch.points["arclength"][k]
    length = math.copysign(length, (end.y - begin.y) @ begin.tangent[: len(begin.y)])
    between = [branch.problem.step(begin.y, begin.tangent, length * j / FINER) for j in range(1, FINER)]
    found = []
    for solution in (begin, *between, end):
        values = floquet_multipliers(cycle_of(branch.problem, solution.y)).values
        found.append(np.array([a + 1.0 / a for a, _ in pairs_of(values)]))
    return found if first == k else found[::-1]


def resonances_on(traces, p, q):
    """How often a pair passes the p:q resonance."""
    signs = np.array([np.sign(np.prod(trace - multiplication(p, q)).real) for trace in traces])
    return int(np.sum(signs[1:] != signs[:-1]))


def collisions_on(traces):
    """How often two pairs meet on the unit circle and leave it, or come back: two traces become complex, or real."""
    met = 0
    off = [trace[np.abs(trace.imag) > 1e-7 * (1.0 + np.abs(trace.real))] for trace in traces]
    for one, other in zip(off[:-1], off[1:], strict=True):
        if len(one) != len(other):
            more = max(one, other, key=len)
            met += abs(more[np.argmin(np.abs(more.imag))].real) < 2.0
    return met


def require_no_collision_is_missed(problem, y, energy):
    """Oracle: the multipliers of all pairs from the map over a period, on a grid that is twenty times finer than the steps of the run.

    The points of a run next to its resonances and collisions are compared as one step. Steps that end at a grazing are left out: no
    multiplier is bounded there. Returns how many resonances and collisions there are."""
    branch = follow_family(problem, y, energy=energy, settings=replace(SETTINGS, maximum_points=400))
    marked = [event for event in branch.events if event.type in ("RT", "NS")]
    at = {event.point for event in marked}
    kept = [k for k in range(len(branch)) if k not in at]
    grazing = {event.point for event in branch.events if event.type == "GR"}
    resonances = collisions = 0
    for first, last in zip(kept[:-1], kept[1:], strict=True):
        if grazing & {first, last}:
            continue
        steps = [traces_between(branch, k) for k in range(first, last)]
        # Without the events themselves: there rounding decides the sign.
        traces = [steps[0][0], *(trace for step in steps for trace in step[1:-1]), steps[-1][-1]]
        here = [event for event in marked if first < event.point < last]
        found = [sum(event.p_q == [p, q] for event in here) for p, q in RESONANCES], sum(event.type == "NS" for event in here)
        expected = [resonances_on(traces, p, q) for p, q in RESONANCES], collisions_on(traces)
        assert found == expected, (problem.ends, problem.sequence, first)
        resonances += sum(found[0])
        collisions += found[1]
    return resonances, collisions


@pytest.mark.parametrize("index, make", [(11, None), (20, None), (15, closed)])
def test_no_collision_is_missed(index, make):
    """Oracle: see `require_no_collision_is_missed`. Four masses and five; a periodic closure, on which one step after many resonances
    hides two."""
    orbit = chains()[index]
    problem, y = (orbit.problem, orbit.solution.y) if make is None else make(orbit)
    resonances, collisions = require_no_collision_is_missed(problem, y, (0.1 * orbit.energy, 10.0 * orbit.energy))
    assert resonances > 0 and (collisions > 0 or make)


@cache
def twelve_masses():
    """A family of a chain of twelve masses with two stops, whose largest multiplier is between 1e2 and 1e10."""
    c = np.zeros((2, 12))
    c[0, 4:6], c[1, 11] = (-1.0, 1.0), 1.0
    stiffness = 2.0 * np.eye(12) - np.eye(12, k=1) - np.eye(12, k=-1)
    stiffness[11, 11] = 1.0
    system = ImpactSystem(np.eye(12), np.zeros((12, 12)), stiffness, tuple(Stop(tuple(row), -1.0, 1.0) for row in c))
    starts = beginnings(linear_modes(system)[2], 3, 2, energy=(0.05, 3.0))
    start = next(one for one in starts if (one.ends, one.sequence) == (("stopb-", "stopb+"), "b+"))
    return start.followed(energy=(0.05, 3.0)).branch


def test_resonances_beside_large_multipliers():
    """Oracle: multipliers of which the large ones are split off: they do not come from the half map."""
    branch = twelve_masses()
    grazing = {event.point for event in branch.events if event.type == "GR"}
    resonant = {event.point for event in branch.events if event.type == "RT"}
    traces = {}
    for k in range(len(branch)):
        if k not in resonant | grazing:
            values = floquet_multipliers(branch.orbit(k).cycle).values
            traces[k] = np.array([a + 1.0 / a for a, _ in pairs_of(values)])
    for first, last in pairwise(traces):
        if last - first == 1 and {first - 1, last + 1} & grazing:
            continue
        for p, q in RESONANCES:
            odd = resonances_on([traces[first], traces[last]], p, q)
            assert odd == sum(event.p_q == [p, q] for event in branch.events if first < event.point < last) % 2, (first, p, q)
    for event in branch.events:
        if event.type == "RT" and event.multiplier < 1e6:
            turn = cmath.exp(2j * math.pi * event.p_q[0] / event.p_q[1])
            assert min(abs(floquet_multipliers(branch.orbit(event.point).cycle).values - turn)) < 1e-8, event
    assert len(resonant) >= 8 and sum(event.multiplier > 1e4 for event in branch.events if event.type == "RT") >= 3


def test_another_multiplier_decides_at_an_event():
    """Oracle: the multipliers: at a fold, a breaking or a doubling one pair is at 1 or -1, and another one is far from the unit circle."""
    decided = 0
    for event in twelve_masses().events:
        if event.type in ("SN", "SB", "PD"):
            values = np.abs(floquet_multipliers(twelve_masses().orbit(event.point).cycle).values)
            assert event.stable is (False if values[0] > 4.0 else None)
            decided += values[0] > 4.0
    assert decided >= 4


def test_pairs_that_hardly_differ_are_found():
    """Oracle: the eigenvalues of the monodromy matrix. A chain of three masses whose two pairs lie on the unit circle: the iteration of the
    product-free route takes up to 66 steps for one eigenvalue."""
    orbit = chains()[8]
    around = np.array([1.0 - 1e-3, 1.0 + 1e-3]) * 76.58
    branch = follow_family(orbit.problem, orbit.solution.y, energy=(0.1 * orbit.energy, 10.0 * orbit.energy))
    compared = 0
    for energy in np.linspace(*around, 201):
        for one in branch.orbits_at(energy=energy):
            cycle = cycle_of(one.problem, one.solution.y)
            found = saddle_point_multipliers(cycle).values
            assert np.abs(found - saltation_multipliers(cycle)).max() < 1e-9
            compared += bool(np.abs(np.abs(found) - 1.0).max() < 1e-9)
    assert compared > 100
