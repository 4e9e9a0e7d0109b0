"""A study: its TOML file, which is checked completely before anything starts, the starts of its runs, and their execution.

A run that starts on an orbit needs the family of that orbit, in the undamped elastic system of the run. Each family is followed once. The
runs are executed block after block on an executor. Each finished block is saved on disk.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from saltus.errors import BadInput, nearest, one_line
from saltus.scene.reading import FINITE, NUMBERS, POSITIVE, TEXT, TEXTS, Kind, TomlTable, one_of, read_toml

if TYPE_CHECKING:
    from saltus.scene import Scene
    from transitions.study.plan import Axis, StudyPlan
    from transitions.study.runs import Starts

__all__ = [
    "StudyFile", "carry_out", "check_folder", "family_seeds", "find_all_starts", "find_starts", "keep_starts", "kept_starts",
    "read_study_file",
]  # fmt: skip

MOST_RUNS = 100_000_000
MOST_BLOCK = 1_000_000

_OF_MODEL = ("mu", "sigma", "lam", "rho")

AHEAD = 3
"""Blocks that are worked on or wait for a worker, for each worker."""

_STARTS = -1
"""Number of the block that has the starts."""

_OF_ORBITS = ("mu", "sigma")
"""Parameters that orbits of the undamped elastic system depend on."""


def _integer(least: int, most: int | None = None) -> Kind:
    """An integer within bounds."""
    expected = f"an integer, {least} or more" if most is None else f"an integer from {least} to {most}"
    return Kind(expected, lambda value: type(value) is int and least <= value <= (most or value))


_FROM_0 = Kind("", lambda value: FINITE.fits(value) and value >= 0.0, float)
_KINDS = {
    "mu": POSITIVE._replace(expected="mu above 0"),
    "sigma": _FROM_0._replace(expected="sigma 0 or more"),
    "rho": Kind("rho 0 to 1", lambda value: FINITE.fits(value) and 0.0 <= value <= 1.0, float),
    "lam": _FROM_0._replace(expected="lam 0 or more"),
    "clearance": POSITIVE._replace(expected="clearance above 0"),
    "energy": POSITIVE._replace(expected="energy above 0"),
    "impulse": Kind("a velocity, not 0", lambda value: FINITE.fits(value) and value != 0.0, float),
    "family": TEXT,
}
"""What the value of each parameter has to be."""


@dataclass(frozen=True)
class StudyFile:
    """What a study's file contains: its scene, with the fixed parameters of the model, and its plan."""

    scene: Scene
    plan: StudyPlan


def read_study_file(path: str | os.PathLike[str], parameters: Mapping[str, float] | None = None) -> StudyFile:
    """Read a study's file. Unknown and missing keys and values out of range are refused in one line. `parameters` replace those of the
    scene."""
    from saltus.scene import LOADS, load_scene
    from transitions.study.plan import FAMILY, StudyPlan

    file, folder = read_toml(Path(path), f"study {path}"), Path(path).parent
    file.only("title", "scene", "design", "runs", "seed", "units", "block", "vary", "fixed", "run")
    design = file.get("design", one_of("grid", "hypercube"))
    axes = _axes(file.table("vary"), design)
    varied = [axis.name for axis in axes]
    given = file.table("fixed", {})
    given.only(*_KINDS)
    fixed = {name: given.get(name, _KINDS[name]) for name in given.content}
    for name in varied:
        if name in fixed:
            raise BadInput(f"{file.where}: {name} is both varied and fixed; expected one of them")
    place: str | None = file.get("scene", TEXT, "") or None
    # A scene's file is in the folder of the study's file.
    if place is not None and (folder / place).exists():
        place = str(folder / place)
    replaced = {name: fixed.pop(name) for name in _OF_MODEL if name in fixed}
    for name in parameters or ():
        if name in (*varied, *replaced):
            raise BadInput(f"{file.where}: {name} is {'varied' if name in varied else 'fixed'} in the file; expected --set for another one")
    scene = load_scene(place, **replaced, **(parameters or {}))
    scene.require_used("saltus study", (*LOADS, "springs"))
    of_model = [name for name in varied if name in _OF_MODEL]
    if of_model and "model" not in scene.system.describe():
        raise BadInput(f"{file.where}: {of_model[0]} is a parameter of a model, and the scene gives matrices instead of a model")
    if not scene.lo and not scene.forces:
        raise BadInput(f"{file.where}: the scene does not say which coordinate is the oscillator's; expected LO under its [coordinates]")
    starts = [name for name in ("energy", "impulse") if name in (*varied, *fixed)]
    if len(starts) == 2:
        raise BadInput(f"{file.where}: energy and impulse each say how a run starts; expected one of them")
    if not starts and not scene.forces:
        raise BadInput(f"{file.where}: how does a run start? expected energy or impulse under [vary] or [fixed]")
    if FAMILY in (*varied, *fixed) and starts != ["energy"]:
        raise BadInput(f"{file.where}: a family's orbit is chosen by its energy; expected energy under [vary] or [fixed]")
    plan = StudyPlan(
        system=scene.system.describe(),
        nes=scene.nes,
        lo=scene.lo,
        axes=axes,
        fixed=fixed,
        design=design,
        units=file.get("units", one_of("natural", "physical"), "natural"),
        title=file.get("title", TEXT, ""),
        forces=scene.forces,
        **_numbers(file, design),
        **_run(file.table("run", {}), _why_no_end(scene)),
    )
    if plan.count > MOST_RUNS:
        raise BadInput(f"{file.where}: the grid has {plan.count} runs, expected {MOST_RUNS} at most")
    for family in plan.families:
        _check_family(file, family)
    return StudyFile(scene, plan)


