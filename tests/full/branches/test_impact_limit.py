"""Long cases of tests/branches/test_impact_limit.py."""

from __future__ import annotations

import numpy as np
import pytest

import saltus
from branches.orbit import Orbit
from branches.released.impact_limit import NEAREST, ImpactLimit, impact_limits
from bvp.multipoint import MultipointProblem
from transitions.response.tracing import trace_in_parameter


def test_an_orbit_beyond_a_grazing_leads_to_one_with_more_impacts():
    """S13O00+ ends at a grazing at h = 14.55. Oracle: the event-driven simulation of a quarter of the period: three impacts,
    the last one at its end."""
    scene = saltus.load_scene("smooth_wall")
    problem = MultipointProblem(scene.system, ("origin", "rest"), ())
    start = problem.modes.from_state @ [0.0, 0.0, 9.68226072, 5.53402048]
    orbit = Orbit(problem, problem.solve(problem.pack(start, None, [1.6452684645]), energy=20.0))
    branch = trace_in_parameter(orbit, "1/n", (NEAREST, 0.1), keep="energy = 20", system=scene.parametric.in_reciprocal("n"))
    (limit,) = impact_limits(branch)
    assert isinstance(limit, ImpactLimit) and limit.orbit.label == "S13O22+"
    assert [contact.letter for contact in limit.contacts] == ["+", "-", "+"]
    motion = saltus.simulate(limit.orbit.system, [0.0, 0.0], limit.orbit.velocities, 1.001 * limit.orbit.alpha)
    times = motion.times[motion.contacts >= 0]
    assert len(times) == 3 and np.allclose(times, [impact.time for impact in limit.orbit.impacts][:3], rtol=0.0, atol=1e-11)
    assert times[-1] == pytest.approx(limit.orbit.alpha, abs=1e-11)
