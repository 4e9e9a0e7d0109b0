"""`saltus run`. Oracles: closed forms of free motion, the motion run directly, the numbers of the files against each other."""

import csv
import itertools
import json
import math
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from bvp.motion import EventKind, MotionStatus
from bvp.simulate import simulate as run_damped
from bvp.system import vibro_impact_nes
from tests.saltus.running import run
from tests.saltus.test_scene_loads import SCENE

DAMPED = ("--rho", "0.7", "--lam", "0.01")

CORNER = """
title = "a body that meets two walls at an acute angle at one instant"
[system]
mass = [[1.0, 0.0], [0.0, 1.0]]
stiffness = [[1.0, 0.0], [0.0, 1.0]]
[[stops]]
c = [1.0, 0.0]
upper = 0.5
restitution = 0.5
[[stops]]
c = [1.0, 0.2]
upper = 0.5
restitution = 0.5
[bounds]
energy = [0.1, 10]
quarter_period = 8
impacts = 6
"""


def reported(capsys, *words):
    """The JSON of a run with its stages, which standard output carries alone."""
    code, out, err = run(capsys, "run", *words, "--stages", "--json", "-")
    assert code == 0, err
    return json.loads(out)


@pytest.fixture(scope="module")
def shock(tmp_path_factory):
    """All files of one damped motion from an impulsive start."""
    from saltus.__main__ import main

    folder = tmp_path_factory.mktemp("shock")
    files = [word for kind in ("json", "csv", "npz", "mat") for word in (f"--{kind}", str(folder / f"run.{kind}"))]
    assert main(["run", "--impulsive", "--energy", "8", *DAMPED, "--duration", "150", "--samples", "301", "--stages", *files]) == 0
    return folder, json.loads((folder / "run.json").read_text())


def test_the_record_is_the_motion_itself(shock):
    """Oracle: the motion run directly: the oscillator's velocity alone, sqrt(2 h)."""
    _, record = shock
    assert record["initial"]["u"] == [0.0, 0.0] and record["initial"]["v"] == [0.0, 4.0] and record["initial"]["energy"] == 8.0
    motion = run_damped(vibro_impact_nes(lam=0.01, rho=0.7), [0, 0], [0, 4.0], 150.0)
    hits = motion.kinds == EventKind.IMPACT.value
    assert [row["time"] for row in record["impacts"]] == motion.times[hits].tolist()
    assert record["shares"]["nes"] == pytest.approx(motion.dissipated["stop a"] / 8.0, rel=1e-14)
    assert record["shares"]["lo"] == pytest.approx(motion.dissipated["rest"] / 8.0, rel=1e-14)
    assert record["last_impact"] == motion.last_impact == record["impacts"][-1]["time"]


def test_the_numbers_of_the_record_agree_with_each_other(shock):
    """Oracles: losses sum to what the stops took; restitution; fractions at the marks; the balance; NES and LO and what is left are 1."""
    _, record = shock
    assert record["schema"] == 1 and record["energy_balance_error"] < 1e-12
    impacts = record["impacts"]
    lost = math.fsum(row["energy_lost"] for row in impacts) + math.fsum(row["energy_lost"] for row in record["chatter"])
    assert lost == pytest.approx(record["dissipated"]["stop a"], rel=1e-13)
    reduced = 0.1 / 1.1
    for row in impacts:
        assert row["speed_after"] == pytest.approx(0.7 * row["speed"], rel=1e-15)
        assert row["energy_lost"] == pytest.approx(0.5 * reduced * (row["speed"] ** 2 - row["speed_after"] ** 2), rel=1e-13)
    assert sum(record["shares"].values()) + record["energy"] / 8.0 == pytest.approx(1.0, abs=1e-13)
    at = record["at"]
    assert list(at) == ["50", "85", "90", "99"]
    reached = [name for name in at if at[name]["time"] is not None]
    for name in reached:
        # An impact loses its energy at once: a mark that it passes is passed by a part of that.
        passed = math.fsum(row["energy_lost"] for row in impacts if row["time"] == at[name]["time"]) / 8.0
        over = at[name]["nes"] + at[name]["lo"] - float(name) / 100.0
        assert abs(over) < 1e-13 if not passed else 0.0 <= over < passed
        before = math.fsum(row["energy_lost"] for row in impacts if row["time"] <= at[name]["time"])
        assert at[name]["nes"] == pytest.approx(before / 8.0, abs=1e-13)
    assert sum(record["shares"].values()) >= max(float(name) for name in reached) / 100.0
    for stage in record["stages"]:
        assert stage["end"] > stage["start"] and stage["periods"] >= 3.0
    spent = [math.fsum(stage[f"dissipated_{who}"] for stage in record["stages"]) for who in ("nes", "lo")]
    assert spent[0] <= record["shares"]["nes"] * 8.0 * (1 + 1e-9) and spent[1] <= record["shares"]["lo"] * 8.0 * (1 + 1e-9)


