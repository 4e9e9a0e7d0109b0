"""Flights whose forces are Python functions. Oracles: elliptic functions, an integral, a second integrator, Taylor series of a formula."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.special import ellipj, ellipk

from branches.orbit import Orbit
from branches.record import orbit_to_json
from branches.tracing import follow_family
from bvp.called_forces import FailedForce, formula_of
from bvp.multipoint import MultipointProblem
from bvp.smooth_flights import core_flight, modal_energies
from bvp.springs import Damper, Spring
from bvp.system import ImpactSystem, Stop
from tests.lab.flights import SmoothFlight


def cube(w):
    """w^3, which takes arrays of real and complex numbers and no symbol."""
    w = np.asarray(w)
    return w * w * w


def oscillator(force, stops=(), **known) -> ImpactSystem:
    """x'' + x + f(x) = 0."""
    return ImpactSystem([[1.0]], [[0.0]], [[1.0]], stops, springs=(Spring((1.0,), force=force, **known),))


def sink(force, **known) -> ImpactSystem:
    """The cubic energy sink, with another force."""
    springs = (Spring((1.0, -1.0), force=force, **known),)
    return ImpactSystem(np.diag([0.05, 1.0]), np.zeros((2, 2)), np.diag([0.0, 1.0]), (), absorber=0, primary=1, springs=springs)


@pytest.mark.parametrize("amplitude", [0.1, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("part", [1.0, -2.7])
def test_duffing_is_elliptic(amplitude, part):
    """Oracle: x = A cn(W t | m), W^2 = 1 + A^2, m = A^2/(2 W^2). The error allowed is rounding, of stages and of the oracle."""
    squared = 1.0 + amplitude**2
    m = amplitude**2 / (2.0 * squared)
    frequency, time = math.sqrt(squared), part * ellipk(m) / math.sqrt(squared)
    end = SmoothFlight.of(oscillator(cube)).end([amplitude, 0.0], time)
    sn, cn, dn, _ = ellipj(frequency * time, m)
    exact = np.array([amplitude * cn, -amplitude * frequency * sn * dn])
    assert np.abs((end.state - exact) / [amplitude, amplitude * frequency]).max() < 2e-14
    assert abs(np.linalg.det(end.derivatives) - 1.0) < 1e-14 * np.linalg.norm(end.derivatives)


def test_a_force_may_keep_what_it_is_given():
    """Oracle: copies of the elongations, made when the force had them."""
    kept = []

    def force(w):
        kept.append((w, np.copy(w)))
        return cube(w)

    core_flight(oscillator(force)).end(np.array([1.0, 0.5]), 2.0)
    arrays = [(given, copy) for given, copy in kept if np.ndim(given)]
    assert len(arrays) > 10 and all(np.array_equal(given, copy) for given, copy in arrays)


def test_energy_changes_by_a_rounding_of_each_step():
    """Oracle: the energy, over sixty periods."""
    system = oscillator(cube)
    flight, z, steps = SmoothFlight.of(system), np.array([1.0, 0.5]), 0
    begin = modal_energies(system, z)
    for _ in range(10):
        end = flight.end(z, 40.0, derivatives=False)
        z, steps = end.state, steps + end.steps
        assert abs(modal_energies(system, z) / begin - 1.0) < 2.2e-16 * steps


@pytest.mark.parametrize("time", [0.4, 6.0])
def test_steps_by_collocation_and_taylor_series_agree(time):
    """Oracle: the Taylor series of the formula: ends, derivatives, and the path between."""
    z = np.array([0.3, -0.2, 0.1, 0.5])
    flights = SmoothFlight.of(sink(cube)), SmoothFlight.of(sink(lambda w: w**3))
    called, series = (flight.end(z, time) for flight in flights)
    growth = np.abs(series.derivatives).max()
    assert np.abs(called.state - series.state).max() < 2e-15 * growth
    assert np.abs(called.derivatives - series.derivatives).max() < 1e-13 * growth
    states = []
    for end in (called, series):
        places = [(max(0, np.searchsorted(end.times, t, "right") - 1), t) for t in np.linspace(0.0, 0.999 * time, 60)]
        states.append([np.polynomial.polynomial.polyval(t - end.times[k], end.coefficients[k]) for k, t in places])
    assert np.abs(np.subtract(*states)).max() < 1e-14 * growth


def test_a_family_is_that_of_the_formula():
    """Oracle: the same family by Taylor series: events, quarter periods and multipliers. A file has no place for the function."""
    branches = []
    for force in (cube, lambda w: w**3):
        problem = MultipointProblem(sink(force), ("origin", "rest"), ())
        y = problem.solve(problem.pack(np.array([0.0, 0.0, 0.0, math.sqrt(0.4)]), None, [1.55]), energy=0.2).y
        branches.append(follow_family(problem, y, energy=(0.19, 0.21)))
    assert [event.type for event in branches[0].events] == [event.type for event in branches[1].events]
    for h in (0.192, 0.2, 0.208):
        one, other = (branch.orbit_at(energy=h) for branch in branches)
        assert abs(one.alpha / other.alpha - 1.0) < 1e-13
        assert np.abs(one.multipliers - other.multipliers).max() < 1e-9 * np.abs(other.multipliers).max()
    with pytest.raises(ValueError, match="a force that is a Python function is not written to files; expected a formula"):
        orbit_to_json(branches[0].orbit(0))


@pytest.mark.parametrize("pieces", [1, 3])
def test_an_impact_is_found_on_a_force_from_a_function(pieces):
    """Oracle: the time from the origin to the stop, the integral of dx over the speed there."""
    system = oscillator(lambda w: np.asarray(np.sinh(np.asarray(w))), [Stop((1.0,), -1.0, 1.0)])
    assert system.smooth_forces.called
    h = 4.0
    problem = MultipointProblem(system, ("origin", "stop+"), (), pieces)
    first = MultipointProblem(system, ("origin", "stop+"), ())
    y = first.in_pieces_of(problem, first.pack(np.array([0.0, math.sqrt(2.0 * h)]), None, [0.35]))
    orbit = Orbit(problem, problem.solve(y, energy=h))
    time, _ = quad(lambda x: 1.0 / math.sqrt(2.0 * h - x * x - 2.0 * (math.cosh(x) - 1.0)), 0.0, 1.0, epsabs=1e-14, epsrel=1e-14)
    assert abs(orbit.alpha - time) < 1e-14
    assert orbit.quality["reliable"] and orbit.residual < 1e-14


def test_a_table_with_kinks_in_its_second_derivative_is_flown():
    """Oracle: DOP853 with steps that are short against the distances of the knots. Steps become short where a knot is passed."""
    x = np.linspace(-2.0, 2.0, 21)
    table = CubicSpline(x, x**3 + 0.2 * np.sin(x))
    slope = table.derivative()
    system = sink(table, slope=slope, energy=table.antiderivative())
    flight, z = SmoothFlight.of(system), np.array([0.2, -0.1, 0.1, 0.3])
    end = flight.end(z, 1.0, derivatives=False)
    assert end is not None, flight.why_not

    def rate(_, z):
        w = flight.rows @ z
        return flight.matrix @ z + np.concatenate([[0.0, 0.0], flight.push @ (table(w) - slope(0.0) * w)])

    second = solve_ivp(rate, (0.0, 1.0), z, method="DOP853", rtol=1e-13, atol=1e-15, max_step=4e-3)
    assert np.abs(end.state - second.y[:, -1]).max() < 1e-13
    assert abs(modal_energies(system, end.state) - modal_energies(system, z)) < 1e-15
    assert np.ptp(np.log10(np.diff(end.times))) > 0.5


def test_the_energy_is_the_integral_of_the_force():
    """Oracle: the antiderivative, beside the linear part, which belongs to K."""
    system = oscillator(lambda w: np.asarray(np.exp(np.asarray(w))) - 1.0)
    w = np.array([[-3.0], [-0.2], [0.4], [5.0]])
    exact = np.exp(w[:, 0]) - 1.0 - w[:, 0] + 0.5 * w[:, 0] ** 2
    assert np.abs(system.energy(w, np.zeros((4, 1))) / exact - 1.0).max() < 1e-14
    assert system.stiffness.tolist() == [[2.0]]
    assert not system.has_odd_symmetry and oscillator(cube).has_odd_symmetry


def test_a_damper_from_a_function_has_a_linear_part():
    """Oracle: van der Pol's equation: the linear part belongs to C, the rest is the force."""

    def force(w, w_dot):
        w, w_dot = np.asarray(w), np.asarray(w_dot)
        return 0.5 * (w * w - 1.0) * w_dot

    damper = Damper((1.0,), force=force)
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], [Stop((1.0,), -9.0, 9.0)], dampers=(damper,))
    assert system.damping[0, 0] == -0.5 and not system.is_conservative
    assert system.smooth_forces.called
    assert system.smooth_forces.values(np.array([2.0]), np.array([3.0]))[0] == 6.0


