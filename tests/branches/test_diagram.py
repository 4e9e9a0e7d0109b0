"""Pictures of branches and orbits, measured by matplotlib's own renderer. The drawn orbits are those of the closed form."""

from __future__ import annotations

import io
import sys
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks import backbone
from branches.figures.curves import curve_runs, draw_events
from branches.figures.room import Room, even_points, thinned
from branches.figures.single import branch_figure, orbit_figure, write_events
from branches.figures.style import family_text, figure_settings, limits_of, new_figure, set_axis, symbol_of, write_figure
from bvp.system import vibro_impact_nes

REFERENCE = vibro_impact_nes(0.1, 0.1)
energy = partial(backbone.energy, REFERENCE)
motion = partial(backbone.motion, REFERENCE)


def make_system(**changed):
    described = {"model": "vibro_impact_nes", "mu": 0.1, "sigma": 0.1, "lam": 0.0, "rho": 1.0}
    plain = {
        "coordinates": ("u1", "u2"),
        "absorber": 0,
        "primary": 1,
        "stops": (SimpleNamespace(gap=(1.0, -1.0), lower=-1.0, upper=1.0, name="a"),),
        "describe": lambda: described,
    }
    return SimpleNamespace(**{**plain, **changed})


def make_branch(alpha, stable=1, events=(), half_waves=1, system=None, label="S13O00+", **points):
    alpha = np.asarray(alpha, dtype=float)
    count = len(alpha)
    half_waves = np.broadcast_to(half_waves, count)
    given_points = {
        "h": energy(alpha),
        "alpha": alpha,
        "frequency": np.pi / 2 / alpha,
        "frequency_index": half_waves * (np.pi / 2 / alpha),
        "half_waves": half_waves,
        "stable": np.broadcast_to(np.asarray(stable, dtype=np.int8), count),
        "velocities": backbone.origin_velocity(REFERENCE, alpha),
        "start_u": np.zeros((count, 2)),
    }
    given_points.update(points)
    if "arclength" not in points:
        steps = np.hypot(np.diff(np.log(given_points["h"])), np.diff(np.log(alpha)))
        given_points["arclength"] = np.concatenate([[0.0], np.cumsum(steps)])
    made, number = [], {}
    for kind, i in events:
        number[kind] = number.get(kind, 0) + 1
        at = {key: given_points[key][i] for key in ("h", "alpha", "arclength")}
        made.append(SimpleNamespace(id=f"{kind}{number[kind]}", type=kind, point=i, criticality=None, **at))
    return SimpleNamespace(
        system=system or make_system(), ends=("origin", "stop+"), sequence="", label=label, points=given_points, events=made
    )


def make_orbit(alpha=1.7, **changed):
    plain = {
        "system": make_system(),
        "ends": ("origin", "stop+"),
        "sequence": "",
        "label": "S13O00+",
        "h": float(energy(np.array(alpha))),
        "alpha": alpha,
        "period": 4 * alpha,
        "impacts": [SimpleNamespace(time=alpha, stop="+", speed=1.0), SimpleNamespace(time=3 * alpha, stop="-", speed=1.0)],
        "sample": lambda times: motion(alpha, times),
        "stable": True,
        "quality": {"reliable": True},
    }
    return SimpleNamespace(**{**plain, **changed})


IN_PHASE = np.linspace(1.835, 1.6265, 300)  # from near the grazing of the in-phase mode to high energy


def in_phase():
    stable = np.where(np.arange(300) < 200, 1, 0)
    stable[200] = -1
    events = [("GR", 0), ("RT", 90), ("RT", 92), ("RT", 94), ("SB", 200), ("PD", 240), ("GR", 299), ("EP", 299)]
    return make_branch(IN_PHASE, stable, events)