def test_the_files_hold_the_same_motion(shock):
    """Oracle: the record; energies, dissipation and work close at each sample."""
    folder, record = shock
    arrays = dict(np.load(folder / "run.npz"))
    matlab = loadmat(folder / "run.mat")
    rows = list(csv.DictReader((folder / "run.csv").read_text().splitlines()))
    assert len(rows) == 301 and arrays["time"][-1] == 150.0
    for name in ("time", "energy", "nes_energy", "dissipated_nes", "dissipated_lo"):
        np.testing.assert_array_equal([float(row[name]) for row in rows], arrays[name])
        np.testing.assert_array_equal(matlab[name][:, 0], arrays[name])
        assert record["samples"][name] == arrays[name].tolist()
    np.testing.assert_array_equal([[float(row[f"u.{k}"]) for k in (1, 2)] for row in rows], arrays["u"])
    np.testing.assert_allclose(arrays["energy"] + arrays["dissipated_nes"] + arrays["dissipated_lo"], 8.0, rtol=1e-13)
    np.testing.assert_allclose(arrays["nes_energy"] + arrays["lo_energy"], arrays["energy"], rtol=1e-13)
    nes = 0.5 * 0.1 * (arrays["v"][:, 0] ** 2 + (arrays["u"][:, 0] - arrays["u"][:, 1]) ** 2)
    np.testing.assert_allclose(arrays["nes_energy"], nes, atol=1e-14)
    assert arrays["impact_time"].tolist() == [row["time"] for row in record["impacts"]]
    assert arrays["impact_stop"].tolist() == [row["stop"] for row in record["impacts"]]
    assert json.loads(str(arrays["about"]))["shares"] == record["shares"]
    assert np.abs(arrays["u"][:, 0] - arrays["u"][:, 1]).max() <= 1.0 + 1e-12
    peak = record["peaks"]["displacements"]["u2"]
    assert np.abs(arrays["u"][:, 1]).max() <= peak["peak"]


def test_free_motion_in_closed_form(capsys):
    """Oracle: sigma = 0, u2 = V sin t while |u2| < 1 and the sink stays at 0; energy V^2/2 in the oscillator, peaks V at pi/2."""
    record = reported(capsys, "--impulse", "0.5", "--sigma", "0", "--duration", repr(2.0 * math.pi), "--samples", "5")
    assert record["initial"]["energy"] == 0.125 and record["impacts"] == [] and record["last_impact"] is None
    np.testing.assert_allclose(np.array(record["samples"]["u"])[:, 1], [0.0, 0.5, 0.0, -0.5, 0.0], atol=1e-14)
    peaks = record["peaks"]
    assert peaks["displacements"]["u1"]["peak"] == 0.0
    for entry in (peaks["displacements"]["u2"], peaks["gaps"]["gap a"]):
        assert entry["peak"] == pytest.approx(0.5, rel=1e-14) and entry["time"] == pytest.approx(math.pi / 2, rel=1e-7)
        assert entry["rms"] == pytest.approx(0.5 / math.sqrt(2.0), rel=1e-14)
    assert record["shares"] == {"nes": 0.0, "lo": 0.0} and record["at"]["50"] == {"time": None, "nes": None, "lo": None}


def test_a_viscous_oscillator_loses_its_energy_in_closed_form(capsys):
    """Oracle: sigma = 0, u2 = V exp(-a t) sin(w t)/w: the energy at 2 pi/w is exp(-4 pi a/w) of the first; all of it goes to the LO."""
    a = 0.05
    w = math.sqrt(1.0 - a * a)
    record = reported(capsys, "--impulse", "0.5", "--sigma", "0", "--lam", "0.1", "--duration", repr(2.0 * math.pi / w))
    assert record["shares"]["lo"] == pytest.approx(1.0 - math.exp(-4.0 * math.pi * a / w), rel=1e-13)
    assert record["shares"]["nes"] == 0.0


