"""The absorber in the plane of frequency and amplitude: the table of points of codimension two of docs/absorber.md."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from branches.curves.starting import curve_at
from branches.curves.switching import curve_through
from branches.curves.tracing import follow_curve
from branches.forced.tracing import follow_response, switch_response
from bvp.criticality import criticality
from saltus.scene import load_scene
from tests.branches.curve_oracles import AbsorberOrbit
from tests.branches.forced_systems import absorber_families
from tests.branches.through_curves import regular_points, require_event
from tests.docs.pages import page, table
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle

WINDOW = ((0.5, 3.0), (0.02, 3.5))
ROWS = [
    (code, curves.split(", "), float(w), float(f))
    for code, curves, w, f in table(page("../absorber.md"), "In the plane of frequency and amplitude")
]
"""The rows of the table: code, curves, w, F."""


def through(branch, code, number=0):
    event = [event for event in branch.events if event.type == code][number]
    return follow_curve(curve_at(branch, event, ("w", "F")), WINDOW)


def point(curve, code, place):
    """Index of the point of a curve with a type of event that is nearest to a place."""
    found = [event for event in curve.events if event.type == code]
    return min(found, key=lambda event: np.abs(curve.parameters[event.point] - place).max()).point


@cache
def curve(name):
    """The curves of the table."""
    symmetric = absorber_families()[0]
    if name in ("NS", "SN"):
        return through(symmetric, name)
    if name == "GR":
        return through(symmetric, "GR", 1)
    if name == "SB":
        parametric = load_scene("absorber", w=0.79).parametric
        found = settled_orbit(ParameterPath(parametric, ["w"]), settle(parametric.system(), parametric.forces()))
        return through(follow_response(found.problem, found.y, (0.72, 0.9)), "SB")
    breaking = curve("SB")
    if name == "NS'":
        return follow_curve(curve_through(breaking, point(breaking, "R2", (0.59, 1.1)), "NS"), WINDOW)
    place = {"SN'": (0.7807, 0.3018), "SN''": (0.9194, 0.0289)}[name]
    return follow_curve(curve_through(breaking, point(breaking, "DP", place), "SN"), WINDOW)


def test_the_table_has_the_points_that_matter():
    assert {code for code, *_ in ROWS} >= {"CP", "DP", "R1", "R2", "R3", "R4", "FN", "PN", "FF", "GH", "SN-GR", "SB-GR", "NS-GR"}
    assert len(ROWS) == 20


@pytest.mark.parametrize(("code", "curves", "w", "f"), ROWS)
def test_each_point_is_on_its_curves(code, curves, w, f):
    """Each curve of a row locates the point with its own equations, to 1e-9."""
    for name in curves:
        found = curve(name)
        place = found.parameters[point(found, code, (w, f))]
        assert place == pytest.approx([w, f], abs=1e-9)


MULTIPLIERS = {"R1": 1.0, "R2": -1.0, "R3": np.exp(2j * math.pi / 3.0), "R4": 1j, "DP": -1.0, "CP": 1.0}


@pytest.mark.parametrize("code", MULTIPLIERS)
def test_points_have_their_multipliers(code):
    """Oracle: products of matrix exponentials and saltation matrices. A double multiplier is known to the root of rounding."""
    for kind, curves, w, f in ROWS:
        if kind == code:
            found = curve(curves[0])
            orbit = AbsorberOrbit.of(found.plane.problem, found.unknowns[point(found, code, (w, f)), : found.plane.size])
            distances = np.sort(np.abs(orbit.multipliers() - MULTIPLIERS[code]))
            assert distances[0] < (1e-6 if code in ("R1", "R2") else 1e-9)
            if code in ("R1", "R2"):
                assert distances[1] < 1e-6


def test_the_coefficient_of_a_fold_has_a_pole_at_a_resonance():
    """Its sign changes there, and no digit of it is known."""
    folds = curve("SN''")
    place = point(folds, "R1", (0.9978, 0.1415))
    before, at, after = (criticality(folds.plane.problem, folds.unknowns[k], "SN") for k in (place - 1, place, place + 1))
    assert at.kind == "degenerate" and before.kind is after.kind is None
    assert before.coefficient * after.coefficient < 0.0


@cache
def doubling():
    """The curve PD of orbits without symmetry."""
    return through(absorber_families()[2], "PD")


CURVES = {"NS": None, "SN": None, "GR": None, "SB": None, "NS'": None, "SN'": None, "SN''": None, "PD": doubling}


def named(name):
    return (CURVES[name] or (lambda: curve(name)))()


@pytest.mark.parametrize("name", CURVES)
def test_a_branch_through_points_of_a_curve_has_the_event(name):
    """A spread sample; tests/full has all points. Oracle: matrix exponentials before and behind, and the event of the branch, to 1e-9."""
    found = named(name)
    points = regular_points(found)
    assert len(points) > len(found) - 8
    for i in points[:: len(points) // 6]:
        require_event(found, i)


@pytest.mark.parametrize("number", [0, 1])
def test_grazings_of_doubled_orbits_end_at_the_grazing_of_the_doubling(number):
    """They touch once in two periods, so that their sequence has no image. Oracle: the curve of the doubling."""
    broken = absorber_families()[2]
    doubling = [event for event in broken.events if event.type == "PD"][number]
    doubled = follow_response(*switch_response(broken, doubling)[0], (0.7, 2.2))
    grazings = through(doubled, "GR")
    assert len(grazings.plane.problem.sequence) == 9
    single = through(broken, "PD")
    place = single.parameters[point(single, "PD-GR", (0.9087, 0.3401))]
    end = next(event for event in grazings.events if event.type == "PD-GR" and event.point in (0, len(grazings) - 1))
    assert end.status == "located" and grazings.parameters[end.point] == pytest.approx(place, abs=1e-9)
    orbit = AbsorberOrbit.of(grazings.plane.problem, grazings.unknowns[end.point, : grazings.plane.size])
    assert orbit.residual() < 1e-9
    back = follow_curve(curve_through(grazings, end.point, "PD"), WINDOW, points=40)
    assert back.plane.problem.sequence == broken.problem.sequence
    assert np.abs(back.parameters - place).max(axis=1).min() < 1e-9