def grazing_cluster():
    """Forty special points, most of them at one grazing, with two changes of m and all three kinds of stability."""
    count = 1200
    index = np.arange(count)
    events = [("GR", 0), ("SN", 0), ("LB", 0), ("BP", 1), ("RT", 2), ("PD", 3), ("SB", 4), ("IO", 5), ("NS", 6), ("GR", 7)]
    events += [("RT", int(k)) for k in np.linspace(10, 500, 14)]
    events += [("LB", 540), ("LB", 780), *(("PD", int(k)) for k in np.linspace(560, 1190, 12)), ("EP", count - 1)]
    half_waves = np.where(index < 540, 1, np.where(index < 780, 3, 2))
    return make_branch(np.linspace(1.835, 1.6265, count), (index // 150) % 3 - 1, events, half_waves)


def twelve_decades():
    count = 2000
    h = np.geomspace(1e-4, 1e8, count)
    velocities = np.stack([np.sqrt(h), -np.sqrt(h) / 3], axis=1)
    events = [("GR", 0), *(("SB", k) for k in range(100, 1980, 100)), ("EP", count - 1)]
    return make_branch(np.linspace(1.2, 0.02, count), (np.sin(np.arange(count) / 180) > 0), events, h=h, velocities=velocities)


def narrow():
    return make_branch(1.7 + np.linspace(0, 1e-7, 7), [1, 1, 1, 0, 0, -1, -1], [("SN", 3), ("SB", 3), ("EP", 6)])


def single():
    return make_branch([1.7], 0, [("EP", 0)])


def no_origin_start():
    system = make_system(absorber=None, primary=None, coordinates=("x", "hull_y"), describe=lambda: {"mass": [[1.0]]})
    start = np.stack([IN_PHASE, -(IN_PHASE**2)], axis=1)
    return make_branch(IN_PHASE, 1, [("GR", 0)], system=system, label="", start_u=start, velocities=np.full((300, 2), np.nan))


def one_coordinate():
    system = make_system(absorber=None, primary=None, coordinates=("x",), describe=lambda: {"mass": [[1.0]]})
    return make_branch(IN_PHASE, 0, [("GR", 0)], system=system, label="", velocities=np.sqrt(2 * energy(IN_PHASE))[:, None])


CASES = [in_phase, grazing_cluster, twelve_decades, narrow, single, no_origin_start, one_coordinate]


@cache
def drawn_once(case):
    """The branch and the figure of a case, which tests measure and do not change."""
    branch = case()
    return branch, branch_figure(branch)


@cache
def orbit_drawn():
    """The figure of an orbit of the closed form, which tests measure and do not change."""
    return orbit_figure(make_orbit())


@pytest.fixture(params=CASES, ids=lambda case: case.__name__)
def drawn(request):
    """(branch, figure) of each case."""
    return drawn_once(request.param)


def overlapping(boxes, others):
    """Which of some boxes (a, 4) overlap which of others (b, 4): bool (a, b). Touching edges do not overlap."""
    a, b = np.asarray(boxes)[:, None, :], np.asarray(others)[None, :, :]
    return (a[..., 0] < b[..., 2]) & (b[..., 0] < a[..., 2]) & (a[..., 1] < b[..., 3]) & (b[..., 1] < a[..., 3])


def panels_of(figure):
    """The axes of a figure by their labels."""
    return {axes.get_label(): axes for axes in figure.axes}


def by_gid(axes, gid):
    return [artist for artist in axes.get_lines() if artist.get_gid() == gid]


def ticks_outside(figure):
    """Texts of ticks outside the limits of their axis, which matplotlib does not draw."""
    out = []
    for axes in panels_of(figure).values():
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval() + 1e-9 * np.ptp(axis.get_view_interval()) * np.array([-1.0, 1.0])
            ticks = [tick for tick in axis.get_major_ticks() if not low <= tick.get_loc() <= high]
            out += [text for tick in ticks for text in (tick.label1, tick.label2)]
    return out


@cache
def text_boxes(figure, kind):
    """Texts and their boxes in points, as the png's renderer or as the one of vector pictures measures them: once for each figure, which
    no test changes afterwards."""
    from matplotlib.backends.backend_svg import RendererSVG
    from matplotlib.text import Text

    with figure_settings():
        figure.set_dpi(200 if kind == "png" else 72)
        figure.canvas.draw()
        size = figure.get_size_inches() * figure.dpi
        renderer = figure.canvas.get_renderer() if kind == "png" else RendererSVG(*size, io.StringIO(), image_dpi=72)
        outside = ticks_outside(figure)
        texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip() and t not in outside]
        boxes = np.array([t.get_window_extent(renderer).extents for t in texts]) * 72 / figure.dpi
        figure.set_dpi(200)
    return texts, boxes


def assert_texts_apart(figure, kind):
    """No text is smaller than 7 points, none overlaps another one, all lie in the figure."""
    texts, boxes = text_boxes(figure, kind)
    assert min(text.get_fontsize() for text in texts) >= 7.0
    hit = overlapping(boxes, boxes) & ~np.eye(len(boxes), dtype=bool)
    pairs = {tuple(sorted((texts[i].get_text(), texts[j].get_text()))) for i, j in np.argwhere(hit)}
    assert not pairs
    width, height = figure.get_size_inches() * 72
    assert (boxes >= -0.5).all() and (boxes[:, [0, 2]] <= width + 0.5).all() and (boxes[:, [1, 3]] <= height + 0.5).all()
    return texts, boxes


@pytest.mark.parametrize("kind", ["png"])
def test_no_two_texts_overlap_and_all_lie_in_the_figure(drawn, kind):
    """Oracle: see `require_no_two_texts_overlap_and_all_lie_in_the_figure`."""
    require_no_two_texts_overlap_and_all_lie_in_the_figure(drawn, kind)


def require_no_two_texts_overlap_and_all_lie_in_the_figure(drawn, kind):
    """Oracle: the text extents of the renderers of bitmaps and of vector pictures."""
    assert_texts_apart(drawn[1], kind)


def test_names_of_special_points_keep_off_markers_and_frames(drawn):
    """Oracle: text extents against each marker's box and the panel's box."""
    figure = drawn[1]
    texts, boxes = text_boxes(figure, "png")
    for axes in figure.axes:
        mine = [box for t, box in zip(texts, boxes, strict=True) if t in axes.texts]
        marks = [line for line in axes.get_lines() if "-events-" in (line.get_gid() or "")]
        if not mine:
            continue
        markers = []
        for line in marks:
            at = axes.transData.transform(line.get_xydata()) * 72 / 200
            markers += [np.concatenate([p - line.get_markersize() / 2, p + line.get_markersize() / 2]) for p in at]
        assert not overlapping(np.array(mine), np.array(markers)).any()
        frame = np.array(axes.get_window_extent().extents) * 72 / 200
        assert (np.array(mine)[:, :2] > frame[:2]).all() and (np.array(mine)[:, 2:] < frame[2:]).all()


def test_each_special_point_has_a_marker_on_the_curve_and_a_name_in_each_panel(drawn):
    """Oracle: the branch's own arrays at the events' points."""
    branch, figure = drawn
    index = np.array([event.point for event in branch.events], dtype=int)
    missing = 0
    for name, axes in panels_of(figure).items():
        marks = [line for line in axes.get_lines() if (line.get_gid() or "").startswith(f"{name}-events-")]
        assert sum(len(line.get_xdata()) for line in marks) == len(branch.events)
        drawn_at = np.concatenate([line.get_xydata() for line in marks])
        if name == "frequency":
            expected = np.stack([branch.points["h"][index], branch.points["frequency_index"][index]], axis=1)
            np.testing.assert_allclose(drawn_at[np.lexsort(drawn_at.T)], expected[np.lexsort(expected.T)], rtol=1e-13)
        names = {name for t in axes.texts for name in t.get_text().replace(",", " ").split()}
        for event in branch.events:
            in_crowd = [n for n in names if n.startswith(event.type) and "\N{EN DASH}" in n]
            ranges = [tuple(int(k) for k in n[len(event.type) :].split("\N{EN DASH}")) for n in in_crowd]
            number = int(event.id[len(event.type) :])
            missing += event.id not in names and not any(low <= number <= high for low, high in ranges)
    assert not missing and not figure.legends[0].get_title().get_text().strip()


def test_each_panel_shows_all_energies_on_a_logarithmic_axis_with_ticks(drawn):
    """Oracle: the branch's own energies; no panel is empty."""
    branch, figure = drawn
    for axes in figure.axes:
        low, high = axes.get_xlim()
        ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
        assert axes.get_xscale() == "log" and low < branch.points["h"].min() and branch.points["h"].max() < high
        assert 2 <= len(ticks) <= 15 and axes.lines


def test_the_index_breaks_where_m_changes_and_the_fundamental_does_not():
    """Oracle: m = 1, 3, 2 by hand: a piece begins at the last point of the one before, with its own m."""
    half_waves = np.repeat([1, 3, 2], [100, 80, 120])
    branch = make_branch(IN_PHASE, half_waves=half_waves)
    single = branch.points["frequency"]
    for frequency, pieces in (
        ("index", [(single[0], single[99]), (3 * single[99], 3 * single[179]), (2 * single[179], 2 * single[299])]),
        ("fundamental", [(single[0], single[299])]),
    ):
        axes = panels_of(branch_figure(branch, frequency=frequency))["frequency"]
        (line,) = by_gid(axes, "frequency-stable")
        drawn = np.split(line.get_ydata(), np.flatnonzero(np.isnan(line.get_ydata())))
        np.testing.assert_allclose([piece[np.isfinite(piece)][[0, -1]] for piece in drawn], pieces, rtol=1e-13)
        assert ("m" in axes.get_ylabel().split("$")[1]) == (frequency == "index")


def test_points_of_each_stability_are_on_the_lines_that_say_so(drawn):
    """Oracle: membership of each (h, frequency) in the drawn data; a solid line joins stable points only."""
    branch, figure = drawn
    axes = panels_of(figure)["frequency"]
    at = np.stack([branch.points["h"], branch.points["frequency_index"]], axis=1)
    stable = np.asarray(branch.points["stable"]).astype(int)
    on = {}
    for code, name in ((1, "stable"), (0, "unstable"), (-1, "undecided")):
        lines = by_gid(axes, f"frequency-{name}")
        on[code] = {tuple(p) for line in lines for p in line.get_xydata() if np.isfinite(p).all()}
        if code == 0 and (stable == 0).any():
            crosses = by_gid(axes, "frequency-unstable-crosses") + by_gid(axes, "frequency-unstable-single")
            assert sum(len(line.get_xdata()) for line in crosses) > 0
    lone = (stable == -1) & (np.append(stable[1:], 0) != -1) & (np.append(0, stable[:-1]) != -1) & (len(stable) > 1)
    for point, code, alone in zip(map(tuple, at), stable, lone, strict=True):
        assert alone or point in on[code]
        assert code != 0 or point not in on[1]


def test_crosses_of_unstable_intervals_do_not_merge():
    figure = branch_figure(make_branch(np.concatenate([IN_PHASE, IN_PHASE[::-1]]), 0))
    axes = panels_of(figure)["frequency"]
    (crosses,) = by_gid(axes, "frequency-unstable-crosses")
    at = axes.transData.transform(crosses.get_xydata()) * 72 / figure.dpi
    apart = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)) + 1e9 * np.eye(len(at))
    assert len(at) > 20 and apart.min() > crosses.get_markersize()


