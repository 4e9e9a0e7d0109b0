"""Smooth scenes on the command line: families by name, from a mode, from a file and in a parameter; files, figures and messages."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.io import mmread
from scipy.linalg import eigh

from saltus.catalogues import default_path
from saltus.scene import load_scene
from tests.branches.test_smooth_agreement import second
from tests.saltus.running import read_json, refused, run

COLUMNS = ("h", "alpha", "frequency", "frequency_index", "half_waves", "stable", "velocities.1", "velocities.2")

pytestmark = pytest.mark.usefixtures("folder")


def test_a_family_is_followed_by_its_label_and_from_its_file(capsys, folder):
    """Oracle: the folds as the library finds them from both sides, and a family that is the same from its own file."""
    code, out, err = run(capsys, "continue", "S11-", "--scene", "cubic_nes", "--energy", "2e-3:0.02", "--json", "a.json", "--plot", "a.png")
    assert code == 0 and not err and "start  S11-" in out
    branch = read_json("a.json")
    folds = [event["h"] for event in branch["events"] if event["type"] == "SN"]
    assert len(folds) == 2 and abs(folds[0] / 0.0051506713248611 - 1.0) < 1e-9 and abs(folds[1] / 0.0024762885445911 - 1.0) < 1e-9
    assert {point["label"] for point in branch["points"]} == {"S11-"}
    assert max(point["residual"] for point in branch["points"]) < 1e-12 and (folder / "a.png").stat().st_size > 10_000
    code, _, _ = run(capsys, "continue", "--from", "a.json@h=0.01", "--energy", "2e-3:0.02", "--json", "b.json")
    assert code == 0 and read_json("b.json")["branch"]["id"] == branch["branch"]["id"]


def test_a_catalogue_keeps_smooth_families(capsys):
    """Oracle: its own check, which computes each point anew."""
    assert run(capsys, "continue", "S11-", "--scene", "cubic_nes", "--energy", "0.01:0.1", "--save", "--catalogue", "c.sqlite")[0] == 0
    code, out, _ = run(capsys, "list", "--catalogue", "c.sqlite")
    assert code == 0 and "S11- " in out and "S11O00" not in out
    code, out, _ = run(capsys, "check", "--catalogue", "c.sqlite")
    assert code == 0 and "all hold" in out


@pytest.fixture
def kept(capsys, folder, monkeypatch):
    """The families of both modes of two masses, in the catalogue of the scene and in files."""
    monkeypatch.setenv("XDG_DATA_HOME", str(folder / "data"))
    for mode in (1, 2):
        words = ("--from", f"mode:{mode}", "--scene", "duffing_pair", "--energy", "0.01:100", "--save", "--json", f"{mode}.json")
        assert run(capsys, "continue", *words)[0] == 0


def test_the_catalogue_of_a_smooth_scene_is_that_of_the_scene(capsys, kept):
    """Oracle: the commands answer alike with the scene's name, below a line with its parameters, and with the catalogue's. Another scene is
    refused."""
    path = default_path("duffing_pair")
    for words in (("list",), ("show", "S11-"), ("tree", "S11-"), ("check",), ("export", "points", "--csv", "-")):
        code, out, err = run(capsys, *words, "--scene", "duffing_pair")
        assert (code, out.removeprefix("at       k3 = 0.5\n"), err) == run(capsys, *words, "--catalogue", path) and code == 0
    refused(run(capsys, "list", "--scene", "cubic_nes", "--catalogue", path), "belongs to another system: there mass[0] is")


def test_a_frequency_energy_plot_of_smooth_families(capsys, folder, kept):
    """Oracles: the energy of each point from its start velocities, as the springs are at rest there; DOP853 for quarter periods and
    stability; the events of the files; one picture of the catalogue, of the files in its order (both begin at one energy, so by id) and
    of the data."""
    shown = ("export", "fep", "--plot")
    files = sorted(("1.json", "2.json"), key=lambda file: read_json(file)["branch"]["id"])
    for words in (
        (*shown, "a.svg", "--scene", "duffing_pair", "--csv", "a.csv", "--json", "a.json"),
        (*shown, "b.svg", "--scene", "duffing_pair", "--branches", *files),
        (*shown, "c.svg", "--data", "a.json"),
    ):
        code, out, err = run(capsys, *words)
        assert code == 0 and not err and f"wrote  {words[3]}" in out
    pictures = [(folder / f"{name}.svg").read_text() for name in "abc"]
    assert pictures[0] == pictures[1] == pictures[2]
    for part in ("stable", "unstable", "events-PD", "events-SB"):
        assert f'id="frequency-{part}"' in pictures[0]
    with open("a.csv", encoding="utf-8") as file:
        next(file)
        rows = [{"event": row["event"], **{name: float(row[name]) for name in COLUMNS}} for row in csv.DictReader(file)]
    files = [read_json(f"{mode}.json") for mode in (1, 2)]
    found = sorted((row["event"], row["h"]) for row in rows if row["event"])
    assert found == sorted((event["type"], event["h"]) for file in files for event in file["events"] if event["type"] in ("PD", "SB"))
    for row in rows:
        assert row["velocities.1"] ** 2 + row["velocities.2"] ** 2 == pytest.approx(2.0 * row["h"], rel=1e-12)
        assert row["frequency"] * row["alpha"] == pytest.approx(0.5 * math.pi, rel=1e-14)
        assert row["frequency_index"] == row["half_waves"] * row["frequency"]
    other = second(load_scene("duffing_pair").system)
    looked_at = [*rows[20::100], *(row for row in rows if row["h"] > 99.0)]
    assert {row["stable"] for row in looked_at} == {1.0, 0.0} and len(looked_at) > 5
    for row in looked_at:
        velocities, alpha, _ = other.quarter(np.array([row["velocities.1"], row["velocities.2"]]), row["alpha"], row["h"])
        assert abs(alpha / row["alpha"] - 1.0) < 1e-12
        _, columns = other.flown(np.append([0.0, 0.0], velocities), 4.0 * alpha)
        assert (abs(np.trace(columns) - 2.0) < 2.0) == row["stable"]


def test_a_family_begins_at_a_mode_of_ten(capsys):
    """Oracle: the quarter period of the linear mode at low energy, from scipy's eigenvalues of the scene's matrices."""
    arguments = ("continue", "--scene", "beam_on_cubic_spring", "--from", "mode:4", "--points", "3", "--json", "a.json")
    assert run(capsys, *arguments)[0] == 0
    first = read_json("a.json")["points"][0]
    files = (Path(__file__).parents[2] / "catalogues" / f"beam_{name}.mtx" for name in ("stiffness", "mass"))
    squares = eigh(*map(mmread, files), eigvals_only=True)
    assert abs(first["alpha"] / (0.5 * math.pi / math.sqrt(squares[3])) - 1.0) < 1e-6
    assert len(first["multipliers"]) == 18


def test_a_family_is_followed_in_the_mass_ratio(capsys):
    """Oracle: the family in the energy at another mass ratio has the same orbit."""
    assert run(capsys, "continue", "S11-@h=0.1", "--scene", "cubic_nes", "--in", "mu", "--range", "0.05:0.06", "--csv", "a.csv")[0] == 0
    with open("a.csv", encoding="utf-8") as file:
        *_, last = csv.DictReader(file)
    other = ("continue", "S11-", "--scene", "cubic_nes", "--set", f"mu={last['mu']}", "--energy", "0.09:0.11", "--json", "b.json")
    assert run(capsys, *other)[0] == 0
    points = read_json("b.json")["points"]
    h, alpha = (np.array([point[name] for point in points]) for name in ("h", "alpha"))
    order = np.argsort(h)
    assert abs(np.interp(0.1, h[order], alpha[order]) / float(last["alpha"]) - 1.0) < 1e-4


def test_an_orbit_is_shown_without_impacts(capsys, folder):
    """Oracle: the words, and the figure."""
    code, out, _ = run(capsys, "orbit", "S11-@h=0.1", "--scene", "cubic_nes", "--json", "o.json", "--plot", "o.png")
    assert code == 0 and out.splitlines()[-3] == "impacts  0 in a period" and (folder / "o.png").stat().st_size > 10_000
    assert read_json("o.json")["orbit"]["label"] == "S11-"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("continue", "S13O11+", "--scene", "cubic_nes"), "S13O11+ has impacts, and this system has no stops; expected a label"),
        (("continue", "S11O00+", "--scene", "cubic_nes"), "S11O00+ has impacts, and this system has no stops; expected a label"),
        (("orbit", "S11+", "--scene", "duffing_pair", "--alpha", "9"), "no orbit of S11+ has alpha = 9: the family was followed from alp"),
        (("continue", "L11+", "--scene", "cubic_nes"), "saltus continue --from mode:K, the family that begins at a linear mode, or a l"),
        (("continue", "L22-", "--scene", "cubic_and_stops"), "L22- is a mode of a linear system, and this one has springs that are not"),
        (("continue", "--scene", "cubic_nes", "--from", "mode:1"), "mode 1 does not oscillate without the smooth forces; expected m"),
        (("continue", "--scene", "duffing_pair", "--from", "mode:7"), "the system has 2 modes without the smooth forces"),
        (("continue", "--scene", "smooth_wall", "--n", "0", "--from", "mode:1"), "are mode:1 1.654138767, mode:2 0.4497503101; e"),
        (("discover", "--scene", "beam_on_cubic_spring", "--energy", "1"), "for two degrees of freedom; this system has 10"),
        (("discover", "--scene", "cubic_nes", "--energy", "1", "--ends", "rest-rest"), "received the ends rest-rest, expected origin-or"),
        (("discover", "--scene", "cubic_nes", "--energy", "1", "--ends", "origin-stop"), "the ends origin-stop need a stop"),
        (("build", "--scene", "ueda_oscillator"), "the scene has"),
        (("build", "--scene", "cubic_nes", "--lam", "0.1"), "families of periodic orbits need a conservative system"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(capsys, arguments, message):
    """Oracle: the line, and the exit code 2."""
    refused(run(capsys, *arguments), message)


def test_all_orbits_of_an_energy_are_listed(capsys):
    """Oracle: the two families of the modes; the words, and the file."""
    arguments = ("--scene", "duffing_pair", "--energy", "1", "--max-quarter-period", "2", "--max-starts", "32")
    code, out, _ = run(capsys, "discover", *arguments, "--json", "a.json")
    assert code == 0 and "S11-" in out and "S11+" in out
    assert "2 orbits at h = 1" in out and "not complete: neighbouring starts are compared, which proves nothing" in out
    found = read_json("a.json")
    assert [orbit["label"] for orbit in found["orbits"]] == ["S11-", "S11+"]
    assert not found["complete"] and found["angles"] == [16, 32] and found["added"] == 0


@pytest.mark.parametrize(("scene", "bounds", "orbits"), [("duffing_pair", ("--energy", "0.8:1", "--max-quarter-period", "1.6"), 2)])
def test_a_catalogue_is_built_of_smooth_families(capsys, scene, bounds, orbits):
    """Oracle: see `require_a_catalogue_is_built_of_smooth_families`."""
    require_a_catalogue_is_built_of_smooth_families(capsys, scene, bounds, orbits)


def require_a_catalogue_is_built_of_smooth_families(capsys, scene, bounds, orbits):
    """Oracle: the check of the catalogue, which computes each point anew; each orbit of an energy between lies on one of its families."""
    code, out, err = run(capsys, "build", "--scene", scene, *bounds, "--catalogue", "c.sqlite", "--json", "c.json")
    assert code == 0 and "not complete: neighbouring starts at the origin were compared" in out, err
    assert not read_json("c.json")["complete"]
    code, out, _ = run(capsys, "check", "--catalogue", "c.sqlite")
    assert code == 0 and "all hold" in out
    others = [*bounds[2:], "--max-starts", "128", "--energy", "0.9" if scene == "duffing_pair" else "1.95"]
    code, out, _ = run(capsys, "discover", "--scene", scene, *others, "--catalogue", "c.sqlite")
    assert code == 0 and "0 orbits lie on none of it" in out and f"{orbits} orbit" in out
    label = out.splitlines()[1].split()[0]
    for words in (("list",), ("tree", label), ("show", label), ("export", "graph", "--json", "g.json")):
        code, out, err = run(capsys, *words, "--catalogue", "c.sqlite")
        assert code == 0, err


def test_a_family_with_impacts_and_smooth_forces_is_found_by_its_label(capsys):
    """Oracle: the orbit lies on the family, at the energy of its file."""
    code, out, _ = run(capsys, "continue", "S11O00-", "--scene", "cubic_and_stops", "--energy", "1:2", "--points", "5")
    assert code == 0 and "start  S11O00-: ends origin, stop-" in out


def test_a_range_above_zero_is_followed_to_its_end(capsys):
    """Oracle: the words. At 0.004, below the value from which the limit is solved, the family ends without a limit."""
    words = ("S11-", "--scene", "smooth_wall", "--in", "1/n", "--range", "0.004:0.11", "--keep", "energy=1")
    code, out, _ = run(capsys, "continue", *words, "--direction", "down")
    assert code == 0 and "EP at 1/n = 0.004: lowest value of 1/n asked for" in out and "limit" not in out


HARDENING = """
[parameters]
p = 1.5
[system]
mass = [[0.7]]
stiffness = [[1.3]]
[[springs]]
on = "u1"
stiffness = 2.0
power = "p"
[bounds]
energy = [0.1, 2.0]
quarter_period = 5.0
impacts = 0
"""


def test_the_force_of_a_spring_and_the_stop_that_it_becomes(capsys, folder):
    """Oracle: the force w^(2 n + 1) of the scene, also where it is linear, and 2 |w|^p sign w, whose stop is at 1."""
    words = ("spring", "--scene", "smooth_wall", "--in", "n", "--values", "0,1.5,20", "--range", "-1.1:0.9")
    code, out, err = run(capsys, *words, "--csv", "a.csv", "--plot", "a.png")
    assert code == 0 and not err and "limit  n to infinity: a stop at -1 and 1" in out
    with Path("a.csv").open(encoding="utf-8") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    w = np.array([row["displacement"] for row in rows])
    assert w[0] == -1.1 and w[-1] == 0.9 and Path("a.png").read_bytes().startswith(b"\x89PNG")
    for n in (0.0, 1.5, 20.0):
        np.testing.assert_allclose([row[f"n={n:g}"] for row in rows], np.sign(w) * np.abs(w) ** (2.0 * n + 1.0), rtol=1e-13, atol=1e-300)
    Path("hardening.toml").write_text(HARDENING, encoding="utf-8")
    code, out, _ = run(capsys, "spring", "--scene", "hardening.toml", "--in", "p", "--values", "1,3", "--range", "-2:2")
    assert code == 0 and out.splitlines()[2].split() == ["1", "-4", "4"] and out.splitlines()[3].split() == ["3", "-16", "16"]
    assert "a stop at -1 and 1" in out
    refused(run(capsys, "spring", "--scene", "smooth_wall", "--in", "k", "--values", "1"), "--in k: no such parameter")
    refused(run(capsys, "spring", "--in", "mu", "--values", "1"), "the scene has 0 springs")


@pytest.mark.parametrize(("name", "interval"), [("p", "1:1.6"), ("1/p", "0.6:1"), ("p", "0:1.6")])
def test_a_power_is_followed_to_one(capsys, folder, name, interval):
    """Oracle: with the power 1 the springs are linear: the frequency is the root of (1.3 + 2)/0.7."""
    (folder / "scene.toml").write_text(HARDENING)
    words = ("--scene", "scene.toml", "--from", "mode:1", "--in", name, "--range", interval, "--keep", "energy=1", "--json", "a.json")
    code, out, err = run(capsys, "continue", *words)
    assert code == 0 and f"end    EP at {name} = 1: " in out, out + err
    (branch,) = read_json("a.json")["branches"]
    point = min(branch["points"], key=lambda point: abs(point[name] - 1.0))
    assert point[name] == 1.0 and point["alpha"] == pytest.approx(0.5 * math.pi * math.sqrt(0.7 / 3.3), rel=1e-9)


def test_a_place_says_which_family_is_meant_at_another_energy(capsys):
    """Oracle: the words. The orbit that is named has another energy than the one that is kept."""
    assert run(capsys, "continue", "S13+", "--scene", "smooth_wall", "--energy", "4:6", "--points", "3", "--json", "a.json")[0] == 0
    point = read_json("a.json")["points"][0]
    name = f"S13+@h={point['h']:.6g},alpha={point['alpha']:.6g}"
    words = ("--scene", "smooth_wall", "--in", "1/n", "--range", "0.09:0.11", "--keep", "energy=5.5", "--points", "3")
    code, out, err = run(capsys, "continue", name, *words)
    assert code == 0 and "from h = 5.5" in out, err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("S13+@h=5", "--in", "1/m", "--range", "0:1"), "--in 1/m: no such parameter; expected one of mu, sigma, n"),
        (("S13+", "--in", "1/n", "--range", "0:1"), "needs 1 equation --keep"),
        (("S13+@h=5", "--in", "1/n", "--range", "0.2:1"), "has not the start's value 1/n = 0.1; expected it inside, or --set n=VALUE"),
        (("S13+@h=5", "--in", "1/n", "--range=-1:1"), "springs become stops at 1/n = 0; expected a range from 0"),
    ],
)
def test_a_reciprocal_that_cannot_be_followed_is_refused(capsys, arguments, message):
    """Oracle: the line, and the exit code 2."""
    refused(run(capsys, "continue", *arguments, "--scene", "smooth_wall"), message)
