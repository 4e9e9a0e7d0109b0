"""A study's TOML file. It is checked completely before anything starts."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from saltus.errors import BadInput, nearest, one_line
from saltus.scene.reading import INTEGER, NUMBER, POSITIVE, TEXT, TEXTS, TomlTable, parse_toml, read_toml

if TYPE_CHECKING:
    from saltus.scene import Scene
    from transitions.study.plan import Axis, StudyPlan

__all__ = ["StudyFile", "read_study_file"]

MOST_RUNS = 100_000_000
MOST_BLOCK = 1_000_000

_OF_MODEL = ("mu", "sigma", "lam", "rho")
_RANGES = {
    "mu": (0.0, False, "above 0"),
    "sigma": (0.0, True, "0 or more"),
    "lam": (0.0, True, "0 or more"),
    "rho": (0.0, True, "0 to 1"),
    "clearance": (0.0, False, "above 0"),
    "energy": (0.0, False, "above 0"),
}


@dataclass(frozen=True)
class StudyFile:
    """What a study's file contains: its scene, with the fixed parameters of the model, and its plan."""

    scene: Scene
    plan: StudyPlan


def read_study_file(path: str | os.PathLike[str]) -> StudyFile:
    """Read a study's file. Unknown and missing keys and values out of range are refused in one line."""
    return _read(parse_toml(read_toml(Path(path), "study"), f"study {path}"), Path(path).parent)


def _read(file: TomlTable, folder: Path) -> StudyFile:
    from saltus.scene import load_scene
    from transitions.study.plan import FAMILY, StudyPlan

    file.only("title", "scene", "design", "runs", "seed", "units", "block", "vary", "fixed", "run")
    design = file.choice("design", ("grid", "hypercube"))
    units = file.choice("units", ("natural", "physical"), "natural")
    axes = _axes(file.table("vary"), design)
    fixed = _fixed(file.table("fixed", {}))
    for axis in axes:
        if axis.name in fixed:
            raise BadInput(f"{file.where}: {axis.name} is both varied and fixed; expected one of them")
    scene = _scene(file, folder, load_scene, {name: fixed[name] for name in _OF_MODEL if name in fixed})
    of_model = [name for name in (axis.name for axis in axes) if name in _OF_MODEL]
    if of_model and "model" not in scene.system.describe():
        raise BadInput(f"{file.where}: {of_model[0]} is a parameter of a model, and the scene gives matrices instead of a model")
    start = {axis.name for axis in axes} | set(fixed)
    if not scene.lo and not scene.forces:
        raise BadInput(f"{file.where}: the scene does not say which coordinate is the oscillator's; expected LO under its [coordinates]")
    given = [name for name in ("energy", "impulse") if name in start]
    if len(given) == 2:
        raise BadInput(f"{file.where}: energy and impulse each say how a run starts; expected one of them")
    if not given and not scene.forces:
        raise BadInput(f"{file.where}: how does a run start? expected energy or impulse under [vary] or [fixed]")
    if FAMILY in start and given != ["energy"]:
        raise BadInput(f"{file.where}: a family's orbit is chosen by its energy; expected energy under [vary] or [fixed]")
    plan = StudyPlan(
        system=scene.system.describe(),
        nes=scene.nes,
        lo=scene.lo,
        axes=axes,
        fixed={key: value for key, value in fixed.items() if key not in _OF_MODEL},
        design=design,
        units=units,
        title=file.get("title", TEXT, ""),
        forces=scene.forces,
        **_numbers(file, design),
        **_run(file.table("run", {}), bool(scene.forces)),
    )
    if plan.count > MOST_RUNS:
        raise BadInput(f"{file.where}: the grid has {plan.count} runs, expected {MOST_RUNS} at most")
    for name in plan.families:
        _check_family(file, name)
    return StudyFile(scene, plan)


def _scene(file: TomlTable, folder: Path, load_scene: Any, parameters: Mapping[str, float]) -> Scene:
    name = file.get("scene", TEXT, "") or None
    # A scene's file is in the folder of the study's file.
    if name is not None and (folder / name).exists():
        name = str(folder / name)
    return load_scene(name, **parameters)


