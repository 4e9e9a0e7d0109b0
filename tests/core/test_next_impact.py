"""The next impact of the compiled core. Oracle: the search of `bvp.kernels.impact`: the same outcome and contact, times equal to rounding.

Starts are at random, after bounces, at slow speeds on a stop, just released, and at turning points beside the bound. Of a near grazing
rounding of w over the speed is the error of a time."""

import numpy as np
import pytest
import saltus_core as core

from bvp.kernels import impact as kernels
from bvp.kernels.flight import flow_state
from tests.bvp.test_impact import oscillator, random_system
from tests.bvp.test_modes import exceptional_point
from tests.bvp.twins import chain
from tests.core.systems import core_of

HIT, TOUCH = 1, 2
SPEEDS = (1e-3, 1e-6, 1e-9, 1e-12, 0.0)
DEPTHS = (0.0, 1e-6, -1e-6, 1e-11, -1e-11, 1e-13, -1e-13)


class Searches:
    """The searches of both, for one system."""

    def __init__(self, system):
        self.modes = system.modes
        self.flight, self.contacts = core_of(self.modes)

    def after(self, z, time):
        """The state after a free flight."""
        out = np.empty_like(z)
        flow_state(self.modes.flight, z, time, out)
        return out

    def compare(self, z, horizon, leaving):
        """What the kernel finds, which the core finds, too. leaving: as in the kernel."""
        contacts = self.modes.contacts
        work = kernels.work_array(len(z), len(contacts.side))
        status, c, time = kernels.next_impact(self.modes.flight, contacts, leaving, z, horizon, work)
        given = leaving if leaving >= -1 else -2 - leaving
        for certified in (True, False):
            found = core.next_impact(self.flight, self.contacts, given, leaving < -1, z, horizon, certified)
            assert found[:2] == (status, c)
            error = abs(found[2] - time)
            if error > 1e-12 * time:
                end = self.after(z, time)
                size = abs(contacts.bound[c]) + np.abs(contacts.gap[c] * end).sum()
                assert status == TOUCH or error * abs(contacts.rate[c] @ end) <= 1e-12 * size
        return status, c, time


def systems():
    """Systems without and with damping, one that grows, free bodies, coalescing pairs."""
    rng = np.random.default_rng(7)
    yield from (random_system(rng, n, damping, shift) for n in (1, 2, 3, 6) for damping in (0.0, 0.01, 5.0) for shift in (0.0, 0.5))
    for n in (2, 3, 7):
        yield from (chain(rng.uniform(0.2, 2.0, n), rng.uniform(0.5, 4.0, n - 1), 0.7, damping) for damping in (0.0, 0.05, 1.0))
    yield from (oscillator(upper=bound, k=k, c=c) for bound in (0.5, -0.5, 0.0) for k in (-1.0, 0.0, 1.0) for c in (0.0, 0.5, 2.0, -0.3))
    yield exceptional_point()


@pytest.mark.parametrize("system", list(systems()))
def test_the_next_impact_is_that_of_the_kernel(system):
    rng = np.random.default_rng(1)
    both = Searches(system)
    modes, contacts, n = both.modes, both.modes.contacts, system.degrees_of_freedom
    for trial in range(8):
        u, v = rng.choice([0.0, 0.1, 0.5]) * rng.normal(size=n), rng.choice([0.1, 1.0, 5.0]) * rng.normal(size=n)
        z, leaving, horizon = modes.from_state @ np.concatenate([u, v]), -1, float(rng.choice([3.0, 10.0, 60.0]))
        for bounce in range(6):
            status, c, time = both.compare(z, horizon, leaving)
            if status not in (HIT, TOUCH):
                break
            z, leaving = both.after(z, time), int(c)
            at_rest = z - (contacts.rate[c] @ z) * contacts.push[c]
            if status == HIT:
                z -= (1.0 + (0.6, 1.0)[trial % 2]) * contacts.push[c] * (contacts.rate[c] @ z)
                both.compare(z, horizon, -1)
            if bounce == 0:
                for speed in SPEEDS:
                    both.compare(at_rest - contacts.side[c] * speed * contacts.push[c], horizon, leaving)
                both.compare(at_rest, horizon, -2 - leaving)
        c = int(rng.integers(len(contacts.side)))
        gap = contacts.gap[c]
        z = modes.from_state @ rng.normal(size=2 * n)
        for depth in DEPTHS:
            turning = z + gap / (gap @ gap) * (contacts.bound[c] * (1.0 + depth) - gap @ z)
            turning -= (contacts.rate[c] @ turning) * contacts.push[c]
            both.compare(both.after(turning, -float(rng.uniform(0.05, 0.6))), 2.0, -1)


@pytest.mark.parametrize(("leaving", "size"), [(2, 2), (-2, 2), (-1, 3)])
def test_sizes_are_checked_at_the_border(leaving, size):
    both = Searches(oscillator(-1.0, 1.0))
    with pytest.raises(ValueError):
        core.next_impact(both.flight, both.contacts, leaving, False, np.zeros(size), 1.0)
