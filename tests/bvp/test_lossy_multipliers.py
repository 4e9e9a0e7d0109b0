"""Multipliers of orbits that lose energy at lossy (restitution 0.7) and plastic (restitution 0) impacts.

Oracle: the closed form of the orbits of a damped system with one impact a period, or a half period, in 50 digits, and powers of its
multipliers where the orbit is run round several times. Some dampers give energy, so that there are orbits.
"""

from itertools import islice

import mpmath as mp
import numpy as np
import pytest

from bvp.closures import Cycle
from bvp.multipliers import floquet_multipliers, saddle_point_multipliers
from bvp.system import ImpactSystem, Stop

DIGITS = 50
EPS = np.finfo(float).eps


class Lossy:
    """Orbits of M u'' + C u' + K u = 0 that hit the stop c . u = 1 from one side, at one impact a period, or at c . u = +-1 in turn, at
    one a half period. They are not asked whether they pass through the stop between impacts.

    An impulse P along M^-1 c in each interval t, with sign s = 1 or s = -1 in turn: the state before it is P h, h = (s - E)^-1 E e for
    E = exp(A t), e = (0, M^-1 c). Restitution r of the speed c . v of P h asks for (1 + r) c . h_v(t) + c . M^-1 c = 0.
    """

    def __init__(self, n, seed, restitution, coupled, side=1):
        random = np.random.default_rng([n, seed])
        turn, other = np.linalg.qr(random.normal(size=(n, n)))[0], random.normal(size=(n, n))
        mass, stiffness = np.diag(random.uniform(0.3, 2.0, n)), turn @ np.diag(random.uniform(0.15, 2.0, n)) @ turn.T
        stiffness = stiffness + stiffness.T
        damping = -0.2 * np.eye(n) - 0.07 * (other + other.T) if coupled else -0.3 * mass + 0.05 * stiffness
        self.matrices, self.row, self.restitution, self.side = (mass, damping, stiffness), random.normal(size=n), restitution, side
        with mp.workdps(DIGITS):
            inverse, gap = mp.matrix(mass.tolist()) ** -1, mp.matrix([list(map(mp.mpf, self.row))])
            self.field = mp.zeros(2 * n)
            self.field[:n, n:] = mp.eye(n)
            self.field[n:, :n], self.field[n:, n:] = (-inverse * mp.matrix(part.tolist()) for part in (stiffness, damping))
            self.gap, self.rate, self.impulse = mp.zeros(1, 2 * n), mp.zeros(1, 2 * n), mp.zeros(2 * n, 1)
            self.gap[:, :n] = self.rate[:, n:] = gap
            self.impulse[n:, :] = inverse * gap.T
            self.compliance = (self.rate * self.impulse)[0]
            self.rates, self.shapes = mp.eig(self.field)
            self.back = self.shapes**-1
            self.kicks, sides = self.back * self.impulse, self.rate * self.shapes
            self.weights = [side * kick for side, kick in zip(sides, self.kicks, strict=True)]

    def flow(self, t):
        return (self.shapes * mp.diag([mp.exp(rate * t) for rate in self.rates]) * self.back).apply(mp.re)

    def response(self, t):
        """h, in the modes of the field."""
        flows = [mp.exp(rate * t) for rate in self.rates]
        return (self.shapes * mp.matrix([flow / (self.side - flow) * k for flow, k in zip(flows, self.kicks, strict=True)])).apply(mp.re)

    def mismatch(self, t):
        flows = [mp.exp(rate * t) for rate in self.rates]
        speed = mp.fsum(flow / (self.side - flow) * w for flow, w in zip(flows, self.weights, strict=True)).real
        return (1 + mp.mpf(self.restitution)) * speed + self.compliance

    def intervals(self, low, high):
        """Brackets of the intervals between impacts, by the same formula in double precision."""
        times = np.linspace(low, high, 900)
        flows = np.exp(np.outer(times, np.array(self.rates, complex)))
        sizes = (1.0 + self.restitution) * np.real(flows / (self.side - flows) @ np.array(self.weights, complex)) + float(self.compliance)
        turns = (sizes[:-1] * sizes[1:] < 0.0) & (np.abs(sizes[:-1]) < 50.0) & (np.abs(sizes[1:]) < 50.0)
        return [(times[k], times[k + 1]) for k in np.flatnonzero(turns)]

    def orbit(self, bracket):
        """(system, states before and after an impact, interval, multipliers of one interval, their relative errors for rounding of flight
        and impact). The trivial multiplier is left out."""
        with mp.workdps(DIGITS):
            t = mp.findroot(self.mismatch, bracket, solver="anderson", tol=mp.mpf(10) ** (10 - DIGITS))
            response = self.response(t)
            before = response / (self.gap * response)[0]
            restitution = mp.mpf(self.restitution)
            turn = mp.eye(len(before)) - (1 + restitution) * self.impulse * self.rate / self.compliance
            after, inward = turn * before, (self.rate * before)[0] > 0
            saltation = turn + (self.field * after - turn * self.field * before) * self.gap / (self.rate * before)[0]
            half = self.side * saltation * self.flow(t)
            values, shapes = mp.eig(half)
            back = shapes**-1
            rounding = EPS * mp.norm(half) * (1 + t * max(map(abs, self.rates)))
            found = [(v, rounding * mp.norm(shapes[:, k]) * mp.norm(back[k, :])) for k, v in enumerate(values)]
            found.remove(min(found, key=lambda pair: abs(pair[0] - 1)))
        if self.side < 0 and not inward:
            return None
        mass, damping, stiffness = self.matrices
        bounds = {"lower": -1.0, "upper": 1.0} if self.side < 0 else {"upper" if inward else "lower": 1.0}
        system = ImpactSystem(mass, damping, stiffness, (Stop(tuple(self.row), **bounds, restitution=self.restitution),))
        states = [system.modes.from_state @ np.array(part.tolist(), float)[:, 0] for part in (before, after)]
        return system, *states, float(t), sorted(found, key=lambda pair: -abs(pair[0]))


