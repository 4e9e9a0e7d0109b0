"""The picture of a motion, measured by matplotlib's own renderer, and drawn again from its files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text

import saltus
from branches.catalogue import Catalogue
from branches.figures.atlas_data import atlas_of
from branches.figures.data import ExportError, read_atlas, write_atlas
from branches.figures.room import short_name
from branches.figures.style import write_figure
from bvp.forcing import Harmonic
from bvp.simulate import simulate
from tests.branches.test_diagram import assert_texts_apart
from tests.branches.traced import traced
from tests.transitions.motions import of_run, synthetic
from transitions.families import families_of
from transitions.figure import draw_transition, gradual_energy, over_energy, shown_spectrum, transition_figure
from transitions.frequencies import decompose
from transitions.record import SampledMotion, sampled
from transitions.sharing import sharing_of
from transitions.spectrum import Wavelet
from transitions.stage import Leaving, StartFamily
from transitions.stages import stages_of
from transitions.transition import Transition, atlas_behind, read_transition, write_transition

DAMPED = saltus.vibro_impact_nes(mu=0.1, sigma=0.1, lam=0.02, rho=0.9)
GAP = (1.0, -1.0)


@pytest.fixture(scope="module")
def drawn(small_scene):
    """A damped motion from an impulse, with its stages, the families behind it, and its figure."""
    record = of_run(DAMPED, [0.0, 0.0], [0.0, 2.0], 250.0)
    with Catalogue(small_scene[0]) as catalogue:
        transition = Transition(DAMPED, record, GAP, (), Wavelet(), (0.4, 6.0))
        transition = replace(transition, stages=tuple(stages_of(record, GAP, families_of(catalogue), spectrum=transition.spectrum)))
        atlas = atlas_behind(transition, catalogue)
    return transition, atlas, transition_figure(transition, atlas)


def by_gid(figure, name):
    (found,) = figure.findobj(lambda artist: artist.get_gid() == name)
    return found


@pytest.mark.parametrize("long", [False])
def test_no_two_texts_of_a_panel_overlap_and_all_lie_in_the_figure(drawn, long):
    """Oracle: see `require_no_two_texts_of_a_panel_overlap_and_all_lie_in_the_figure`."""
    require_no_two_texts_of_a_panel_overlap_and_all_lie_in_the_figure(drawn, long)


def require_no_two_texts_of_a_panel_overlap_and_all_lie_in_the_figure(drawn, long):
    """Oracle: the renderer's own boxes of all texts that are drawn, also where stages follow families with long ids."""
    transition, atlas, figure = drawn
    if long:
        followed = next(stage.follows for stage in transition.stages if stage.follows is not None)
        name = replace(followed, label="", family="stop+-stop+:-+-+-+-:9bba7e7f", harmonic=8, harmonics=(3, 7, 8), others=("another",))
        stages = [replace(stage, follows=name) for stage in transition.stages]
        panels = [figure.axes[k].get_position().height * figure.get_figheight() for k in range(5)]
        figure = transition_figure(replace(transition, stages=stages), atlas)
        figure.draw_without_rendering()
        assert [figure.axes[k].get_position().height * figure.get_figheight() for k in range(5)] == pytest.approx(panels, rel=0.05)
    assert_texts_apart(figure, "png")


@pytest.mark.rounding
@pytest.mark.parametrize(("speed", "words"), [(0.0, "of what came in"), (0.1, "of the start")])
def test_what_a_load_brings_in_is_dissipated_within_the_panel(speed, words):
    """Oracles: shares of what came in end at what `saltus run` tells; shares of a small start exceed 100 % and are all to be seen."""
    system = replace(DAMPED, damping=DAMPED.damping + 0.1 * np.eye(2))
    shared = sharing_of(system, (0,), (1,))
    motion = simulate(system, [0.0, 0.0], [0.0, speed], 60.0, forces=Harmonic(0.9, cosine=[0.0, 1.0]), dampers=shared.dampers)
    figure = transition_figure(Transition(system, sampled(motion, shared), GAP, (), Wavelet(), (0.5, 6.0)))
    line = by_gid(figure, "lost-both")
    spent = float(motion.totals[:-1].sum())
    whole = motion.initial_energy if speed else motion.initial_energy + motion.work
    assert line.get_ydata()[-1] == pytest.approx(100.0 * spent / whole, rel=1e-9)
    assert line.get_ydata().max() <= line.axes.get_ylim()[1] and words in line.axes.get_ylabel()
    assert figure.get_suptitle().startswith("Motion from energy" if speed else "Motion from rest")