def test_frequencies_over_decades_get_a_logarithmic_axis():
    """Oracle: a rise from 1.3 to 79 is shown in decades, a single value evenly."""
    assert panels_of(drawn_once(twelve_decades)[1])["frequency"].get_yscale() == "log"
    assert panels_of(drawn_once(single)[1])["frequency"].get_yscale() == "linear"


def test_start_velocities_are_those_of_absorber_and_primary():
    """Oracle: closed form; the coordinates' order in the system does not matter."""
    branch, figure = drawn_once(in_phase)
    panels = panels_of(figure)
    for name, k, text in (("start0", 0, r"\dot{u}_{1}"), ("start1", 1, r"\dot{u}_{2}")):
        line = by_gid(panels[name], f"{name}-stable")[0]
        assert np.isin(branch.points["velocities"][:200, k], line.get_ydata()).all()
        assert text in panels[name].get_ylabel()
    swapped = make_branch(IN_PHASE, system=make_system(absorber=1, primary=0, coordinates=("u2", "u1")))
    assert [axes.get_label() for axes in branch_figure(swapped).axes] == ["frequency", "start1", "start0"]


def test_without_a_start_at_zero_displacement_the_panels_show_displacements_and_say_so():
    branch, figure = drawn_once(no_origin_start)
    panels = panels_of(figure)
    for name, k in (("start0", 0), ("start1", 1)):
        assert np.isin(branch.points["start_u"][:, k], by_gid(panels[name], f"{name}-stable")[0].get_ydata()).all()
        assert "start displacement" in panels[name].get_ylabel() and "no start" in panels[name].get_ylabel()