def run_round(system, before, after, t, side, impacts):
    """The orbit with so many impacts."""
    signs = np.array([side**k for k in range(impacts)], float)
    contact = np.zeros(impacts, np.int64) if side > 0 else np.array([(k + 1) % 2 for k in range(impacts)])
    return Cycle(system, np.outer(signs, before), np.outer(signs, after), np.full(impacts, t), contact, 0.0)


CASES = [
    (n, coupled, restitution, side)
    for n in (2, 3, 5) for coupled in (False, True) for restitution in (0.7, 0.0) for side in (1, -1)
]  # fmt: skip


@pytest.mark.parametrize("n, coupled, restitution, side", CASES[::5])
def test_each_multiplier_keeps_its_digits(n, coupled, restitution, side):
    """Oracle: see `require_each_multiplier_keeps_its_digits`."""
    require_each_multiplier_keeps_its_digits(n, coupled, restitution, side)


def require_each_multiplier_keeps_its_digits(n, coupled, restitution, side):
    """Relative to itself, to the rounding of each flight and impact, up to 1e12. One is 0 exactly where impacts are plastic."""
    largest = 0.0
    for seed in range(2 if n < 5 else 1):
        family = Lossy(n, seed, restitution, coupled, side)
        orbits = filter(None, map(family.orbit, family.intervals(0.3, 9.0)))
        for system, before, after, t, exact in islice(orbits, 2 if n < 5 else 1):
            for impacts in (2, 6, 2 * round(min(max(abs(6.0 / np.log10(float(abs(exact[0][0])))), 5.0), 25.0))):
                cycle = run_round(system, before, after, t, side, impacts)
                for route in (floquet_multipliers, saddle_point_multipliers):
                    found = route(cycle)
                    assert found.values.shape == (2 * n - 1,) and found.reliable and found.pairing is None
                    if restitution == 0.0:
                        assert found.values[-1] == 0.0
                    for value, error in exact[: 2 * n - 1 - (restitution == 0.0)]:
                        nearest = min(abs(mp.mpc(complex(other)) / value**impacts - 1) for other in found.values)
                        assert nearest < 2 * impacts * error / abs(value)
                largest = max(largest, float(abs(exact[0][0] ** impacts)))
    assert 1e2 < largest < 1e14
