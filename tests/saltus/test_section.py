"""`saltus section` from end to end: tables, files, pictures, panels, interruption, bad input."""

import csv
import io
import json

import numpy as np
import pytest
from scipy.io import loadmat

from branches.catalogue import Catalogue
from saltus.scene import load_scene
from tests.branches.traced import traced
from tests.saltus.running import reported

SMALL = "--orbits 6 --crossings 30"
BOUNDS = "[bounds]\nenergy = [0.1, 10]\nquarter_period = 8\nimpacts = 6\n"


@pytest.fixture(scope="module")
def families(tmp_path_factory):
    """A catalogue with both backbones."""
    path = tmp_path_factory.mktemp("families") / "two.sqlite"
    with Catalogue(path, "a", scene=load_scene()) as catalogue:
        for name in ("S13O00+", "S11O00-"):
            catalogue.add(traced(name, low=0.05, high=5.0))
    return path


def test_the_table_and_all_files_say_the_same(tmp_path, families):
    """Oracle: the files beside each other, and the numbers of the table."""
    code, out, err = reported(
        f"section --energy 0.3 {SMALL} --catalogue {families} --json {tmp_path}/a.json --csv {tmp_path}/a.csv --npz {tmp_path}/a.npz "
        f"--mat {tmp_path}/a.mat --plot {tmp_path}/a.png"
    )
    assert code == 0 and not err
    record = json.loads((tmp_path / "a.json").read_text())
    (section,) = record["sections"]
    assert record["schema"] == 1 and record["plane"] == {"zero": "u2", "x": "u1", "y": "velocity"}
    assert section["points"] == 180 == sum(len(orbit["points"]) for orbit in section["orbits"])
    assert section["energy_drift"] < 1e-12 and section["ends"] == {"complete": 6}
    row = out.splitlines()[1].split()
    assert row[:4] == ["0.3", "6", "180", str(section["impacts"])]
    lines = list(csv.DictReader(io.StringIO((tmp_path / "a.csv").read_text())))
    with np.load(tmp_path / "a.npz") as arrays:
        for name in ("time", "x", "y", "energy", "lyapunov"):
            values = np.array([float(line[name]) if line[name] else np.nan for line in lines])
            assert np.array_equal(values, arrays[name], equal_nan=True)
        matlab = loadmat(tmp_path / "a.mat")
        assert np.array_equal(matlab["x"][:, 0], arrays["x"]) and np.char.strip(matlab["kind"]).tolist() == arrays["kind"].tolist()
        points = arrays["kind"] == "point"
        assert points.sum() == 180
        flat = np.concatenate([orbit["points"] for orbit in section["orbits"]])
        assert np.array_equal(flat, np.stack([arrays["x"], arrays["y"]], 1)[points])
        marked = arrays["kind"] == "mark"
        assert set(arrays["label"][marked]) == {"S13O00+", "S11O00-"}
        assert dict(zip(arrays["label"][marked], arrays["stable"][marked], strict=True)) == {"S13O00+": 0, "S11O00-": 1}
        assert json.loads(str(arrays["about"]))["system"]["mu"] == 0.1
    assert "found  2 periodic orbits (1 elliptic, 1 hyperbolic), 2 points" in out
    assert {mark["label"]: mark["kind"] for mark in section["marks"]} == {"S13O00+": "hyperbolic", "S11O00-": "elliptic"}
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_panels_of_the_scene_say_which_energies_are_cited(tmp_path):
    """Oracle: the scene: two energies are the paper's, six are not."""
    code, out, err = reported(f"section --panels {SMALL} --plot {tmp_path}/p.svg --json {tmp_path}/p.json")
    assert code == 0 and not err
    assert "note   h = 0.05 and 0.06 as in Lee, Nucera" in out and "the other energies are our choice" in out
    energies = [section["energy"] for section in json.loads((tmp_path / "p.json").read_text())["sections"]]
    assert len(energies) == 8 and energies == sorted(energies) and {0.05, 0.06} < set(energies)
    picture = (tmp_path / "p.svg").read_text()
    assert all(f'id="section{k}-boundary"' in picture for k in range(8)) and picture.count("<image") == 8
    code, out, _ = reported(f"section --panels --mu 0.2 {SMALL}")
    assert code == 0 and "note   the energies are our choice" in out