def test_on_an_orbit_the_undamped_motion_comes_back(capsys):
    """Oracle: the published orbit alpha = 1.7, h = 0.58875: after a period the start state; two impacts of one speed; one stage on it."""
    record = reported(capsys, "--on", "S13O00+@alpha=1.7", "--duration", "6.8", "--samples", "2")
    initial = record["initial"]
    assert initial["kind"] == "orbit" and initial["on"]["label"] == "S13O00+" and initial["energy"] == pytest.approx(0.588748128566)
    assert initial["v"][0] / initial["v"][1] > 0.0
    np.testing.assert_allclose(record["samples"]["v"][-1], initial["v"], atol=1e-11)
    np.testing.assert_allclose(record["samples"]["u"][-1], 0.0, atol=1e-11)
    assert [row["time"] for row in record["impacts"]] == pytest.approx([1.7, 5.1], abs=1e-11)
    assert record["shares"] == {"nes": 0.0, "lo": 0.0}


def test_damping_and_restitution_do_not_change_where_the_family_is(capsys):
    """Oracle: the start of the undamped run; the damped motion then loses energy and follows its own way."""
    plain = reported(capsys, "--on", "S13O00+", "--energy", "10", "--duration", "20")
    damped = reported(capsys, "--on", "S13O00+", "--energy", "10", *DAMPED, "--duration", "20")
    assert plain["initial"]["v"] == damped["initial"]["v"] and plain["initial"]["on"] == damped["initial"]["on"]
    assert damped["system"]["rho"] == 0.7 and damped["energy"] < 0.9 * plain["energy"]


@pytest.mark.parametrize("name", ["S31O11-", "U8344-"])
def test_the_impulsive_orbit_of_a_family(capsys, name):
    """Oracle: it is the impulsive start of its own energy, and after its period the motion is there again. U8344- turns back on itself and
    passes its impulsive orbit twice."""
    record = reported(capsys, "--on", name, "--impulsive", "--duration", "0.001")
    on = record["initial"]["on"]
    assert record["initial"]["v"] == pytest.approx([0.0, math.sqrt(2.0 * on["h"])], rel=1e-14, abs=0.0)
    period = 4.0 * on["alpha"]
    again = reported(capsys, "--impulsive", "--energy", repr(on["h"]), "--duration", repr(period), "--samples", "2")
    np.testing.assert_allclose(again["samples"]["v"][-1], again["initial"]["v"], atol=1e-6)


def test_units_scale_what_is_reported_and_nothing_else(capsys):
    """Oracle: natural units times the clearance, its square, and the natural frequency."""
    words = ("--state", "-0.1,0.2,0.3,4", *DAMPED, "--duration", "60", "--samples", "3")
    plain = reported(capsys, *words)
    scaled = reported(capsys, *words, "--clearance", "0.02", "--natural-frequency", "10")
    assert plain["initial"]["u"] == [-0.1, 0.2] and plain["initial"]["v"] == [0.3, 4.0]
    assert len(plain["impacts"]) == len(scaled["impacts"]) > 3
    for a, b in zip(plain["impacts"], scaled["impacts"], strict=True):
        assert b["time"] == pytest.approx(a["time"] / 10.0, rel=1e-14) and b["speed"] == pytest.approx(0.2 * a["speed"], rel=1e-14)
        assert b["energy_lost"] == pytest.approx(0.04 * a["energy_lost"], rel=1e-14)
    assert scaled["shares"] == plain["shares"] and scaled["at"]["50"]["nes"] == plain["at"]["50"]["nes"]
    assert scaled["at"]["50"]["time"] == pytest.approx(plain["at"]["50"]["time"] / 10.0, rel=1e-14)
    assert scaled["peaks"]["gaps"]["gap a"]["peak"] == pytest.approx(0.02, rel=1e-12)
    np.testing.assert_allclose(np.array(scaled["samples"]["u"]), 0.02 * np.array(plain["samples"]["u"]), rtol=1e-14)
    assert scaled["stages"][0]["frequency"] == pytest.approx(10.0 * plain["stages"][0]["frequency"], rel=1e-14)


