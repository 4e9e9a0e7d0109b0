"""Pictures of many families, measured by matplotlib's own renderer, and their data.

Oracles: the columns of the families; closed forms of the linear modes; renderer extents; the bytes of a picture drawn again.
"""

import io
import json
import re
from dataclasses import fields, is_dataclass, replace
from functools import cache

import numpy as np
import pytest
from matplotlib.lines import Line2D

from benchmarks import backbone
from branches.figures.atlas import atlas_figure, draw_atlas, velocities_figure
from branches.figures.atlas_data import EVENTS, atlas_of, regime_bounds, rescaled
from branches.figures.curves import parse_inset
from branches.figures.data import ExportError, read_atlas, write_atlas
from branches.figures.room import even_points, short_name
from branches.figures.style import legend_below, new_figure, write_figure
from branches.naming.labels import canonical_label, parse
from tests.branches import atlas_families as real
from tests.branches.test_diagram import assert_texts_apart, by_gid, overlapping, panels_of, text_boxes

INSETS = ("1:3,1.8:3.2", "0.09:0.16")


@cache
def drawn_once(kind):
    """The figure of a kind, which tests measure and do not change."""
    if kind == "velocities":
        return velocities_figure(real.atlas())
    if kind == "impulsive":
        return atlas_figure(atlas_of(real.SYSTEM, (), manifold=real.curve(), impulsive=real.impulsive()))
    options = {"insets": {"insets": [parse_inset(text) for text in INSETS]}, "fundamental": {"frequency": "fundamental"}}
    return atlas_figure(real.atlas(), **options.get(kind, {}))


@pytest.fixture(params=["index", "insets", "fundamental", "velocities", "impulsive"])
def drawn(request):
    """(kind, figure) of each kind of picture."""
    return request.param, drawn_once(request.param)


@pytest.mark.parametrize("renderer", ["png", "svg"])
def test_no_two_texts_overlap_and_all_lie_in_the_figure(drawn, renderer):
    """Oracle: the text extents of the renderers of bitmaps and of vector pictures."""
    assert_texts_apart(drawn[1], renderer)


def test_names_keep_off_stars_and_bullets(drawn):
    """Oracle: text extents against the places of the markers."""
    figure = drawn[1]
    texts, boxes = text_boxes(figure, "png")
    for axes in panels_of(figure).values():
        mine = [box for text, box in zip(texts, boxes, strict=True) if text in axes.texts]
        marks = [line for line in axes.get_lines() if (line.get_gid() or "").endswith(("-impulsive", "-grazing"))]
        for line in marks:
            spots = axes.transData.transform(line.get_xydata()) * 72 / 200
            markers = np.concatenate([spots - 1.5, spots + 1.5], axis=1)
            assert mine and not overlapping(np.array(mine), markers).any()


def lines_of(axes, prefix):
    return {line.get_gid(): line for line in axes.get_lines() if (line.get_gid() or "").startswith(prefix)}


@pytest.mark.parametrize(("frequency", "column"), [("index", "frequency_index"), ("fundamental", "frequency")])
def test_every_point_is_drawn_on_the_line_of_its_stability_and_lines_break_where_m_changes(frequency, column):
    """Oracle: membership of each (h, frequency); each drawn segment joins two successive points of one family, of one m on the index
    axis, where a point beside a change of m has the frequencies of both."""
    data = real.atlas()
    axes = panels_of(drawn_once(frequency))["frequency"]
    lines = lines_of(axes, "frequency-")
    places = {}
    for k, curve in enumerate(data.curves):
        for i, point in enumerate(zip(curve.h, getattr(curve, column), strict=True)):
            places.setdefault(point, []).append((k, i, curve.half_waves[i]))
            for j in (i - 1, i + 1):
                if frequency == "index" and 0 <= j < len(curve.h) and curve.half_waves[j] != curve.half_waves[i]:
                    turned = curve.half_waves[j] * curve.frequency[i]
                    places.setdefault((point[0], turned), []).append((k, i, curve.half_waves[j]))
    drawn = {name: lines[f"frequency-{name}"].get_xydata() for name in ("stable", "unstable", "undecided") if f"frequency-{name}" in lines}
    on = {name: {tuple(p) for p in points} for name, points in drawn.items()}
    everywhere = set.union(*on.values())
    for curve in data.curves:
        for point, stable in zip(zip(curve.h, getattr(curve, column), strict=True), curve.stable, strict=True):
            assert point in everywhere
            assert stable != 0 or point not in on["stable"]
    joins = 0
    for name in on:
        points = drawn[name]
        for a, b in zip(points, points[1:], strict=False):
            if np.isnan(a[0]) or np.isnan(b[0]):
                continue
            pairs = [(i, j) for i in places[tuple(a)] for j in places[tuple(b)] if i[0] == j[0] and abs(i[1] - j[1]) == 1]
            assert pairs
            if frequency == "index":
                assert any(i[2] == j[2] for i, j in pairs)
            joins += 1
    assert joins > 1000 and len(axes.get_lines()) < 40


