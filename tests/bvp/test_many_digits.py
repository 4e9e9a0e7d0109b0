"""Orbits in fifty digits from the multipoint equations.

Oracles: determinant 1 and the symplectic relations; the half map and the stability in double precision, with the bound of their errors; the
closed form of one impact a half period; single shooting over the whole period.
"""

import mpmath as mp
import numpy as np
import pytest

from benchmarks.backbone import Backbone
from branches.orbit import Orbit
from branches.search.discovery import discover_orbits
from bvp.many_digits import BITS, DIGITS, digit_modes, orbit_in_digits
from bvp.multipoint import MultipointProblem
from bvp.stability import balance, half_map_of, roundings, stability, velocity_scale
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.branches.many_digits import ManyDigits
from tests.branches.paper_names import family
from tests.bvp.orbits import backbone_segment, chain, chains, collection

FOLD = 1.13584395619551
"""Quarter period at the fold of the out-of-phase backbone of the default system."""

TINY = mp.mpf(10) ** -35


def largest(matrix):
    return max(abs(x) for x in matrix)


@pytest.mark.parametrize("index", range(0, 40, 4))
def test_half_map_between_all_kinds_of_ends(index):
    """Oracle: determinant 1; the entries in double precision, to the bound of their errors."""
    found = collection()[index]
    problem, solution = found.problem, found.solution
    exact = orbit_in_digits(problem, solution.y)
    with mp.workdps(DIGITS):
        size = largest(exact.half_map)
        assert abs(mp.det(exact.half_map) - 1) < TINY * size**2
        assert exact.residual < mp.mpf(10) ** -40 and exact.moved < 1e-12
        phi, magnified = half_map_of(problem, solution)
        units = np.reshape(balance(problem, velocity_scale(problem, solution)), (2, 2))
        error = [float(abs(phi[i, j] - exact.half_map[i, j])) * units[i, j] for i in (0, 1) for j in (0, 1)]
    bound = roundings(problem.inner, solution["branching"]) * magnified * np.max(np.abs(phi * units))
    assert max(error) < bound
    said = stability(problem, solution).stable
    assert said is None or exact.stable is said


def test_more_degrees_of_freedom():
    """Oracle: a'c and b'd symmetric, a'd - c'b = 1; what double precision decides; chains with and without a rigid-body mode."""
    decided = []
    for found in chains()[::3]:
        problem, solution = found.problem, found.solution
        exact = orbit_in_digits(problem, solution.y)
        m = problem.pairs
        with mp.workdps(DIGITS):
            phi = exact.half_map
            a, b, c, d = phi[:m, :m], phi[:m, m:], phi[m:, :m], phi[m:, m:]
            error = TINY * (1 + largest(phi)) ** 2
            assert largest(a.T * d - c.T * b - mp.eye(m)) < error
            assert largest(a.T * c - c.T * a) < error and largest(b.T * d - d.T * b) < error
        said = stability(problem, solution).stable
        if said is not None:
            assert exact.stable is said
            decided.append(said)
    assert set(decided) == {False, True}


def test_a_rigid_body_mode_moves_on_in_a_straight_line():
    """Oracle: q(t) = q + p t."""
    modes = digit_modes(chain(np.random.default_rng(1), 3))
    assert modes.squares[0] == 0 and all(square > 0 for square in modes.squares[1:])
    state = np.array([k + 1 << BITS for k in range(6)], dtype=object)
    moved = modes.in_fixed.flow(state, modes.flights([2 << BITS])[:, 0])
    assert moved[0] == 1 + 2 * 4 << BITS and moved[3] == 4 << BITS


@pytest.mark.parametrize("apart", [1e-6, 1e-10, 1e-14])
def test_beside_the_fold(apart):
    """Oracle: tau_half of the closed form in forty digits: its value and its side of 2, nearer than double precision decides."""
    system = vibro_impact_nes()
    backbone = Backbone.of(system)
    problem, y = backbone_segment(system, FOLD)
    for side in (-1.0, 1.0):
        alpha = FOLD * (1.0 + side * apart)
        exact = orbit_in_digits(problem, y, alpha)
        with mp.workdps(DIGITS):
            assert abs(exact.trace - (backbone.tau_half(alpha) ** 2 - 2)) < TINY
        assert exact.stable is backbone.stable(alpha)


