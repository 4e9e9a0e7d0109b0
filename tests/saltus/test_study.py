"""`saltus study` and `saltus plot`: files that are checked, blocks that are kept, pictures drawn from them."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import saltus
from tests.branches.building.test_frontier import Serial
from tests.saltus.running import refused, run

SMALL = """
title = "small"
design = "hypercube"
runs = 60
seed = 4
block = 10
[fixed]
lam = 0.01
[vary.energy]
from = 0.06
to = 10.0
scale = "log"
[vary.rho]
from = 0.0
to = 1.0
[run]
until = 60.0
"""

LARGE = """
design = "grid"
[vary.energy]
from = 0.1
to = 1.0
points = 1000000
[vary.rho]
from = 0.0
to = 1.0
points = 100000
"""


def written(folder, text, name="a.toml"):
    path = folder / name
    path.write_text(text)
    return path


def blocks(folder):
    return {path.name: path.read_bytes() for path in sorted(Path(folder).glob("block-*"))}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The small study, run by one process: its file and its folder."""
    from saltus.__main__ import main

    path = written(tmp_path_factory.mktemp("study"), SMALL)
    assert main(["study", str(path), "--workers", "1"]) == 0
    return path, path.with_suffix(".study")


@pytest.fixture(autouse=True)
def one_worker_is_this_process(monkeypatch):
    """No process is started for one worker; `finished`, and what is killed or has two workers, are by processes."""
    from saltus import processes

    plain = processes.open_executor

    def opened(workers, dask=None):
        return contextlib.nullcontext((Serial(), 1)) if workers == 1 and dask is None else plain(workers, dask)

    monkeypatch.setattr(processes, "open_executor", opened)


def assert_same(folder, other):
    """Both studies have the same runs and results, bit for bit."""
    one, two = saltus.Study(folder), saltus.Study(other)
    assert one.names == two.names and list(one.given) == list(two.given)
    for name in one.names:
        assert np.array_equal(one[name], two[name], equal_nan=True)
    assert all(np.array_equal(one.given[name], two.given[name]) for name in one.given)


def test_the_report_has_the_quartiles_of_the_finite_values(finished):
    """Oracle: numpy, and the arrays of the study."""
    from saltus.commands.study import study_lines

    study = saltus.Study(finished[1])
    lines = study_lines(study)
    assert lines[0] == f"done     60 runs, {study['impacts'].sum()} impacts"
    rows = {line.split()[0]: line.split()[1:] for line in lines if not line.startswith(("done", "ended", "balance", " "))}
    assert set(rows) == {name for name in study.names if name not in ("ended", "balance_error") and np.isfinite(study[name]).any()}
    for name, cells in rows.items():
        values = study[name][np.isfinite(study[name])]
        assert cells == [f"{value:.5g}" for value in (values.min(), *np.quantile(values, [0.25, 0.5, 0.75]), values.max())]


def test_arrays_by_name(finished):
    """Oracle: the runs themselves, each by `saltus.vibro_impact_nes` and the general run."""
    from bvp.simulate import simulate as damped

    study = saltus.Study(finished[1])
    assert study.complete and len(study) == 60 and sum(study.endings().values()) == 60
    for b in (0, 17, 59):
        system = saltus.vibro_impact_nes(lam=0.01, rho=study.given["rho"][b])
        motion = damped(system, [0.0, 0.0], [0.0, np.sqrt(2.0 * study.given["energy"][b])], 60.0)
        assert study["h"][b] == pytest.approx(study.given["energy"][b], rel=1e-15)
        if motion.impacts < 20:
            assert study["impacts"][b] == motion.impacts
            assert study["nes_share"][b] * study["h"][b] == pytest.approx(motion.dissipated["stop a"], abs=1e-9)
    assert study["left_share"] == pytest.approx(1.0 - study["nes_share"] - study["lo_share"])
    with pytest.raises(KeyError, match="nes_share"):
        study["nes"]


