"""Carrying a study out: starts, then block after block on an executor, each kept on disk when it is finished."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from saltus.errors import BadInput

if TYPE_CHECKING:
    from saltus.study_file import StudyFile
    from transitions.study.plan import Plan
    from transitions.study.runs import Starts

__all__ = ["carry_out", "check_folder", "find_all_starts", "keep_starts", "kept_starts"]

AHEAD = 3
"""Blocks that are worked on or wait for a worker, for each worker."""

_STARTS = -1
"""Number of the block that has the starts."""


def check_folder(folder: Path, plan: Plan, kind: str) -> None:
    """Refuse a folder that holds another study, or something else.

    Raises
    ------
    BadInput
    """
    from transitions.study.study import PLAN, NoStudy, read_plan

    if not folder.exists():
        return
    if not folder.is_dir():
        raise BadInput(f"{folder} is a file; expected a folder for the study's blocks, or a place where one can be made")
    if not (folder / PLAN).exists():
        # Blocks without their plan: it was lost, and they tell themselves whose they are.
        foreign = [entry.name for entry in sorted(folder.iterdir()) if not _is_own(entry.name)]
        if foreign:
            raise BadInput(f"{folder} holds no study but {foreign[0]}; expected an empty folder, or one that saltus study has made")
        return
    try:
        other, digest, other_kind = read_plan(folder)
    except NoStudy:
        return  # damaged: it is written again
    if digest != plan.digest:
        raise BadInput(f"{folder} holds another study: {_difference(other, plan)}; expected another --out")
    if other_kind != kind:
        raise BadInput(f"{folder} holds this study as {other_kind}; expected --format {other_kind}, or another --out")


def _is_own(name: str) -> bool:
    return name.startswith(("block-", "starts.", ".saltus-", "study.json"))


def _difference(other: Plan, plan: Plan) -> str:
    """The first thing in which two plans differ."""
    theirs, ours = other.plain(), plan.plain()
    for key in ours:
        if key not in ("title", "forces") and theirs.get(key) != ours[key]:
            return f"its {key} is {theirs.get(key)!r}, and the file says {ours[key]!r}"
    return "its loads are others"


def kept_starts(study: StudyFile, folder: Path, damaged: Callable[[str], None]) -> tuple[Starts | None, bool]:
    """The starts that are kept in the folder, and whether they are still to be found."""
    from transitions.study.blocks import DamagedBlock, read_block
    from transitions.study.plan import IMPULSIVE
    from transitions.study.runs import Starts

    plan = study.plan
    if plan.families == (IMPULSIVE,):
        return None, False
    path = folder / "starts.npz"
    if not path.exists():
        return None, True
    try:
        kept = read_block(path, plan.digest, _STARTS, plan.count)
    except DamagedBlock as error:
        damaged(str(error))
        return None, True
    return Starts(kept["states"], kept["leaving"].astype("<U2")), False


def find_all_starts(study: StudyFile, executor: Executor) -> Starts | None:
    """Follow the families of a study on an executor.

    Raises
    ------
    BadInput
        For a family that is not found, or that has several orbits at an energy.
    """
    from saltus.study_starts import family_seeds, find_starts, starts_of

    seeds = family_seeds(study.plan, study.scene)
    futures = [executor.submit(find_starts, seed) for seed in seeds]
    return starts_of(study.plan, seeds, {k: future.result() for k, future in enumerate(futures)})


def keep_starts(starts: Starts, folder: Path, digest: str) -> None:
    """Keep the starts in a study's folder."""
    from transitions.study.blocks import write_block

    write_block(folder / "starts.npz", {"states": starts.states, "leaving": starts.leaving.astype("S2")}, digest, _STARTS)


class _Block(NamedTuple):
    """What a worker needs for a block."""

    number: int
    given: dict[str, np.ndarray]
    starts: Starts | None


def _work(plan: Plan, block: _Block) -> dict[str, np.ndarray]:
    """Run a block: in any process, from plain data."""
    from transitions.study.runs import run_block

    return run_block(plan, block.given, block.starts)


def carry_out(
    plan: Plan, starts: Starts | None, folder: Path, kind: str, finished: set[int], executor: Executor, workers: int,
    on_progress: Callable[[int], None],
) -> None:  # fmt: skip
    """Run the blocks of a plan that are not finished, and write each.

    What is written does not depend on the executor: a block depends on the plan alone.

    Parameters
    ----------
    on_progress : callable
        Told how many runs are finished.

    Raises
    ------
    branches.files.WriteFailure
        Where a block cannot be written; those before it are kept.
    """
    from branches.building.frontier import Frontier
    from transitions.study.blocks import block_path, write_block
    from transitions.study.runs import Starts

    digest = plan.digest
    blocks = []
    done = 0
    for number in range(plan.blocks):
        first, last = plan.block_range(number)
        if number in finished:
            done += last - first
            continue
        some = None if starts is None else Starts(starts.states[first:last], starts.leaving[first:last])
        blocks.append(_Block(number, plan.values(first, last), some))
    frontier = Frontier(executor, partial(_work, plan), lambda block: False, lambda block: block.number, AHEAD * workers)
    frontier.extend(blocks)
    for block, columns in frontier:
        assert columns is not None
        write_block(block_path(folder, block.number, kind), columns, digest, block.number)
        done += len(columns["h"])
        on_progress(done)
