"""The command line: what it prints and writes, and how it ends."""

import ast
import csv
import importlib
import io
import json
import math
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import saltus
from saltus.scene.model import explain
from saltus.terminal import ProgressBar
from tests.saltus.running import refused, run

ROOT = Path(__file__).parents[2]
NUMBER = r"[-+0-9.e]+"
EVENT = re.compile(rf"^ *-?\d+  [A-Z]{{2}} +\S+ +({NUMBER}) +({NUMBER}) +(yes|no|undecided) +({NUMBER}|unbounded)")
QUICK = ("--energy", "0.05:1")


def test_help_and_version_are_quick_and_load_nothing():
    """Oracle: the modules that Python has loaded after it; the heavy ones are named."""
    heavy = "numpy", "scipy", "sympy", "matplotlib", "networkx", "numba", "rich"
    for word in ("--help", "--version", "-V"):
        loaded = f"print([name for name in {heavy} if name in sys.modules])"
        code = f"import sys\nfrom saltus.__main__ import main\ntry: main(['{word}'])\nfinally: {loaded}"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert done.stdout.splitlines()[-1] == "[]", done.stdout
    assert f"saltus {saltus.__version__}" in done.stdout


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_the_shell_completes_commands_options_and_files(tmp_path, capsys):
    """Oracle: what bash offers for the last word, after it has read the script."""
    code, script, err = run(capsys, "--print-completion", "bash")
    assert (code, err) == (0, "")
    (tmp_path / "branch.json").touch()
    offers = {"saltus con": "continue", "saltus export fep --ins": "--inset", "saltus continue S13+ --json bra": "branch.json"}
    for line, offered in offers.items():
        words = line.split()
        ask = f"COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _shtab_saltus saltus {words[-1]} {words[-2]}; echo ${{COMPREPLY[@]}}"
        done = subprocess.run(["bash", "-c", f"{script}\n{ask}"], capture_output=True, text=True, cwd=tmp_path)
        assert done.stdout.split() == [offered], done
    assert run(capsys, "--print-completion", "fish")[0] == 2


def test_the_public_names_are_those_that_are_listed():
    """Oracle: the imports of the package's stub, which type checkers read."""
    source = ast.parse(Path(saltus.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    froms = [node for node in ast.walk(source) if isinstance(node, ast.ImportFrom)]
    imported = {alias.asname: (node.module, alias.name) for node in froms for alias in node.names if alias.asname}
    assert dir(saltus) == saltus.__all__ == sorted(imported) and len(imported) > 40
    for name, (module, original) in imported.items():
        assert getattr(saltus, name) is getattr(importlib.import_module(module), original)
    with pytest.raises(AttributeError, match="tracee"):
        _ = saltus.tracee


def test_the_pages_import_nothing_else():
    """Oracle: the import lines of the README and of docs/."""
    ours = re.compile(r"^\s*(?:from|import) (bvp|continuation|branches|transitions|saltus\.\w+)\b.*", re.MULTILINE)
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("**/*.md")]
    assert len(pages) > 5 and not [(page.name, line[0]) for page in pages for line in ours.finditer(page.read_text(encoding="utf-8"))]


def test_no_command_prints_the_help(capsys):
    """Oracle: the help names each command."""
    code, out, err = run(capsys)
    assert code == 0 and "continue" in out and "orbit" in out and not err


@pytest.mark.parametrize(
    ("command", "words"), [("build", "one stop, else those modes lead to"), ("discover", "by default those through the origin")]
)
def test_the_help_says_what_is_found(capsys, command, words):
    """Oracle: every family and orbit is searched for two degrees of freedom; else and by default only some."""
    with pytest.raises(SystemExit):
        run(capsys, command, "--help")
    text = " ".join(capsys.readouterr().out.split())
    assert "two degrees of freedom" in text and words in text


def test_data_on_standard_output_are_alone(capsys):
    """Oracle: the format; the table goes to standard error; the numbers of the CSV are those of the JSON."""
    code, out, err = run(capsys, "continue", "S13O00+", *QUICK, "--json", "-")
    data = json.loads(out)
    assert code == 0 and data["schema"] == 2 and data["branch"]["label"] == "S13O00+"
    assert err.startswith("start  ")
    assert len([line for line in err.splitlines() if EVENT.match(line)]) == len(data["events"])
    code, out, _ = run(capsys, "continue", "S13O00+", *QUICK, "--csv", "-")
    rows = list(csv.DictReader(io.StringIO(out)))
    assert code == 0 and [float(row["h"]) for row in rows] == [point["h"] for point in data["points"]]


@pytest.mark.parametrize(("suffix", "magic"), [("png", b"\x89PNG")])
def test_pictures(capsys, tmp_path, suffix, magic):
    """Oracle: see `require_pictures`."""
    require_pictures(capsys, tmp_path, suffix, magic)


def require_pictures(capsys, tmp_path, suffix, magic):
    """Oracle: the first bytes of each format; the files are named as they are written."""
    picture, data = tmp_path / f"family.{suffix}", tmp_path / "family.json"
    words = ("--plot", str(picture), "--json", str(data), "--frequency", "fundamental")
    code, out, _ = run(capsys, "continue", "S13O00+", *QUICK, *words)
    assert code == 0 and picture.read_bytes().startswith(magic)
    assert f"wrote  {picture}" in out and f"wrote  {data}" in out
    assert {entry.name for entry in tmp_path.iterdir()} == {f"family.{suffix}", "family.json"}


def test_an_orbit(capsys, tmp_path):
    """Oracle: published: S13O00+ has alpha = 1.7 at h = 0.58875 (Fig. 7(a)); closed form h = 0.588748128566443."""
    picture, data = tmp_path / "orbit.png", tmp_path / "orbit.json"
    words = ("--alpha", "1.7", "--json", str(data), "--plot", str(picture), "--csv", str(tmp_path / "orbit.csv"))
    code, out, err = run(capsys, "orbit", "S13O00+", *words)
    orbit = json.loads(data.read_text())["orbit"]
    assert code == 0 and not err and "multiplier" in out and "impacts  2 in a period" in out
    assert math.isclose(orbit["h"], 0.588748128566443, rel_tol=1e-12)
    assert [impact["stop"] for impact in orbit["impacts"]] in (["+", "-"], ["-", "+"])
    assert math.isclose(orbit["impacts"][0]["time"], 1.7, rel_tol=1e-12)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "orbit.csv").read_text().splitlines()[0].startswith("label,")