def test_energies_and_lengths_are_those_of_the_clearance_on_output(tmp_path, capsys):
    """Oracle: clearance^2 h, and the peaks of clearance 1 times the clearance; the file's energies are h."""
    text = 'design = "grid"\n[vary.clearance]\nvalues = [1.0, 0.5]\n[vary.energy]\nvalues = [0.5, 2.0]\n[fixed]\nlam = 0.01\nrho = 0.7\n'
    assert run(capsys, "study", written(tmp_path, text), "--workers", 1)[0] == 0
    study = saltus.Study(tmp_path / "a.study")
    assert study["h"] == pytest.approx([0.5, 2.0, 0.5, 2.0]) and study["energy"] == pytest.approx([0.5, 2.0, 0.125, 0.5])
    assert study["peak_u2"][2:] == pytest.approx(0.5 * study["peak_u2"][:2], rel=1e-15)
    assert np.array_equal(study["nes_share"][2:], study["nes_share"][:2])


def test_the_result_does_not_depend_on_the_workers(finished, tmp_path, capsys):
    """Oracle: the files of one worker, byte for byte."""
    code, out, err = run(capsys, "study", finished[0], "--out", tmp_path / "two", "--workers", 2)
    assert code == 0 and not err and "60 runs in 6 blocks" in out
    assert {name: _numbers(data) for name, data in blocks(tmp_path / "two").items()} == {
        name: _numbers(data) for name, data in blocks(finished[1]).items()
    }


def _numbers(data):
    """The arrays of an NPZ: its headers hold the time of writing."""
    import io

    with np.load(io.BytesIO(data)) as arrays:
        return {name: arrays[name].tobytes() for name in arrays.files}


def test_a_killed_study_goes_on(finished, tmp_path, capsys):
    """Oracle: the study that was not killed; blocks that were finished are not run again."""
    path, out = written(tmp_path, SMALL), tmp_path / "a.study"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    words = [sys.executable, "-m", "saltus", "study", str(path), "--workers", "1"]
    process = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 300.0
    while not blocks(out) and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    kept = blocks(out)
    assert kept
    times = {name: (out / name).stat().st_mtime_ns for name in kept}
    code, text, err = run(capsys, "study", path, "--workers", 1)
    assert code == 0 and not err and f"{len(kept)} of 6 blocks are finished" in text
    assert {name: (out / name).stat().st_mtime_ns for name in kept} == times
    assert_same(out, finished[1])