def test_lines_show_the_record(drawn):
    """Oracle: the columns of the record; the line of a sum lies below those of its parts and is twice as wide."""
    transition, _, figure = drawn
    record = transition.record
    for k, name in enumerate(("u1", "u2")):
        line = by_gid(figure, f"series-{name}")
        np.testing.assert_allclose(np.interp(line.get_xdata(), record.times, record.displacements[:, k]), line.get_ydata(), atol=1e-12)
    start = record.energy[0]
    both = by_gid(figure, "lost-both")
    assert both.get_ydata()[-1] == pytest.approx(100.0 * (record.dissipated_nes[-1] + record.dissipated_lo[-1]) / start, abs=0.1)
    parts = [by_gid(figure, f"lost-{name}") for name in ("sink", "oscillator")]
    # Edges of the sum show where one part is all of it.
    assert all(both.get_linewidth() >= 2.0 * part.get_linewidth() and both.get_zorder() <= part.get_zorder() for part in parts)
    for name, energy in (("sink", record.nes_energy), ("oscillator", record.lo_energy)):
        np.testing.assert_allclose(by_gid(figure, f"share-{name}").get_ydata(), 100.0 * energy / record.energy, rtol=1e-12)
    np.testing.assert_allclose(by_gid(figure, "total-energy").get_ydata() + both.get_ydata(), 100.0, atol=1e-9)
    assert by_gid(figure, "families-stable") is not None and by_gid(figure, "spectrum-cone") is not None


def test_a_window_shows_its_times_and_their_energies(drawn):
    """Oracles: the record within the window; the full figure has the same amplitudes at these times. Texts do not overlap."""
    transition, atlas, figure = drawn
    record, window = transition.record, (40.0, 90.0)
    close = transition_figure(transition, atlas, window=window)
    assert_texts_apart(close, "png")
    inside = (record.times >= 40.0) & (record.times <= 90.0)
    times, energies = [axes for axes in close.axes if axes.get_xlabel().startswith("time")], record.energy[inside]
    assert len(times) == 4 and all(axes.get_xlim() == window for axes in times)
    (families,) = (axes for axes in close.axes if axes.get_xlabel().startswith("energy"))
    low, high = families.get_xlim()
    assert low <= energies.min() and energies.max() <= high and high / low < 1.2 * energies.max() / energies.min()
    letters = [text for text, stage in zip("ABCDEFGH", transition.stages, strict=False) if stage.end > 40.0 and stage.start < 90.0]
    below = [text.get_text() for text in close.legends[0].get_texts()]
    assert [text[0] for text in below] == letters and len(letters) < len(transition.stages)
    part = shown_spectrum(transition)
    columns = (part.times >= 40.0) & (part.times <= 90.0)
    assert by_gid(close, "spectrum").get_clim()[1] == part.amplitudes[:, columns].max() <= by_gid(figure, "spectrum").get_clim()[1]
    with pytest.raises(ValueError, match="the motion lasts from 0 to 250: too little of it is between 300 and 310"):
        transition_figure(transition, atlas, window=(300.0, 310.0))


def test_empirical_modes_have_panels_of_their_own(drawn):
    """Oracle: the modes themselves, of which the strongest four are drawn; texts do not overlap."""
    pytest.importorskip("PyEMD")
    transition, atlas, _ = drawn
    record = transition.record
    modes = decompose(record.times, record.along(GAP)[0])
    figure = transition_figure(transition, atlas, modes=modes)
    assert_texts_apart(figure, "png")
    size = np.sum(modes.functions**2, axis=1)
    drawn_modes = [k for k in range(len(size)) if figure.findobj(lambda artist, k=k: artist.get_gid() == f"emd-{k}")]
    assert len(drawn_modes) == min(4, len(size)) and sorted(size)[-len(drawn_modes) :] == sorted(size[drawn_modes])
    for k in drawn_modes:
        np.testing.assert_array_equal(by_gid(figure, f"emd-{k}").get_ydata(), modes.functions[k])
        rate, strong = by_gid(figure, f"emd-rate-{k}").get_ydata(), modes.amplitudes[k] >= 0.1 * modes.amplitudes[k].max()
        np.testing.assert_array_equal(rate[strong], modes.frequencies[k][strong])
        assert np.isnan(rate[~strong]).all()


