"""Long motions against what is known of them. Oracles: periodicity, Floquet multipliers, the slow invariant manifold of the
free-flying sink.

That elastic undamped motion keeps its energy over 100,000 impacts, to 1e-10 of it, is in tests/bvp/test_damped.py."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bvp.forcing import Harmonic
from bvp.motion import EventKind
from bvp.simulate import simulate
from bvp.system import vibro_impact_nes
from tests.branches.paper_names import NAMES, SYSTEM, orbit_of

STABLE = [name for name, (*_, stable) in NAMES.items() if stable]


def away(orbit, velocities, periods):
    """Distance from the orbit's start after each period, of a motion that starts with these velocities: (periods + 1,), over sqrt(2 h)."""
    motion = simulate(SYSTEM, [0.0, 0.0], velocities, (periods + 0.5) * orbit.period)
    u, v = motion.sample(orbit.period * np.arange(periods + 1))
    return np.linalg.norm(np.hstack([u, v - orbit.velocities]), axis=1) / math.sqrt(2.0 * orbit.h)


@pytest.mark.parametrize("name", STABLE[::3])
def test_a_stable_orbit_stays_on_itself_for_a_hundred_periods(name):
    """Oracle: see `require_a_stable_orbit_stays_on_itself_for_a_hundred_periods`."""
    require_a_stable_orbit_stays_on_itself_for_a_hundred_periods(name)


def require_a_stable_orbit_stays_on_itself_for_a_hundred_periods(name):
    """Oracle: periodicity, to 1e-8 times the number of periods."""
    orbit = orbit_of(name)
    far = away(orbit, orbit.velocities, 100)
    assert orbit.stable
    assert (far[1:] <= 1e-8 * np.arange(1, 101)).all()


@pytest.mark.parametrize("name", ["U11+", "U8353-", "U4421+", "S73E33-"])
def test_an_unstable_orbit_is_left_at_its_floquet_rate(name):
    """Oracle: the largest multiplier. The distance grows from 1e-11 at the start; the line is fitted to its logarithm from 1e-9
    to 1e-4, where the motion has turned into the unstable direction and is still linear."""
    orbit = orbit_of(name)
    far = away(orbit, orbit.velocities + [0.0, 1e-11 * math.sqrt(2.0 * orbit.h)], 120)
    periods = np.arange(len(far))
    linear = (far > 1e-9) & (far < 1e-4) & (periods < np.argmax(far > 1e-4))
    assert linear.sum() >= 2 and not orbit.stable
    rate = np.polyfit(periods[linear], np.log(far[linear]), 1)[0]
    assert rate == pytest.approx(math.log(max(abs(orbit.multipliers))), rel=0.02)


def steady(mu, rho, force):
    """The free-flying sink at resonance, u2'' + mu u2' + u2 = mu force cos(t), after 60/mu: A, C, impacts a period, spread of C.

    A is the amplitude of the first harmonic of u2, C the mean of |u1| at the impacts, over the last 20 periods."""
    system = vibro_impact_nes(mu, 0.0, mu, rho)
    period, count = 2.0 * math.pi, 20
    end = period * round(60.0 / mu / period)
    motion = simulate(system, [0.5, 0.0], [1.0, 0.5], end, forces=Harmonic(1.0, cosine=[0.0, mu * force]))
    begin = end - count * period
    hits = motion.before[(motion.times > begin) & (motion.kinds == EventKind.IMPACT.value), 0]
    times = begin + period * count * np.arange(10_000) / 10_000
    u, _ = motion.sample(times)
    amplitude = 2.0 * abs(np.mean(u[:, 1] * np.exp(-1j * times)))
    return amplitude, float(np.abs(hits).mean()), len(hits) / count, float(np.ptp(np.abs(hits)))


def slope(rho):
    """r = (2/pi)(1 - rho)/(1 + rho): u2' = -r C at an impact, where the sink flies to and fro between +-C in half a period each."""
    return 2.0 / math.pi * (1.0 - rho) / (1.0 + rho)


@pytest.mark.parametrize(("rho", "force"), [(0.6, 1.0)])
def test_two_impacts_a_period_lie_on_the_slow_invariant_manifold(rho, force):
    """Oracle: see `require_two_impacts_a_period_lie_on_the_slow_invariant_manifold`."""
    require_two_impacts_a_period_lie_on_the_slow_invariant_manifold(rho, force)


def require_two_impacts_a_period_lie_on_the_slow_invariant_manifold(rho, force):
    """Oracle: A^2 = (C - 1)^2 + r^2 C^2 for mu -> 0; its error is of first order in mu, so it halves with mu."""
    errors = []
    for mu in (0.02, 0.01, 0.005):
        amplitude, contact, impacts, spread = steady(mu, rho, force)
        assert impacts == 2.0 and spread < 1e-10
        errors.append(math.hypot(contact - 1.0, slope(rho) * contact) / amplitude - 1.0)
    assert abs(errors[-1]) < 2.0 * 0.005
    np.testing.assert_allclose(np.divide(errors[1:], errors[:-1]), 0.5, atol=0.02)
