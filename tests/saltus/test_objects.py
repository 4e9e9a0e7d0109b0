"""The objects of the Python interface: short texts, plots, tables, files, and the help of every public function."""

import builtins
import csv
import inspect
import io
import json
import re
import subprocess
import sys

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest
from matplotlib import pyplot

import saltus
from branches.tables import csv_cell, csv_text


@pytest.fixture(scope="module")
def branch():
    """A family with several kinds of events."""
    return saltus.trace("S13O00+", energy=(0.1, 2.0))


@pytest.fixture(scope="module")
def motion():
    return saltus.simulate(saltus.vibro_impact_nes(lam=0.01, rho=0.7), [0.0, 0.0], [0.0, 2.0], 100.0)


@pytest.fixture(scope="module")
def catalogue(branch, tmp_path_factory):
    path = tmp_path_factory.mktemp("objects") / "few.sqlite"
    with saltus.Catalogue(path, "a", scene=saltus.load_scene()) as catalogue:
        catalogue.add(branch)
        yield catalogue


@pytest.fixture(autouse=True)
def close_figures():
    yield
    pyplot.close("all")


def test_every_object_has_a_short_text_and_a_small_table(branch, motion, catalogue):
    """Oracle: the number of lines and letters; the text of the table, whose tags are removed, is that of the repr."""
    system = branch.system
    shared = saltus.sharing_of(motion.system, (0,), (1,))
    record = saltus.sampled(motion, shared)
    stages = saltus.stages_of(record, (1.0, -1.0), saltus.families_of([branch]))
    first = branch, branch.orbit(3), branch.events[0], motion, catalogue, system, saltus.section(system, 0.06, orbits=3, crossings=9)
    others = (
        motion.stop_events, saltus.discover(system, 0.3, quarter_period=3.0, impacts=2), saltus.load_scene(), shared, record,
        branch.neighbours("GR1")[0], saltus.Harmonic(1.0, [0.0, 1.0]), saltus.atlas_of(system, [branch]), saltus.extents(motion),
        saltus.linear_modes(system)[0], saltus.impulsive_orbits(system, (0.05, 0.2), quarter_period=2.0), saltus.families_of([branch]),
        saltus.impulsive_manifold(system, (0.05, 0.1), density=5), saltus.Transition(motion.system, record, (1.0, -1.0), stages),
        saltus.Simulator(system).run_many(np.zeros((3, 4)), 1.0), branch.orbit(3).solution,
    )  # fmt: skip
    for item in (*first, *others):
        text, html = repr(item), item._repr_html_()
        lines = text.splitlines()
        assert len(lines) <= (4 if item in first else 16) and max(map(len, lines)) <= 140, text
        plain = re.sub(r"&#x27;", "'", re.sub(r"&gt;", ">", re.sub(r"&lt;", "<", re.sub(r"<[^>]*>", "", html))))
        assert html.startswith("<table>") and "".join(plain.split()) == "".join(text.split())
    assert re.match(r"Branch S13O00\+: origin-stop\+, sequence \(none\), \d+ points\n", repr(branch))


def test_the_table_is_escaped():
    """Oracle: the entities of HTML."""
    system = saltus.ImpactSystem([[1.0]], [[0.0]], [[1.0]], [saltus.Stop((1.0,), -1.0, 1.0)], coordinates=("<b>x&y",))
    assert "&lt;b&gt;x&amp;y" in system._repr_html_() and "<b>" not in system._repr_html_()


def test_plots_draw_on_the_axes_that_are_given(branch, motion, catalogue):
    """Oracle: the data of the curves, and the labels of the axes."""
    figure, ax = pyplot.subplots()
    assert branch.plot(ax=ax) is ax and ax.get_xscale() == "log"
    drawn = np.concatenate([line.get_xydata() for line in ax.lines])
    low, high = np.nanmin(drawn, axis=0), np.nanmax(drawn, axis=0)
    h, index = branch.points["h"], branch.points["frequency_index"]
    assert low == pytest.approx([h.min(), index.min()], rel=1e-9) and high == pytest.approx([h.max(), index.max()], rel=1e-9)
    before = ax.get_xlim()
    other = saltus.trace("S11O00-", energy=(1.0, 8.0))
    other.plot(ax, frequency="fundamental", events=False)
    assert ax.get_xlim()[0] == before[0] and ax.get_xlim()[1] > 8.0
    assert catalogue.plot(label="S13O00+").get_xlabel() == ax.get_xlabel() != ""
    for item, end in ((branch.orbit(3), branch.orbit(3).period), (motion, 100.0)):
        axes = item.plot()
        assert axes.get_xlim() == (0.0, end) and len(axes.lines) >= 2 and axes.get_xlabel()
        assert item.plot(axes) is axes
    with pytest.raises(ValueError, match="unknown frequency 'both': expected index or fundamental"):
        branch.plot(frequency="both")
    with pytest.raises(ValueError, match="nothing to plot"):
        catalogue.plot(label="S73O33-")
    with pytest.raises(TypeError, match="^ax is 3, expected matplotlib axes$"):
        branch.plot(3)


