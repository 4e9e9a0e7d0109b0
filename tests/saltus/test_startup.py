"""The first run: what a command needs is compiled before it starts, in several processes, and only once."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import tempfile

import pytest

from bvp.kernels import stored
from saltus import compiling
from saltus.__main__ import main

ANNOUNCE = compiling.announce
"""As it is outside the tests, which are not to depend on what was compiled before them."""


def forget_the_cache():
    """Have the cache folder looked at again, as by a new process."""
    for function in (stored.cache_root, stored.folder_of, stored.unread, stored._unwritten):
        function.cache_clear()


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """An empty cache folder, and a list with one small kernel in two groups."""
    forget_the_cache()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    call = [0.6, "bvp.kernels.flight", "free_step", ["", "float", "float", "float"]]
    other = [0.6, "bvp.kernels.flight", "pair_envelope", ["", "float", "float", "float"]]
    listed = {"kernels": [call, other], "commands": {"continue": [0], "run": [0, 1]}}
    monkeypatch.setattr(compiling, "_listed", lambda: listed)
    monkeypatch.setattr(compiling, "announce", ANNOUNCE)
    monkeypatch.setattr(compiling, "_tried", set())
    yield listed
    monkeypatch.undo()
    forget_the_cache()


def test_all_that_is_missing_is_compiled_and_nothing_twice(empty, capsys):
    """Oracle: the files, and a second call that finds nothing to do and says nothing."""
    assert compiling.missing("continue") == empty["kernels"][:1]
    compiling.prepare("continue")
    assert capsys.readouterr() == ("", "saltus: compiling 1 kernel, at the first run only\n")
    (file,) = stored.folder_of("bvp.kernels.flight").iterdir()
    assert file.name.startswith("free_step-")
    compiling.prepare("continue")
    assert capsys.readouterr() == ("", "")
    assert compiling.missing() == empty["kernels"][1:]


def test_damaged_files_are_compiled_like_missing_ones(empty, capsys):
    """Oracle: a file that is cut, as by a crash of the system."""
    compiling.prepare("continue")
    (file,) = stored.folder_of("bvp.kernels.flight").iterdir()
    os.truncate(file, file.stat().st_size // 2)
    compiling._tried.clear()
    assert compiling.missing("continue") == empty["kernels"][:1]
    capsys.readouterr()
    compiling.prepare("continue")
    assert capsys.readouterr().err == "saltus: compiling 1 kernel, at the first run only\n"
    assert compiling.missing("continue") == []


def a_file(root, monkeypatch):
    root.parent.write_text("no folder")
    return f"cannot make the folder {root}: Not a directory"


def open_to_others(root, monkeypatch):
    root.mkdir(parents=True)
    root.chmod(0o777)
    return f"others can write to the folder {root}; remove it, and it is made anew"


def full(root, monkeypatch):
    def refuse(*args, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    return f"cannot write to the folder {root}: No space left on device"


@pytest.mark.skipif(os.name != "posix", reason="modes of folders are those of POSIX")
@pytest.mark.parametrize("make", [a_file, open_to_others, full])
def test_where_nothing_can_be_kept_one_line_says_so(empty, monkeypatch, tmp_path, capsys, make):
    """Oracle: folders by hand, and a disk that is full. The kernels are compiled when they are called: no process is started in vain."""
    reason = make(tmp_path / "kept/saltus-kernels", monkeypatch)
    monkeypatch.setattr(compiling, "compile_kernels", None)
    assert main(["compile"]) == 2
    assert capsys.readouterr() == ("", f"saltus: compiled kernels cannot be kept: {reason}\n")
    compiling.prepare("run")
    compiling.prepare("run")
    assert capsys.readouterr() == ("", f"saltus: compiling 2 kernels, at each run; they are not kept: {reason}\n")


def test_a_folder_that_cannot_be_written_and_lacks_nothing_is_not_mentioned(empty, monkeypatch, tmp_path, capsys):
    """Oracle: a disk that became full when all was compiled."""
    compiling.prepare()
    full(tmp_path, monkeypatch)
    capsys.readouterr()
    compiling.prepare("run")
    assert capsys.readouterr() == ("", "")
    assert main(["compile"]) == 0
    assert capsys.readouterr() == ("all kernels are compiled: no command compiles any\n", "")


def test_where_no_process_can_start_the_command_goes_on(empty, monkeypatch):
    """Oracle: an operating system that refuses processes: nothing is compiled, and nothing is raised."""

    def refuse(*args, **options):
        raise OSError("no more processes")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    compiling.prepare("run")
    assert len(compiling.missing()) == 2


def test_a_kernel_for_other_arguments_brings_its_own_group(empty, monkeypatch):
    """Oracle: the groups by hand. One kernel is compiled for plain numbers first, then met with a vector."""
    other = [0.6, "bvp.kernels.flight", "free_step", ["", "float64 1 C", "float", "float"]]
    empty["kernels"].append(other)
    empty["commands"] |= {"vectors": [1, 2], "more": [0, 1, 2]}
    asked = []
    monkeypatch.setattr(compiling, "compile_kernels", lambda calls: asked.append(calls))
    compiling.prepare("continue")
    compiling.prepare_with(other[1], other[2], stored.types_from(other[3]))
    compiling.prepare_with(other[1], other[2], stored.types_from(other[3]))  # it was tried
    assert asked == [empty["kernels"][:1], empty["kernels"][1:]]


def test_a_kernel_on_no_list_is_announced(empty, monkeypatch, capsys):
    """In a worker process nothing is said."""
    call = "bvp.kernels.flight", "free_step", stored.types_from(["", "float64 1 C", "float", "float"])
    compiling.prepare_with(*call)
    assert capsys.readouterr().err == "saltus: compiling 1 kernel, at the first run only\n"
    monkeypatch.setattr(compiling.multiprocessing, "parent_process", lambda: object())
    compiling.prepare_with(*call)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ("impulsive --energy 1:2", "impulsive"),
        ("export fep --plot a.png --catalogue {catalogue} --impulsive", "impulsive"),
        ("discover --energy 1", "discover"),
        ("continue S13O00+", "continue"),
        ("continue --scene absorber --in w --range 0.9:1.1 --from rest", "response"),
        ("continue --scene absorber --in w --range 0.9:1.1 --from simulate", "response, simulated response"),
        ("run --state 0,0,0,1 --duration 1", "run"),
        ("section --energy 1", "section"),
        ("build --energy 0.06:0.1 --catalogue {new}", "build"),
        ("build --scene three_mass_chain --catalogue {new}", "build modes"),
    ],
)
def test_commands_ask_for_the_kernels_that_they_use(monkeypatch, catalogue, tmp_path, words, asked):
    """Oracle: the groups by hand; the command ends where it asks."""
    seen = []

    def stop(*groups):
        seen.extend(groups)
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compiling, "prepare", stop)
    assert main(words.format(catalogue=catalogue, new=tmp_path / "new.sqlite").split()) == 130
    assert seen == asked.split(", ")


@pytest.mark.parametrize("words", ["S13O00+ --points 20", "S11- --energy 0.06:0.1"])
def test_a_warm_start_imports_what_it_needs(words):
    """No compiler, and nothing that takes as long as the family; also with normal forms. Oracle: the modules of a process whose kernels are
    on disk."""
    compiling.prepare("continue")
    heavy = ("numba", "scipy", "sympy", "matplotlib", "networkx")
    follow = f"from saltus.__main__ import main; main({['continue', *words.split()]})"
    script = f"import sys; {follow}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


SHOWN = """
import sys
from saltus import compiling, terminal
from saltus.__main__ import main

