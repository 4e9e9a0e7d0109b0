"""`saltus build`: a very small catalogue by two processes, browsed; bad input in one line."""

import json
import multiprocessing

import pytest

import saltus
from benchmarks.backbone import Backbone
from saltus.terminal import ProgressBar
from tests.saltus.running import reported

SMALL = "--energy 0.06:0.4 --max-quarter-period 1.9 --max-impacts 2"


def test_a_small_build_is_browsed(tmp_path):
    """Oracle: the catalogue's own check, and the backbones of Lee et al. 2009 in its list."""
    path = tmp_path / "small.sqlite"
    code, out, err = reported(f"build {SMALL} --workers 2 --catalogue {path} --json {tmp_path}/report.json")
    assert (code, err) == (0, "") and "complete" in out
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["complete"] and report["bounds"]["quarter_period"] == 1.9 and report["failed"] == []
    code, out, err = reported(f"list --catalogue {path}")
    assert code == 0 and "S13O00+" in out and "S11O00-" in out
    assert reported(f"check {path}")[0] == 0
    code, out, err = reported(f"build {SMALL} --catalogue {path}")
    assert code == 0 and f"done   {report['families']} families" in out
    other = SMALL.replace("impacts 2", "impacts 3")
    code, out, err = reported(f"build {other} --catalogue {path}")
    assert code == 2 and not out and err.count("\n") == 1 and "up to 2 impacts" in err and "up to 3 impacts" in err


def test_the_summary_says_what_fifty_digits_cost(tmp_path, monkeypatch):
    """Oracle: the report of the build, changed."""
    from branches.building import build as building

    real = building.build

    def build(*arguments):
        return real(*arguments) | {"digits": {"orbits": 12, "seconds": 3.25}, "missed": ["x: between two points"]}

    monkeypatch.setattr(building, "build", build)
    bounds = "--energy 0.051:0.055 --max-quarter-period 2 --max-impacts 1"
    code, out, err = reported(f"build {bounds} --workers 1 --catalogue {tmp_path}/a.sqlite")
    assert (code, err) == (0, "")
    assert "12 orbits solved in fifty digits to decide stability, in 3.2 s" in out and "1 event missed" in out


def test_another_system_builds_just_as_well(tmp_path):
    """Oracle: the catalogue's own check; the out-of-phase backbone is there from its fold on, which is at another energy."""
    path = tmp_path / "other.sqlite"
    bounds = "--mu 0.37 --sigma 0.81 --energy 0.41:0.9 --max-quarter-period 1.5 --max-impacts 2"
    assert reported(f"build {bounds} --workers 1 --catalogue {path}")[0] == 0
    assert reported(f"check {path}")[0] == 0
    families = json.loads(reported(f"list --catalogue {path} --json -")[1])["families"]
    fold = next(family["h"][0] for family in families if family["label"] == "S11O00-")
    expected = saltus.trace("S11O00-", saltus.vibro_impact_nes(mu=0.37, sigma=0.81), energy=(0.41, 0.9)).points["h"].min()
    assert abs(fold / expected - 1.0) < 1e-9
    code, out, err = reported(f"build --energy 0.41:0.9 --max-quarter-period 1.5 --max-impacts 2 --catalogue {path}")
    assert code == 2 and err.count("\n") == 1 and "mu is" in err


@pytest.mark.parametrize(
    ("bounds", "expected"),
    [
        ("--energy 0.5:4 --max-quarter-period 1e-3 --max-impacts 3", "no orbit has so short a quarter period; the shortest"),
        ("--energy 0.051:0.055 --max-quarter-period 2 --max-impacts 1", "at h = 0.051 and at h = 0.055 no orbit within the impacts"),
        ("--energy 0.01:0.02 --max-quarter-period 2 --max-impacts 1", "no motion reaches a stop below h = 0.05"),
    ],
)
def test_bounds_in_which_nothing_lies(tmp_path, bounds, expected):
    """Oracle: sigma/2, below which nothing impacts; U44-, the lowest family known, from h = 0.0585 on; and the closed form of S11O00-,
    the orbit with the shortest quarter period, at the highest energy."""
    code, out, err = reported(f"build {bounds} --workers 1 --catalogue {tmp_path}/a.sqlite")
    assert code == 0 and not err and "0 families" in out
    assert f"nothing lies inside the bounds: {expected}" in out
    if "4 " in bounds:
        alpha = float(out.rpartition("energy is ")[2].partition(" ")[0])
        assert "(S11O00-, h = 4)" in out and abs(Backbone().energy(alpha) / 4.0 - 1.0) < 1e-4



def test_an_interrupted_build_says_that_what_was_finished_is_kept(tmp_path, monkeypatch):
    """Oracle: exit code 130 and one line; the file opens with the families that were finished; the same command ends well."""
    path = tmp_path / "small.sqlite"

    def interrupt(self, count, words=""):
        if count >= 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(ProgressBar, "update", interrupt)
        code, _, err = reported(f"build {SMALL} --workers 1 --catalogue {path}")
    assert code == 130 and err.count("\n") == 1 and "keeps what was finished" in err and str(path) in err
    code, out, _ = reported(f"list --catalogue {path}")
    assert code == 0 and "2 of 2 families" in out
    assert reported(f"build {SMALL} --workers 1 --catalogue {path}")[0] == 0


def test_a_worker_that_is_killed_is_reported(tmp_path, monkeypatch):
    """Oracle: exit code 1 and one line that says what to do; the same command ends well."""
    path = tmp_path / "small.sqlite"
    killed = []

    def kill(self, count, words=""):
        if not killed:
            killed.append(True)
            for worker in multiprocessing.active_children():
                worker.kill()

    with monkeypatch.context() as patched:
        patched.setattr(ProgressBar, "update", kill)
        code, _, err = reported(f"build {SMALL} --workers 1 --catalogue {path}")
    assert code == 1 and err.count("\n") == 1 and "a worker process was killed" in err and "the same command goes on" in err
    assert reported(f"build {SMALL} --workers 1 --catalogue {path}")[0] == 0
