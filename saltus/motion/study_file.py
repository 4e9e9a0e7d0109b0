"""A study's TOML file. It is checked completely before anything starts."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from saltus.errors import BadInput, nearest, one_line
from saltus.scene.reading import NUMBER, POSITIVE, TEXT, TEXTS, Kind, TomlTable, parse_toml, read_toml

if TYPE_CHECKING:
    from saltus.scene import Scene
    from transitions.study.plan import Axis, StudyPlan

__all__ = ["StudyFile", "read_study_file"]

MOST_RUNS = 100_000_000
MOST_BLOCK = 1_000_000

_OF_MODEL = ("mu", "sigma", "lam", "rho")


def _integer(least: int, most: int | None = None) -> Kind:
    """An integer within bounds."""
    expected = f"an integer, {least} or more" if most is None else f"an integer from {least} to {most}"
    return Kind(expected, lambda value: type(value) is int and least <= value <= (most or value))


_ABOVE_0 = POSITIVE.fits
_FROM_0 = Kind("", lambda value: NUMBER.fits(value) and 0.0 <= value < math.inf).fits
_KINDS = {
    "mu": Kind("mu above 0", _ABOVE_0, float),
    "sigma": Kind("sigma 0 or more", _FROM_0, float),
    "lam": Kind("lam 0 or more", _FROM_0, float),
    "rho": Kind("rho 0 to 1", lambda value: NUMBER.fits(value) and 0.0 <= value <= 1.0, float),
    "clearance": Kind("clearance above 0", _ABOVE_0, float),
    "energy": Kind("energy above 0", _ABOVE_0, float),
    "impulse": Kind("a velocity, not 0", lambda value: NUMBER.fits(value) and value != 0.0 and math.isfinite(value), float),
    "family": TEXT,
}
"""What the value of each parameter has to be."""


@dataclass(frozen=True)
class StudyFile:
    """What a study's file contains: its scene, with the fixed parameters of the model, and its plan."""

    scene: Scene
    plan: StudyPlan


def read_study_file(path: str | os.PathLike[str]) -> StudyFile:
    """Read a study's file. Unknown and missing keys and values out of range are refused in one line."""
    from saltus.scene import load_scene
    from transitions.study.plan import FAMILY, StudyPlan

    file, folder = parse_toml(read_toml(Path(path), "study"), f"study {path}"), Path(path).parent
    file.only("title", "scene", "design", "runs", "seed", "units", "block", "vary", "fixed", "run")
    design = file.choice("design", ("grid", "hypercube"))
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
    scene = load_scene(place, **{name: fixed.pop(name) for name in _OF_MODEL if name in fixed})
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
        units=file.choice("units", ("natural", "physical"), "natural"),
        title=file.get("title", TEXT, ""),
        forces=scene.forces,
        **_numbers(file, design),
        **_run(file.table("run", {}), bool(scene.forces)),
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


def _run(run: TomlTable, forced: bool) -> dict[str, Any]:
    from transitions.study.plan import CLEAR

    run.only("until", "longest", "impacts")
    out: dict[str, Any] = {}
    until = run.content.get("until", CLEAR)
    if until != CLEAR:
        hint = nearest(until, (CLEAR,)) if isinstance(until, str) else ""
        out["until"] = run.get("until", POSITIVE._replace(expected=f'a duration above 0, or "{CLEAR}": until no impact is possible{hint}'))
    elif forced:
        raise run.wrong("until", until, "a duration: the scene has loads, under which impacts stay possible")
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
            values = axis.get("values", TEXTS) if name == FAMILY else axis.numbers("values")
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
        scale = axis.choice("scale", SCALES, "linear")
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