@pytest.mark.parametrize(
    ("function", "names", "text"),
    [
        (lambda w: w**3 + 0.1 * np.tanh(w), ["w"], "w**3 + tanh(w)/10"),
        (lambda w, w_dot: (w * w - 1) * w_dot, ["w", "w_dot"], "w_dot*(w**2 - 1)"),
        (lambda w: w if w > 0 else 2 * w, ["w"], ""),
        (lambda w: math.sin(w), ["w"], ""),
        (lambda w: np.interp(w, [0.0, 1.0], [0.0, 1.0]), ["w"], ""),
    ],
)
def test_a_function_that_is_a_formula_is_read(function, names, text):
    """Oracle: the formula in the source."""
    assert formula_of(function, names) == text


def test_an_error_of_the_function_reaches_the_user():
    """Oracle: the contract. The error is the cause of the one that is raised, also out of a family that is followed."""

    def force(w):
        if np.any(np.abs(w) > 4.0):
            raise KeyError("beyond the table")
        return cube(w)

    problem = MultipointProblem(oscillator(force), ("origin", "rest"), ())
    y = problem.solve(problem.pack(np.array([0.0, 1.1]), None, [1.4]), energy=0.6).y
    with pytest.raises(FailedForce, match="fails at .*: KeyError: 'beyond the table'") as caught:
        follow_family(problem, y, energy=(0.5, 200.0))
    assert isinstance(caught.value.__cause__, KeyError)
    # The next one is not taken for the former.
    assert Orbit(problem, problem.solve(y, energy=0.7)).residual < 1e-14
