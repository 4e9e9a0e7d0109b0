"""Motions of the compiled core. Oracles: the kernels of smooth systems, event by event; closed forms; the balance of energies.

Impacts magnify what they start from: motions are compared over times in which rounding does not grow to what is asked."""

import numpy as np
import pytest

from bvp.forcing import Constant, Harmonic, Record
from bvp.motion import MotionStatus
from bvp.simulate import Simulator, simulate
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp.twins import chain
from tests.lab.motions import KernelSimulator

BALL = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=0.5)])
FALL = Constant([-1.0])


def two_stops(rho, damping):
    stiffness = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    stops = [Stop((1.0, -1.0, 0.0), -0.3, 0.3, rho), Stop((0.0, 0.0, 1.0), -0.5, 0.5, rho)]
    return ImpactSystem(np.eye(3), damping * np.eye(3), stiffness, stops)


CASES = {
    **{f"nes {lam} {rho}": (vibro_impact_nes(lam=lam, rho=rho), [0.0, 0.0], [0.0, 2.0], None, 12.0)
       for lam in (0.0, 0.01, 0.5, 5.0) for rho in (0.0, 0.2, 0.7, 1.0)},
    "free sink": (vibro_impact_nes(sigma=0.0, lam=0.02, rho=0.6), [0.0, 0.0], [0.0, 2.0], None, 12.0),
    "bouncing ball": (BALL, [0.5], [0.3], [FALL], 6.0),
    "shaken ball": (BALL, [0.5], [0.0], [FALL, Harmonic(0.7, [1.4])], 20.0),
    "ball on a record": (BALL, [0.5], [0.0], [FALL, Record([1.0], [0.0, 1.0, 2.5, 4.0, 9.0], [0.0, 1.5, 0.5, 2.0, 0.0])], 12.0),
    **{f"two stops {rho} {c}": (two_stops(rho, c), [0.1, 0.0, 0.2], [1.0, -0.4, 0.7], None, 12.0)
       for rho in (0.0, 0.3, 0.8, 1.0) for c in (0.0, 0.05)},
    "pressed stops": (two_stops(0.4, 0.1), [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [Constant([0.8, -0.2, 1.5])], 30.0),
    "chain": (chain([0.2, 1.0, 0.7, 1.3], [0.5, 2.0, 1.0], 0.7, 0.05), [0.0] * 4, [1.0, 0.3, -1.2, 0.4], None, 10.0),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_the_motion_is_that_of_the_kernels(case):
    """Oracle: the kernels. Peaks of both are those of the same search; the states at all times, too."""
    system, u, v, forces, duration = CASES[case]
    ours, theirs = (kind(system, forces).run(u, v, duration) for kind in (Simulator, KernelSimulator))
    assert ours.status is theirs.status and (ours.impacts, ours.touches) == (theirs.impacts, theirs.touches)
    assert np.array_equal(ours.kinds, theirs.kinds) and np.array_equal(ours.contacts, theirs.contacts)
    for name in ("times", "speeds", "losses", "before", "states", "sums", "final", "totals", "sticking_time", "energy"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-9, atol=1e-9, err_msg=name)
    for one, other in zip(ours.marks, theirs.marks, strict=True):
        assert (one.time is None) == (other.time is None)
        if one.time is not None:
            assert one.time == pytest.approx(other.time, abs=1e-7)
    incoming = max(ours.turnover, 1e-300)
    assert abs(ours.balance) < 1e-12 * incoming and (ours.clear_from is None) == (theirs.clear_from is None)


def test_a_ball_between_two_walls():
    """Oracle: uniform motion: one impact in each unit of time, exactly."""
    free = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), 0.0, 1.0)])
    motion = simulate(free, [0.5], [1.0], 100.0)
    assert np.array_equal(motion.stop_events.times, 0.5 + np.arange(100)) and motion.energy == 0.5