def _numbers(file: TomlTable, design: str) -> dict[str, int]:
    kinds = {"block": _integer(1, MOST_BLOCK)}
    if design == "hypercube":
        kinds |= {"runs": _integer(2, MOST_RUNS), "seed": _integer(0, 2**32 - 1)}
    elif wrong := [key for key in ("runs", "seed") if key in file.content]:
        raise BadInput(f"{file.where}: {wrong[0]} goes with design = 'hypercube'; a grid has the points of its parameters")
    return {key: file.get(key, kind) for key, kind in kinds.items() if key in file.content or key == "runs"}


def _why_no_end(scene: Scene) -> str:
    """Why there is no proof that impacts are no longer possible; empty if there can be one."""
    if scene.forces:
        return "the scene has loads, under which impacts stay possible"
    reason = scene.system.why_not_linear()
    return "" if reason is None else f"{reason}, and only linear flights have a proof that no impact is possible"


def _run(run: TomlTable, why_no_end: str) -> dict[str, Any]:
    from transitions.study.plan import CLEAR

    run.only("until", "longest", "impacts")
    out: dict[str, Any] = {}
    until = run.content.get("until", CLEAR)
    if until != CLEAR:
        hint = nearest(until, (CLEAR,)) if isinstance(until, str) else ""
        out["until"] = run.get("until", POSITIVE._replace(expected=f'a duration above 0, or "{CLEAR}": until no impact is possible{hint}'))
    elif why_no_end:
        raise run.wrong("until", until, f"a duration: {why_no_end}")
    if "longest" in run.content:
        if until != CLEAR:
            raise BadInput(f'{run.where}: longest goes with until = "{CLEAR}"; a duration is the longest time itself')
        out["longest"] = run.get("longest", POSITIVE)
    if "impacts" in run.content:
        out["impacts"] = run.get("impacts", _integer(1))
    return out


def _axes(vary: TomlTable, design: str) -> tuple[Axis, ...]:
    from transitions.study.plan import FAMILY, SCALES, Axis

    vary.only(*_KINDS)
    if not vary.content:
        raise BadInput(f"{vary.where}: nothing is varied; expected one or more of {', '.join(_KINDS)}")
    axes = []
    for name in vary.content:
        kind, axis = _KINDS[name], vary.table(name)
        axis.only("values", "from", "to", "scale", "points")
        if name == FAMILY or "values" in axis.content:
            axis.only("values")
            values = axis.get("values", TEXTS) if name == FAMILY else axis.get("values", NUMBERS)
            for value in values:
                if not kind.fits(value):
                    raise axis.wrong("values", value, kind.expected)
            if not values or len(set(values)) < len(values):
                raise axis.wrong("values", list(values), "one value or more, each of them once")
            axes.append(Axis(name, values))
            continue
        low, high = (axis.get(key, kind) for key in ("from", "to"))
        if not low < high:
            raise axis.wrong("to", high, f"a number above from = {low:g}")
        scale = axis.get("scale", one_of(*SCALES), "linear")
        if scale == "log" and not low > 0.0:
            raise axis.wrong("from", low, "a number above 0 on a logarithmic scale")
        if design != "grid" and "points" in axis.content:
            raise BadInput(f"{axis.where}: points goes with design = 'grid'; a hypercube has runs")
        axes.append(Axis(name, (), low, high, scale, axis.get("points", _integer(2)) if design == "grid" else 0))
    return tuple(axes)


