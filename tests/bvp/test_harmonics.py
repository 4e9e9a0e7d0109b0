"""Harmonic content of orbits. Oracles: the cosine series of elliptic functions by the nome, closed integrals of sines, the transfer
function of a linear system, sums of samples over the full period, and Parseval's equation."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from branches.orbit import Orbit
from bvp.harmonics import harmonics, sizes
from bvp.multipoint import MultipointProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.springs import Spring
from bvp.system import ImpactSystem, vibro_impact_nes
from tests.branches.forced_systems import oscillator, settled
from tests.bvp.orbits import collection
from transitions.response.measures import _OrbitMeasures, measures_along
from transitions.response.tracing import trace_response

EPS = np.finfo(float).eps
FREE = {
    "system": {"mass": [[1.0]], "stiffness": [[1.0]], "springs": [{"c": [1.0], "stiffness": "a", "power": 3}]},
    "parameters": {"a": 1.0},
}


@pytest.mark.parametrize("size", [0.1, 1.0, 30.0])
@pytest.mark.parametrize("ends", [("origin", "rest"), ("rest", "origin")])
def test_the_duffing_oscillator_has_the_series_of_cn(size, ends):
    """Oracle: x = A cn(W t | m), W^2 = 1 + A^2, m = A^2/(2 W^2), whose harmonic 2 k + 1 is A 2 pi/(K sqrt m) q^(k + 1/2)/(1 + q^(2 k + 1)).
    """
    rate = math.sqrt(1.0 + size**2)
    m = size**2 / (2.0 * rate**2)
    with mpmath.workdps(30):
        quarter, q = mpmath.ellipk(m), mpmath.qfrom(m=m)
        series = [2 * mpmath.pi / (quarter * mpmath.sqrt(m)) * q ** (k + 0.5) / (1 + q ** (2 * k + 1)) for k in range(6)]
        exact = np.zeros(12)
        exact[1::2] = [size * float(term) for term in series]
    system = ImpactSystem([[1.0]], [[0.0]], [[1.0]], (), springs=(Spring((1.0,), stiffness=1.0, power=3.0),))
    energy = 0.5 * size**2 + 0.25 * size**4
    start = [0.0, math.sqrt(2.0 * energy)] if ends[0] == "origin" else [size, 0.0]
    problem = MultipointProblem(system, ends, ())
    solved = problem.solve(problem.pack(start, None, [float(quarter) / rate]), energy=energy)
    assert np.abs(harmonics(problem, solved.y, 11)[:, 0] - exact).max() < 100.0 * EPS * size
    largest, squares = sizes(problem, solved.y)
    mean = size**2 * (float(mpmath.ellipe(m) / quarter) - 1.0 + m) / m  # of the square of cn
    assert abs(largest[0] - size) < 100.0 * EPS * size and abs(squares[0] ** 2 - mean) < 1e3 * EPS * mean / m


def test_a_released_orbit_has_the_harmonics_of_its_system():
    """Oracle: the problem of the system at these parameters."""
    problem = ReleasedProblem(ParametricSystem.from_description(FREE), ("origin", "rest"), (), ["a"], ["energy = 0.8"])
    y = problem.solve(problem.pack([[0.0, math.sqrt(1.6)]], [0.0], [1.0], [1.3])).y
    own, at = problem.orbit_problem(y)
    assert np.array_equal(harmonics(problem, y, 5), harmonics(own, at, 5))


def test_the_backbone_has_closed_integrals():
    """Oracle: each mode of the quarter to the stop is a sine, whose product with another sine has a closed integral."""
    problem = MultipointProblem(vibro_impact_nes(), ("origin", "stop+"), ())
    y = problem.solve(problem.pack([0.0, 0.0, 0.9, 0.6], [], [1.7]), quarter_period=1.7).y
    modes, quarter = problem.modes, problem.quarter_period(y)
    sines = problem.start(y)[2:] / modes.frequencies
    exact = np.zeros((8, 2))
    for k in range(1, 8, 2):
        a, b = modes.frequencies, 0.5 * math.pi * k / quarter
        integral = np.sin((a - b) * quarter) / (2.0 * (a - b)) - np.sin((a + b) * quarter) / (2.0 * (a + b))
        exact[k] = np.abs(modes.shapes @ (sines * integral)) * 2.0 / quarter
    assert np.abs(harmonics(problem, y, 7) - exact).max() < 100.0 * EPS * np.abs(exact).max()


def by_samples(orbit: Orbit, highest: int) -> np.ndarray:
    """The amplitudes by Gauss's rule over the full period, from impact to impact."""
    ends = np.unique([0.0, *(impact.time for impact in orbit.impacts), orbit.period])
    nodes, weights = np.polynomial.legendre.leggauss(60)
    times = np.concatenate([a + (b - a) * 0.5 * (1.0 + nodes) for a, b in zip(ends[:-1], ends[1:], strict=True)])
    parts = np.concatenate([0.5 * (b - a) * weights for a, b in zip(ends[:-1], ends[1:], strict=True)]) / orbit.period
    turned = np.exp(-2j * math.pi * np.outer(np.arange(highest + 1), times) / orbit.period)
    sums = turned @ (parts[:, None] * orbit.sample(times)[0])
    found = 2.0 * np.abs(sums)
    found[0] = sums[0].real
    return found


