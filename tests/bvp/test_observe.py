"""What is seen along the flights of an orbit. Oracle: the states at its impacts, by hand in physical coordinates."""

import numpy as np

from bvp.kernels.segment import STOP
from tests.bvp.orbits import collection


def test_slowest_impact_also_of_orbits_that_start_at_one():
    """Each impact comes in with the speed of its gap coordinate towards the stop; the one at the start went out with it."""
    begun = 0
    for orbit in collection():
        problem, y = orbit.problem, orbit.solution.y
        modes, n = problem.modes, problem.half
        speeds = {}
        for node, state in enumerate(problem.end_states(y)[: problem.inner + (problem.kinds[1] == STOP)]):
            speeds[node] = (problem.contacts[node], state)
        if problem.kinds[0] == STOP:
            speeds[problem.inner + 1] = (problem.contacts[problem.inner + 1], -problem.start(y))
        for node, (contact, state) in speeds.items():
            gap = np.array(problem.system.stops[modes.contact_stop[contact]].gap)
            speeds[node] = modes.contact_side[contact] * float(gap @ (modes.to_state[n:] @ state))
        slowest = min(speeds.values())
        assert slowest > 0.0 and abs(orbit.solution["speed"] - slowest) <= 1e-12 * max(speeds.values())
        # The last impact of a segment from stop to stop can be as slow as the first.
        assert abs(speeds[int(orbit.solution["speed_node"])] - slowest) <= 1e-12 * slowest
        begun += problem.kinds[0] == STOP
    assert begun > 10
