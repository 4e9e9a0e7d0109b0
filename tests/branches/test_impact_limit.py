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
from branches.presentation import closed_presentation, starts_of, symmetries
from branches.released.impact_limit import NEAREST, ImpactLimit, impact_limit, impact_limits
from bvp.closures import EndsError
from bvp.multipoint import MultipointProblem
from bvp.parameters import ParametricSystem
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


@pytest.fixture(scope="module")
def closed_toward_impacts(toward_impacts):
    """The same orbits, closed on themselves."""
    orbit, parametric = toward_impacts.orbit(len(toward_impacts) - 1), toward_impacts.problem.parametric
    image = closed_presentation(orbit.cycle)
    problem = MultipointProblem(orbit.system, image.ends, image.sequence)
    closed = Orbit(problem, problem.solve(image.unknowns(problem), energy=5.0))
    return trace_in_parameter(closed, "1/n", (NEAREST, 0.1), keep="energy = 5", system=parametric.replaced({"1/n": 0.1}))


def scaled_orbit(system, n: float, h: float) -> tuple[float, float]:
    """d and alpha_infinity(h/d^2), with d of the impact speed there, both from the closed form of one impact a half period."""

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
    return d, alpha


@pytest.mark.parametrize("family", ["toward_impacts", "closed_toward_impacts"])
def test_quarter_periods_approach_those_at_the_effective_clearance(family, request):
    """Oracle: the difference falls by four where n doubles, while the plain one falls by less than two: its order is log n/n."""
    system = saltus.vibro_impact_nes(mu=MU, sigma=0.1)
    branch = request.getfixturevalue(family)
    plain, scaled = [], []
    for n in (25.0, 50.0, 100.0, 200.0):
        i = int(np.argmin(np.abs(branch.parameter - 1.0 / n)))
        n = 1.0 / branch.parameter[i]
        alpha = branch.columns["alpha"][i]
        plain.append(n * (alpha - scaled_orbit(system, 1e9, 5.0)[1]))
        scaled.append(n * n * (alpha - scaled_orbit(system, n, 5.0)[1]))
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


@pytest.mark.parametrize("pieces", [1, 3])
def test_a_closed_orbit_leads_to_a_closed_orbit_with_impacts(toward_impacts, pieces):
    """Oracle: the same orbit between an origin and an end at rest. It starts at each of its maxima, of which one is a contact."""
    (limit,) = impact_limits(toward_impacts)
    assert isinstance(limit, ImpactLimit)
    orbit, parametric = limit.smooth, toward_impacts.problem.parametric
    begun_at_contact = []
    for first in range(starts_of(orbit.cycle)):
        image = closed_presentation(orbit.cycle, 1, first)
        problem = MultipointProblem(orbit.system, image.ends, image.sequence, pieces)
        closed = Orbit(problem, problem.solve(image.unknowns(problem), energy=orbit.h))
        found = impact_limit(parametric, "1/n", closed, parametric.at({"1/n": NEAREST}))
        begun_at_contact.append(found.contacts[0].time == 0.0)
        assert found.orbit.ends == ("periodic", "periodic") and sorted(found.orbit.sequence) == ["+", "-"]
        for one, other in ((found.orbit, limit.orbit), (found.scaled, limit.scaled)):
            assert abs(one.alpha / other.alpha - 1.0) < 1e-12
        assert np.abs(found.orbit.multipliers - limit.orbit.multipliers).max() < 1e-10
        assert abs(found.clearance / limit.clearance - 1.0) < 1e-12
    assert sorted(begun_at_contact) == [False, False, True]


def test_an_orbit_without_a_reversal_leads_to_one_with_impacts():
    """Oracle: the event-driven simulation of a period of the orbit with impacts."""
    parametric = saltus.load_scene("smooth_wall").parametric
    problem = MultipointProblem(parametric.system(), ("periodic", "periodic"), ())
    start = problem.modes.from_state @ [1.561709, 1.08097562, -0.28861417, 0.00717081]
    orbit = Orbit(problem, problem.solve(problem.pack(start, None, [6.7487061046]), energy=0.6))
    branch = trace_in_parameter(orbit, "1/n", (NEAREST, 0.1), keep="energy = 0.6", system=parametric.in_reciprocal("n"), direction="down")
    (limit,) = impact_limits(branch)
    assert isinstance(limit, ImpactLimit) and len(limit.contacts) == 2
    found = limit.orbit
    assert not symmetries(found.cycle).reversals and not symmetries(found.cycle).half and abs(found.h - 0.6) < 1e-12
    (u,), (v,) = found.sample(np.zeros(1))
    motion = saltus.simulate(found.system, u, v, 1.001 * found.period)
    times = motion.times[motion.contacts >= 0]
    level = 1e-13 * np.abs(found.multipliers).max() * found.period
    assert np.allclose(times, [found.impacts[1].time, found.period], rtol=0.0, atol=100.0 * level)


@pytest.mark.parametrize("ends", [("stop-", "rest"), ("rest", "stop-"), ("periodic", "periodic")])
def test_impacts_that_are_there_before_stay(ends):
    """Oracle: the half period asin(1/A) + asin(d/A) of a linear oscillator of amplitude A between a stop at -d and one at 1, which is the
    limit of the spring w^(2 n + 1). The two impacts have different speeds, and the stop's distance is not in units of the clearance."""
    distance, amplitude, n = 0.5, 1.5, 200.0
    spring, stop = {"on": "u1", "stiffness": 1.0, "power": "2*n + 1"}, {"c": [1.0], "lower": -distance}
    system = {"mass": [[1.0]], "stiffness": [[1.0]], "springs": [spring], "stops": [stop]}
    parametric = ParametricSystem.from_description({"parameters": {"n": n}, "system": system}).in_reciprocal("n")
    problem = MultipointProblem(parametric.system(), ends, ("-",) if ends[0] == "periodic" else ())
    speed = math.sqrt(amplitude**2 - 1.0)
    turn, clearance = ((n + 1.0) * speed**2) ** (0.5 / (n + 1.0)), effective_clearance(2.0 * n + 1.0, 1.0, 1.0, speed)
    half, smooth = (math.asin(bound / amplitude) + math.asin(distance / amplitude) for bound in (1.0, clearance))
    start = [turn, 0.0] if ends[0] == "rest" else [-distance, math.sqrt(amplitude**2 - distance**2)]
    guess = problem.pack(problem.modes.from_state @ start, None, [smooth * problem.quarters / 2.0])
    orbit = Orbit(problem, problem.solve(guess, energy=0.5 * amplitude**2))
    limit = impact_limit(parametric, "1/n", orbit, parametric.at())
    assert [contact.letter for contact in limit.contacts] == ["b+"]
    assert abs(limit.orbit.period / (2.0 * half) - 1.0) < 1e-13
    assert len(limit.orbit.impacts) == 2 and limit.orbit.ends == tuple(end.replace("rest", "stopb+").replace("p-", "pa-") for end in ends)


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
