"""Flights with smooth forces. Oracles: elliptic functions, constants of motion, and many digits."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy
from scipy.special import ellipj, ellipk

from bvp.jet_programs import jet_program
from bvp.programs import program_of
from tests.lab.flights import ROUNDING, SmoothFlight

W = sympy.Symbol("w", real=True)


def power_flight(exponent: int, linear, row, push):
    """Flights with one force w^p."""
    program, potential = jet_program([W**exponent], [W])[0], program_of([W ** (exponent + 1) / (exponent + 1)], [W])
    return SmoothFlight(linear, [row], push, program, potential)


def duffing():
    """x'' = -x - x^3."""
    return power_flight(3, [[0.0, 1.0], [-1.0, 0.0]], [1.0, 0.0], [[-1.0]])


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_flights_of_any_size_are_symplectic(n):
    """Oracle: M^T J M = J. Each force depends on all inputs, and the columns do not come in fours."""
    w = sympy.symbols(f"w0:{n}", real=True)
    potential = sum(w) ** 4 / 4 + sum((k + 1) * x**2 * w[0] ** 2 for k, x in enumerate(w))
    program = jet_program([sympy.diff(potential, x) for x in w], list(w))[0]
    linear, places = np.zeros((2 * n, 2 * n)), np.hstack([np.eye(n) + 0.2, np.zeros((n, n))])
    linear[:n, n:], linear[n:, :n] = np.eye(n), -np.diag(1.0 + np.arange(n))
    flight = SmoothFlight(linear, places, -places[:, :n].T, program, program_of([potential], list(w)))
    start = np.linspace(-1.0, 1.3, 2 * n)
    turn = linear.copy()
    turn[n:, :n] = -np.eye(n)
    known = flight.end(start, 1.0).derivatives
    assert np.abs(known.T @ turn @ known - turn).max() < 1e-14 * np.linalg.norm(known, 2) ** 2
    step = 1e-5
    for c in range(2 * n):
        ends = [flight.end(start + sign * step * np.eye(2 * n)[c], 1.0, derivatives=False).state for sign in (1.0, -1.0)]
        assert np.abs((ends[0] - ends[1]) / (2.0 * step) - known[:, c]).max() < 1e-6 * np.abs(known).max()


@pytest.mark.parametrize("inputs", [1, 2])
@pytest.mark.parametrize("forces", [1, 2])
@pytest.mark.parametrize("damped", [False, True])
def test_two_coordinates_move_as_they_do_beside_a_third_one_at_rest(inputs, forces, damped):
    """Oracle: the code for any number of coordinates; two have their own."""
    w = sympy.symbols(f"w0:{inputs}", real=True)
    program = jet_program([w[-1] ** 3, w[0] ** 2 * w[-1] + w[-1]][:forces], list(w))[0]
    potential = program_of([sympy.Integer(0)], list(w))
    maps = []
    for n in (2, 3):
        linear, rows, push = np.zeros((2 * n, 2 * n)), np.zeros((inputs, 2 * n)), np.zeros((n, forces))
        linear[:n, n:] = np.eye(n)
        linear[n : n + 2, :2] = [[-10.0, 10.0], [1.0, -2.0]]
        rows[:, :2] = [[1.0, -1.0], [0.2, 0.7]][:inputs]
        push[:2] = np.array([[-10.0, 0.5], [1.0, -0.3]])[:, :forces]
        if damped:
            linear[n : n + 2, n : n + 2] = [[-0.3, 0.1], [0.2, -0.4]]
            rows[:, n : n + 2] = [[0.05, 0.02], [0.0, 0.1]][:inputs]
        flight = SmoothFlight(linear, rows, push, program, potential)
        moving = [0, 1, n, n + 1]
        start = np.zeros(2 * n)
        start[moving] = [0.3, -0.2, 0.5, 1.0]
        end = flight.end(start, 1.5)
        maps.append(np.column_stack([end.state, end.derivatives])[moving][:, [0, *(1 + k for k in moving)]])
    assert np.abs(maps[0] - maps[1]).max() < 1e-14 * np.linalg.norm(maps[0])


@pytest.mark.parametrize("amplitude", [0.1, 1.0, 10.0, 1000.0])
@pytest.mark.parametrize("part", [0.3, 1.0, 4.0])
def test_duffing_is_elliptic(amplitude, part):
    """Oracle: x = A cn(W t | m), W^2 = 1 + A^2, m = A^2/(2 W^2). The error allowed is a rounding of each step and of the oracle's phase."""
    squared = 1.0 + amplitude**2
    m = amplitude**2 / (2.0 * squared)
    frequency, time = math.sqrt(squared), part * ellipk(m) / math.sqrt(squared)
    end = duffing().end([amplitude, 0.0], time)
    sn, cn, dn, _ = ellipj(frequency * time, m)
    exact = np.array([amplitude * cn, -amplitude * frequency * sn * dn])
    assert np.abs((end.state - exact) / [amplitude, amplitude * frequency]).max() < 2e-14
    assert abs(np.linalg.det(end.derivatives) - 1.0) < 1e-14 * np.linalg.norm(end.derivatives)


def _sink(exponent: int, coupling: float = 0.1):
    """The reference system with the force w^p between its masses in place of stops."""
    linear = np.zeros((4, 4))
    linear[0, 2] = linear[1, 3] = 1.0
    linear[2, :2], linear[3, :2] = [-10.0 * coupling, 10.0 * coupling], [coupling, -1.0 - coupling]
    return power_flight(exponent, linear, [1.0, -1.0, 0.0, 0.0], [[-10.0], [1.0]])


