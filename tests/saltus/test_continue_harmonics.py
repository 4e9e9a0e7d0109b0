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
