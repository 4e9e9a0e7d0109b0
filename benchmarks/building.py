"""How long a catalogue takes to build, with one worker and with two, in what memory, and how large it is.

    python -m benchmarks.building [--small]

builds the reference scene as it ships (minutes), or with `--small` up to quarter period 2 and 4 impacts at energies up to 5. Memory is the
largest of any one process, and the sum of the largest of the main process and of its workers.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from saltus.bench.machine import describe
from saltus.bench.tables import Table, number

__all__ = ["Built", "build", "main"]

SMALL = ("--energy", "0.05:5", "--max-quarter-period", "2", "--max-impacts", "4")

RUN = """
import json, resource, sys
from saltus.__main__ import main
code = main(sys.argv[1:])
usage = [resource.getrusage(who).ru_maxrss * 1024 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print("\\n" + json.dumps({"code": code, "memory": usage}))
"""


@dataclass(frozen=True)
class Built:
    """A build: its workers, seconds, what it found, bytes of the largest main and worker process, and of the file."""

    workers: int
    seconds: float
    families: int
    points: int
    settled: bool
    main: int
    worker: int
    size: int

    @property
    def memory(self) -> int:
        """Bytes of all processes together, at most."""
        return self.main + self.workers * self.worker


def build(workers: int, options: tuple[str, ...], folder: Path) -> Built:
    """Build a catalogue in a process of its own.

    Raises
    ------
    RuntimeError
        When it fails; the message holds the last line it wrote.
    """
    path, report = folder / f"{workers}.sqlite", folder / f"{workers}.json"
    words = ["build", *options, "--workers", str(workers), "--catalogue", str(path), "--json", str(report)]
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", RUN, *words], capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begin
    if done.returncode or not report.exists():
        raise RuntimeError((done.stderr or done.stdout).strip().rpartition("\n")[2])
    memory = json.loads(done.stdout.strip().rpartition("\n")[2])["memory"]
    found = json.loads(report.read_text())
    return Built(workers, seconds, found["families"], found["points"], found["settled"], memory[0], memory[1], path.stat().st_size)


def table(runs: list[Built]) -> Table:
    """The runs as rows."""
    columns = ("workers", "seconds", "times faster", "families", "points", "points/s", "settled", "memory MB", "file MB", "bytes a point")
    rows = [
        (
            str(run.workers), number(run.seconds), number(runs[0].seconds / run.seconds), str(run.families), str(run.points),
            number(run.points / run.seconds), "yes" if run.settled else "no", number(run.memory / 1e6), number(run.size / 1e6),
            number(run.size / run.points),
        )
        for run in runs
    ]  # fmt: skip
    return Table("Building a catalogue", columns, rows, ("From the start of the program to its end, kernels compiled before.",))


def main(words: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.building", description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="a small scene, in seconds")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    arguments = parser.parse_args(words)
    options = SMALL if arguments.small else ()
    print("\n".join(describe()))
    with tempfile.TemporaryDirectory() as folder:
        print(table([build(workers, options, Path(folder)) for workers in arguments.workers]).text())


if __name__ == "__main__":
    main()
