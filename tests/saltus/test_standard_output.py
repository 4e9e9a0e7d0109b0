"""Standard output that fails, interrupts, and what the operating system refuses: the files are written, one line says what is wrong."""

import gzip
import json
import os
import pkgutil
import signal
import subprocess
import sys

import pytest

from saltus.__main__ import main
from saltus.errors import LONGEST
from tests.saltus.running import refused, run

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs a shell, signals and pipes of this kind")
SALTUS = f"{sys.executable} -m saltus"
QUICK = "continue S13O00+ --energy 0.2:0.4 --points 5"
FULL = "saltus: cannot write standard output: no space is left on the device\n"


def shell(command, **options):
    """A finished process."""
    return subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=300, **options)


@POSIX
def test_a_full_standard_output_does_not_keep_files_from_being_written(tmp_path):
    """Oracles: the files asked for; one line on standard error; the exit code 2."""
    done = shell(f"{SALTUS} {QUICK} --json {tmp_path}/a.json --csv {tmp_path}/a.csv >/dev/full")
    assert (done.returncode, done.stderr) == (2, FULL)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a.csv", "a.json"]


@POSIX
@pytest.mark.parametrize("words", [QUICK, f"{QUICK} --json -", ""])
def test_a_full_standard_output_is_one_line(words):
    """Oracle: exit code 2, and what the system says."""
    done = shell(f"{SALTUS} {words} >/dev/full")
    assert done.returncode == 2 and done.stderr.endswith(FULL) and done.stderr.count("saltus:") == 1


@POSIX
def test_a_reader_that_leaves_ends_the_command_without_files_and_not_one_with_files(tmp_path):
    """Oracles: nothing on standard error; the files asked for."""
    for more, files in ("", []), (f"--json {tmp_path}/a.json", ["a.json"]):
        done = shell(f"{SALTUS} {QUICK} {more} | true")
        assert done.stderr == "" and [entry.name for entry in tmp_path.iterdir()] == files


@POSIX
def test_a_standard_error_that_fails_does_not_mix_with_data():
    """Oracle: what is printed is one JSON text."""
    done = shell(f"{SALTUS} {QUICK} --json - 2>/dev/full")
    assert done.returncode == 0 and len(json.loads(done.stdout)["points"]) == 5


@POSIX
def test_pipes_are_written_by_their_path(tmp_path):
    """Oracle: the data that another program reads at the end of the pipe."""
    packed = tmp_path / "a.gz"
    done = shell(f"{SALTUS} {QUICK} --csv >(gzip > {packed}) --json >(cat > {tmp_path}/a.json); wait $!; sleep 0.2")
    assert done.returncode == 0, done.stderr
    assert gzip.decompress(packed.read_bytes()).startswith(b"h,alpha,")
    assert len(json.loads((tmp_path / "a.json").read_text())["points"]) == 5


def test_messages_have_an_end(capsys):
    """Oracle: both ends of what is too long to be read."""
    error = refused(run(capsys, "continue", "S13O00+", "--energy", "9" * 50_000), "--energy: received '999", "expected LO:HI")
    assert len(error) < LONGEST + 100


def test_what_the_system_refuses_is_said_as_it_is(capsys, monkeypatch):
    """Oracle: the words for the error's number, and the file that it names; not standard output."""

    def refuse(words):
        raise OSError(24, "Too many open files", "branch.json")

    monkeypatch.setattr("saltus.__main__._command", refuse)
    assert run(capsys) == (2, "", "saltus: too many files are open (ulimit -n): branch.json\n")


@POSIX
def test_an_interrupt_after_the_ends_waits_for_the_files(capsys, tmp_path, monkeypatch):
    """Oracle: the branch of an undisturbed run; the exit code 130. The interrupt comes with the line of an end."""
    places = [tmp_path / name for name in ("whole.json", "cut.json", "cut.csv")]
    assert main([*QUICK.split(), "--json", str(places[0])]) == 0
    from saltus.terminal import ProgressBar

    line, sent = ProgressBar.line, []

    def interrupted(self, text, stream):
        line(self, text, stream)
        if text.startswith("end    ") and not sent:
            sent.append(text)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ProgressBar, "line", interrupted)
    capsys.readouterr()
    words = ["--json", places[1], "--csv", places[2], "--save", "--catalogue", tmp_path / "a.sqlite"]
    code, out, err = run(capsys, *QUICK.split(), *words)
    assert code == 130 and err == "saltus: interrupted; what was computed is written\n"
    assert len(json.loads(places[1].read_text())["points"]) == len(json.loads(places[0].read_text())["points"])
    assert places[2].read_text().startswith("h,alpha,") and out.splitlines()[-1].startswith("saved  ")


@POSIX
def test_an_interrupt_while_a_branch_is_finished_comes_with_the_branch(monkeypatch):
    """Oracle: the branch of an undisturbed run, which travels with the error."""
    import saltus

    expected = saltus.trace("S13O00+", energy=(0.2, 0.4), points=5)
    sent = []

    def interrupt():
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt) as caught:
        saltus.trace("S13O00+", energy=(0.2, 0.4), points=5, on_end=lambda end: sent.append(end) or len(sent) > 1 or interrupt())
    assert list(caught.value.branch.points["h"]) == list(expected.points["h"])
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def interrupting(monkeypatch, place, after=False):
    """Let an interrupt come when a function is first called, before its work or after it."""
    asked, sent = pkgutil.resolve_name(place), []

    def interrupted(*arguments, **options):
        found = asked(*arguments, **options) if after else None
        if not sent:
            sent.append(place)
            signal.raise_signal(signal.SIGINT)
        return found if after else asked(*arguments, **options)

    monkeypatch.setattr(place, interrupted)


