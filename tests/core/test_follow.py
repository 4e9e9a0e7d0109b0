"""One start followed with its derivative. Oracles: the event-driven run; central differences; dense samples of the flight."""

import math
from itertools import pairwise

import numpy as np
import pytest
from saltus_core import FlightRecord, PlanarSystem, StartMap, positive_between

import saltus
from branches.search.starts import curves
from tests.core.test_next_impact import Searches

LONGEST = 9.0 / 1.05
"""Turning points are looked for in 1.05 times as long."""

SYSTEMS = [saltus.vibro_impact_nes(), saltus.vibro_impact_nes(0.37, 0.81), saltus.vibro_impact_nes(1.0, 0.0)]


def flights_of(curve, parameter, longest=9.0, most=6):
    return curve.starts.follow(parameter, longest, math.inf, most)


def test_a_flight_that_begins_too_late_is_not_followed():
    """Oracle: the same start followed through all its flights. The slack is a twentieth of the longest time."""
    (curve,) = curves(SYSTEMS[0], "stop", 5.0)
    full = flights_of(curve, 0.4)
    assert len(full) > 4 and full[3].time > 0.5
    for before, is_followed in ((0.44, True), (0.46, False)):
        flights = curve.starts.follow(0.4, 9.0, full[3].time - before, 3)
        assert len(flights) == 4
        assert [(one.time, one.duration, one.contact) for one in flights[:3]] == [(one.time, one.duration, one.contact) for one in full[:3]]
        assert np.array_equal(flights[3].state, full[3].state) and flights[3].time == full[3].time
        assert flights[3].contact == (full[3].contact if is_followed else FlightRecord.AHEAD)


def start_of(curve, parameter):
    return flights_of(curve, parameter, most=0)[0].state


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("end", ["origin", "rest", "stop"])
def test_impacts_are_those_of_the_run(system, end):
    """Oracle: `saltus.simulate`, whose events share only the search for the next impact."""
    (curve,) = curves(system, end, 1.3)
    modes = system.modes
    total = 0
    for part in (0.17, 0.52, 0.83):
        flights = flights_of(curve, curve.low + part * (curve.high - curve.low))
        state = modes.to_state @ flights[0].state
        leaving = "+" if end == "stop" else None
        met = saltus.simulate(system, state[:2], state[2:], 9.0, leaving=leaving).stop_events
        hits = [flight for flight in flights if flight.contact >= 0 and flight.time + flight.duration < 9.0]
        assert len(hits) == min(len(met.times), 7)
        total += len(hits)
        assert np.allclose([flight.time + flight.duration for flight in hits], met.times[: len(hits)], rtol=1e-12)
        assert np.allclose([flight.speed for flight in hits], met.speeds[: len(hits)], rtol=1e-9)
        assert tuple(modes.contact_letters[flight.contact] for flight in hits) == met.contacts[: len(hits)]
    assert total > 3


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("end", ["origin", "rest", "stop"])
def test_energy_of_the_starts(system, end):
    """Oracle: the energy asked for, and the conditions of the end, all along the curve."""
    (curve,) = curves(system, end, 1.3)
    modes = system.modes
    for parameter in np.linspace(curve.low, curve.high, 23):
        z = start_of(curve, parameter)
        state = modes.to_state @ z
        assert system.energy(state[None, :2], state[None, 2:])[0] == pytest.approx(1.3, rel=1e-13)
        w, rate = state[0] - state[1], state[2] - state[3]
        if end == "origin":
            assert np.all(state[:2] == 0.0)
        elif end == "rest":
            assert np.all(state[2:] == 0.0) and abs(w) <= 1.0 + 1e-12
        else:
            assert w == pytest.approx(1.0, abs=1e-13) and rate <= 1e-12
            # an impulse between the two bodies alone stops the motion and turns it round
            momentum = system.mass @ state[2:]
            assert abs(momentum.sum()) < 1e-13 * np.abs(momentum).max() + 1e-15


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("end", ["origin", "rest", "stop"])
def test_derivatives(system, end):
    """Oracle: central differences; their error falls fourfold when the step is halved."""
    (curve,) = curves(system, end, 6.0)
    numbers = ("time", "duration", "speed", "residual")

    def values(flights):
        return np.array([[*one.state, *(getattr(one, name) for name in numbers)] for one in flights])

    parameter = curve.low + 0.37 * (curve.high - curve.low)
    middle = flights_of(curve, parameter)
    flights = len(middle) - 1 if middle[-1].contact < 0 else len(middle)
    exact = np.array([[*one.derivative, *(getattr(one, name + "_rate") for name in numbers)] for one in middle[:flights]])
    errors = []
    for step in (2e-5, 1e-5):
        above, below = (flights_of(curve, parameter + sign * step)[:flights] for sign in (1.0, -1.0))
        assert [one.contact for one in above] == [one.contact for one in middle[:flights]]
        difference = (values(above) - values(below)) / (2.0 * step)
        errors.append(np.max(np.abs(difference - exact) / (1.0 + np.abs(exact))))
    assert flights >= 2 and errors[1] < 1e-3
    assert errors[1] < 0.3 * errors[0] or errors[1] < 1e-8