def test_rotation_numbers_say_about_which_point(tmp_path):
    """Oracle: the ratio of the linear frequencies, 1.370157, below the first impact."""
    words = f"section --energy 0.04 --colour rotation --start 0,0.7 --start 0.01,-0.6 --plot {tmp_path}/r.png"
    code, out, err = reported(words)
    assert code == 0 and not err
    assert "about  (0, 0.680051), elliptic, period 7.3547: 1 orbits at 0.37015" in out
    assert "about  (0, -0.580974), elliptic, period 5.36778: 1 orbits at 0.7298" in out
    code, out, _ = reported(f"{words} --about 0,0.6")
    assert code == 0 and "(0, 0.680051)" in out and "-0.580974" not in out and "none: 1 orbits" in out


def test_a_system_that_loses_energy_is_reported_as_one(tmp_path, monkeypatch):
    """Oracle: the words; the energies of the file fall, and colour the picture unless another colour is given."""
    colours = []
    monkeypatch.setattr("branches.figures.style.write_figure", lambda make, path, views, **options: colours.append(options["colour"]))
    for more in ("--rho 0.7", "--rho 0.7 --colour none", ""):
        reported(f"section --energy 0.5 {SMALL} {more} --plot {tmp_path}/b.png")
    assert colours == ["energy", "none", "none"]
    monkeypatch.undo()
    code, out, err = reported(f"section --energy 0.5 --rho 0.7 {SMALL} --model --json {tmp_path}/a.json --plot {tmp_path}/a.png")
    assert code == 0 and not err
    assert "model  restitution 0.7 of stop a loses energy -> energy falls" in out
    assert "note   restitution 0.7 of stop a loses energy: the section is that of motions and not of an energy surface" in out
    for orbit in json.loads((tmp_path / "a.json").read_text())["sections"][0]["orbits"]:
        assert np.all(np.diff(orbit["energies"]) <= 1e-14)


def test_a_free_sink_and_other_scenes(tmp_path):
    """Oracle: exit code 0; orbits that stick to a stop are followed on, and reported."""
    code, out, _ = reported(f"section --energy 0.5 --sigma 0 {SMALL} --model")
    assert code == 0 and "rigid-body mode" in out and "areas" in out
    code, out, _ = reported(f"section --energy 5 --sigma 0 --rho 0.3 {SMALL}")
    assert code == 0 and "ended  " not in out and "sticks " in out and "no Lyapunov exponent" in out
    scene = tmp_path / "two.toml"
    scene.write_text(
        "[system]\nmass = [[0.7, 0.25], [0.25, 1.3]]\nstiffness = [[1.0, -0.3], [-0.3, 2.0]]\n"
        '[[stops]]\nc = [1.0, -0.6]\nlower = -0.8\nupper = 1.1\n[coordinates]\nnames = ["x", "y"]\nLO = "y"\nNES = "x"\n' + BOUNDS
    )
    code, out, _ = reported(f"section --energy 1 {SMALL} --scene {scene} --json {tmp_path}/s.json --plot {tmp_path}/s.png")
    assert code == 0
    assert json.loads((tmp_path / "s.json").read_text())["plane"] == {"zero": "y", "x": "x", "y": "momentum over mass"}
    code, out, err = reported(f"section --panels --scene {scene}")
    assert code == 2 and "[sections] energies" in err


def test_an_interruption_keeps_what_was_followed(tmp_path, monkeypatch):
    """Oracle: exit code 130 and the orbits of the first batch."""
    import transitions.section.section as module

    follow, calls = module.follow_crossings, []

    def interrupted(plane, starts, *arguments, **options):
        calls.append(len(starts))
        if len(calls) == 3:  # the first is the one that compiles
            raise KeyboardInterrupt
        return follow(plane, starts, *arguments, **options)

    monkeypatch.setattr(module, "follow_crossings", interrupted)
    code, _, err = reported(f"section --energy 0.06 --orbits 100 --crossings 5 --json {tmp_path}/a.json")
    assert code == 130 and "interrupted" in err
    assert len(json.loads((tmp_path / "a.json").read_text())["sections"][0]["orbits"]) == 32