def test_the_spectrum_over_the_energy_stands_where_the_motion_is(drawn):
    """Oracle: the energy axis spans the motion's energies, and the ridge of its last stage lies at its frequency and energy."""
    transition, _, figure = drawn
    mesh = by_gid(figure, "families-spectrum")
    last = transition.stages[-1]
    edges, rows = mesh.get_coordinates()[0, :, 0], mesh.get_coordinates()[:, 0, 1]
    energy = transition.record.energy
    assert edges[0] < energy.min() and edges[-1] > energy.max() and edges[-1] / edges[0] < 2.0 * energy.max() / energy.min()
    values = np.ma.filled(mesh.get_array(), np.nan)
    middle = np.exp(np.mean(np.log(last.energies)))
    column = np.searchsorted(edges, middle) - 1
    best = np.nanargmax(values[:, column])
    assert rows[best] / 1.03 < last.frequency < rows[best + 1] * 1.03


def test_amplitudes_over_energy_are_the_largest_there_and_between_what_is_passed():
    """Oracle: by hand: three times in one interval, an impact that passes two intervals, and one where the motion never is."""
    edges = np.exp(np.arange(7.0))
    energies = np.exp([5.5, 5.2, 5.8, 2.5])
    found = over_energy(energies, np.array([[1.0, 4.0, 2.0, 6.0]]), edges)
    part = (5.8 - np.array([3.5, 4.5])) / (5.8 - 2.5)
    np.testing.assert_allclose(found[0], [np.nan, np.nan, 6.0, *(2.0 + 4.0 * part), 4.0])


@pytest.mark.parametrize("suffix", ["json", "npz", "mat"])
def test_the_picture_is_drawn_again_from_its_files(drawn, suffix, tmp_path):
    """Oracle: see `require_the_picture_is_drawn_again_from_its_files`."""
    require_the_picture_is_drawn_again_from_its_files(drawn, suffix, tmp_path)


def require_the_picture_is_drawn_again_from_its_files(drawn, suffix, tmp_path):
    """Oracle: the bytes."""
    transition, atlas, _ = drawn
    start = StartFamily("a:b:c", "S95E22-", "S75E22-", 3.5, 1, Leaving(2, 3.5, "+", "-"))
    transition = replace(transition, start=start if suffix in ("json", "mat") else None)
    write_transition(transition, tmp_path / f"motion.{suffix}")
    write_atlas(atlas, tmp_path / f"families.{suffix}")
    again, behind = read_transition(tmp_path / f"motion.{suffix}"), read_atlas(tmp_path / f"families.{suffix}")
    assert (again.stages, again.start) == (transition.stages, transition.start)
    for name in ("times", "displacements", "energy", "impacts"):
        np.testing.assert_array_equal(getattr(again.record, name), getattr(transition.record, name))
    if suffix == "csv":
        draw_transition(transition, atlas, tmp_path / "a.png")
        draw_transition(again, behind, tmp_path / "b.png")
        assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize(("kind", "magic"), [("svg", b"<?xml")])
def test_formats(drawn, kind, magic, tmp_path):
    """Oracle: see `require_formats`."""
    require_formats(drawn, kind, magic, tmp_path)


def require_formats(drawn, kind, magic, tmp_path):
    """Oracle: the first bytes; a spectrum is a picture in the picture, so the file stays small."""
    write_figure(lambda: drawn[2], tmp_path / f"a.{kind}")
    content = (tmp_path / f"a.{kind}").read_bytes()
    assert content.startswith(magic) and len(content) < 3_000_000


def test_a_conservative_motion_and_one_without_families_are_drawn():
    """Oracle: no error, and the panels that there are."""
    times = 0.05 * np.arange(4000)
    record = synthetic(times, np.cos(times), -np.sin(times))
    figure = transition_figure(Transition(saltus.vibro_impact_nes(), record, GAP))
    assert by_gid(figure, "families-spectrum") is not None and not figure.legends[0].get_texts()