def test_more_names_than_room_are_counted_in_the_picture():
    """Forty special points of seven types in a panel of 1.6 by 1.1 inches: the names that fit stay apart; the rest is said."""
    with figure_settings():
        figure = new_figure(1.7)
        figure.set_size_inches(2.2, 1.7)
        axes = figure.subplots(subplot_kw={"xticks": [], "yticks": [], "xlim": (0, 1), "ylim": (0, 1), "xlabel": "energy"})
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        kinds = [("SN", "BP", "SB", "PD", "RT", "NS", "GR")[k % 7] for k in range(40)]
        x, y = np.linspace(0.05, 0.95, 40), 0.5 + 0.4 * np.sin(np.arange(40.0))
        places = np.stack([x, y], axis=1)
        draw_events(axes, kinds, places, "small")
        left_out = write_events(Room(axes, [places]), [f"{kind}{k}" for k, kind in enumerate(kinds)], kinds, places)
    assert_texts_apart(figure, "svg")
    written = sum(1 for t in axes.texts if t.get_text())
    assert 5 < written < 40
    assert left_out == (40 - written, 40) and axes.get_xlabel() == "energy"


def test_a_picture_says_below_how_many_names_have_no_room(monkeypatch):
    monkeypatch.setattr("branches.figures.single.write_events", lambda *arguments: (2, 9))
    (legend,) = branch_figure(make_branch(IN_PHASE, events=[("SN", 40)])).legends
    assert legend.get_title().get_text() == "6 of 27 names have no room"


