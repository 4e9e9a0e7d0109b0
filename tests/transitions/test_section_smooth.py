"""Poincare sections with smooth forces.

Oracles: DOP853 of scipy with events, areas and energies that are constant, periodic orbits of a family, the closed form of the boundary.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from saltus import load_scene, trace
from transitions.section.plane import SectionPlane
from transitions.section.section import SectionEnd, follow_crossings, section
from transitions.section.view import branch_marks

PLANES = [("cubic_nes", {}, 0.05), ("smooth_wall", {"n": 3}, 0.5)]


@pytest.mark.parametrize(("name", "values", "energy"), PLANES[:1])
def test_crossings_are_those_of_a_second_integrator(name, values, energy):
    """Oracle: see `require_crossings_are_those_of_a_second_integrator`."""
    require_crossings_are_those_of_a_second_integrator(name, values, energy)


def require_crossings_are_those_of_a_second_integrator(name, values, energy):
    """Oracle: DOP853 with events at u2 = 0."""
    system = load_scene(name, **values).system
    plane = SectionPlane(system, energy)
    points = plane.starts(2)
    found = follow_crossings(plane, points, 5)
    u, v = plane.states(points)

    inverse = np.linalg.inv(system.mass)

    def rate(_, x):
        return [*x[2:], *(inverse @ (-system.stiffness @ x[:2] - system.smooth_forces.acting(x[:2], x[2:])))]

    def crosses(_, x):
        return x[1]

    crosses.direction = 1
    for m in range(2):
        end = found.times[m, -1] + 0.01
        other = solve_ivp(rate, (0.0, end), [*u[m], *v[m]], "DOP853", events=crosses, rtol=1e-13, atol=1e-15, max_step=0.5)
        times, states = other.t_events[0], other.y_events[0]
        states = states[times > 1e-9]
        assert np.abs(times[times > 1e-9] - found.times[m, 1:]).max() < 1e-9
        assert np.abs(plane.coordinates(states[:, :2], states[:, 2:]) - found.points[m, 1:]).max() < 1e-9
    assert found.drift < 1e-13


@pytest.mark.parametrize(("name", "values", "energy"), [*PLANES, ("cubic_and_stops", {}, 1.0)])
def test_the_map_keeps_areas(name, values, energy):
    """Invariant: the derivative of the map has the determinant 1, through impacts too. Second method: differences of the map."""
    plane = SectionPlane(load_scene(name, **values).system, energy)
    points, step = plane.starts(6), 1e-6
    images = []
    for direction in np.eye(2):
        found = follow_crossings(plane, points, 2, directions=np.tile(direction, (6, 1)))
        size = np.exp(found.growths[:, 1])[:, None]
        images.append(size * found.tangents[:, 1])
        ends = [follow_crossings(plane, points + sign * step * direction, 2).points[:, 1] for sign in (1.0, -1.0)]
        differences = (ends[0] - ends[1]) / (2.0 * step)
        # The error of a difference is of the square of the step; rounding goes with its inverse.
        assert np.abs(images[-1] - differences).max() < 1e-6 * size.max()
    determinants = images[0][:, 0] * images[1][:, 1] - images[0][:, 1] * images[1][:, 0]
    assert np.abs(determinants - 1.0).max() < 1e-10
    if plane.system.stops:
        assert found.impacts.all()


def test_the_boundary():
    """Oracle: on u2 = 0 the sink has h = 0.05 v1^2/2 + u1^4/4, so |u1| is (4 h)^(1/4) at most."""
    plane = SectionPlane(load_scene("cubic_nes").system, 0.05)
    assert np.allclose(plane.reach, np.array([-1.0, 1.0]) * 0.2**0.25, rtol=1e-14)
    x = np.array([0.0, 0.3, -0.5])
    assert np.allclose(plane.height(x), np.sqrt((0.1 - 0.5 * x**4) / 0.05), rtol=1e-14)


def test_periodic_orbits_return_to_their_marks():
    """Oracle: the orbits of two families, which were solved as boundary-value problems."""
    scene = load_scene("cubic_nes")
    plane = SectionPlane(scene.system, 0.05)
    marks = branch_marks(plane, trace("S11-", scene=scene, energy=(0.04, 0.06)))
    assert len(marks) == 1 and len(marks[0].points) == 1
    found = follow_crossings(plane, marks[0].points, 40)
    assert np.abs(found.points - marks[0].points[0]).max() < 1e-9
    assert np.abs(np.diff(found.times[0]) - marks[0].period).max() < 1e-10


def test_energy_through_impacts_and_smooth_flights():
    """Invariant: constant energy; a sink that reaches its walls hits them."""
    found = section(load_scene("cubic_and_stops").system, 1.0, orbits=4, crossings=60)
    assert set(found.ends) == {SectionEnd.COMPLETE} and found.drift < 1e-12
    assert found.impacts.all() and found.impacts.sum() > 200