def test_what_cannot_be_drawn_or_read_is_reported_in_one_line(drawn, tmp_path):
    """Oracle: the words."""
    transition, atlas, _ = drawn
    heavy = saltus.vibro_impact_nes(mu=0.2, sigma=0.1)
    write_atlas(atlas, tmp_path / "families.json")
    write_transition(transition, tmp_path / "cut.json")
    (tmp_path / "cut.json").write_text((tmp_path / "cut.json").read_text().replace('"gap"', '"gep"'))
    for call, kind, said in (
        (lambda: transition_figure(transition, atlas_of(heavy, [])), ValueError, "other masses"),
        (lambda: transition_figure(transition, replace(atlas, clearance=2.0)), ValueError, "natural units"),
        (lambda: draw_transition(transition, atlas, tmp_path / "a.jpg"), ValueError, "unknown figure format"),
        (lambda: write_transition(transition, tmp_path / "a.xls"), ExportError, "unknown format"),
        (lambda: read_transition(tmp_path / "families.json"), ExportError, "does not say that it holds a transition"),
        (lambda: read_transition(tmp_path / "none.csv"), ExportError, "cannot read"),
        (lambda: read_transition(tmp_path / "cut.json"), ExportError, "lacks 'gap'"),
    ):
        with pytest.raises(kind, match=said) as caught:
            call()
        assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def captured():
    """The motion of Fig. 16: from S11O00- at h = 0.8, with the family behind it and two stages, the first a 25th of the record."""
    system = saltus.vibro_impact_nes(mu=0.1, sigma=0.1, lam=0.01, rho=0.7)
    branch = traced("S11O00-")
    orbit = branch.orbit_at(energy=0.8)
    record = of_run(system, [0.0, 0.0], orbit.velocities, 400.0)
    transition = Transition(system, record, GAP)
    transition = replace(transition, stages=stages_of(record, GAP, families_of([branch], GAP), spectrum=transition.spectrum))
    return transition, orbit, transition_figure(transition, atlas_of(system.underlying, [branch], energy=(0.003, 1.6)))


def test_the_axes_hold_the_frequencies_of_the_start(captured):
    """Oracle: the closed form of the orbit's frequency, pi/(2 alpha), which falls to a fifth within sixteen of 400 units of time."""
    _, orbit, figure = captured
    for name in ("spectrum", "families-spectrum"):
        low, high = by_gid(figure, name).axes.get_ylim()
        assert low < 1.1 and high > 0.5 * np.pi / orbit.alpha > 6.0


def test_every_stage_has_its_letter_in_both_panels_over_time(captured):
    """Oracle: the stages; letters lie in the axes and apart from each other."""
    transition, _, figure = captured
    assert len(transition.stages) == 2 and transition.stages[0].end < 20.0
    for axes in (figure.axes[0], by_gid(figure, "spectrum").axes):
        letters = [text for text in axes.texts if text.get_text() in "AB"]
        assert [text.get_text() for text in letters] == ["A", "B"]
        boxes = [text.get_window_extent() for text in letters]
        assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes) and not boxes[0].overlaps(boxes[1])


def test_the_family_of_the_start_is_named_first_and_by_one_name(captured):
    """Oracle: the words below the picture, and the names in it: that of the start, not the label; the stage says why it has no family."""
    transition, orbit, _ = captured
    branch = traced("S11O00-")
    start = StartFamily(branch.id, "S95E22-", orbit.label, 8.74, 7)
    record = transition.record
    stages = stages_of(record, GAP, families_of([branch], GAP), start=start, spectrum=transition.spectrum)
    behind = atlas_of(transition.system.underlying, [branch], energy=(0.003, 1.6))
    figure = transition_figure(replace(transition, stages=stages, start=start), behind)
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    name = short_name("S95E22-")
    assert len(words) == 1 + len(stages) and words[0] == f"start  0\N{EN DASH}8.74  {name}, 7 impacts in its impact sequence"
    assert "no family: the frequency of " + name in words[1] and words[1].startswith("A  0")
    assert not any("S11" in text for text in words)
    shown = {text.get_text() for text in by_gid(figure, "families-spectrum").axes.texts}
    assert name in shown and short_name("S11O00-") not in shown