def test_linear_modes_end_in_bullets_where_they_graze():
    """Oracle: w_k^2/(2 b_k^2), by numpy alone."""
    frequencies, _, participation = backbone.participation(real.SYSTEM)
    axes = panels_of(drawn_once("index"))["frequency"]
    for k, label in enumerate(("L11+", "L11-")):
        energy, frequency = frequencies[k] ** 2 / (2.0 * participation[k] ** 2), frequencies[k]
        (line,), (bullet,) = by_gid(axes, f"frequency-{label}"), by_gid(axes, f"frequency-{label}-grazing")
        np.testing.assert_allclose(line.get_xydata(), [[axes.get_xlim()[0], frequency], [energy, frequency]], rtol=1e-12)
        np.testing.assert_allclose(bullet.get_xydata(), [[energy, frequency]], rtol=1e-12)
        mode = real.atlas().thresholds[k]
        assert mode.label == label and abs(mode.h / energy - 1.0) < 1e-12


def test_the_manifold_is_dots_joined_where_it_does_not_jump():
    """Oracle: the curve's own breaks."""
    curve = real.curve()
    axes = panels_of(drawn_once("index"))["frequency"]
    (dots,) = by_gid(axes, "frequency-manifold")
    drawn = dots.get_xydata()
    kept = drawn[np.isfinite(drawn[:, 0])]
    np.testing.assert_array_equal(kept, np.stack([curve.h, curve.frequency], axis=1))
    joined = {tuple(a) for a, b in zip(drawn, drawn[1:], strict=False) if np.isfinite(a[0]) and np.isfinite(b[0])}
    for i, broken in enumerate(curve.breaks):
        assert ((curve.h[i], curve.frequency[i]) in joined) is not bool(broken)
    assert curve.breaks.any() and dots.get_marker() == "."


def test_names_are_counted_and_cited_ones_come_first():
    """Oracle: the texts in the picture; with room for three, both cited families and the one with the longest range of energies."""
    data = real.atlas()
    total = len({curve.family for curve in data.curves})
    for most in (3, 1000):
        figure = atlas_figure(data, names=most)
        axes = panels_of(figure)["frequency"]
        texts = {text.get_text() for text in axes.texts if text.get_text().startswith("$") and "L11" not in text.get_text()}
        note = figure.legends[0].get_title().get_text()
        count = int(note.split(" of ")[0])
        assert f"of {total} families named" in note and "named" not in axes.get_xlabel()
        assert count == len(texts) <= most
        if most == 3:
            others = [curve for curve in data.curves if not curve.cited.any()]
            widest = max(others, key=lambda curve: curve.h.max() / curve.h.min())
            assert count == 3 and {r"$\mathrm{S13}^{+}$", r"$\mathrm{S31O11}^{+}$"} < texts
            assert widest.label in ("S11O00-",) and r"$\mathrm{S11}^{-}$" in texts


PINS = {
    "U11+": {"h": 0.48, "alpha": 1.6903},
    "U21+": {"h": 0.53, "alpha": 1.6453},
    "U21-": {"h": 0.58, "alpha": 1.6186},
    "S31O11-": {"h": 1.5, "alpha": 1.6376},
    "S11-": {"h": 0.8},
    "U(15)578-": {"h": 1.475, "alpha": 8.1792},
    "S13+": {"h": 0.8, "alpha": 0.3},
}


def test_a_reference_point_marks_its_family_at_its_place():
    """Oracle: the scene's own pins. U11+ and U21- are labels of the family that leaves S13+, U21+ is the literature's name of a point
    that counts as U1101+; S31O11- counts as S33O11- there; a pin of a family that is not there, and one where no orbit is, mark nothing."""
    data = atlas_of(real.SYSTEM, real.families(), reference_points=PINS)
    marked = {}
    for curve in data.curves:
        for name in dict.fromkeys(curve.names[curve.cited].tolist()):
            assert name not in marked
            marked[name] = curve
    assert set(marked) == {"U11+", "U21+", "U21-", "S31O11-", "S11-"}
    born = marked["U11+"]
    assert born is marked["U21+"] is marked["U21-"] and "U1101+" in born.labels
    for name, label in (("U11+", "U1101+"), ("U21-", "U2101-"), ("S11-", "S11O00-")):
        curve = marked[name]
        here = set(curve.labels[(curve.names == name) & curve.cited].tolist())
        assert {str(canonical_label(parse(text))) for text in here} == {label}
    for name, label in (("U21+", "U1101+"), ("S31O11-", "S33O11-")):
        curve = marked[name]
        (k,) = np.flatnonzero(curve.names == name)
        assert str(canonical_label(parse(curve.labels[k]))) == label
        away = np.hypot(np.log(curve.h / PINS[name]["h"]), np.log(curve.alpha / PINS[name]["alpha"]))
        assert k == np.argmin(away) and away[k] < 0.05


@pytest.mark.parametrize("figure", [atlas_figure])
def test_cited_names_are_written_as_the_scene_writes_them(figure):
    """Oracle: see `require_cited_names_are_written_as_the_scene_writes_them`."""
    require_cited_names_are_written_as_the_scene_writes_them(figure)


