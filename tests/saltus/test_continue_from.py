"""`saltus continue --from`: families that begin at a linear mode, and families of saved orbits.

Oracle: the closed forms of one impact a half period and of one a period, in forty digits, for 1 to 12 degrees of freedom.
"""

import json
import math
import re
from functools import partial

import mpmath as mp
import numpy as np
import pytest

import saltus
from benchmarks.backbone import OneImpact
from bvp.checks import EPSILON
from tests.saltus.running import refused, run

HEAD = 'title = "a chain"\nsource = "a test"\n'
BOUNDS = "[bounds]\nenergy = [{low!r}, {high!r}]\nquarter_period = 20.0\nimpacts = 6\n"


def system_of(n, lower=-0.8):
    """A chain of n unequal masses from a wall on, with a stop at its last mass, two-sided or one-sided."""
    k = np.arange(n)
    springs = 1.0 + 0.3 * np.cos(2.0 * k)
    stiffness = np.diag(springs + np.append(springs[1:], 0.0)) - np.diag(springs[1:], 1) - np.diag(springs[1:], -1)
    stop = saltus.Stop((0.0,) * (n - 1) + (1.0,), -math.inf if lower is None else lower, 0.8)
    return saltus.ImpactSystem(np.diag(1.0 + 0.4 * np.sin(k)), np.zeros((n, n)), stiffness, (stop,))


def scene_of(folder, system, low, high):
    """A scene of a system with these energies; its path."""
    text = f"{HEAD}[system]\nmass = {system.mass.tolist()}\nstiffness = {system.stiffness.tolist()}\n"
    for stop in system.stops:
        text += f"[[stops]]\nc = {list(stop.gap)}\nlower = {stop.lower!r}\nupper = {stop.upper!r}\n"
    path = folder / "scene.toml"
    path.write_text(text + BOUNDS.format(low=low, high=high), encoding="utf-8")
    return path


def largest_error(data, closed):
    """Largest relative difference from a closed form at any point: of the energy, and of the start state from its size. What the form
    changes within the rounding of alpha, four units, is no difference."""

    def form(alpha):
        energy, u, v = closed(alpha)
        return energy, mp.matrix([*u, *v])

    worst = 0.0
    for point in data["points"]:
        (energy, state), (moved, beside) = form(point["alpha"]), form(point["alpha"] * (1 + mp.mpf(4 * EPSILON)))
        own = mp.matrix(point["start"]["u"] + point["start"]["v"])
        off = min(mp.norm(own - state), mp.norm(own + state)) - mp.norm(beside - state)
        worst = max(worst, (abs(point["h"] - energy) - abs(moved - energy)) / energy, off / mp.norm(state))
    return float(worst)


MODES = [(1, -0.8, 1), (1, None, 1)]
MODES += [(n, lower, number) for n in (3, 5) for lower in (-0.8, None) for number in (1, 2, 3)]
# Mode 9 of twelve hardly moves the stop: its energy changes by 2e4 parts for one part of alpha, and rounding alpha makes 5e-12.
MODES += [(12, lower, number) for lower, numbers in ((-0.8, (1, 6, 9)), (None, (2, 4, 9))) for number in numbers]


@pytest.mark.parametrize(("n", "lower", "number"), MODES[::4])
def test_families_of_modes_are_the_closed_form(tmp_path, capsys, n, lower, number):
    """Oracle: see `require_families_of_modes_are_the_closed_form`."""
    require_families_of_modes_are_the_closed_form(tmp_path, capsys, n, lower, number)