def test_over_the_energy_amplitudes_change_gradually_across_impacts(captured):
    """Oracle: the largest change from one interval of the energy to the next, of the energies at which there are impacts: a fifth of that
    over the energy itself, which is the edge of a block."""
    transition, _, figure = captured
    mesh = by_gid(figure, "families-spectrum")
    edges, spectrum = mesh.get_coordinates()[0, :, 0], shown_spectrum(transition)
    shown = (edges[:-1] > 0.07) & (edges[1:] < 0.75)
    energy = np.interp(spectrum.times, transition.record.times, transition.record.energy)
    steps = [
        np.abs(np.diff(values[:, shown], axis=1)).max()
        for values in (np.ma.filled(mesh.get_array(), np.nan), over_energy(energy, spectrum.amplitudes, edges))
    ]
    assert steps[0] < 0.2 * steps[1] and len(transition.record.impacts) == 7


def test_the_gradual_energy():
    """Oracles, of a motion that loses half of its energy at each of three impacts: the middles between impacts that are evenly spaced have
    the energy itself; in between its logarithm is a straight line; without impacts it is the energy."""
    times = np.linspace(0.0, 40.0, 4001)
    impacts = np.array([10.005, 20.005, 30.005])
    energy = 0.5 ** np.searchsorted(impacts, times)
    still = np.zeros_like(times)
    columns = (times, np.stack([np.cos(times)] * 2, 1), np.stack([-np.sin(times)] * 2, 1), energy, still, energy, still, still)
    record = SampledMotion(*columns, impacts)
    at = np.linspace(5.5, 34.5, 777)
    np.testing.assert_allclose(np.log2(gradual_energy(record, at)), np.clip(-(at - 5.005) / 10.0, -3.0, 0.0), atol=2e-3)
    np.testing.assert_allclose(gradual_energy(SampledMotion(*columns, []), times), energy, rtol=1e-12)


def test_a_system_without_a_sink_has_none_in_its_picture():
    """Oracle: the words of the figure, and the energy, which is drawn in place of the share of the sink."""
    gears = saltus.ImpactSystem([[1.0, 0.0], [0.0, 0.5]], 0.02 * np.eye(2), np.diag([1.0, 0.3]), (saltus.Stop(GAP, -0.1, 0.1, 0.8),))
    shared = sharing_of(gears)
    motion = simulate(gears, [0.0, 0.0], [1.0, 0.2], 60.0, dampers=shared.dampers)
    record = sampled(motion, shared)
    figure = transition_figure(Transition(gears, record, GAP, (), Wavelet(), (0.5, 6.0)))
    words = " ".join(text.get_text() for text in figure.findobj(Text))
    assert "sink" not in words and "oscillator" not in words and "stops" in words and shared.names == ("stops", "rest")
    line = by_gid(figure, "share-energy")
    np.testing.assert_allclose(line.get_ydata()[-1], 100.0 * record.energy[-1] / record.energy.max())
    assert np.ptp(line.get_ydata()) > 10.0
    spent = by_gid(figure, "lost-stops").get_ydata()[-1]
    assert spent == pytest.approx(100.0 * motion.dissipated["stop a"] / motion.initial_energy, rel=1e-6)


def test_a_family_without_a_label_has_a_short_id_below_and_over_the_spectrum(drawn):
    """Oracle: the digits of the id that tell it from the others."""
    transition, atlas, _ = drawn
    followed = next(stage.follows for stage in transition.stages if stage.follows is not None and stage.follows.impacts)
    curve = next(curve for curve in atlas.curves if curve.family == followed.family)
    raw = "rest-stop+::2c49f5ff"
    blank = np.full(len(curve.h), "")
    other = replace(curve, family=raw, names=blank, labels=blank, cited=np.zeros(len(blank), dtype=bool))
    name = replace(followed, label="", family=raw)
    stages = [replace(stage, follows=name) for stage in transition.stages]
    figure = transition_figure(replace(transition, stages=stages), replace(atlas, curves=(other,)))
    below = [text.get_text() for text in figure.legends[0].get_texts()]
    assert all("rest-stop+ #2c49" in text and raw not in text for text in below)
    assert "#2c49" in [text.get_text() for text in figure.axes[4].texts]
