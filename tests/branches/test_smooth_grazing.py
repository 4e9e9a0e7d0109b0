"""Impacting families between flights with smooth forces: where they meet the smooth ones, closed orbits, and families between origins."""

import numpy as np
import pytest

from branches.catalogue.members import distances_from_orbit
from branches.grazing.following import neighbours
from branches.naming.families import trace_named
from branches.presentation import embed
from branches.switching import emanating_families
from branches.tracing import follow_family
from bvp.closures import cycle_of
from bvp.multipliers import floquet_multipliers
from bvp.multipoint import MultipointProblem, NotConverged
from bvp.springs import Spring
from bvp.system import ImpactSystem, Stop
from saltus.scene import load_scene
from tests.branches.test_smooth_agreement import second
from tests.branches.test_smooth_events import require_events

BOUNDS = {"energy": (0.015, 2.0), "quarter_period": 4.0}


@pytest.fixture(scope="module")
def smooth():
    """The family of the cubic spring that the linear mode at zero energy frequency 1 has, up to its first touch of the stops."""
    system = load_scene("cubic_and_stops").system
    problem = MultipointProblem(system, ("origin", "rest"), ())
    mode = int(np.argmax(system.modes.frequencies))
    start = np.zeros(4)
    start[2 + mode] = np.sqrt(2.0 * 0.03)
    return follow_family(problem, problem.solve(problem.pack(start, None, [0.5 * np.pi]), energy=0.03).y, **BOUNDS)


@pytest.fixture(scope="module")
def impacting(smooth):
    """The family behind that touch."""
    met = [item for item in neighbours(smooth, next(event for event in smooth.events if event.type == "GR")) if item.beside is not None]
    assert [item.kind for item in met] == ["fold"]
    return follow_family(met[0].beside.problem, met[0].beside.y, **BOUNDS)


def test_a_smooth_family_and_an_impacting_one_meet_at_a_touch(smooth, impacting):
    there, back = (next(event for event in branch.events if event.type == "GR") for branch in (smooth, impacting))
    assert impacting.label == "S11O00-" and impacting.ends == ("origin", "stop-")
    assert abs(there.h - back.h) < 1e-11 * there.h
    assert abs(there.alpha - back.alpha) < 1e-11 * there.alpha
    met = [item for item in neighbours(impacting, back) if item.beside is not None]
    assert [(item.kind, item.ends, item.sequence) for item in met] == [("fold", ("origin", "rest"), "")]


def test_a_second_integrator_agrees_on_orbits_with_impacts(impacting):
    """Oracle: DOP853 at 1e-13 up to the impact, where Newton's method solves its equations: the gap is closed, the impulse turns all
    momentum, the energy is given. The trace is that of the product of flights and of saltation matrices."""
    other, mass, gap = second(impacting.system), np.array(impacting.system.mass), np.array([1.0, -1.0])
    reflection = np.eye(4)
    reflection[2:, 2:] -= 2.0 * np.outer(np.linalg.solve(mass, gap), gap) / (gap @ np.linalg.solve(mass, gap))
    for energy in (0.15, 0.2, 0.6, 1.0, 1.9):
        orbit = impacting.orbit_at(energy=energy)
        velocities, time = np.array(orbit.velocities), orbit.alpha
        for _ in range(3):
            end, columns = other.flown(np.append([0.0, 0.0], velocities), time)
            rows = np.zeros((3, 4))
            rows[0, :2], rows[1, 2:] = gap, mass.sum(axis=0)
            jacobian = np.column_stack([rows @ columns[:, 2:], rows @ other.rate(end)])
            jacobian[2, :2] = mass @ velocities
            residual = [gap @ end[:2] + 1.0, mass.sum(axis=0) @ end[2:], 0.5 * velocities @ mass @ velocities - energy]
            change = np.linalg.solve(jacobian, residual)
            velocities, time = velocities - change[:2], time - float(change[2])
        assert abs(time / orbit.alpha - 1.0) < 1e-12 and np.abs(velocities / orbit.velocities - 1.0).max() < 1e-11
        first = other.flown(np.append([0.0, 0.0], velocities), time)
        before, after = first[0], reflection @ first[0]
        row = np.append(gap, [0.0, 0.0])
        late = other.rate(after) - reflection @ other.rate(before)
        saltation = reflection + np.outer(late, row) / (row @ other.rate(before))
        middle, last = other.flown(after, 2.0 * time), other.flown(-after, time)  # the other impact mirrors this one
        whole = last[1] @ saltation @ middle[1] @ saltation @ first[1]
        assert abs((np.trace(whole) - 2.0) / orbit.tau - 1.0) < 1e-9


@pytest.mark.parametrize(("name", "types"), [("smooth", ("SN", "PD", "RT", "GR")), ("impacting", ("SN", "PD", "RT", "GR"))])
def test_events_on_both_sides_of_a_touch_agree_with_many_digits(request, name, types):
    """Oracle: see `require_events`; at a touch the gap vanishes at rest, or the speed at the stop."""
    require_events(request.getfixturevalue(name), types, 1)