def require_families_of_modes_are_the_closed_form(tmp_path, capsys, n, lower, number):
    """Oracle: closed forms in forty digits, with the relative error 1e-12 at every point: one impact a half period between two stops, one a
    period on one stop. Also the grazing energy w^2 d^2/(2 b^2), at which the family begins."""
    system = system_of(n, lower)
    mode = saltus.linear_modes(system)[number - 1]
    grazing = mode.energies[1]
    scene = scene_of(tmp_path, system, 0.2 * grazing, 5.0 * grazing)
    code, out, err = run(capsys, "continue", "--from", f"mode:{number}", "--scene", scene, "--points", "40", "--json", "-")
    assert code == 0, err
    data = json.loads(out)
    ends = ["origin", "stop+"] if lower else ["rest", "stop+"]
    assert sorted(end.replace("-", "+") for end in data["branch"]["ends"]) == ends and data["branch"]["sequence"] == ""
    assert any(event["type"] == "GR" and abs(event["h"] / grazing - 1.0) < 1e-9 for event in data["events"])
    closed = OneImpact(system)
    # The start is at rest, or just after the impact.
    form = closed.two_sided if lower else partial(closed.one_sided, phase=int(data["branch"]["ends"][0] == "rest"))
    assert len(data["points"]) > 10 and largest_error(data, form) < 1e-12


def test_the_main_family_is_the_backbone(capsys):
    """Oracle: the families that the names of the reference select; the main family is one of those of the mode's period."""
    for start, name in (("mode:1", "S13O00+"), ("mode:2", "S11O00-"), ("mode:2,origin-stop+", "S11O00-")):
        code, out, _ = run(capsys, "continue", "--from", start, "--energy", "0.05:1", "--json", "-")
        assert code == 0 and json.loads(out)["branch"]["label"] == name
        assert json.loads(out)["branch"]["id"] == saltus.trace(name, energy=(0.05, 1.0)).id


def test_a_choice_of_several_families_is_listed(capsys):
    """Oracle: each text of the list selects a family of its own, of those that `families_at` gives. Two of the nine-fold cover have
    equal ends and sequences; the hash of the id tells them apart."""
    line = refused(run(capsys, "continue", "--from", "mode:1,cover=2"), "mode:1,cover=2 matches 3 families; choose one of ")
    ids = []
    for start in line.strip().partition("choose one of ")[2].split(", "):
        code, out, err = run(capsys, "continue", "--from", start, "--points", "5", "--json", "-")
        assert code == 0, err
        ids.append(json.loads(out)["branch"]["id"])
        assert ids[-1].startswith(start.split(",")[2])
    mode = saltus.linear_modes(saltus.vibro_impact_nes())[0]
    assert sorted(ids) == sorted(item.branch.id for item in saltus.families_at(mode, 2, 4, points=5, energy=(0.05, 1.0)))
    many = refused(run(capsys, "continue", "--from", "mode:1,cover=9,origin-rest:+"), "matches 2 families", "mode:1,cover=9,origin-rest:+:")
    first = many.partition("choose one of ")[2].split(", ")[0]
    code, out, _ = run(capsys, "continue", "--from", first, "--points", "5", "--json", "-")
    assert code == 0 and json.loads(out)["branch"]["id"] == first.split(",")[2]
    refused(run(capsys, "continue", "--from", "mode:1,cover=9"), "matches 106 families", "and 94 more")