def _check_family(file: TomlTable, name: str) -> None:
    from branches.naming.labels import parse_name
    from transitions.study.plan import IMPULSIVE

    if name == IMPULSIVE:
        return
    try:
        parsed = parse_name(name)
    except ValueError as error:
        raise BadInput(f"{file.where}: {one_line(error)}{nearest(name, [IMPULSIVE])}") from error
    if parsed.h is not None:
        raise BadInput(f"{file.where}: family {name!r} names an energy, which is a parameter of its own; expected a name, or name@alpha=A")


def check_folder(folder: Path, plan: StudyPlan, kind: str) -> None:
    """Raise `BadInput` for a folder that holds another study, or something else."""
    from transitions.study.study import PLAN, NoStudy, read_plan

    if not folder.exists():
        return
    if not folder.is_dir():
        raise BadInput(f"{folder} is a file; expected a folder for the study's blocks, or a place where one can be made")
    if not (folder / PLAN).exists():
        # The plan was lost. Each block holds the digest of its plan.
        own = ("block-", "starts.", ".saltus-", "study.json")
        foreign = sorted(entry.name for entry in folder.iterdir() if not entry.name.startswith(own))
        if foreign:
            raise BadInput(f"{folder} is not a study and contains {foreign[0]}; expected an empty folder or a study")
        return
    try:
        other, digest, other_kind = read_plan(folder)
    except NoStudy:
        return  # damaged: it is written again
    if digest != plan.digest:
        theirs, ours = other.plain(), plan.plain()
        which = next((key for key in ours if key not in ("title", "forces") and theirs.get(key) != ours[key]), None)
        what = "its loads are others" if which is None else f"its {which} is {theirs.get(which)!r}, and the file says {ours[which]!r}"
        raise BadInput(f"{folder} holds another study: {what}; expected another --out")
    if other_kind != kind:
        raise BadInput(f"{folder} holds this study as {other_kind}; expected --format {other_kind}, or another --out")


def kept_starts(study: StudyFile, folder: Path, damaged: Callable[[str], None]) -> tuple[Starts | None, bool]:
    """The starts that are kept in the folder, and whether they are still to be found."""
    from transitions.study.plan import IMPULSIVE
    from transitions.study.runs import Starts
    from transitions.study.study import DamagedBlock, read_block

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


class FamilySeed(NamedTuple):
    """A family to follow and the energies of the required orbits, as plain data."""

    system: str  # description of the undamped elastic system, as JSON
    name: str
    energies: tuple[float, ...]
    runs: tuple[int, ...]  # the run of each
    bounds: dict[str, Any]  # of the scene's search for names
    reference_points: dict[str, dict[str, float]]  # the scene's reference points, where they hold for the system


class FamilyStarts(NamedTuple):
    """The orbits of a family at the energies of a seed: states (k, 2n), NaN for none, and the contacts just left; or why there are none."""

    states: np.ndarray
    leaving: tuple[str, ...]
    error: str = ""


def family_seeds(plan: StudyPlan, scene: Scene) -> list[FamilySeed]:
    """The families of a plan of a scene, with the energies of their runs."""
    from bvp.system import ImpactSystem
    from transitions.study.plan import IMPULSIVE

    names = plan.families
    if names == (IMPULSIVE,):
        return []
    given = plan.values(0, plan.count)
    index = given.get("family", np.zeros(plan.count))
    energies = np.broadcast_to(given.get("energy", plan.fixed.get("energy", np.nan)), plan.count)
    if plan.units == "physical":
        energies = energies / given.get("clearance", plan.fixed.get("clearance", 1.0)) ** 2
    varied = [name for name in _OF_ORBITS if name in given]
    distinct, which = np.unique(np.stack([index, *(given[name] for name in varied)], axis=1), axis=0, return_inverse=True)
    seeds = []
    for k, row in enumerate(distinct):
        name, runs = names[int(row[0])], np.flatnonzero(which.ravel() == k)
        if name == IMPULSIVE:
            continue
        described = {**plan.system, **dict(zip(varied, map(float, row[1:]), strict=True))}
        system = ImpactSystem.from_description(described).underlying
        wanted, reference_points = tuple(energies[runs].tolist()), scene.underlying.reference_points_for(system)
        seeds.append(FamilySeed(json.dumps(system.describe()), name, wanted, tuple(runs.tolist()), scene.bounds, reference_points))
    return seeds


