"""Positions at rest under constant loads against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from bvp.resting import rest_position
from bvp.system import ImpactSystem, Stop


def chain(n, stiffness, stops):
    """n masses that hang on springs below each other, counted downwards."""
    matrix = stiffness * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    matrix[-1, -1] = stiffness
    return ImpactSystem(np.eye(n), np.zeros((n, n)), matrix, stops)


@pytest.mark.parametrize("stiffness", [1e-12, 1.0, 1e7, 1e12])
@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
def test_a_pressed_stop_holds_a_load_in_any_units(stiffness, length):
    """Oracle: a spring k and a stop at -L under the load -2 k L; the stop takes k L."""
    system = ImpactSystem([[1.0]], [[0.0]], [[stiffness]], [Stop((1.0,), lower=-length)])
    rest = rest_position(system, np.array([-2.0 * stiffness * length]))
    force, energy = stiffness * length, stiffness * length**2
    assert rest.pressed == ((0, -length),) and rest.place == pytest.approx([-length], rel=1e-14)
    assert rest.force == pytest.approx([force], rel=1e-14) and rest.energy == pytest.approx(-1.5 * energy, rel=1e-14)


@pytest.mark.parametrize("n", [30, 100])
def test_a_long_chain_hangs_on_its_springs(n):
    """Oracle: spring j carries n - j masses, so that mass i hangs at the sum of (n - j) g/k up to i."""
    rest = rest_position(chain(n, 1.0, [Stop(tuple(np.eye(n)[-1]), upper=1e6)]), np.full(n, 9.81))
    assert rest.pressed == () and rest.place == pytest.approx(9.81 * np.cumsum(np.arange(n, 0, -1.0)), rel=1e-11)


def test_of_many_stops_those_that_are_pressed_are_found():
    """Oracle: balance of each mass between stops on both sides; the stops that are pressed push back."""
    n = 10
    system = chain(n, 1000.0, [Stop(tuple(row), lower=-0.05 * (i + 1), upper=0.05 * (i + 1)) for i, row in enumerate(np.eye(n))])
    rest = rest_position(system, np.full(n, -9.81))
    pressed = [stop for stop, _ in rest.pressed]
    assert pressed == [0, 1, 2, 3, 4] and rest.force[pressed].min() > 0.0
    assert system.stiffness @ rest.place + 9.81 == pytest.approx(rest.force, abs=1e-10)


def test_a_stack_of_balls_rests_on_its_floor():
    """Oracle: each contact carries the weight of the balls above it, and all are closed."""
    n, weights = 15, 9.81 * np.arange(1.0, 16.0)
    stops = [Stop(tuple(np.eye(n)[i] - (np.eye(n)[i - 1] if i else 0.0)), lower=0.1) for i in range(n)]
    rest = rest_position(ImpactSystem(np.diag(weights), np.zeros((n, n)), np.zeros((n, n)), stops), -weights)
    assert len(rest.pressed) == n and rest.place == pytest.approx(0.1 * np.arange(1.0, n + 1.0), rel=1e-13)
    assert rest.force == pytest.approx(weights, rel=1e-12)
