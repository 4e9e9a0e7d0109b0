"""Normal forms along curves of SB and PD of free orbits: where they vanish, and folds that end there.

Oracles: broken orbits of a closed form in many digits; the folds of the orbits that begin, extrapolated; the normal form of one event.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from branches.curves.figure import _pieces
from branches.curves.free_start import released_of
from branches.curves.starting import curve_start
from branches.curves.switching import curve_through
from branches.curves.tracing import follow_curve
from branches.released.criticality import free_criticality_of
from bvp.parameters import ParametricSystem
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


@pytest.mark.parametrize(("label", "code", "kind"), [("S31O11-", "PD", "GPD")])
def test_folds_end_where_the_criticality_changes(label, code, kind):
    """Oracle: see `require_folds_end_where_the_criticality_changes`."""
    require_folds_end_where_the_criticality_changes(label, code, kind)


def require_folds_end_where_the_criticality_changes(label, code, kind):
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


@pytest.mark.parametrize(("label", "code"), [*RANGES][2:4])
def test_criticality_along_a_curve(label, code):
    """Oracle: see `require_criticality_along_a_curve`."""
    require_criticality_along_a_curve(label, code)


def require_criticality_along_a_curve(label, code):
    """Oracle: the normal form of a point as an event of a family, from a period that is unfolded in another way."""
    curve = curve_of(label, code)
    kinds = curve.criticality
    unknown = [k for k, kind in enumerate(kinds) if not kind]
    assert set(unknown) <= {event.point for event in curve.events}
    between = set(range(len(curve) // 12, len(curve), len(curve) // 6)) - {event.point for event in curve.events}
    for k in sorted(between):
        known = free_criticality_of(curve.plane.problem, curve.unknowns[k], code)
        assert known.kind == kinds[k], k


def test_both_kinds_are_drawn():
    """Oracle: from the impact that vanishes, over DP, R2, R2 and DP, to the impact that vanishes."""
    assert [solid for _, _, solid in _pieces(curve_of("S13O00+", "SB"))][-5:] == [True, False, True, False, True]
