"""Orbits with smooth forces at one energy. Oracles: the complete search of linear flights, families of linear modes, another integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import saltus
from branches.naming.at_modes import orbit_at_mode
from branches.naming.search import MORE
from branches.search.discovery import discover_orbits
from branches.search.smooth_starts import SmoothSampler
from branches.tracing import follow_family
from bvp.smooth_flights import sample_path
from bvp.system import ImpactSystem


def numbers(found):
    """Labels, energies and quarter periods of a discovery."""
    return [orbit.label.rstrip("+-") for orbit in found.orbits], np.array([orbit.alpha for orbit in found.orbits])


def test_a_spring_of_no_strength_leaves_the_orbits_of_linear_flights():
    """Oracle: the complete search of the system without the spring, to 1e-12."""
    bounds = {"quarter_period": 2.0, "impacts": 4}
    exact = discover_orbits(saltus.load_scene("lee2009", sigma=0.0).system, 2.0, **bounds)
    found = discover_orbits(saltus.load_scene("cubic_and_stops", k3=1e-30).system, 2.0, **bounds, budget=256)
    assert exact.complete and not found.complete and found.angles == (128, 256)
    assert numbers(found)[0] == numbers(exact)[0] and len(exact.orbits) == 5
    np.testing.assert_allclose(numbers(found)[1], numbers(exact)[1], rtol=1e-12)


def test_stops_that_are_not_reached_change_nothing():
    """Oracle: the scene without stops."""
    system = saltus.load_scene("cubic_nes").system
    far = {**system.describe(), "stops": [{"c": [1.0, -1.0], "lower": -100.0, "upper": 100.0}]}
    bounds = {"quarter_period": 2.0, "budget": 64, "ends": ("origin-origin",)}
    free = discover_orbits(system, 1.0, **bounds)
    stopped = discover_orbits(ImpactSystem.from_description(far), 1.0, **bounds)
    assert [orbit.ends for orbit in stopped.orbits] == [orbit.ends for orbit in free.orbits] and len(free.orbits) == 7
    np.testing.assert_allclose(numbers(stopped)[1], numbers(free)[1], rtol=1e-12)


def test_covers_are_left_out():
    """Oracle: whole multiples of the quarter period of S11-, up to its 8-fold cover, have its start."""
    found = discover_orbits(saltus.load_scene("cubic_nes").system, 1.0, quarter_period=2.4, budget=64)
    first, *others = found.orbits
    assert first.label == "S11-" and found.counts["covers"] > 4
    apart = [np.max(np.abs(np.abs(orbit.velocities) - np.abs(first.velocities))) for orbit in others]
    assert min(apart) > 1e-3


@pytest.mark.parametrize("mode", [1, 2])
def test_the_families_of_the_modes_are_found(mode):
    """Oracle: the families of the linear modes, followed to this energy."""
    scene = saltus.load_scene("duffing_pair")
    first = orbit_at_mode(f"mode:{mode}", scene.system, (1e-3, 1.2))
    (orbit,) = follow_family(first.problem, first.solution.y, energy=(1e-3, 1.2)).orbits_at(energy=1.0)
    found = discover_orbits(scene.system, 1.0, quarter_period=2.0, budget=32)
    assert min(abs(other.alpha / orbit.alpha - 1.0) for other in found.orbits) < 1e-12


def test_orbits_with_impacts_agree_with_another_integrator():
    """Oracle: DOP853 from the origin, reflected at the stops, hits the stop at a right angle after a quarter period."""
    system = saltus.load_scene("cubic_and_stops").system
    found = discover_orbits(system, 6.0, quarter_period=1.7, impacts=5, budget=128, ends=("origin-stop",))
    several = [orbit for orbit in found.orbits if orbit.sequence]
    assert several
    mass, gap = system.mass, np.array([1.0, -1.0])
    push = np.linalg.solve(mass, gap)

    def rate(_, z):
        force = 0.5 * (z[0] - z[1]) ** 3
        return np.array([z[2], z[3], -force / 0.1, force - z[1]])

    def contact(_, z):
        return 1.0 - abs(z[0] - z[1])

    contact.terminal, contact.direction = True, -1.0
    for orbit in several:
        z, time = np.array([0.0, 0.0, *orbit.velocities]), 0.0
        for _ in range(len(orbit.sequence) + 1):
            flight = solve_ivp(rate, (0.0, 9.0), z, "DOP853", events=contact, rtol=1e-12, atol=1e-13)
            z, time = flight.y_events[0][0], time + flight.t_events[0][0]
            before = z.copy()
            z[2:] -= 2.0 * (gap @ z[2:]) / (gap @ push) * push
        assert abs(time / orbit.alpha - 1.0) < 1e-9
        # At the far end the momentum along the stop is zero.
        assert abs((mass @ before[2:]).sum()) < 1e-8


@pytest.mark.parametrize("end", ["rest"])
def test_motions_of_few_half_waves_are_searched_as_all_are(end):
    """Oracle: see `require_motions_of_few_half_waves_are_searched_as_all_are`."""
    require_motions_of_few_half_waves_are_searched_as_all_are(end)


def require_motions_of_few_half_waves_are_searched_as_all_are(end):
    """Oracle: the scan without a limit, and the sign changes of both velocities along its segments, by dense sampling."""
    system = saltus.load_scene("cubic_nes").system
    limit = np.array([3, 2])  # neighbouring motions can have more
    every = list(SmoothSampler(system, end, 6.0, [0]).segments(1.0, 48))
    few = list(SmoothSampler(system, end, 6.0, [0], tuple(limit + MORE)).segments(1.0, 48))
    inside = []
    for segment in every:
        times = np.linspace(0.0, segment.flight_times.sum(), 2001)[:-2]
        states = np.empty((len(times), 4))
        sample_path(system, np.zeros(1), segment.start[None, :], times, states)
        velocities = states @ system.modes.to_state[2:].T
        waves = np.count_nonzero(np.diff(np.sign(velocities), axis=0), axis=0)
        if np.all(waves[[system.absorber, system.primary]] <= limit):
            inside.append(segment)
    found = np.array([[segment.parameter, segment.flight_times.sum()] for segment in few])
    assert 0 < len(inside) <= len(few) < len(every)
    for segment in inside:
        assert np.min(np.abs(found - [segment.parameter, segment.flight_times.sum()]).max(axis=1)) < 1e-3