def test_turning_points():
    """Oracle: extrema of dense samples of each flight."""
    system = saltus.vibro_impact_nes()
    (curve,) = curves(system, "origin", 0.4)
    modes = system.modes
    for part in np.linspace(0.02, 0.98, 17):
        for flight in flights_of(curve, curve.low + part * np.pi):
            duration = min(flight.duration, 9.0 - flight.time)
            if duration < 1e-3:
                continue
            curve.starts.find_clearance(flight, LONGEST)
            times = np.linspace(0.0, duration, 20001)
            w = np.zeros_like(times)
            for j in range(2):
                o = modes.frequencies[j]
                w += modes.contacts.gap[0, j] * (flight.state[j] * np.cos(o * times) + flight.state[2 + j] * np.sin(o * times) / o)
            turns = np.flatnonzero((w[1:-1] - w[:-2]) * (w[2:] - w[1:-1]) < 0.0) + 1
            distances = sorted(1.0 - w[i] if w[i] > w[i - 1] else 1.0 + w[i] for i in turns)
            assert flight.turning_points == len(turns)
            expected = [*distances, np.inf, np.inf][:2]
            assert np.allclose([flight.clearance, flight.second], expected, rtol=0.0, atol=1e-6)


def test_clearance_changes_as_its_derivative_says():
    """Oracle: central differences."""
    (curve,) = curves(saltus.vibro_impact_nes(), "origin", 3.0)
    checked = 0
    for parameter in np.linspace(0.5, 3.2, 60):
        sides = []
        for step in (-1e-6, 0.0, 1e-6):
            sides.append(flights_of(curve, parameter + step))
            for flight in sides[-1]:
                curve.starts.find_clearance(flight, LONGEST)
        for below, here, above in zip(*sides, strict=False):
            if np.isfinite(here.clearance) and here.contact >= 0 and np.isfinite(below.clearance + above.clearance):
                slope = (above.clearance - below.clearance) / 2e-6
                assert slope == pytest.approx(here.clearance_rate, rel=1e-4, abs=1e-4)
                checked += 1
    assert checked > 10


def test_acceleration_towards_the_stop():
    """Oracle: w'' of the flight by its own equation, along the side of the contact."""
    system = saltus.vibro_impact_nes()
    (curve,) = curves(system, "origin", 0.4)
    modes, flights = system.modes, flights_of(curve, 1.1)
    for flight, following in pairwise(flights):
        force = -(modes.squares * following.state[:2]) @ modes.contacts.gap[flight.contact, :2]
        assert flight.acceleration == pytest.approx(modes.contacts.side[flight.contact] * force, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("roots", [(False, False), (True, False), (False, True), (True, True)])
def test_places_and_their_inverse(roots):
    """Oracle: the definition: inverse functions, derivative by central differences, both ends kept."""
    curve = StartMap(0.4, 1.1, *roots)
    for x in (0.003, 0.2, 0.5, 0.81, 0.997):
        theta, rate = curve.place(x)
        assert curve.unplace(theta) == pytest.approx(x, rel=1e-10)
        assert rate == pytest.approx((curve.place(x + 1e-6)[0] - curve.place(x - 1e-6)[0]) / 2e-6, rel=1e-5)
    assert [curve.place(x)[0] for x in (0.0, 1.0)] == pytest.approx([0.4, 1.1], abs=1e-16)


def test_positive_is_said_only_of_what_is():
    """Oracle: parabolas, dense samples."""
    generator = np.random.default_rng(4)
    said = wrong = 0
    for a, b, c in generator.normal(size=(4000, 3)):
        x = np.linspace(-1.0, 1.0, 401)
        f = a + b * x + c * x * x
        if positive_between(a - b + c, b - 2.0 * c, a, b, a + b + c, b + 2.0 * c, 1.0, 0.0):
            said += 1
            wrong += bool(f.min() <= 0.0)
    assert said > 150 and wrong == 0


@pytest.mark.parametrize("square", [2.3, 0.0, -0.7])
def test_amplitudes_bound_a_mode_and_its_derivatives(square):
    """Oracle: the mode in closed form, sampled: cosine, straight line or hyperbolic cosine. They are reached
    where no part cancels another."""
    system = PlanarSystem([square, 1.0], Searches(SYSTEMS[0]).contacts, -1.0, 1.0)
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 4.0, 4001)
    root = np.sqrt(abs(square))
    c, s = {2.3: (np.cos, np.sin), 0.0: (np.ones_like, np.copy), -0.7: (np.cosh, np.sinh)}[square]
    for q, p in rng.normal(size=(20, 2)):
        cosine, sine = c(root * t), s(root * t) / root if root else t
        path = (q * cosine + p * sine, p * cosine - square * q * sine)
        for order, values in enumerate((*path, -square * path[0])):
            bound, largest = system.amplitude(0, [q, 0.0, p, 0.0], 4.0, order), np.max(np.abs(values))
            assert largest <= bound * (1.0 + 1e-12)
            if square > 0.0 or q * p > 0.0:
                assert largest >= 0.99 * bound


def test_more_turning_points_than_are_looked_through_leave_nothing_known():
    """Oracle: a mode of frequency 3e5 has a million turning points in ten time units, one of 3 has ten."""
    for mu, known in ((0.1, True), (1e-12, False)):
        (curve,) = curves(saltus.vibro_impact_nes(mu=mu), "origin", 1e-9)
        flight = FlightRecord()
        flight.state, flight.duration = [0.0, 0.0, 1e-5, 1e-5], math.inf
        curve.starts.find_clearance(flight, 10.0 / 1.05)
        assert (flight.clearance > 0.0) is known and (flight.clearance == -math.inf) is not known
