"""Compile the kernels of a command before it starts: in several processes, with a progress bar.

`kernels.json` lists the kernels that each command calls, with the types of their arguments. `python -m benchmarks kernels` writes it.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import queue
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from saltus.terminal import ProgressBar, counted

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["LIST", "announce", "compile_kernels", "missing", "prepare", "prepare_for", "prepare_with", "unkept"]

LIST = Path(__file__).with_name("kernels.json")

_COMMAND = [sys.executable, "-m", "bvp.kernels"]


@cache
def _listed() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(LIST.read_text(encoding="utf-8"))
    return found


def missing(*groups: str) -> list[list[Any]]:
    """The kernels of some commands, of all where none is named, that have no machine code: seconds, module, name and types of each."""
    from bvp.kernels.stored import symbol, types_from, whole

    listed = _listed()
    indices = sorted({index for group in groups or listed["commands"] for index in listed["commands"].get(group, ())})
    calls = [listed["kernels"][index] for index in indices]

    def is_there(_: float, module: str, name: str, types: Any) -> bool:
        return any(whole(module, symbol(module, name, types_from(types))))

    return [call for call in calls if not is_there(*call)]


def unkept(calls: list[list[Any]]) -> str:
    """Why some of these kernels, compiled now, are not there at the next run; empty where all are."""
    from bvp.kernels import stored

    return next(filter(None, (stored.unkept(module) for _, module, *_ in calls)), "")


def prepare(*groups: str) -> None:
    """Compile what is missing of the kernels of some commands, and say so. Where no process can be started, or nothing can be kept, each
    kernel is compiled when it is called."""
    calls = [call for call in missing(*groups) if _key(call) not in _tried]
    if calls:
        announce(calls)
        kept = [call for call in calls if not unkept([call])]
        if kept:
            compile_kernels(kept)
        _tried.update(map(_key, calls))


def prepare_for(system: ImpactSystem, *groups: str) -> None:
    """`prepare` the kernels of some commands for a system: one with smooth forces has groups of its own."""
    prepare(*(groups if system.smooth_forces is None else (f"smooth {group}" for group in groups)))


_tried: set[str] = set()
"""Kernels that this process had compiled, or could not, with the types of their arguments."""


def _key(call: list[Any]) -> str:
    """What tells a kernel of the list from all others."""
    return json.dumps(call[1:])


def prepare_with(module: str, name: str, types: Any) -> None:
    """Compile a kernel with all others of a group of commands: the group that lacks least. One that is on no list is only announced. In a
    worker process nothing is done."""
    from bvp.kernels.stored import types_from

    listed = _listed()
    places = [k for k, call in enumerate(listed["kernels"]) if call[1:3] == [module, name] and types_from(call[3]) == types]
    groups = [group for group, members in listed["commands"].items() if set(places) & set(members)]
    tried = any(_key(listed["kernels"][k]) in _tried for k in places)
    if tried or multiprocessing.parent_process() is not None:
        return
    if groups:
        prepare(min(groups, key=lambda group: sum(call[0] for call in missing(group))))
    else:  # it is compiled alone, in this process
        announce([[0.0, module, name, types]])


def announce(calls: list[list[Any]]) -> None:
    """Say on standard error how many kernels are compiled, and why they are not kept where that is so."""
    reason = unkept(calls)
    runs = "at each run" if reason else "at the first run only"
    if sys.stderr is not None:
        text = f"saltus: compiling {counted(len(calls), 'kernel')}, {runs}"
        print(f"{text}; they are not kept: {reason}" if reason else text, file=sys.stderr, flush=True)


_MEMORY = {"MALLOC_TRIM_THRESHOLD_": str(1 << 29), "MALLOC_MMAP_THRESHOLD_": str(1 << 29), "MALLOC_TOP_PAD_": str(1 << 26)}
"""Lets a process that compiles keep its memory. To give it back to the system and ask for it again takes a tenth of the time (glibc)."""


def workers_for(calls: list[list[Any]]) -> int:
    """How many processes compile beside each other."""
    return min(os.cpu_count() or 1, len(calls))


def compile_kernels(calls: list[list[Any]], workers: int | None = None) -> list[list[Any]]:
    """Compile kernels in several processes. Returns those that were compiled, with the seconds that each took: not all where a process
    fails. An interrupt says how many are kept."""
    waiting: queue.SimpleQueue[list[Any]] = queue.SimpleQueue()
    for call in sorted(calls, key=lambda call: -call[0]):
        waiting.put(call)
    done: list[list[Any]] = []
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    processes: list[subprocess.Popen[str]] = []
    with ProgressBar(len(calls), "kernels") as bar:

        def feed(process: subprocess.Popen[str]) -> None:
            assert process.stdin is not None and process.stdout is not None
            while True:
                try:
                    call = waiting.get_nowait()
                    process.stdin.write(json.dumps(call[1:]) + "\n")
                    process.stdin.flush()
                except (queue.Empty, OSError):
                    break
                seconds = process.stdout.readline()
                if not seconds:
                    break
                done.append([float(seconds), *call[1:]])
                bar.update(len(done))

        try:
            for _ in range(workers or workers_for(calls)):
                processes.append(
                    subprocess.Popen(
                        _COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                        env={**os.environ, **_MEMORY, "PYTHONPATH": paths},
                    )
                )  # fmt: skip
            threads = [threading.Thread(target=feed, args=(process,), daemon=True) for process in processes]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        except OSError:
            pass
        except KeyboardInterrupt:
            text = f"{len(done)} of {counted(len(calls), 'kernel')} are compiled and kept; the same command goes on with the rest"
            raise KeyboardInterrupt(text) from None
        finally:
            for process in processes:
                process.kill()
                process.wait()
    return done


def ship(place: Path) -> int:
    """Compile all kernels for the common processors of this kind of machine into a folder, for a wheel. Returns an exit code."""
    from bvp.kernels import stored

    level = stored.level()
    if level is None:
        print(f"no kernels are shipped for {sys.platform}, {platform.machine()}: they are compiled when they are first called")
        return 0
    os.environ |= {"NUMBA_CPU_NAME": level.name, "NUMBA_CPU_FEATURES": ""}
    calls = missing()
    done = compile_kernels(calls)
    for _, module, name, types in calls:
        symbol = stored.symbol(module, name, stored.types_from(types))
        target = place / stored.shipped_name(module, level) / symbol
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(next(stored.whole(module, symbol)))
    print(f"{len(done)} kernels for {level.name} in {place}")
    return 0


if __name__ == "__main__":
    sys.exit(ship(Path(sys.argv[1])))
