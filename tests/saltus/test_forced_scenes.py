"""The shipped scenes with a harmonic load, simulated. Oracles: closed forms of their periodic motions, of grazing and of release."""

import math

import numpy as np
import pytest
import scipy.linalg

from bvp.forcing import Constant, Harmonic
from bvp.motion import EventKind
from bvp.simulate import simulate
from saltus import load_scene
from tests.units import CHANGES, require_same_family, require_same_response

FORCED = (
    "impact_oscillator", "damped_impact_oscillator", "oscillator_at_wall", "bouncing_ball", "impact_pair", "absorber",
    "forced_impact_damper", "rattling_gear_pair", "forced_chain", "ueda_oscillator",
)  # fmt: skip


def settled(scene, u, v, periods, count):
    """The intervals, over the period of the load, and the speeds of the last impacts of a motion."""
    period = 2 * math.pi / scene.parameters["w"]
    motion = simulate(scene.system, u, v, periods * period, forces=scene.forces)
    impacts = motion.kinds == EventKind.IMPACT.value
    return np.diff(motion.times[impacts][-count - 1 :]) / period, motion.speeds[impacts][-count:]


def response(scene):
    """The complex amplitudes of the coordinates without stops: u = Re(amplitudes exp(i w t)) + the static displacement, if any."""
    layout, entries = scene.parametric.layout, scene.parametric.entries()
    n = layout.degrees_of_freedom
    mass, damping, stiffness = (entries[getattr(layout, name)].reshape(n, n) for name in ("mass", "damping", "stiffness"))
    (w,) = entries[layout.frequency]
    load = entries[layout.cosine] - 1j * entries[layout.sine]
    return np.linalg.solve(stiffness - w * w * mass + 1j * w * damping, load), np.linalg.solve(stiffness, entries[layout.constant])


def one_impact(w, r, s):
    """Speeds v- of x'' + x = cos(w t), x <= s, with one impact a period: both roots of the quadratic."""
    period = 2 * math.pi / w
    gamma, c, big = 1 / (1 - w * w), (1 + r) * math.sin(period) / (1 - math.cos(period)), (1 - r) / w
    return np.roots([(c * c + big * big) / 4, c * s, s * s - gamma * gamma])


def test_one_impact_a_period_of_the_harmonic_impact_oscillator():
    """Oracle: the closed form, started 1e-6 beside its upper root. Between the fold at s = -1.78 and the period doubling at s = -0.0686 the
    motion returns to it, past the period doubling it leaves it."""
    w, r = 2.8, 0.8
    period, gamma = 2 * math.pi / w, 1 / (1 - w * w)
    for s in (-1.7, -0.5, -0.08, -0.06):
        scene, speed = load_scene("impact_oscillator", s=s), one_impact(w, r, s).real.max()
        # x = gamma cos(w t + phase) + a cos t + b sin t from just after an impact on
        b = -(1 + r) * speed / 2
        a = b * math.sin(period) / (1 - math.cos(period))
        phase = math.atan2((b + r * speed) / (w * gamma), (s - a) / gamma)
        late = _later(scene, np.exp(1j * phase))
        motion = simulate(scene.system, [s], [-r * speed * (1 + 1e-6)], 2000 * period, forces=late, leaving="+")
        impacts = motion.kinds == EventKind.IMPACT.value
        intervals, speeds = np.diff(motion.times[impacts][-6:]) / period, motion.speeds[impacts][-5:]
        if s < -0.0685756522788391:
            np.testing.assert_allclose(intervals, 1.0, atol=1e-11)
            np.testing.assert_allclose(speeds, speed, rtol=1e-11)
        else:
            assert abs(intervals - 1.0).min() > 1e-3
    assert one_impact(w, r, 0.0).max() == pytest.approx(0.3361772699757, rel=1e-12)  # published


GRAZING = [
    ("damped_impact_oscillator", "A", 0.1),
    ("oscillator_at_wall", "A", math.hypot(1 - 0.8**2, 0.2 * 0.8)),
    ("absorber", "F", None),
    ("forced_chain", "F", None),
]


