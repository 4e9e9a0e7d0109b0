"""Long cases of tests/branches/test_smooth_events.py."""

from __future__ import annotations

import math

import numpy as np
import pytest

from branches.naming.at_modes import orbit_at_mode
from branches.tracing import follow_family
from saltus.scene import load_scene


def tip(n):
    """The energy at which a tongue crosses the 3-fold cover of the in-phase family of smooth walls, and that of the tongue's tip."""
    energy = (0.05, 0.06)
    first = orbit_at_mode("mode:1", load_scene("smooth_wall", n=n).system, energy)
    branch = follow_family(first.problem, first.solution.y, energy=energy)
    (crossing,) = (event for event in branch.events if event.type == "RT" and event.p_q == [1, 3])
    tongues = branch.switch(crossing.id, energy=(crossing.h - 1e-4, crossing.h + 1e-4))
    (fold,) = (event for tongue in tongues for event in tongue.events if event.type == "SN")
    return crossing.h, fold.h


def test_the_tip_of_a_tongue_is_told_from_its_crossing_with_a_cover():
    """Oracle: the normal form of a tripling. Along the tongue h - h_crossing = a s + b s^2, so its tip is at -a^2/(4 b), where a is zero
    at one exponent of the walls. The root of the distance is a smooth function of the exponent: the parabola through three of its values,
    at most 4.3e-7 apart in h, gives the others, down to 7e-10. Its error is that of the next term, 4e-4 here."""
    known = {n: tip(n) for n in (1.41, 1.42, 1.43)}
    roots = [math.copysign(math.sqrt(crossing - fold), n - 1.4255) for n, (crossing, fold) in known.items()]
    parabola = np.polyfit(list(known), roots, 2)
    for n in (1.4249, 1.4264):
        crossing, fold = tip(n)
        assert 3e-10 < crossing - fold < 1.3e-9
        assert math.sqrt(crossing - fold) == pytest.approx(abs(np.polyval(parabola, n)), rel=2e-3)
