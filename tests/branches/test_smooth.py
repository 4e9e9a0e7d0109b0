"""Drawn curves. Oracles: the points themselves; exact curves; monotone pieces stay monotone."""

import numpy as np
import pytest

from branches.figures.curves import PARTS, curve_runs, smooth
from branches.figures.room import even_points
from branches.figures.single import branch_figure
from tests.branches.traced import traced


def test_it_passes_through_every_point_and_bends_nowhere_else():
    random = np.random.default_rng(0)
    for _ in range(30):
        count = int(random.integers(2, 25))
        s = np.cumsum(random.uniform(0.01, 0.4, count))
        given = np.stack([np.exp(random.normal(size=count)), random.normal(size=count)], axis=1)
        drawn = smooth(given, s)
        np.testing.assert_array_equal(drawn[::PARTS], given)
        for values in drawn.T:  # between two points it goes one way: no bend of its own, nothing overshoots
            steps = np.diff(values).reshape(count - 1, PARTS) * np.sign(np.diff(values[::PARTS]))[:, None]
            assert np.all(steps >= -1e-12 * np.max(np.abs(values)))


def test_a_smooth_curve_is_met_better_than_by_chords():
    """Oracle: y = sin x over exp(x): the error of the drawn curve falls faster than the square of the spacing, below the chords'."""
    errors = []
    for count in (9, 17, 33):
        s = np.linspace(0.0, 3.0, count)
        drawn = smooth(np.stack([np.exp(s), np.sin(s)], axis=1), s)
        dense = np.log(drawn[:, 0])
        inside = (dense > 0.5) & (dense < 1.0)
        errors.append(np.max(np.abs(drawn[:, 1] - np.sin(dense))[inside]))
        chords = np.max(np.abs(np.interp(dense, s, np.sin(s)) - np.sin(dense))[inside])
        assert errors[-1] < 0.5 * chords
    assert errors[2] < errors[0] / 32.0


def test_breaks_stay():
    """Oracle: the pieces: nothing is drawn to a row that is not finite, or where the arclength does not rise; stability is that of the
    pieces between points."""
    s = np.arange(9.0)
    points = np.stack([np.exp(0.1 * s), np.sin(s)], axis=1)
    points[6] = np.nan
    s[3:] -= 1.0
    drawn = smooth(points, s)
    there = np.isfinite(drawn[:, 1]).nonzero()[0] / PARTS
    assert not np.any((there > 2.0) & (there < 3.0)) and not np.any((there > 5.0) & (there < 7.0)) and len(there) == 5 * PARTS + 3
    runs = curve_runs(drawn, np.array([1, 1, 0, 0, 0, 0, 0, 1, 1]))
    assert {code: len(run) for code, run in runs.items()} == {1: 2 * PARTS + 3, 0: 3 * PARTS + 3}


@pytest.mark.parametrize("name", ["U8353-"])
def test_no_corner_is_seen(name):
    """Oracle: see `require_no_corner_is_seen`."""
    require_no_corner_is_seen(name)


def require_no_corner_is_seen(name):
    """Oracle: the angle between neighbouring pieces on the page, less than ten degrees where the paper's curves are smooth."""
    figure = branch_figure(traced(name))
    angles = {}
    for axes in figure.axes:
        for line in axes.get_lines():
            gid = line.get_gid() or ""
            if gid.endswith(("-stable", "-unstable")) and "start" in gid:
                at = axes.transData.transform(line.get_xydata()) * 72 / figure.dpi
                steps = np.diff(even_points(at, 1.0), axis=0)
                steps[np.hypot(*steps.T) > 1.5] = np.nan  # from a piece to the next
                angles[gid] = np.abs(np.angle(np.exp(1j * np.diff(np.arctan2(steps[:, 1], steps[:, 0])))))
    assert {gid.partition("-")[0] for gid, values in angles.items() if len(values) > 20} == {"start0", "start1"}
    assert all(np.nanmax(values, initial=0.0) < np.radians(10.0) for values in angles.values())