@pytest.mark.parametrize("rho", ["0", "0.3", "0.9", "1"])
def test_any_restitution_ends_and_closes(capsys, rho):
    """Oracle: the balance, and losses that sum to what the stop took, chattering included. Light and stiffly forced: it chatters."""
    record = reported(capsys, "--impulse", "3", "--rho", rho, "--lam", "0.05", "--sigma", "0.6", "--mu", "0.8", "--duration", "100")
    assert record["energy_balance_error"] < 1e-12 and record["ended"]["reason"] == "DURATION_REACHED"
    lost = math.fsum(row["energy_lost"] for row in [*record["impacts"], *record["chatter"]])
    assert lost == pytest.approx(record["dissipated"]["stop a"], rel=1e-12, abs=1e-15)
    assert record["sticking_time"] == pytest.approx(sum(s["end"] - s["begin"] for s in record["sticking"]), abs=1e-12)


def forced(tmp_path, loads):
    path = tmp_path / "forced.toml"
    path.write_text(SCENE + loads)
    return path


def test_a_forced_system_starts_at_rest(capsys, tmp_path):
    """Oracles: the balance with the work of the loads; shares are of what came in, and sum to 1 with what is left."""
    scene = forced(tmp_path, '[[forces]]\non = "floor"\namplitude = 2.0\nfrequency = 0.9\n')
    record = reported(capsys, "--scene", scene, "--duration", "60")
    assert record["initial"]["kind"] == "rest" and record["initial"]["energy"] == 0.0 and len(record["impacts"]) > 5
    assert record["energy_balance_error"] < 1e-12 and record["shares_of"]["what"] == "energy that came in"
    assert record["work"] == pytest.approx(record["shares_of"]["energy"], rel=1e-12)
    assert sum(record["shares"].values()) + record["energy"] / record["work"] == pytest.approx(1.0, abs=1e-12)
    assert record["at"] == {name: {"time": None, "nes": None, "lo": None} for name in ("50", "85", "90", "99")}
    assert record["forces"] == [{"kind": "harmonic", "frequency": 0.9, "cosine": [2.0, 0.0, 0.0], "sine": [0.0, 0.0, 0.0]}]
    assert list(record["peaks"]["drifts"]) == ["roof - floor"]


def test_bounces_that_were_summed_are_in_the_record(capsys, tmp_path):
    """Oracles: losses of impacts and of summed bounces are what the stop took; contacts are held as long as is said; the balance."""
    scene = forced(tmp_path, '[[forces]]\non = "sink"\namplitude = 3.0\nfrequency = 0.2\n')
    record = reported(capsys, "--scene", scene, "--duration", "100", "--samples", "2001")
    assert len(record["chatter"]) >= 3 and len(record["sticking"]) >= 3 and record["energy_balance_error"] < 1e-12
    lost = math.fsum(row["energy_lost"] for row in [*record["impacts"], *record["chatter"]])
    assert lost == pytest.approx(record["dissipated"]["stop a"], rel=1e-12)
    assert record["sticking_time"] == pytest.approx(sum(s["end"] - s["begin"] for s in record["sticking"]), rel=1e-12)
    assert {row["time"] for row in record["chatter"]} <= {s["begin"] for s in record["sticking"]}
    gap = np.array(record["samples"]["u"]) @ [0.0, -1.0, 1.0]
    assert np.abs(gap).max() <= 1.0 + 1e-12
    times = np.array(record["samples"]["time"])
    for held in record["sticking"]:
        inside = gap[(times > held["begin"]) & (times < held["end"])]
        np.testing.assert_allclose(inside, 1.0 if held["stops"] == ["+"] else -1.0, atol=1e-13)


def test_the_sink_locked_beside_it(capsys):
    """Oracle: free flight in closed form: (1 + mu) u'' + u = 0 from the velocity V: peak V sqrt(1 + mu)."""
    code, out, _ = run(capsys, "run", "--impulse", "2", "--mu", "0.21", "--duration", "40", "--locked", "--json", "-")
    record = json.loads(out)
    assert code == 0 and record["locked"]["energy_balance_error"] < 1e-12
    assert record["locked"]["peaks"]["displacements"]["u2"]["peak"] == pytest.approx(2.2, rel=1e-13)
    code, out, _ = run(capsys, "run", "--impulse", "2", "--mu", "0.21", "--duration", "40", "--locked")
    line = next(line for line in reversed(out.splitlines()) if line.startswith("u2 "))
    assert line.split()[2] == "2.2"
    assert float(line.split()[3]) == pytest.approx(record["peaks"]["displacements"]["u2"]["peak"] / 2.2, abs=1e-4)


