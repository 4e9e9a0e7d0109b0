"""Points that are made when asked for are those of a list. Oracle: the same points in a list, sliced and turned by hand."""

import numpy as np
import pytest

from continuation.problem import PlainPoints, Point, Points, Step


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
        with pytest.raises(IndexError):
            points[place]
    assert list(Points()) == [] and Points().arclengths().shape == (0,)


def test_a_single_point_is_replaced():
    points, _ = joined()
    points.mark(Point(8, 0.5, step(7)))
    assert points[-1].arclength == 0.5


def test_a_block_seen_the_other_way():
    turned = PlainPoints(
        3, 0.9 - PLAIN.arclengths[::-1], PLAIN.strides[::-1], STEPS[::-1], lambda step: step._replace(slope=-step.slope)
    )
    assert numbers(turned) == [(10 - p.index, 0.9 - p.arclength, p.step.parameter, p.step_size, None) for p in reversed(PLAIN)]
    assert [point.step.slope for point in turned] == [-1.0] * 5
