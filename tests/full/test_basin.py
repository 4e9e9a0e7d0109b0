"""Basins of systems with two coordinates. Oracle: the plain simulator, over hundreds of periods of each start."""

import math

import numpy as np
import pytest

from bvp.simulate import Simulator
from saltus import load_scene
from transitions.basin.basin import find_basin
from transitions.basin.following import StartFollower
from transitions.basin.grid import BasinAxis, StartGrid
from transitions.basin.identity import same_states
from transitions.basin.plan import BasinPlan, path_of
from transitions.sweep.settle import settle


def basin_of(w, x, y, count, **options):
    scene = load_scene("absorber", w=w)
    grid = StartGrid(("u1", "u2"), BasinAxis(*x, count), BasinAxis(*y, count), **options)
    return scene, find_basin(BasinPlan(path_of(scene.parametric), grid))[0]


@pytest.mark.parametrize(
    ("w", "x", "y", "count", "attractors"),
    [
        (1.4, ("u2", -1.0, 1.0), ("u2'", -2.0, 2.0), 30, 4),
        (1.4, ("u1", -3.0, 3.0), ("u2", -3.0, 3.0), 40, 5),
        (0.9, ("u2", -3.0, 3.0), ("u1", -3.0, 3.0), 40, 2),
    ],
)
def test_no_start_of_the_absorber_is_assigned_to_another_attractor(w, x, y, count, attractors):
    scene, basin = basin_of(w, x, y, count)
    assert len(basin.attractors) == attractors and not basin.undecided
    simulator = Simulator(scene.system, list(scene.forces))
    chosen = basin.attractor >= 0
    assert chosen.sum() > 300
    for state, number in zip(basin.grid.states[chosen], basin.attractor[chosen], strict=True):
        final = simulator.run(state[:2], state[2:], 700 * 2.0 * math.pi / w).final
        distances = [np.abs(found.states - final).max(axis=1).min() for found in basin.attractors]
        assert np.argmin(distances) == number and min(distances) < 1e-5, state


def test_the_saddles_of_the_absorber_part_two_basins():
    """Oracle: each is a fixed point of the stroboscopic map over its period, and motions on both sides of it, along the unstable direction,
    go to different attractors."""
    scene, basin = basin_of(1.4, ("u2", -1.0, 1.0), ("u2'", -2.0, 2.0), 30)
    assert len(basin.saddles) >= 2
    follower = StartFollower(scene.system, scene.forces)
    for saddle in basin.saddles:
        start, p = saddle.states[0], saddle.period
        assert np.abs(follower.follow(start[None], p).states[0] - start).max() < 1e-8
        columns = [
            (follower.follow((start + sign * 1e-6 * unit)[None], p).states[0] - start) * sign / 2e-6
            for unit in np.eye(4)
            for sign in (-1, 1)
        ]
        matrix = np.array([columns[2 * k] + columns[2 * k + 1] for k in range(4)]).T
        values, vectors = np.linalg.eig(matrix)
        k = int(np.argmax(np.abs(values)))
        assert abs(values[k] - saddle.multipliers[0]) < 1e-3 * abs(values[k]) and np.sum(np.abs(values) > 1.0) == 1
        ends = [settle(scene.system, scene.forces, *np.split(start + sign * 1e-3 * vectors[:, k].real, 2)) for sign in (-1.0, 1.0)]
        assert not same_states(ends[0].states, ends[1].states)