def test_the_building(capsys):
    """Oracles: the balance; the gap within its clearance; a duration that is the record's; floors locked to each other's sides."""
    record = reported(capsys, "--scene", "three_storey_building", "--locked")
    assert record["duration"] == 20.0 and record["energy_balance_error"] < 1e-12 and len(record["impacts"]) > 10
    assert record["peaks"]["gaps"]["gap a"]["peak"] == pytest.approx(0.02, rel=1e-12)
    locked = record["locked"]
    assert locked["energy_balance_error"] < 1e-12 and list(locked["peaks"]["displacements"]) == ["floor1", "floor2", "floor3"]
    for name in ("floor1", "floor2", "floor3"):
        assert record["peaks"]["displacements"][name]["rms"] < locked["peaks"]["displacements"][name]["rms"]


def test_the_table_reports_what_the_record_has(capsys):
    """Oracle: the record of the same run."""
    words = ("--impulsive", "--energy", "8", *DAMPED, "--duration", "150")
    record = reported(capsys, *words)
    code, out, err = run(capsys, "run", *words, "--model", "--stages")
    assert code == 0 and not err
    lines = out.splitlines()
    assert lines[0].startswith("model  damped -> ") and any("restitution below 1" in line for line in lines[:3])
    assert f"impacts  {len(record['impacts'])}, the last at {record['last_impact']:.10g}" in out
    assert f"NES {record['shares']['nes']:.4%}  LO {record['shares']['lo']:.4%}" in out
    stages = [line for line in lines if line.endswith("follows no family") or ("harmonic" in line and line[0].isdigit())]
    assert len(stages) == len(record["stages"])
    assert f"{record['at']['50']['time']:.10g}" in out
    assert "and " + str(len(record["impacts"]) - 12) + " more" in out


def test_captures_and_escapes_are_reported(capsys):
    """Oracle: the stages: what follows a family begins with its capture and, where another stage comes, ends with its escape, in the units
    of the stages; at the end of the run nothing is left. The table has a line for each."""
    words = ("--on", "S13O00+", "--energy", "1", *DAMPED, "--duration", "250", "--natural-frequency", "2")
    record = reported(capsys, *words)
    stages = [stage for stage in record["stages"] if stage["follows"] is not None]
    assert {stage["follows"]["label"] for stage in stages} == {"S13O00+", "L11+"}
    entries = [(stage["follows"]["label"], "capture", stage["start"]) for stage in stages]
    entries += [(stage["follows"]["label"], "escape", stage["end"]) for stage in stages if stage != record["stages"][-1]]
    assert sorted((c["label"], c["kind"], c["time"]) for c in record["changes"]) == sorted(entries)
    assert [c["time"] for c in record["changes"]] == sorted(c["time"] for c in record["changes"])
    _, out, _ = run(capsys, "run", *words, "--stages")
    for change in record["changes"]:
        line = f"{change['kind']} {change['time']:.5g} harmonic {change['harmonic']} of {change['label']}"
        assert line in (" ".join(line.split()) for line in out.splitlines())


def test_without_a_catalogue_free_motion_is_on_a_linear_mode(capsys, tmp_path):
    """Oracle: below h = 0.05 nothing impacts, so that only modes are left to follow. The picture has both, by their names."""
    words = ("--impulsive", "--energy", "0.04", *DAMPED, "--duration", "300")
    record = reported(capsys, *words)
    assert not record["impacts"] and {stage["follows"]["label"] for stage in record["stages"]} == {"L11-"}
    assert run(capsys, "run", *words, "--plot", tmp_path / "modes.svg")[0] == 0
    picture = (tmp_path / "modes.svg").read_text()
    assert all(f'id="families-{name}"' in picture for name in ("L11+", "L11-"))


