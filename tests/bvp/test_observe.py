"""What is seen along the flights of an orbit. Oracle: the states at its impacts, by hand in physical coordinates."""

import numpy as np

from bvp.kernels.multipoint import REST, STOP
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
            speeds[node] = modes.contacts.side[contact] * float(gap @ (modes.to_state[n:] @ state))
        slowest = min(speeds.values())
        assert slowest > 0.0 and abs(orbit.solution["speed"] - slowest) <= 1e-12 * max(speeds.values())
        # The last impact of a segment from stop to stop can be as slow as the first.
        assert abs(speeds[int(orbit.solution["speed_node"])] - slowest) <= 1e-12 * slowest
        begun += problem.kinds[0] == STOP
    assert begun > 10


def test_rest_ends_are_turning_points():
    """Where the gap coordinate is nearest to a stop at an end at rest, that end, its instant and that side are named."""
    named = 0
    for orbit in collection():
        problem, solution = orbit.problem, orbit.solution
        times = problem.flight_times(solution.y)
        gap = np.array(problem.system.stops[0].gap) @ problem.modes.to_state[: problem.half]
        places = [(problem.start(solution.y), 0, 0.0)] if problem.kinds[0] == REST else []
        places += [(solution.ends[-1], problem.inner, times[-1])] if problem.kinds[1] == REST else []
        for state, flight, time in places:
            w = float(gap @ state)
            assert solution["clearance"] <= 1.0 - abs(w) + 1e-13
            if abs(solution["clearance"] - (1.0 - abs(w))) < 1e-13 and len(places) == 1:
                named += 1
                where = [solution[name] for name in ("clearance_side", "clearance_flight", "clearance_time")]
                assert where == [np.sign(w), flight, time]
    assert named > 2
