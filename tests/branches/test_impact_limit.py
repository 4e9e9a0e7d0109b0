"""The impact as the limit of smooth families. Oracles: the closed form of orbits with one impact a half period, the order of convergence
of theory, equation (48), and impacting families that are found without smooth ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import saltus
from benchmarks import backbone
from branches.orbit import Orbit
from branches.released.impact_limit import NEAREST, ImpactLimit, impact_limit, impact_limits
from bvp.closures import EndsError
from bvp.multipoint import MultipointProblem
from bvp.stiff_springs import effective_clearance
from transitions.response.tracing import trace_in_parameter

MU = 0.1


@pytest.fixture(scope="module")
def toward_impacts():
    """The family of S13+ at the energy 5 from n = 10 to the limit."""
    scene = saltus.load_scene("smooth_wall")
    family = saltus.trace("S13+", scene=scene, energy=(1.0, 5.5))
    orbit = min(family.orbits_at(energy=5.0), key=lambda orbit: -orbit.alpha)
    return trace_in_parameter(orbit, "1/n", (NEAREST, 0.1), keep="energy = 5", system=scene.parametric.in_reciprocal("n"))


def scaled_quarter_period(system, n: float, h: float) -> float:
    """alpha_infinity(h/d^2), with d of the impact speed there, both from the closed form of one impact a half period."""

    def at(energy):
        alpha = brentq(lambda alpha: float(backbone.energy(system, alpha)) / energy - 1.0, 1.641, 1.70, xtol=1e-15)
        # The relative velocity at the impact, a quarter period after the origin.
        v = backbone.origin_velocity(system, alpha)
        w, shapes = backbone.modes_of(system)
        speed = float(np.array(system.stops[0].gap) @ (shapes @ (np.cos(w * alpha) * np.linalg.solve(shapes, v))))
        return alpha, speed

    d = 1.0
    for _ in range(60):
        alpha, speed = at(h / d**2)
        d = effective_clearance(2.0 * n + 1.0, 1.0, MU / (1.0 + MU), d * speed)
    return alpha


def test_quarter_periods_approach_those_at_the_effective_clearance(toward_impacts):
    """Oracle: the difference falls by four where n doubles, while the plain one falls by less than two: its order is log n/n."""
    system = saltus.vibro_impact_nes(mu=MU, sigma=0.1)
    branch = toward_impacts
    plain, scaled = [], []
    for n in (25.0, 50.0, 100.0, 200.0):
        i = int(np.argmin(np.abs(branch.parameter - 1.0 / n)))
        n = 1.0 / branch.parameter[i]
        alpha = branch.columns["alpha"][i]
        plain.append(n * (alpha - scaled_quarter_period(system, 1e9, 5.0)))
        scaled.append(n * n * (alpha - scaled_quarter_period(system, n, 5.0)))
    scaled = np.array(scaled)
    # The next order is a part of log n/n of this one.
    assert np.all(np.abs(scaled / scaled[-1] - 1.0) < 0.2) and abs(scaled[-1]) < 0.01
    assert np.all(np.diff(plain) > 0.0)


def test_the_limit_is_the_orbit_with_impacts(toward_impacts):
    """Oracle: the closed form of the orbit with one impact a half period."""
    (limit,) = impact_limits(toward_impacts)
    assert isinstance(limit, ImpactLimit)
    orbit = limit.orbit
    assert (orbit.label, orbit.ends, orbit.sequence) == ("S13O00+", ("origin", "stop+"), "")
    assert abs(orbit.h - 5.0) < 1e-12 and limit.clearance > 1.0 and len(limit.contacts) == 1
    # h depends on alpha with a large slope there, so the energy is compared.
    assert abs(float(backbone.energy(orbit.system, orbit.alpha)) / 5.0 - 1.0) < 1e-10
    assert abs(limit.smooth.alpha - limit.scaled.alpha) < 1e-6 < abs(limit.smooth.alpha - orbit.alpha)


def test_an_end_without_impacts_is_refused():
    """Oracle: the words. At the energy 1e-3 the sink stays far inside the walls."""
    scene = saltus.load_scene("smooth_wall")
    problem = MultipointProblem(scene.system, ("origin", "rest"), ())
    slow = problem.modes.frequencies[0]
    shape = problem.modes.shapes[:, 0]
    guess = problem.pack(problem.modes.from_state @ [0.0, 0.0, *(math.sqrt(2e-3) * shape)], None, [math.pi / 2.0 / slow])
    orbit = Orbit(problem, problem.solve(guess, energy=1e-3))
    with pytest.raises(EndsError, match="has no contact"):
        impact_limit(scene.parametric.in_reciprocal("n"), "1/n", orbit, {"mu": MU, "sigma": 0.1, "1/n": 0.1})