def test_title_names_the_family_and_the_system():
    title = drawn_once(in_phase)[1].get_suptitle()
    assert r"\mathrm{S13O00}^{+}" in title and r"\mu = 0.1" in title and r"\sigma = 0.1" in title
    assert family_text("", ("rest", "stop+"), "+-") == "rest to stop+, sequence +\N{MINUS SIGN}"
    assert len(family_text("", ("rest", "stop+"), "+-" * 200)) < 80
    assert symbol_of("a$b") == r"\mathrm{a\$b}"


@pytest.mark.parametrize(("name", "magic", "draw", "data"), [("picture.png", b"\x89PNG\r\n\x1a\n", branch_figure, single())])
def test_files_are_of_their_format_and_the_same_with_any_settings_of_the_user(tmp_path, name, magic, draw, data):
    """Oracle: see `require_files_are_of_their_format_and_the_same_with_any_settings_of_the_user`."""
    require_files_are_of_their_format_and_the_same_with_any_settings_of_the_user(tmp_path, name, magic, draw, data)


def require_files_are_of_their_format_and_the_same_with_any_settings_of_the_user(tmp_path, name, magic, draw, data):
    """Oracle: the formats' first bytes; two runs byte by byte, one of them with other settings, which stay."""
    import matplotlib

    first, second = tmp_path / f"a{name}", tmp_path / f"b{name}"
    write_figure(draw, first, data)
    with matplotlib.rc_context({"font.size": 31.0, "lines.linewidth": 9.0, "axes.facecolor": "red"}):
        write_figure(draw, second, data)
        assert matplotlib.rcParams["font.size"] == 31.0
    assert first.read_bytes().startswith(magic)
    assert first.read_bytes() == second.read_bytes()
    assert sorted(p.name for p in tmp_path.glob("*part")) == []


EMPTY = make_branch([1.7])
EMPTY.points = {key: values[:0] for key, values in EMPTY.points.items()}
NEGATIVE = make_branch([1.7, 1.75, 1.8], h=np.array([1.0, -1.0, 2.0]), arclength=np.arange(3.0))
REFUSED = [
    (single(), "picture.jpg", {}, "png, pdf or svg"),
    (single(), "picture", {}, "png, pdf or svg"),
    (single(), io.BytesIO(), {}, "png, pdf or svg"),
    (single(), "old.png", {"format": "gif"}, "'gif'.*png, pdf or svg"),
    (single(), "old.png", {"frequency": "angular"}, "'angular': expected index or fundamental"),
    (NEGATIVE, "old.png", {}, "positive values: the lowest is -1"),
    (EMPTY, "old.png", {}, "no points"),
]


@pytest.mark.parametrize(("branch", "target", "options", "said"), REFUSED, ids=[said for *_, said in REFUSED])
def test_what_cannot_be_drawn_is_refused_in_one_line_and_leaves_the_old_file(tmp_path, branch, target, options, said):
    path = tmp_path / "old.png"
    path.write_bytes(b"old")
    with pytest.raises(ValueError, match=said) as caught:
        write_figure(branch_figure, tmp_path / target if isinstance(target, str) else target, branch, **options)
    assert "\n" not in str(caught.value) and path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["old.png"]


