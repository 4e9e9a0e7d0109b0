"""Long cases of tests/saltus/test_curve_self_excited.py."""

import pytest

from tests.saltus import test_curve_self_excited as origin
from tests.saltus.running import read_branch, read_json, run

files = origin.files


def test_a_curve_goes_on_and_a_family_begins_on_it(files, folder, capsys):
    """Oracle: the parameters of the points."""
    code, _, err = run(capsys, "curve", str(files["fold"]), "--range", "0:0.5,0.05:0.95", "--json", "wide.json")
    assert code == 0, err
    rho = [point["parameters"][1] for point in read_json("wide.json")["curves"][0]["points"]]
    assert (min(rho), max(rho)) == pytest.approx((0.05, 0.95), abs=1e-9)
    code, _, err = run(capsys, "continue", "--from", "wide.json:EP2", "--in", "lam", "--range", "0.01:0.2", "--json", "a.json")
    assert code == 0, err
    event = next(event for event in read_branch("a.json")["events"] if event["type"] == "SN")
    curve = read_json("wide.json")["curves"][0]
    end = next(one for one in curve["events"] if one["id"] == "EP2")
    assert event["values"]["lam"] == pytest.approx(end["values"]["lam"], rel=1e-9)
