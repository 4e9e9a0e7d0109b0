"""Long cases of tests/saltus/test_continue_further.py."""

import pytest

from tests.saltus import test_continue_further as origin
from tests.saltus.running import read_json, run
from tests.saltus.test_continue_further import PD, SN, STARTED, require_a_family_ends_where_the_system_ends, require_in_order, values

pytestmark = origin.pytestmark


@pytest.mark.parametrize(
    ("name", "texts", "bound", "words"),
    [
        ("a", ("1.0", '"a"'), 1.0, "a leaves its domain here"),
        ("a", ("1.0", '"1.25*a"'), 0.8 / 0.8, "restitution lies in [0, 1]"),
        ("a", ("1.0", '"a/b"'), 1.0, "restitution lies in [0, 1]"),
    ],
)
def test_a_family_ends_where_the_system_ends(capsys, folder, name, texts, bound, words):
    """Oracle: see `require_a_family_ends_where_the_system_ends`."""
    require_a_family_ends_where_the_system_ends(capsys, folder, name, texts, bound, words)


def test_a_branch_goes_on_beyond_both_ends(capsys):
    """Oracle: the family followed at once, and the closed form: PD above the range of the file, SN below it."""
    assert run(capsys, *STARTED, "--range=-0.3:-0.1", "--json", "a.json")[0] == 0
    (first,) = read_json("a.json")["branches"]
    code, out, err = run(capsys, "continue", "--from", "a.json", "--range=-3:1", "--json", "b.json")
    assert code == 0, err
    (further,) = read_json("b.json")["branches"]
    require_in_order(further)
    assert further["range"] == [-3.0, 1.0] and len(further["points"]) > len(first["points"])
    unknowns = [point["unknowns"] for point in further["points"]]
    assert all(point["unknowns"] in unknowns for point in first["points"])
    found = values(further)
    assert found["PD1"] == pytest.approx(PD, abs=1e-12) and found["SN1"] == pytest.approx(SN, abs=1e-12)
    assert run(capsys, *STARTED, "--range=-3:1", "--json", "c.json")[0] == 0
    (whole,) = read_json("c.json")["branches"]
    assert found == pytest.approx(values(whole), abs=1e-9) and further["ended"] == whole["ended"]
    assert "EP" not in {event["type"] for event in further["events"]}
    code, out, _ = run(capsys, "continue", "--from", "b.json", "--range=-3:1", "--json", "d.json")
    assert code == 0 and "nothing is left to follow" in out
    assert read_json("d.json")["branches"] == read_json("b.json")["branches"]