def test_a_saved_orbit_and_a_saved_family_are_followed(tmp_path, capsys, monkeypatch):
    """Oracle: the family of the file, with the same id and events, for three degrees of freedom; the orbit that a suffix selects."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    scene = scene_of(tmp_path, system_of(3, None), 0.02, 5.0)
    words = ["continue", "--scene", scene, "--from"]
    assert run(capsys, *words, "mode:2", "--json", "family.json", "--save")[0] == 0
    first = json.loads((tmp_path / "family.json").read_text(encoding="utf-8"))
    id = first["branch"]["id"]
    assert run(capsys, "orbit", id, "--scene", scene, "--energy", "1.7", "--json", "orbit.json")[0] == 0
    for start in ("family.json", "family.json@h=1.7", "orbit.json"):
        code, out, err = run(capsys, *words, start, "--json", "-")
        data = json.loads(out)
        assert code == 0 and data["branch"]["id"] == id, err
        places = [[(event["type"], event["h"]) for event in events["events"]] for events in (first, data)]
        assert [kind for kind, _ in places[0]] == [kind for kind, _ in places[1]]
        assert np.allclose([h for _, h in places[0]], [h for _, h in places[1]], rtol=1e-9)
        assert start == "family.json" or min(abs(point["h"] - 1.7) for point in data["points"]) < 1e-12
    refused(run(capsys, *words, "orbit.json@h=2"), "orbit.json holds one orbit", "@h=2")
    refused(run(capsys, *words, "family.json@h=9"), "no orbit of family.json@h=9.0 has h = 9", "followed from h = ")
    refused(run(capsys, *words, "family.json@x"), 'unexpected "x" at character 13', "h=.. or alpha=..")
    (tmp_path / "other.json").write_text('{"schema": 2}', encoding="utf-8")
    refused(run(capsys, *words, "other.json"), "neither a branch nor an orbit", "saltus orbit --json")


def test_a_file_of_another_system(tmp_path, capsys, monkeypatch):
    """Oracle: without a scene the energies must be given; with one, the systems must be the same. A catalogue belongs to its scene."""
    monkeypatch.chdir(tmp_path)
    scene = scene_of(tmp_path, system_of(3), 0.02, 5.0)
    assert run(capsys, "continue", "--from", "mode:1", "--scene", scene, "--points", "9", "--json", "a.json")[0] == 0
    refused(
        run(capsys, "continue", "--from", "a.json"),
        "another system than the scene lee2009",
        "--scene FILE",
        "or --energy LO:HI in place of",
    )
    refused(run(capsys, "continue", "--from", "a.json", "--mu", "0.2", "--energy", "0.1:1"), "another system", "a scene with its system")
    refused(run(capsys, "continue", "--from", "a.json", "--energy", "0.1:1", "--save"), "--scene FILE with its system")
    code, out, _ = run(capsys, "continue", "--from", "a.json", "--energy", "0.1:1", "--points", "9", "--json", "-")
    assert code == 0 and len(json.loads(out)["points"]) == 9


def test_the_model_of_a_start(capsys):
    """Oracle: the lines for the family's name."""
    lines = [run(capsys, "continue", *words, "--points", "3", "--model")[1] for words in (["S13O00+"], ["--from", "mode:1"])]
    model = [[line for line in text.splitlines() if line.startswith("model")] for text in lines]
    assert len(model[1]) == 5 and model[0][:2] == model[1][:2] and model[0][3:] == model[1][3:]
    assert "quarter-period problem between the ends origin and stop+" in model[1][2]


SHIPPED = {"three_mass_chain": (1, 0.1823327926), "gear_pair": (3, 0.78125), "impact_damper": (2, 0.5)}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_are_the_closed_form(capsys, name):
    """Oracle: closed forms in forty digits, also with rigid-body modes. The family begins where the mode reaches the stop: the torsion
    of the shaft at (1 + 1/4)^2/2, the oscillator that moves alone at 1/2, the chain at w^2 d^2/(2 b^2)."""
    number, grazing = SHIPPED[name]
    code, out, err = run(capsys, "continue", "--scene", name, "--from", f"mode:{number}", "--energy", "0.02:5", "--json", "-")
    assert code == 0, err
    data = json.loads(out)
    system = saltus.load_scene(name).system
    closed = OneImpact(system)
    one_sided = partial(closed.one_sided, phase=int(data["branch"]["ends"][0] == "rest"))
    assert largest_error(data, one_sided if name == "three_mass_chain" else closed.two_sided) < 1e-12
    assert [event["h"] for event in data["events"] if event["note"] and "speed reaches zero" in event["note"]] == [pytest.approx(grazing)]
    assert any(point["stable"] for point in data["points"])


