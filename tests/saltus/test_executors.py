"""Processes that work: they end with the one that started them, however that ends."""

import gc
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from saltus.processes import open_executor

ROOT = Path(__file__).parents[2]

PARENT = """
import os, time
from saltus.processes import open_executor
if __name__ == "__main__":
    with open_executor(1) as (executor, _):
        print(executor.submit(os.getpid).result(), flush=True)
        time.sleep(60)
"""


def alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z" if Path("/proc/self/stat").exists() else True


def test_workers_of_a_killed_parent_end(tmp_path):
    """Oracle: the system's list of processes."""
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, env=environment) as parent:
        worker = int(parent.stdout.readline())
        assert alive(worker)
        parent.kill()
        parent.wait()
        until = time.monotonic() + 10.0
        while alive(worker) and time.monotonic() < until:
            time.sleep(0.05)
        assert not alive(worker)


BEGINNING = """
import os
from saltus import processes
processes.LOADED = "slow",
if __name__ == "__main__":
    try:
        with processes.open_executor(1) as (executor, _):
            executor.submit(os.getpid).result()
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="modules are loaded once on Linux alone")
def test_an_interrupt_while_workers_begin_prints_nothing(tmp_path):
    """Oracle: standard error, where Python writes tracebacks. The signal reaches all processes, as in a terminal, while one loads."""
    (tmp_path / "slow.py").write_text("import time\nprint('loading', flush=True)\ntime.sleep(0.3)\n")
    script = tmp_path / "parent.py"
    script.write_text(BEGINNING)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as parent:
        assert parent.stdout.readline() == "loading\n"
        os.killpg(parent.pid, signal.SIGINT)
        assert parent.communicate() == ("interrupted\n", "")


SWEEPING = """
import sys
from saltus import terminal
from saltus.__main__ import program
terminal.ProgressBar.update = lambda self, count, more="": print("piece", flush=True)
if __name__ == "__main__":
    sys.argv[1:] = "sweep --scene damped_impact_oscillator --in w --range 0.5:1.5 --points 4000 --json sweep.json --workers 2".split()
    program()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="these signals are those of POSIX")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_that_ends_all_processes_keeps_what_is_finished(tmp_path, number, code):
    """Oracle: the file, one line on standard error, and the exit code 128 + the signal, as a shell reports it. The signal reaches all
    processes, as `timeout` and batch systems send it."""
    script = tmp_path / "sweeping.py"
    script.write_text(SWEEPING)
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # what runs in the background, or under nohup, ignores it
    ) as process:  # fmt: skip
        for line in process.stdout:
            if line == "piece\n":
                break
        os.killpg(process.pid, number)
        _, err = process.communicate()
    assert (process.returncode, err) == (code, "saltus: interrupted; the values that were finished are written\n")
    assert 0 < len(json.loads((tmp_path / "sweep.json").read_text())["points"]) < 8000


def test_a_signal_that_the_caller_ignores_changes_nothing(tmp_path):
    """Oracle: `nohup`, under which a closed terminal does not end a run."""
    code = "import os, signal; from saltus import __main__ as m\n"
    code += "m._command = lambda words: (os.kill(os.getpid(), signal.SIGHUP), print('done'))[1] or 0\nm.program()"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)},
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


def test_garbage_is_collected_seldom_only_while_processes_work():
    """Oracle: the thresholds that the interpreter reports, here and in the worker."""
    before = gc.get_threshold()
    with open_executor(1) as (executor, _):
        during = gc.get_threshold()
        assert during[0] > before[0]
        assert executor.submit(gc.get_threshold).result() == during
    assert gc.get_threshold() == before
