"""The benchmark of sweeps: the integrator finds the same motion, and the table is complete. No time is asserted."""

import numpy as np

from benchmarks.sweeps import SCENES, integrated, sweep_table
from saltus.scene import load_scene
from transitions.sweep.settle import settle


def test_the_integrator_finds_the_same_motion():
    """Oracle: solve_ivp with tolerance 1e-9, over two periods of a periodic motion."""
    scene = load_scene("forced_chain")
    found = settle(scene.system, scene.forces)
    impacts, end = integrated(scene.system, scene.forces, found.states[0], 2.0 * found.period * found.period_of_loads)
    assert impacts == 2 * len(found.impacts) > 0
    assert np.abs(end - found.states[0]).max() < 1e-6


def test_each_scene_has_a_row():
    table = sweep_table(quick=True)
    assert [row[0] for row in table.rows] == list(SCENES[:2]) and {len(row) for row in table.rows} == {len(table.columns)}
    assert all(float(row[2]) > 0.0 for row in table.rows)