def test_a_damaged_block_is_reported_and_done_again(finished, tmp_path, capsys):
    """Oracle: the block as it was."""
    out = tmp_path / "copy"
    shutil.copytree(finished[1], out)
    block = out / "block-000002.npz"
    data = bytearray(block.read_bytes())
    data[len(data) // 2] ^= 1
    block.write_bytes(bytes(data))
    with pytest.raises(ValueError, match=r"block-000002.npz is damaged.*does it again"):
        saltus.Study(out)
    (out / "block-000004.npz").unlink()
    (out / "study.json").write_text("{")
    code, text, err = run(capsys, "study", finished[0], "--out", out, "--workers", 1)
    assert code == 0 and not err and "DAMAGED  block-000002.npz" in text and "4 of 6 blocks are finished" in text
    assert_same(out, finished[1])


@pytest.mark.parametrize("key", ["axes", "fixed", "system", "block", "runs", "title", "until", "units"])
@pytest.mark.parametrize("value", ["text", ["a", 1], None, {"a": None}, 1e300])
def test_a_plan_of_other_kinds_of_values_is_damaged(finished, tmp_path, capsys, key, value):
    """Oracle: one line and exit code 2, whatever the entry is."""
    out = tmp_path / "copy"
    shutil.copytree(finished[1], out)
    about = json.loads((out / "study.json").read_text())
    about["plan"][key] = value
    if key == "title" and value == "text":
        return
    (out / "study.json").write_text(json.dumps(about))
    refused(run(capsys, "plot", out, "--csv", tmp_path / "a.csv"), "study.json is damaged")


@pytest.mark.parametrize("text", ["", "{}", "null", "[]", '"a"', '{"plan": 1}', '[{"plan": {}}]'])
def test_a_file_that_holds_no_plan_is_damaged(finished, tmp_path, capsys, text):
    """Oracle: one line, exit code 2, and no words of Python; the study writes it again."""
    out = tmp_path / "copy"
    shutil.copytree(finished[1], out)
    (out / "study.json").write_text(text)
    refused(run(capsys, "plot", out, "--csv", tmp_path / "a.csv"), "study.json is damaged: it differs from the plan that was written")
    assert run(capsys, "study", finished[0], "--out", out, "--workers", 1)[0] == 0
    assert_same(out, finished[1])


def test_another_study_s_folder_is_refused(finished, tmp_path, capsys):
    """Oracle: exit code 2, and every file as it was; so without its plan."""
    other, out = written(tmp_path, SMALL.replace("seed = 4", "seed = 5")), tmp_path / "copy"
    shutil.copytree(finished[1], out)
    before = blocks(out)
    refused(run(capsys, "study", other, "--out", out), "its seed is 4, and the file says 5")
    (out / "study.json").unlink()
    code, text, err = run(capsys, "study", other, "--out", out, "--workers", 1)
    assert code == 2 and err.count("\n") == 1 and "another study" in err
    assert blocks(out) == before and not (out / "study.json").exists()
    refused(run(capsys, "study", finished[0], "--out", other), "a.toml is a file; expected a folder for the study's blocks")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    code, _, err = run(capsys, "study", finished[0], "--out", tmp_path / "mine")
    assert code == 2 and "thesis.tex" in err and len(list((tmp_path / "mine").iterdir())) == 1


FAMILIES = """
design = "grid"
[fixed]
lam = 0.01
rho = 0.7
[vary.family]
values = ["S11O00-", "impulsive"]
[vary.energy]
values = [0.05, 0.8]
"""


def test_starting_families(tmp_path, capsys):
    """Oracle: the orbit of the family at the energy, and the general run from it; below the family's fold there is no orbit (h = 0.069)."""
    from bvp.simulate import simulate as damped
    from transitions.study.figure import lines_figure
    from transitions.study.runs import Ending

    code, text, err = run(capsys, "study", written(tmp_path, FAMILIES), "--workers", 1)
    assert code == 0 and not err and "1: the starting family has no orbit" in text
    study = saltus.Study(tmp_path / "a.study")
    assert study.given["family"].tolist() == ["S11O00-", "S11O00-", "impulsive", "impulsive"]
    assert study["ended"][0] == Ending.NO_ORBIT.code and np.isnan(study["nes_share"][0])
    (orbit,) = saltus.trace("S11O00-", energy=(0.05, 2.0)).orbits_at(energy=0.8)
    motion = damped(saltus.vibro_impact_nes(lam=0.01, rho=0.7), [0.0, 0.0], orbit.velocities, 3000.0)
    assert study["impacts"][1] == motion.impacts and study["last_impact"][1] == pytest.approx(motion.last_impact, abs=1e-6)
    assert (tmp_path / "a.study" / "starts.npz").exists()
    again = run(capsys, "study", tmp_path / "a.toml", "--workers", 1)
    assert again[0] == 0 and "1 of 1 blocks are finished" in again[1]
    drawn = run(capsys, "plot", tmp_path / "a.study", "--view", "map", "--plot", tmp_path / "a.png")
    refused(drawn, "--view map needs two parameters that are numbers", "varies family, energy")
    best = study.best()
    assert best.given["family"] == "S11O00-" and best.value == np.nanmax(study["nes_share"])
    study["nes_share"][:] = np.nan
    for asked in (study.best, lambda: lines_figure(study)):
        with pytest.raises(ValueError, match="no finished run of .*a.study has nes_share"):
            asked()


def test_a_family_with_several_orbits_asks_which(tmp_path, capsys):
    """Oracle: above its fold near h = 0.0691 and below the grazing at h = 0.0871 the out-of-phase backbone has two orbits."""
    text = FAMILIES.replace("[0.05, 0.8]", "[0.075]")
    code, out, err = run(capsys, "study", written(tmp_path, text), "--workers", 1)
    assert code == 2 and not out and err.count("\n") == 1 and "2 orbits of S11O00-" in err and "alpha=" in err
    assert not (tmp_path / "a.study").exists()
    alphas = sorted(float(part.partition(" ")[0]) for part in err.split("alpha=")[1:])
    for alpha in alphas:
        path = written(tmp_path, text.replace("S11O00-", f"S11O00-@alpha={alpha}"), f"{alpha}.toml")
        assert run(capsys, "study", path, "--workers", 1)[0] == 0
    shares = [saltus.Study(tmp_path / f"{alpha}.study")["time_90"][0] for alpha in alphas]
    assert shares[0] != shares[1]


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("[vary.rho]", "[vary.rhoo]", ["unknown key 'rhoo'", "nearest: rho"]),
        ("lam = 0.01", "lamb = 0.01", ["unknown key 'lamb'", "nearest: lam"]),
        ('scale = "log"', 'scale = "logarithmic"', ["'logarithmic'", "linear or log"]),
        ('"hypercube"', '"lattice"', ["'lattice'", "grid or hypercube"]),
        ("runs = 60\n", "", ["runs is missing"]),
        ('design = "hypercube"\n', "", ["design is missing", "grid or hypercube"]),
        ("runs = 60", "runs = 0", ["runs = 0", "from 2"]),
        ("runs = 60", "runs = 1.5", ["runs = 1.5", "integer"]),
        ("to = 1.0\n", "to = 1.5\n", ["to = 1.5", "0 to 1"]),
        ("to = 10.0", "to = 0.01", ["to = 0.01", "above from"]),
        ("from = 0.06", "from = -1", ["from = -1", "above 0"]),
        ("to = 1.0\n", 'to = 1.0\nscale = "log"\n', ["from = 0", "logarithmic scale"]),
        ("from = 0.0\nto = 1.0", "values = [0.5, 0.5]", ["values = [0.5, 0.5]", "each of them once"]),
        ("from = 0.0\nto = 1.0", "values = [0.5, 2.0]", ["values = 2", "rho 0 to 1"]),
        (SMALL, 'design = "grid"\nruns = 5\n[vary.rho]\nvalues = [0.5]\n[fixed]\nenergy = 1.0', ["runs goes with design = 'hypercube'"]),
        (SMALL, 'design = "grid"\n[vary]\n[fixed]\nenergy = 1.0', ["nothing is varied", "mu, sigma"]),
        (SMALL, LARGE, ["the grid has 100000000000 runs", "expected 100000000 at most"]),
        ("lam = 0.01", "rho = 0.5", ["rho is both varied and fixed"]),
        ("lam = 0.01", "impulse = 1.0", ["energy and impulse"]),
        ("lam = 0.01", 'family = "X13O00"', ["X13O00"]),
        ("lam = 0.01", 'family = "S13O00+@h=1"', ["names an energy"]),
        ("lam = 0.01\n[vary.energy]", 'family = "S13O00+"\n[vary.impulse]', ["a family's orbit is chosen by its energy"]),
        ("lam = 0.01", 'scene = "x"', ["unknown key 'scene'"]),
        ("until = 60.0", 'until = "cleared"', ["'cleared'", "nearest: clear"]),
        ("until = 60.0", "until = -1.0", ["until = -1", "above 0"]),
        ("until = 60.0", "until = 60.0\nlongest = 5.0", ["longest"]),
        ("until = 60.0", "impact = 3", ["unknown key 'impact'", "nearest: impacts"]),
        ('title = "small"', 'scene = "lee2010"', ["lee2010", "nearest: lee2009"]),
        ("[vary.rho]\nfrom = 0.0", "[vary.rho]\npoints = 3\nfrom = 0.0", ["points goes with"]),
        ("block = 10", "block = 0", ["block = 0"]),
        ("title =", "title", ["as TOML"]),
    ],
)
def test_a_bad_file_is_refused_before_anything_starts(tmp_path, capsys, old, new, parts):
    """Oracle: one line with what was received and what was expected, exit code 2, and nothing written."""
    assert old in SMALL
    refused(run(capsys, "study", written(tmp_path, SMALL.replace(old, new, 1))), *parts)
    assert [path.name for path in tmp_path.iterdir()] == ["a.toml"]