def test_drawing_leaves_pyplot_alone(monkeypatch):
    """Oracle: Python's import, which fails for a module that is None."""
    import matplotlib

    monkeypatch.delattr(matplotlib, "pyplot", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ImportError):
        from matplotlib import pyplot  # noqa: F401
    write_figure(orbit_figure, io.BytesIO(), make_orbit(), format="png")


def test_orbit_panels_show_the_closed_form_with_sharp_kinks():
    """Oracle: closed form at alpha = 1.7; impacts at alpha and 3 alpha, where |u1 - u2| = 1 to rounding."""
    alpha = 1.7
    panels = panels_of(orbit_drawn())
    (gap,) = by_gid(panels["stop0"], "gap-a")
    times, values = gap.get_data()
    assert times[0] == 0.0 and times[-1] == 4 * alpha and panels["stop0"].get_xlim() == (0.0, 4 * alpha)
    u, _ = motion(alpha, times)
    np.testing.assert_allclose(values, u[:, 0] - u[:, 1], rtol=0, atol=1e-15)
    assert {alpha, 3 * alpha} <= set(times)
    assert abs(values[times == alpha][0] - 1) < 1e-13 and abs(values[times == 3 * alpha][0] + 1) < 1e-13
    for k in range(2):
        (line,) = by_gid(panels["displacement"], f"displacement-{k}")
        np.testing.assert_array_equal(line.get_ydata(), u[:, k])
        (marks,) = by_gid(panels["displacement"], f"displacement-{k}-impacts")
        np.testing.assert_array_equal(marks.get_xdata(), [alpha, 3 * alpha])


def test_the_configuration_plane_says_where_its_axes_differ_in_scale():
    """Oracle: limits and size of the panel: at high energy one coordinate moves far less than the other."""
    for figure, differ in ((orbit_drawn(), False), (orbit_figure(make_orbit(0.5)), True)):
        figure.draw_without_rendering()
        panel = panels_of(figure)["plane"]
        length = np.array([np.ptp(panel.get_xlim()), np.ptp(panel.get_ylim())]) / panel.get_window_extent().size
        assert bool(length.max() / length.min() > 1.05) is differ is ("scales" in panel.get_xlabel())


def test_orbit_walls_stand_at_one_and_minus_one():
    """Oracle: |u1 - u2| = 1, in the gap's panel and as two lines over the whole configuration plane."""
    figure = orbit_drawn()
    figure.draw_without_rendering()
    panels = panels_of(figure)
    assert sorted(line.get_ydata()[0] for line in by_gid(panels["stop0"], "gap-a-wall")) == [-1.0, 1.0]
    walls = [line.get_xydata() for line in by_gid(panels["plane"], "plane-wall-a")]
    assert sorted(round(float(x - y), 12) for wall in walls for x, y in wall) == [-1.0, -1.0, 1.0, 1.0]
    (left, right), (bottom, top) = panels["plane"].get_xlim(), panels["plane"].get_ylim()
    for wall in walls:
        assert (wall.min(axis=0) < [left, bottom]).all() and (wall.max(axis=0) > [right, top]).all()
    shaded = [patch.get_path() for patch in panels["plane"].patches]
    for point, behind in (((0.9, 0.0), 0), ((1.1, 0.0), 1), ((-1.1, 0.0), 1), ((0.0, 1.2), 1)):
        assert sum(path.contains_point(point) for path in shaded) == behind
    (start,) = by_gid(panels["plane"], "plane-start")
    np.testing.assert_allclose(start.get_xydata(), [[0.0, 0.0]], atol=1e-14)
    size = panels["plane"].get_window_extent().size
    assert (right - left) / size[0] == pytest.approx((top - bottom) / size[1], rel=0.02)  # one scale on both axes
    assert_texts_apart(figure, "svg")
    assert_texts_apart(figure, "png")


def test_orbit_title_says_stability_and_its_quality():
    for stable, words in ((True, "  stable"), (False, "unstable"), (None, "undecided"), (-1, "undecided")):
        assert words in orbit_figure(make_orbit(stable=stable)).get_suptitle()
    title = orbit_figure(make_orbit(quality={"reliable": False})).get_suptitle()
    assert "not reliable" in title and "h = 0.58874813" in title and r"\alpha = 1.7" in title


