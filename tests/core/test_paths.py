"""Single flights of the core at many times, and what a problem says of its orbits. Oracles: flights of one time each, and numpy."""

import numpy as np
import pytest
import saltus_core as core
import sympy

from branches.naming.at_modes import orbit_at_mode
from bvp.jet_programs import jet_program
from bvp.programs import program_of
from bvp.smooth_flights import core_arrays, flight_of
from bvp.system import vibro_impact_nes
from saltus.scene import load_scene
from tests.core.smooth_systems import chain, states

W = sympy.Symbol("w", real=True)

SYSTEMS = {"linear": vibro_impact_nes, "smooth": lambda: chain(2)}


@pytest.mark.parametrize("name", SYSTEMS)
def test_states_along_a_path_are_ends_of_flights(name):
    """A smooth flight of another time has other steps."""
    system = SYSTEMS[name]()
    flight = flight_of(system)
    for z in states(system, 4):
        path = core.path(flight, z, 5.0)
        times = np.linspace(0.0, 5.0, 7)
        for t, sampled in zip(times, core.sample(flight, z, times), strict=True):
            state, rate = path.motion(t)
            np.testing.assert_allclose(state, flight.end(z, t), rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(rate, flight.rate(state), rtol=1e-14)
            np.testing.assert_allclose(sampled, state, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", SYSTEMS)
def test_crossings_and_rises_are_where_a_displacement_vanishes(name):
    """Rises are every other crossing."""
    system = SYSTEMS[name]()
    flight, matrix, row = flight_of(system), system.modes.matrix, np.array([1.0, 0.5, 0.0, 0.0])
    rows = np.array([row, row @ matrix, row @ matrix @ matrix])
    for z in states(system, 4):
        path = core.path(flight, z, 40.0)
        times = path.crossings(rows)
        assert len(times) > 3 and max(abs(row @ path.state(t)) for t in times) < 1e-11
        rises, sign = path.rises(rows, 0)
        assert sign in (-1, 1) and set(np.round(rises, 9)) <= set(np.round(times, 9)) and abs(2 * len(rises) - len(times)) <= 1
        assert all(rows[0] @ path.motion(t)[1] > 0.0 for t in rises)


def test_a_flight_of_too_many_steps_is_sampled_in_parts():
    """Oracle: twice as many flights of half the time, from end to end."""
    system = chain(1)
    flight, z = flight_of(system), np.array([1.0, 0.5])
    assert not flight.path(z, 2000.0).complete
    times, state = np.linspace(0.0, 2000.0, 201), z
    found = core.sample(flight, z, times)
    for k in range(1, 201):
        state = flight.end(state, 10.0)
        np.testing.assert_allclose(found[k], state, rtol=0.0, atol=1e-9)


def test_what_is_known_before_a_motion_leaves_the_numbers():
    """Oracle: shorter flights. x'' = -x + x^3 from beyond its maximum of energy is infinite after a finite time."""
    program, potential = jet_program([W**3], [W])[0], program_of([-(W**4) / 4], [W])
    flight = core_arrays(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[1.0, 0.0]]), np.ones((1, 1)), np.ones(2), program, potential)
    z, low, high = np.array([1.2, 0.0]), 0.0, 10.0
    while high - low > 1e-12:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if flight.path(z, middle).complete else (low, middle)
    times = np.append(np.linspace(0.0, 0.9999, 40) * low, [1.001 * high, 10.0])
    found = core.sample(flight, z, times)
    assert np.isnan(found[-2:]).all() and low > 1.0
    for t, state in zip(times[:-2], found[:-2], strict=True):
        np.testing.assert_allclose(state, flight.end(z, t), rtol=1e-9)
    rows = np.array([[[1.0, 0.0]], [[0.0, 1.0]]])
    assert not core.raise_peaks(flight, *rows, z, 10.0, np.zeros(1), np.zeros(1))


def test_times_and_durations_are_checked():
    """Times before a smooth flight have no state; the sampled ones are finite, and ascend."""
    flight, z = flight_of(chain(2)), np.array([0.3, 0.1, 0.2, -0.4])
    path = core.path(flight, z, 1.0)
    assert np.isnan(path.state(-0.1)).all() and np.isnan(path.state(1.1)).all()
    for times in ([0.2, 0.1], [0.1, np.nan], [0.1, np.inf]):
        with pytest.raises(ValueError, match="times are finite, and ascend"):
            core.sample(flight, z, np.array(times))
    for duration, parts in ((-1.0, 4), (np.nan, 4), (1.0, 0), (1.0, -3)):
        with pytest.raises(ValueError, match="from 1 to a million parts"):
            core.slowest_instants(flight, z, duration, False, parts)


def test_growth_and_lengths_of_directions():
    """Oracles: the map of the one flight, relative to sizes; differences of the coordinates of the arclength."""
    orbit = orbit_at_mode("mode:1", load_scene("duffing_pair").system, (1.0, 2.0))
    problem, y = orbit.problem, orbit.solution.y
    start, time = problem.start(y), float(problem.flight_times(y)[0])
    end, flown = problem.orbits.flight.end_with_map(start, time)
    size = np.repeat(np.abs([start, end]).max(axis=0).reshape(2, -1).max(axis=1), problem.half)
    size[problem.half :] = max(size[-1], np.sqrt(2.0 * orbit.h))
    assert problem.growth(y) == pytest.approx(np.max(np.abs(flown) * size / size[:, None]), rel=1e-13)
    direction, zero = np.linspace(-1.0, 1.0, len(y)), np.zeros(len(y))
    ahead, back = (problem.orbits.core.course(y + s * 1e-6 * direction, zero)[0] for s in (1.0, -1.0))
    assert problem.orbits.length(y, direction) == pytest.approx(np.linalg.norm(ahead - back) / 2e-6, rel=1e-8)
