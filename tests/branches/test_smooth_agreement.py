"""Smooth conservative orbits by independent methods. Oracles: DOP853 with the equation of variations, harmonic balance, closed forms of
linear modes, and the energy."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from branches.branch import Branch
from branches.naming.at_modes import orbit_at_mode
from branches.orbit import Orbit
from branches.tracing import follow_family
from bvp.multipoint import MultipointProblem
from bvp.released import ReleasedProblem
from bvp.springs import Spring
from bvp.system import ImpactSystem
from saltus.scene import load_scene
from tests.branches.smooth_second import OneSpring
from tests.branches.test_smooth_families import sink


def second(system: ImpactSystem) -> OneSpring:
    """The same system, as the other methods have it."""
    (spring,) = system.describe()["springs"]
    row = np.array(spring["c"])
    return OneSpring(np.array(system.mass), np.array(system.stiffness), row, spring["stiffness"], int(spring["power"]))


@cache
def family(scene: str, mode: str, low: float, high: float, **values: float) -> Branch:
    first = orbit_at_mode(mode, load_scene(scene, **values).system, (low, high))
    return follow_family(first.problem, first.solution.y, energy=(low, high))


FAMILIES = [
    ("cubic_nes", {}, "mode:2", (1e-3, 2.0), (0.002, 0.02, 0.1, 0.5, 1.5)),
    ("smooth_wall", {"n": 3}, "mode:1", (0.02, 4.0), (0.05, 0.2, 1.0, 2.0, 3.9)),
    ("smooth_wall", {"n": 10}, "mode:1", (0.02, 4.0), (0.05, 0.2, 1.0, 2.0, 3.9)),
    ("smooth_wall", {"n": 20}, "mode:1", (0.02, 4.0), (0.05, 0.2, 1.0, 2.0, 3.9)),
    ("smooth_wall", {"n": 100}, "mode:1", (0.02, 4.0), (0.05, 0.2, 1.0, 2.0, 3.9)),
    ("smooth_wall", {"n": 3}, "mode:2", (0.02, 4.0), (0.05, 0.2, 1.0, 2.0, 3.9)),
    ("duffing_pair", {}, "mode:1", (1e-3, 20.0), (0.01, 0.1, 1.0, 5.0, 19.0)),
    ("duffing_pair", {}, "mode:2", (1e-3, 20.0), (0.01, 0.1, 1.0, 5.0, 19.0)),
]


@pytest.mark.parametrize(("scene", "values", "mode", "energy", "energies"), [FAMILIES[0], *FAMILIES[-2:]])
def test_a_second_integrator_agrees(scene, values, mode, energy, energies):
    """Oracle: see `require_a_second_integrator_agrees`."""
    require_a_second_integrator_agrees(scene, values, mode, energy, energies[::2])


def require_a_second_integrator_agrees(scene, values, mode, energy, energies):
    """Oracle: DOP853 at 1e-13, whose orbit Newton's method solves. The quarter period has its error, times a condition of at most 30; the
    trace of the period's derivative, which grows by up to some hundred at n = 100, has five digits less."""
    branch = family(scene, mode, *energy, **values)
    other = second(branch.system)
    hard = values.get("n") == 100
    for h in energies:
        orbit = branch.orbits_at(energy=h)[0]
        velocities, time, _ = other.quarter(np.array(orbit.velocities), orbit.alpha, h)
        assert abs(time / orbit.alpha - 1.0) < (1e-10 if hard else 1e-12)
        assert np.abs(velocities / orbit.velocities - 1.0).max() < 1e-10
        end, columns = other.flown(np.concatenate([np.zeros(2), velocities]), 4.0 * time)
        assert np.abs(end[2:] - velocities).max() < 1e-12 * np.abs(velocities).max() * max(1.0, np.abs(columns).max())
        assert abs((np.trace(columns) - 2.0) / orbit.tau - 1.0) < (1e-8 if hard else 1e-9)


@pytest.mark.parametrize(("scene", "values", "mode", "energy", "energies"), FAMILIES)
def test_the_energy_is_constant_along_orbits(scene, values, mode, energy, energies):
    """Oracle: kinetic energy and potential of the matrices and the spring, at samples of the period."""
    branch = family(scene, mode, *energy, **values)
    other = second(branch.system)
    for h in energies:
        orbit = branch.orbits_at(energy=h)[0]
        u, v = orbit.sample(np.linspace(0.0, orbit.period, 60))
        assert max(abs(other.energy(*state) / h - 1.0) for state in zip(u, v, strict=True)) < 1e-13


def balanced(orbit: Orbit, count: int) -> tuple[np.ndarray, float]:
    """Harmonic balance from samples of an orbit, with odd sines."""
    samples = 4 * count
    u, _ = orbit.sample(np.arange(samples) * orbit.period / samples)
    orders = np.arange(1, 2 * count, 2)
    guess = np.sin(np.outer(orders, 2.0 * math.pi * np.arange(samples) / samples)) @ u * (2.0 / samples)
    return second(orbit.system).balanced(guess, 2.0 * math.pi / orbit.period, orbit.h)


@pytest.mark.parametrize(
    ("scene", "values", "mode", "energy", "energies", "count"),
    [
        ("cubic_nes", {}, "mode:2", (1e-3, 2.0), (0.01, 0.5), 24),
        ("smooth_wall", {"n": 3}, "mode:1", (0.02, 4.0), (0.3, 1.0), 48),
        ("duffing_pair", {}, "mode:1", (1e-3, 20.0), (1.0, 19.0), 24),
        ("duffing_pair", {}, "mode:2", (1e-3, 20.0), (5.0,), 24),
    ],
)
def test_harmonic_balance_agrees(scene, values, mode, energy, energies, count):
    """Oracle: harmonic balance with so many odd sines that the last is rounding: frequency and amplitudes of the orbit."""
    branch = family(scene, mode, *energy, **values)
    for h in energies:
        _agrees(branch.orbits_at(energy=h)[0], count)