def require_cited_names_are_written_as_the_scene_writes_them(figure):
    """Oracle: the texts of the picture; three names of one family count as one family."""
    families = real.families()[:2] + tuple(b for b in real.families() if "U1101+" in b.points["label"])
    data = atlas_of(real.SYSTEM, families, reference_points=PINS)
    drawn = figure(data)
    texts = {text.get_text() for axes in drawn.axes for text in axes.texts}
    note = drawn.legends[0].get_title().get_text()
    assert {r"$\mathrm{U11}^{+}$", r"$\mathrm{U21}^{+}$", r"$\mathrm{U21}^{-}$"} < texts
    assert r"$\mathrm{U1101}^{+}$" not in texts and note.startswith("3 of 3 families named")


def test_a_reference_point_outside_the_energies_shown_marks_nothing():
    """Oracle: the range."""
    data = atlas_of(real.SYSTEM, real.families(), reference_points=PINS, energy=(0.56, 1.4))
    assert {name for curve in data.curves for name in curve.names[curve.cited]} == {"U21-", "S11-"}


@pytest.mark.parametrize(("texts", "frequency"), [("0.2:0.4,0.7:1.2", "index")])
def test_insets_show_their_part_larger_beside_the_axes(texts, frequency):
    """Oracles: see `require_insets`. All frequencies of all insets are in tests/full."""
    require_insets(texts, frequency)


def require_insets(texts, frequency):
    """Oracles: the limits asked for; text extents; sizes of the part and of the inset (one that is as high as the picture is wider only);
    the words at the axes; the data of the lines in the axes.

    Names keep off the curves in an inset and off the edges of its frame. The letter of an inset is at its frame.
    """
    insets = [parse_inset(text) for text in texts.split()]
    figure = atlas_figure(real.atlas(), frequency=frequency, insets=insets)
    written, boxes = assert_texts_apart(figure, "png")
    panels = panels_of(figure)
    axes = panels["frequency"]
    points = 72 / 200
    frame = np.array(axes.bbox.extents) * points
    names = np.array([box for text, box in zip(written, boxes, strict=True) if text in axes.texts and "mathrm" in text.get_text()])
    for letter, asked in zip("abc", insets, strict=False):
        inset = panels[f"inset-{letter}"]
        (indicated,) = [artist.rectangle for artist in axes.artists if artist.rectangle.get_gid() == f"inset-{letter}-frame"]
        shown = np.array(indicated.get_bbox().get_points())
        np.testing.assert_allclose(shown, np.transpose([inset.get_xlim(), inset.get_ylim()]), rtol=1e-12)
        np.testing.assert_allclose(inset.get_xlim(), asked.energy, rtol=1e-12)
        assert asked.frequency is None or tuple(np.round(inset.get_ylim(), 9)) == asked.frequency
        corners = axes.transData.transform(shown) * points
        (left, bottom), (right, top) = corners
        larger = np.array(inset.bbox.size) * points > 1.05 * (corners[1] - corners[0])
        if len(insets) == 1:
            assert larger[0] and (larger[1] or top - bottom > 0.6 * (frame[3] - frame[1]))
        assert inset.get_yscale() == axes.get_yscale()
        assert (inset.get_xlabel(), inset.get_ylabel()) == ("$h$", r"$2\pi/T$" if frequency == "fundamental" else r"$m\,2\pi/T$")
        box = np.array(inset.get_tightbbox().extents) * points
        assert box[0] > frame[2] and inset.get_title(loc="left") == f"({letter})"
        (named,) = [box for text, box in zip(written, boxes, strict=True) if text in axes.texts and text.get_text() == f"({letter})"]
        assert np.hypot(*(np.clip((left, top), named[:2], named[2:]) - (left, top))) < 50.0
        edges = [(left, bottom, right, bottom), (left, top, right, top), (left, bottom, left, top), (right, bottom, right, top)]
        assert not overlapping(names, np.array(edges)).any()
        assert_names_off(along(line for line in lines_of(inset, f"inset-{letter}-").values() if line.get_linestyle() != "None"), inset)
        for name in ("stable", "unstable"):
            there = by_gid(axes, f"frequency-{name}")[0].get_xydata()
            np.testing.assert_array_equal(by_gid(inset, f"inset-{letter}-{name}")[0].get_xydata(), there)


def along(lines):
    """Places on lines, half a point apart, in points on the page."""
    paths = [line.get_transform().transform(line.get_xydata()) * 72 / 200 for line in lines]
    return np.concatenate([np.concatenate([even_points(path, 0.5), path]) for path in paths])


def assert_names_off(spots, axes, names=None):
    """A name hides a few places of the curves of some axes at most."""
    for text in axes.texts:
        if text.get_text().startswith("$\\mathrm{") and (names is None or text.get_text() in names):
            left, bottom, right, top = np.array(text.get_window_extent().extents) * 72 / 200
            inside = (spots > [left + 1.0, bottom + 1.5]).all(axis=1) & (spots < [right - 1.0, top - 1.5]).all(axis=1)
            assert inside.sum() <= 4, text.get_text()