def test_a_start_that_is_missing_and_a_file_that_is_not_there(tmp_path, capsys):
    """Oracle: one line, exit code 2."""
    path = written(tmp_path, 'design = "grid"\n[vary.rho]\nvalues = [0.5]\n')
    assert "how does a run start" in run(capsys, "study", path)[2]
    assert "nearest: " in run(capsys, "study", tmp_path / "b.toml")[2]
    whole = written(tmp_path, SMALL, "c.toml")
    assert "does not exist" in run(capsys, "study", whole, "--out", tmp_path / "none" / "x")[2]
    assert "'csv'" in run(capsys, "study", whole, "--format", "csv")[2] and len(list(tmp_path.iterdir())) == 2


# -- pictures -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("view", "kind"), [("map", "png")])
def test_pictures_are_drawn_from_the_data(finished, tmp_path, capsys, view, kind):
    """Oracle: see `require_pictures_are_drawn_from_the_data`."""
    require_pictures_are_drawn_from_the_data(finished, tmp_path, capsys, view, kind)


def require_pictures_are_drawn_from_the_data(finished, tmp_path, capsys, view, kind):
    """Oracle: the format's first bytes; the same bytes again."""
    first, second = (tmp_path / f"{k}.{kind}" for k in (1, 2))
    for path in (first, second):
        code, out, err = run(capsys, "plot", finished[1], "--view", view, "--plot", path)
        assert code == 0 and not err and f"wrote  {path}" in out
    assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes()[:5] in (b"\x89PNG\r", b"%PDF-", b"<?xml")