@pytest.mark.parametrize("h", [0.01])
def test_harmonic_balance_agrees_in_ten_degrees_of_freedom(h):
    """Oracle: see `require_harmonic_balance_agrees_in_ten_degrees_of_freedom`."""
    require_harmonic_balance_agrees_in_ten_degrees_of_freedom(h)


def require_harmonic_balance_agrees_in_ten_degrees_of_freedom(h):
    """Oracle: the same, of the beam."""
    orbit = orbit_at_mode("mode:1", load_scene("beam_on_cubic_spring").system, (h, 2.0 * h))
    _agrees(orbit, 16)


def _agrees(orbit: Orbit, count: int) -> None:
    amplitudes, rate = balanced(orbit, count)
    assert np.abs(amplitudes[-1]).max() < 1e-14 * np.abs(amplitudes).max()
    assert abs(rate * orbit.alpha / (0.5 * math.pi) - 1.0) < 1e-12
    times = np.linspace(0.0, orbit.period, 40)
    u = np.sin(np.outer(times, rate * np.arange(1, 2 * count, 2))) @ amplitudes
    assert np.abs(orbit.sample(times)[0] - u).max() < 1e-11 * np.abs(u).max()


def test_harmonic_balance_agrees_between_stops_that_are_not_reached():
    """Oracle: the same, for the scene with stops, in an orbit that stays between them."""
    system = load_scene("cubic_and_stops").system
    (spring,) = system.describe()["springs"]
    springs = (Spring(tuple(spring["c"]), stiffness=spring["stiffness"], power=spring["power"]),)
    open_one = ImpactSystem(system.mass, np.zeros((2, 2)), system.stiffness, (), absorber=0, primary=1, springs=springs)
    first = orbit_at_mode("mode:2", open_one, (1e-3, 0.05))
    start = follow_family(first.problem, first.solution.y, energy=(1e-3, 0.05)).orbits_at(energy=0.01)[0]
    problem = MultipointProblem(system, ("origin", "rest"), ())
    orbit = Orbit(problem, problem.solve(problem.pack([0.0, 0.0, *start.solution.y[:2]], None, [start.alpha]), energy=0.01))
    assert np.abs(orbit.sample(np.linspace(0.0, orbit.period, 200))[0] @ np.array(spring["c"])).max() < 1.0
    _agrees(orbit, 24)


@pytest.mark.parametrize("out_of_phase", [False, True])
def test_walls_of_power_one_give_the_linear_modes(out_of_phase):
    """Oracle: the roots of det(K - w^2 M) in closed form, where the spring of the walls adds 1 to sigma; the real power flies as any."""
    mu, sigma = 0.1, 1.1
    middle, product = 0.5 * (sigma / mu + 1.0 + sigma), sigma / mu
    square = middle + math.sqrt(middle**2 - product)
    square = square if out_of_phase else product / square
    parametric = load_scene("smooth_wall").parametric
    problem = ReleasedProblem(parametric, ("origin", "rest"), (), ["n"], ["energy = 0.5"], values={"n": 0.0})
    shape = np.array([sigma / (sigma - mu * square), 1.0])
    velocities = shape / math.sqrt(mu * shape[0] ** 2 + shape[1] ** 2)
    quarter = 0.5 * math.pi / math.sqrt(square)
    y = problem.solve(problem.pack([[0.0, 0.0, *velocities]], [0.0], [0.0], [1.01 * quarter])).y
    assert abs(float(np.sum(problem.flight_times(y))) / quarter - 1.0) < 1e-13
    assert np.abs(problem.nodes(y)[0, 2:4] - velocities).max() < 1e-13 * np.abs(velocities).max()


@pytest.mark.parametrize(("n", "folds"), [(10, ()), (13, ()), (14, ()), (15, (0.064581662405999, 0.064652545529434))])
def test_folds_of_the_out_of_phase_family_appear_between_fourteen_and_fifteen(n, folds):
    """Oracle: the published digits; and by DOP853 the energy of orbits at quarter periods around a fold, whose parabola turns there."""
    system = sink(2 * n + 1, 0.1, 0.1)
    first = orbit_at_mode("mode:2", system, (0.02, 0.2))
    branch = follow_family(first.problem, first.solution.y, energy=(0.02, 0.2))
    found = sorted((event for event in branch.events if event.type == "SN"), key=lambda event: event.h)
    assert [event.h for event in found] == pytest.approx(folds, abs=1e-13)
    assert {str(label) for label in branch.points["label"]} == {"S11-"}
    other = second(system)
    for event in found:
        places, energies = event.alpha * (1.0 + 1e-4 * np.array([-1.0, 0.0, 1.0])), []
        for alpha in places:
            velocities = branch.orbit(event.point).velocities.copy()
            for _ in range(4):
                end, columns = other.flown(np.concatenate([np.zeros(2), velocities]), float(alpha))
                velocities = velocities - np.linalg.solve(columns[2:, 2:], end[2:])
            energies.append(0.5 * velocities @ other.mass @ velocities)
        bend, slope, level = np.polyfit((places - event.alpha) / event.alpha * 1e4, energies, 2)
        assert abs(bend) > 1e-13 and abs(level - slope**2 / (4.0 * bend) - event.h) < 1e-12