def test_no_dot_is_left_where_m_changes():
    """Oracle: dots are of families that have one point alone, and of a first point with another m than the next; of a family whose m
    changes at every point, the lines still show every m."""
    data = real.atlas()
    waves = np.arange(1, 1 + len(data.curves[0].h))
    once = replace(data.curves[0], half_waves=waves, frequency_index=waves * data.curves[0].frequency)
    for curves, figure in ((data.curves, drawn_once("index")), ((once,), atlas_figure(replace(data, curves=(once,))))):
        axes = panels_of(figure)["frequency"]
        singles = [line for name, line in lines_of(axes, "frequency-").items() if name.endswith("-single")]
        alone = {curve.h[0] for curve in curves if len(curve.h) == 1 or curve is once}
        assert all(set(line.get_xdata()) <= alone for line in singles)
    drawn = np.concatenate([lines_of(axes, "frequency-")[f"frequency-{name}"].get_xydata() for name in ("stable", "unstable", "undecided")])
    for i, m in enumerate(once.half_waves):
        assert ((drawn[:, 0] == once.h[i]) & np.isclose(drawn[:, 1], m * once.frequency[i], rtol=1e-13)).any()


def test_special_points_are_marked_where_there_is_room():
    """Oracles: the events of the families; the distances of all markers of a panel; a lone family has room for all that are apart."""
    wanted = {(kind, event.h) for b in real.families() for kind in ("SN", "SB", "PD", "GR") for event in b.events if event.type == kind}
    for figure, panel in ((drawn_once("index"), "frequency"), (drawn_once("velocities"), "velocity1")):
        axes = panels_of(figure)[panel]
        marks = lines_of(axes, f"{panel}-events-")
        assert len(marks) >= 3
        for name, line in marks.items():
            assert all((name[-2:], h) in wanted for h in line.get_xdata())
            assert any(text.get_text().startswith(name[-2:]) for text in figure.legends[0].get_texts())
        spots = axes.transData.transform(np.concatenate([line.get_xydata() for line in marks.values()])) * 72 / 200
        apart = np.hypot(*(spots[:, None] - spots[None]).T) + 99.0 * np.eye(len(spots))
        assert apart.min() > 6.9
    branch = real.families()[1]
    axes = panels_of(atlas_figure(atlas_of(real.SYSTEM, [branch])))["frequency"]
    (fold,) = [event for event in branch.events if event.type == "SN"]
    (mark,) = by_gid(axes, "frequency-events-SN")
    assert mark.get_xydata().tolist() == [[fold.h, branch.points["frequency_index"][fold.point]]]


def test_no_marker_stands_where_many_families_run_together():
    """Oracle: the same family under many ids: what is marked of it alone is not marked of ten on top of each other."""
    data = atlas_of(real.SYSTEM, real.families()[1:2])
    bundle = tuple(replace(data.curves[0], family=f"origin-stop+::{k:08x}") for k in range(10))
    figures = [atlas_figure(replace(data, curves=curves)) for curves in (data.curves, bundle)]
    alone, many = (lines_of(panels_of(figure)["frequency"], "frequency-events-") for figure in figures)
    assert alone and not many


def test_equal_names_are_distinguished_and_families_without_a_label_have_a_short_id():
    """Oracle: the texts of the picture: one plain name, and the first digits of the hashes that tell the ids apart."""
    data = real.atlas()
    blank = np.full(len(data.curves[0].h), "")
    some = [
        replace(data.curves[0], family=f"rest-stop+::{hash}", h=10.0**k * data.curves[0].h, cited=blank == "x", **names)
        for k, (hash, names) in enumerate(
            [("aaaa1111", {}), ("bbbb2222", {}), ("bbbb2333", {}), ("cccc4444", {"names": blank, "labels": blank})]
        )
    ]
    for draw in (atlas_figure, velocities_figure):
        figure = draw(replace(atlas_of(real.SYSTEM, []), curves=tuple(some)))
        for axes in figure.axes:
            texts = [text.get_text() for text in axes.texts if text.get_text() and "L11" not in text.get_text()]
            plain = r"$\mathrm{S13}^{+}$"
            assert sorted(texts) == sorted(["#cccc", plain, f"{plain} #bbbb22", f"{plain} #bbbb23"])
        assert figure.legends[0].get_title().get_text().startswith("4 of 4 families named; #")


def types_in_legend(figure):
    """Types of special points that the legend has."""
    return {text.get_text()[:2] for text in figure.legends[0].get_texts()} & set(EVENTS)


@pytest.mark.parametrize("figure", [atlas_figure, velocities_figure])
def test_the_legend_has_the_special_points_of_the_families(figure):
    """Oracle: the events of the families, and the markers in all panels."""
    data = real.atlas()
    drawn = drawn_once("insets" if figure is atlas_figure else "velocities")
    names = {name for axes in panels_of(drawn).values() for name in lines_of(axes, "") if name and "-events-" in name}
    assert {name[-2:] for name in names} <= types_in_legend(drawn) == {kind for c in data.curves for kind in c.events.tolist()} - {""}


