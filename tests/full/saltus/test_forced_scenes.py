"""Long cases of tests/saltus/test_forced_scenes.py."""

import numpy as np
import pytest

from bvp.simulate import simulate
from saltus import trace
from tests.saltus.test_forced_scenes import FORCED, require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling
from tests.units import CHANGES, RESPONSES, Units, require_same_response, scaled_scene


@pytest.mark.parametrize("e", [0.5, 0.8])
@pytest.mark.parametrize("n", [1, 2])
def test_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling(e, n):
    """Oracle: see `require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling`."""
    require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling(e, n)


@pytest.mark.parametrize("units", CHANGES)
@pytest.mark.parametrize("name", sorted(RESPONSES))
def test_a_response_does_not_depend_on_units(tmp_path, name, units):
    """Oracle: the same response in the units of the scene."""
    require_same_response(name, units, tmp_path)


@pytest.mark.parametrize("units", CHANGES)
@pytest.mark.parametrize("name", FORCED)
def test_a_motion_does_not_depend_on_units(tmp_path, name, units):
    """Oracle: the same motion in the units of the scene, over three periods of the load."""
    states = []
    for one in (Units(), units):
        scene = scaled_scene(name, one, tmp_path).scene
        zero, period = np.zeros(scene.system.degrees_of_freedom), 2.0 * np.pi / scene.parameters["w"]
        motion = simulate(scene.system, zero, zero + 0.3 * one.of("speed"), 3.0 * period, forces=scene.forces)
        states.append(motion.final / np.repeat([one.length, one.of("speed")], len(zero)))
    np.testing.assert_allclose(states[1], states[0], rtol=0.0, atol=1e-7 * np.abs(states[0]).max())


FREE = {
    "lee2009": ("S11-", 0.07, 0.5), "impact_damper": ("S11-", 0.1, 0.5), "cubic_nes": ("S11+", 1e-3, 1e-2),
    "duffing_pair": ("S11-", 0.1, 1.0),
}  # fmt: skip


@pytest.mark.parametrize("units", CHANGES)
@pytest.mark.parametrize("name", FREE)
def test_a_family_does_not_depend_on_units(tmp_path, name, units):
    """Oracle: the same family, found by its name in the units of the scene."""
    label, low, high = FREE[name]
    found = []
    for one in (Units(), units):
        unit = one.of("energy")
        branch = trace(label, scene=scaled_scene(name, one, tmp_path).scene, energy=(low * unit, high * unit))
        found.append((len(branch), sorted((event.type, event.h / unit, event.alpha / one.time) for event in branch.events)))
    assert abs(found[1][0] - found[0][0]) <= 3 and len(found[0][1]) == len(found[1][1])
    for (code, h, alpha), (other, *values) in zip(found[0][1], found[1][1], strict=True):
        assert code == other and values == pytest.approx([h, alpha], rel=1e-9)