def test_no_marks_no_shares(capsys, tmp_path):
    """Oracle: energies without shares are null; stops and gap dampers are still distinguished, and the table names them, not a sink."""
    path = tmp_path / "unmarked.toml"
    path.write_text(SCENE.replace('LO = ["floor", "roof"]\nNES = ["sink"]\n', ""))
    words = ("--scene", path, "--state", "0,0,0,0,2,0", "--duration", "10", "--samples", "2", "--stages")
    code, out, err = run(capsys, "run", *words, "--json", "-")
    record = json.loads(out)
    assert code == 0 and record["stages"] is not None and record["stages_note"] is None
    assert record["samples"]["nes_energy"] == [None, None] and record["shares"]["nes"] > 0.0
    assert "shares   stops " in err and "NES" not in err and " LO" not in err


def test_stages_are_computed_where_they_are_asked_for(capsys, tmp_path, catalogue, monkeypatch):
    """Oracle: how often they are computed; without them the record, and a line of the table, say what asks for them."""
    import transitions.stages

    calls = []
    compute = transitions.stages.stages_of
    monkeypatch.setattr(transitions.stages, "stages_of", lambda *words, **options: calls.append(1) or compute(*words, **options))
    words = ("run", "--impulsive", "--energy", "0.3", *DAMPED, "--duration", "40")
    code, out, _ = run(capsys, *words, "--json", tmp_path / "a.json", "--csv", tmp_path / "a.csv")
    record = json.loads((tmp_path / "a.json").read_text())
    assert code == 0 and not calls and record["stages"] is None and record["changes"] is None
    assert "--stages" in record["stages_note"] and f"stages   not computed: {record['stages_note']}" in out.splitlines()
    for asked in (("--stages",), ("--catalogue", catalogue), ("--plot", tmp_path / "a.png")):
        calls.clear()
        code, out, _ = run(capsys, *words, *asked)
        assert code == 0 and calls and "not computed" not in out


def test_progress_is_reported_of_the_motion_and_of_its_stages(capsys, monkeypatch):
    """Oracle: percentages that do not fall, of which the last is the whole."""
    import saltus.terminal

    seen = {}
    monkeypatch.setattr("bvp.interrupts.MOST", 1)
    monkeypatch.setattr("bvp.interrupts.FIRST", 1)
    monkeypatch.setattr(saltus.terminal.ProgressBar, "update", lambda bar, count, more="": seen.setdefault(bar._things, []).append(count))
    assert run(capsys, "run", "--impulsive", "--energy", "0.3", *DAMPED, "--duration", "40", "--stages")[0] == 0
    motion, stages = seen["% of the motion and its peaks"], seen["% of the stages"]
    assert len(motion) > 5 and motion == sorted(motion) and motion[-1] == 100
    assert stages == sorted(stages) and 90 <= stages[-1] <= 100


STIFF = """
import sys
from saltus.__main__ import main
main(["run", "--scene", "three_storey_building", "--duration", "0.1", "--stages"])
print("ready", flush=True)
sys.exit(main(["run", "--scene", sys.argv[1], "--stages"]))
"""


def test_a_run_is_interrupted_while_it_computes(tmp_path):
    """Oracle: the exit code, of a run whose record would take hours: one damper is 2.5e8 times as strong. A minute is enough to see that it
    does not go on."""
    scene = Path(__file__).parents[2] / "catalogues" / "three_storey_building.toml"
    for file in scene.parent.glob("three_storey_building*"):
        shutil.copy(file, tmp_path)
    stiff = tmp_path / "stiff.toml"
    stiff.write_text(scene.read_text().replace("[4000.0, -2000.0, 0.0, 0.0]", "[1e12, -2000.0, 0.0, 0.0]", 1))
    assert "1e12" in stiff.read_text()
    child = subprocess.Popen([sys.executable, "-c", STIFF, stiff], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=scene.parents[1])
    try:
        assert child.stdout is not None
        while child.stdout.readline().strip() not in (b"ready", b""):
            pass
        time.sleep(1.0)
        assert child.poll() is None
        child.send_signal(signal.SIGINT)
        assert child.wait(timeout=60.0) == 130
    finally:
        child.kill()
        child.communicate()


