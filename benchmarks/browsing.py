"""How large a catalogue is, and how quickly it is written and browsed: a synthetic one, of copies of real families.

    python -m benchmarks.browsing [FAMILIES [DIRECTORY]]

prints bytes and microseconds a point, and the time of `saltus list`, `show`, `tree` and `path` as processes of their own beside that of
a Python that only starts.
"""

from __future__ import annotations

import dataclasses
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import saltus
from branches.branch import Branch
from branches.catalogue import Catalogue, Edge
from branches.events import Ended

__all__ = ["copy_of", "fill", "main"]


def copy_of(branch: Branch, k: int) -> Branch:
    """The same points under the id of another family."""
    events = tuple(event for event in branch.events if event.point != 0)
    copy = dataclasses.replace(branch, ended=(Ended(f"COPY{k}", "a copy"), branch.ended[1]), events=events)
    stem = branch.id.rpartition(":")[0]
    copy.__dict__["whole"] = dataclasses.replace(branch.whole, ids=(f"{stem}:{0xC0000000 + k:08x}",))
    return copy


def fill(path: Path, families: int) -> tuple[int, float]:
    """Write a catalogue of copies, with two or three edges a family; the number of points, and seconds."""
    scene = saltus.load_scene()
    real = [saltus.trace(name, energy=(0.05, 100.0)) for name in ("S13O00+", "S11O00-", "S73O33-")]
    real += real[0].switch("SB1", energy=(0.05, 100.0))
    dice = random.Random(1)
    points = 0
    begin = time.perf_counter()
    with Catalogue(path, "a", scene=scene) as catalogue:
        known: list[Branch] = []
        for k in range(families):
            # Most families of a catalogue are short.
            branch = copy_of(dice.choices(real, (6, 1, 3, 45, 45))[0], k)
            points += len(branch)
            with catalogue.transaction():
                id = catalogue.add(branch)
                for other in dice.sample(known, min(len(known), 3)):
                    event = dice.choice(other.events)
                    catalogue.connect(Edge(other.id, event.id, event.type, "switch", id, event.h, event.alpha))
            known.append(branch)
    return points, time.perf_counter() - begin


def main(families: int = 2000, directory: str | None = None, repeats: int = 5) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory(dir=directory) as folder:
        path = Path(folder, "synthetic.sqlite")
        points, seconds = fill(path, families)
        size = path.stat().st_size
        print(f"{families} families, {points} points: {size / 1e6:.1f} MB, {size / points:.0f} bytes a point")
        print(f"written in {seconds:.2f} s, {1e6 * seconds / points:.1f} us a point, one transaction a family")
        with Catalogue(path) as catalogue:
            first, last = (row.id for row in (catalogue.families()[0], catalogue.families()[-1]))
            begin = time.perf_counter()
            for row in catalogue.families():
                catalogue.points(row.id)
            print(f"all points read with their checksums in {time.perf_counter() - begin:.2f} s")
        commands = {
            "python -c pass": [sys.executable, "-c", "pass"],
            "saltus list": ["list"],
            "saltus list --label 'U*' --energy 0.5 --stable": ["list", "--label", "U*", "--energy", "0.5", "--stable"],
            "saltus show ID": ["show", first],
            "saltus show S11O00-@h=50": ["show", "S11O00-@h=50"],
            "saltus tree ID": ["tree", first],
            "saltus path ID ID": ["path", first, last],
        }
        for name, words in commands.items():
            if words[0] != sys.executable:
                words = [sys.executable, "-m", "saltus", *words, "--catalogue", str(path)]
            times = []
            for _ in range(repeats):
                begin, used = time.perf_counter(), sum(os.times()[2:4])
                subprocess.run(words, capture_output=True, check=False)
                times.append((time.perf_counter() - begin, sum(os.times()[2:4]) - used))
            wall, processor = (min(values) for values in zip(*times, strict=True))
            print(f"{wall:8.3f} s, {processor:.2f} s of a processor  {name}")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:2]), *sys.argv[2:3])