def test_impacts_are_marked_at_their_own_stop_and_far_walls_are_named():
    """Three coordinates, two stops: only stop a is hit, by a triangle wave; stop b has one wall, stop a's gap is x1."""

    def sample(times):
        t = np.asarray(times, dtype=float)
        wave = 2 * np.abs((t % 2) - 1) - 1
        return np.stack([wave, np.sin(np.pi * t / 4), 0.2 * np.cos(np.pi * t / 4)], axis=1), np.zeros((len(t), 3))

    stops = (
        SimpleNamespace(gap=(1.0, 0.0, 0.0), lower=-1.0, upper=1.0, name="a"),
        SimpleNamespace(gap=(0.0, 1.0, -1.0), lower=-np.inf, upper=50.0, name="b"),
    )
    system = make_system(coordinates=("x1", "x2", "y"), absorber=None, primary=None, stops=stops, describe=lambda: {"mass": [[1.0]]})
    hits = [SimpleNamespace(time=float(k), stop="a-" if k % 2 else "a+", speed=1.0) for k in range(8)]
    figure = orbit_figure(make_orbit(2.0, system=system, sample=sample, impacts=hits, label="", sequence="a+a-"))
    panels = panels_of(figure)
    (marks,) = by_gid(panels["stop0"], "gap-a-impacts")
    np.testing.assert_allclose(marks.get_ydata(), [1.0, -1.0] * 4)
    assert not by_gid(panels["stop1"], "gap-b-impacts") and not by_gid(panels["stop1"], "gap-b-wall")
    assert "wall at 50" in panels["stop1"].get_title(loc="right")
    assert {line.get_gid() for line in panels["plane"].get_lines()} >= {"plane-wall-a"}
    assert not by_gid(panels["plane"], "plane-wall-b")
    assert_texts_apart(figure, "png")


def test_one_degree_of_freedom_gets_its_phase_plane():
    """x = -cos(t - T/2) up to the wall at x = d: the velocity's jump there is drawn from side to side."""
    period = 1.6 * np.pi
    wall = -np.cos(period / 2)

    def sample(times):
        t = np.asarray(times, dtype=float) % period - period / 2
        return -np.cos(t)[:, None], np.sin(t)[:, None]

    system = make_system(
        coordinates=("x",),
        stops=(SimpleNamespace(gap=(1.0,), lower=-np.inf, upper=wall, name="a"),),
        absorber=None,
        primary=None,
    )
    hits = [SimpleNamespace(time=0.0, stop="+", speed=1.0)]
    panels = panels_of(orbit_figure(make_orbit(period / 4, system=system, sample=sample, impacts=hits)))
    (line,) = by_gid(panels["plane"], "plane-orbit")
    speed = np.sin(period / 2)
    assert line.get_ydata().max() == pytest.approx(1.0, abs=1e-5)
    touching = line.get_ydata()[np.abs(line.get_xdata() - wall) < 1e-9]
    assert touching.min() == pytest.approx(-speed, abs=1e-9) and touching.max() == pytest.approx(speed, abs=1e-9)
    np.testing.assert_allclose(by_gid(panels["plane"], "plane-wall-a")[0].get_xdata(), wall)


coordinates = st.floats(5, 195, allow_nan=False)
spots = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=14)


CROWDED = [(5, 5), (14, 35), (5, 152), (5, 166), (13, 54), (22, 5), (155, 136), (5, 21), (38, 5), (5, 44), (5, 92)]


@settings(max_examples=10, deadline=None)
@given(spots, st.booleans())
@example(CROWDED, True)
def test_names_overlap_nothing(points, squeezed):
    """Oracle: the renderer's boxes, on random points; squeezed: all of them in one corner. Nearer points share a text (`crowds`), so that
    here, as in a figure, every name has room."""
    places = np.array(points) * (0.2 if squeezed else 1.0) + 10
    places = places[thinned(places, 2.5)]
    with figure_settings():
        figure = new_figure(3.5)
        axes = figure.add_axes((0.05, 0.05, 0.9, 0.9), xlim=(0.0, 230.0), ylim=(0.0, 230.0))
        room = Room(axes, [])
        room.take(room.to_page(places), 3.0)
        texts = room.write([f"name {k}" for k in range(len(places))], room.to_page(places), 3.0, far=150.0)
        scale = 72 / figure.dpi
        boxes = np.array([text.get_window_extent().extents for text in texts if text]) * scale
        markers = np.concatenate([room.to_page(places) - 3, room.to_page(places) + 3], axis=1)
    assert len(boxes) == len(places)
    assert not (overlapping(boxes, boxes) & ~np.eye(len(boxes), dtype=bool)).any()
    assert not overlapping(boxes, markers).any()
    assert (boxes[:, :2] >= room.frame[:2]).all() and (boxes[:, 2:] <= room.frame[2:]).all()
    leaders = by_gid(axes, "leader")
    ends = np.array([line.get_xydata()[1] for line in leaders]).reshape(-1, 2)
    named = places[[text is not None for text in texts]]
    assert all(np.hypot(*(named - end).T).min() < 1e-6 for end in ends) and len(ends) == len(boxes)
    for line in leaders:
        path = even_points(room.to_page(line.get_xydata()), 0.2)
        inside = (path[:, None] > boxes[None, :, :2] + 0.1).all(axis=-1) & (path[:, None] < boxes[None, :, 2:] - 0.1).all(axis=-1)
        assert not inside.any()