def test_stages_of_a_long_motion_are_reported_as_far_as_its_record_goes(capsys, monkeypatch):
    """Oracle: a record that has to be four times as coarse shows the stages of a slow motion to its end; one that is too coarse for that
    has the note, and stages that end before it; the other numbers are those of the whole motion."""
    words = ("--impulsive", "--energy", "8", *DAMPED, "--duration", "150")
    monkeypatch.setattr("saltus.motion.simulation.MOST_SAMPLES", 2000)
    record = reported(capsys, *words)
    assert record["stages_note"] is None and record["stages"][-1]["end"] == pytest.approx(150.0, abs=1.0)
    monkeypatch.setattr("saltus.motion.simulation.MOST_SAMPLES", 100)
    record = reported(capsys, *words)
    up_to = float(record["stages_note"].split()[4].rstrip(","))
    assert up_to < 150.0 == record["duration"]
    assert record["stages"] and all(stage["end"] <= up_to for stage in record["stages"])


def test_the_picture(capsys, tmp_path, catalogue):
    """Oracle: the file's own signature; over the family that the motion starts on, and over those of a catalogue."""
    words = ("run", "--on", "S13O00+", "--energy", "0.4", *DAMPED, "--duration", "20")
    assert run(capsys, *words, "--plot", tmp_path / "own.png")[0] == 0
    code, out, _ = run(capsys, *words, "--plot", tmp_path / "kept.svg", "--catalogue", catalogue, "--clearance", "0.1")
    assert code == 0 and "the figure is in natural units" in out
    assert (tmp_path / "own.png").read_bytes().startswith(b"\x89PNG") and (tmp_path / "kept.svg").read_bytes().startswith(b"<?xml")


def test_the_table_names_the_family_of_the_start_and_where_it_is_left(capsys):
    """Oracles: an undamped motion never leaves the impact sequence of its orbit; restitution 0.7 changes that of S13O00+ at h = 10 at
    its second impact, so the first stage follows another family; on S11O00- all impacts alternate, as in the orbit."""
    for words, expected in (
        (("S13O00+", "--energy", "10", "--duration", "20"), "leaves   S13O00+ at no impact: all 6 are in its impact sequence"),
        (
            ("S13O00+", "--energy", "10", *DAMPED, "--duration", "20"),
            "leaves   S13O00+ at 3.30196: impact 2 is at stop +, that of the orbit at",
        ),
        (
            ("S11O00-", "--energy", "0.8", *DAMPED, "--duration", "20"),
            "leaves   S11O00- at no impact: all 7 are in its impact sequence, the last",
        ),
    ):
        code, out, err = run(capsys, "run", "--on", *words, "--json", "-")
        initial, impacts = json.loads(out)["initial"], json.loads(out)["impacts"]
        assert code == 0 and expected in err
        if initial["left"] is None:
            assert len({(a["stop"], b["stop"]) for a, b in zip(impacts, impacts[1:], strict=False)} - {("+", "-"), ("-", "+")}) == 0
        else:
            assert initial["left"] == {"impact": 2, "time": impacts[1]["time"], "stop": impacts[1]["stop"], "expected": "-"}


@pytest.mark.parametrize("name", ["S31O11-", "U8344-", "S95E22-", "U4122-"])
def test_an_undamped_impulsive_motion_keeps_the_impact_sequence_of_its_orbit(capsys, name):
    """Oracle: it is the periodic orbit itself, which starts at either end of the solved part, or is mirrored."""
    code, out, _ = run(capsys, "run", "--on", name, "--impulsive", "--duration", "65", "--json", "-")
    initial, impacts = json.loads(out)["initial"], json.loads(out)["impacts"]
    assert code == 0 and initial["kind"] == "impulsive" and len(impacts) > 8
    assert initial["left"] is None and initial["follows"]["impacts"] == len(impacts) and initial["follows"]["end"] == 65.0


def stage_table(out):
    """The rows of the table of stages: what it says of the start, and of each stage."""
    lines = out.splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("stage "))
    rows = list(itertools.takewhile(lambda line: line[:5].strip().isdigit() or line.startswith("start"), lines[head + 1 :]))
    return rows[0], rows[1:]


@pytest.mark.parametrize(
    ("words", "reasons"),
    [
        (("S13O00+", "--energy", "10"), ["of the orbit's amplitude", None, None, "has no orbit at these energies", "no impact"]),
        (("U4122-", "--impulsive"), ["of the orbit's amplitude", "no impact"]),
    ],
    ids=lambda words: words[0],
)
def test_the_stages_begin_with_the_family_of_the_start(capsys, words, reasons):
    """Oracle: see `require_the_stages_begin_with_the_family_of_the_start`."""
    require_the_stages_begin_with_the_family_of_the_start(capsys, words, reasons)


