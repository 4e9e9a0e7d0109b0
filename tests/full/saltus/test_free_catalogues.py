"""Long cases of tests/saltus/test_free_catalogues.py."""

import csv
import json

import mpmath as mp
import pytest

from benchmarks.backbone import Backbone
from branches.catalogue import Catalogue
from tests.saltus import test_free_catalogues as origin
from tests.saltus.running import run
from tests.saltus.test_free_catalogues import BACKBONE, START

folder = origin.folder
place = origin.place


def test_a_part_of_a_known_family_is_joined(folder, capsys, tmp_path):
    """Oracle: the ids and ranges; the equation is the same one with other spaces."""
    place = str(tmp_path / "a.sqlite")
    words = "continue", *START[:-1], "energy = 0.6", "--catalogue", place, "--range"
    code, out, _ = run(capsys, *words, "0.09:0.12")
    assert code == 0 and f"saved  {BACKBONE} in {place}, with sigma = 0.09:0.12" in out
    code, out, _ = run(capsys, *words, "0.08:0.11")
    assert code == 0 and f"wider  {BACKBONE} in {place}, now with sigma = 0.08:0.12; before with sigma = 0.09:0.12" in out
    code, out, _ = run(capsys, *words, "0.09:0.11")
    assert code == 0 and f"known  {BACKBONE} in {place}" in out
    code, out, _ = run(capsys, "continue", "--from", f"{folder / 'backbone.json'}:SB1", "--points", "8", "--catalogue", place)
    assert code == 0 and f"edge   {BACKBONE} SB" not in out and "expected it saved, too" in out, "the stored part has not this event"


LIGHT = """
[parameters]
a = 0.15

[system]
model = "vibro_impact_nes"
mu = "a - 0.05"

[bounds]
energy = [0.05, 100]
quarter_period = 10
impacts = 4
"""


def test_a_mass_that_vanishes_ends_the_family(capsys, tmp_path):
    """Oracle: the speeds grow as the root of the energy over the mass; the mass of the last point is a thousandth of the scene's."""
    (tmp_path / "light.toml").write_text(LIGHT)
    words = "continue", "S11-", "--scene", tmp_path / "light.toml", "--in", "a", "--range", "-1:0.16"
    code, out, err = run(capsys, *words, "--keep", "energy = 0.8*((a - 0.05)/0.1)**0.3", "--csv", tmp_path / "a.csv")
    assert code == 0 and "a mass is below 1/1000 of the scene's, and the velocities grow without bound, at a = 0.05009" in out, out + err
    with (tmp_path / "a.csv").open() as file:
        first = next(csv.DictReader(file))
    assert 0.9e-4 < float(first["a"]) - 0.05 < 1e-4


def test_the_backbone_is_identified_by_its_grazing(folder):
    """Oracle: the closed form of the linear mode's grazing, h = w^2/(2 b^2) and T = 2 pi/w."""
    (branch,) = json.loads((folder / "backbone.json").read_text())["branches"]
    assert branch["id"] is None and branch["ends"] == ["origin", "stop+"]
    with Catalogue(folder / "free.sqlite") as catalogue:
        (mark,) = catalogue.branch(BACKBONE).full_family.marks

    def beyond(sigma):
        w, _, b = Backbone(0.1, sigma).modes[0]
        return w**2 / (2 * b**2) - mp.mpf("0.6")

    with mp.workdps(30):
        sigma = mp.findroot(beyond, mp.mpf("0.168"))
        period = 2 * mp.pi / Backbone(0.1, sigma).modes[0][0]
    assert mark.h == pytest.approx(float(sigma), rel=1e-9) and mark.alpha == pytest.approx(float(period), rel=1e-8)