def interrupted_run(capsys, folder, monkeypatch, words, place, after=False):
    """The JSON of an undisturbed run, that of a run with an interrupt, and the one line that the second says."""
    assert main([*words, "--json", str(folder / "whole.json")]) == 0
    interrupting(monkeypatch, place, after)
    capsys.readouterr()
    code, _, err = run(capsys, *words, "--json", folder / "cut.json")
    assert code == 130 and err.startswith("saltus: interrupted; ") and err.count("\n") == 1
    return *(json.loads((folder / f"{name}.json").read_text()) for name in ("whole", "cut")), err


@POSIX
@pytest.mark.parametrize(
    ("option", "place", "missing"),
    [
        ("--stages", "saltus.motion.simulation.with_stages", "stages"),
        ("--stages", "saltus.motion.record.motion_record", None),
        (None, "transitions.record.extents", "peaks"),
        ("--locked", "saltus.motion.simulation.run_locked", "locked"),
    ],
)
def test_an_interrupted_run_writes_its_motion(capsys, tmp_path, monkeypatch, option, place, missing):
    """Oracle: the impacts of an undisturbed run, which ends as before; null for what was to be computed from them."""
    words = ["run", "--impulse", "0.5", "--duration", "8", *([option] if option else [])]
    whole, cut, err = interrupted_run(capsys, tmp_path, monkeypatch, words, place)
    assert cut["impacts"] == whole["impacts"] and cut["ended"] == whole["ended"]
    assert (cut["stages"] is None) == (missing == "stages" or option != "--stages")
    assert missing is None or cut[missing] is None
    if option != "--stages":
        assert err.startswith("saltus: interrupted; the motion is written")
        assert cut["locked"] is None and (cut["peaks"] is None) == (missing == "peaks")


@pytest.mark.parametrize("words", [QUICK, "list --catalogue {catalogue}"])
def test_kernels_that_are_not_to_be_compiled_are_one_line(catalogue, tmp_path, words):
    """Oracle: numba's own switch, and an empty cache folder; what needs no kernel works."""
    command = [*SALTUS.split(), *words.format(catalogue=catalogue).split()]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if words.startswith("list"):
        assert (done.returncode, done.stderr) == (0, "")
        return
    announced, *lines = done.stderr.splitlines()
    expected = "saltus: NUMBA_DISABLE_JIT is set, and saltus computes with compiled code alone; expected it unset, or 0"
    assert (done.returncode, lines) == (2, [expected]) and announced.startswith("saltus: compiling")


@POSIX
def test_an_interrupt_at_exit_ends_with_130():
    """Oracle: the exit code, where the interrupt comes after the work, in what a library does at exit."""
    code = "import atexit, os, signal, sys, saltus.__main__ as m\n"
    code += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code += "m._command = lambda words: atexit.register(lambda: (os.kill(os.getpid(), signal.SIGINT), print('late'))) and 0\nm.program()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_an_interrupt_while_a_class_is_made_is_one_line(capsys, monkeypatch):
    """Oracle: Python itself, which wraps an interrupt in `__set_name__` up to version 3.11."""

    class Interrupted:
        def __set_name__(self, owner, name):
            raise KeyboardInterrupt

    monkeypatch.setattr("saltus.commands.list.run", lambda arguments: type("Made", (), {"part": Interrupted()}))
    assert run(capsys, "list") == (130, "", "saltus: interrupted; nothing more is written\n")


@POSIX
def test_a_motion_that_is_interrupted_is_written_up_to_there(capsys, tmp_path, monkeypatch):
    """Oracle: the impacts of an undisturbed run, of which the first ones are there."""
    monkeypatch.setattr("saltus.compiling.prepare", lambda *groups: None)
    words = ["run", "--impulse", "20", "--lam", "0", "--rho", "1", "--duration", "80"]
    whole, cut, err = interrupted_run(capsys, tmp_path, monkeypatch, words, "bvp.interrupts.Pace.__exit__", after=True)
    assert err.startswith("saltus: interrupted; the motion is written")
    count = len(cut["impacts"])
    assert 100 < count < len(whole["impacts"]) and cut["impacts"] == whole["impacts"][:count]
    assert cut["ended"]["reason"] == "INTERRUPTED" and cut["energy_balance_error"] < 1e-12
    assert cut["duration"] <= whole["impacts"][count]["time"]


@POSIX
def test_peaks_of_a_long_motion_are_left_out_after_an_interrupt(capsys, tmp_path, monkeypatch):
    """Oracle: all impacts of the motion up to there, and null for its peaks."""
    monkeypatch.setattr("saltus.motion.simulation.MOST_IN_A_HURRY", 100)
    monkeypatch.setattr("saltus.compiling.prepare", lambda *groups: None)
    words = ["run", "--impulse", "20", "--lam", "0", "--rho", "1", "--duration", "80"]
    whole, cut, _ = interrupted_run(capsys, tmp_path, monkeypatch, words, "bvp.interrupts.Pace.__exit__", after=True)
    count = len(cut["impacts"])
    assert cut["peaks"] is None and 100 < count < len(whole["impacts"]) and cut["impacts"] == whole["impacts"][:count]


@POSIX
def test_a_second_interrupt_ends_the_program(capsys, tmp_path, monkeypatch):
    """Oracle: the exit code; no file, where the first interrupt would have waited for it."""
    interrupting(monkeypatch, "saltus.motion.simulation.with_stages")
    interrupting(monkeypatch, "saltus.motion.record.motion_record")
    code, _, err = run(capsys, "run", "--impulse", "0.5", "--duration", "8", "--stages", "--json", tmp_path / "cut.json")
    assert code == 130 and err.splitlines()[-1] == "saltus: interrupted; nothing more is written" and not list(tmp_path.iterdir())
