"""Long cases of tests/saltus/test_curve_catalogues.py."""

import shutil

import pytest

from branches.catalogue import Catalogue
from tests.saltus import test_curve_catalogues as origin
from tests.saltus.running import read_json, run
from tests.saltus.test_curve_catalogues import WIDE

curve = origin.curve
folder = origin.folder
id = origin.id
kept = origin.kept


def test_a_longer_curve_replaces_the_stored_one(folder, kept, curve, id, capsys, tmp_path):
    """Oracle: the run in the wide range from the event."""
    place, longer = shutil.copy(kept, tmp_path / "b.sqlite"), tmp_path / "d.json"
    code, out, err = run(capsys, "curve", curve, WIDE, "--json", longer, "--save", "--catalogue", place)
    assert code == 0 and "wider  PD:s,w:" in out, err
    assert run(capsys, "curve", f"{folder / 'r.json'}:PD1", "--in", "s,w", WIDE, "--json", tmp_path / "e.json")[0] == 0
    (found,), (whole,) = read_json(longer)["curves"], read_json(tmp_path / "e.json")["curves"]
    assert found["id"] == whole["id"] != id
    for event, expected in zip(found["events"], whole["events"], strict=True):
        assert event["id"] == expected["id"] and event["values"] == pytest.approx(expected["values"], abs=1e-9)
    first_point = next(
        i for i, point in enumerate(found["points"]) if point["unknowns"] == read_json(curve)["curves"][0]["points"][0]["unknowns"]
    )
    for here, there in zip(found["points"][first_point:], read_json(curve)["curves"][0]["points"], strict=False):
        assert here["unknowns"] == there["unknowns"] and here["parameters"] == there["parameters"]
    with Catalogue(place) as catalogue:
        assert [row.id for row in catalogue.curve_rows()] == [found["id"]]
    code, out, _ = run(capsys, "curve", longer, WIDE)
    assert code == 0 and "nothing is left to follow" in out
    code, out, _ = run(capsys, "curve", "PD:", "--range=-0.13:0.01,2.7:3", "--save", "--catalogue", place)
    assert code == 0 and "wider  PD:s,w:" in out
    code, out, _ = run(capsys, "curve", longer, "--range=-0.08:-0.05,2.7:3", "--json", tmp_path / "f.json")
    assert code == 0, "in a range that does not contain it, it is followed again"
    assert min(point["parameters"][0] for point in read_json(tmp_path / "f.json")["curves"][0]["points"]) == pytest.approx(-0.08)
