"""Long cases of tests/saltus/test_free_curve_catalogues.py."""

import pytest

from tests.saltus import test_free_curve_catalogues as origin
from tests.saltus.running import read_json, run
from tests.saltus.test_free_curve_catalogues import PLANE

folder = origin.folder


def test_a_curve_of_free_orbits_goes_on(folder, capsys):
    """Oracle: one run in the wide range."""
    wide = "0.05:0.2,0.01:1"
    code, out, err = run(capsys, "curve", folder / "c.json", "--range", wide, "--json", folder / "d.json")
    assert code == 0, err
    code, out, err = run(capsys, "curve", f"{folder / 'f.json'}:GR1", *PLANE[:2], "--range", wide, "--json", folder / "e.json")
    assert code == 0, err
    (found,), (whole,) = read_json(folder / "d.json")["curves"], read_json(folder / "e.json")["curves"]
    assert found["id"] == whole["id"]
    for event, expected in zip(found["events"], whole["events"], strict=True):
        assert event["id"] == expected["id"] and event["values"] == pytest.approx(expected["values"], abs=1e-9)
