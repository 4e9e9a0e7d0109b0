"""scipy's solve_bvp as a peer: its orbits against the closed form and the multipoint problem, its derivatives against differences."""

import numpy as np
import pytest

from benchmarks import backbone
from benchmarks.peers.collocation import CollocationError, _Segments, solve_collocation
from bvp.multipoint import MultipointProblem
from bvp.system import vibro_impact_nes
from tests.bvp.orbits import backbone_segment, collection

NEAR = 4.9065 * 0.9999


def u8353():
    """U8353- at the published alpha = 4.9065: problem and exact unknowns."""
    system = vibro_impact_nes()
    problem = MultipointProblem(system, ("origin", "origin"), tuple("+-+-+-+-"))
    start = system.modes.from_state @ [0.0, 0.0, 0.059436725, -1.972621447]
    times = (0.54734943, 0.89065889, 0.95702120, 1.12608516, 0.86660931, 1.06450745, 1.23252467, 0.88055437, 2.24768973)
    return problem, problem.solve(problem.pack(start, None, np.array(times)), quarter_period=4.9065).y


def test_the_backbone_at_a_quarter_period_and_at_an_energy():
    """Oracle: closed form of S13O00+; a method of fourth order, so that a hundredth of the tolerance takes nearly as much off the error."""
    system = vibro_impact_nes()
    problem, _ = backbone_segment(system, 1.7)
    guess = backbone_segment(system, 1.72)[1]
    exact = backbone_segment(system, 1.7)[1]
    h = backbone.energy(system, 1.7)
    for wanted in ({"quarter_period": 1.7}, {"energy": h}):
        errors = []
        for tolerance in (1e-4, 1e-6, 1e-8):
            orbit = solve_collocation(problem, guess, tolerance=tolerance, **wanted)
            assert orbit.residual <= tolerance == orbit.tolerance
            errors.append(float(np.max(np.abs(orbit.unknowns - exact))))
            assert errors[-1] < tolerance
            assert abs(orbit.energy / h - 1.0) < tolerance and abs(orbit.quarter_period / 1.7 - 1.0) < tolerance
        assert errors[1] < 0.05 * errors[0] and errors[2] < 0.05 * errors[1]


def test_eight_inner_impacts():
    """Oracle: the multipoint problem at the same quarter period: the published h = 1.9458 of U8353-; from an orbit nearby on its mesh."""
    problem, exact = u8353()
    near = problem.solve(exact, quarter_period=NEAR).y
    orbit = solve_collocation(problem, near, quarter_period=4.9065)
    assert abs(orbit.energy - 1.9458) < 6e-6
    assert np.max(np.abs(orbit.unknowns - exact)) < 1e-5
    again = solve_collocation(problem, exact, quarter_period=NEAR, near=orbit)
    assert np.max(np.abs(again.unknowns - near)) < 1e-5
    assert len(again.mesh) <= 1.5 * len(orbit.mesh)


def test_all_ends():
    """Oracle: the multipoint problem at the same energy, for each pair of ends that the collection has."""
    seen = set()
    for found in collection():
        problem = found.problem
        kinds = tuple(end.rstrip("+-") for end in problem.ends)
        if kinds in seen or problem.inner > 3 or abs(found.solution["trace"]) > 100.0:
            continue
        seen.add(kinds)
        y = found.solution.y
        orbit = solve_collocation(problem, y * (1.0 + 1e-4), energy=found.energy, tolerance=1e-8)
        assert np.max(np.abs(orbit.unknowns - y)) < 1e-7 * np.max(np.abs(y)), found.name
    assert len(seen) >= 4


@pytest.mark.parametrize("wanted", [{"energy": 1.9, "quarter_period": None}, {"energy": None, "quarter_period": 4.9}])
def test_derivatives(wanted):
    """Oracle: central differences of the right-hand side and of the boundary conditions, at random places."""
    problem, _ = u8353()
    segments = _Segments(problem, **wanted)
    rng = np.random.default_rng(5)
    n, times = segments.width, rng.uniform(0.5, 2.0, segments.flights)
    y, first, last = rng.normal(size=(n, 3)), rng.normal(size=n), rng.normal(size=n)
    assert len(segments.conditions(first, last, times)) == n + segments.flights
    step = 1e-5

    def differences(function, values):
        out = []
        for j in range(len(values)):
            moved = step * np.eye(len(values))[j].reshape(-1, *[1] * (values.ndim - 1))
            out.append((function(values + moved) - function(values - moved)) / (2.0 * step))
        return np.stack(out, axis=1)

    by_state, by_time = segments.motion_derivatives(np.zeros(3), y, times)
    assert np.allclose(by_state, differences(lambda values: segments.motion(np.zeros(3), values, times), y), atol=1e-8)
    assert np.allclose(by_time, differences(lambda values: segments.motion(np.zeros(3), y, values), times), atol=1e-8)
    at = (first, last, times)
    for i, matrix in enumerate(segments.condition_derivatives(*at)):
        changed = differences(lambda values, i=i: segments.conditions(*at[:i], values, *at[i + 1 :]), at[i])
        assert np.allclose(matrix, changed, atol=1e-8)


def test_the_exact_orbit_satisfies_the_conditions():
    """Oracle: the multipoint problem's own nodes and ends of flights."""
    problem, y = u8353()
    segments = _Segments(problem, problem.energy(y), None)
    first = np.concatenate([problem.start(y), *problem.nodes(y)])
    assert np.max(np.abs(segments.conditions(first, problem.end_states(y).ravel(), problem.flight_times(y)))) < 1e-12


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"energy": 1.0}, "received both"),
        ({"quarter_period": None}, "received none"),
        ({"tolerance": 0.0}, "received 0"),
        ({"problem": MultipointProblem(vibro_impact_nes(), ("periodic", "periodic"), ("+", "-"))}, "received a closed one"),
    ],
)
def test_what_it_cannot_do_is_refused(change, words):
    """Oracle: the message names what was received."""
    problem, y = backbone_segment(vibro_impact_nes(), 1.7)
    given = {"problem": problem, "quarter_period": 1.7} | change
    with pytest.raises(ValueError, match=words):
        solve_collocation(given.pop("problem"), y, **given)


def test_a_tolerance_that_is_not_reached_is_reported():
    """Oracle: more nodes than are allowed; an energy below that of any impact, sigma/2."""
    problem, y = backbone_segment(vibro_impact_nes(), 1.7)
    with pytest.raises(CollocationError, match=r"tolerance 1.0e-09: The maximum number of mesh nodes is exceeded. \(\d+ nodes\)"):
        solve_collocation(problem, y, quarter_period=1.7, tolerance=1e-9, most_nodes=50)
    with pytest.raises(CollocationError, match="solve_bvp"):
        solve_collocation(problem, y, energy=0.04, most_nodes=500)