@pytest.mark.parametrize("lower", [-0.8, None])
def test_a_mode_that_alone_moves_the_gap(tmp_path, capsys, lower):
    """Oracle: the closed form of the one oscillator that meets the stop; the other one is coupled to nothing. At first order the impulses
    change no displacement at the stop, and the family begins all the same."""
    stop = saltus.Stop((1.0, 0.0), -math.inf if lower is None else lower, 0.8)
    system = saltus.ImpactSystem(np.diag([1.3, 0.7]), np.zeros((2, 2)), np.diag([1.1, 4.0]), (stop,))
    scene = scene_of(tmp_path, system, 0.05, 3.0)
    code, out, err = run(capsys, "continue", "--scene", scene, "--from", "mode:1", "--json", "-")
    assert code == 0, err
    data = json.loads(out)
    closed = OneImpact(system)
    one_sided = partial(closed.one_sided, phase=int(data["branch"]["ends"][0] == "rest"))
    assert largest_error(data, closed.two_sided if lower else one_sided) < 1e-12
    assert len(data["points"]) > 10 and max(point["h"] for point in data["points"]) == pytest.approx(3.0)


def test_modes_without_families(tmp_path, capsys):
    """Oracle: one line with the reason, exit code 2; a build reports a mode at which two stops are touched at one instant, exit code 1."""
    below = saltus.ImpactSystem([[1.0]], [[0.0]], [[1.0]], (saltus.Stop((1.0,), -math.inf, -0.5),))
    refused(run(capsys, "continue", "--from", "mode:1", "--scene", scene_of(tmp_path, below, 0.1, 3.0)), "lies beyond stop a")
    stops = (saltus.Stop((1.0, 0.0), -math.inf, 1.0), saltus.Stop((0.0, 1.0), -math.inf, 1.0))
    two = saltus.ImpactSystem(np.eye(2), np.zeros((2, 2)), [[2.0, -1.0], [-1.0, 2.0]], stops)
    scene = scene_of(tmp_path, two, 0.1, 1.2)
    refused(run(capsys, "continue", "--from", "mode:1", "--scene", scene), "touches the stops a+, b+ at one instant")
    code, out, err = run(capsys, "build", "--workers", "1", "--scene", scene, "--catalogue", tmp_path / "two.sqlite")
    assert code == 1 and err == "" and out.count("FAILS") == 1 and "FAILS  L1: the mode of frequency 1 touches the stops a+, b+" in out


@pytest.mark.parametrize("factor", [1.0, 2.0, -2.0])
def test_two_stops_at_one_place_count_as_one(tmp_path, capsys, factor):
    """Oracle: the family of the same system without the second stop; a build has it too."""
    once = system_of(3, lower=None)
    second = {"upper": 0.8 * factor} if factor > 0.0 else {"lower": 0.8 * factor, "upper": math.inf}
    stops = (*once.stops, saltus.Stop((0.0, 0.0, factor), **second))
    twice = saltus.ImpactSystem(once.mass, once.damping, once.stiffness, stops)
    points = []
    for name, system in (("once", once), ("twice", twice)):
        (tmp_path / name).mkdir()
        scene = scene_of(tmp_path / name, system, 0.05, 0.3)
        code, out, err = run(capsys, "continue", "--from", "mode:1", "--scene", scene, "--json", "-")
        assert code == 0, err
        points.append([value for point in json.loads(out)["points"] for value in (point["h"], point["alpha"])])
    assert points[0] == pytest.approx(points[1], rel=1e-10) and len(points[0]) > 20
    code, out, err = run(capsys, "build", "--workers", "1", "--max-impacts", "1", "--scene", scene, "--catalogue", tmp_path / "a.sqlite")
    assert (code, err) == (0, "") and "FAILS" not in out and "done   0 families" not in out


@pytest.mark.parametrize("square", [1.0, 4.0, 9.0])
def test_a_mode_in_resonance_with_one_that_moves_no_gap(tmp_path, capsys, square):
    """Oracle: one mass at a one-sided stop returns after the period 2 (pi - arccos(1/A)), A^2 = 2h, whatever the other mass does."""
    system = saltus.ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag([1.0, square]), (saltus.Stop((1.0, 0.0), -math.inf, 1.0),))
    code, out, err = run(capsys, "continue", "--from", "mode:1", "--scene", scene_of(tmp_path, system, 0.1, 3.0), "--json", "-")
    assert code == 0, err
    points = json.loads(out)["points"]
    assert [min(point["h"] for point in points), max(point["h"] for point in points)] == [pytest.approx(0.5), pytest.approx(3.0)]
    for point in points:
        assert point["alpha"] == pytest.approx(0.5 * (math.pi - math.acos(min(1.0, (2.0 * point["h"]) ** -0.5))), rel=1e-7)