def test_an_orbit_closed_on_itself_has_the_multipliers_of_its_quarter(impacting):
    for energy in (0.2, 1.0, 1.9):
        orbit = impacting.orbit_at(energy=energy)
        closed = embed(impacting.problem, orbit.solution.y, 1)
        problem = MultipointProblem(impacting.system, closed.ends, closed.sequence)
        solution = problem.solve(closed.unknowns(problem), energy=energy)
        assert abs(solution["quarter_period"] - orbit.solution["quarter_period"]) < 1e-12 * orbit.solution["quarter_period"]
        assert abs(solution["trace"] - orbit.solution["trace"]) < 1e-9 * max(1.0, abs(orbit.solution["trace"]))
        found = floquet_multipliers(cycle_of(problem, solution.y))
        assert found.reliable
        assert abs(found.trace - orbit.solution["trace"]) < 1e-9 * max(1.0, abs(orbit.solution["trace"]))


def test_the_distance_of_a_state_from_an_orbit_is_that_from_its_path(impacting):
    orbit = impacting.orbit_at(energy=1.0)
    displacement, velocity = cycle_of(impacting.problem, orbit.solution.y).sample(np.array([0.3, 1.1]))
    states = np.hstack([displacement, velocity])
    assert max(distances_from_orbit(impacting.problem, orbit.solution.y, [*states, -states[0]])) < 1e-12
    assert distances_from_orbit(impacting.problem, orbit.solution.y, [states[0] * [1.0, 1.0, 1.0, 1.01]])[0] > 1e-4


def test_families_between_two_origins_begin_at_period_doublings():
    cubic = trace_named("S11-", load_scene("cubic_nes").system, energy=(1e-3, 1.0), quarter_period=4.0)
    doubling = next(event for event in cubic.events if event.type == "PD")
    found = emanating_families(cubic, doubling)
    assert {item.problem.ends for item in found} == {("origin", "origin"), ("rest", "rest")}
    for item in found:
        solution = item.step.extra
        assert solution["residual"] < 1e-12
        family = follow_family(item.problem, item.step, energy=(0.9 * doubling.h, 1.1 * doubling.h), quarter_period=4.0)
        assert len(family) > 3 and np.max(family.points["residual"]) < 1e-12


def test_a_flight_at_its_limit_says_where_and_why():
    system = load_scene("smooth_wall", n=100.0).system
    problem = MultipointProblem(system, ("origin", "rest"), ())
    with pytest.raises(NotConverged, match=r"a flight of time 30 cannot be computed beyond the time [\d.]+: it takes more than 256 Taylor"):
        problem.solve(problem.pack(np.array([0.0, 0.0, 6.0, 8.0]), None, [30.0]), energy=50.0)


def test_a_closed_orbit_without_impacts_meets_impacting_ones_at_a_touch():
    """Oracle: equality of paths. Two oscillators that rotate about the origin touch a stop. The families with impacts that begin there lead
    back to the family without, at the same energy."""
    rows = (((1.0, 0.0), 1.0), ((0.0, 1.0), 1.2), ((1.0, -1.0), 0.4), ((1.0, 0.5), 0.6))
    springs = tuple(Spring(row, stiffness=k, power=3.0) for row, k in rows)
    system = ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag([1.0, 1.01]), (Stop((1.0, 0.0), -0.11, 0.11),), springs=springs)
    problem = MultipointProblem(system, ("periodic", "periodic"), ())
    start = problem.solve(problem.pack([0.097, 0.045, -0.047, 0.047], None, [6.22]), energy=0.008)
    smooth = follow_family(problem, start.y, energy=(0.007, 0.1))
    assert {event.type for event in smooth.events} == {"EP", "GR"}
    touch = next(event for event in smooth.events if event.type == "GR")
    cycle = smooth.orbit(touch.point).cycle
    assert np.max(np.abs(cycle.sample(np.linspace(0.0, cycle.period, 4001))[0][:, 0])) == pytest.approx(0.11, abs=1e-7)
    found = neighbours(smooth, touch, energy=(0.007, 0.1), points=40)
    assert {(item.ends, item.sequence) for item in found} == {(("periodic", "periodic"), "-"), (("periodic", "periodic"), "-+")}
    for item in found:
        assert item.kind == "passage" and item.h == pytest.approx(touch.h, rel=1e-10)
        first = next(event for event in item.branch.events if event.type == "GR")
        back = neighbours(item.branch, first, energy=(0.007, 0.1), points=40)
        own = next(other for other in back if not other.sequence)
        assert own.kind == "passage" and own.branch.problem.periodic and own.h == pytest.approx(touch.h, rel=1e-10)
        assert own.branch.orbit_at(energy=0.008).alpha == pytest.approx(smooth.orbit_at(energy=0.008).alpha, rel=1e-12)
