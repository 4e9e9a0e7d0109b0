"""`saltus curve`: bifurcations and grazings in the plane of two parameters, from events of families, and what is refused."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from saltus.curves import report_lines
from saltus.inputs import curves_in
from tests.branches.curve_oracles import ImpactOscillator, ReferenceBackbone
from tests.saltus.running import refused, run

ROOT = Path(__file__).parents[2]
RANGE = ("--range", "0.7:1.4,0.02:3")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A response, a family in the energy, and a curve of each."""
    from saltus.__main__ import main

    folder = tmp_path_factory.mktemp("curves")
    response, family, fold = folder / "response.json", folder / "S11.json", folder / "fold.json"
    simulated = ("--scene", "damped_impact_oscillator", "--set", "w=1.1", "--set", "A=0.3", "--from", "simulate", "--in", "A")
    assert main(["continue", *simulated, "--range", "0.05:1", "--json", str(response)]) == 0
    assert main(["continue", "S11-", "--json", str(family), "--energy", "0.01:1"]) == 0
    assert main(["curve", f"{response}:SN1", "--in", "w,A", *RANGE, "--json", str(fold)]) == 0
    return {"response": response, "family": family, "fold": fold}


def test_a_fold_in_all_formats(files, folder, capsys):
    """Oracle: the closed form. All files have the same points."""
    written = ("--json", "c.json", "--csv", "c.csv", "--npz", "c.npz", "--mat", "c.mat", "--plot", "c.png")
    code, out, err = run(capsys, "curve", f"{files['response']}:SN1", "--in", "w,A", *RANGE, *written)
    assert code == 0, err
    row = next(line for line in out.splitlines() if line.startswith("SN-GR1"))
    assert [float(cell) for cell in row.split()[1:3]] == pytest.approx([0.99874921777190895, 0.09990620601340443], abs=1e-12)
    record = json.loads((folder / "c.json").read_text())["curves"][0]
    points = np.array([point["parameters"] for point in record["points"]])
    for w, amplitude in points[::5]:
        assert amplitude == pytest.approx(float(ImpactOscillator("0.1", "0.8").fold(w).amplitude), rel=1e-12)
    with (folder / "c.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["w"]) for row in rows] == points[:, 0].tolist()
    assert np.load(folder / "c.npz")["A"].tolist() == points[:, 1].tolist()
    assert loadmat(folder / "c.mat")["A"].ravel().tolist() == points[:, 1].tolist()
    assert (folder / "c.png").read_bytes()[:4] == b"\x89PNG"


def test_standard_output_carries_only_the_data(files, folder, capsys):
    code, out, _ = run(capsys, "curve", f"{files['response']}:SN1", "--in", "w,A", *RANGE, "--json", "-")
    assert code == 0 and json.loads(out)["kind"] == "curve"


def test_the_fold_of_a_free_family(files, folder, capsys):
    """Oracle: the closed form in many digits. Tables and files have the parameters in the order that was asked for."""
    place = f"{files['family']}:SN1"
    code, out, err = run(capsys, "curve", place, "--in", "energy,mu", "--range", "0.01:10,0.02:1", "--csv", "c.csv", "--plot", "c.png")
    assert code == 0, err
    assert next(line for line in out.splitlines() if line.startswith("event")).split()[:3] == ["event", "energy", "mu"]
    with (folder / "c.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[4:6] == ["energy", "mu"]
    for row in rows[:: len(rows) // 6]:
        exact = ReferenceBackbone(row["mu"], "0.1").fold()
        assert float(row["energy"]) == pytest.approx(float(exact.h), rel=1e-11)


def test_another_curve_at_a_point(files, folder, capsys):
    code, out, err = run(capsys, "curve", f"{files['fold']}:SN-GR1", "--to", "GR", *RANGE)
    assert code == 0, err
    assert out.startswith("start  SN-GR1 of fold.json: curve GR in w and A")
    assert "PD-GR1" in out and "SN-GR1" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "START is required"),
        (("none.json:SN1", "--in", "w,A", *RANGE), "no file none.json; expected FILE:EVENT"),
        (("{response}", "--in", "w,A", *RANGE), "which event? expected"),
        (("{response}:SN9", "--in", "w,A", *RANGE), "has no event SN9; nearest: SN1; it has"),
        (("{response}:SN1", *RANGE), "--in P1,P2 is required"),
        (("{response}:SN1", "--in", "w", *RANGE), "a curve lies in the plane of two parameters; received 1, expected P1,P2"),
        (("{response}:SN1", "--in", "w,A,c", *RANGE), "--in w,A,c needs 1 equation --keep; received 0"),
        (("{response}:SN1", "--in", "w,A", "--keep", "c=0.1", *RANGE), "--in w,A needs no --keep; received 1"),
        (("{response}:SN1", "--in", "w,w", *RANGE), "a parameter is given twice"),
        (("{response}:SN1", "--in", "w,AA", *RANGE), "unknown parameter AA; expected one of k, c, A, w, d, e"),
        (("{response}:SN1", "--in", "w,energy", *RANGE), "unknown parameter energy"),
        (("{response}:SN1", "--in", "w,A"), "--range LO:HI,LO:HI is required"),
        (("{response}:SN1", "--in", "w,A", "--range", "0.7:1.4"), "--range: received '0.7:1.4', expected LO:HI,LO:HI, two ranges"),
        (("{response}:SN1", "--in", "w,A", "--range", "0.7:1,0.02:3"), "--range 0.7:1 of w does not contain the start, which has w = 1.1"),
        (("{response}:SN1", "--in", "w,A", "--to", "GR", *RANGE), "is a family; expected an event of a curve, or no --to"),
        (("{response}:EP1", "--in", "w,A", *RANGE), "cannot be continued: the end of a run is no bifurcation; expected one of SN, PD"),
        (("{response}:GR1", "--in", "A,e", "--range", "0.05:1,0.1:0.9"), "the GR does not depend on e: it stays at A = 0.237065"),
        (("{family}:RT1", "--in", "energy,mu", "--range", "0.01:10,0.02:1"), "a p:q resonance changes no stability"),
        (("{family}:SN1", "--in", "energy,quarter_period", "--range", "0.01:10,0.02:2"), "a plane needs a parameter of the system"),
        (("{family}:SN1", "--in", "energy,muu", "--range", "0.01:10,0.02:1"), "unknown parameter muu"),
        (
            ("{family}:SN1", "--in", "mu,sigma", "--range", "0.01:1,0.02:1"),
            "needs 1 equation --keep, such as --keep energy=0.8",
        ),
        (("{fold}:SN-GR1", "--to", "NS", *RANGE), "no curve NS passes through the point"),
        (("{fold}:SN-GR1", "--in", "w,c", *RANGE), "has w, A; expected these, or no --in"),
    ],
)
def test_what_is_refused(files, folder, capsys, words, message):
    """One line that names what was received and what was expected, and exit code 2."""
    refused(run(capsys, "curve", *(word.format(**files) for word in words)), message)