def test_the_best_run_and_those_about_it(finished, capsys, tmp_path):
    """Oracle: the largest of the array; the nearest runs by their distance on the axes."""
    study = saltus.Study(finished[1])
    code, out, _ = run(capsys, "plot", finished[1], "--best", "lo_share", "--plot", tmp_path / "a.png")
    at = int(np.argmax(study["lo_share"]))
    assert code == 0 and f"best     lo_share = {study['lo_share'].max():.6g} in run {at}" in out
    best = study.best("lo_share")
    places = np.array([np.log(study.given["energy"]), study.given["rho"]])
    places = (places - places.min(axis=1)[:, None]) / np.ptp(places, axis=1)[:, None]
    distance = np.linalg.norm(places - places[:, [at]], axis=0)
    assert len(best.neighbours) == 5 and set(best.neighbours) == set(np.argsort(distance)[1:6])


def test_the_runs_as_a_table(finished, capsys, tmp_path):
    """Oracle: the study's arrays; the same numbers in each kind of file."""
    study = saltus.Study(finished[1])
    kinds = ("json", "csv", "npz", "mat")
    assert run(capsys, "plot", finished[1], *(word for kind in kinds for word in (f"--{kind}", tmp_path / f"a.{kind}")))[0] == 0
    listed = json.loads((tmp_path / "a.json").read_text())["runs"]
    rows = np.genfromtxt(tmp_path / "a.csv", names=True, delimiter=",")
    arrays, matlab = np.load(tmp_path / "a.npz"), loadmat(tmp_path / "a.mat")
    assert set(arrays) == {"run", *study.given, *study.names} and len(rows) == 60
    for name in ("run", "rho", "nes_share", "last_impact"):
        wanted = {"run": study.runs, "rho": study.given["rho"]}.get(name)
        wanted = study[name] if wanted is None else wanted
        for values in (rows[name], arrays[name], matlab[name][:, 0], np.array([row[name] for row in listed], dtype=float)):
            assert np.array_equal(values, wanted, equal_nan=True)