@pytest.mark.parametrize(("name", "amplitude", "closed"), GRAZING)
def test_a_response_without_impacts_ends_where_it_grazes(name, amplitude, closed):
    """Oracle: the amplitude at which the linear response meets a stop; in one degree of freedom d sqrt((k - w^2)^2 + c^2 w^2). On the
    response, a motion has no impact 1e-6 below it, and an impact in the first period 1e-6 above it."""
    for w in (load_scene(name).parameters["w"], 1.3):
        scene = load_scene(name, w=w)
        amplitudes, static = response(scene)
        ratios = []
        for stop in scene.system.stops:
            gap, middle = abs(np.dot(stop.gap, amplitudes)), np.dot(stop.gap, static)
            ratios.append(min(stop.upper - middle, middle - stop.lower) / gap)
        grazing = scene.parameters[amplitude] * min(ratios)
        if closed is not None and w == load_scene(name).parameters["w"]:
            assert grazing == pytest.approx(closed, rel=1e-14)
        for change in (-1e-6, 1e-6):
            near = load_scene(name, w=w, **{amplitude: grazing * (1 + change)})
            amplitudes, static = response(near)
            # A quarter of a period after the largest gap; no stop is touched there.
            turn = np.exp(1j * (0.5 * np.pi - np.angle(np.dot(scene.system.stops[int(np.argmin(ratios))].gap, amplitudes))))
            late = _later(near, turn)
            u, v = (amplitudes * turn).real + static, (1j * w * amplitudes * turn).real
            motion = simulate(near.system, u, v, 2.2 * math.pi / w, forces=late)
            assert (motion.impacts > 0) == (change > 0), (w, change)


def _later(scene, turn):
    """The loads of a scene from the phase of a complex number on."""
    layout, entries = scene.parametric.layout, scene.parametric.entries()
    load = (entries[layout.cosine] - 1j * entries[layout.sine]) * turn
    return [Harmonic(entries[layout.frequency][0], load.real, -load.imag), Constant(entries[layout.constant])]


@pytest.mark.parametrize("e", [0.5])
@pytest.mark.parametrize("n", [1, 2])
def test_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling(e, n):
    """Oracle: see `require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling`."""
    require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling(e, n)


def require_the_ball_bounces_once_in_n_periods_between_fold_and_period_doubling(e, n):
    """Oracle: the ball leaves and lands at the same height after T = 2 pi n/w, so v- = g T/(1 + e); it exists above
    Gamma = n pi (1 - e)/(1 + e), and is stable up to sqrt(that^2 + (2 (1 + e^2)/(1 + e)^2)^2)."""
    fold = n * math.pi * (1 - e) / (1 + e)
    doubling = math.hypot(fold, 2 * (1 + e * e) / (1 + e) ** 2)
    for gamma, holds in ((0.5 * (fold + doubling), True), (1.03 * doubling, False)):
        scene = load_scene("bouncing_ball", Gamma=gamma, e=e)
        # The start is just after the impact, on the closed form: the table's speed A w cos(w t) is g T/2 (1 - e)/(1 + e).
        speed = 2 * math.pi * n / (1 + e)
        phase = math.acos(fold / gamma)
        late = _later(scene, np.exp(1j * phase))
        motion = simulate(scene.system, [0.0], [e * speed * (1 + 1e-4)], 800 * n * math.pi, forces=late, leaving="-")
        impacts = motion.kinds == EventKind.IMPACT.value
        intervals, speeds = np.diff(motion.times[impacts][-6:]) / (2 * math.pi), motion.speeds[impacts][-5:]
        if holds:
            np.testing.assert_allclose(intervals, n, atol=1e-10)
            np.testing.assert_allclose(speeds, speed, rtol=1e-10)
        else:
            assert abs(intervals - n).max() > 1e-2


def test_two_impacts_a_period_of_the_impact_pair():
    """Oracle: between the walls the mass flies half a period at a speed V, V = 2 w (s + d)/pi with the frame at s and at the speed
    -V (1 - e)/(1 + e): a quadratic for V. The speed of the impact is 2 V/(1 + e)."""
    scene = load_scene("impact_pair")
    a, w, d, e = (scene.parameters[name] for name in ("A", "w", "d", "e"))
    q = (1 - e) / (1 + e)
    # (pi V/(2 w) - d)^2 + (q V/w)^2 = A^2
    speeds = np.roots([(math.pi / (2 * w)) ** 2 + (q / w) ** 2, -math.pi * d / w, d * d - a * a])
    intervals, found = settled(scene, [0.0], [0.5], 2000, 6)
    np.testing.assert_allclose(intervals, 0.5, atol=1e-12)
    np.testing.assert_allclose(found, 2 * speeds.max() / (1 + e), rtol=1e-12)


