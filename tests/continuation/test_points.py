"""Points that are made when asked for are those of a list. Oracle: the same points in a list, sliced and turned by hand."""

import numpy as np
import pytest

from continuation.points import PlainPoints, Points
from continuation.problem import Point, Step


def step(value):
    y = np.array([float(value), 0.0])
    return Step(True, y, y, (float(value),), 1.0, 0.0, 1, 0.0, float(value), 1.0, [float(value)])


STEPS = [step(value) for value in range(5)]
PLAIN = PlainPoints(3, np.array([0.1, 0.3, 0.4, 0.8, 0.9]), np.array([0.1, 0.2, 0.1, 0.4, 0.1]), STEPS)
SINGLE = [Point(k, 0.01 * k, step(10 + k), 0.01) for k in range(3)]


def numbers(points):
    return [(point.index, point.arclength, point.step.parameter, point.step_size, point.event) for point in points]


def joined():
    points = Points()
    for point in SINGLE:
        points.add([point])
    points.add(PLAIN)
    points.add([Point(8, 1.0, step(20), 0.1)])
    return points, [*SINGLE, *[PLAIN[k] for k in range(5)], Point(8, 1.0, step(20), 0.1)]


def test_points_are_a_sequence():
    points, known = joined()
    assert len(points) == len(known) == 9 and numbers(points) == numbers(known)
    assert [point.index for point in points] == list(range(9))
    assert [points[k].step.parameter for k in range(-9, 9)] == [known[k].step.parameter for k in range(-9, 9)]
    assert points.arclengths().tolist() == [point.arclength for point in known]
    for place in (9, -10):
        with pytest.raises(IndexError, match=f"point {place} of 9"):
            points[place]
    assert list(Points()) == [] and Points().arclengths().shape == (0,)


@pytest.mark.parametrize("place", [slice(1, None), slice(0, 2), slice(4, 7), slice(-2, None), slice(5, 5), slice(None)])
def test_a_slice_is_that_of_the_list(place):
    points, known = joined()
    assert numbers(points[place]) == numbers(known[place])
    with pytest.raises(ValueError, match="expected neighbours"):
        points[::2]


def test_a_single_point_is_replaced_and_one_of_a_block_is_not():
    points, _ = joined()
    points[-1] = SINGLE[1]
    assert points[8] is SINGLE[1]
    with pytest.raises(TypeError, match="stays as it is"):
        points[4] = SINGLE[1]


def test_a_block_seen_the_other_way():
    turned = PlainPoints(
        3, 0.9 - PLAIN.arclengths[::-1], PLAIN.strides[::-1], STEPS[::-1], lambda step: step._replace(slope=-step.slope)
    )
    assert numbers(turned) == [(10 - p.index, 0.9 - p.arclength, p.step.parameter, p.step_size, None) for p in reversed(PLAIN)]
    assert [point.step.slope for point in turned] == [-1.0] * 5
    assert numbers(turned[1:3]) == numbers(list(turned)[1:3])
