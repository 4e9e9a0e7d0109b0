"""Curves that go on beyond their ends, their ids and their files."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from branches.curves.files import COLUMNS, read_curves, save_curves
from branches.curves.identity import curve_id
from branches.curves.starting import CurveStart, curve_at
from branches.curves.tracing import can_go_on, curve_again, extend_curve, follow_curve
from branches.forced.tracing import follow_response
from branches.reading import RecordError
from tests.branches.curve_oracles import doubling_stop
from tests.branches.forced_systems import absorber_families, oscillator, settled

NARROW, WIDE = ((2.4, 2.7), (-1.0, 1.0)), ((1.9, 3.1), (-1.0, 1.0))


@cache
def family():
    """x'' + x = cos(w t), r = 0.8, one impact a period, over the place of the stop."""
    problem, y = settled(oscillator(w=2.5), ["s"], values={"s": -0.05}, start=([-1.0], [0.0]))
    return follow_response(problem, y, (-0.1, 0.2))


@cache
def curve(window=NARROW, direction="both", points=None):
    """The curve of its period doubling."""
    return follow_curve(curve_at(family(), "PD1", ("w", "s")), window, direction=direction, points=points)


def located(one):
    return [(event.type, *one.parameters[event.point], event.arclength) for event in one.events]


def test_an_extended_curve_is_that_of_one_run():
    """Oracle: one run in the wide range: its events to 1e-9. The points are kept, and the formula holds at the new ones."""
    narrow, whole = curve(), curve(WIDE)
    found = extend_curve(narrow, WIDE)
    assert [event.id for event in found.events] == [event.id for event in whole.events]
    for (code, *numbers), (other, *expected) in zip(located(found), located(whole), strict=True):
        assert code == other and numbers == pytest.approx(expected, abs=1e-9)
    assert [end.reason for end in found.ended] == [end.reason for end in whole.ended] and found.window == WIDE
    first = found.start - narrow.start
    for name in ("unknowns", "tangents", "parameters", "multipliers", "coefficient"):
        kept = getattr(found, name)[first : first + len(narrow)]
        assert np.array_equal(kept, getattr(narrow, name), equal_nan=True), name
    assert (np.diff(found.arclength) > 0.0).all() and found.arclength[0] == 0.0
    inside = np.abs(found.parameters[:, 0] - 2.0) > 1e-6
    for w, s in found.parameters[inside][::7]:
        assert s == pytest.approx(float(doubling_stop(w, 0.8)), rel=1e-11)
    assert curve_id(found) == curve_id(whole) != curve_id(narrow)


def test_points_of_codimension_two_of_an_extended_curve():
    """Oracle: one run in the wide range, to 1e-9, on the curve NS of the absorber."""
    first = absorber_families()[0]
    event = next(event for event in first.events if event.type == "NS")
    start, window = curve_at(first, event, ("w", "F")), ((0.8, 2.4), (0.1, 1.0))
    narrow = follow_curve(start, ((1.2, 1.4), (0.25, 0.35)))
    found, one_run = extend_curve(narrow, window), follow_curve(start, window)
    assert len(narrow.events) < len(found.events) and {"NS-GR", "PN", "GH"} <= {event.type for event in found.events}
    assert [event.id for event in found.events] == [event.id for event in one_run.events]
    for (_, *numbers, _), (_, *expected, _) in zip(located(found), located(one_run), strict=True):
        assert numbers == pytest.approx(expected, abs=1e-9)
    assert curve_id(found) == curve_id(one_run)


def test_only_open_ends_go_on():
    """Oracle: by hand. The curve ends at a grazing at w = 2, and at the ranges elsewhere."""
    whole = extend_curve(curve(), WIDE)
    grazes = [event.point for event in whole.events if event.type == "PD-GR"]
    assert grazes in ([0], [len(whole) - 1])
    last = grazes != [0]
    further = ((1.5, 3.2), (-1.0, 1.0))
    assert not can_go_on(whole, last, further) and can_go_on(whole, not last, further)
    assert not can_go_on(whole, not last, WIDE)
    assert len(extend_curve(whole, WIDE)) == len(whole)


def test_a_curve_goes_on_in_one_direction_and_for_some_points():
    """Oracle: the ends by hand."""
    narrow = curve()
    up = extend_curve(narrow, ((2.3, 2.8), (-1.0, 1.0)), direction="up")
    assert up.span[0][0] == narrow.span[0][0] and up.span[1][0] == pytest.approx(2.8)
    few = extend_curve(narrow, WIDE, points=len(narrow) + 6)
    assert len(narrow) + 4 <= len(few) <= len(narrow) + 6 and {end.reason for end in few.ended} == {"POINTS"}
    again = extend_curve(few, ((2.3, 2.8), (-1.0, 1.0)))
    assert again.span[0][0] == pytest.approx(2.3) and again.span[1][0] == pytest.approx(2.8)
    with pytest.raises(ValueError, match="outside these ranges"):
        extend_curve(narrow, ((2.5, 3.0), (-1.0, 1.0)))
    with pytest.raises(ValueError, match="points already"):
        extend_curve(narrow, WIDE, points=3)


def test_the_other_direction_goes_on():
    """A run in one direction alone, completed. Oracle: the run in both."""
    found = extend_curve(curve(direction="up"), NARROW)
    assert located(found)[0][1:3] == pytest.approx(located(curve())[0][1:3], abs=1e-9)
    assert located(found)[-1][1:3] == pytest.approx(located(curve())[-1][1:3], abs=1e-9)


def test_an_id_does_not_depend_on_the_start():
    """Oracle: the run from the event of a family. Here: from another point, in the other order of the parameters."""
    narrow = curve()
    other = follow_curve(CurveStart(narrow.plane, "PD", None, narrow.unknowns[-3]), NARROW)
    assert curve_id(other) == curve_id(narrow) and curve_id(narrow).startswith("PD:s,w:")
    turned = follow_curve(curve_at(family(), "PD1", ("s", "w")), NARROW[::-1])
    assert curve_id(turned) == curve_id(narrow)


def test_files_are_read_bit_for_bit(tmp_path):
    """Oracle: the curves that were written."""
    path = tmp_path / "curve.json"
    curves = [curve(), curve(direction="up")]
    save_curves(curves, path)
    for one, again in zip(curves, read_curves(path), strict=True):
        for name in COLUMNS.values():
            assert np.array_equal(getattr(one, name), getattr(again, name), equal_nan=True), name
        for name in ("code", "names", "events", "ended", "start", "closed", "window", "origin", "grazing"):
            assert getattr(one, name) == getattr(again, name), name
        assert np.array_equal(curve_again(again).y, curve_again(one).y)
    before = path.read_bytes()
    save_curves(read_curves(path), path)
    assert path.read_bytes() == before


def test_a_changed_file_is_refused(tmp_path):
    """Oracle: by hand."""
    path = tmp_path / "curve.json"
    one = curve()
    for change, words in (
        ({"start": 10**6}, "has no point"),
        ({"unknowns": one.unknowns + 0.01}, "do not solve the equations"),
        ({"code": "NS"}, "unknowns of its sequence"),
    ):
        save_curves([replace(one, **change)], path)
        with pytest.raises(RecordError, match=words):
            read_curves(path)
    with pytest.raises(ValueError, match="no event PD7; known: EP1"):
        curve_at(family(), "PD7", ("w", "s"))