def find_starts(seed: FamilySeed) -> FamilyStarts:
    """Follow the family of a seed, and take its orbits at the energies. Of several orbits, the one with the quarter period nearest to that
    of the name is taken."""
    from branches.naming.labels import parse_name
    from bvp.system import ImpactSystem
    from saltus.families import list_orbits, orbits_of, start_of, trace
    from saltus.scene import Scene

    system = ImpactSystem.from_description(json.loads(seed.system))
    states, leaving = np.full((len(seed.energies), 2 * system.degrees_of_freedom), np.nan), [""] * len(seed.energies)
    name = parse_name(seed.name)
    alpha = name.alpha
    lowest, highest = seed.bounds["energy"]
    low, high = min(lowest, 0.9 * min(seed.energies)), max(highest, 1.1 * max(seed.energies))
    scene = Scene(system=system, reference_points=seed.reference_points, **seed.bounds)
    try:
        branch = trace(seed.name, scene=scene, energy=(low, high))
    except (ValueError, RuntimeError) as failure:
        return FamilyStarts(states, tuple(leaving), one_line(failure))
    energies = np.array(seed.energies)
    for energy in dict.fromkeys(seed.energies):
        found = orbits_of(branch, name, energy)
        if len(found) > 1 and alpha is None:
            error = f"{len(found)} orbits of {seed.name} have h = {energy:.10g}, expected one of {list_orbits(found, branch)}"
            return FamilyStarts(states, tuple(leaving), error)
        if found:
            u, v, contact = start_of(min(found, key=lambda orbit: abs(orbit.alpha - (alpha or orbit.alpha))))
            for k in np.flatnonzero(energies == energy).tolist():
                states[k], leaving[k] = np.concatenate([u, v]), contact or ""
    return FamilyStarts(states, tuple(leaving))


def find_all_starts(study: StudyFile, executor: Executor) -> Starts | None:
    """Follow the families of a study on an executor. The result is one start for each run, None if all runs start with an impulse.
    `BadInput` for a family that is not found, or that has several orbits at an energy."""
    from bvp.system import ImpactSystem
    from transitions.study.runs import Starts

    plan = study.plan
    seeds = family_seeds(plan, study.scene)
    if not seeds:
        return None
    futures = [executor.submit(find_starts, seed) for seed in seeds]
    n = ImpactSystem.from_description(plan.system).degrees_of_freedom
    states, leaving = np.full((plan.count, 2 * n), np.nan), np.full(plan.count, "", dtype="<U2")
    for seed, found in zip(seeds, [future.result() for future in futures], strict=True):
        if found.error:
            described: dict[str, Any] = json.loads(seed.system)
            where = ", ".join(f"{name} = {described[name]:.6g}" for name in _OF_ORBITS if name in plan.names)
            raise BadInput(f"family {seed.name!r}{f' at {where}' if where else ''}: {found.error}")
        runs = np.array(seed.runs)
        states[runs], leaving[runs] = found.states, found.leaving
    return Starts(states, leaving)


def keep_starts(starts: Starts, folder: Path, digest: str) -> None:
    """Keep the starts in a study's folder."""
    from transitions.study.study import write_block

    write_block(folder / "starts.npz", {"states": starts.states, "leaving": starts.leaving.astype("S2")}, digest, _STARTS)


class _Block(NamedTuple):
    """The data that a worker needs for a block."""

    number: int
    given: dict[str, np.ndarray]
    starts: Starts | None


def _work(plan: StudyPlan, block: _Block) -> dict[str, np.ndarray]:
    """Run a block: in any process, from plain data."""
    from transitions.study.runs import run_block

    return run_block(plan, block.given, block.starts)


def carry_out(
    plan: StudyPlan, starts: Starts | None, folder: Path, kind: str, finished: set[int], executor: Executor, workers: int,
    on_progress: Callable[[int], None],
) -> None:  # fmt: skip
    """Run the blocks of a plan that are not finished, and write each. The files do not depend on the executor: a block depends on the plan
    alone. `on_progress` is called with the number of finished runs."""
    from branches.building.frontier import Frontier
    from transitions.study.runs import Starts
    from transitions.study.study import block_path, write_block

    digest = plan.digest
    left = [number for number in range(plan.blocks) if number not in finished]
    done = plan.count - sum(last - first for first, last in map(plan.block_range, left))

    def blocks() -> Iterator[_Block]:
        for number in left:
            first, last = plan.block_range(number)
            some = None if starts is None else Starts(starts.states[first:last], starts.leaving[first:last])
            yield _Block(number, plan.values(first, last), some)

    waiting = blocks()
    frontier: Frontier[_Block, dict[str, np.ndarray]] = Frontier(executor, partial(_work, plan), lambda block: False, AHEAD * workers)
    frontier.extend(islice(waiting, AHEAD * workers))
    for block, columns in frontier:
        assert columns is not None
        frontier.extend(islice(waiting, 1))
        write_block(block_path(folder, block.number, kind), columns, digest, block.number)
        done += len(columns["h"])
        on_progress(done)
