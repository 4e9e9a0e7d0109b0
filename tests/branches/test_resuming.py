"""Scans of starts that floating-point numbers do not tell apart.

Oracles: a scan of the same starts in forty digits, orbits refined to sixty digits, and that each orbit is found from both its ends.
"""

import mpmath as mp
import numpy as np
import pytest

import saltus
from branches.search.discovery import discover_orbits
from branches.search.intervals import resumed, scan, segment_limits
from branches.search.orbit_search import CLASSES
from branches.search.starts import curves
from branches.sequences import mirror, unfolded_sequence
from tests.bvp.high_precision import DIGITS, Exact

SYSTEM = saltus.vibro_impact_nes()
BOUNDS = {"quarter_period": 5.1, "impacts": 10}
LIMITS = {far: segment_limits("origin", far, 5.1, 10) for far in ("origin", "rest", "stop")}
LONGEST = max(time for time, _ in LIMITS.values())


@pytest.mark.parametrize("energy", [14.0, 14.55])
def test_energies_below_the_last_grazing_of_the_backbone_are_complete(energy):
    """Oracle: see `require_energies_below_the_last_grazing_of_the_backbone_are_complete`."""
    require_energies_below_the_last_grazing_of_the_backbone_are_complete(energy)


def require_energies_below_the_last_grazing_of_the_backbone_are_complete(energy):
    """Oracle: reversal: between two ends of one kind each orbit is found once from either; S13O00+ grazes at h = 14.5537."""
    found = discover_orbits(SYSTEM, energy, **BOUNDS, ends=tuple(CLASSES))
    assert found.complete and found.counts["resumed"] > 50 and not found.open
    assert max(abs(orbit.tau) for orbit in found.orbits) > 1e16


def test_the_most_unstable_orbits_are_orbits():
    """Oracle: Newton's method in sixty digits moves them by rounding alone."""
    found = discover_orbits(SYSTEM, 14.3, **BOUNDS)
    chosen = [orbit for orbit in found.orbits if abs(orbit.tau) > 1e15]
    assert len(chosen) >= 5
    for orbit in chosen:
        exact = Exact(orbit.problem, orbit.solution)
        with mp.workdps(DIGITS):
            assert exact.left < mp.mpf(10) ** -45
            assert max(abs(a - mp.mpf(float(b))) for a, b in zip(exact.y, orbit.solution.y, strict=True)) < 1e-10


