"""The next impact in steps of fixed length. Oracles: the certified search; dense samples; fifty digits."""

import mpmath as mp
import numpy as np
import pytest
import saltus_core as core
from hypothesis import given, settings
from hypothesis import strategies as st

import saltus
from bvp.kernels.flight import flow_state
from bvp.system import ImpactSystem, Stop
from tests.bvp.twins import chain
from tests.core.test_next_impact import Searches

NONE, HIT = 0, 1
HORIZON = 9.0


def one_sided():
    """A stop on one side, whose other bound is infinite."""
    return ImpactSystem(np.diag([0.4, 1.0]), np.zeros((2, 2)), [[0.9, -0.3], [-0.3, 1.3]], (Stop((1.0, -1.0), upper=0.7),))


SYSTEMS = [
    saltus.vibro_impact_nes(), saltus.vibro_impact_nes(0.37, 0.81), saltus.vibro_impact_nes(0.02, 3.0), one_sided(),
    saltus.vibro_impact_nes(0.37, 0.81, lam=0.1), chain([1.0, 0.7, 1.3, 0.4], [1.0, 2.0, 0.8], 0.5, 0.0),
]  # fmt: skip


def found_both_ways(system, z, contact, horizon=HORIZON):
    """(status, contact, time) in fixed steps, and by the certified search; the contact is -1 for none."""
    both = Searches(system)
    return tuple(core.next_impact(both.flight, both.contacts, contact, False, z, horizon, certified) for certified in (False, True))


def limits_of(system):
    return np.array([system.stops[0].lower, system.stops[0].upper], dtype=float)


def random_start(system, rng):
    """A state inside the stops, or leaving one of them, and the contact that it leaves."""
    contacts, n = system.modes.contacts, system.degrees_of_freedom
    gap, rate = contacts.gap[0], contacts.rate[0]
    z = rng.normal(size=2 * n) * 10.0 ** rng.uniform(-1.0, 2.0)
    contact = int(rng.integers(-1, len(contacts.side)))
    low, high = np.clip(limits_of(system), -3.0, 3.0)
    wanted = contacts.bound[contact] if contact >= 0 else rng.uniform(low + 1e-3, high - 1e-3)
    z += (wanted - gap @ z) / (gap @ gap) * gap
    if contact >= 0 and contacts.side[contact] * (rate @ z) > 0.0:
        z -= 2.0 * (rate @ z) * contacts.push[contact]
    return z, contact


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_an_impact_is_that_of_the_certified_search(seed):
    """Oracle: the certified search."""
    rng = np.random.default_rng(seed)
    for system in SYSTEMS:
        for _ in range(10):
            z, contact = random_start(system, rng)
            mine, general = found_both_ways(system, z, contact)
            assert mine[:2] == general[:2]
            if mine[0] == HIT:
                state = np.zeros_like(z)
                flow_state(system.modes.flight, z, mine[2], state)
                speed = abs(system.modes.contacts.rate[mine[1]] @ state)
                assert abs(mine[2] - general[2]) < 1e-14 * (1.0 + np.abs(z).max() / speed) + 1e-15 * mine[2]


@pytest.mark.parametrize("system", SYSTEMS[:4])
def test_no_earlier_impact_is_passed_over(system):
    """Oracle: the gap coordinate at dense samples, and the bound at the impact in fifty digits."""
    rng = np.random.default_rng(5)
    low, high = limits_of(system)
    gap, squares = system.modes.contacts.gap[0], system.modes.squares
    hits = 0
    for _ in range(100):
        z, contact = random_start(system, rng)
        (status, hit, time), _ = found_both_ways(system, z, contact)
        rates, t = np.sqrt(squares), np.linspace(0.0, time, 400)[1:-1, None]
        w = (np.cos(rates * t) * z[:2] + np.sin(rates * t) * z[2:] / rates) @ gap[:2]
        rounding = 1e-13 * (1.0 + np.abs(z).max())
        assert np.all(w < high + rounding) and np.all(w > low - rounding)
        if status == HIT:
            hits += 1
            with mp.workdps(50):
                terms = []
                for k in range(2):
                    rate = mp.sqrt(mp.mpf(float(squares[k])))
                    c, s = mp.cos_sin(rate * mp.mpf(time))
                    terms.append(mp.mpf(float(gap[k])) * (c * mp.mpf(float(z[k])) + s / rate * mp.mpf(float(z[k + 2]))))
                assert abs(float(sum(terms) - mp.mpf(float(system.modes.contacts.bound[hit])))) < rounding * (1.0 + time)
    assert hits > 33


@pytest.mark.parametrize("above", [-1e-9, 1e-9])
def test_what_nearly_grazes(above):
    """Oracle: the largest |w| of a motion, at dense samples refined by a parabola, scaled to the bound but for a part of 1e-9."""
    system = saltus.vibro_impact_nes()
    gap, rates = system.modes.contacts.gap[0], np.sqrt(system.modes.squares)
    z = np.array([0.2, 0.1, -0.4, 0.7])
    t = np.linspace(0.0, HORIZON, 200_001)[:, None]
    w = np.abs((np.cos(rates * t) * z[:2] + np.sin(rates * t) * z[2:] / rates) @ gap[:2])
    peak = int(np.argmax(w))
    assert 0 < peak < len(w) - 1
    largest = w[peak] + (w[peak + 1] - w[peak - 1]) ** 2 / (16.0 * w[peak] - 8.0 * (w[peak + 1] + w[peak - 1]))
    mine, general = found_both_ways(system, (1.0 + above) / largest * z, -1)
    assert mine == general and mine[0] == (HIT if above > 0.0 else NONE)


def test_motion_that_reaches_no_stop():
    """Oracle: amplitudes below the bound; and a horizon that ends before the impact."""
    system = saltus.vibro_impact_nes()
    gap = system.modes.contacts.gap[0]
    z = np.zeros(4)
    z[1] = 0.9 / gap[1]
    assert found_both_ways(system, z, -1)[0] == (NONE, -1, HORIZON)
    z[3] = 40.0
    (status, _, time), _ = found_both_ways(system, z, -1)
    assert status == HIT and found_both_ways(system, z, -1, 0.9 * time)[0] == (NONE, -1, 0.9 * time)
