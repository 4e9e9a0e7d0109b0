"""Marks of a section's picture. Oracle: distances between all of them, taken pair by pair."""

import numpy as np

from transitions.figures.section import ROOM, with_room
from transitions.section.view import Mark


def axes_of_points():
    """Axes whose data coordinates are points of type."""
    from branches.figures.style import new_figure

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
        Mark(f"f{k}", "", int(random.integers(-1, 2)), 1.0, int(random.integers(1, 30)), "own", random.uniform(0.0, 200.0, (1 + k % 3, 2)))
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
    from bvp.system import vibro_impact_nes
    from transitions.figures.section import section_figure
    from transitions.section.section import section
    from transitions.section.view import SectionView

    found = section(vibro_impact_nes(), 0.3, orbits=2, crossings=3)
    marks = tuple(Mark(f"f{k}", "", 1, 1.0, k, "own", np.array([[0.1 * (k % 2), 0.2]])) for k in range(3))
    figure = section_figure([SectionView(found, marks)])
    assert "2 of 3 orbits marked" in figure.legends[0].get_title().get_text() and "marked" not in figure.axes[0].get_xlabel()
    plate = section_figure([SectionView(found, marks), SectionView(found, marks[:2])])
    assert plate.axes[0].get_title().endswith("(2 of 3 orbits marked)") and "marked" not in plate.axes[1].get_title()
    (circles,) = [line for line in plate.axes[0].lines if line.get_gid() == "section0-elliptic orbit"]
    assert np.array_equal(circles.get_xydata(), [[0.0, 0.2], [0.1, 0.2]])
