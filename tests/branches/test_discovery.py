"""Orbits found at an energy: each is one, is primitive, and none that is known is missed.

Oracles: the closed form of both backbones; a second scan in plain numpy (tests/bvp/orbits.py); a scan of other density; dense samples.
"""

import numpy as np
import pytest

import saltus
from benchmarks import backbone
from branches.naming.labels import parse
from branches.orbit import Orbit
from branches.search.discovery import cover_of, judged
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.branches.scans import sampled
from tests.bvp import orbits as by_numpy
from tests.bvp.orbits import backbone_segment

SYSTEM = vibro_impact_nes()


@pytest.mark.parametrize("energy", [0.3, 3.0, 12.0])
def test_the_backbones_are_found(energy):
    """Oracle: closed form: every alpha with G > 0 and no passage of a wall at that energy."""
    found = {round(orbit.alpha, 9) for orbit in sampled(SYSTEM, "stop", 2.0, energy, 1000, [0])}
    assert found == {round(alpha, 9) for alpha in backbone.orbits_at(SYSTEM, energy, 2.0)} and found


def same(orbit, other):
    return (
        orbit.problem.ends == other.problem.ends
        and orbit.problem.sequence == other.problem.sequence
        and np.allclose(orbit.solution.y, other.solution.y, rtol=1e-7, atol=1e-9)
    )


@pytest.mark.parametrize(("kind", "energy"), [("stop", 1.0), ("rest", 3.0), ("origin", 0.3)])
def test_each_orbit_is_one(kind, energy):
    """Oracle: the energy asked for, residual, dense samples inside the walls, the label's own parse, no repetition in a turn."""
    found = sampled(SYSTEM, kind, 6.0, energy, 1500, range(5))
    assert found
    for orbit in found:
        assert abs(orbit.h / energy - 1.0) < 1e-13 and orbit.solution["residual"] < 1e-12
        whole = Orbit(orbit.problem, orbit.solution)
        u, _ = whole.sample(np.linspace(0.0, whole.period, 4001))
        assert np.max(np.abs(u[:, 0] - u[:, 1])) < 1.0 + 1e-12 and whole.impacts
        assert parse(str(orbit.label)) == orbit.label
        assert cover_of(orbit.problem, orbit.solution) == 1


def test_a_finer_scan_finds_nothing_less():
    """Oracle: a scan of four times the density."""
    coarse = sampled(SYSTEM, "stop", 4.0, 0.6, 500, [0, 1])
    fine = sampled(SYSTEM, "stop", 4.0, 0.6, 2000, [0, 1])
    assert coarse and all(any(same(orbit, other) for other in fine) for orbit in coarse)


def test_what_numpy_finds_is_found():
    """Oracle: the scan of tests/bvp/orbits.py, which shares nothing with this one; orbits without turns."""
    mine = {}
    missing = []
    for other in by_numpy.scan(SYSTEM, "origin", 0.5, angles=110, impacts=2):
        if cover_of(other.problem, other.solution) > 1:
            continue
        kind = other.problem.ends[1].rstrip("+-")
        inner = len(other.problem.sequence)
        key = kind, inner
        if key not in mine:
            mine[key] = sampled(SYSTEM, kind, 16.0, 0.5, 3000, [inner])
        alphas = [orbit.alpha for orbit in mine[key]]
        if not any(abs(alpha / other.solution["quarter_period"] - 1.0) < 1e-8 for alpha in alphas):
            missing.append(other.name)
    assert not missing and mine


def test_several_turns_are_counted():
    """Oracle: the backbone's half period unfolded 1, 2, 3 times."""
    for impacts in (2, 4, 6):
        problem, y = backbone_segment(SYSTEM, 1.7, impacts)
        assert cover_of(problem, problem.solve(y)) == impacts  # a quarter problem solves half a turn of it
        assert judged(problem, problem.solve(y)) == "covers"


def test_orbits_without_impacts_are_none():
    """Oracle: below every grazing energy there are linear modes alone."""
    for kind in ("rest", "origin"):
        assert sampled(SYSTEM, kind, 6.0, 0.04, 200, [0]) == []
    modes = SYSTEM.modes
    problem = MultipointProblem(SYSTEM, ("origin", "rest"), ())
    start = np.array([0.0, 0.0, 0.2, 0.0])
    guess = problem.pack(start, np.zeros((0, 4)), [0.5 * np.pi / modes.frequencies[0]])
    assert judged(problem, problem.solve(guess)) == "without_impacts"


def test_the_free_impact_damper():
    """Oracle: closed form at sigma = 0: the NES flies freely, G = b^2 alpha + tan(alpha)."""
    system = saltus.vibro_impact_nes(0.1, 0.0)
    found = sampled(system, "stop", 6.0, 0.5, 1000, [0])
    assert found
    for orbit in found:
        g = 10.0 * orbit.alpha + np.tan(orbit.alpha)
        assert abs((10.0 + 1.0 / np.cos(orbit.alpha) ** 2) / (2.0 * g * g) - 0.5) < 1e-11


def test_systems_that_cannot_be_scanned():
    """Oracle: the messages."""
    stops = (Stop((1.0, 0.0), -1, 1), Stop((0.0, 1.0), -1, 1))
    two = ImpactSystem([[1.0, 0], [0, 1.0]], [[0.0] * 2] * 2, [[2.0, -1], [-1, 2]], stops)
    with pytest.raises(ValueError, match="one stop; this one has 2"):
        sampled(two, "stop", 5.0, 1.0, 10, [0])