@pytest.mark.parametrize("start", ["{response}:SN1", "{fold}", "{fold}:SN-GR1"])
@pytest.mark.parametrize("words", [("--scene", "absorber"), ("--scene", "damped_impact_oscillator", "--set", "c=0.2")])
def test_another_scene_than_that_of_the_file_is_refused(files, folder, capsys, start, words):
    given = ("--in", "w,A", *RANGE, *words)
    refused(run(capsys, "curve", start.format(**files), *given), "another system than the scene", "expected its scene, or none")


def test_folds_of_a_steep_spring(folder, capsys):
    """The parameters of springs are those of a scene. Oracle: the cusp of docs/limit.md."""
    assert run(capsys, "continue", "S11-", "--scene", "smooth_wall", "--n", "15", "--energy", "0.05:0.1", "--json", "s.json")[0] == 0
    words = ("curve", "s.json:SN1", "--in", "energy,n", "--range", "0.01:1,14:15.5")
    refused(run(capsys, *words), " without --scene: unknown parameter n; expected one of energy, quarter_period")
    refused(run(capsys, *words, "--scene", "smooth_wall"), "s.json has another system than the scene smooth_wall")
    code, out, err = run(capsys, *words, "--scene", "smooth_wall", "--n", "15")
    assert code == 0, err
    cusp = next(line for line in out.splitlines() if line.startswith("CP1")).split()
    page = (ROOT / "docs" / "limit.md").read_text(encoding="utf-8")
    wanted = re.search(r"appear together, at n = ([\d.]+) and h = ([\d.]+)", page)
    assert [float(cell) for cell in cusp[1:3]] == pytest.approx([float(wanted[2].rstrip(".")), float(wanted[1])], rel=1e-10)


def test_an_equation_that_does_not_hold_at_the_event_is_said(files, folder, capsys):
    words = ("curve", f"{files['family']}:SN1", "--in", "mu,sigma", "--range", "0.09:0.11,0.05:0.2", "--points", "5")
    code, out, _ = run(capsys, *words, "--keep", "energy=0.07")
    assert code == 0 and "note   an equation to keep does not hold at the event: the curve starts at mu = " in out
    assert "energy = 0.07 where the event has 0.06911645" in out
    code, out, _ = run(capsys, *words, "--keep", "energy=0.0691164499683")
    assert code == 0 and "note" not in out


def test_a_coefficient_that_is_not_known_is_said(files):
    (fold,) = curves_in(str(files["fold"]))
    unknown = replace(fold, coefficient=np.full(len(fold), np.nan))
    assert not any(line.startswith("note") for line in report_lines(unknown, None))  # the coefficient of a fold decides nothing
    notes = [line for line in report_lines(replace(unknown, code="PD"), None) if line.startswith("note")]
    assert notes == ["note   the coefficient of the normal form is not known along the curve: a point GPD on it is not found"]


def test_what_does_not_fit_a_point_of_a_curve_says_what_is_expected(files, folder, capsys):
    start = ("curve", f"{files['fold']}:SN-GR1", "--to", "NS", *RANGE)
    refused(run(capsys, *start), "no curve NS passes through the point, which has SN-GR", "expected a point where a curve NS meets")
    outside = refused(run(capsys, "continue", "--from", f"{files['fold']}:#10", "--in", "A", "--range", "2:3"), "expected it inside")
    assert "--set" not in outside