def test_even_points_and_thinning():
    """Oracle: two sides of a square, measured; the gap between them is not crossed."""
    path = np.array([[0.0, 0.0], [10.0, 0.0], [np.nan, np.nan], [100.0, 0.0], [100.0, 10.0]])
    np.testing.assert_allclose(even_points(path, 4.0), [[2, 0], [6, 0], [100, 0], [100, 4], [100, 8]], atol=1e-12)
    assert thinned(np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0], [3.5, 2.0]]), 2.5).tolist() == [True, False, True, False]


def test_a_name_without_any_room_is_left_out(capsys):
    """Oracle: a panel smaller than the name; nothing is printed."""
    with figure_settings():
        figure = new_figure(1.0)
        axes = figure.add_axes((0.0, 0.0, 0.05, 0.1))
        assert Room(axes, []).write(["a long name"], np.array([[5.0, 5.0]])) == [None]
    assert not axes.texts and not axes.lines and capsys.readouterr() == ("", "")


def test_runs_are_stable_only_where_both_ends_are():
    """Oracle: by hand. A single undecided point (an event) takes each neighbour's side; two of them are an interval."""
    x = np.arange(9.0)
    points = np.stack([x, x], axis=1)
    runs = curve_runs(points, np.array([1, 1, -1, 0, 0, -1, -1, 1, 1]))
    assert [np.nan_to_num(runs[code][:, 0], nan=-1.0).tolist() for code in (1, 0, -1)] == [
        [0.0, 1.0, 2.0, -1.0, 7.0, 8.0],
        [2.0, 3.0, 4.0],
        [4.0, 5.0, 6.0, 7.0],
    ]
    lone = curve_runs(np.insert(points[:3], [1, 2], np.nan, axis=0), np.array([1, 0, 0, 0, 1]))
    assert lone[0].tolist() == [[1.0, 1.0]]


@settings(max_examples=40, deadline=None)
@given(st.floats(-8, 8), st.floats(-7, 1.08), st.integers(3, 14), st.booleans())
def test_every_axis_has_ticks_with_different_texts(exponent, width, count, log):
    """Oracle: two ticks or more inside the limits, at most about as many as asked for, all with their own text."""
    low = 10.0**exponent
    limits = (low, low * (1 + 10.0**width))
    figure = new_figure(2.0)
    axes = figure.subplots()
    for which in "xy":
        set_axis(axes, which, limits, count, "energy", "h", log=log)
    for axis in (axes.xaxis, axes.yaxis):
        shown = [text for text, at in zip(axis.get_ticklabels(), axis.get_ticklocs(), strict=True) if limits[0] <= at <= limits[1]]
        shown = [text.get_text() for text in shown]
        assert axis.get_view_interval().tolist() == list(limits) and axis.get_label_text() == "energy $h$"
        assert 2 <= len(shown) == len(set(shown)) <= 3 * count and all(shown)


def test_limits_have_a_margin_and_are_never_of_zero_width():
    """Oracle: by hand."""
    np.testing.assert_allclose(limits_of(np.array([1.0, 3.0, np.nan]), 0.1), (0.8, 3.2))
    np.testing.assert_allclose(limits_of(np.array([1.0, 100.0]), 0.5, log=True), (0.1, 1000.0))
    np.testing.assert_allclose(limits_of(np.full(3, 2.0)), (1.9, 2.1))
    assert limits_of(np.zeros(2)) == limits_of(np.full(1, np.nan)) == (-1.0, 1.0)
    with pytest.raises(ValueError, match="the lowest is 0"):
        limits_of(np.array([0.0, 1.0]), log=True)
