"""Normal-form coefficients: a map in many digits, the families that begin at bifurcations, and the size of a torus."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
import scipy.linalg
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

import saltus
from branches.forced.primitive import primitive_orbit
from branches.forced.tracing import follow_response, switch_response
from bvp.criticality import NormalForms, criticality
from bvp.forced import ForcedProblem
from tests.branches.forced_systems import absorber_families, impact_speed, oscillator
from tests.branches.test_absorber import located
from tests.bvp.test_curvature import KINDS, problem_of
from tests.lab.problems import units
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle

TURN = 2.0 * math.pi


def closed_form(w, r, n, s, sign=1):
    """The problem and the orbit of x'' + x = cos(w t) with one impact in n periods: problem, unknowns."""
    problem = ForcedProblem(oscillator(w=w, r=r, s=s), ("+",), ("s",), load_periods=n)
    speed = impact_speed(w, r, n, s, sign)
    starts = [problem.pack([[s, -r * speed]], [fraction], [s]) for fraction in np.linspace(0.0, 1.0, 200 * n)]
    return problem, problem.solve(min(starts, key=lambda y: np.abs(problem.residual(y)).max())).y


def impact_map(w, r, n, s):
    """The map of (velocity after the impact, its time) to the next ones, less n periods, in mpmath."""
    w, r, s = mp.mpf(w), mp.mpf(r), mp.mpf(s)
    gamma, period = 1 / (1 - w * w), 2 * mp.pi * n / w

    def next_impact(state):
        v, begin = state
        a, b = s - gamma * mp.cos(w * begin), v + gamma * w * mp.sin(w * begin)

        def place(t):
            return gamma * mp.cos(w * t) + a * mp.cos(t - begin) + b * mp.sin(t - begin) - s

        def speed(t):
            return -gamma * w * mp.sin(w * t) - a * mp.sin(t - begin) + b * mp.cos(t - begin)

        t = begin + period
        for _ in range(12):
            t -= place(t) / speed(t)
        return mp.matrix([-r * speed(t), t - period])

    return next_impact, period


def along(function, place, directions, step):
    """The derivative along directions, by differences of second order."""
    if not directions:
        return function(place)
    ahead, back = (along(function, place + turn * step * directions[0], directions[1:], step) for turn in (1, -1))
    return (ahead - back) / (2 * step)


def many_digit_coefficient(problem, y, w, r, n, s, multiplier):
    """a or c by Kuznetsov's formulas for the map, in the units of the problem. At a fold (1) the located orbit stands: Newton's method
    does not converge."""
    with mp.workdps(80):
        function, period = impact_map(w, r, n, s)
        step = mp.mpf(10) ** -16
        place = mp.matrix([mp.mpf(float(problem.states(y)[0, 1])), mp.mpf(float(problem.instants(y)[0])) * period])
        axes = [mp.matrix([1, 0]), mp.matrix([0, 1])]

        def slope(at):
            columns = [along(function, at, [axis], step) for axis in axes]
            return mp.matrix([[columns[0][0], columns[1][0]], [columns[0][1], columns[1][1]]])

        for _ in range(4 if multiplier != 1 else 0):
            place -= mp.lu_solve(slope(place) - mp.eye(2), function(place) - place)
        matrix = slope(place)
        shifted = matrix - multiplier * mp.eye(2)
        q = mp.matrix([-shifted[0, 1], shifted[0, 0]])
        unit = mp.matrix([mp.mpf(float(units(problem)[1])), period])
        q /= mp.norm(mp.matrix([q[0] / unit[0], q[1] / unit[1]]))
        q *= mp.sign(max(q[0] / unit[0], q[1] / unit[1], key=abs))
        p = mp.matrix([[-shifted[1, 0], shifted[0, 0]]])
        p /= (p * q)[0]
        squared = along(function, place, [q, q], step)
        if multiplier == 1:
            return float((p * squared)[0] / 2)
        bent = mp.lu_solve(mp.eye(2) - matrix, squared)
        return float((p * (along(function, place, [q, q, q], step) + 3 * along(function, place, [q, bent], step)))[0] / 6)


def doubling(w, r, n, low, high):
    """The clearance of a period doubling, from the stroboscopic multipliers."""

    def test(s):
        problem, y = closed_form(w, r, n, s)
        return float(np.prod(1.0 + problem.multipliers(y)).real)

    return brentq(test, low, high, xtol=1e-15)


@pytest.mark.parametrize(
    ("w", "r", "n", "low", "high"), [(2.8, 0.8, 1, -0.07, -0.06), (2.6, 0.5, 1, 0.02, 0.04), (3.7, 0.8, 2, -0.0614, -0.0612)]
)
def test_period_doubling_of_the_map_in_many_digits(w, r, n, low, high):
    """Oracle: differences in 80 digits of the closed form of the map from impact to impact."""
    s = doubling(w, r, n, low, high)
    if (w, r, n) == (2.8, 0.8, 1):
        assert s == pytest.approx(-0.0685756522788391, abs=1e-14)
    problem, y = closed_form(w, r, n, s)
    found = criticality(problem, y, "PD")
    assert found.coefficient == pytest.approx(many_digit_coefficient(problem, y, w, r, n, s, -1), rel=1e-9)
    assert found.error < 1e-7 * abs(found.coefficient)
    assert found.kind == ("supercritical" if found.coefficient > 0.0 else "subcritical")


def test_a_fold_of_the_map_in_many_digits():
    """Oracle: the same at the fold, whose place is known in closed form. The orbit is known to the root of rounding there."""
    w, r, n, s = 2.8, 0.8, 1, -1.78023560132159
    problem, y = closed_form(w, r, n, s + 1e-3)
    branch = follow_response(problem, y, (-1.9, -1.7))
    event = next(event for event in branch.events if event.type == "SN")
    assert event.values["s"] == pytest.approx(s, abs=1e-12)
    y = branch.unknowns[event.point]
    found = criticality(branch.problem, y, "SN")
    twin = many_digit_coefficient(branch.problem, y, w, r, n, float(branch.problem.states(y)[0, 0]), 1)
    assert found.coefficient == pytest.approx(twin, rel=1e-6) and found.kind is None


def outside(problem, y):
    """Number of multipliers outside the unit circle."""
    return int(np.sum(np.abs(problem.multipliers(y)) > 1.0))


CASES = ["PD 0.980029900377", "PD 0.913623496657", "SB 0.781365496480", "SB 0.901162653745", "SB 0.985087129854"]
"""Bifurcations of the absorber, one of which is subcritical: its family turns 1e-6 further."""


def at_event(text):
    """(branch, event) of the absorber."""
    code, value = text.split()
    return next(pair for key, pair in located().items() if key[0] == code and abs(key[3] - float(value)) < 2e-9)


@pytest.mark.parametrize("case", [*CASES, "2.8 0.8 1", "4.5 0.6 2"])
def test_families_that_begin_at_bifurcations_have_the_stability_of_their_kind(case):
    """Oracle: multipliers of the new orbits. As many of them are outside the unit circle as on the stable side of the others, and one more
    where the bifurcation is subcritical."""
    if case in CASES:
        branch, event = at_event(case)
    else:
        w, r, n = map(float, case.split())
        problem, y = closed_form(w, r, int(n), 0.0)
        branch = follow_response(problem, y, (-0.5, 0.5))
        event = next(event for event in branch.events if event.type == "PD")
    found = criticality(branch.problem, branch.unknowns[event.point], event.type)
    beside = [outside(branch.problem, branch.unknowns[event.point + turn]) for turn in (-1, 1)]
    assert abs(beside[0] - beside[1]) == 1 and abs(found.coefficient) > 1e3 * found.error
    assert found.kind == ("subcritical" if case == "SB 0.781365496480" else "supercritical")
    problem, step = switch_response(branch, event)[0]
    other = follow_response(problem, step, branch.interval, direction="along", points=3)
    assert outside(problem, other.unknowns[1]) == min(beside) + (found.kind == "subcritical")


def test_a_subcritical_doubling_of_an_oscillator_with_a_cubic_spring():
    """Oracle: the same, for Ueda's oscillator x'' + 0.05 x' + x^3 = B cos t, with derivatives from differences."""
    path = ParameterPath(saltus.load_scene("ueda_oscillator").parametric, ["B"], [], {"B": 1.0})
    system, forces = (make({"B": 1.0}) for make in (path.parametric.system, path.parametric.forces))
    found = settled_orbit(path, settle(system, forces))
    first = follow_response(*primitive_orbit(found.problem, found.y), (0.5, 3.0))
    event = next(event for event in first.events if event.type == "SB")
    assert criticality(first.problem, first.unknowns[event.point], "SB").kind == "supercritical"
    problem, step = switch_response(first, event)[0]
    branch = follow_response(problem, step, (0.5, 8.1), direction="along")
    doublings = [event for event in branch.events if event.type == "PD"]
    kinds = [criticality(problem, branch.unknowns[event.point], "PD").kind for event in doublings]
    assert kinds == ["supercritical", "supercritical", "supercritical", "subcritical"]
    for event, kind in list(zip(doublings, kinds, strict=True))[2:]:
        beside = [outside(problem, branch.unknowns[event.point + turn]) for turn in (-1, 1)]
        doubled, step = switch_response(branch, event)[0]
        other = follow_response(doubled, step, branch.interval, direction="along", points=3)
        assert outside(doubled, other.unknowns[1]) == min(beside) + (kind == "subcritical")


def plain_equations(problem, y):
    """T(lambda) = first - lambda last of the open orbit in units of the unknowns, with the places of its rows and columns."""
    n, inner, width = problem.degrees_of_freedom, problem.inner, problem.size + 1
    count, clock = (inner + 1) * width, [problem.unknowns] * problem.has_clock
    columns, rows = np.array([*range(count), *clock]), np.array([*range(count), *(place - 1 for place in clock)])
    last = np.zeros((len(rows), len(rows)))
    for e in range(2 * n):
        last[inner * width + e, 1 + e] = problem.closing[0]
    if clock:
        last[-1, 0] = 1.0
    scale = np.append(problem.scales(y), 1.0)[columns]
    return (problem.curvature.open_jacobian(y)[np.ix_(rows, columns)] + last) * scale, last * scale, rows, columns, scale


def whole(problem, places, entries):
    """A vector of the unknowns, or of the equations, of an open orbit."""
    found = np.zeros(max(problem.unknowns + problem.has_clock, max(places) + 1), dtype=complex)
    found[places] = entries
    return found


def compiled_cubic(problem, y, multiplier, pair):
    """The coefficient of PD or NS and its error, compiled, from null vectors of any length."""
    first, last, rows, columns, scale = plain_equations(problem, y)
    left, _, right = np.linalg.svd(first - multiplier * last)
    q = whole(problem, columns, scale * right[-1].conj())
    p = whole(problem, rows, left[:, -1].conj())[: len(q) - 1]
    return NormalForms(problem).cubic(y, q, p, "NS" if pair else "PD", multiplier)


def plain_cubic(problem, y, multiplier, pair):
    """The coefficient of PD or NS from singular vectors, LAPACK's solutions, and the core's derivatives."""
    first, last, rows, columns, scale = plain_equations(problem, y)
    left, _, right = np.linalg.svd(first - multiplier * last)
    p, q = left[:, -1], right[-1].conj()
    unit = units(problem)
    metric = np.array([unit[problem.size] if problem.has_clock else math.inf, *unit[: problem.size]])
    start = (scale * q)[: len(metric)] / metric
    largest = start[np.argmax(np.abs(start))]
    q = q * abs(largest) / largest / np.linalg.norm(start)
    p = p / np.vdot(p, last @ q).conj()

    def moved(vector):
        return whole(problem, columns, scale * vector)

    def bent(a, b):
        return (problem.curvature.open_second(y, moved(a)) @ moved(b))[rows]

    def solved(value, right_side):
        return np.linalg.solve(first - value * last, -right_side)

    other = q.conj() if pair else q
    cubic = problem.curvature.open_third(y, moved(q), moved(q), moved(other))[rows]
    h = solved(multiplier**2, bent(q, q))
    if not pair:
        return np.vdot(p, cubic / 6.0 + bent(q, h) / 2.0).real
    g = solved(abs(multiplier) ** 2, bent(q, other))
    return (np.conj(multiplier) / abs(multiplier) * np.vdot(p, cubic / 2.0 + bent(q, g) + bent(other, h) / 2.0)).real


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.tuples(st.integers(1, 3), st.sampled_from(KINDS[:3]), st.integers(1, 3), st.integers(0, 10**6)))
def test_the_compiled_coefficient_is_that_of_plain_algebra(case):
    """Oracle: singular vectors, LAPACK; several impacts, half a period, sticking, harmonics."""
    n, kind, impacts, seed = case
    problem, y = problem_of(n, kind, impacts, ["b"], np.random.default_rng(seed))
    first, last, *_ = plain_equations(problem, y)
    values = scipy.linalg.eigvals(first, last)
    values = values[np.isfinite(values) & (np.abs(values) > 1e-3) & (np.abs(values) < 1e3)]
    values = values[[np.sum(np.abs(values - value) < 1e-2 * abs(value)) == 1 for value in values]]
    assume(len(values) > 0)
    for value in values[values.imag >= 0.0]:
        pair = value.imag > 0.0
        found, error = compiled_cubic(problem, y, value if pair else value.real, pair)
        assume(error < 1e-5 * abs(found))
        assert found == pytest.approx(plain_cubic(problem, y, value if pair else value.real, pair), rel=1e-11, abs=error)


@pytest.mark.parametrize("code", ["NS", "SN"])
def test_the_whole_period_has_twice_the_coefficient_of_the_half(code):
    """Oracle: the second iterate of the normal form, whose null vector is the same."""
    branch = absorber_families()[0]
    event = next(event for event in branch.events if event.type == code)
    y, n = branch.unknowns[event.point], branch.problem.degrees_of_freedom
    node, time = branch.problem.nodes(y)[0], branch.problem.flight_times(y)[0]
    sequence = [*branch.sequence, branch.problem.mirrored(branch.sequence[0])]
    whole = ForcedProblem(branch.problem.parametric, sequence, branch.problem.released, values=branch.problem.values)
    fractions = node[2 * n] + np.array([0.0, 0.5])
    states = np.array([node[: 2 * n], -node[: 2 * n]])
    both = whole.pack(states, fractions, node[2 * n + 1 :], [time, time])
    angle = event.angle if code == "NS" else None
    half, full = criticality(branch.problem, y, code, angle), criticality(whole, both, code, 2.0 * angle if angle else None)
    assert full.coefficient == pytest.approx(2.0 * half.coefficient, rel=1e-9) and full.kind == half.kind


def test_what_has_no_normal_form_is_refused():
    """The message names what was received."""
    problem, y = closed_form(2.8, 0.8, 1, 0.0)
    with pytest.raises(ValueError, match="received GR"):
        criticality(problem, y, "GR")
    with pytest.raises(ValueError, match="no complex multipliers"):
        criticality(problem, y, "NS")