def test_two_modes_in_resonance_at_one_stop(tmp_path, capsys):
    """Oracle: one line that names the other mode: the first order decides nothing."""
    system = saltus.ImpactSystem(np.eye(2), np.zeros((2, 2)), np.diag([1.0, 4.0]), (saltus.Stop((1.0, 0.5), -math.inf, 1.0),))
    refused(run(capsys, "continue", "--from", "mode:1", "--scene", scene_of(tmp_path, system, 0.1, 3.0)), "it is in resonance with mode:2")


PENDULUM = """
[system]
mass = [[1.0]]
stiffness = [[0.0]]
coordinates = ["x"]
[[springs]]
c = [1.0]
potential = "1 - cos(w)"
[[stops]]
c = [1.0]
lower = -1.0
upper = 1.0
[bounds]
energy = [0.01, 1.9]
quarter_period = 20.0
impacts = 3
"""


def test_the_family_behind_a_grazing_is_followed(tmp_path, capsys):
    """Oracle: a pendulum between two stops touches them at h = 1 - cos 1; above, a quarter period is the integral of 1/x' from 0 to 1."""
    (tmp_path / "pendulum.toml").write_text(PENDULUM)
    scene = ("--scene", tmp_path / "pendulum.toml")
    code, _, err = run(capsys, "continue", "--from", "mode:1", *scene, "--json", tmp_path / "a.json")
    assert code == 0, err
    code, out, err = run(capsys, "continue", "--from", f"{tmp_path / 'a.json'}:GR", *scene, "--json", "-")
    branch = json.loads(out)
    assert code == 0 and branch["branch"]["ends"] == ["origin", "stop+"], err
    assert min(point["h"] for point in branch["points"]) == pytest.approx(1.0 - math.cos(1.0), rel=1e-10)
    assert len(branch["points"]) > 20
    for point in branch["points"][5:-5:20]:
        with mp.workdps(20):
            quarter = mp.quad(lambda x, h=point["h"]: 1 / mp.sqrt(2 * (h - 1 + mp.cos(x))), [0, 0.5, 1])
        assert point["alpha"] == pytest.approx(float(quarter), rel=1e-9)


def test_families_at_the_events_of_a_file_are_followed_or_listed(tmp_path, capsys):
    """Oracle: the families that `Branch.switch` and `Branch.neighbours` find at the same events."""
    branch = saltus.trace("S13+", energy=(0.05, 20.0))
    branch.save(tmp_path / "a.json")
    words = ("continue", "--energy", "0.1:20", "--points", "9", "--json", "-", "--from")
    code, out, err = run(capsys, *words, f"{tmp_path / 'a.json'}:SB1")
    assert code == 0 and json.loads(out)["branch"]["id"] == branch.switch("SB1", points=3)[0].id, err
    known = {item.branch.id for item in branch.neighbours("GR2", points=9) if item.branch is not None}
    err = run(capsys, *words, f"{tmp_path / 'a.json'}:GR2")[2]
    listed = re.findall(r"GR2,(\S+?)(?:,|$)", err.strip())
    assert len(listed) == len(known) > 2 and "choose one of" in err
    assert all(any(id.startswith(item) for id in known) for item in listed)
    code, out, err = run(capsys, *words, f"{tmp_path / 'a.json'}:GR2,origin-stop")
    assert code == 0 and json.loads(out)["branch"]["id"] in known, err
    refused(run(capsys, *words, f"{tmp_path / 'a.json'}:GR1"), "no family begins at GR1", "L11+")
    refused(run(capsys, *words, f"{tmp_path / 'a.json'}:GR2,rest"), "no family rest begins at GR2", "origin-stop+:-")
