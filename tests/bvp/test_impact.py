"""Next impact by bounds, and restitution. Oracles: dense sampling with Brent's method (twin), touches constructed exactly,
closed forms."""

import math
from itertools import accumulate

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from bvp.checks import EPSILON
from bvp.system import ImpactSystem, Stop, vibro_impact_nes
from tests.bvp import twins
from tests.bvp.test_modes import exceptional_point
from tests.bvp.twins import amplitude_samples, chain, distances, first_order, flow
from tests.lab.flights import LinearFlight
from tests.lab.limits import CONTACT_TOLERANCE
from tests.lab.paths import ImpactStatus, next_impact, restitute


def oscillator(lower=-math.inf, upper=math.inf, k=1.0, c=0.0, restitution=1.0):
    """u'' + c u' + k u = 0 between stops."""
    return ImpactSystem([[1.0]], [[c]], [[k]], (Stop((1.0,), lower, upper, restitution),))


def random_system(rng, n, damping, stiffness_shift=0.0):
    """Full matrices, a two-sided stop and a one-sided one."""
    half, root = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    stiffness = root @ root.T - stiffness_shift * np.eye(n)
    stops = (Stop(tuple(rng.normal(size=n)), -1.0, rng.uniform(0.5, 2.0)), Stop(tuple(rng.normal(size=n)), upper=rng.uniform(0.5, 2.0)))
    return ImpactSystem(np.diag(rng.uniform(0.2, 2.0, n)), damping * half @ half.T, stiffness, stops)


@settings(max_examples=30)
@given(st.integers(1, 4), st.integers(0, 2**31), st.sampled_from([0.0, 0.01, 0.3, 5.0]), st.sampled_from([0.0, 0.5]), st.floats(0.01, 5.0))
def test_amplitudes_bound_what_dense_sampling_finds(n, seed, damping, shift, horizon):
    rng = np.random.default_rng(seed)
    system = random_system(rng, n, damping, shift)
    modes, z = system.modes, rng.normal(size=2 * n)
    bounds = LinearFlight(system).amplitudes(modes.contacts.gap[0], z, horizon)
    for order, bound in zip((0, 2, 3), bounds, strict=True):
        samples = amplitude_samples(modes.matrix, modes.contacts.gap[0], z, horizon, order)
        assert samples.max() <= bound * (1.0 + 1e-9)


def test_amplitudes_of_a_larger_block_bound_what_dense_sampling_finds():
    system = exceptional_point()
    modes, z = system.modes, np.array([1.0, -0.3, 0.2, 0.7])
    bounds = LinearFlight(system).amplitudes(modes.contacts.gap[0], z, 10.0)
    for order, bound in zip((0, 2, 3), bounds, strict=True):
        assert amplitude_samples(modes.matrix, modes.contacts.gap[0], z, 10.0, order).max() <= bound


def test_amplitudes_of_one_mode_are_its_amplitude():
    """|u| <= hypot(u, v/w), |u''| <= w^2 of it, |u'''| <= w^3 of it: attained."""
    system = oscillator(upper=1.0, k=4.0)
    modes = system.modes
    size = math.hypot(0.3, 0.8 / 2.0)
    bounds = LinearFlight(system).amplitudes(modes.contacts.gap[0], modes.from_state @ [0.3, 0.8], math.inf)
    np.testing.assert_allclose(bounds, [size, 4 * size, 8 * size], rtol=1e-8)