@pytest.mark.parametrize(
    ("words", "h", "counted"),
    [
        (("U5231-",), 1.1710685, "U4231+"),  # by its event it ends with the oscillator's velocity alone
        (("U4122-",), 2.9873673, "U3122+"),
        (("S31O11-",), 1.6363853, "S13O11+"),
        (("S13+", "--scene", "smooth_wall"), 1.9605284, ""),
    ],
)
def test_the_impulsive_orbit_of_a_family_is_shown(capsys, tmp_path, words, h, counted):
    """Oracles: the energies of docs/reference/paper.md; at the start the oscillator alone moves, with all of the energy; the event-driven
    simulation returns there after a period."""
    code, out, err = run(capsys, "orbit", *words, "--impulsive", "--json", tmp_path / "a.json", "--plot", tmp_path / "a.png")
    orbit = json.loads((tmp_path / "a.json").read_text())["orbit"]
    assert code == 0 and not err and math.isclose(orbit["h"], h, rel_tol=1e-7)
    start = [*orbit["start"]["u"], *orbit["start"]["v"]]
    assert start == pytest.approx([0.0, 0.0, 0.0, math.sqrt(2.0 * orbit["h"])], abs=1e-9)
    if counted:
        assert f"orbit    {words[0]} (counted {counted})" in out
        motion = saltus.simulate(saltus.vibro_impact_nes(), [0.0, 0.0], start[2:], 4.0 * orbit["alpha"])
        (u,), (v,) = motion.sample([motion.duration])
        assert [*u, *v] == pytest.approx(start, abs=1e-6)


def test_a_family_without_an_impulsive_orbit(capsys):
    """Oracle: both backbones start with a sink that moves, at all energies."""
    refused(run(capsys, "orbit", "S13O00+", "--impulsive"), "S13O00+ has no impulsive orbit")
    refused(run(capsys, "orbit", "U4122-", "--impulsive", "--energy", "2"), "0 impulsive orbits with these values", "@h=2.987367315")
    refused(run(capsys, "orbit", "U4122-"), "needs --energy H, --alpha A or --impulsive")


@pytest.mark.parametrize(("energy", "reported"), [("1e11", False), ("1e13", True)])
def test_an_orbit_beyond_the_highest_energy_of_a_family_has_a_warning(capsys, energy, reported):
    """Oracle: the bound that docs/reference/limits.md states, 1e12."""
    code, out, _ = run(capsys, "orbit", "S11O00-", "--energy", energy)
    assert code == 0 and ("warning  above h = 1e+12" in out) is reported


