"""The sink locked. Oracles: closed forms, and the free system with a spring across the gap so stiff that it hardly moves."""

from dataclasses import replace

import numpy as np
import pytest

from bvp.forcing import Constant, Harmonic, Record
from bvp.run import run
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.transitions.test_sharing import chain
from transitions.locked import lock


def test_the_reference_system_is_one_oscillator():
    """(1 + mu) u'' + u = 0."""
    system, _ = lock(vibro_impact_nes(0.21, 0.3), (0,))
    motion = run(system, [0.0], [2.0], 50.0)
    times = np.linspace(0.0, 50.0, 101)
    np.testing.assert_allclose(motion.sample(times)[0][:, 0], 2.0 * 1.1 * np.sin(times / 1.1), atol=1e-12)
    assert motion.impacts == 0


def test_loads_go_with_the_coordinates():
    """T'f: the force on the sink acts on its carrier."""
    _, forces = lock(
        vibro_impact_nes(), (0,), (Harmonic(2.0, cosine=[0.5, 1.0]), Constant([3.0, -1.0]), Record([0.1, 0.2], [0.0, 1.0], [1.0, 2.0]))
    )
    assert forces[0].cosine.tolist() == [1.5] and forces[0].sine.tolist() == [0.0]
    assert forces[1].load.tolist() == [2.0] and forces[2].load == pytest.approx([0.3])


def test_two_sinks_and_the_stop_that_stays():
    """Oracle: the same chain with both gaps closed by springs of 1e7: the floors agree to the squares of the frequencies over that."""
    locked, _ = lock(chain(), (2, 3))
    assert locked.coordinates == ("u1", "u2") and [stop.name for stop in locked.stops] == ["c"]
    free = chain()
    stiff = free.stiffness.copy()
    for stop in free.stops[:2]:
        stiff += 1e7 * np.outer(stop.gap, stop.gap)
    u, v = np.zeros(4), np.array([0.3, 1.0, 1.0, 1.0])
    times = np.linspace(0.0, 4.0, 41)
    expected, _ = run(replace(free, stiffness=stiff), u, v, 4.0).sample(times)
    found, _ = run(locked, u[:2], v[:2], 4.0).sample(times)
    np.testing.assert_allclose(found, expected[:, :2], atol=1e-5)


def test_a_gap_with_a_lever_and_one_to_the_ground():
    """c . u = 0: the sink moves half as far as its host; a sink beside the ground does not move."""
    system = ImpactSystem(np.diag([1.0, 2.0]), np.zeros((2, 2)), np.eye(2), (Stop((-0.5, 1.0), -1.0, 1.0),))
    assert lock(system, (1,))[0].mass.tolist() == [[1.5]]
    grounded = ImpactSystem(np.diag([1.0, 2.0]), np.zeros((2, 2)), np.eye(2), (Stop((0.0, 1.0), -1.0, 1.0),))
    assert lock(grounded, (1,))[0].mass.tolist() == [[1.0]]


@pytest.mark.parametrize(
    ("system", "nes", "words"),
    [
        (vibro_impact_nes(), (), "no coordinate is marked"),
        (chain(), (1,), "u2 cannot be locked"),
        (ImpactSystem(np.eye(3), np.zeros((3, 3)), np.eye(3), (Stop((1.0, -1.0, 1.0), -1.0, 1.0),)), (0,), "u1 cannot be locked"),
        (ImpactSystem([[1.0]], [[0.0]], [[1.0]], (Stop((1.0,), -1.0, 1.0),)), (0,), "nothing is left"),
    ],
)
def test_what_cannot_be_locked_is_named(system, nes, words):
    with pytest.raises(ValueError, match=words):
        lock(system, nes)
