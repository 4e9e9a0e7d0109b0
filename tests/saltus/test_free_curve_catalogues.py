"""Curves of free orbits in catalogues, and families from their points."""

import re

import pytest

from branches.catalogue import Catalogue
from branches.catalogue.responses import system_of
from branches.catalogue.rows import SceneRecord
from branches.catalogue.widening import Kept
from branches.curves.files import read_curves
from saltus.__main__ import main
from tests.saltus.running import read_json, run
from tests.saltus.running import refused as check_refused

FAMILY = ("continue", "S11O00-", "--energy", "0.06:0.2")
PLANE = ("--in", "mu,energy", "--range", "0.08:0.15,0.01:1")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A family in the energy, and the curve of its grazing over the energy and the mass ratio."""
    folder = tmp_path_factory.mktemp("free")
    assert main([*FAMILY, "--json", str(folder / "f.json")]) == 0
    assert main(["curve", f"{folder / 'f.json'}:GR1", *PLANE, "--json", str(folder / "c.json")]) == 0
    return folder


def test_a_curve_of_grazings_is_kept(folder, capsys):
    """Oracle: at the energy 0.1 the main backbone touches at mu = 1/9, at the quarter period that the family in mu has there."""
    (curve,) = read_curves(folder / "c.json")
    place, system = folder / "a.sqlite", system_of(curve.plane.problem)
    with Catalogue(place, "a", scene=SceneRecord(system, parameters={"names": ["mu"], "keep": ["energy = 0.1"]})) as catalogue:
        kept, id = catalogue.keep_curve(curve)
        (row,) = catalogue.curve_rows()
        assert kept is Kept.NEW and row.names == ("energy", "mu") and row.id == id == read_json(folder / "c.json")["curves"][0]["id"]
        ((value, period),) = row.meetings
        assert value == pytest.approx(1.0 / 9.0, abs=1e-10) and period == pytest.approx(4.0 * 1.369160474, rel=1e-9)
    code, out, _ = run(capsys, "check", "--catalogue", place)
    assert code == 0 and "1 curve looked at: all hold" in out
    code, out, err = run(capsys, "export", "curves", "--catalogue", place, "--json", folder / "e.json")
    assert code == 0 and not err and (folder / "e.json").read_bytes() == (folder / "c.json").read_bytes()
    code, out, _ = run(capsys, "show", id, "--catalogue", place)
    assert code == 0 and "no family of the catalogue has an event on the curve" in out


def test_a_family_of_free_orbits_starts_at_a_point(folder, capsys):
    """Oracle: the energy and the parameter of the point, where the family grazes."""
    mu, energy = read_json(folder / "c.json")["curves"][0]["points"][4]["parameters"]
    words = "continue", "--from", f"{folder / 'c.json'}:#4", "--in", "mu"
    code, out, err = run(capsys, *words)
    assert code == 0 and "a point of a curve GR at mu = " in out, err
    assert float(re.search(r"; energy = (\S+);", out)[1]) == pytest.approx(energy, rel=1e-14)
    row = next(line.split() for line in out.splitlines() if line.startswith("GR1"))
    assert float(row[1]) == pytest.approx(mu, rel=1e-12)
    for more, parts in (
        (("--keep", "energy = 0.3"), ["energy = 0.3 does not hold at the point", "quarter_period = "]),
        (("--direction", "up", "--scene", "lee2009"), ["has a system of its own"]),
    ):
        result = run(capsys, *words, *more)
        check_refused(result, *parts)
