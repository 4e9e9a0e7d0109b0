"""`saltus basin`: options, files, messages, exit codes."""

import csv
import json
import signal

import numpy as np
import pytest

from tests.saltus.running import read_json, refused, run

BISTABLE = ["basin", "--scene", "damped_impact_oscillator", "--set", "w=2.2", "--set", "A=1", "--set", "c=0.02"]
PLANE = ["--x", "x:-2:2", "--y", "x':-4:4"]


def test_the_files_have_the_same_starts(folder, capsys):
    """Oracle: JSON, CSV and NPZ with each other; the stop at x = 1; the table on the terminal."""
    files = ["--json", "a.json", "--csv", "a.csv", "--npz", "a.npz", "--mat", "a.mat", "--plot", "a.png"]
    code, out, err = run(capsys, *BISTABLE, *PLANE, "--grid", "16x12", *files)
    assert code == 0 and not err
    lines = out.splitlines()
    assert lines[0] == "basin    16 x 12 starts over x = -2 to 2 and x' = -4 to 4; phase 0"
    assert lines[1].split() == ["attractor", "kind", "family", "period", "impacts", "|multiplier|", "starts", "share"]
    assert [line.split()[:2] for line in lines[2:4]] == [["A1", "periodic"], ["A2", "periodic"]] and lines[5].startswith("S1 ")
    assert "beyond   48 of 192 starts are beyond a stop" in lines
    data = read_json("a.json")
    assert (data["schema"], data["kind"], data["starts"], data["impossible"], data["undecided"]) == (1, "basin", 144, 48, {})
    assert data["x"] == {"name": "x", "range": [-2.0, 2.0], "count": 16} and data["y"]["count"] == 12 and data["fixed"] == {}
    cells = np.array(data["cells"])
    assert cells.shape == (12, 16) and np.all((cells == -1) == (np.arange(16) >= 12))
    assert [one["starts"] for one in data["attractors"]] == [int(np.sum(cells == k)) for k in (1, 2)]
    assert data["attractors"][1]["sequence"] == "" and data["saddles"][0]["period"] == 2 and data["saddles_from"] == "boundary"
    with open("a.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["attractor"]) for row in rows] == cells.ravel().tolist() and float(rows[1]["start_u.x"]) == -1.625
    arrays = np.load("a.npz")
    assert np.array_equal(arrays["attractor"], cells.ravel())
    assert json.loads(str(arrays["about"]))["attractors"] == data["attractors"]


def test_workers_change_nothing(folder, capsys):
    """Oracle: the files of one process and of two."""
    for workers in (1, 2):
        assert run(capsys, *BISTABLE, *PLANE, "--grid", "20x20", "--workers", workers, "--csv", f"{workers}.csv")[0] == 0
    one, other = ((folder / f"{workers}.csv").read_bytes() for workers in (1, 2))
    assert one == other and one.count(b"\n") == 401


def test_attractors_and_saddles_are_named_by_followed_families(folder, capsys):
    """Oracle: the ids in the file, or closure and sequence where it has none; the saddle that is found without the file."""
    scene = ["--scene", "damped_impact_oscillator", "--set", "w=2.2", "--set", "A=1", "--set", "c=0.02"]
    start = ["--from", "simulate", "--start", "0.94,0.41", "--in", "w", "--range", "1.9:2.6", "--json", "hits.json"]
    assert run(capsys, "continue", *scene, *start)[0] == 0
    assert run(capsys, "continue", *scene, "--from", "rest", "--in", "w", "--range", "2.1:2.3", "--json", "rest.json")[0] == 0
    both = ["--from", "hits.json", "--from", "rest.json"]
    assert run(capsys, *BISTABLE, *PLANE, "--grid", "8x8", *both, "--json", "named.json")[0] == 0
    assert run(capsys, *BISTABLE, *PLANE, "--grid", "8x8", "--json", "plain.json")[0] == 0
    named, plain = read_json("named.json"), read_json("plain.json")
    assert sorted(one["family"] for one in named["attractors"]) == sorted(one["family"] for one in plain["attractors"])
    assert all(one["branch"] for one in named["attractors"])
    for name in ("hits.json", "rest.json"):  # as files from a catalogue, and older ones, have them
        record = read_json(name)
        assert all(branch["id"] is None for branch in record["branches"])
        record["branches"] = [{**branch, "id": f"{name}:{k}"} for k, branch in enumerate(record["branches"])]
        (folder / name).write_text(json.dumps(record))
    assert run(capsys, *BISTABLE, *PLANE, "--grid", "8x8", *both, "--json", "named.json")[0] == 0
    named = read_json("named.json")
    ids = [branch["id"] for name in ("hits.json", "rest.json") for branch in read_json(name)["branches"]]
    assert sorted(one["family"] for one in named["attractors"]) == sorted({ids[0], ids[-1]}) and len(set(ids)) >= 2
    assert all(one["branch"] for one in named["attractors"]) and named["cells"] == plain["cells"]
    assert named["saddles_from"] == "file" and plain["saddles"][0]["multipliers"][0][0] > 1.0
    places = [np.array(sorted(found["saddles"][0]["positions"])) for found in (named, plain)]
    assert np.abs(places[0] - places[1]).max() < 1e-8


def test_a_file_of_another_system_or_value_is_refused(folder, capsys):
    scene = ["--scene", "damped_impact_oscillator", "--set", "A=0.05"]
    assert run(capsys, "continue", *scene, "--from", "rest", "--in", "w", "--range", "0.9:1.1", "--json", "rest.json")[0] == 0
    refused(run(capsys, "basin", *scene, "--set", "w=2", "--from", "rest.json"), "--from rest.json", "no orbit at w = 2", "0.9 to 1.1")
    refused(run(capsys, "basin", *scene, "--set", "c=0.2", "--from", "rest.json"), "--from rest.json", "expected")
    refused(run(capsys, "basin", "--scene", "absorber", "--from", "rest.json"), "--from rest.json", "another system than the scene")


def test_what_is_undecided_is_counted(folder, capsys):
    """Oracle: ten periods are too few for weak damping."""
    code, out, _ = run(capsys, *BISTABLE, *PLANE, "--grid", "30x30", "--periods", "10", "--json", "a.json", "--workers", "1")
    data = read_json("a.json")
    ((reason, count),) = data["undecided"].items()
    assert code == 0 and reason == "not settled in 10 periods" and f"undecided {count} of 690 starts: {reason}" in out
    assert count == np.sum(np.array(data["cells"]) == 0) > 0


def test_an_interrupt_writes_what_is_done(folder, capsys, monkeypatch):
    """Oracle: exit code 130, and a file with starts of both kinds."""
    monkeypatch.setattr("transitions.basin.rounds.BLOCK", 20)
    updates = []

    def update(self, count, more=""):
        updates.append(count)
        if len(updates) == 3:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("saltus.terminal.ProgressBar.update", update)
    code, _, err = run(capsys, *BISTABLE, *PLANE, "--grid", "12x12", "--json", "a.json")
    assert code == 130 and err == "saltus: interrupted; the starts that were finished are written\n"
    data = read_json("a.json")
    assert 0 < sum(one["starts"] for one in data["attractors"]) == 108 - data["undecided"]["interrupted"] < 108


@pytest.mark.parametrize("words", [[], ["--x", "u2", "--y", "u2'", "--fix", "u1'=0.5", "--phase", "7"]])
def test_the_plane_is_the_first_coordinate_with_its_velocity_by_default(words, folder, capsys):
    """Oracle: the stops at |u1 - u2| = 1."""
    code, _, _ = run(capsys, "basin", "--scene", "absorber", "--set", "w=0.82", *words, "--grid", "2x2", "--json", "a.json")
    data = read_json("a.json")
    assert code == 0 and data["x"]["range"] == [-1.0, 1.0] and abs(data["phase"] - (0.0 if not words else 7.0 - 2.0 * np.pi)) < 1e-12
    fixed = {"u2": 0.0, "u2'": 0.0} if not words else {"u1": 0.0, "u1'": 0.5}
    assert data["fixed"] == fixed and [one["family"] for one in data["attractors"]] == ["half-period-1:+"]