worker = '''
import json, os, sys, time
from bvp.kernels.stored import keep, sealed, symbol, types_from
for line in sys.stdin:
    while not os.path.exists("go"):
        time.sleep(0.01)
    module, name, types = json.loads(line)
    keep(module, symbol(module, name, types_from(types)), sealed(b"machine code", []))
    print(0.1, flush=True)
'''
compiling._listed = lambda: LISTED
compiling._COMMAND = [sys.executable, "-c", worker]
compiling.workers_for = lambda calls: 1
terminal.PATIENCE, terminal.PAUSE = 0.0, 0.05
sys.exit(main(["compile"]))
"""


def read_until(stream, text):
    """What arrives until a text does, or until the end where it is None."""
    received = b""
    while text is None or text not in received:
        try:
            more = os.read(stream, 4096)
        except OSError:  # the end of a pseudo-terminal, on Linux
            more = b""
        if not more:
            assert text is None, received
            break
        received += more
    return received.decode()


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are those of POSIX")
@pytest.mark.parametrize("on_terminal", [True, False])
def test_what_a_first_run_shows(empty, tmp_path, on_terminal):
    """Oracle: the announcement is read before any kernel is compiled: these wait for a file. Then a bar counts in a terminal, by control
    characters that move the cursor; elsewhere lines do, without them."""
    place = {name: os.environ[name] for name in ("NUMBA_CACHE_DIR", "PATH") if name in os.environ}
    environment = {**place, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path), "TERM": "xterm", "COLUMNS": "100"}
    reading, writing = os.openpty() if on_terminal else os.pipe()
    script = SHOWN.replace("LISTED", repr(empty))
    with subprocess.Popen(
        [sys.executable, "-c", script], cwd=tmp_path, stdout=subprocess.PIPE, stderr=writing, env=environment, text=True
    ) as process:
        os.close(writing)
        said = read_until(reading, b"\n")
        assert said.startswith("saltus: compiling 2 kernels, at the first run only")
        if not on_terminal:
            said += read_until(reading, b"still at work after 0 min\n")
        (tmp_path / "go").touch()
        said += read_until(reading, None)
        out = process.communicate()[0]
    os.close(reading)
    assert process.returncode == 0 and out.startswith("compiled 2 of 2 kernels") and "all kernels are compiled" in out
    assert ("\x1b[2K" in said and " 2 kernels" in said.partition("\n")[2]) is on_terminal
    assert "\\x1b" not in said


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
def test_an_interrupt_says_what_is_kept(empty, tmp_path):
    """Oracle: no kernel is finished, since all wait for a file."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
    script = SHOWN.replace("LISTED", repr(empty))
    with subprocess.Popen([sys.executable, "-c", script], cwd=tmp_path, stderr=subprocess.PIPE, env=environment) as process:
        read_until(process.stderr.fileno(), b"still at work after 0 min\n")
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1].decode().splitlines()[-1]
    assert process.returncode == 130
    assert said == "saltus: interrupted; 0 of 2 kernels are compiled and kept; the same command goes on with the rest"


COMPILING = """
import os, sys
from bvp.kernels import __main__, compiled
compiled.Kernel.compile = lambda kernel, types: (print(os.getpid(), flush=True), __import__("time").sleep(60))
__main__.compile_requested()
"""


def test_a_process_that_compiles_ends_with_the_one_that_asks(empty):
    """Oracle: the end of its output, long before that of the kernel."""
    with subprocess.Popen([sys.executable, "-c", COMPILING], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        print(json.dumps(empty["kernels"][0][1:]), file=process.stdin, flush=True)
        assert process.stdout.readline()
        process.stdin.close()
        assert process.wait(10.0) == 1
