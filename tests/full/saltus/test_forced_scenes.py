"""Long cases of tests/saltus/test_forced_scenes.py."""

import numpy as np
import pytest

from bvp.simulate import simulate
from saltus.errors import BadInput
from tests.saltus.test_forced_scenes import FORCED, require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling
from tests.units import CATALOGUES, CHANGES, FAMILIES, RESPONSES, Units, require_same_family, require_same_response, scaled_scene


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
@pytest.mark.parametrize("name", [*FORCED, "three_storey_building"])
def test_a_motion_does_not_depend_on_units(tmp_path, name, units):
    """Oracle: the same motion in the units of the scene, over three periods of the load; of the building, three seconds without a load."""
    states = []
    for one in (Units(), units):
        scene = scaled_scene(name, one, tmp_path).scene
        zero, w = np.zeros(scene.system.degrees_of_freedom), scene.parameters.get("w", 2.0 * np.pi / one.time)
        motion = simulate(scene.system, zero, zero + 0.3 * one.of("speed"), 6.0 * np.pi / w, forces=scene.forces)
        states.append(motion.final / np.repeat([one.length, one.of("speed")], len(zero)))
    np.testing.assert_allclose(states[1], states[0], rtol=0.0, atol=1e-7 * np.abs(states[0]).max())


def test_every_shipped_scene_is_tested_in_other_units():
    """Oracle: the names of the files."""
    assert {path.stem for path in CATALOGUES.glob("*.toml")} == {*FORCED, "three_storey_building", *(name for name, *_ in FAMILIES)}


@pytest.mark.parametrize("units", CHANGES)
@pytest.mark.parametrize(("name", "start", "low", "high"), FAMILIES)
def test_a_family_does_not_depend_on_units(tmp_path, name, start, low, high, units):
    """Oracle: the same family in the units of the scene. A stiffness beyond the bounds of a scene is refused."""
    if name == "smooth_wall" and units.length == 1e-6:  # w^21 in micrometers
        with pytest.raises(BadInput, match="is too large to compute with"):
            scaled_scene(name, units, tmp_path)
        return
    require_same_family(name, start, (low, high), units, tmp_path)