def test_impacting_orbits_agree_with_sums_over_the_period():
    """Oracle: samples over the full period without its symmetries, between all kinds of ends."""
    found = {one.problem.ends: Orbit(one.problem, one.solution) for one in collection()}
    assert {ends[0] for ends in found} == {"origin", "rest", "stop+"} and len(found) >= 5
    for orbit in found.values():
        exact = by_samples(orbit, 25)
        assert np.abs(exact).max() > 0.1
        assert np.abs(harmonics(orbit.problem, orbit.solution.y, 25) - exact).max() < 100.0 * EPS
        # Beside a turn the samples fall short by the curvature times the square of their distance.
        sampled = np.abs(orbit.sample(np.linspace(0.0, orbit.period, 20001))[0]).max(axis=0)
        largest = sizes(orbit.problem, orbit.solution.y)[0]
        assert np.all(largest > sampled - 100.0 * EPS) and np.all(largest < sampled * (1.0 + 1e-3))


@pytest.mark.parametrize("power", [3.0, 7.0, 3.5])
def test_smooth_orbits_fulfil_parseval(power):
    """Oracle: the mean square of samples is a_0^2 + sum a_k^2/2, which converges as the orbit is smooth; a real power ends it slowly."""
    springs = (Spring((1.0, -1.0), stiffness=1.0, power=power),)
    stiffness = [[0.1, -0.1], [-0.1, 1.1]]
    system = ImpactSystem([[0.1, 0.0], [0.0, 1.0]], np.zeros((2, 2)), stiffness, (), absorber=0, primary=1, springs=springs)
    problem = MultipointProblem(system, ("origin", "rest"), ())
    first = problem.modes.shapes[:, 0] * math.sqrt(0.2) * 0.5
    solved = problem.solve(problem.pack([0.0, 0.0, *first], None, [0.5 * math.pi / problem.modes.frequencies[0]]), energy=0.02)
    orbit = Orbit(problem, solved)
    amplitudes = harmonics(problem, solved.y, 31)
    u, _ = orbit.sample(np.arange(256) * orbit.period / 256.0)
    spectrum = np.abs(np.fft.rfft(u, axis=0))[:32] / 128.0
    assert np.abs(amplitudes[1:] - spectrum[1:]).max() < 1e-13
    assert np.abs(0.5 * np.sum(amplitudes**2, axis=0) - np.mean(u**2, axis=0)).max() < 1e-14


@pytest.mark.parametrize("c", [0.1, 1e4, 1e8])
def test_a_linear_response_has_the_harmonics_of_its_load(c):
    """Oracle: the transfer function at each harmonic of the load, and the static displacement."""
    system = {"mass": [[1.0]], "damping": [[c]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": 50.0}]}
    loads = [{"load": [1.0], "amplitude": a, "harmonic": k} for k, a in ((1, "F"), (3, 0.5))]
    parametric = ParametricSystem.from_description({"parameters": {"F": 0.3, "w": 0.4}, "system": system, "forces": loads})
    (branch,) = trace_response(parametric, "w", (0.3, 0.5), values={"w": 0.4}, start="rest")
    y, w = branch.unknowns[branch.start], branch.parameter[branch.start]
    exact = np.zeros(6)
    for k, amplitude in ((1, 0.3), (3, 0.5)):
        exact[k] = amplitude / abs(1.0 - (k * w) ** 2 + 1j * c * k * w)
    assert np.abs(harmonics(branch.problem, y, 5)[:, 0] - exact).max() < 1e-14 * (1.0 + c) * min(1.0, exact.max())


def test_responses_fulfil_parseval():
    """Oracle: the root mean square of the measures, which are integrals of other kernels. The series of a motion with a kink in its
    velocity falls with the square of k, and what is left out of Parseval's sum with its cube."""
    problem, y = settled(oscillator(s=-0.2), ["s"], start=(np.array([-0.66]), np.zeros(1)))
    found = harmonics(problem, y, 400)[:, 0]
    measured = float(_OrbitMeasures(problem)(y, problem.period(y))[1][0] ** 2)
    assert abs(found[0] ** 2 + 0.5 * np.sum(found[1:] ** 2) - measured) < 1e-7 * measured


def test_smooth_responses_fulfil_parseval():
    """Oracle: the root mean square of the measures; the series converges faster than any power."""
    duffing = {
        "parameters": {"F": 0.3, "w": 1.2},
        "system": {"mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]], "springs": [{"c": [1.0], "stiffness": 1.0, "power": 3}]},
        "forces": [{"load": [1.0], "amplitude": "F", "harmonic": 1}],
    }
    (branch,) = trace_response(ParametricSystem.from_description(duffing), "w", (1.7, 2.1), values={"w": 2.0}, start="rest")
    squares = measures_along(branch).rms[:, 0] ** 2
    for i in range(0, len(branch), 10):
        found = harmonics(branch.problem, branch.unknowns[i], 25)[:, 0]
        assert np.all(found[::2] == 0.0)
        assert abs(0.5 * np.sum(found**2) - squares[i]) < 1e-14
