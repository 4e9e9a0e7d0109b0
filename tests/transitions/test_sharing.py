"""The shares of NES and LO, and the NES locked.

Oracles: the formulae of the reference system, sums that are the total, mirrored markings. For a locked NES: closed forms, and the free
system with a spring across the gap that is so stiff that it hardly moves.
"""

from dataclasses import replace

import numpy as np
import pytest

from bvp.forcing import Constant, Harmonic, Record
from bvp.simulate import simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from transitions.sharing import lock, sharing_of

TIMES = np.linspace(0.0, 30.0, 301)


def test_the_reference_system():
    """NES: (mu u1'^2 + sigma (u1 - u2)^2)/2 and the stops; LO: the rest, and its damper."""
    system = vibro_impact_nes(0.1, 0.3, 0.02, 0.7)
    shared = sharing_of(system, (0,), (1,))
    motion = simulate(system, [0.0, 0.0], [0.0, 2.0], 30.0, dampers=shared.dampers)
    u, v = motion.sample(TIMES)
    whole, nes, lo = shared.energies(motion, TIMES)
    np.testing.assert_allclose(nes, 0.5 * (0.1 * v[:, 0] ** 2 + 0.3 * (u[:, 0] - u[:, 1]) ** 2), atol=1e-15)
    np.testing.assert_allclose(lo, 0.5 * (v[:, 1] ** 2 + u[:, 1] ** 2), rtol=1e-12)
    np.testing.assert_allclose(nes + lo, whole, rtol=1e-14)
    by_nes, by_lo, work = shared.dissipated(motion, TIMES)
    assert shared.totals(motion.dissipated) == pytest.approx((motion.dissipated["stop a"], motion.dissipated["rest"]), rel=1e-15)
    np.testing.assert_allclose(whole + by_nes + by_lo, motion.initial_energy, rtol=1e-13)
    assert not work.any() and by_nes[0] == by_lo[0] == 0.0 and np.all(np.diff(by_lo) > 0.0)
    assert by_nes[-1] == pytest.approx(motion.dissipated["stop a"], rel=1e-14)


def chain(c_gap=0.3):
    """Ground - floor - roof - two sinks on the roof that a spring joins; one stop at each sink and a wall beside the floor."""
    k = np.array([[3.0, -1.0, 0.0, 0.0], [-1.0, 1.7, -0.2, -0.5], [0.0, -0.2, 0.6, -0.4], [0.0, -0.5, -0.4, 0.9]])
    gaps = [(0.0, -1.0, 1.0, 0.0), (0.0, -1.0, 0.0, 1.0)]
    damping = 0.1 * np.diag([1.0, 0.0, 0.0, 0.0]) + c_gap * np.outer(gaps[0], gaps[0])
    stops = [Stop(gap, -1.0, 1.0, 0.6) for gap in gaps] + [Stop((1.0, 0.0, 0.0, 0.0), upper=0.9, restitution=0.5)]
    return ImpactSystem(np.diag([2.0, 1.0, 0.1, 0.2]), damping, k, tuple(stops), absorber=2)


def test_two_sinks_and_a_wall_that_is_not_theirs():
    """Each spring once: between roof and sinks 0.2 and 0.5, between the sinks 0.4. The wall beside the floor is the LO's."""
    shared = sharing_of(chain(), (2, 3), (0, 1))
    rng = np.random.default_rng(2)
    u, v = rng.normal(size=(2, 4))
    springs = 0.2 * (u[2] - u[1]) ** 2 + 0.5 * (u[3] - u[1]) ** 2 + 0.4 * (u[2] - u[3]) ** 2
    assert u @ shared.stiffness @ u == pytest.approx(springs, rel=1e-13)
    assert v @ shared.mass @ v == pytest.approx(0.1 * v[2] ** 2 + 0.2 * v[3] ** 2, rel=1e-14)
    assert shared.nes_parts == {"gaps", "stop a", "stop b"}
    np.testing.assert_allclose(shared.dampers["gaps"][2], [0.0, -0.3, 0.3, 0.0], atol=1e-15)
    np.testing.assert_allclose(shared.dampers["rest"], 0.1 * np.diag([1.0, 0.0, 0.0, 0.0]), atol=1e-15)
    motion = simulate(chain(), np.zeros(4), [0.0, 4.0, 0.0, 0.0], 30.0, dampers=shared.dampers)
    nes, lo = shared.totals(motion.dissipated)
    assert motion.dissipated["stop c"] > 0.0
    assert lo == pytest.approx(motion.dissipated["rest"] + motion.dissipated["stop c"], rel=1e-15)
    assert nes + lo + motion.energy == pytest.approx(motion.initial_energy, rel=1e-12)


def test_one_oscillator_named_keeps_the_springs_to_others():
    """One LO coordinate: of the springs of a sink, that between the two alone is the NES's."""
    shared = sharing_of(chain(), (3,), (1,))
    u = np.array([0.0, 0.3, 2.0, 1.0])
    assert u @ shared.stiffness @ u == pytest.approx(0.5 * 0.7**2, rel=1e-14)


def test_without_marks_the_gaps_are_still_distinguished():
    shared = sharing_of(chain())
    assert shared.mass is None and not shared.sink and shared.nes_parts == {"gaps", "stop a", "stop b", "stop c"}
    motion = simulate(chain(), np.zeros(4), [0.0, 1.0, 0.0, 0.0], 3.0, dampers=shared.dampers)
    whole, nes, lo = shared.energies(motion, TIMES[:5] / 100.0)
    assert np.isfinite(whole).all() and np.isnan(nes).all() and np.isnan(lo).all()


def test_a_mass_matrix_that_couples_the_sink_has_no_shares():
    """A coordinate relative to its carrier: kinetic energy has no share of its own."""
    system = ImpactSystem([[0.1, 0.1], [0.1, 1.1]], np.zeros((2, 2)), np.diag([0.1, 1.0]), (Stop((1.0, 0.0), -1.0, 1.0),))
    assert sharing_of(system, (0,), (1,)).mass is None and sharing_of(system, (0,), (1,)).sink


def test_the_reference_system_is_one_oscillator():
    """(1 + mu) u'' + u = 0."""
    system, _ = lock(vibro_impact_nes(0.21, 0.3), (0,))
    motion = simulate(system, [0.0], [2.0], 50.0)
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
    expected, _ = simulate(replace(free, stiffness=stiff), u, v, 4.0).sample(times)
    found, _ = simulate(locked, u[:2], v[:2], 4.0).sample(times)
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