def test_a_periodic_closure():
    """Oracle: single shooting over the whole period, which finds another orbit of the family, apart by rounding."""
    source = family("U11+")
    breaking = next(event for event in source.events if event.type == "SB" and event.breaks == "reversal")
    branch = source.switch(breaking, energy=(0.05, 100.0))[0]
    assert branch.problem.periodic
    for i in sorted({*range(3, len(branch), len(branch) // 6)} - {event.point for event in branch.events}):
        orbit = branch.orbit(i)
        exact, other = orbit_in_digits(branch.problem, orbit.solution.y), ManyDigits(orbit)
        assert abs(float(abs(exact.trace) - 2 - other.margin)) < 1e-9 * (1.0 + abs(float(exact.trace)))
        assert exact.stable is bool(other.margin < 0)
        with pytest.raises(ValueError, match="no half map"):
            _ = exact.half_map


def test_a_dissipative_system_is_refused():
    with pytest.raises(ValueError, match="periodic orbits in many digits need a conservative system: "):
        digit_modes(vibro_impact_nes(lam=0.1))


def test_what_is_no_orbit_does_not_settle():
    """Oracle: a flight that takes no time does not lead from the origin to the stop."""
    problem, y = backbone_segment(vibro_impact_nes(), FOLD)
    for far in (1.0, 3.0, 5.0):
        with pytest.raises(ArithmeticError, match="did not settle"):
            orbit_in_digits(problem, far * y, 0.0)


def test_the_orbit_is_the_nearest_one():
    """Oracle: its start, to rounding, and its energy, of an orbit moved off by 1e-6."""
    problem, y = backbone_segment(vibro_impact_nes(), 0.9)
    rng = np.random.default_rng(2)
    exact = orbit_in_digits(problem, y * (1.0 + 1e-6 * rng.uniform(-1.0, 1.0, len(y))))
    assert 1e-8 < exact.moved < 1e-5
    solved = MultipointProblem(problem.system, problem.ends, problem.sequence).solve(y, energy=float(exact.energy))
    assert abs(Orbit(problem, solved).tau - float(exact.trace)) < 1e-9 * (1.0 + abs(float(exact.trace)))


@pytest.mark.parametrize(("length", "mass", "stiffness"), [(1e-9, 1.0, 1e6), (1e-9, 1e-3, 1e12), (1e6, 1e-3, 1e-9)])
def test_an_orbit_is_as_exact_in_all_units(length, mass, stiffness):
    """Oracle: flights and impacts with the sines and cosines of mpmath, relative to the largest displacement and velocity."""
    plain = vibro_impact_nes()
    stop = Stop((1.0, -1.0), upper=length, lower=-length)
    system = ImpactSystem(mass * plain.mass, 0.0 * plain.damping, stiffness * plain.stiffness, [stop])
    size, time = length * mass**0.5, (mass / stiffness) ** 0.5
    modes, checked = digit_modes(system), 0
    for orbit in discover_orbits(plain, 0.6, quarter_period=4.0, impacts=4).orbits:
        one, scales = orbit.problem, np.repeat([size, size / time], 2)
        problem = MultipointProblem(system, one.ends, one.sequence)
        states = [part(orbit.solution.y) * scales for part in (one.start, one.nodes)]
        found = orbit_in_digits(problem, problem.pack(*states, one.flight_times(orbit.solution.y) * time))
        with mp.workdps(DIGITS):
            (q, p), largest_two = np.split(found.states, 2, axis=1), np.abs(found.states).reshape(-1, 2, 2).max(axis=(0, 2))
            for i, t in enumerate(found.times[:-1]):
                w, b = [mp.sqrt(square) for square in modes.squares], modes.gaps[0]
                places = [q[i, k] * mp.cos(w[k] * t) + p[i, k] * mp.sin(w[k] * t) / w[k] for k in (0, 1)]
                speeds = np.array([p[i, k] * mp.cos(w[k] * t) - q[i, k] * mp.sin(w[k] * t) * w[k] for k in (0, 1)])
                after = speeds - 2 * (b @ speeds) / (b @ b) * b
                left = np.abs(places - q[i + 1]).max() / largest_two[0], np.abs(after - p[i + 1]).max() / largest_two[1]
                assert max(left) < mp.mpf(10) ** -46
                checked += 1
    assert checked > 3