@settings(max_examples=20)
@given(st.integers(1, 5), st.integers(0, 2**31), st.floats(0.0, 1.0))
def test_restitution_against_the_plain_twin(n, seed, restitution):
    """From M and c alone; momentum along directions that c does not see is kept, the rate of w is reversed, energy as
    formula."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    system = ImpactSystem(root @ root.T + np.eye(n), np.zeros((n, n)), np.eye(n), (Stop(tuple(rng.normal(size=n)), 0.0, 1.0, restitution),))
    v = rng.normal(size=n)
    after = restitute(system, "+", v)
    np.testing.assert_allclose(after, twins.restitute(system, 0, v), atol=1e-12 * np.linalg.cond(system.mass))
    c = np.array(system.stops[0].gap)
    assert c @ after == pytest.approx(-restitution * (c @ v), abs=1e-12)
    reduced = 1.0 / (c @ np.linalg.solve(system.mass, c))
    loss = 0.5 * (1.0 - restitution**2) * reduced * (c @ v) ** 2
    rest = np.zeros(n)
    assert system.energy(rest, v) - system.energy(rest, after) == pytest.approx(loss, abs=1e-11 * system.energy(rest, v) + 1e-14)


@pytest.mark.parametrize(("sign", "factor"), [(-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
def test_a_flipped_sign_in_restitution_is_seen(sign, factor):
    """Mutation: the comparison above fails with either sign of the twin turned."""
    system = vibro_impact_nes(rho=0.7)
    v = np.array([2.0, 0.4])
    assert np.abs(restitute(system, "+", v) - twins.restitute(system, 0, v, sign, factor)).max() > 0.1
    np.testing.assert_allclose(restitute(system, "+", v), twins.restitute(system, 0, v), rtol=1e-14)


@settings(max_examples=30)
@given(st.integers(1, 4), st.integers(0, 2**31), st.sampled_from([0.0, 0.02, 1.0, 8.0]), st.floats(0.1, 6.0))
def test_no_impact_is_missed_and_none_invented(n, seed, damping, speed):
    """The plain twin samples at steps of 0.01 and minimises between samples."""
    rng = np.random.default_rng(seed)
    system = random_system(rng, n, damping)
    u, v = np.zeros(n), speed * rng.normal(size=n)
    expected = twins.next_impact(system, u, v, 10.0, 0.01)
    found = next_impact(system, u, v, 10.0)
    if expected is None:
        assert found.status is ImpactStatus.NONE and found.time == 10.0
        return
    assert found.status is ImpactStatus.HIT
    assert found.contact == system.modes.contact_letters[expected[0]]
    assert found.speed >= 0.0
    assert abs(found.time - expected[1]) * max(found.speed, 1e-6) <= 1e-9 * (1.0 + speed)
    assert abs(distances(system, np.concatenate([found.u, found.v]))[expected[0]]) <= 1e-12 * (1.0 + np.abs(found.u).max())


@settings(max_examples=20)
@given(st.integers(0, 2**31), st.floats(0.0, 5.0), st.sampled_from([0.0, 0.05]))
def test_no_return_to_the_stop_just_left_is_missed(seed, speed, damping):
    """Starts on the stop, moving away or pulled back at once; the twin skips the first 1e-7."""
    rng = np.random.default_rng(seed)
    system = chain(rng.uniform(0.2, 2.0, 3), rng.uniform(0.5, 4.0, 2), rng.uniform(0.0, 1.0), damping)
    u = rng.normal(size=3)
    u[2] = u[0] - 1.0
    v = rng.normal(size=3)
    v[0] = v[2] - speed
    assume(speed > 1e-4)
    expected = twins.next_impact(system, u, v, 10.0, 0.01, 1e-7)
    found = next_impact(system, u, v, 10.0, leaving="+")
    if expected is None:
        assert found.status is ImpactStatus.NONE
        return
    assert found.status is ImpactStatus.HIT and found.contact == system.modes.contact_letters[expected[0]]
    assert abs(found.time - expected[1]) * max(found.speed, 1e-6) <= 1e-9 * (1.0 + speed)


GROWING = [oscillator(upper=1.0, k=-1.0), oscillator(upper=1.0, k=-1.0, c=0.5), oscillator(upper=1.0, k=0.2, c=-0.3)]
GROWING_STARTS = [([u], [v]) for u, v in ((0.0, 0.01), (-0.5, 1.0), (-0.5, 0.3), (0.9, -1.2), (0.5, -0.49))]
LARGER_STARTS = [([0.0, 0.0], v) for v in ([3.0, 0.0], [0.0, 2.5], [1.2, -1.3], [0.1, 0.1])]


@pytest.mark.parametrize(
    ("system", "starts", "horizon"), [*((system, GROWING_STARTS, 15.0) for system in GROWING), (exceptional_point(), LARGER_STARTS, 20.0)]
)
def test_growing_motion_and_a_larger_block(system, starts, horizon):
    """Against the twin: hyperbolic pairs, negative damping, a hyperbolic motion that turns before the stop, pairs that coalesce."""
    for u, v in starts:
        expected = twins.next_impact(system, np.array(u), np.array(v), horizon, 0.01)
        found = next_impact(system, u, v, horizon)
        assert (found.status is ImpactStatus.HIT) == (expected is not None)
        if expected is not None:
            assert found.time == pytest.approx(expected[1], rel=1e-9)


@settings(max_examples=25)
@given(
    st.integers(2, 4),
    st.integers(0, 2**31),
    st.sampled_from([(0.0, "TOUCH"), (1e-11, "HIT"), (1e-6, "HIT"), (-1e-11, "NONE"), (-1e-6, "NONE")]),
    st.sampled_from([0.0, 0.05, 2.0]),
    st.floats(0.05, 0.6),
)
@example(4, 1509, (0.0, "TOUCH"), 0.05, 0.5)
def test_grazing_of_random_systems(n, seed, case, damping, back):
    """A turning point of w at a chosen distance beyond the stop, made at time 0 and flown backwards; nothing else is
    reached. Where damping couples modes, w is a sum of larger terms: their rounding may make a touch a hit, or nothing."""
    depth, status = case
    rng = np.random.default_rng(seed)
    plain = random_system(rng, n, damping)
    row = rng.normal(size=n)
    row /= np.linalg.norm(row)
    system = ImpactSystem(plain.mass, plain.damping, plain.stiffness, (Stop(tuple(row), upper=1.0),))
    u, v = rng.normal(size=n), rng.normal(size=n)
    u += row * (1.0 + depth - row @ u)
    v -= row * (row @ v)
    bend = row @ (first_order(system) @ np.concatenate([u, v]))[n:]
    assume(bend < -0.3)
    early = flow(system, u, v, -back)
    times = np.linspace(-back, 0.05, 400)
    move = expm(first_order(system) * (times[1] - times[0]))
    path = np.array([row @ state[:n] for state in accumulate(times[1:], lambda state, _: move @ state, initial=early)])
    assume(np.all(path[times < -0.02] < 1.0 - 1e-5) and np.all(np.diff(path)[times[:-1] < -1e-3] > 0.0) and np.abs(early).max() < 50.0)
    found = next_impact(system, early[:n], early[n:], back + 0.04)
    # To the modes and back, where one map is the other's inverse to its own rounding.
    both = np.abs(system.modes.to_state) @ np.abs(system.modes.from_state)
    rounding = EPSILON * float(np.abs(row) @ (both @ both @ np.abs(early))[:n])
    assume(rounding < 0.1 * abs(depth) or depth == 0.0)
    if depth == 0.0 and rounding > CONTACT_TOLERANCE:
        if found.status is not ImpactStatus.NONE:
            assert found.time == pytest.approx(back, abs=math.sqrt(2.0 * rounding / -bend) + 1e-6)
        return
    assert found.status is ImpactStatus[status]
    if status == "TOUCH":
        assert found.time == pytest.approx(back, abs=1e-6)
    if status == "HIT":
        assert found.time == pytest.approx(back - math.sqrt(2 * depth / -bend), abs=2e-2 * math.sqrt(depth) + 1e-7)


def two_modes(bound):
    """Modes 1 and 2 with w = q1 + q2 and w <= bound."""
    return ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag([1.0, 4.0]), (Stop((1.0, 1.0), upper=bound),))


def test_a_touch_of_fourth_order_is_a_touch():
    """w = 4 cos t - cos 2t has w = 3, w' = w'' = w''' = 0 at t = 0 and 2 pi: found from t = 1."""
    start = [4 * math.cos(1.0), -math.cos(2.0)], [-4 * math.sin(1.0), 2 * math.sin(2.0)]
    touch = next_impact(two_modes(3.0), *start, 10.0)
    assert touch.status is ImpactStatus.TOUCH
    assert touch.time == pytest.approx(2 * math.pi - 1.0, abs=2e-3)  # w is within 1e-13 of 3 for 7e-4 around it
    assert next_impact(two_modes(3.0 + 1e-9), *start, 10.0).status is ImpactStatus.NONE
    hit = next_impact(two_modes(3.0 - 1e-9), *start, 10.0)
    assert hit.status is ImpactStatus.HIT
    assert hit.time == pytest.approx(2 * math.pi - 1.0 - (2e-9) ** 0.25, abs=1e-4)


def test_a_crossing_of_third_order_is_a_hit():
    """w = 2 sin t - sin 2t goes through 0 as t^3 at t = 0: found from t = -1, as well as rounding allows."""
    start = [2 * math.sin(-1.0), -math.sin(-2.0)], [2 * math.cos(-1.0), -2 * math.cos(-2.0)]
    hit = next_impact(two_modes(0.0), *start, 10.0)
    assert hit.status is ImpactStatus.HIT
    assert hit.time == pytest.approx(1.0, abs=2e-4)


@pytest.mark.parametrize("speed", [1.0, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-9, 1e-10, 1e-12, 1e-14])
def test_leaving_a_stop_at_any_speed(speed):
    """u'' = -u, left at `speed`. Pushed against u <= -1/2, it is back at t = 2 atan(2 speed) and at the same speed. Pulled away from
    u <= 1/2, it is back after the long way, at 2 pi less that time."""
    short = next_impact(oscillator(upper=-0.5), [-0.5], [-speed], 20.0, leaving="+")
    assert short.status is ImpactStatus.HIT and short.contact == "+"
    assert short.time == pytest.approx(2 * math.atan(2 * speed), rel=1e-13)
    assert short.speed == pytest.approx(speed, rel=1e-9 if speed > 1e-9 else 1.0)
    long = next_impact(oscillator(upper=0.5), [0.5], [-speed], 20.0, leaving="+")
    assert long.time == pytest.approx(2 * math.pi - 2 * math.atan(2 * speed), rel=1e-9 if speed > 1e-8 else 1e-7)


AT = math.asin(0.5)
INSIDE_TOLERANCE = 0.5 * (1 + 0.5 * CONTACT_TOLERANCE)


@pytest.mark.parametrize(
    ("system", "start", "horizon", "leaving", "status", "contact", "time", "speed"),
    [
        # At rest on a stop: pulled away, it touches again after 2 pi; pushed, it stays; a rigid body does neither.
        (oscillator(upper=0.5), (0.5, 0.0), 10.0, None, "TOUCH", "+", 2 * math.pi, 0.0),
        (oscillator(upper=-0.5), (-0.5, 0.0), 10.0, None, "PRESSED", "+", 0.0, 0.0),
        (oscillator(upper=-0.5), (-0.5, 0.0), 10.0, "+", "PRESSED", "+", 0.0, 0.0),
        (oscillator(upper=0.5, k=0.0), (0.5, 0.0), 10.0, None, "NONE", "", 10.0, 0.0),
        # On a stop, or beyond it by less than the tolerance, and moving.
        (oscillator(upper=0.5), (0.5, 1.0), 10.0, None, "HIT", "+", 0.0, 1.0),
        (oscillator(upper=0.5), (0.5, 1.0), 10.0, "+", "HIT", "+", 0.0, 1.0),
        (oscillator(-1.0, 0.5), (INSIDE_TOLERANCE, -1.0), 10.0, None, "HIT", "-", None, None),
        # Beyond a stop.
        (oscillator(-1.0, 0.5), (0.6, 0.0), 10.0, None, "OUTSIDE", "+", 0.0, 0.0),
        (oscillator(-1.0, 0.5), (-1.0 - 1e-9, 0.0), 10.0, None, "OUTSIDE", "-", 0.0, 0.0),
        # The speed side * w' is positive on approach to either side; u = v t.
        (oscillator(-1.0, 1.0), (0.0, 2.0), 10.0, None, "HIT", "+", AT, math.sqrt(3.0)),
        (oscillator(-1.0, 1.0), (0.0, -2.0), 10.0, None, "HIT", "-", AT, math.sqrt(3.0)),
        (oscillator(-1.0, 1.0, k=0.0), (0.25, 3.0), 10.0, None, "HIT", "+", 0.25, 3.0),
        # Just after the horizon, just before it, and a stop that cannot be reached in a million periods.
        (oscillator(upper=0.5), (0.0, 1.0), AT * (1 - 1e-12), None, "NONE", "", AT, None),
        (oscillator(upper=0.5), (0.0, 1.0), AT * (1 + 1e-12), None, "HIT", "+", AT, math.sqrt(0.75)),
        (oscillator(-1.0, 1.0), (0.0, 0.999), 1e7, None, "NONE", "", 1e7, None),
    ],
)
def test_starts_of_one_oscillator(system, start, horizon, leaving, status, contact, time, speed):
    """Oracle: closed forms."""
    found = next_impact(system, [start[0]], [start[1]], horizon, leaving)
    assert found.status is ImpactStatus[status] and found.contact == contact
    assert time is None or found.time == pytest.approx(time, rel=1e-9 if status == "TOUCH" else 1e-11, abs=1e-15)
    assert speed is None or found.speed == pytest.approx(speed, rel=1e-14, abs=1e-14)


def test_the_state_at_a_hit_is_on_the_stop():
    system = vibro_impact_nes()
    modes = system.modes
    rng = np.random.default_rng(8)
    hits = 0
    for _ in range(100):
        v = rng.normal(size=2) * 3
        found = next_impact(system, [0.0, 0.0], v, 100.0)
        if found.status is ImpactStatus.HIT:
            hits += 1
            out = LinearFlight(system).end(modes.from_state @ np.array([0.0, 0.0, *v]), found.time)
            assert abs(abs(modes.contacts.gap[0] @ out) - 1.0) <= 2e-15 * (1.0 + np.abs(modes.contacts.gap[0] * out).sum())
    assert hits > 90
