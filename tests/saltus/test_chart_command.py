"""`saltus chart`: options, files, messages, exit codes."""

import csv
import json

import numpy as np
import pytest

from saltus.__main__ import main
from tests.saltus.running import read_json, refused, reported

RANGE = "0.9:1.1,0.06:0.25"
SHORT = f"--in w,A --from response.json --range {RANGE} --levels 0"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the response of the damped impact oscillator at A = 0.12, and one without events for curves."""
    place = tmp_path_factory.mktemp("chart")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        follow = "continue --scene damped_impact_oscillator --from simulate --in w"
        assert main([*follow.split(), "--set", "A=0.12", "--range", "0.9:1.1", "--json", "response.json"]) == 0
        assert main([*follow.split(), "--set", "A=0.05", "--range", "0.95:1.05", "--json", "quiet.json"]) == 0
        assert main("orbit S11- --energy 1 --json orbit.json".split()) == 0
    return place


@pytest.fixture
def inside(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def chart(words):
    return reported(f"chart {words}")


def test_the_report_and_all_files(inside):
    """Contract: stages, curves, points and regions are printed; the files have the same numbers."""
    code, out, err = chart(f"{SHORT} --grid 4x3 --workers 1 --json c.json --csv c.csv --npz c.npz --mat c.mat --plot c.png")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "chart    2 events of response.json in w and A"
    assert "stage    events of the branches: 2 starts, 2 new curves" in lines
    assert "stage    points of codimension two: 4 starts, 3 on known curves, 1 new curve" in lines
    assert any(line.split()[:4] == ["SN-GR,", "PD-GR", "0.998749217772", "0.0999062060134"] for line in lines)
    assert any(line.startswith("regions  sampled in 4 x 3 cells") for line in lines)
    record = read_json("c.json")
    assert record["kind"] == "chart" and [curve["code"] for curve in record["curves"]] == ["GR", "PD", "SN"]
    assert record["found_in"] == ["events of the branches"] * 2 + ["points of codimension two"]
    (point,) = record["codimension_two"]
    assert point["curves"] == [1, 2, 3] and set(point["events"]) == {"SN-GR1", "PD-GR1", "2.PD-GR1", "3.SN-GR1"}
    regions = record["regions"]
    assert np.shape(regions["cells"]) == (3, 4) and sum(one["cells"] for one in regions["sets"]) == 12
    with open("c.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    points = sum(len(curve["points"]) for curve in record["curves"])
    assert len(rows) == points + 12 and rows[-1]["type"] == "cell" and rows[-1]["attractors"]
    with np.load("c.npz") as arrays:
        assert len(arrays["w"]) == len(rows)
        assert json.loads(str(arrays["about"]))["window"] == [[0.9, 1.1], [0.06, 0.25]]
    assert (inside / "c.png").stat().st_size > 20000 and (inside / "c.mat").stat().st_size > 0


def test_a_curve_goes_on_from_a_chart(inside):
    """Contract: the JSON file is a file of curves. Oracle: A = |1 - w^2 + 0.1 i w| of the grazing."""
    assert chart(f"{SHORT} --grid 0x0 --json curves.json")[0] == 0
    assert read_json("curves.json")["regions"] is None
    code, out, err = reported(f"curve curves.json:2.PD-GR1 --to GR --range {RANGE} --json again.json")
    assert (code, err) == (0, ""), err
    assert "curve GR" in out
    (again,) = read_json("again.json")["curves"]
    assert again["code"] == "GR" and len(again["points"]) > 20
    for w, amplitude in (point["parameters"] for point in again["points"]):
        assert amplitude == pytest.approx(np.hypot(1.0 - w * w, 0.1 * w), rel=1e-9)


def test_default_ranges_are_printed(inside):
    """Contract."""
    code, out, _ = chart("--in w,A --from response.json --levels 0 --grid 0x0 --curves 1")
    assert code == 0
    assert "range    w = 0.9 to 1.1, the range of the branch" in out
    assert "range    A = 0.03 to 0.48, a factor of 4 around its value 0.12" in out
    assert "left, --curves N allows more" in out


def test_an_interrupt_writes_what_was_found(inside, monkeypatch):
    """Contract: exit code 130, with the curves of the first stage."""
    from transitions.chart.curves import CurveSearch

    def stop(self):
        raise KeyboardInterrupt

    monkeypatch.setattr(CurveSearch, "through_points", stop)
    code, out, err = chart(f"{SHORT} --grid 2x2 --json part.json --plot part.png")
    assert code == 130 and "interrupted" in err
    assert [curve["code"] for curve in read_json("part.json")["curves"]] == ["GR", "PD"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--in w,A", ["--from RESPONSE is required"]),
        ("--from response.json", ["--in P1,P2 is required"]),
        ("--in w,A --from none.json", ["no file none.json"]),
        ("--in w,A --from orbit.json", ["orbit.json", "no response"]),
        ("--in w --from response.json", ["plane of two parameters", "received 1"]),
        ("--in w,w --from response.json", ["given twice"]),
        ("--in w,A,c --from response.json", ["needs 1 equation --keep", "received 0"]),
        ("--in w,A --keep c=0.1*w --from response.json", ["needs no --keep"]),
        ("--in w,a --from response.json", ["--in a: no such parameter", "nearest: A"]),
        ("--in w,A --from response.json --range 0.9:1.1", ["--range", "LO:HI,LO:HI"]),
        ("--in w,A --from response.json --range 0.9:1.1,0.2:0.1", ["LO:HI"]),
        ("--in w,A --from response.json --range 0.9:1.1,0.2:0.3", ["does not contain the start, which has A = 0.12"]),
        ("--in w,A --from response.json --range 1.05:1.1,0.1:0.3", ["does not contain the start", "w = 0.963576 to 0.996366"]),
        ("--in w,e --from response.json --range 0.9:1.1,-2:-0.5", ["--range"]),
        ("--in w,A --from quiet.json", ["has no event that can be continued", "EP"]),
        ("--scene absorber --in w,A --from response.json", ["another system than the scene absorber"]),
        ("--scene damped_impact_oscillator --set A=0.1 --in w,A --from response.json", ["another system", "there A is 0.12, not 0.1"]),
        ("--in c,e --from response.json", ["the events of the response have different values of w", "expected w among the parameters"]),
        ("--in A,w --from response.json --range 0.2:0.3,0.9:1.1", ["does not contain the start, which has A = 0.12"]),
        ("--in w,A --from response.json --grid 5", ["--grid", "NXxNY"]),
        ("--in w,A --from response.json --grid 0x5", ["--grid", "0x0 for no regions"]),
        ("--in w,A --from response.json --levels -1", ["--levels"]),
        ("--in w,A --from response.json --periods 10000000000", ["--periods", "up to 1e9"]),
        ("--in w,A --from response.json --workers 2 --dask x", ["--dask"]),
    ],
)
def test_bad_input_is_refused_in_one_line(inside, words, expected):
    """Contract: exit code 2, nothing started."""
    refused(chart(words), *expected)


def test_the_response_has_values_of_its_own(inside):
    """The scene has A = 0.1, and the response A = 0.12. Oracle: the chart without a scene."""
    found = [chart(f"{words} {SHORT} --grid 0x0") for words in ("", "--scene damped_impact_oscillator")]
    assert found[0] == found[1] and found[0][0] == 0


def test_a_system_without_periodic_loads_has_no_chart(inside):
    """Contract: the message names the other command."""
    assert reported("continue S13+ --in sigma --range 0.095:0.105 --keep energy=0.6 --json free.json")[0] == 0
    refused(chart("--in mu,sigma --from free.json"), "no responses to periodic loads", "expected saltus curve free.json:EVENT")
