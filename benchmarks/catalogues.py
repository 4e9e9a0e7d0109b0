"""`python -m benchmarks building` and `browsing`: how long a catalogue takes to build and to read, in what memory, and its size."""

from __future__ import annotations

import argparse
import dataclasses
import json
import random
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import saltus
from benchmarks.measure import run_python
from benchmarks.report import Table, machine, number, progress, show, watched
from branches.branch import Branch
from branches.catalogue import Catalogue, Edge
from branches.events import Ended
from saltus.errors import DONE
from saltus.options import whole_above_zero

__all__ = ["Built", "browse", "browsing_arguments", "build", "building_arguments", "copy_of", "fill_catalogue", "table"]

SMALL = ("--energy", "0.05:5", "--max-quarter-period", "2", "--max-impacts", "4")
"""Options of the small build."""

BUILD = """
import json, resource, sys
from saltus.__main__ import main
code = main(sys.argv[1:])
usage = [resource.getrusage(who).ru_maxrss * 1024 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
print("\\n" + json.dumps(usage))
sys.exit(code)
"""
"""Program that builds and prints the most bytes of the main process and of a worker."""

REPEATS = 5
"""Runs of a command that reads a catalogue; the fastest counts."""


def building_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of `building`."""
    parser.add_argument("--small", action="store_true", help="energies up to 5, quarter period up to 2, 4 impacts: seconds")
    parser.add_argument("--workers", type=whole_above_zero, nargs="+", default=[1, 2], help="numbers of worker processes (default: 1 2)")
    parser.set_defaults(run=_run_building)


def _run_building(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    options = SMALL if arguments.small else ()
    with tempfile.TemporaryDirectory() as folder:
        numbers = watched(arguments.workers, lambda workers: f"a build with {workers} workers")
        show(table([build(workers, options, Path(folder)) for workers in numbers]))
    return DONE


@dataclass(frozen=True)
class Built:
    """A build: its workers, seconds, what it found, most bytes of the main process and of a worker, and bytes of the file."""

    workers: int
    seconds: float
    families: int
    points: int
    complete: bool
    main: int
    worker: int
    size: int

    @property
    def memory(self) -> int:
        """Most bytes of all processes together."""
        return self.main + self.workers * self.worker


def build(workers: int, options: tuple[str, ...], folder: Path) -> Built:
    """Build a catalogue in a process of its own.

    Raises
    ------
    RuntimeError
        If it fails; the message contains the last line that it wrote.
    """
    path, report = folder / f"{workers}.sqlite", folder / f"{workers}.json"
    words = ("build", *options, "--workers", str(workers), "--catalogue", str(path), "--json", str(report))
    done = run_python("-c", BUILD, *words)
    main, worker = json.loads(done.output.strip().rpartition("\n")[2])
    found = json.loads(report.read_text())
    return Built(workers, done.seconds, found["families"], found["points"], found["complete"], main, worker, path.stat().st_size)


def table(builds: list[Built]) -> Table:
    """The builds as rows."""
    columns = ("workers", "seconds", "times faster", "families", "points", "points/s", "complete", "memory MB", "file MB", "bytes a point")
    rows = [
        (
            str(built.workers), number(built.seconds), number(builds[0].seconds / built.seconds), str(built.families), str(built.points),
            number(built.points / built.seconds), "yes" if built.complete else "no", number(built.memory / 1e6),
            number(built.size / 1e6), number(built.size / built.points),
        )
        for built in builds
    ]  # fmt: skip
    return Table("Building a catalogue", columns, rows, ("From the start of the program to its end, with kernels on disk.",))


def browsing_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser of `browsing`."""
    parser.add_argument("families", metavar="FAMILIES", type=whole_above_zero, nargs="?", default=2000, help="copies (default: 2000)")
    parser.add_argument("folder", metavar="FOLDER", nargs="?", help="where the catalogue is written (default: a temporary folder)")
    parser.set_defaults(run=_run_browsing)


def _run_browsing(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    show(browse(arguments.families, arguments.folder, REPEATS))
    return DONE


def copy_of(branch: Branch, k: int) -> Branch:
    """The same points under the id of another family."""
    events = tuple(event for event in branch.events if event.point != 0)
    copy = dataclasses.replace(branch, ended=(Ended(f"COPY{k}", "a copy"), branch.ended[1]), events=events)
    stem = branch.id.rpartition(":")[0]
    copy.__dict__["full_family"] = dataclasses.replace(branch.full_family, ids=(f"{stem}:{0xC0000000 + k:08x}",))
    return copy


def fill_catalogue(path: Path, families: int) -> tuple[int, float]:
    """Write a catalogue of copies, with two or three edges a family; return the number of points and the seconds."""
    scene = saltus.load_scene()
    real = [saltus.trace(name, energy=(0.05, 100.0)) for name in ("S13O00+", "S11O00-", "S73O33-")]
    real += real[0].switch("SB1", energy=(0.05, 100.0))
    dice = random.Random(1)
    points = 0
    began = time.perf_counter()
    with Catalogue(path, "a", scene=scene) as catalogue:
        known: list[Branch] = []
        for k in range(families):
            # Each family once, then mostly short ones, as in a real catalogue.
            branch = copy_of(real[k] if k < len(real) else dice.choices(real, (6, 1, 3, 45, 45))[0], k)
            points += len(branch)
            with catalogue.transaction():
                id = catalogue.add(branch)
                for other in dice.sample(known, min(len(known), 3)):
                    event = dice.choice(other.events)
                    catalogue.connect(Edge(other.id, event.id, event.type, "switch", id, event.h, event.alpha))
            known.append(branch)
    return points, time.perf_counter() - began


def browse(families: int, folder: str | None, repeats: int) -> Table:
    """Write a catalogue and read it with each command, as a process of its own beside a Python that does nothing."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        path = Path(place, "synthetic.sqlite")
        progress(f"a catalogue of {families} families")
        points, written = fill_catalogue(path, families)
        size = path.stat().st_size
        with Catalogue(path) as catalogue:
            ids = [row.id for row in catalogue.families()]
            began = time.perf_counter()
            for id in ids:
                catalogue.points(id)
            read = time.perf_counter() - began
        commands = (
            ("list",), ("list", "--label", "U*", "--energy", "0.5", "--stable"), ("show", ids[0]), ("show", "S11O00-@h=50"),
            ("tree", ids[0]), ("path", ids[0], ids[-1]),
        )  # fmt: skip
        rows = [("python -c pass", *_least_of_process(("-c", "pass"), repeats))]
        for command in watched(commands, " ".join):
            shown = " ".join("ID" if word in ids else word for word in command)
            rows.append((f"saltus {shown}", *_least_of_process(("-m", "saltus", *command, "--catalogue", str(path)), repeats)))
    notes = (
        f"{families} families, {points} points: {size / 1e6:.1f} MB, {size / points:.0f} bytes a point. Written in {written:.2f} s,",
        f"{1e6 * written / points:.1f} us a point, one transaction a family. All points read with their checksums in {read:.2f} s.",
    )
    return Table("Browsing a synthetic catalogue", ("process", "seconds", "of a processor"), rows, notes)


def _least_of_process(arguments: tuple[str, ...], repeats: int) -> tuple[str, str]:
    """Least seconds and processor seconds of a process; `saltus path` may end with code 1, without a chain."""
    runs = [run_python(*arguments, codes=(0, 1)) for _ in range(repeats)]
    return f"{min(run.seconds for run in runs):.3f}", f"{min(run.processor for run in runs):.2f}"