def _energy(z: np.ndarray, exponent: int, coupling: float = 0.1) -> float:
    w = z[0] - z[1]
    return 0.5 * (0.1 * z[2] ** 2 + z[3] ** 2 + z[1] ** 2 + coupling * w * w) + abs(w) ** (exponent + 1) / (exponent + 1)


@pytest.mark.parametrize("exponent", [3, 7, 21, 41, 201])
@pytest.mark.parametrize("energy", [0.02, 1.0, 30.0])
def test_energy_and_volume_are_kept_and_time_can_be_reversed(exponent, energy):
    """Oracle: constants of motion, 1e-13 of the energy; the determinant 1 and the way back, to a rounding of each step with the growth of
    the flight."""
    flight = _sink(exponent)
    start = np.array([0.0, 0.0, 0.5, 1.0])
    start *= math.sqrt(energy / _energy(start, exponent))
    end = flight.end(start, 1.5)
    rounding = ROUNDING * end.steps * np.linalg.norm(end.derivatives)
    assert abs(_energy(end.state, exponent) / energy - 1.0) < 1e-13
    assert abs(np.linalg.det(end.derivatives) - 1.0) < rounding
    assert np.abs(flight.end(end.state, -1.5, derivatives=False).state - start).max() < rounding * math.sqrt(energy)


def test_a_force_that_begins_with_a_high_power_is_not_missed():
    """Oracle: the same flight begun a little earlier. From w = 0 no coefficient up to the order of the series shows w^41."""
    flight = _sink(41, 0.0)
    start = np.array([0.0, 0.0, 8.0, 0.2])
    middle = flight.end(start, 0.05, derivatives=False).state
    later, whole = flight.end(middle, 0.25, derivatives=False).state, flight.end(start, 0.3, derivatives=False).state
    assert np.abs(later - whole).max() < 1e-12
    assert whole[2] < 0.0


@pytest.mark.parametrize("scale", np.linspace(0.9, 1.02, 25))
def test_no_step_jumps_over_a_near_contact(scale):
    """Oracle: the same flight in eighty parts. The gap turns inside it where w^201 begins to count, and at both ends of a long step it
    does not count at all."""
    flight, time = _sink(201), 1.64
    start = scale * np.array([0.0, 0.0, 3.3117, 5.2784])
    state, growth = start, np.eye(4)
    for _ in range(80):
        end = flight.end(state, time / 80)
        state, growth = end.state, end.derivatives @ growth
    for with_columns in (False, True):
        end = flight.end(start, time, with_columns)
        assert np.abs(end.state - state).max() < 1e-13 * np.linalg.norm(growth)
    assert np.abs(end.derivatives - growth).max() < 1e-10 * np.linalg.norm(growth)


@pytest.mark.parametrize("speed", [0.0, 1e-5, -1e-5])
@pytest.mark.parametrize(("turn", "size"), [(0.35, 1200.0), (0.3, 2500.0), (0.2, 12000.0)])
def test_no_step_jumps_over_a_near_contact_after_rest(speed, turn, size):
    """Oracle: the same flight in eighty parts. An input that begins at rest, or nearly, turns in the first third of a long step."""
    program, potential = jet_program([sympy.exp(200 * (W - 1))], [W])[0], program_of([sympy.exp(200 * (W - 1)) / 200], [W])
    linear = np.zeros((6, 6))
    linear[:3, 3:] = np.eye(3)
    linear[3, 0], linear[4, 1] = -1.0, -0.25
    slow = 4.0 * math.cos(0.5 * turn)
    highest = size * (slow * math.cos(0.5 * turn) - math.cos(turn))
    flight = SmoothFlight(linear, [[-size, size, 1.0, 0.0, 0.0, 0.0]], [[0.0], [0.0], [-1.0]], program, potential)
    start = np.array([1.0, slow, 1.0 - highest, 0.0, 0.0, speed])
    state = start
    for _ in range(80):
        state = flight.end(state, 1.5 / 80, derivatives=False).state
    assert abs(state[5]) > 0.01 and np.abs(flight.end(start, 1.5, derivatives=False).state - state).max() < 1e-9


def test_the_derivative_is_that_of_the_flight():
    """Oracle: central differences of two lengths, extrapolated."""
    flight = _sink(7)
    start = np.array([0.1, -0.2, 1.5, 0.7])

    def end(z):
        return flight.end(z, 1.2, derivatives=False).state

    derivatives = flight.end(start, 1.2).derivatives
    for c in range(4):
        slopes = [(end(start + h * np.eye(4)[c]) - end(start - h * np.eye(4)[c])) / (2.0 * h) for h in (1e-3, 5e-4)]
        assert np.abs((4.0 * slopes[1] - slopes[0]) / 3.0 - derivatives[:, c]).max() < 1e-8


def test_a_flight_with_too_many_steps_is_given_up():
    """Oracle: the answer: no end."""
    assert duffing().end([1.0, 0.0], 1e4, derivatives=False) is None


@pytest.mark.parametrize("speed", [1e10, 1e150])
def test_a_motion_that_leaves_the_range_of_numbers_is_given_up(speed):
    """Oracle: the answer, soon. The coefficients of w^21 have no numbers there."""
    flight = power_flight(21, [[0.0, 1.0], [0.0, 0.0]], [1.0, 0.0], [[-1.0]])
    assert flight.end([0.0, speed], 1.0, derivatives=False) is None