@pytest.mark.parametrize("rho", [0.1, 0.5, 0.9])
def test_a_bouncing_ball_comes_to_rest(rho):
    """Oracle: geometric series: it falls for 1, bounces at rho, rho^2, .. and rests at 1 + 2 rho/(1 - rho)."""
    ball = ImpactSystem([[1.0]], [[0.0]], [[0.0]], [Stop((1.0,), lower=0.0, restitution=rho)])
    motion = simulate(ball, [0.5], [0.0], 30.0, forces=FALL)
    rest = 1.0 + 2.0 * rho / (1.0 - rho)
    assert motion.contact_intervals[1].begin == pytest.approx(rest, abs=1e-12)
    assert motion.dissipated["stop a"] == pytest.approx(0.5, abs=1e-13) and motion.energy < 1e-25
    counts = np.arange(min(motion.impacts, 6))
    assert motion.stop_events.times[: len(counts)] == pytest.approx(1.0 + 2.0 * rho * (1.0 - rho**counts) / (1.0 - rho), abs=1e-12)


@pytest.mark.parametrize("damping", [0.05, 2.0, 5.0])
def test_what_a_damper_takes(damping):
    """Oracle: an oscillator below, at and above critical damping: the energy that is left in closed form."""
    system = ImpactSystem([[1.0]], [[damping]], [[1.0]], [Stop((1.0,), -50.0, 50.0)])
    motion = simulate(system, [1.0], [0.5], 7.0)
    assert motion.status is MotionStatus.DURATION_REACHED and abs(motion.balance) < 1e-14
    roots = np.roots([1.0, damping, 1.0])
    if damping == 2.0:
        u, v = (1.0 + 1.5 * 7.0) * np.exp(-7.0), (0.5 - 1.5 * 7.0) * np.exp(-7.0)
    else:
        factors = np.linalg.solve(np.array([[1.0, 1.0], roots]), [1.0, 0.5])
        u, v = (factors * np.exp(7.0 * roots)).sum().real, (factors * roots * np.exp(7.0 * roots)).sum().real
    assert motion.totals[:2].sum() == pytest.approx(0.625 - 0.5 * (u * u + v * v), rel=1e-13)
    assert motion.final == pytest.approx([u, v], rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("damping", [0.0, 0.03])
def test_a_number_of_pairs_that_is_compiled(count, damping):
    """Oracle: the same system beside four slow oscillators at rest, which is computed for any number of pairs."""
    rng = np.random.default_rng(count)
    stiffness = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    stop, rest = (1.0,) + (0.0,) * (count - 1), (0.0,) * 4
    # A damper at the last mass couples the modes.
    dampers = damping * np.diag([*[0.25] * (count - 1), 1.0])
    alone = ImpactSystem(np.eye(count), dampers, stiffness, [Stop(stop, -0.5, 0.5, 0.9)])
    slow, pad = np.diag([0.01, 0.02, 0.03, 0.04]), np.zeros((count, 4))
    beside = ImpactSystem(
        np.eye(count + 4), np.block([[dampers, pad], [pad.T, 0.0 * slow]]), np.block([[stiffness, pad], [pad.T, slow]]),
        [Stop((*stop, *rest), -0.5, 0.5, 0.9)],
    )  # fmt: skip
    starts = np.hstack([np.zeros((5, count)), rng.normal(size=(5, count))])
    wide = np.hstack([starts[:, :count], np.zeros((5, 4)), starts[:, count:], np.zeros((5, 4))])
    one, other = (Simulator(kind).run_many(z, 12.0, marks=(0.1, 0.3), with_peaks=True) for kind, z in [(alone, starts), (beside, wide)])
    assert one.impacts.sum() > 5 and np.array_equal(one.impacts, other.impacts)
    close = {"rtol": 1e-9, "atol": 1e-10}
    np.testing.assert_allclose(one.final, other.final[:, [*range(count), *range(count + 4, 2 * count + 4)]], **close)
    np.testing.assert_allclose(one.peaks, other.peaks[:, :count], **close)
    np.testing.assert_allclose(one.totals, other.totals, **close)
    np.testing.assert_allclose(one.marks, other.marks, **close)
