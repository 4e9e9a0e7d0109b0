"""Drawn curves. Oracles: the points themselves; exact curves; monotone pieces stay monotone."""

import numpy as np
import pytest

from branches.figures.curves import DrawnCurve, smooth
from branches.figures.single import branch_figure
from tests.branches.traced import traced

SIZE = (470.0, 170.0)


def curve(x, y, stable=None, breaks=None):
    stable = np.ones(len(x), dtype=int) if stable is None else np.asarray(stable)
    return DrawnCurve(x, y, stable, np.zeros(len(x) - 1, dtype=bool) if breaks is None else np.asarray(breaks))


def test_it_passes_through_every_point_and_adds_none_beyond():
    random = np.random.default_rng(0)
    for _ in range(30):
        count = int(random.integers(3, 25))
        s = np.cumsum(random.uniform(0.01, 0.4, count))
        given = curve(np.exp(random.normal(size=count)), random.normal(size=count), random.choice([-1, 0, 1], count))
        drawn = smooth(given, s, SIZE)
        at = [int(np.flatnonzero((drawn.x == x) & (drawn.y == y))[0]) for x, y in zip(given.x, given.y, strict=True)]
        assert at == sorted(at) and at[0] == 0 and at[-1] == len(drawn.x) - 1 and len(drawn.x) > 4 * count
        assert not drawn.breaks.any() and len(drawn.breaks) == len(drawn.x) - 1 and len(drawn.stable) == len(drawn.x)
        for i, (low, high) in enumerate(zip(at, at[1:], strict=False)):
            for values in (drawn.x, drawn.y):  # between two points it goes one way: no bend of its own, nothing overshoots
                step = np.diff(values[low : high + 1]) * np.sign(values[high] - values[low])
                assert np.all(step >= -1e-12 * np.max(np.abs(values))), i
        np.testing.assert_array_equal(drawn.stable[at], given.stable)


def test_a_smooth_curve_is_met_better_than_by_chords():
    """Oracle: y = sin x over exp(x): the error of the drawn curve falls faster than the square of the spacing, below the chords'."""
    errors = []
    for count in (9, 17, 33):
        s = np.linspace(0.0, 3.0, count)
        drawn = smooth(curve(np.exp(s), np.sin(s)), s, SIZE)
        dense = np.log(drawn.x)
        inside = (dense > 0.5) & (dense < 1.0)
        errors.append(np.max(np.abs(drawn.y - np.sin(dense))[inside]))
        chords = np.max(np.abs(np.interp(dense, s, np.sin(s)) - np.sin(dense))[inside])
        assert errors[-1] < 0.5 * chords
    assert errors[2] < errors[0] / 32.0


def test_breaks_and_values_that_do_not_exist_stay():
    """Oracle: the pieces: nothing is drawn over a break or to a value that is not finite."""
    s = np.arange(9.0)
    y = np.sin(s)
    y[6] = np.nan
    breaks = np.zeros(8, dtype=bool)
    breaks[2] = True
    drawn = smooth(curve(np.exp(0.1 * s), y, breaks=breaks), s, SIZE)
    level = np.log(drawn.x[np.isfinite(drawn.y)])
    assert not np.any((level > 0.2 + 1e-9) & (level < 0.3 - 1e-9)) and not np.any((level > 0.5 + 1e-9) & (level < 0.7 - 1e-9))
    assert np.sum(drawn.breaks) == 3 and np.sum(np.isnan(drawn.y)) == 1


def test_dense_points_are_left_alone():
    """Oracle: the points: nearer than what can be seen apart."""
    s = np.linspace(0.0, 1.0, 2000)
    given = curve(np.exp(s), s**2)
    assert smooth(given, s, SIZE) is given


@pytest.mark.parametrize("name", ["U8353-", "S11O00-"])
def test_no_corner_is_seen(name):
    """Oracle: the angle between neighbouring pieces on the page, less than ten degrees where the paper's curves are smooth."""
    figure = branch_figure(traced(name))
    angles = {}
    for axes in figure.axes:
        for line in axes.get_lines():
            gid = line.get_gid() or ""
            if gid.endswith(("-stable", "-unstable")) and "start" in gid:
                at = axes.transData.transform(line.get_xydata()) * 72 / figure.dpi
                steps = np.diff(at, axis=0)
                steps = steps[np.hypot(*steps.T) > 0.5]
                angles[gid] = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))))
    assert {gid.partition("-")[0] for gid, values in angles.items() if len(values) > 20} == {"start0", "start1"}
    assert all(np.max(values, initial=0.0) < np.radians(10.0) for values in angles.values())