class ManyDigits:
    """Starts at the origin followed in forty digits: where the gap coordinate passes zero, how far the motion is from the origin."""

    def __init__(self, energy):
        modes = SYSTEM.modes
        self.squares = [mp.mpf(float(s)) for s in modes.squares]
        self.w = [mp.sqrt(s) for s in self.squares]
        self.gap = [mp.mpf(float(g)) for g in modes.contacts.gap[0, :2]]
        self.across = [-self.gap[1], self.gap[0]]
        self.speed = mp.sqrt(2 * mp.mpf(energy))
        self.grid = np.arange(1, 4001) * 2.5e-3
        self.turns = [(np.cos(float(w) * self.grid), np.sin(float(w) * self.grid) / float(w)) for w in self.w]

    def flow(self, z, t):
        out = [None] * 4
        for k in range(2):
            c, s = mp.cos_sin(self.w[k] * t)
            out[k] = c * z[k] + s / self.w[k] * z[k + 2]
            out[k + 2] = c * z[k + 2] - s * self.w[k] * z[k]
        return out

    def along(self, z):
        return self.gap[0] * z[0] + self.gap[1] * z[1], self.gap[0] * z[2] + self.gap[1] * z[3]

    def root(self, z, t, level):
        for _ in range(12):
            w, rate = self.along(self.flow(z, t))
            step = (w - level) / rate
            t -= step
            if abs(step) < mp.mpf(10) ** -34:
                return t
        return t

    def crossings(self, theta, impacts, longest):
        """{(sequence, number of the crossing in its flight): (residual, time)}."""
        z = [mp.mpf(0), mp.mpf(0), self.speed * mp.cos(theta), self.speed * mp.sin(theta)]
        out, sequence, elapsed = {}, "", mp.mpf(0)
        grid = self.grid
        for _ in range(impacts + 1):
            a = [float(x) for x in z]
            x = sum(float(g) * (c * a[k] + s * a[k + 2]) for k, (g, (c, s)) in enumerate(zip(self.gap, self.turns, strict=True)))
            beyond = np.flatnonzero(np.abs(x) > 1.0)
            end = int(beyond[0]) if beyond.size else len(grid) - 1
            number = 0
            for i in np.flatnonzero(x[:end] * x[1 : end + 1] <= 0.0):
                t = self.root(z, mp.mpf(float(grid[i])), 0)
                at = self.flow(z, t)
                if elapsed + t <= longest:
                    out[sequence, number] = (self.across[0] * at[0] + self.across[1] * at[1], elapsed + t)
                number += 1
            if not beyond.size:
                break
            side = 1 if x[end] > 0.0 else -1
            t = self.root(z, mp.mpf(float(grid[end])), side)
            z = self.flow(z, t)
            elapsed += t
            if elapsed > longest:
                break
            sequence += "+" if side > 0 else "-"
            rate = self.along(z)[1]
            size = self.gap[0] ** 2 + self.gap[1] ** 2
            z = [z[0], z[1], z[2] - 2 * rate * self.gap[0] / size, z[3] - 2 * rate * self.gap[1] / size]
        return out


def sequences_to_origin(found):
    """{sequence: times} of every crossing of the origin that the orbits found make, whatever the cover, and of their images."""
    out = {}
    for orbit in found.orbits:
        ends, sequence = orbit.ends, orbit.problem.sequence
        quarter = ends[1] != "origin"
        for first in (sequence,) if quarter else (sequence, sequence[::-1]):
            for cover in range(2, 9, 2) if quarter else range(1, 5):
                longer, _ = unfolded_sequence(first, ends, cover)
                for image in ("".join(longer), "".join(mirror(longer))):
                    out.setdefault(image, []).append(cover * orbit.alpha * (1.0 if quarter else 2.0))
    return out


@pytest.mark.parametrize("energy", [14.0])
def test_a_scan_in_forty_digits_adds_nothing(energy):
    """Oracle: see `require_nothing_new`. More intervals are in tests/full."""
    require_nothing_new(energy, 1, 50)


def require_nothing_new(energy, intervals, steps):
    """Oracle: changes of sign, between starts in forty digits, over intervals as narrow as rounding that were resumed."""
    (curve,) = curves(SYSTEM, "origin", energy)
    _, opened, _ = scan(curve, LIMITS, 100000)
    images = [(opening, resumed(curve, opening, LONGEST)) for opening in opened]
    most = [(sum(p.kind == "origin" for p in scan(image, LIMITS, 10000)[0]), opening) for opening, image in images if image is not None]
    most.sort(key=lambda pair: -pair[0])
    known = sequences_to_origin(discover_orbits(SYSTEM, energy, **BOUNDS))
    hits = 0
    with mp.workdps(40):
        digits = ManyDigits(energy)
        for _, opening in most[:intervals]:
            taken = {}
            for j in range(steps + 1):
                rows = digits.crossings(mp.mpf(opening.parameter) + mp.mpf(opening.width) * j / steps, 10, LONGEST)
                for sequence, number in rows.keys() & taken.keys():
                    (a, t_a), (b, t_b) = rows[sequence, number], taken[sequence, number]
                    if sequence and a * b < 0:
                        low, high = sorted((float(t_a), float(t_b)))
                        assert any(low - 1e-3 < t < high + 1e-3 for t in known.get(sequence, [])), (energy, sequence, low, high)
                        hits += 1
                taken = rows
    assert hits > 0
