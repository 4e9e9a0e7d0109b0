"""What is seen along the flights of an orbit. Oracle: the states at its impacts, by hand in physical coordinates."""

import math

import numpy as np
import pytest

from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from tests.bvp.orbits import collection


def test_slowest_impact_also_of_orbits_that_start_at_one():
    """Each impact comes in with the speed of its gap coordinate towards the stop; the one at the start went out with it."""
    begun = 0
    for orbit in collection():
        problem, y = orbit.problem, orbit.solution.y
        modes, n = problem.modes, problem.half
        speeds = {}
        for node, state in enumerate(problem.end_states(y)[: problem.inner + (problem.ends[1].startswith("stop"))]):
            speeds[node] = (problem.contacts[node], state)
        if problem.ends[0].startswith("stop"):
            speeds[problem.inner + 1] = (problem.contacts[problem.inner + 1], -problem.start(y))
        for node, (contact, state) in speeds.items():
            gap = np.array(problem.system.stops[modes.contact_stop[contact]].gap)
            speeds[node] = modes.contacts.side[contact] * float(gap @ (modes.to_state[n:] @ state))
        slowest = min(speeds.values())
        assert slowest > 0.0 and abs(orbit.solution["speed"] - slowest) <= 1e-12 * max(speeds.values())
        # The last impact of a segment from stop to stop can be as slow as the first.
        assert abs(speeds[int(orbit.solution["speed_node"])] - slowest) <= 1e-12 * slowest
        begun += problem.ends[0].startswith("stop")
    assert begun > 10


def test_rest_ends_are_turning_points():
    """Where the gap coordinate is nearest to a stop at an end at rest, that end, its instant and that side are named."""
    named = 0
    for orbit in collection():
        problem, solution = orbit.problem, orbit.solution
        times = problem.flight_times(solution.y)
        gap = np.array(problem.system.stops[0].gap) @ problem.modes.to_state[: problem.half]
        places = [(problem.start(solution.y), 0, 0.0)] if problem.ends[0] == "rest" else []
        places += [(solution.ends[-1], problem.inner, times[-1])] if problem.ends[1] == "rest" else []
        for state, flight, time in places:
            w = float(gap @ state)
            assert solution["clearance"] <= 1.0 - abs(w) + 1e-13
            if abs(solution["clearance"] - (1.0 - abs(w))) < 1e-13 and len(places) == 1:
                side, at, seconds = [solution[name] for name in ("clearance_side", "clearance_flight", "clearance_time")]
                if (at, seconds) == (flight, time):
                    named += 1
                    assert side == np.sign(w)
                else:
                    # As near as the end, and before it.
                    (u,), _ = orbit.sample([times[: int(at)].sum() + seconds])
                    assert (at, seconds) < (flight, time)
                    assert abs(1.0 - side * (np.array(problem.system.stops[0].gap) @ u) - solution["clearance"]) < 1e-13
    assert named > 2


def test_of_equal_distances_the_earliest_counts():
    """Oracle: x = cos(w t)/(1 - w^2) of two masses, and half of it of the third: both turn at the same instants, on either side as near to
    their stops. The earliest of these instants counts, and the first of the stops; rounding would decide otherwise."""
    for w in np.linspace(1.3, 2.7, 15).tolist():
        stops = [{"c": row, "lower": -2.0, "upper": 2.0} for row in np.eye(3)[[2, 0, 1]].tolist()]
        system = {"mass": np.eye(3).tolist(), "damping": np.zeros((3, 3)).tolist(), "stiffness": np.eye(3).tolist(), "stops": stops}
        load = {"load": [1.0, 1.0, 0.5], "amplitude": 1.0, "harmonic": 1}
        parametric = ParametricSystem.from_description({"parameters": {"w": w}, "system": system, "forces": [load]})
        problem = ForcedProblem(parametric, (), ["w"])
        for phase in (0.0, 0.2, 0.5):
            size = 1.0 / (1.0 - w * w)
            shape = size * np.array([1.0, 1.0, 0.5])
            start = np.concatenate([shape * np.cos(2.0 * np.pi * phase), -w * shape * np.sin(2.0 * np.pi * phase)])
            y = problem.pack([start], [phase], [w])
            solution = problem.solve(y)
            w = problem.parameters(solution.y)["w"]
            size, period, begin = 1.0 / (1.0 - w * w), 2.0 * np.pi / w, float(problem.nodes(solution.y)[0, 6])
            turn = np.ceil(2.0 * begin - 1e-9) / 2.0
            assert solution["clearance"] == pytest.approx(2.0 - abs(size), abs=1e-13)
            assert (solution["clearance_flight"], solution["clearance_stop"]) == (0, 1)
            assert solution["clearance_side"] == np.sign(size * np.cos(2.0 * np.pi * turn))
            assert abs(math.remainder(solution["clearance_time"] - (turn - begin) * period, period)) < 1e-7
