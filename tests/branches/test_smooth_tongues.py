"""Families of orbits with q periods where a smooth family is at a p:q resonance. Oracles: DOP853 with the equation of variations, and the
normal form of a resonance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from branches.switching import switch
from tests.branches.test_smooth_agreement import family, second

ALONG = 14
CLEAR = 1e-9
"""Distance of a trace from 2 that rounding, 1e-13, changes by little."""

CASES = [
    ("smooth_wall", {"n": 3}, (0.02, 4.0), [1, 5], 0, 5),
    ("smooth_wall", {"n": 3}, (0.02, 4.0), [1, 4], 0, 8),
    ("smooth_wall", {"n": 3}, (0.02, 4.0), [2, 5], 0, 5),
    ("smooth_wall", {"n": 3}, (0.02, 4.0), [2, 5], 1, 10),
    ("smooth_wall", {"n": 100}, (0.02, 0.3), [1, 5], 0, 5),
    ("duffing_pair", {}, (1e-3, 20.0), [1, 4], 0, 8),
]
"""A scene with its in-phase family, a resonance of the period and which of several, and after how many half periods orbits return."""


@pytest.mark.parametrize(("scene", "values", "energy", "p_q", "which", "returns"), CASES[:2])
def test_tongues(scene, values, energy, p_q, which, returns):
    """Oracle: see `require_tongues`."""
    require_tongues(scene, values, energy, p_q, which, returns)


def require_tongues(scene, values, energy, p_q, which, returns):
    """Oracles: the rotation of half a period by DOP853; orbits with q periods close by it, with their traces. The normal form: a
    rotation by r/s of a turn leaves chains of s centres and s saddles, at h - h0 proportional to the square of their amplitude a. The
    energy of the normal form differs between them by a^s, so their traces leave 2 by +-c a^s. A next term changes the exponent s/2 by a
    part of a; that of another s would be off by a half."""
    branch = family(scene, "mode:1", *energy, **values)
    event = [event for event in branch.events if event.p_q == p_q][which]
    other, orbit = second(branch.system), branch.orbit(event.point)
    _, half = other.flown(np.append([0.0, 0.0], orbit.velocities), 2.0 * orbit.alpha)
    turn = math.acos((-np.trace(half) - 2.0) / 2.0) / (2.0 * math.pi)
    assert min(s for s in range(3, 20) if abs(s * turn - round(s * turn)) < 1e-7) == returns
    born = switch(branch, event, energy=(0.8 * event.h, 1.2 * event.h), points=ALONG)
    found = {}
    for one in born:
        h, tau = one.points["h"] - event.h, one.points["tau"] - 2.0
        assert np.all(np.abs(one.points["alpha"] / (p_q[1] * event.alpha) - 1.0) < np.abs(h) / event.h)
        i = int(np.flatnonzero(np.abs(tau) > CLEAR)[0])
        j = int(np.flatnonzero(h / h[i] > 2.0)[0])
        assert abs(math.log(tau[j] / tau[i]) / math.log(h[j] / h[i]) - 0.5 * returns) < 0.2
        for point in (i, j, len(one) - 1):
            orbit = one.orbit(point)
            start = np.hstack(orbit.sample(np.zeros(1)))[0]
            end, columns = other.flown(start, orbit.period)
            growth = np.abs(columns).max()
            assert np.abs(end - start).max() < 1e-12 * growth * np.abs(start).max()
            assert abs(np.trace(columns) - 2.0 - orbit.tau) < 1e-12 * growth**2
        # It is no old orbit: it is not closed after one of the q periods.
        assert np.abs(other.flown(start, orbit.period / p_q[1])[0] - start).max() > 1e-3
        found.setdefault((one.ends, tau[i] > 0.0), []).append((tau[i] / abs(h[i]) ** (0.5 * returns), one))
    kinds = {("origin", "rest")} if returns % 2 else {("origin", "origin"), ("rest", "rest")}
    assert {ends for ends, _ in found} == kinds and len(found) == 2
    (first, *images), (last, *others) = found.values()
    assert abs(first[0] / last[0] + 1.0) < 0.1
    # For even s the two sides of a line are one orbit, s/2 half periods later; for odd s/2 that is its mirror image.
    assert len(images) == len(others) == (1 if returns % 4 == 2 else 0)