def test_what_a_map_and_lines_show(finished):
    """Oracle: medians and quartiles by hand; each run is in one cell; the artists of the figure have these numbers."""
    from transitions.study.figure import lines_figure, map_figure
    from transitions.study.study import along, over

    study = saltus.Study(finished[1])
    energy, rho = study.plan.axes
    found = over(study, energy, rho, study["nes_share"])
    assert found.counts.sum() == 60
    x = np.digitize(np.log(study.given["energy"]), np.log(found.x.edges[1:-1]))
    y = np.digitize(study.given["rho"], found.y.edges[1:-1])
    here = (x == 0) & (y == 0)
    assert found.counts[0, 0] == here.sum() and found.medians[0, 0] == np.median(study["nes_share"][here])
    mesh = next(artist for artist in map_figure(study).axes[0].collections if artist.get_gid() == "map")
    assert np.array_equal(mesh.get_array().filled(np.nan).ravel(), found.medians.T.ravel(), equal_nan=True)
    star = next(line for line in map_figure(study).axes[0].lines if line.get_gid() == "best")
    colours = {star.get_markerfacecolor(), star.get_markeredgecolor(), star.get_path_effects()[0]._gc["foreground"]}
    assert colours == {"white", "#000000"}, "one of the two stands out on any colour"
    places, quartiles = along(study, rho, study["nes_share"])
    part = np.clip((study.given["rho"] * len(places)).astype(int), 0, len(places) - 1) == 0
    assert quartiles[0] == pytest.approx(np.quantile(study["nes_share"][part], [0.25, 0.5, 0.75]))
    panel = lines_figure(study).axes[1]
    line = next(line for line in panel.lines if line.get_gid() == "median-median")
    assert np.array_equal(line.get_ydata(), quartiles[:, 1])


def test_studies_beside_each_other(finished, tmp_path, capsys):
    """Oracle: the runs of each study; the limits have all of them."""
    from transitions.study.figure import lines_figure

    studies = []
    for name, scene, high in (("impacts", "lee2009", 1.0), ("cubic", "cubic_nes", 4.0)):
        vary = f'from = 0.1\nto = {high}\npoints = 3\n[run]\nuntil = 20.0\n'
        (tmp_path / f"{name}.toml").write_text(f'title = "{name}"\nscene = "{scene}"\ndesign = "grid"\n[vary.energy]\n{vary}')
        assert run(capsys, "study", tmp_path / f"{name}.toml", "--set", "lam=0.05", "--workers", 1)[0] == 0
        studies.append(saltus.Study(tmp_path / f"{name}.study"))
    (panel,) = lines_figure(studies[0], "lo_share", beside=studies[1:]).axes
    for study in studies:
        line = next(line for line in panel.lines if line.get_gid() == f"median-{study.plan.title}")
        assert line.get_xdata() == pytest.approx(study.given["energy"]) and line.get_ydata() == pytest.approx(study["lo_share"])
    assert panel.get_xlim()[1] > 4.0
    words = [studies[0].path, "--view", "lines", "--plot", tmp_path / "a.png", "--beside"]
    assert run(capsys, "plot", *words, studies[1].path)[0] == 0
    code, _, err = run(capsys, "plot", *words, finished[1])
    assert code == 2 and "beside it are studies of the same numbers" in err


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--plot", "a.jpg"], ["'jpg'", "png, pdf or svg"]),
        (["--plot", "{folder}/none/a.png"], ["does not exist"]),
        (["--plot", "{folder}/a.png", "--best", "nes_shares"], ["nes_shares", "nearest: nes_share"]),
        (["--plot", "{folder}/a.png", "--value", "xyzzy"], ["xyzzy", "expected"]),
        (["--plot", "{folder}/a.png", "--view", "maps"], ["'maps'", "nearest: map"]),
        (["--plot", "{folder}/a.png", "--over", "energy,roh"], ["'energy,roh'", "nearest: rho"]),
        (["--plot", "{folder}/a.png", "--over", "energy"], ["two parameters"]),
        (["--plot", "{folder}/a.png", "--beside", "{folder}"], ["--beside draws lines", "expected --view lines"]),
        (["--plot", "{folder}/a.png", "--view", "lines", "--beside", "{folder}"], ["is not a study"]),
        (["--plot", "{folder}/a.png", "--over", "energy,rho", "--view", "lines"], ["--view map"]),
        ([], ["--plot"]),
    ],
)
def test_a_picture_that_cannot_be_is_refused(finished, tmp_path, capsys, words, parts):
    """Oracle: one line, exit code 2, nothing written."""
    refused(run(capsys, "plot", finished[1], *(word.format(folder=tmp_path) for word in words)), *parts)
    assert not list(tmp_path.iterdir())


def test_a_folder_without_a_study(tmp_path, capsys):
    """Oracle: one line, exit code 2."""
    refused(run(capsys, "plot", tmp_path, "--plot", tmp_path / "a.png"), "is not a study")
