"""`saltus continue NAME --in PARAMETER --keep EQUATION`: starts, files, figures, messages, exit codes."""

import csv

import mpmath as mp
import numpy as np
import pytest
from scipy.io import loadmat

from benchmarks.backbone import Backbone
from tests.saltus.running import read_json, refused, run

pytestmark = pytest.mark.usefixtures("folder")


def rows_of(path):
    """The rows of a CSV file."""
    with open(path, encoding="utf-8") as file:
        return list(csv.DictReader(file))


def grazing_in_sigma():
    """Where the linear mode of the reference system grazes with energy 0.6: h = w^2/(2 b^2), in closed form."""

    def beyond(sigma):
        w, _, b = Backbone(0.1, sigma).modes[0]
        return w**2 / (2 * b**2) - mp.mpf("0.6")

    with mp.workdps(30):
        return float(mp.findroot(beyond, mp.mpf("0.168")))


def test_a_backbone_in_sigma(capsys):
    """Oracle: the closed form at each point, in each kind of file."""
    words = "S13+", "--in", "sigma", "--range", "0.06:0.2", "--keep", "energy=0.6"
    files = [word for kind in ("json", "csv", "npz", "mat") for word in (f"--{kind}", f"a.{kind}")]
    code, out, err = run(capsys, "continue", *words, *files, "--plot", "a.png", "--y", "start:u1'", "--uz", "0.15")
    assert code == 0, err
    assert out.splitlines()[0] == "start  S13O00+: from h = 0.6, alpha = 1.699237773"
    assert "origin-stop+, sequence (none); energy=0.6" in out and "event" in out and "stable after" in out
    branch = read_json("a.json")["branches"][0]
    assert branch["ends"] == ["origin", "stop+"] and branch["keep"] == ["energy=0.6"] and branch["released"] == ["sigma"]
    points = branch["points"]
    assert points[0]["sigma"] == pytest.approx(0.06) and points[-1]["sigma"] == pytest.approx(grazing_in_sigma(), rel=1e-9)
    for point in points[2:-2:8]:
        form = Backbone(0.1, point["sigma"])
        assert float(form.energy(point["alpha"])) == pytest.approx(0.6, rel=1e-12)
        assert point["h"] == pytest.approx(0.6, rel=1e-13) and point["label"] == "S13O00+"
        assert point["stable"] is form.stable(point["alpha"])
    marked = next(event for event in branch["events"] if event["type"] == "UZ")
    assert marked["values"]["sigma"] == pytest.approx(0.15) and set(marked["values"]) >= {"mu", "sigma", "energy", "quarter_period"}
    rows = rows_of("a.csv")
    assert [float(row["alpha"]) for row in rows] == [point["alpha"] for point in points]
    with np.load("a.npz") as arrays:
        assert arrays["alpha"].tolist() == [point["alpha"] for point in points]
    assert loadmat("a.mat")["sigma"].ravel().tolist() == [point["sigma"] for point in points]


def test_a_saved_family_is_shown_drawn_and_goes_on(capsys):
    """Oracle: the file; the closed form of the end; the family that begins at an event has it at the same sigma."""
    code, _, err = run(capsys, "continue", "S13+", "--in", "sigma", "--range", "0.09:0.13", "--keep", "energy=0.6", "--json", "a.json")
    assert code == 0, err
    shown = run(capsys, "show", "a.json")
    assert shown[0] == 0 and "energy=0.6" in shown[1] and "S" in shown[1]
    assert run(capsys, "plot", "a.json", "--y", "tau_half", "--plot", "a.pdf")[0] == 0
    code, out, _ = run(capsys, "continue", "--from", "a.json", "--range", "0.06:0.2", "--json", "b.json")
    assert code == 0 and "GR1" in out
    first, last = (read_json(name)["branches"][0] for name in ("a.json", "b.json"))
    assert {event["type"] for event in first["events"]} == {"SB", "EP"}
    assert last["points"][-1]["sigma"] == pytest.approx(grazing_in_sigma(), rel=1e-9)
    code, out, _ = run(capsys, "continue", "--from", "a.json", "--in", "mu", "--range", "0.09:0.11", "--keep", "energy = 0.6*mu/0.1")
    assert code == 0 and "mu = 0.09" in out
    code, _, err = run(capsys, "continue", "--from", "b.json:SB1", "--json", "c.json")
    assert code == 0, err
    first, last = (read_json(name)["branches"][0]["events"] for name in ("b.json", "c.json"))
    broken = next(event["values"]["sigma"] for event in first if event["type"] == "SB")
    assert next(event["values"]["sigma"] for event in last if event["type"] == "BP") == pytest.approx(broken, rel=1e-9)
    code, _, err = run(capsys, "continue", "--from", "b.json:GR1")
    assert code == 1 and "all impacts vanish at GR1: the linear mode L11+ remains" in err


