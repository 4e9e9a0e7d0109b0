"""Long cases of tests/transitions/test_basin.py."""

import math

from saltus import load_scene
from transitions.basin.basin import find_basin
from transitions.basin.grid import BasinAxis, StartGrid
from transitions.basin.identity import same_states
from transitions.basin.plan import BasinPlan, path_of


def absorber_plan(count=12, phase=0.0):
    scene = load_scene("absorber", w=1.4)
    grid = StartGrid(("u1", "u2"), BasinAxis("u2", -1.0, 1.0, count), BasinAxis("u2'", -2.0, 2.0, count), phase=phase)
    return BasinPlan(path_of(scene.parametric), grid)


def test_an_odd_system_has_mirror_images_of_basins():
    """Oracle: x(t) -> -x(t + pi/w) takes motions to motions: the basins half a period later are those of now, turned by half a turn."""
    now, _ = find_basin(absorber_plan(), saddles=False)
    later, _ = find_basin(absorber_plan(phase=math.pi), saddles=False)
    assert len(now.attractors) == len(later.attractors) == 4 and not now.undecided and not later.undecided
    turned = later.grid.image(later.attractor)[::-1, ::-1].ravel()
    pairs = set(zip(now.attractor.tolist(), turned.tolist(), strict=True))
    assert len(pairs) == 4
    for here, there in pairs:
        image = now.attractors[here].mirror
        assert image not in (-1, here) and same_states(later.attractors[there].states, now.attractors[image].states)
        assert now.attractors[here].family == now.attractors[image].family