def test_several_orbits_at_an_energy_are_listed(capsys):
    """Oracle: closed form: S11O00- has a fold at h = 0.0691164, so two orbits at h = 0.08; each suffix selects its orbit."""
    code, out, err = run(capsys, "orbit", "S11O00-", "--energy", "0.08")
    names = re.findall(r"S11O00-@\S+", err)
    assert code == 2 and not out and len(err.splitlines()) == 1 and len(names) == 2
    found = []
    for name in names:
        code, out, _ = run(capsys, "orbit", name, "--json", "-")
        assert code == 0
        found.append(json.loads(out)["orbit"])
        assert math.isclose(found[-1]["alpha"], float(name.rsplit("=", 1)[1]), rel_tol=1e-4)
    assert found[0]["alpha"] != found[1]["alpha"]
    assert all(math.isclose(orbit["h"], 0.08, rel_tol=1e-10) for orbit in found)


def test_the_label_asked_for_is_meant(capsys):
    """Oracle: published: S73O33- has h = 7.3348 at alpha = 1.6459 (Fig. 7(b)); its family has a second orbit there, S71O33+."""
    code, out, _ = run(capsys, "orbit", "S73O33-", "--energy", "7.3348", "--json", "-")
    orbit = json.loads(out)["orbit"]
    assert code == 0 and orbit["label"] == "S73O33-"
    assert math.isclose(orbit["h"], 7.3348, rel_tol=1e-12) and abs(orbit["alpha"] - 1.6459) < 1e-4
    code, out, _ = run(capsys, "orbit", "S71O33+@h=7.3348,alpha=1.64595", "--json", "-")
    assert code == 0 and json.loads(out)["orbit"]["label"] == "S71O33+"


def test_an_interrupted_run_writes_what_it_has(capsys, tmp_path, monkeypatch):
    """Oracle: the exit code 130, and the points before the interruption, by blocks. With --points the family is followed anew."""

    def interrupt(self, count):
        if count >= 20:
            raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "update", interrupt)
    path = tmp_path / "family.json"
    code, out, err = run(capsys, "continue", "S13O00+", "--points", "150", "--json", str(path))
    assert code == 130 and len(err.splitlines()) == 1 and "interrupted" in err
    assert 20 <= len(json.loads(path.read_text())["points"]) < 100


def test_a_failed_run_writes_what_it_has(capsys, tmp_path, monkeypatch):
    """Oracle: the exit code 1, the reason, and the points that travel with the error."""
    branch = saltus.trace("S13O00+", energy=(0.2, 0.7), points=10)

    def fail(*arguments, **options):
        error = RuntimeError("the corrector does not converge")
        error.branch = branch
        raise error

    monkeypatch.setattr("saltus.families.trace", fail)
    path = tmp_path / "family.json"
    code, _, err = run(capsys, "continue", "S13O00+", "--json", str(path))
    assert code == 1 and err == "saltus: the corrector does not converge\n"
    assert len(json.loads(path.read_text())["points"]) == 10


def test_an_end_for_numerical_reasons_is_a_failure(capsys, monkeypatch):
    """Oracle: the exit code 1 for the shortest step, 0 for other reasons."""
    branch = saltus.trace("S13O00+", energy=(0.2, 0.7), points=10)
    monkeypatch.setattr("saltus.families.trace", lambda *arguments, **options: branch)
    assert run(capsys, "continue", "S13O00+")[0] == 0
    first, last = branch.ended
    object.__setattr__(branch, "ended", (first, type(last)("MINIMUM_STEP", "steps were refused")))
    assert run(capsys, "continue", "S13O00+")[0] == 1


def test_the_model_is_explained(capsys):
    """Oracle: the function that explains it, whose examples have the words."""
    _, out, _ = run(capsys, "continue", "S13O00+", *QUICK, "--points", "5", "--model")
    model = [line[7:] for line in out.splitlines() if line.startswith("model  ")]
    assert model == explain(saltus.vibro_impact_nes(), "S13O00+")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs the device that is always full")
def test_a_full_disk_is_a_place_that_cannot_be_written_and_the_other_files_are_written(capsys, tmp_path):
    """Oracles: /dev/full refuses every byte; the exit code 2."""
    path = tmp_path / "family.csv"
    code, _, err = run(capsys, "continue", "S13O00+", *QUICK, "--json", "/dev/full", "--csv", str(path))
    assert code == 2 and err == "saltus: cannot write /dev/full: no space is left on the device\n"
    assert path.read_text().startswith("h,alpha,")


def test_a_reader_that_leaves_is_no_traceback():
    """Oracle: `head -1` in a shell."""
    command = f"{sys.executable} -m saltus continue S13O00+ --energy 0.05:1 --csv - | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert done.stdout.startswith("h,alpha,") and "Traceback" not in done.stderr


