"""Normal forms along curves of SB and PD of free orbits: where they vanish, and folds that end there.

Oracles: broken orbits of a closed form in many digits; the folds of the orbits that begin, extrapolated; the normal form of one event.
"""

from __future__ import annotations

import math
from functools import cache

import mpmath as mp
import numpy as np
import pytest

from branches.curves.figure import _pieces
from branches.curves.free_criticality import free_criticality_of
from branches.curves.free_start import released_of
from branches.curves.starting import curve_start
from branches.curves.switching import curve_through
from branches.curves.tracing import follow_curve
from bvp.parameters import ParametricSystem
from tests.branches.curve_oracles import DIGITS, ReferenceBackbone
from tests.branches.test_free_criticality import many_digit_breaking
from tests.branches.traced import traced

ANY = (1e-3, math.inf)
RANGES = {
    ("S13O00+", "SB"): (0.02, 1.0),
    ("S31O11-", "SB"): (0.015, 0.11),
    ("S31O11-", "PD"): (0.04, 0.11),
    ("U21-", "SB"): (0.085, 0.11),
    ("U2111-", "PD"): (0.09, 0.11),
}


@cache
def curve_of(label, code):
    """The curve over mu and the energy through an event of the reference system."""
    branch = traced(label, low=0.05, high=30.0)
    event = next(event for event in branch.events if event.type == code)
    problem, y = released_of(branch.orbit(event.point), ("mu", "energy"), ParametricSystem.of(branch.system))
    return follow_curve(curve_start(problem, y, code, ("mu", "energy")), (RANGES[label, code], ANY))


def changes(curve):
    """The events at which the criticality of a curve changes."""
    return [event for event in curve.events if event.type in ("DP", "GPD")]


def test_degenerate_pitchforks_in_many_digits():
    """Oracle: the coefficient from broken orbits in fifty digits vanishes over mu."""
    curve = curve_of("S13O00+", "SB")
    events = changes(curve)
    assert [event.type for event in events] == ["DP", "DP"] and {event.status for event in events} == {"located"}
    for event in events:
        near = mp.mpf(event.values["quarter_period"])
        with mp.workdps(DIGITS):

            def place(mu, near=near):
                line = ReferenceBackbone(mu=mu)
                return line, mp.findroot(line.breaking_condition, near)

            def coefficient(mu, place=place):
                line, alpha = place(mu)
                return mp.mpf(many_digit_breaking(alpha, (1,), line))

            mu = mp.mpf(event.values["mu"])
            mu = mp.findroot(coefficient, (mu - mp.mpf("1e-7"), mu + mp.mpf("1e-7")), solver="secant", tol=1e-24)
            line, alpha = place(mu)
            assert abs(event.values["mu"] / mu - 1) < 1e-11
            assert abs(event.values["energy"] / line.energy(alpha) - 1) < 1e-11


@pytest.mark.parametrize(("label", "code", "kind"), [("S31O11-", "SB", "DP"), ("S31O11-", "PD", "GPD")])
def test_folds_end_where_the_criticality_changes(label, code, kind):
    """Oracle: points of the curve of folds of the orbits that begin, which have no limit set by the normal form. Mu and the energy are even
    functions of the difference of two flights that are equal on the other orbits. In the PD one of two families has the fold."""
    (event,) = changes(curve_of(label, code))
    assert event.type == kind and event.status == "located"
    start = curve_through(curve_of(label, code), event.point, "SN")
    fold = start.curve(((-math.inf, math.inf), (-math.inf, math.inf)))
    begin = fold.begin(start.y)
    distances = (0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.01, 0.014)
    steps = [begin, *(fold.step(begin.y, begin.tangent, sign * ds) for ds in distances for sign in (1.0, -1.0))]
    found = []
    for step in steps:
        times = start.plane.problem.flight_times(step.y)
        if step.converged and abs(times[0] - times[-1]) > 0.01:
            found.append(((times[0] - times[-1]) ** 2, *start.plane.linearised(step.y).parameters))
    spread = []
    for one in sorted(found):
        if not spread or one[0] > 1.15 * spread[-1][0]:
            spread.append(one)
    apart, *values = np.array(spread[:8]).T
    assert len(apart) == 8
    for name, column in zip(start.plane.names, values, strict=True):
        limit = np.polyfit(apart / apart[0], column, 7)[-1]
        assert event.values[name] == pytest.approx(limit, rel=1e-9)


def test_a_curve_of_folds_ends_at_the_point():
    """The equations of the doubled orbits are singular there, and the curve has the point of the other one."""
    curve = curve_of("S31O11-", "PD")
    event = changes(curve)[0]
    folds = follow_curve(curve_through(curve, event.point, "SN"), ((-math.inf, math.inf), (-math.inf, math.inf)), points=100)
    (end,) = [one for one in folds.events if one.type == event.type]
    assert end.status == "located" and end.point in (0, len(folds) - 1)
    assert folds.parameters[end.point] == pytest.approx([event.values["mu"], event.values["energy"]], rel=1e-11)
    # It is no jump: the curve itself comes up to it.
    beside = folds.parameters[1 if end.point == 0 else -2]
    assert beside == pytest.approx(folds.parameters[end.point], rel=1e-4)
    # From there it leads back to that curve.
    back = curve_through(folds, end.point, "PD")
    begin = back.curve(((-math.inf, math.inf), (-math.inf, math.inf))).begin(back.y)
    assert begin.converged and back.code == "PD"
    assert back.plane.linearised(begin.y).parameters == pytest.approx(folds.parameters[end.point], rel=1e-11)


@pytest.mark.parametrize(("label", "code"), RANGES)
def test_criticality_along_a_curve(label, code):
    """Oracle: the normal form of a point as an event of a family, from a period that is unfolded in another way."""
    curve = curve_of(label, code)
    kinds = curve.criticality
    unknown = [k for k, kind in enumerate(kinds) if not kind]
    assert set(unknown) <= {event.point for event in curve.events}
    for k in range(len(curve) // 12, len(curve), len(curve) // 6):
        known = free_criticality_of(curve.plane.problem, curve.unknowns[k], code)
        assert known.kind == kinds[k], k


def test_both_kinds_are_drawn():
    """Oracle: from the impact that vanishes, over DP, R2, R2 and DP, to the impact that vanishes."""
    assert [solid for _, _, solid in _pieces(curve_of("S13O00+", "SB"))][-5:] == [True, False, True, False, True]