def test_two_impacts_a_period_of_the_forced_impact_damper():
    """Oracle: over half a period the loose mass flies at a speed V. The oscillator is its forced response and the response to kicks 2 mu V,
    whose sign changes from one half period to the next. Together they satisfy cos^2 + sin^2 = 1: a quadratic for V."""
    scene = load_scene("forced_impact_damper")
    mu, c, e, w = (scene.parameters[name] for name in ("mu", "c", "e", "w"))
    amplitude = scene.parameters["F"] / abs(1 - w * w + 1j * c * w)
    half = scipy.linalg.expm(np.array([[0.0, 1.0], [-1.0, -c]]) * math.pi / w)
    # z after a kick (0, 2 mu) of V = 1; half z = -(z - kick)
    after = np.linalg.solve(half + np.eye(2), [0.0, 2 * mu])
    position, before = after[0], after[1] - 2 * mu
    # At the impact x = amplitude cos + V position = pi V/(2 w) - 1, x' = -amplitude w sin + V before = -V (1 - e + 2 mu)/(1 + e).
    ratio = (1 - e + 2 * mu) / (1 + e)
    along, across = math.pi / (2 * w) - position, (before + ratio) / w
    speeds = np.roots([along**2 + across**2, -2 * along, 1 - amplitude**2])
    intervals, found = settled(scene, [0.0, 0.0], [0.0, 0.3], 3000, 6)
    np.testing.assert_allclose(intervals, 0.5, atol=1e-11)
    np.testing.assert_allclose(found, speeds.max() * (1 + ratio), rtol=1e-10)


def test_the_loose_gear_leaves_its_flank_where_the_error_exceeds_the_drag():
    """Oracle: on a flank, the contact force is delta Omega - epsilon w sqrt(w^2 + delta^2) cos(w t - phase)."""
    names = ("delta", "Omega", "w")
    delta, speed, w = (load_scene("rattling_gear_pair").parameters[name] for name in names)
    limit = delta * speed / (w * math.hypot(w, delta))
    for epsilon, leaves in ((0.999 * limit, False), (1.001 * limit, True)):
        scene = load_scene("rattling_gear_pair", epsilon=epsilon)
        motion = simulate(scene.system, [-1.0], [0.0], 100.0, forces=scene.forces)
        released = motion.times[motion.kinds == EventKind.RELEASE.value]
        if leaves:
            # cos(w t - phase) = limit/epsilon for the first time; tan(phase) = delta/w.
            first = (math.atan2(delta, w) - math.acos(limit / epsilon)) / w
            assert released[0] == pytest.approx(first, rel=1e-10)
            assert motion.impacts > 0
        else:
            assert len(released) == 0 and motion.impacts == 0


@pytest.mark.parametrize("name", FORCED)
def test_each_has_exact_derivatives_by_its_parameters(name):
    """Oracle: every parameter moves an entry, and a step of it moves the entries by the derivative, to second order."""
    parametric = load_scene(name).parametric
    for parameter, value in parametric.values.items():
        slope = parametric.derivatives(None, [parameter])[:, 0]
        assert np.any(slope)
        step = 1e-4 * max(abs(value), 0.1)
        ends = [parametric.entries({parameter: value + sign * step}) for sign in (-1, 1)]
        finite = np.isfinite(ends[0])
        np.testing.assert_allclose((ends[1][finite] - ends[0][finite]) / (2 * step), slope[finite], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("oscillator_at_wall", CHANGES[0]),
        ("impact_oscillator", CHANGES[3]),
        ("forced_impact_damper", CHANGES[0]),
        ("rattling_gear_pair", CHANGES[1]),
    ],
)
def test_a_response_does_not_depend_on_units(tmp_path, name, units):
    """Oracle: the same response in the units of the scene."""
    require_same_response(name, units, tmp_path)


@pytest.mark.parametrize(
    ("name", "start", "energies", "units"),
    [
        ("lee2009", "S13O00+", (0.2, 2.0), CHANGES[2]),
        ("cubic_and_stops", "S11-", (0.1, 1.0), CHANGES[0]),
        ("three_mass_chain", "mode:2", (0.3, 3.0), CHANGES[3]),
        ("duffing_pair", "mode:2", (0.1, 1.0), CHANGES[3]),
    ],
)
def test_a_family_does_not_depend_on_units(tmp_path, name, start, energies, units):
    """Oracle: the same family in the units of the scene. Once an SB, an SN and an end were missing here, and one took minutes."""
    require_same_family(name, start, energies, units, tmp_path)
