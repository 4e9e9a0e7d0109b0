"""The coordinates in which arclength is measured. Oracle: central differences of their closed form in numpy."""

import numpy as np
import pytest

from bvp.kernels.step import constraint_row, locate, metric_direction
from bvp.multipoint import MultipointProblem
from bvp.system import vibro_impact_nes
from tests.bvp.orbits import backbone_segment, chain


def position_of(problem, y):
    """(start state / sqrt(2 h), log h, log alpha)."""
    h = problem.energy(y)
    return np.concatenate([problem.start(y) / np.sqrt(2.0 * h), [np.log(h), np.log(problem.quarter_period(y))]])


def problems():
    rng = np.random.default_rng(11)
    problem, y = backbone_segment(vibro_impact_nes(), 0.9, 3)
    yield problem, y
    for ends, sequence in ((("rest", "stop+"), ("-",)), (("stop-", "origin"), ()), (("periodic", "periodic"), ("+", "-", "+"))):
        problem = MultipointProblem(chain(rng, 3, grounded=True), ends, sequence)
        y = rng.normal(size=problem.unknowns)
        problem.flight_times(y)[:] = rng.uniform(0.5, 1.5, problem.inner + 1)
        yield problem, y


@pytest.mark.parametrize("problem, y", list(problems()))
def test_changes_of_the_coordinates_against_differences(problem, y):
    rng = np.random.default_rng(5)
    size = problem.size + 2
    position, direction, change, row = np.empty(size), rng.normal(size=size), np.empty(size), np.empty(problem.unknowns)
    energy, alpha = locate(problem.segment, y, position)
    np.testing.assert_allclose(position, position_of(problem, y), rtol=1e-14, atol=1e-14)
    assert np.isclose(energy, problem.energy(y), rtol=1e-14) and np.isclose(alpha, problem.quarter_period(y), rtol=1e-14)
    constraint_row(problem.segment, y, energy, alpha, position, direction, row)
    for step in rng.normal(size=(5, problem.unknowns)):
        expected = (position_of(problem, y + 1e-6 * step) - position_of(problem, y - 1e-6 * step)) / 2e-6
        slope, length = metric_direction(problem.segment, y, position, energy, alpha, step, change)
        np.testing.assert_allclose(change, expected, rtol=1e-7, atol=1e-7 * length)
        assert np.isclose(length, np.linalg.norm(change), rtol=1e-13)
        # h is quadratic, so its central difference is exact
        assert np.isclose(slope, (problem.energy(y + step) - problem.energy(y - step)) / 2.0, rtol=1e-12, atol=1e-12)
        assert abs(row @ step - direction @ expected) < 1e-6 * length * np.linalg.norm(direction)