def test_two_parameters_and_an_equation_that_names_both(capsys):
    """Oracle: the closed form where energy = quarter_period/3 and sigma = mu."""
    keep = "--keep", "energy = quarter_period/3", "--keep", "sigma = mu"
    words = "continue", "S13+", "--in", "mu,sigma", "--range", "0.05:0.3", *keep, "--points", "30", "--csv", "a.csv"
    code, out, err = run(capsys, *words)
    assert code == 0, err
    for point in rows_of("a.csv")[::5]:
        mu, alpha = float(point["mu"]), float(point["alpha"])
        assert float(point["sigma"]) == pytest.approx(mu, rel=1e-14)
        assert float(Backbone(mu, mu).energy(alpha)) == pytest.approx(alpha / 3.0, rel=1e-12)


def test_a_mode_and_a_file_of_an_orbit(capsys):
    words = "--in", "mu", "--range", "0.09:0.11", "--keep", "energy=1"
    code, out, err = run(capsys, "continue", "--from", "mode:1", *words)
    assert code == 0 and out.startswith("start  S13O00+: from h = 1"), err
    assert run(capsys, "orbit", "S13+", "--energy", "0.5", "--json", "orbit.json")[0] == 0
    code, out, err = run(capsys, "continue", "--from", "orbit.json", *words)
    assert code == 0 and out.startswith("start  S13O00+: from h = 1"), err


CASES = [
    ("--in mu --range 0.02:1", ["--in mu: free orbits in 1 parameter need 1 equation --keep", "energy=0.8", "received 0"]),
    ("--in mu,sigma --range 0.02:1 --keep energy=1", ["2 parameters need 2 equations", "received 1"]),
    ("--in mu,mu --range 0.02:1 --keep energy=1 --keep sigma=1", ["given twice"]),
    ("--in mu --keep energy=0.5", ["--range LO:HI is required"]),
    ("--in nu --range 0.02:1 --keep energy=0.5", ["--in nu: no such parameter; nearest: mu"]),
    ("--in mu --range 0.2:1 --keep energy=0.5", ["--range 0.2:1 has not the start's value mu = 0.1", "--set mu=VALUE"]),
    ("--in lam --range 0:1 --keep energy=0.5", ["lam damps the system", "conservative"]),
    ("--in rho --range 0.5:1 --keep energy=0.5", ["rho changes a restitution", "conservative"]),
    ("--in mu --range 0.02:1 --keep energy=-1", ["--keep energy=-1: expected a value above 0"]),
    ("--in mu --range 0.02:1 --keep energy=1e9", ["no orbit of S13+ has h = 1000000000"]),
    ("--in mu --range 0.02:1 --keep foo=1", ["name foo, which is no parameter", "energy, quarter_period"]),
    ("--in mu --range 0.02:1 --keep sigma=0.1", ["no equation names energy or quarter_period"]),
    ("--in mu --range 0.02:1 --keep energy", ["an equation is LEFT = RIGHT"]),
    ("--in mu --range 0.02:1 --keep energy=quarter_period*99", ["no orbit of S13+ fulfils it", "the family has h ="]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --y alfa", ["--y: unknown column 'alfa'; nearest: alpha"]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --energy 1:2", ["--energy belongs to families in the energy"]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --phase 1", ["--phase is where a simulation starts"]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --stop-at EP", ["--stop-at EP: a family of free orbits in a parameter has no such event"]),
    ("--in mu --range 0.02:1 --keep energy=0.5 --set lam=0.1", ["families of free orbits need a conservative system: damping acts on u2"]),
    ("--in w --range 0.02:1 --keep energy=0.5 --scene absorber", ["S13+ is a free orbit, and the scene has [[forces]]"]),
]


@pytest.mark.parametrize(("words", "expected"), CASES)
def test_bad_input(capsys, words, expected):
    refused(run(capsys, "continue", "S13+", *words.split()), *expected)


def test_a_scene_without_parameters(capsys, tmp_path):
    matrices = "mass = [[1.0]]\nstiffness = [[1.0]]\n"
    (tmp_path / "scene.toml").write_text(f'[system]\n{matrices}[[springs]]\non = "u1"\nstiffness = 1.0\npower = 3\n')
    words = ("--scene", tmp_path / "scene.toml", "--from", "mode:1", "--in", "k", "--range", "0:1", "--keep", "energy=1")
    refused(run(capsys, "continue", *words), "--in k: no such parameter; the scene has no [parameters]")


def test_bad_input_with_a_file(capsys):
    assert run(capsys, "continue", "S13+", "--in", "sigma", "--range", "0.09:0.1", "--keep", "energy=0.5", "--json", "a.json")[0] == 0
    refused(run(capsys, "continue", "--from", "a.json:EP1"), "no other family begins at EP1", "BP, SB, PD, RT, GR")
    refused(run(capsys, "continue", "--from", "a.json:XX"), "no such event")
    refused(run(capsys, "continue", "--from", "a.json:EP1", "--in", "mu", "--keep", "energy=1"), "keeps energy=0.5", "expected no --in")
    refused(run(capsys, "continue", "S13+", "--from", "a.json"), "received S13+ and --from a.json")
    refused(run(capsys, "continue", "--from", "a.json", "--keep", "energy=1"), "needs --in NAME")
    refused(run(capsys, "continue", "--from", "a.json", "--set", "mu=0.2"), "has a system of its own")
    refused(run(capsys, "continue", "--from", "a.json", "--in", "sigma", "--keep", "energy=1"), "--range LO:HI is required")
