"""Long cases of tests/transitions/test_settle.py."""

import math

import numpy as np

from bvp.simulate import simulate
from saltus.scene import load_scene
from transitions.sweep.settle import SettledKind, settle


def test_sticking_at_the_start_does_not_hide_chaos():
    """The ball sticks to its table at the start, which leaves no tangent vector. Oracle: differences of `simulate` in one later period."""
    scene = load_scene("bouncing_ball")
    found = settle(scene.system, scene.forces)
    assert found.kind is SettledKind.CHAOS and math.isfinite(found.growth)
    near, step = found.states[0], 1e-8
    ends = [
        simulate(scene.system, near[:1] + sign * step, near[1:], found.period_of_loads, forces=scene.forces).final for sign in (1.0, -1.0)
    ]
    assert np.linalg.norm(ends[0] - ends[1]) > 2.0 * step
