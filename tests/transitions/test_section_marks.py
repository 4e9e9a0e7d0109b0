"""Periodic orbits on a section. Oracles: the section's own map, closed forms of linear motion, the families' multipliers."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bvp.closures import Cycle
from bvp.system import vibro_impact_nes
from tests.branches.traced import traced
from tests.lab.flights import LinearFlight
from transitions.section.plane import SectionPlane
from transitions.section.rotation import FixedPoint, about_point, fixed_points, return_map, rotations
from transitions.section.section import follow_crossings, section
from transitions.section.view import IMAGES, branch_marks, crossings_of, mode_marks, orbit_marks


@pytest.mark.parametrize(
    ("name", "energy"), [("S13O00+", 0.3), ("S11O00-", 0.075), ("S11O00-", 0.5), ("S73O33-", 2.0), ("U4122-", 2.5), ("U44-", 0.06)]
)
def test_the_map_carries_the_marks_of_an_orbit_round(name, energy):
    """Oracle: the map of the section, which knows nothing of families: each crossing goes to the next, for the orbit and all its
    images, and the time round is the period."""
    plane = SectionPlane(vibro_impact_nes(), energy)
    marks = branch_marks(plane, traced(name, low=0.05, high=5.0))
    assert marks
    for mark in marks:
        images, derivatives, times = return_map(plane, mark.points)
        scale = np.abs(derivatives).max(axis=(1, 2))
        apart = np.abs(images[:, None] - mark.points[None]).max(axis=-1)
        goes_to = apart.argmin(axis=1)
        assert np.all(apart.min(axis=1) < 1e-11 * scale)
        assert sorted(goes_to) == list(range(len(mark.points)))
        assert times.sum() == pytest.approx(mark.period, abs=1e-10 * scale.max())
        product, k = np.eye(2), 0
        for _ in mark.points:
            product, k = derivatives[k] @ product, int(goes_to[k])
        assert k == 0
        assert (abs(np.trace(product)) < 2.0) == (mark.kind == "elliptic")


def test_orbits_without_a_symmetry_have_images():
    """Oracle: a symmetric orbit is its own image; one that runs from the origin to the origin is that of mirror and reversal together."""
    plane = SectionPlane(vibro_impact_nes(), 0.3)
    assert {mark.image for mark in branch_marks(plane, traced("S13O00+", low=0.05, high=5.0))} == {"own"}
    plane = SectionPlane(vibro_impact_nes(), 2.5)
    marks = branch_marks(plane, traced("U4122-", low=0.05, high=5.0))
    assert {mark.image for mark in marks} == {"own", "mirrored"}


def test_linear_modes_are_the_fixed_points_of_linear_motion():
    """Oracle: closed form: trace 2 cos(2 pi w'/w) at the mode of frequency w."""
    plane = SectionPlane(vibro_impact_nes(), 0.06)
    marks = {mark.label: mark for mark in mode_marks(plane)}
    slow, fast = plane.system.modes.frequencies
    found = fixed_points(plane)
    for label, ratio, period in (("L11-", slow / fast, 2 * math.pi / fast), ("L11+", fast / slow, 2 * math.pi / slow)):
        x, y = marks[label].points[0]
        (point,) = [p for p in found if math.hypot(p.x - x, p.y - y) < 1e-11]
        assert point.kind == marks[label].kind == "elliptic"
        assert point.trace == pytest.approx(2.0 * math.cos(2.0 * math.pi * ratio), abs=1e-11)
        assert point.period == pytest.approx(period, rel=1e-12)
    assert not [mark for mark in mode_marks(SectionPlane(vibro_impact_nes(), 0.1)) if mark.label == "L11-"]


@pytest.mark.parametrize("guesses", ["12", [["0", "0.6"]], [[0.0, 0.6, 0.0]], [[0.0, True]]])
def test_guesses_that_are_no_points_are_refused(guesses):
    """Oracle: the words."""
    with pytest.raises(ValueError, match=r"guesses is an array of numbers of shape \(m, 2\)"):
        fixed_points(SectionPlane(vibro_impact_nes(), 0.06), guesses)


@pytest.mark.parametrize(("mu", "sigma"), [(0.1, 0.1), (0.37, 0.81)])
def test_linear_motion_turns_about_its_modes_at_the_ratio_of_frequencies(mu, sigma):
    """Oracle: closed form: on a torus whose mode of frequency w prevails in u2, the other makes w'/w turns from crossing to crossing."""
    system = vibro_impact_nes(mu, sigma)
    found = section(system, 0.49 * sigma, orbits=60, crossings=400)
    turning = rotations(found)
    slow, fast = system.modes.frequencies
    u, v = found.plane.states(found.points[:, 0])
    shapes = system.modes.shapes
    amplitudes = np.hypot(v @ system.mass @ shapes / system.modes.frequencies, u @ system.mass @ shapes) * np.abs(shapes[1])
    expected = np.where(amplitudes[:, 0] > amplitudes[:, 1], fast / slow, slow / fast) % 1.0
    # Where one mode prevails in displacement and not in velocity, u2 has zeros of both.
    clear = np.abs(np.log(amplitudes[:, 0] / amplitudes[:, 1])) > math.log(fast / slow)
    assert clear.sum() > 20
    assert np.abs(turning.numbers - expected)[clear].max() < 1e-5
    assert np.median(np.abs(turning.numbers - expected)[clear]) < 1e-7
    assert np.array_equal([turning.centres[k].y > 0.0 for k in turning.about[clear]], (amplitudes[:, 0] > amplitudes[:, 1])[clear])


def test_close_to_an_elliptic_point_the_rotation_number_is_that_of_its_trace():
    """Oracle: trace = 2 cos(2 pi r) at a fixed point with impacts."""
    plane = SectionPlane(vibro_impact_nes(), 0.3)
    centres = [centre for centre in fixed_points(plane) if centre.elliptic and centre.trace < 1.9]
    assert len(centres) >= 4
    for centre in centres:
        near = follow_crossings(plane, np.array([[centre.x + 1e-4, centre.y]]), 600)
        assert near.impacts[0] > 500
        number = rotations(near, [centre]).numbers[0]
        assert 2.0 * math.cos(2.0 * math.pi * number) == pytest.approx(centre.trace, abs=1e-4)


def test_chaotic_orbits_have_no_rotation_number():
    """Oracle: the orbits' Lyapunov exponents: those that part fast have none."""
    found = section(vibro_impact_nes(), 0.2, orbits=60, crossings=400)
    turning = rotations(found)
    chaotic = found.exponents > 0.03
    assert chaotic.sum() > 5
    assert np.isnan(turning.numbers[chaotic]).mean() > 0.9


def test_a_place_without_an_elliptic_point_is_refused():
    """Oracle: the nearest one that exists is named."""
    found = section(vibro_impact_nes(), 0.06, orbits=1, crossings=2)
    assert about_point(found, (0.0, 0.8)).y == pytest.approx(0.832889104)
    with pytest.raises(ValueError, match=r"no elliptic fixed point is found from \(9, 9\) at h = 0.06; nearest: \(.*, 0.832889\)"):
        about_point(found, (9.0, 9.0))
    with pytest.raises(ValueError, match="restitution 0.7 of stop a loses energy"):
        rotations(section(vibro_impact_nes(rho=0.7), 0.06, orbits=1, crossings=2))


def test_images_are_those_of_the_motion_itself():
    """Oracle: the crossings of the flights that are mirrored, or run backwards, one by one; of flights that have no symmetry."""
    system = vibro_impact_nes()
    modes = system.modes
    durations = np.array([2.3, 4.1, 3.2])
    after = np.random.default_rng(7).normal(size=(3, 4))  # u2 keeps its sign from each flight to the next, so that none crosses between
    before = np.empty_like(after)
    for i, duration in enumerate(durations):
        before[i] = LinearFlight(system).end(after[i], duration)
    contact = np.full(3, -1)
    plane = SectionPlane(system, 0.3)
    backwards = (modes.from_state @ np.diag([1.0, 1.0, -1.0, -1.0]) @ modes.to_state).T

    def points(before, after, duration):
        return crossings_of(plane, Cycle(system, before, after, duration, contact, 0.0))[0]

    turned = after[::-1] @ backwards, before[::-1] @ backwards, durations[::-1].copy()
    expected = {
        "own": points(before, after, durations),
        "mirrored": points(-before, -after, durations),
        "reversed": points(*turned),
        "mirrored and reversed": points(-turned[0], -turned[1], turned[2]),
    }
    orbit = SimpleNamespace(cycle=Cycle(system, before, after, durations, contact, 0.0), label="", stable=None, period=durations.sum())
    marks = {mark.image: mark.points for mark in orbit_marks(plane, orbit, "")}
    assert tuple(marks) == IMAGES
    for image, marked in marks.items():
        apart = np.abs(marked[:, None] - expected[image][None]).max(axis=-1)
        assert len(marked) == len(expected[image]) > 0 and apart.min(axis=1).max() < 1e-12


def section_of(angles, radii):
    """A section of one orbit whose points have these angles, from +y to +x, and radii about the middle, in its own units."""
    found = section(vibro_impact_nes(), 0.06, orbits=1, crossings=2)
    points = np.stack([radii * np.sin(angles), found.plane.height(0.0) * radii * np.cos(angles)], axis=1)
    return replace(found, points=points[None], counts=np.array([len(points)]))


def centre(x, y):
    return FixedPoint(x, y, 1.0, 0.0)


@pytest.mark.parametrize("number", [0.0137 * math.sqrt(2.0), 1.0 - 0.0137 * math.sqrt(2.0), 0.61803398875])
def test_a_curve_that_turns_back_on_its_way_round_has_its_rotation_number(number):
    """Oracle: the rotation that the points are made by: the angle goes back on part of the way."""
    turn = 2.0 * math.pi * number * np.arange(600)
    found = rotations(section_of(turn + 0.9 * np.sin(2.0 * turn), 0.4 + 0.1 * np.cos(turn)), [centre(0.0, 0.0)])
    assert found.numbers[0] == pytest.approx(number, abs=1e-6) and found.about[0] == 0


def test_points_that_come_and_go_round_a_bend_do_not_go_round_its_middle():
    """Oracle: the angles, which never get round, though they are in all quarters."""
    turn = 2.0 * math.pi * 0.0317 * math.sqrt(2.0) * np.arange(600)
    found = rotations(section_of(2.5 * np.sin(turn), 0.5 + 0.05 * np.cos(turn)), [centre(0.0, 0.0)])
    assert np.isnan(found.numbers[0]) and found.about[0] == -1


@pytest.mark.parametrize("first", [0, 1])
def test_of_several_points_an_orbit_is_reported_about_the_one_that_it_goes_round_most_evenly(first):
    """Oracle: a circle, evenly gone round, about its middle."""
    turn = 2.0 * math.pi * 0.217 * math.sqrt(2.0) * np.arange(600)
    both = [centre(0.0, 0.0), centre(0.2, 0.0)]
    found = rotations(section_of(turn, np.full(600, 0.5)), both if first == 0 else both[::-1])
    assert found.about[0] == first and found.numbers[0] == pytest.approx(0.217 * math.sqrt(2.0), abs=1e-9)