def require_the_stages_begin_with_the_family_of_the_start(capsys, words, reasons):
    """Oracles: the impacts of the motion; each stage follows the family of the start, by the name that was asked for, or says why not;
    another label of that family is said behind the name alone."""
    code, out, err = run(capsys, "run", "--on", *words, *DAMPED, "--duration", "400", "--stages", "--json", "-")
    record, name = json.loads(out), words[0]
    assert code == 0
    follows, left = record["initial"]["follows"], record["initial"]["left"]
    start, stages = stage_table(err)
    times = [impact["time"] for impact in record["impacts"]]
    assert follows["name"] == record["initial"]["on"]["name"] == name and follows["label"] == record["initial"]["on"]["label"]
    assert follows["end"] == (times[-1] if left is None else left["time"]) == times[follows["impacts"] - (left is None)]
    assert start.split()[:3] == ["start", "0", f"{follows['end']:.5g}"] and f"follows {name}, where it starts" in start
    spent = record["initial"]["energy"] - follows["dissipated_nes"] - follows["dissipated_lo"]
    assert spent == pytest.approx(follows["energies"][0], rel=1e-9)
    assert len(stages) == len(record["stages"]) == len(reasons)
    for line, stage, reason in zip(stages, record["stages"], reasons, strict=True):
        same = stage["follows"] is not None and stage["follows"]["family"] == follows["family"]
        assert same == (reason is None) == (stage["why"] == "")
        if same:
            other = stage["follows"]["label"]
            assert f" of {name}" in line and ((f"{name} (counted {other} here)" in line) == (other != name))
        else:
            assert reason in line and name in line
    first = next(line for line in err.splitlines() if line.startswith("start "))
    assert (f"on {name} (counted {follows['label']})" in first) == (follows["label"] != name)
    labels = {follows["label"], *(stage["follows"]["label"] for stage in record["stages"] if stage["follows"])} - {name, "L11+", "L11-"}
    for label in labels:
        assert all(f"(counted {label}" in line for line in err.splitlines() if label in line)


def test_what_has_no_record_has_no_picture(capsys, tmp_path, monkeypatch):
    """Oracle: exit code 1, one line, no file; what else was asked for is written."""
    monkeypatch.setattr("saltus.motion.simulation.FINEST", 1e-9)
    monkeypatch.setattr("saltus.motion.simulation.MOST_SAMPLES", 60)
    words = ("--impulsive", "--energy", "8", *DAMPED, "--duration", "150", "--plot", tmp_path / "a.png", "--json", tmp_path / "a.json")
    code, _, err = run(capsys, "run", *words)
    assert code == 1 and "cannot draw" in err and "too coarse" in err and len(err.splitlines()) == 1
    assert not (tmp_path / "a.png").exists() and (tmp_path / "a.json").exists()


def test_an_outcome_that_is_not_defined_is_a_failure_with_what_was_computed(capsys, tmp_path):
    """Oracle: exit code 1, the words, and the file."""
    (tmp_path / "corner.toml").write_text(CORNER)
    code, out, _ = run(
        capsys, "run", "--scene", tmp_path / "corner.toml", "--state", "0,0,1,0", "--duration", "9", "--json", tmp_path / "out.json"
    )
    assert code == 1 and "two stops are hit at the same instant" in out
    record = json.loads((tmp_path / "out.json").read_text())
    assert record["ended"]["reason"] == "SIMULTANEOUS" and record["duration"] == pytest.approx(math.asin(0.5), rel=1e-14)


def test_a_motion_that_ends_beyond_a_stop_is_not_reported_as_its_start(capsys, monkeypatch):
    """Oracle: by hand: of a motion that rounding carries beyond a stop later on, the record so far is reported, and why it ended."""
    import bvp.simulate

    def carried_beyond(*arguments, **options):
        return replace(run_damped(*arguments, **options), status=MotionStatus.PIERCED)

    monkeypatch.setattr(bvp.simulate, "simulate", carried_beyond)
    code, out, err = run(capsys, "run", "--impulse", "1", *DAMPED, "--duration", "5", "--json", "-")
    record = json.loads(out)
    assert code == 1 and not err.startswith("saltus:")
    assert record["ended"]["reason"] == "PIERCED" and record["duration"] == 5.0 and "the start lies" not in record["ended"]["text"]
