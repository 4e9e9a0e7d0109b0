"""`saltus continue --harmonics K`: columns of all files, a panel of the figure, and what is said where they are not known."""

import csv

import numpy as np
import pytest
from scipy.io import loadmat

from bvp.multipoint import NotConverged
from tests.saltus.running import read_json, run

pytestmark = pytest.mark.usefixtures("folder")


def rows(path):
    with open(path, encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_family_in_the_energy_has_the_columns_in_each_file(capsys, folder):
    """Oracle: the files agree. In a motion with one impact a half period the start velocity is the sum of k w a_k of odd k; its series
    has alternating signs, so the largest displacement, at the impact, is a_1 - a_3 + ..."""
    files = [word for kind in ("json", "csv", "npz", "mat") for word in (f"--{kind}", f"a.{kind}")]
    words = ("continue", "S13O00+", "--energy", "0.5:0.6", "--harmonics", "9")
    code, out, err = run(capsys, *words, *files, "--plot", "a.png")
    assert code == 0 and not err and "warning" not in out and (folder / "a.png").stat().st_size > 10_000
    points, table = read_json("a.json")["points"], rows("a.csv")
    third = np.array([point["harmonic"]["u1"]["3"] for point in points])
    assert np.array_equal(third, [float(row["harmonic.u1.3"]) for row in table])
    assert np.array_equal(third, np.load("a.npz")["harmonic.u1.3"]) and np.array_equal(third, loadmat("a.mat")["harmonic_u1_3"][:, 0])
    assert all(point["harmonic"]["u2"]["2"] == point["harmonic"]["u2"]["0"] == 0.0 for point in points)
    assert sorted(points[0]["harmonic"]["u2"], key=int) == [str(k) for k in range(10)]
    from branches.reading import read_branch as read

    assert np.array_equal(read("a.json").points["harmonic.u1.3"], third)


def test_a_family_in_a_parameter_has_the_columns(capsys, folder):
    """Oracle: the family in the energy at the same orbit."""
    words = ("--scene", "cubic_nes", "--harmonics", "3")
    code, _, err = run(capsys, "continue", "S11-@h=0.1", *words, "--in", "mu", "--range", "0.05:0.051", "--csv", "a.csv", "--plot", "a.png")
    assert code == 0 and not err and (folder / "a.png").stat().st_size > 10_000
    first = next(row for row in rows("a.csv") if float(row["mu"]) == 0.05)
    assert run(capsys, "continue", "S11-", *words, "--energy", "0.099:0.1", "--csv", "b.csv")[0] == 0
    other = next(row for row in rows("b.csv") if abs(float(row["h"]) - 0.1) < 1e-12)
    for name in ("harmonic.u1.1", "harmonic.u1.3", "harmonic.u2.1"):
        assert abs(float(first[name]) / float(other[name]) - 1.0) < 1e-9


CHAIN = """
[system]
mass = [[1.0, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.2]]
stiffness = [[2.0, -1.0, 0.0], [-1.0, 1.8, 0.0], [0.0, 0.0, 0.8]]
[[springs]]
between = ["x", "y"]
polynomial = [0.2, 0.0, 1.1]
[coordinates]
names = ["x", "y", "z"]
"""


def test_the_figure_has_a_panel_for_each_coordinate_and_one_legend(capsys, folder):
    """The third mass is on its own and stays at rest: the legend is that of the two others."""
    from branches.figures.single import branch_figure
    from branches.reading import read_branch as read

    (folder / "chain.toml").write_text(CHAIN)
    words = ("--scene", "chain.toml", "--from", "mode:1", "--energy", "0.1:0.12", "--harmonics", "4", "--json", "a.json", "--plot", "a.png")
    code, _, err = run(capsys, "continue", *words)
    assert code == 0 and "legend" not in err
    panels = {axes.get_ylabel(): axes for axes in branch_figure(read("a.json")).axes}
    drawn = {name: {line.get_gid() for line in panels[f"amplitude of harmonics of ${name}$"].lines} for name in "xyz"}
    assert drawn == {"x": {"harmonic-x-1-1", "harmonic-x-3-1"}, "y": {"harmonic-y-1-1", "harmonic-y-3-1"}, "z": set()}
    (legend,) = (axes.get_legend() for axes in panels.values() if axes.get_legend())
    assert [text.get_text() for text in legend.get_texts()] == ["1", "3"]


def test_the_legend_has_the_harmonics_of_all_panels():
    """Amplitudes that are given: odd harmonics of x, even ones of y."""
    from branches.figures import style
    from branches.figures.harmonics import draw_harmonics, harmonic_layout

    amplitudes = np.zeros((2, 4, 2))
    amplitudes[:, [1, 3], 0] = amplitudes[:, [0, 2], 1] = 0.5
    figure = style.new_figure(2.0)
    mosaic = figure.subplot_mosaic(harmonic_layout(["x", "y"]))
    draw_harmonics(mosaic, ["x", "y"], [(np.array([1.0, 2.0]), amplitudes)], (1.0, 2.0), ("energy", "h"), log=True)
    assert [text.get_text() for text in mosaic["harmonics-y"].get_legend().get_texts()] == ["mean", "1", "2", "3"]


@pytest.mark.parametrize("count, rows", [(1, [1]), (3, [3]), (4, [2, 2]), (5, [3, 2]), (12, [3, 3, 3, 3])])
def test_rows_of_panels(count, rows):
    from branches.figures.harmonics import COLUMNS, harmonic_layout

    layout = harmonic_layout([f"u{k}" for k in range(count)])
    assert [len(set(row) - {"."}) for row in layout] == rows and {len(row) for row in layout} == {COLUMNS}


def test_a_point_that_cannot_be_sampled_says_why(capsys, monkeypatch):
    """Oracle: the words, the note of the point, and null in its place."""
    from branches import harmonics as module

    true, calls = module.harmonics, []

    def failing(problem, y, highest):
        calls.append(y)
        if len(calls) == 2:
            raise NotConverged("a flight of time 3 cannot be computed beyond the time 2")
        return true(problem, y, highest)

    monkeypatch.setattr(module, "harmonics", failing)
    code, out, _ = run(capsys, "continue", "S13O00+", "--energy", "0.5:0.6", "--harmonics", "2", "--json", "a.json")
    points = read_json("a.json")["points"]
    where = f"warning  the harmonics of 1 of {len(points)} points are not computed, first at point 1: a flight of time 3 cannot"
    assert code == 0 and where in out
    assert points[1]["harmonic"]["u1"] == {"0": None, "1": None, "2": None}
    assert points[1]["note"] == "not computed at this point, so null: harmonic" and points[0]["note"] is None