@pytest.mark.skipif(os.name != "posix", reason="needs pipes that break")
def test_a_reader_that_leaves_does_not_keep_the_files_from_being_written(tmp_path):
    """Oracle: every file that was asked for, whole, though nobody reads a line of what is reported."""
    names = ("a.json", "a.csv", "a.npz")
    options = (word for name in names for word in (f"--{name[2:]}", str(tmp_path / name)))
    command = [sys.executable, "-m", "saltus", "run", "--impulse", "0.5", "--duration", "5", *options]
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    os.close(writing)
    assert done.returncode == 0 and done.stderr == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert json.loads((tmp_path / "a.json").read_text())["duration"] == 5.0


@pytest.mark.skipif(os.name != "posix", reason="needs a shell that closes a stream")
@pytest.mark.parametrize("place", ["-", "spring.json"])
def test_data_for_a_closed_standard_output_are_not_lost_without_a_word(tmp_path, place):
    """Oracle: the documented exit code 2, a line that says so, and the file where there is one."""
    line = f"{sys.executable} -m saltus spring --scene smooth_wall --in n --values 5 --json {place} >&-"
    done = subprocess.run(["sh", "-c", line], cwd=tmp_path, env=os.environ | {"PYTHONPATH": os.getcwd()}, capture_output=True, text=True)
    assert done.returncode == 2 and "saltus: cannot write standard output" in done.stderr
    assert place == "-" or len(json.loads((tmp_path / place).read_text())["points"]) == 401


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_the_interrupt_key_ends_the_process_with_130():
    """Oracle: the exit code, and one line. The signal comes while points are computed: the first report of progress sends it."""
    # Of processes in the background the key is ignored.
    code = """
import os, signal, saltus.__main__ as m
from saltus.terminal import ProgressBar
signal.signal(signal.SIGINT, signal.default_int_handler)
ProgressBar.update = lambda self, count: os.kill(os.getpid(), signal.SIGINT)
m.program()
"""
    command = [sys.executable, "-c", code, "continue", "S11O00-"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.startswith("start") and done.stderr.startswith("saltus: interrupted") and done.stderr.count("\n") == 1
    assert done.returncode == 130


class Terminal(io.StringIO):
    """Standard error as a terminal."""

    def isatty(self):
        """Say that it is one."""
        return True


@pytest.mark.parametrize("on_terminal", [False, True])
def test_a_line_a_minute_where_no_bar_is_drawn(monkeypatch, capsys, on_terminal):
    """Oracle: the words, by a clock; a thread that prints them although nothing is reported to it, on a terminal too."""
    monkeypatch.setattr("saltus.terminal.time", type("Clock", (), {"monotonic": staticmethod(lambda: now[0])}))
    printed = threading.Event()
    now, lines = [0.0], []

    class Stream(io.StringIO):
        def write(self, text):
            lines.append(text)
            printed.set()

        def isatty(self):
            return on_terminal

    monkeypatch.setattr("sys.stderr", Stream())
    monkeypatch.setattr("saltus.terminal.PAUSE", 0.001)
    cases = [(60.0, (), "still at work after 1 min, with words")]
    if not on_terminal:
        cases.append((120.0, (12, "3 queued"), "12 families after 2 min, 3 queued"))
    for time_passed, reported, line in cases:
        now[0] = 0.0
        printed.clear()
        with ProgressBar(None, "families", "with words") as bar:
            now[0] = time_passed
            if reported:
                bar.update(*reported)
            while f"saltus: {line}" not in lines:
                assert printed.wait(60.0)
                printed.clear()


def test_the_bar_shows_nothing_without_standard_error(monkeypatch, capsys):
    """A library can be used where there is none, and compile its kernels there. Nothing goes to standard output instead."""
    monkeypatch.setattr("sys.stderr", None)
    monkeypatch.setattr("saltus.terminal.PAUSE", 0.001)
    with ProgressBar(3) as bar:
        bar.update(1)
        time.sleep(0.1)
    assert capsys.readouterr().out == ""


def test_the_bar_shows_on_a_terminal_only_and_late(monkeypatch):
    """Oracle: what standard error gets: nothing within a second, nothing where it is no terminal."""
    for stream, wait, expected in ((Terminal(), 0.0, False), (Terminal(), 2.0, True), (io.StringIO(), 2.0, False)):
        now = [time.monotonic()]
        monkeypatch.setattr("sys.stderr", stream)
        monkeypatch.setattr("saltus.terminal.time", type("Clock", (), {"monotonic": staticmethod(lambda now=now: now[0])}))
        printed = io.StringIO()
        with ProgressBar(100) as bar:
            bar.update(1)
            now[0] += wait
            bar.update(50)
            bar.line("a line", printed)
        assert bool(stream.getvalue()) is expected
        assert printed.getvalue() == "a line\n"