def test_the_table_of_a_branch_is_that_of_its_csv(branch, tmp_path):
    """Oracle: the csv file."""
    branch.save(tmp_path / "branch.csv")
    table = branch.to_dataframe()
    with open(tmp_path / "branch.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(table.columns) == list(rows[0]) and len(table) == len(rows) == len(branch)
    assert table["h"].to_numpy().tobytes() == branch.points["h"].tobytes()
    names = {True: "true", False: "false"}
    assert [row["stable"] for row in rows] == [names.get(value, "") for value in table["stable"].to_numpy(object, na_value=None)]


def test_a_missing_pandas_is_named(branch, monkeypatch):
    """Oracle: the message."""
    real = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name == "pandas":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(ImportError, match="^to_dataframe needs pandas, which is not installed; expected pip install pandas$"):
        branch.to_dataframe()


def test_numpy_reads_the_csv_of_a_branch_with_notes(branch, tmp_path):
    """Oracle: `numpy.genfromtxt`, which knows no quoting and takes # for a comment."""
    branch.save(tmp_path / "branch.csv")
    read = np.genfromtxt(tmp_path / "branch.csv", names=True, delimiter=",", dtype=None, encoding="utf-8")
    assert any(read["note"]) and len(read) == len(branch)
    assert read["h"].tobytes() == branch.points["h"].tobytes()
    note, plain = 'multipliers, "tau" of #2\nand more', "multipliers; 'tau' of no. 2 and more"
    text = csv_text({"h": np.array([1.0, 2.0]), "note": np.array([note, ""])})
    read = np.genfromtxt(io.StringIO(text), names=True, delimiter=",", dtype=None, encoding="utf-8")
    assert read["h"].tolist() == [1.0, 2.0] and read["note"].tolist() == [plain, ""] and csv_cell(note) == plain


def test_a_family_is_followed_from_an_orbit(branch, tmp_path, capsys):
    """Oracle: the family's id, from an orbit of a search, of a file and of a branch."""
    found = saltus.discover(branch.system, 0.5, quarter_period=2.0, impacts=2)
    searched = next(orbit for orbit in found.orbits if orbit.label == "S13O00+")
    assert saltus.main(["orbit", "S13O00+", "--energy", "0.5", "--json", str(tmp_path / "orbit.json")]) == 0
    written = saltus.read_orbit(tmp_path / "orbit.json")
    assert written.residual < 1e-12 and written.alpha == pytest.approx(searched.alpha, rel=1e-12)
    for orbit in (searched, written, branch.orbit(int(np.argmin(np.abs(branch.points["h"] - 0.5))))):
        assert saltus.trace(orbit, energy=(0.3, 1.0), points=9).id == branch.id
        with pytest.raises(ValueError, match=r"the orbit has h = .*, outside the energy range 30:40"):
            saltus.trace(orbit, energy=(30.0, 40.0))
    branch.save(tmp_path / "branch.json")
    with pytest.raises(ValueError, match="is not a readable orbit file: it lacks 'orbit'"):
        saltus.read_orbit(tmp_path / "branch.json")
    record = json.loads((tmp_path / "orbit.json").read_text())
    assert record["schema"] == 2
    (tmp_path / "longer.json").write_text(json.dumps({**record, "orbit": {**record["orbit"], "sequence": "+"}}))
    with pytest.raises(ValueError, match="is not a readable orbit file: 0 impacts lie inside the solved segment; its sequence has 1"):
        saltus.read_orbit(tmp_path / "longer.json")


def test_help_lists_every_option():
    """Oracle: the signature of every public function and class; each name has its place under Parameters."""
    functions = {name: getattr(saltus, name) for name in saltus.__all__ if inspect.isfunction(getattr(saltus, name))}
    assert len(functions) > 25
    for name, function in functions.items():
        parameters = inspect.signature(function).parameters.values()
        section = re.search(r"^Parameters\n-+\n(.*?)(?:\n\n[A-Z]\w+\n-|\Z)", inspect.getdoc(function), re.DOTALL | re.MULTILINE)
        assert section, name
        listed = set(re.findall(r"\w+", " ".join(line.partition(":")[0] for line in re.findall(r"^\S.*", section[1], re.MULTILINE))))
        assert listed >= {item.name for item in parameters}, (name, {item.name for item in parameters} - listed)
    names = ("trace", "extend", "switch", "neighbours", "families_at")
    code = f"import saltus; [print('{'=' * 9}', help(getattr(saltus, name))) for name in {names}]"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split("=" * 9)[:-1]
    assert len(shown) == len(names)
    for text in shown:
        assert "stop_when : callable" in text and "**options" not in text