@pytest.mark.parametrize(("names", "words"), [(1, 1), (4, 1), (7, 5), (12, 9)])
def test_a_legend_has_no_more_columns_than_the_figure_has_room_for(names, words):
    """Oracle: the renderer's boxes of the legend, and of one of four columns."""
    figure = new_figure(5.0)
    entries = [Line2D([], [], label=f"{k} " + "wide " * words) for k in range(names)]
    plain = figure.legend(handles=entries, ncols=min(4, names))
    wide = plain.get_window_extent().width > figure.bbox.width
    plain.remove()
    legend = legend_below(figure, entries, 4)
    figure.draw_without_rendering()  # puts the texts into their places
    box = legend.get_window_extent()
    rows = {round(text.get_window_extent().y0) for text in legend.get_texts()}
    assert figure.legends == [legend] and len(legend.get_texts()) == names
    assert 0.0 <= box.x0 and box.x1 <= figure.bbox.width and box.y0 >= 0.0
    assert (len(rows) > -(-names // 4)) == wide == (words > 1)


@pytest.mark.parametrize("families", [False])
def test_families_frame_the_frequencies_and_an_impulsive_motion_far_below_is_counted(families):
    """Oracle: see `require_families_frame_the_frequencies_and_an_impulsive_motion_far_below_is_counted`."""
    require_families_frame_the_frequencies_and_an_impulsive_motion_far_below_is_counted(families)


def require_families_frame_the_frequencies_and_an_impulsive_motion_far_below_is_counted(families):
    """Oracle: the axis of the figure without the impulsive motions; a figure without families shows all of them."""
    curves = real.atlas().curves[:2] if families else ()
    data = replace(real.atlas(), curves=curves, manifold_frequency=np.append(real.atlas().manifold_frequency[:-1], 0.01))
    bare = replace(data, manifold_h=np.zeros(0), manifold_frequency=np.zeros(0), manifold_joined=np.zeros(0, dtype=bool))
    figure, other = atlas_figure(data, frequency="fundamental"), atlas_figure(bare, frequency="fundamental")
    low, high = panels_of(figure)["frequency"].get_ylim()
    outside = np.count_nonzero((data.manifold_frequency < low) | (data.manifold_frequency > high))
    (entry,) = [text.get_text() for text in figure.legends[0].get_texts() if text.get_text().startswith("impulsive motions")]
    assert ((low, high) == panels_of(other)["frequency"].get_ylim()) == families
    assert (outside > 0) == families == (f"{outside} of {len(data.manifold_h)} are outside" in entry)


def test_the_legend_of_everything_lies_in_the_picture():
    """Oracle: the renderer's box, with the regimes, the impulsive motions, and all types of special points."""
    curve = next(curve for curve in real.atlas().curves if curve.labels[-1] == "S11O00-")
    events = np.full(len(curve.h), "", dtype="<U2")
    events[np.searchsorted(curve.frequency, [6.0, 12.0, 18.0, 24.0])] = EVENTS
    data = replace(real.atlas(), curves=(replace(curve, events=events),), manifold_window="Blackman-Harris and a wider one")
    figure = atlas_figure(data, frequency="fundamental")
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert types_in_legend(figure) == set(EVENTS)
    assert 0.0 <= box.x0 and box.x1 <= figure.bbox.width and 0.0 <= box.y0
    assert box.y1 <= panels_of(figure)["frequency"].get_tightbbox().y0


def test_each_name_has_a_leader_to_its_curve():
    """Oracle: the ends of the leaders, which lie on the lines of the modes and at the names."""
    axes = panels_of(drawn_once("index"))["frequency"]
    leaders = np.array([line.get_xydata() for line in by_gid(axes, "leader")])
    names = [text for text in axes.texts if text.get_text().startswith("$\\mathrm{")]
    assert len(leaders) == len(names) > 5
    for label in ("L11+", "L11-"):
        (line,) = by_gid(axes, f"frequency-{label}")
        (end,) = [leader for leader in leaders if abs(leader[1, 1] / line.get_ydata()[0] - 1.0) < 1e-6]
        (text,) = [text for text in names if text.get_text() == short_name(label)]
        box = text.get_window_extent()
        tip = axes.transData.transform(end[0])
        assert box.x0 - 1 <= tip[0] <= box.x1 + 1 and box.y0 - 1 <= tip[1] <= box.y1 + 1


def test_cited_names_hide_no_curve_where_there_is_room():
    """Oracle: the drawn lines, half a point at a time, in the renderer's box of each name; at these energies all have room."""
    data = atlas_of(real.SYSTEM, real.families(), reference_points=PINS, energy=(0.05, 1.0))
    axes = panels_of(atlas_figure(data))["frequency"]
    axes.figure.draw_without_rendering()
    cited = {short_name(name) for name in PINS}
    assert sum(text.get_text() in cited for text in axes.texts) >= 4
    assert_names_off(along(line for line in axes.get_lines() if line.get_linestyle() != "None"), axes, cited)


def test_names_in_insets_count():
    """Oracle: the number asked for, and the texts of the picture and its insets."""
    figure = atlas_figure(real.atlas(), names=6, insets=[parse_inset(text) for text in INSETS])
    texts = {text.get_text() for panel in panels_of(figure).values() for text in panel.texts if "mathrm" in text.get_text()}
    count = int(figure.legends[0].get_title().get_text().split(" of ")[0])
    assert 1 < len({text for text in texts if "L11" not in text}) == count <= 6


@pytest.mark.parametrize("text", ["0.2:0.3,20:30", "1e+06:1e+07"])
def test_an_inset_without_anything_in_it(text):
    """Oracle: the message names it as it was given."""
    with pytest.raises(ValueError, match=re.escape(f"inset {text}: no family has a point there")):
        atlas_figure(real.atlas(), insets=[parse_inset(text)])


@pytest.mark.parametrize("text", ["3:1", "1", "1:2:3", "1:2,3", "a:b", "0:1", "1:2,3:4,5:6", "1:2,4:3"])
def test_an_inset_that_cannot_be(text):
    """Oracle: one line with what was received and expected."""
    with pytest.raises(ValueError, match="expected LO:HI") as caught:
        parse_inset(text)
    assert repr(text) in str(caught.value)


def test_bounds_of_regimes():
    """Oracle: the grazing energy of L11-, the events of the families; undecided bounds are reported; the legend says whose they are."""
    bounds, missing = regime_bounds(real.SYSTEM, real.families())
    breaking = next(event.h for event in real.families()[0].events if event.type == "SB")
    third = next(b for b in real.families() if any(alias["label"] == "S31O11+" for alias in b.aliases))
    impulsive = next(event.h for event in third.events if event.type == "IO")
    assert not missing
    np.testing.assert_allclose([bound.h for bound in bounds], [real.atlas().thresholds[1].h, breaking, impulsive], rtol=1e-14)
    assert [(bound.below, bound.above) for bound in bounds] == [("I", "II"), ("II", "III"), ("III", "IV")]
    figure = drawn_once("index")
    (legend,) = figure.legends
    assert any("ours, not the paper's" in text.get_text() for text in legend.get_texts())
    axes = panels_of(figure)["frequency"]
    for bound in bounds:
        (line,) = by_gid(axes, f"bound-{bound.below}-{bound.above}")
        assert set(line.get_xdata()) == {bound.h}
    assert {"I", "II", "III", "IV"} <= {text.get_text() for text in axes.texts}
    some, missing = regime_bounds(real.SYSTEM, real.families()[1:2])
    assert [bound.below for bound in some] == ["I"] and len(missing) == 2 and "S13O00+" in missing[0]


def test_start_velocities():
    """Oracle: the families' own columns, in the order absorber, primary."""
    data = real.atlas()
    panels = panels_of(drawn_once("velocities"))
    for k in (0, 1):
        axes = panels[f"velocity{k}"]
        lines = lines_of(axes, f"velocity{k}-")
        drawn = {tuple(p) for line in lines.values() for p in line.get_xydata()}
        assert all((h, v) in drawn for curve in data.curves for h, v in zip(curve.h, curve.velocities[:, k], strict=True))
        assert rf"\dot{{u}}_{{{k + 1}}}" in axes.get_ylabel() and axes.get_xscale() == "log"


@pytest.mark.parametrize("scale", [(1.0, 1.0)])
def test_the_impulsive_motions_among_start_velocities(scale):
    """Oracle: see `require_the_impulsive_motions_among_start_velocities`."""
    require_the_impulsive_motions_among_start_velocities(scale)


def require_the_impulsive_motions_among_start_velocities(scale):
    """Oracles: the energy, which is all that of the primary's velocity; the periodic impulsive orbits, which lie on the curve."""
    data = rescaled(real.atlas(), *scale)
    figure = drawn_once("velocities") if scale == (1.0, 1.0) else velocities_figure(data)
    panels = panels_of(figure)
    (sink,), (primary,) = (by_gid(panels[f"velocity{k}"], f"velocity{k}-manifold") for k in (0, 1))
    np.testing.assert_array_equal(sink.get_xydata(), np.stack([data.manifold_h, np.zeros(len(data.manifold_h))], axis=1))
    h, v = primary.get_xydata()[np.isfinite(primary.get_xydata()[:, 0])].T
    np.testing.assert_allclose(0.5 * real.SYSTEM.mass[1, 1] * v**2, h, rtol=1e-14)
    assert len(h) == 2 * len(data.manifold_h) and (v[: len(h) // 2] > 0.0).all() and (v[len(h) // 2 :] < 0.0).all()
    for star_h, star in zip(data.impulsive.h, data.impulsive.velocities, strict=True):
        assert abs(star[0]) < 1e-9 * abs(star[1])
        assert abs(np.interp(star_h, h[: len(h) // 2], v[: len(h) // 2]) / abs(star[1]) - 1.0) < 1e-2
    low, high = panels["velocity1"].get_ylim()
    assert low < v.min() and high > v.max()
    assert "impulsive motions" in {text.get_text() for text in figure.legends[0].get_texts()}
    bare = replace(data, manifold_h=np.zeros(0), manifold_frequency=np.zeros(0), manifold_joined=np.zeros(0, dtype=bool))
    assert not by_gid(panels_of(velocities_figure(bare))["velocity1"], "velocity1-manifold")


def test_scaling():
    """Oracle: energies by the square of clearance and frequency, velocities by their product, quarter periods by 1/frequency."""
    data = real.atlas()
    scaled = rescaled(data, 0.01, 20.0)
    for before, after in ((data.curves[3], scaled.curves[3]), (data.impulsive, scaled.impulsive)):
        np.testing.assert_allclose(after.h, 0.04 * before.h, rtol=1e-14)
        np.testing.assert_allclose(after.velocities, 0.2 * before.velocities, rtol=1e-14)
        np.testing.assert_allclose(after.alpha * after.frequency, before.alpha * before.frequency, rtol=1e-14)
        np.testing.assert_allclose(after.frequency_index, 20.0 * before.frequency_index, rtol=1e-14)
    np.testing.assert_allclose([mode.h for mode in scaled.thresholds], [0.04 * mode.h for mode in data.thresholds], rtol=1e-14)
    np.testing.assert_allclose([bound.h for bound in scaled.bounds], [0.04 * bound.h for bound in data.bounds], rtol=1e-14)
    title = atlas_figure(replace(scaled, curves=scaled.curves[:1])).get_suptitle()
    assert "clearance 0.01" in title and "20 rad/s" in title
    with pytest.raises(ValueError, match="above 0"):
        rescaled(data, -1.0)
    with pytest.raises(ValueError, match="already"):
        rescaled(scaled, 2.0)


def test_a_family_of_another_system_is_refused():
    """Oracle: the message names it."""
    from bvp.system import vibro_impact_nes

    with pytest.raises(ValueError, match="S13O00\\+ belongs to another system"):
        atlas_of(vibro_impact_nes(mu=0.2), real.families()[:1])


def test_a_range_of_energies_leaves_points_out_and_ends_families_at_its_bounds():
    """Oracle: the families' own points, and their orbits at the two bounds."""
    low, high = 0.3, 2.0
    data = atlas_of(real.SYSTEM, real.families(), energy=(low, high))
    for branch in real.families():
        mine = [curve for curve in data.curves if curve.family == branch.id]
        shown = np.concatenate([np.stack([curve.h, curve.alpha], axis=1) for curve in mine]) if mine else np.zeros((0, 2))
        points = np.stack([branch.points["h"], branch.points["alpha"]], axis=1)
        ends = [[orbit.h, orbit.alpha] for bound in (low, high) for orbit in branch.orbits_at(energy=bound)]
        wanted = np.array([*points[(points[:, 0] >= low) & (points[:, 0] <= high)], *ends]).reshape(-1, 2)
        assert len(shown) == len(wanted)
        order, other = np.lexsort(shown.T), np.lexsort(wanted.T)
        np.testing.assert_allclose(shown[order], wanted[other], rtol=1e-12)
    with pytest.raises(ValueError, match="nothing to draw: no family, no impulsive orbit has a point in the range"):
        atlas_figure(atlas_of(real.SYSTEM, real.families(), energy=(1e7, 1e8)))
    from_rest = replace(data.curves[0], velocities=np.full_like(data.curves[0].velocities, np.nan))
    with pytest.raises(ValueError, match="nothing to draw: velocities are those at zero displacement"):
        velocities_figure(replace(data, curves=(from_rest,)))


@pytest.mark.parametrize(("number", "steepest"), [(0, np.argmax), (1, np.argmin)])
def test_families_without_a_point_in_a_narrow_range_are_shown(number, steepest):
    """Oracle: the closed form of the backbones between two of their points, where energy rises and where it falls along the arclength."""
    branch = real.families()[number]
    k = int(steepest(np.diff(np.log(branch.points["h"]))))
    part = np.array([0.4, 0.6])
    met = branch.points["h"][k] ** (1 - part) * branch.points["h"][k + 1] ** part
    low, high = sorted(met)
    curves = atlas_of(real.SYSTEM, [branch], energy=(low, high)).curves
    curve = min(curves, key=lambda curve: abs(curve.alpha[0] - branch.points["alpha"][k]))  # above its fold a backbone has two
    np.testing.assert_allclose(curve.h, met, rtol=1e-13)
    np.testing.assert_allclose(backbone.energy(real.SYSTEM, curve.alpha), met, rtol=1e-11)
    figure = atlas_figure(atlas_of(real.SYSTEM, [branch], energy=(low, high)))
    left, right = figure.axes[0].get_xlim()
    assert left > 0.9 * low and right < 1.1 * high, "linear modes that graze at other energies widen the picture"


def test_an_orbit_of_another_family_does_not_end_one_at_a_bound(monkeypatch):
    """Oracle: the points of the family, where the corrector gives an orbit of the other backbone."""
    branch, other = real.families()[:2]
    (astray,) = [orbit for orbit in other.orbits_at(energy=2.0)]
    assert abs(astray.alpha - branch.orbit_at(energy=2.0).alpha) > 0.3
    monkeypatch.setattr(type(branch), "orbit_between", lambda *arguments, **asked: astray)
    (curve,) = atlas_of(real.SYSTEM, [branch], energy=(0.0, 2.0)).curves
    assert curve.h.tolist() == branch.points["h"][branch.points["h"] <= 2.0].tolist()


# ------------------------------------------------------------------------------------------------ data


def picture(data, draw=draw_atlas, kind="svg", **options):
    file = io.BytesIO()
    draw(data, file, format=kind, **options)
    return file.getvalue()


def draw_velocities(data, path, **options):
    write_figure(velocities_figure, path, data, **options)


@cache
def exported():
    """Families as data, and what draws them: of both kinds, scaled and not."""
    some = replace(real.atlas(), curves=real.atlas().curves[:8])
    ranged = rescaled(atlas_of(real.SYSTEM, real.families()[:3], energy=(0.5, 2.0)), 2.0)
    return (some, draw_atlas), (rescaled(some, 0.013, 7.7), draw_velocities), (ranged, draw_atlas)


def assert_same(one, other):
    """All fields of two objects are equal."""
    if is_dataclass(one):
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, tuple):
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    else:
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("kind", ["csv", "json", "npz", "mat"])
def test_exported_data_come_back(kind, tmp_path):
    """Oracle: every field of the data, to the last bit."""
    for data, _ in exported():
        write_atlas(data, tmp_path / f"data.{kind}")
        assert_same(data, read_atlas(tmp_path / f"data.{kind}"))


@pytest.mark.parametrize(("case", "kind"), [(2, "mat")])
def test_a_picture_drawn_from_its_exported_data_is_the_same(case, kind, tmp_path):
    """Oracle: see `require_a_picture_drawn_from_its_exported_data_is_the_same`."""
    require_a_picture_drawn_from_its_exported_data_is_the_same(case, kind, tmp_path)


def require_a_picture_drawn_from_its_exported_data_is_the_same(case, kind, tmp_path):
    """Oracle: the bytes of the pictures drawn from the families and from the file."""
    data, draw = exported()[case]
    write_atlas(data, tmp_path / f"data.{kind}")
    assert picture(read_atlas(tmp_path / f"data.{kind}"), draw) == picture(data, draw)


def test_tables_can_be_read_without_this_program(tmp_path):
    """Oracle: numpy's own reader of CSV, json, and scipy's of MAT files, against the families."""
    from scipy.io import loadmat

    data = real.atlas()
    for kind in ("csv", "json", "mat"):
        write_atlas(data, tmp_path / f"data.{kind}")
    table = np.genfromtxt(tmp_path / "data.csv", delimiter=",", names=True, dtype=None, encoding="utf-8", comments="#", skip_header=1)
    mine = table["family"] == data.curves[0].family
    np.testing.assert_array_equal(table["h"][mine], data.curves[0].h)
    np.testing.assert_array_equal(table["velocities2"][mine], data.curves[0].velocities[:, 1])
    columns = json.loads((tmp_path / "data.json").read_text())["columns"]
    assert columns["h"][: len(data.curves[0].h)] == data.curves[0].h.tolist()
    mat = loadmat(tmp_path / "data.mat")
    np.testing.assert_array_equal(mat["h"][: len(data.curves[0].h), 0], data.curves[0].h)
    assert mat["name"][0].rstrip() == data.curves[0].names[0]


def test_files_that_cannot_be_read(tmp_path):
    """Oracle: one line that names the file, and what is wrong with it."""
    good = tmp_path / "good.json"
    write_atlas(real.atlas(), good)
    record = json.loads(good.read_text())

    def refused(name, content, *said):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(ExportError) as caught:
            read_atlas(path)
        assert name in str(caught.value) and "\n" not in str(caught.value)
        for word in said:
            assert word in str(caught.value), str(caught.value)

    refused("a.json", good.read_text()[:1000])
    refused("b.json", json.dumps({**record, "schema": 7}), "schema", "7")
    refused("c.json", json.dumps({k: v for k, v in record.items() if k != "columns"}), "columns")
    refused("d.json", json.dumps({**record, "columns": {k: v for k, v in record["columns"].items() if k != "alpha"}}), "alpha")
    refused("e.json", json.dumps({**record, "columns": {**record["columns"], "h": [1.0]}}), "different lengths")
    refused("f.json", "[]")
    kinds = ["x" for _ in record["columns"]["kind"]]
    refused("k.json", json.dumps({**record, "columns": {**record["columns"], "kind": kinds}}), "unknown kind 'x'")
    refused("l.csv", "# {}\nh,alpha\n1\n", "different numbers of cells")
    refused("g.csv", "h,alpha\n1,2\n", "first line")
    refused("h.npz", b"nothing")
    refused("i.mat", b"nothing at all")
    refused("j.txt", "x", "csv, json, npz, mat")
    with pytest.raises(ExportError, match="cannot read"):
        read_atlas(tmp_path / "missing.csv")
    with pytest.raises(ExportError, match="nearest: csv"):
        write_atlas(real.atlas(), tmp_path / "data.cvs")
