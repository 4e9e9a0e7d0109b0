"""Long cases of tests/transitions/test_sweep.py."""

import numpy as np
import pytest

from bvp.simulate import simulate
from tests.transitions.test_sweep import (
    pressed_chain,
    require_the_bouncing_ball_doubles_its_period,
    require_the_exponent_of_a_motion_that_sticks_is_that_of_the_differenced_map,
)
from transitions.sweep.forced import Carried, ForcedMotion


@pytest.mark.parametrize("e", [0.5, 0.8])
def test_the_bouncing_ball_doubles_its_period(e):
    """Oracle: see `require_the_bouncing_ball_doubles_its_period`."""
    require_the_bouncing_ball_doubles_its_period(e)


@pytest.mark.parametrize("r", [0.0, 0.4, 0.7])
def test_the_exponent_of_a_motion_that_sticks_is_that_of_the_differenced_map(r):
    """Oracle: see `require_the_exponent_of_a_motion_that_sticks_is_that_of_the_differenced_map`."""
    require_the_exponent_of_a_motion_that_sticks_is_that_of_the_differenced_map(r)


def test_many_impacts_are_all_recorded():
    """Oracle: the number of impacts of `simulate` over the same time."""
    system, forces = pressed_chain(0.7, -0.4)
    motion = ForcedMotion(system, forces, Carried(np.array([0.5, 0.0, 0.0, 0.0])))
    record = motion.advance(600, impacts=True)
    other = simulate(system, [0.5, 0.0], [0.0, 0.0], 600 * motion.period, forces=forces)
    assert len(record.impacts) == record.count == other.impacts > 1024
    assert np.abs(record.impacts.speeds[:200] - other.stop_events.speeds[~other.stop_events.touches][:200]).max() < 1e-9
