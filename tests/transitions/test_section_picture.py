"""What the picture of a section draws of its points. Oracles: symmetries of the motion, the renderer's own ink, numbers by hand."""

import numpy as np
import pytest
from matplotlib.text import Text

from branches.figures.style import new_figure
from bvp.system import vibro_impact_nes
from transitions.section.figure import ROOM, has_images, robust_limits, section_figure, with_room
from transitions.section.plane import SectionPlane
from transitions.section.rotation import Rotations, rotations
from transitions.section.section import section
from transitions.section.view import OrbitMark, SectionView


def by_gid(axes, name):
    return axes.findobj(lambda artist: artist.get_gid() == name)


@pytest.mark.parametrize("energy", [0.06, 1.0])
def test_the_mirrored_start_has_the_mirrored_points(energy):
    """Oracle: the motion from (-x, y) followed backwards: u to -u with time reversed. From the image of the last point on, the crossings
    are the images of those before it, in reverse order."""
    system = vibro_impact_nes()
    found = section(system, energy, starts=[[0.31, 0.6]], crossings=12)
    back = section(system, energy, starts=(found.points[0, -1:] * (-1.0, 1.0)).tolist(), crossings=12)
    np.testing.assert_allclose(back.points[0, :6], (found.points[0] * (-1.0, 1.0))[::-1][:6], atol=1e-7)
    assert has_images(SectionPlane(system, energy)) and not has_images(SectionPlane(vibro_impact_nes(rho=0.9), energy))


def test_each_motion_is_drawn_with_its_image():
    """Oracle: the points of the section and their images; of a system that loses energy the points alone."""
    for rho, images in ((1.0, True), (0.8, False)):
        found = section(vibro_impact_nes(rho=rho), 0.3, orbits=4, crossings=30)
        figure = section_figure([SectionView(found)])
        (line,) = by_gid(figure.axes[0], "section0-points")
        assert "motions drawn" not in figure.legends[0].get_title().get_text()
        points = found.points.reshape(-1, 2)
        wanted = np.concatenate([points, points * (-1.0, 1.0)]) if images else points
        np.testing.assert_array_equal(np.sort(line.get_xydata(), axis=0), np.sort(wanted, axis=0))


def test_a_few_outliers_do_not_set_the_range_of_colours():
    """Oracle: rotation numbers by hand; the bar ends in a tip where the outlier lies."""
    found = section(vibro_impact_nes(), 0.06, orbits=12, crossings=30)
    numbers = np.array([*np.linspace(0.30, 0.34, 11), 0.97])
    view = SectionView(found, rotations=Rotations(numbers, np.zeros(12, dtype=int), rotations(found).centres))
    figure = section_figure([view], colour="rotation")
    (dots,) = by_gid(figure.axes[0], "section0-points")
    assert (dots.norm.vmin, dots.norm.vmax) == pytest.approx((0.30, 0.34))
    assert dots.get_array().max() == 0.97 and figure.axes[1]._colorbar.extend == "max"
    assert robust_limits(numbers[:11]) == (0.30, 0.34)


def test_a_section_that_loses_energy_is_coloured_by_energy():
    """Oracle: the energies at the crossings; the scale is logarithmic, and the bar names it."""
    found = section(vibro_impact_nes(lam=0.01, rho=0.9), 2.0, orbits=8, crossings=60)
    figure = section_figure([SectionView(found)], colour="energy")
    (dots,) = by_gid(figure.axes[0], "section0-points")
    np.testing.assert_array_equal(dots.get_array(), found.energies[~np.isnan(found.times)])
    assert type(dots.norm).__name__ == "LogNorm" and "energy" in figure.axes[1].get_ylabel()


def test_names_on_points_have_a_ground_and_a_readable_sign():
    """Oracle: the renderer's extents: the ground covers the raised sign too, which is at least 6 points large; seven tenths of a name."""
    found = section(vibro_impact_nes(), 0.3, orbits=10, crossings=50)
    figure = section_figure([SectionView(found, (OrbitMark("f", "S13O00+", 1, 1.0, 2, "own", np.array([[0.1, 0.2]])),))])
    (name,) = [text for text in figure.axes[0].findobj(Text) if "S13" in text.get_text()]
    figure.draw_without_rendering()
    ground = name.get_bbox_patch()
    assert ground.get_alpha() >= 0.9 and 0.7 * name.get_fontsize() >= 6.0
    box, text = ground.get_window_extent(), name.get_window_extent()
    assert box.x0 < text.x0 and box.y1 > text.y1 and box.x1 > text.x1


def test_what_cannot_be_drawn_is_refused():
    """Oracle: the words."""
    with pytest.raises(ValueError, match="nothing to draw: no section"):
        section_figure([])
    with pytest.raises(ValueError, match="unknown colour 'red': expected none, energy, lyapunov, rotation"):
        section_figure([SectionView(section(vibro_impact_nes(), 0.06, orbits=1, crossings=2))], colour="red")


def axes_of_points():
    """Axes whose data coordinates are points of type."""
    figure = new_figure(3.0)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    width, height = 72.0 * figure.get_size_inches()
    axes.set_xlim(0.0, width)
    axes.set_ylim(0.0, height)
    return axes


def apart(one, other):
    return np.hypot(*(one.points[:, None] - other.points[None]).T).min()


def test_orbits_are_drawn_that_have_room_beside_those_before_them():
    """Elliptic ones first, then by impacts; none is left out that no earlier one is in the way of."""
    random = np.random.default_rng(3)
    marks = [
        OrbitMark(
            f"f{k}", "", int(random.integers(-1, 2)), 1.0, int(random.integers(1, 30)), "own", random.uniform(0.0, 200.0, (1 + k % 3, 2))
        )
        for k in range(400)
    ]
    drawn = with_room(axes_of_points(), marks)
    assert 20 < len(drawn) < 200
    assert min(apart(one, other) for k, one in enumerate(drawn) for other in drawn[:k]) >= ROOM * (1.0 - 1e-9)
    rank = {mark.family: (mark.stable != 1, mark.impacts, len(mark.points)) for mark in marks}
    assert [rank[mark.family] for mark in drawn] == sorted(rank[mark.family] for mark in drawn)
    kept = {mark.family for mark in drawn}
    for mark in marks:
        if mark.family not in kept:
            assert any(rank[other.family] <= rank[mark.family] and apart(mark, other) < ROOM * (1.0 + 1e-9) for other in drawn)


def test_a_picture_says_how_many_orbits_it_marks():
    """Two orbits at one place have room for one."""
    found = section(vibro_impact_nes(), 0.3, orbits=2, crossings=3)
    marks = tuple(OrbitMark(f"f{k}", "", 1, 1.0, k, "own", np.array([[0.1 * (k % 2), 0.2]])) for k in range(3))
    figure = section_figure([SectionView(found, marks)])
    assert "2 of 3 orbits marked" in figure.legends[0].get_title().get_text() and "marked" not in figure.axes[0].get_xlabel()
    plate = section_figure([SectionView(found, marks), SectionView(found, marks[:2])])
    assert plate.axes[0].get_title().endswith("(2 of 3 orbits marked)") and "marked" not in plate.axes[1].get_title()
    (circles,) = [line for line in plate.axes[0].lines if line.get_gid() == "section0-elliptic orbit"]
    assert np.array_equal(circles.get_xydata(), [[0.0, 0.2], [0.1, 0.2]])