def _numbers(file: TomlTable, design: str) -> dict[str, int]:
    out = {}
    limits = (("runs", 2, MOST_RUNS, "hypercube"), ("seed", 0, 2**32 - 1, "hypercube"), ("block", 1, MOST_BLOCK, None))
    for key, least, most, only in limits:
        if key not in file.content:
            if key == "runs" and design == "hypercube":
                raise BadInput(f"{file.where}: runs is missing; a hypercube has as many runs as it says")
            continue
        if only is not None and design != only:
            raise BadInput(f"{file.where}: {key} goes with design = {only!r}; a grid has the points of its parameters")
        value = file.get(key, INTEGER)
        if not least <= value <= most:
            raise file.wrong(key, value, f"an integer from {least} to {most}")
        out[key] = value
    return out


def _run(run: TomlTable, forced: bool) -> dict[str, Any]:
    from transitions.study.plan import CLEAR

    run.only("until", "longest", "impacts")
    out: dict[str, Any] = {}
    until = run.content.get("until", CLEAR)
    if until != CLEAR:
        expected = f'a duration above 0, or "{CLEAR}": until no impact is possible any more'
        if isinstance(until, str):
            raise run.wrong("until", until, expected + nearest(until, (CLEAR,)))
        out["until"] = run.get("until", POSITIVE._replace(expected=expected))
    elif forced:
        raise run.wrong("until", until, "a duration: the scene has loads, under which impacts stay possible")
    if "longest" in run.content:
        if until != CLEAR:
            raise BadInput(f'{run.where}: longest goes with until = "{CLEAR}"; a duration is the longest time itself')
        out["longest"] = run.get("longest", POSITIVE._replace(expected="a time above 0"))
    if "impacts" in run.content:
        out["impacts"] = run.get("impacts", INTEGER)
        if out["impacts"] < 1:
            raise run.wrong("impacts", out["impacts"], "an integer above 0")
    return out


def _axes(vary: TomlTable, design: str) -> tuple[Axis, ...]:
    from transitions.study.plan import FAMILY, PARAMETERS, SCALES, Axis

    vary.only(*PARAMETERS)
    if not vary.content:
        raise BadInput(f"{vary.where}: nothing is varied; expected one or more of {', '.join(PARAMETERS)}")
    axes = []
    for name in vary.content:
        axis = vary.table(name)
        axis.only("values", "from", "to", "scale", "points")
        if name == FAMILY:
            axis.only("values")
            axes.append(Axis(name, _distinct(axis, axis.get("values", TEXTS))))
            continue
        if "values" in axis.content:
            axis.only("values")
            axes.append(Axis(name, _distinct(axis, tuple(_in_range(axis, name, "values", x) for x in axis.numbers("values")))))
            continue
        low, high = (_in_range(axis, name, key, axis.get(key, NUMBER)) for key in ("from", "to"))
        if not low < high:
            raise axis.wrong("to", high, f"a number above from = {low:g}")
        scale = axis.choice("scale", SCALES, "linear")
        if scale == "log" and not low > 0.0:
            raise axis.wrong("from", low, "a number above 0 on a logarithmic scale")
        points = 0
        if design == "grid":
            points = axis.get("points", INTEGER)
            if points < 2:
                raise axis.wrong("points", points, "an integer, 2 or more")
        elif "points" in axis.content:
            raise BadInput(f"{axis.where}: points goes with design = 'grid'; a hypercube has runs")
        axes.append(Axis(name, (), low, high, scale, points))
    return tuple(axes)


def _distinct(axis: TomlTable, values: tuple[Any, ...]) -> tuple[Any, ...]:
    if not values:
        raise axis.wrong("values", [], "one value or more")
    for k, value in enumerate(values):
        if value in values[:k]:
            raise axis.wrong("values", list(values), f"each value once; {value!r} is there twice")
    return values


def _fixed(fixed: TomlTable) -> dict[str, Any]:
    from transitions.study.plan import FAMILY, PARAMETERS

    fixed.only(*PARAMETERS)
    return {
        name: fixed.get(name, TEXT) if name == FAMILY else _in_range(fixed, name, name, fixed.get(name, NUMBER)) for name in fixed.content
    }


def _in_range(table: TomlTable, name: str, key: str, value: float) -> float:
    """A value that its parameter can have."""
    if name == "impulse":
        if not (math.isfinite(value) and value != 0.0):
            raise table.wrong(key, value, "a velocity, not 0")
        return value
    least, included, expected = _RANGES[name]
    inside = (least <= value if included else least < value) and value < math.inf and not (name == "rho" and value > 1.0)
    if not inside:
        raise table.wrong(key, value, f"{name} {expected}")
    return value


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
