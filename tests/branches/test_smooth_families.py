"""Families of smooth motion. Oracles: elliptic functions, an independent integrator, constants of motion, and closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import beta, ellipk, ellipkm1

from branches import full_family
from branches.family import Family
from branches.naming.at_modes import orbit_at_mode
from branches.naming.families import trace_named
from branches.naming.matching import NameNotFound
from branches.tracing import follow_family
from bvp.multipoint import MultipointProblem
from bvp.springs import Spring
from bvp.system import ImpactSystem
from saltus.scene import load_scene
from tests.lab.flights import limit_steps

STEPS = 8
"""Taylor steps that the flights of S11- take between its two folds, and a little above."""


def duffing(cubic: float = 1.0) -> ImpactSystem:
    """x'' + x + cubic x^3 = 0."""
    return ImpactSystem([[1.0]], [[0.0]], [[1.0]], (), springs=(Spring((1.0,), stiffness=cubic, power=3.0),))


def sink(power: float, mu: float, sigma: float) -> ImpactSystem:
    """An oscillator with a sink on a spring w^power beside a linear one."""
    spring = Spring((1.0, -1.0), stiffness=1.0, power=power)
    stiffness = [[sigma, -sigma], [-sigma, 1.0 + sigma]]
    return ImpactSystem([[mu, 0.0], [0.0, 1.0]], np.zeros((2, 2)), stiffness, (), absorber=0, primary=1, springs=(spring,))


@pytest.mark.parametrize("cubic", [1.0, 100.0])
def test_the_duffing_oscillator_agrees_with_elliptic_functions(cubic):
    """Oracle: T/4 = K(m)/W with W^2 = 1 + a A^2, m = a A^2/(2 W^2), h = A^2/2 + a A^4/4, along the family to large energies."""
    problem = MultipointProblem(duffing(cubic), ("origin", "rest"), ())
    first = problem.solve(problem.pack([0.0, math.sqrt(2e-4)], None, [1.57]), energy=1e-4)
    branch = follow_family(problem, first.y, energy=(1e-4, 1e6))
    assert [end.text.split(": ")[1] for end in branch.ended] == ["lowest energy asked for", "highest energy asked for"]
    assert {event.type for event in branch.events} == {"EP"}
    h, alpha = branch.points["h"], branch.points["alpha"]
    square = 2.0 * h / (0.5 + np.sqrt(0.25 + cubic * h))
    frequency = np.sqrt(1.0 + cubic * square)
    exact = ellipk(cubic * square / (2.0 * frequency**2)) / frequency
    assert np.abs(alpha / exact - 1.0).max() < 1e-14
    assert branch.points["residual"].max() < 1e-14


@pytest.mark.parametrize("power", [2.5, 3.0, 7.0])
def test_a_spring_without_a_linear_part_has_a_family(power):
    """Oracle: T/4 = A/v B(1/q, 1/2)/q with q = p + 1, v^2 = 2 h, h = k A^q/q."""
    system = ImpactSystem([[1.0]], [[0.0]], [[0.0]], (), springs=(Spring((1.0,), stiffness=2.0, power=power),))
    orbit = orbit_at_mode("mode:1", system, (1e-4, 10.0))
    branch = follow_family(orbit.problem, orbit.solution.y, energy=(1e-4, 10.0))
    h, q = branch.points["h"], power + 1.0
    amplitude = (0.5 * q * h) ** (1.0 / q)
    assert h.min() < 1.1e-4 and h.max() > 9.0
    assert np.abs(branch.points["alpha"] / (amplitude / np.sqrt(2.0 * h) * beta(1.0 / q, 0.5) / q) - 1.0).max() < 1e-12


@pytest.mark.parametrize("lowest", [1e-12, 1e-2])
def test_the_family_around_both_wells(lowest):
    """Oracle: as for the Duffing oscillator, of x'' - x + x^3 = 0."""
    system = ImpactSystem([[1.0]], [[0.0]], [[-1.0]], (), springs=(Spring((1.0,), stiffness=1.0, power=3.0),))
    orbit = orbit_at_mode("mode:1", system, (lowest, 10.0))
    square = 1.0 + math.sqrt(1.0 + 4.0 * lowest)
    frequency = math.sqrt(square - 1.0)
    assert orbit.h == pytest.approx(lowest, rel=1e-9)
    assert orbit.alpha == pytest.approx(ellipkm1(1.0 - square / (2.0 * frequency**2)) / frequency, rel=1e-6 * orbit.alpha / frequency)


def test_a_spring_that_pushes_has_no_orbit():
    """Oracle: x'' = x^3 never comes to rest."""
    system = ImpactSystem([[1.0]], [[0.0]], [[0.0]], (), springs=(Spring((1.0,), stiffness=-1.0, power=3.0),))
    with pytest.raises(NameNotFound, match="^mode:1: no motion of h = 0.1 comes to rest .*; expected other energies$"):
        orbit_at_mode("mode:1", system, (0.1, 1.0))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_steps_begin_at_a_prediction_of_fourth_order(way):
    """Oracle: the next orbit of the family. The distance of the predicted curve from it is 16 times as small for half the step."""
    orbit = orbit_at_mode("mode:1", sink(7, 0.1, 0.1), (0.5, 1.0))
    family = Family(orbit.problem)
    first = family.begin(orbit.solution.y)

    def distance(ds: float) -> float:
        step = first
        for _ in range(3):
            before, step = step, family.step(step.y, step.tangent, way * ds)
        first_order, second, third = np.split(before.tangent, 3)

        def apart(s: float) -> np.ndarray:
            return before.y + s * (first_order + s / 2.0 * (second + s / 3.0 * third)) - step.y

        s = brentq(lambda s: apart(s)[0], 0.5 * way * ds, 2.0 * way * ds, xtol=1e-15)
        return float(np.abs(apart(s)).max())

    assert 12.0 < distance(0.08) / distance(0.04) < 20.0


def test_the_folds_of_the_cubic_sink_are_where_the_energy_turns():
    """Oracle: orbits at given quarter periods around each fold of S11-, whose energies have their extremum there."""
    branch = trace_named("S11-", sink(3, 0.05, 0.0), bounds={"energy": (1e-5, 30.0), "quarter_period": 4.0})
    folds = [event for event in branch.events if event.type == "SN"]
    assert len(folds) == 2 and len(branch.points["h"]) > 300
    problem = branch.problem
    for event in folds:
        y = branch.orbit(event.point).solution.y

        def slope(alpha: float, y=y) -> float:
            step = 1e-5
            return sum(sign * problem.solve(y, quarter_period=alpha + sign * step)["energy"] for sign in (1.0, -1.0))

        turning = brentq(slope, event.alpha * (1.0 - 1e-4), event.alpha * (1.0 + 1e-4), xtol=1e-13)
        assert abs(problem.solve(y, quarter_period=turning)["energy"] / event.h - 1.0) < 1e-9


def test_labels_without_impacts_count_half_waves():
    """Oracle: S13+ of smooth walls is the in-phase backbone, whose quarter period at low energy is pi/(2 w_1)."""
    system = sink(21, 0.1, 0.1)
    branch = trace_named("S13+@h=1.458,alpha=1.6757", system, bounds={"energy": (0.02, 3.0), "quarter_period": 2.0})
    i = int(np.argmin(branch.points["h"]))
    assert branch.points["label"][i] == "S11+" and "S13+" in branch.points["label"]
    assert abs(branch.points["alpha"][i] - 0.5 * math.pi / system.modes.frequencies[0]) < 1e-7
    with pytest.raises(NameNotFound, match="has impacts, and this system has no stops"):
        trace_named("S13O11+", system)


def test_stability_follows_from_a_perturbed_motion():
    """Oracle: the trace of the reduced map of the full period, by DOP853 over four quarters."""
    system = sink(3, 0.05, 0.0)
    branch = trace_named("S11-", system, bounds={"energy": (0.01, 1.0), "quarter_period": 2.0})
    orbit = branch.orbits_at(energy=0.05)[0]

    def right(_, y):
        w = y[0] - y[1]
        matrix = np.zeros((4, 4))
        matrix[0, 2] = matrix[1, 3] = 1.0
        matrix[2, :2], matrix[3, :2] = [-60.0 * w * w, 60.0 * w * w], [3.0 * w * w, -3.0 * w * w - 1.0]
        return np.concatenate([[y[2], y[3], -20.0 * w**3, w**3 - y[1]], (matrix @ y[4:].reshape(4, 4)).ravel()])

    start = np.concatenate([[0.0, 0.0], orbit.velocities, np.eye(4).ravel()])
    end = solve_ivp(right, (0.0, orbit.period), start, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    assert np.abs(end[:4] - start[:4]).max() < 1e-11
    assert abs(np.trace(end[4:].reshape(4, 4)) - 2.0 - orbit.tau) < 1e-9
    assert orbit.stable is True


@pytest.mark.parametrize("mode", [1, 2])
def test_each_linear_mode_begins_a_family(mode):
    """Oracle: the frequency of the mode at low energy; the symmetric mode of two equal oscillators moves as a Duffing oscillator."""
    springs = (Spring((1.0, 0.0), stiffness=1.0, power=3.0), Spring((0.0, 1.0), stiffness=1.0, power=3.0))
    stiffness = [[2.0, -1.0], [-1.0, 2.0]]
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), stiffness, (), springs=springs)
    orbit = orbit_at_mode(f"mode:{mode}", system, (1e-8, 10.0))
    assert abs(orbit.alpha - 0.5 * math.pi / system.modes.frequencies[mode - 1]) < 1e-6
    branch = follow_family(orbit.problem, orbit.solution.y, energy=(1e-8, 10.0))
    if mode == 1:
        h = 0.5 * branch.points["h"]  # of each
        square = 2.0 * h / (0.5 + np.sqrt(0.25 + h))
        frequency = np.sqrt(1.0 + square)
        assert np.abs(branch.points["alpha"] / (ellipk(square / (2.0 * frequency**2)) / frequency) - 1.0).max() < 1e-13
    with pytest.raises(NameNotFound, match="expected mode:1 or mode:2"):
        orbit_at_mode("mode:3", system)


def test_a_family_that_leaves_what_can_be_flown_is_followed_once(monkeypatch):
    """Oracle: the lower one of the two folds identifies the family, as with flights of any length. No other way leads beyond the limit of
    a flight, and the reason is named."""
    branch = trace_named("S11-", sink(5, 0.1, 0.02), bounds={"energy": (1.5e-3, 2e-3), "quarter_period": 4.0})
    expected = branch.full_family.marks
    runs, follow = [], full_family.follow_both_ways

    def counted(*arguments):
        runs.append(follow(*arguments))
        return runs[-1]

    limit_steps(monkeypatch, STEPS)
    monkeypatch.setattr(full_family, "follow_both_ways", counted)
    found = full_family.full_family(replace(branch, problem=MultipointProblem(branch.system, branch.ends, ())))
    assert found.ids == branch.full_family.ids and abs(found.marks[0].h / expected[0].h - 1.0) < 1e-12
    (run,) = runs
    assert sum(f"it takes more than {STEPS} Taylor steps" in end.text for end in run.ends) == 1
    assert found.h.max() < 0.04


@pytest.mark.parametrize(("scene", "mode", "low", "h"), [("duffing_pair", "mode:1", 0.1, 100.0), ("smooth_wall", "mode:2", 0.001, 1.0)])
def test_a_mode_at_high_energy_is_that_of_its_family(scene, mode, low, h):
    """Oracle: the family of the mode, followed up from an energy at which it is nearly linear."""
    system = load_scene(scene).system
    first = orbit_at_mode(mode, system, (low, h))
    assert first.alpha == pytest.approx(0.5 * math.pi / system.modes.frequencies[int(mode[-1]) - 1], rel=0.01)
    followed = follow_family(first.problem, first.solution.y, energy=(low, 2.0 * h), direction="up").orbits_at(energy=h)[0]
    assert orbit_at_mode(mode, system, (h, 2.0 * h)).alpha == pytest.approx(followed.alpha, rel=1e-10)


def test_an_id_does_not_depend_on_the_range_of_energies():
    """Oracle: one family has one id, also of a range below those of its end, and where it leaves them and returns."""
    system = load_scene("duffing_pair").system
    ids = set()
    for low, high in ((0.01, 1.0), (1e-6, 1e-4), (1e-4, 3e-3), (100.0, 1e4)):
        first = orbit_at_mode("mode:1", system, (low, high))
        ids.add(follow_family(first.problem, first.solution.y, energy=(low, high)).id)
    assert len(ids) == 1


@pytest.mark.parametrize("ends", [("rest", "rest"), ("origin", "origin")])
def test_orbits_between_rests_and_between_origins_have_a_verdict(ends):
    """Oracle: the trace of the multipliers by scipy's integrator, of a half period there and back. A force that is not odd, from rest to
    rest; one that is, through the origin twice."""
    odd = ends[0] == "origin"
    springs = (Spring((1.0, -1.0), stiffness=1.0, power=3.0),) if odd else (Spring((1.0, -1.0), polynomial=(0.7, 0.5, 0.9)),)
    stiffness = np.diag([1.0, 2.0] if odd else [1.0, 0.0])
    system = ImpactSystem(np.diag([1.0, 0.4]), np.zeros((2, 2)), stiffness, (), springs=springs)
    modes = system.modes
    problem = MultipointProblem(system, ends, ())
    start = np.zeros(4)
    start[2 if odd else 0] = 0.3
    half = math.pi / math.sqrt(modes.squares[0])
    first = problem.solve(problem.pack(start, None, [half]), energy=0.045 * (1.0 if odd else modes.squares[0]))
    branch = follow_family(problem, first.y, energy=(1e-3, 1.0))
    away = sorted(set(range(len(branch))) - {event.point for event in branch.events})
    stable, tau = branch.points["stable"], branch.points["tau"]
    assert len(away) > 30 and all(stable[i] == (abs(tau[i]) < 2.0) for i in away if abs(abs(tau[i]) - 2.0) > 1e-6)
    assert np.mean(stable[away] >= 0) > 0.9
    for i in away[:: len(away) // 4]:
        period = 4.0 * branch.points["alpha"][i]

        def rate(_, z):
            u, v = z[:2], z[2:4]
            w = u[0] - u[1]
            force, slope = (w**3, 3.0 * w * w) if odd else (0.7 * w + 0.5 * w * w + 0.9 * w**3, 0.7 + w + 2.7 * w * w)
            pull = np.array([1.0, -1.0])
            matrix = np.zeros((4, 4))
            matrix[:2, 2:] = np.eye(2)
            matrix[2:, :2] = -np.linalg.solve(system.mass, stiffness + slope * np.outer(pull, pull))
            acceleration = -np.linalg.solve(system.mass, stiffness @ u + force * pull)
            return np.concatenate([v, acceleration, (matrix @ z[4:].reshape(4, 4)).ravel()])

        state = np.concatenate([branch.points["start_u"][i], branch.points["start_v"][i]])
        flown = solve_ivp(rate, (0.0, period), np.concatenate([state, np.eye(4).ravel()]), method="DOP853", rtol=1e-12, atol=1e-13)
        trace = np.trace(flown.y[4:, -1].reshape(4, 4)) - 2.0
        assert abs(trace - tau[i]) < 1e-8 * (1.0 + abs(trace))
