"""Catalogues of families of free orbits in a parameter: `continue NAME --in --keep --catalogue`, and the commands that read them."""

import csv
import json

import mpmath as mp
import numpy as np
import pytest
from scipy.io import loadmat

from benchmarks.backbone import Backbone
from branches.catalogue import Catalogue
from saltus.__main__ import main
from tests.saltus.running import run, run_refused

START = ("S13+", "--in", "sigma", "--keep", "energy=0.6")
BACKBONE, BROKEN = "origin-stop+::0f85daa8", "stop+-stop-::040806a8"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A catalogue of the in-phase backbone and of the family that breaks its symmetry, with the file of the first."""
    folder = tmp_path_factory.mktemp("free")
    place = str(folder / "free.sqlite")
    files = "--json", str(folder / "backbone.json"), "--catalogue", place
    assert main(["continue", *START, "--range", "0.05:0.2", *files]) == 0
    assert main(["continue", "--from", f"{folder / 'backbone.json'}:SB1", "--catalogue", place]) == 0
    return folder


@pytest.fixture
def place(folder):
    return str(folder / "free.sqlite")


def test_a_stored_family_is_the_branch_that_was_added(folder, place):
    """Oracle: the points of the file."""
    (points,) = [branch["points"] for branch in json.loads((folder / "backbone.json").read_text())["branches"]]
    with Catalogue(place) as catalogue:
        branch, row = catalogue.branch(BACKBONE), catalogue.family(BACKBONE)
    assert np.array_equal(branch.unknowns, [point["unknowns"] for point in points])
    assert branch.columns["label"].tolist() == [point["label"] for point in points]
    assert (row.ends, row.impacts, row.points) == ("origin-stop+", 2.0, len(points))
    assert [event.values["energy"] for event in branch.events] == pytest.approx([0.6] * len(branch.events), rel=1e-12)


def test_the_commands_that_read_a_catalogue(place, capsys, tmp_path):
    """Oracle: the closed form of the symmetry breaking, where tau_half is -2."""
    with mp.workdps(30):
        equations = [lambda sigma, a: Backbone(0.1, sigma).tau_half(a) + 2, lambda sigma, a: Backbone(0.1, sigma).energy(a) - mp.mpf("0.6")]
        breaks = float(mp.findroot(equations, (mp.mpf("0.0759"), mp.mpf("1.695")))[0])
    code, out, _ = run(capsys, "list", "--catalogue", place)
    assert code == 0 and out.splitlines()[0].split() == ["id", "impacts", "sigma", "period", "stable", "points", "events"]
    assert BACKBONE in out and BROKEN in out and out.splitlines()[-1] == "2 of 2 families"
    code, out, _ = run(capsys, "show", "origin-stop+", "--catalogue", place, "--plot", tmp_path / "a.png", "--json", tmp_path / "a.json")
    assert code == 0 and (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert "ends     origin-stop+  sequence (none)  2 impacts in a period\n" in out and "with energy=0.6" in out
    record = json.loads((tmp_path / "a.json").read_text())
    assert record["family"]["ends"] == "origin-stop+" and record["path"] == {"names": ["sigma"], "keep": ["energy=0.6"]}
    code, out, _ = run(capsys, "tree", BACKBONE, "--catalogue", place)
    assert code == 0 and f"└─ SB1 switch at sigma {breaks:.6g}: {BROKEN}" in out
    code, out, _ = run(capsys, "path", BACKBONE, BROKEN, "--catalogue", place)
    assert code == 0 and f"SB1 to BP1: switch at sigma = {breaks:.9f}" in out
    code, out, err = run(capsys, "check", "--catalogue", place)
    assert code == 0 and "all hold" in out, out


def test_export(place, capsys, tmp_path):
    """Oracle: the numbers of points of the catalogue."""
    names = {kind: tmp_path / f"a.{kind}" for kind in ("json", "csv", "npz", "mat", "png")}
    files = [text for kind, name in names.items() for text in ("--plot" if kind == "png" else f"--{kind}", name)]
    code, _, err = run(capsys, "export", "response", "--catalogue", place, "--y", "alpha", *files)
    assert code == 0 and not err and names["png"].read_bytes().startswith(b"\x89PNG")
    with Catalogue(place) as catalogue:
        count = catalogue.counts()["points"]
    assert {branch["id"] for branch in json.loads(names["json"].read_text())["branches"]} == {BACKBONE, BROKEN}
    assert len(np.load(names["npz"])["sigma"]) == len(list(csv.DictReader(names["csv"].open()))) == count
    assert loadmat(names["mat"])["sigma"].size == count
    rows = json.loads(run(capsys, "export", "points", BACKBONE, "--catalogue", place, "--json", "-")[1])["points"]
    with Catalogue(place) as catalogue:
        events = [(event.id, event.coefficient) for event in catalogue.branch(BACKBONE).events]
    assert [(row["event"], row["coefficient"]) for row in rows if row["event"]] == events
    assert any(coefficient is not None for _, coefficient in events)
    code, out, _ = run(capsys, "export", "graph", "--catalogue", place, "--json", "-")
    assert code == 0 and {node.get("ends") for node in json.loads(out)["nodes"]} == {"origin-stop+", "stop+-stop-"}


def test_export_of_a_file(folder, capsys, tmp_path):
    """Oracle: the points of the file."""
    place = folder / "backbone.json"
    code, _, err = run(capsys, "export", "response", "--branches", place, "--csv", tmp_path / "a.csv")
    assert code == 0 and not err
    (branch,) = json.loads(place.read_text())["branches"]
    rows = list(csv.DictReader((tmp_path / "a.csv").open()))
    assert [float(row["sigma"]) for row in rows] == [point["sigma"] for point in branch["points"]]


def test_what_does_not_fit_is_refused(folder, place, capsys, tmp_path, scene=("--range", "0.05:0.2")):
    """Oracle: one line that names what the catalogue holds."""
    line = run_refused(capsys, "continue", *START[:-1], "energy=0.7", *scene, "--catalogue", place)
    assert "holds families of free orbits in sigma, energy=0.6; received one in sigma, energy=0.7" in line
    assert "--catalogue FILE is required" in run_refused(capsys, "continue", *START, *scene, "--save")
    assert "holds families of free orbits in sigma, and no families in the energy" in run_refused(
        capsys, "continue", "S13+", "--save", "--catalogue", place
    )
    assert "no family 'S13+': the families of" in run_refused(capsys, "show", "S13+", "--catalogue", place)
    assert "--label needs families in the energy" in run_refused(capsys, "list", "--label", "S13+", "--catalogue", place)
