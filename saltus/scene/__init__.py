"""A scene: a system, the bounds of the search for its orbits, and the names that its literature uses.

A scene is a TOML file. Unknown keys are refused.

- ``[system]``: ``model = "vibro_impact_nes"`` with ``mu``, ``sigma``, ``lam``, ``rho``; or matrices ``mass``, ``damping``, ``stiffness``.
- ``[[stops]]``, with matrices: ``c``, ``lower``, ``upper``, ``restitution``, ``name``.
- ``[[springs]]`` and ``[[dampers]]``, with matrices: ``between``, ``on`` or ``c``, and a law (`bvp.springs`).
- ``[coordinates]``, with matrices: ``names``, ``LO``, ``NES``; each of the last two is a name or a list of names.
- ``[parameters]``: names with a number or an expression of others. Numbers of the tables above and of the loads can then be expressions.
- ``[ground]`` and ``[[forces]]``: loads (`saltus.scene.reading`).
- ``[bounds]``: ``energy``, ``quarter_period`` and ``impacts``, where names are searched; not needed for motion under loads.
- ``[complete]``: the same three, up to which a build finds every family.
- ``[sections]``: ``energies`` of panels of Poincare sections; ``cited``, those that the source gives.
- ``[names]``: the reference point of each name, ``{}`` where a name needs none.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import catalogues
from bvp.checks import Frozen
from bvp.texts import brief, listed, shown
from saltus.errors import BadInput, nearest, one_line, refusing
from saltus.scene.reading import INTEGER, NUMBERS, POSITIVE, TEXT, TEXTS, Kind, TomlTable, read_toml

if TYPE_CHECKING:
    from bvp.forcing import Force
    from bvp.parameters import ParametricSystem
    from bvp.resting import Rest
    from bvp.system import ImpactSystem

__all__ = ["DEFAULT", "LOADS", "SHIPPED", "Scene", "load_scene"]

DEFAULT = "lee2009"
SHIPPED = Path(catalogues.__file__).parent
"""The folder of the scenes that ship with saltus."""
LOADS = {"ground": "[ground]", "forces": "[[forces]]"}
"""Tables of a scene that drive its motion, as messages name them."""

_BOUNDS = {
    "energy": Kind(
        "[lowest, highest] with 0 < lowest < highest",
        lambda value: NUMBERS.fits(value) and len(value) == 2 and 0.0 < value[0] < value[1] < math.inf,
        NUMBERS.read,
    ),
    "quarter_period": POSITIVE,
    "impacts": INTEGER._replace(expected="an integer, 0 or more", fits=lambda value: INTEGER.fits(value) and value >= 0),
}
_SECTIONS = {
    "energies": Kind(
        "rising energies above 0",
        lambda value: NUMBERS.fits(value) and value == sorted(set(value)) and all(0.0 < energy < math.inf for energy in value),
        NUMBERS.read,
        default=(),
    ),
    "cited": NUMBERS._replace(default=()),
}
_POINT = {"h": POSITIVE._replace(default=None), "alpha": POSITIVE._replace(default=None)}
_MARK = Kind(
    "a coordinate, or a list of coordinates",
    lambda value: isinstance(value, str) or (value != [] and TEXTS.fits(value)),
    lambda value: (value,) if isinstance(value, str) else tuple(value),
    default=(),
)
_COORDINATES = {"names": TEXTS._replace(default=()), "NES": _MARK, "LO": _MARK}
_KEYS = (
    "parameters", "system", "stops", "springs", "dampers", "coordinates", "ground", "forces", "bounds", "complete", "sections", "names",
    "title", "source",
)  # fmt: skip


@brief
@dataclass(frozen=True, eq=False)
class Scene:
    """A system with its bounds and names. Two scenes with the same content are equal.

    Attributes
    ----------
    system : bvp.system.ImpactSystem
    energy : tuple of float
        Lowest and highest energy h that a family is followed to. It and the next two are None for a scene without bounds.
    quarter_period : float
        Longest quarter period alpha that is searched.
    impacts : int
        Most impacts inside the solved part of an orbit that are searched.
    reference_points : mapping of str to mapping of str to float
        Bare names with the point, ``h`` and ``alpha``, that the literature shows; used only to choose among matches.
    names : tuple of str
        Names whose families a build follows beyond its bounds: those with a reference point, and others that need none.
    complete : mapping
        ``energy``, ``quarter_period`` and ``impacts`` (in half a period) of a build, which finds every family within them. By default
        they are the limits of the search.
    sections : tuple of float
        Energies of panels of Poincare sections, rising; none where the scene gives none.
    cited_sections : tuple of float
        Those of them that the source gives; none for another system than the scene's.
    title, source : str
        Description of the scene and its source.
    nes, lo : tuple of int
        Indices of the coordinates marked as those of the nonlinear energy sink and of the linear oscillator.
    forces : tuple of bvp.forcing loads
        Motion of the ground and forces on coordinates.
    loads : tuple of str
        The tables, of `LOADS`, that they were read from.
    parametric : bvp.parameters.ParametricSystem, optional
        The system and the loads as functions of the scene's parameters, or of those of its model, whose values are those of the scene.
    rest : bvp.resting.Rest, optional
        Where the system rests under its constant loads, in a scene that `about_rest` made.
    """

    system: ImpactSystem
    energy: tuple[float, float] | None
    quarter_period: float | None
    impacts: int | None
    reference_points: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    complete: Mapping[str, Any] = field(default_factory=dict)
    sections: tuple[float, ...] = ()
    cited_sections: tuple[float, ...] = ()
    title: str = ""
    source: str = ""
    nes: tuple[int, ...] = ()
    lo: tuple[int, ...] = ()
    forces: tuple[Force, ...] = ()
    loads: tuple[str, ...] = ()
    parametric: ParametricSystem | None = field(default=None, repr=False)
    rest: Rest | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        reference_points = {name: Frozen(point) for name, point in self.reference_points.items()}
        object.__setattr__(self, "reference_points", Frozen(reference_points))
        object.__setattr__(self, "complete", Frozen(self.complete))

    def __eq__(self, other: object) -> bool:
        return self._content() == other._content() if isinstance(other, Scene) else NotImplemented

    def _content(self) -> dict[str, Any]:
        """All of it as plain data."""
        forces = [
            (type(force), {item.name: np.asarray(getattr(force, item.name)).tolist() for item in fields(force)}) for force in self.forces
        ]
        content = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "rest"}
        parametric = self.parametric and self.parametric.describe()
        return content | {"system": self.system.describe(), "forces": forces, "parametric": parametric}

    @property
    def underlying(self) -> Scene:
        """The scene of the undamped elastic system without loads, against whose families damped motion is read."""
        if self.system.is_conservative and not self.forces:
            return self
        from bvp.parameters import ParametricSystem

        system = self.system.underlying
        return replace(self, system=system, forces=(), loads=(), parametric=ParametricSystem.of(system))

    @cached_property
    def about_rest(self) -> Scene:
        """The scene in which constant loads are part of the potential energy, and displacements are counted from the position at rest
        (`bvp.resting`). The scene itself where there are none, where other loads act, and where energy is lost."""
        if not self.forces and self.system.smooth_forces is None:
            return self
        from bvp.parameters import ParametricSystem
        from bvp.resting import about_rest, with_loads_in_potential

        given = ParametricSystem.of(self.system, self.forces)
        with refusing():
            if with_loads_in_potential(given) is given:
                return self
            plain, rest = about_rest(given)
            parametric = self.parametric and with_loads_in_potential(self.parametric)
        return replace(self, system=plain.system(), parametric=parametric, forces=(), loads=(), rest=rest)

    @property
    def in_parameters(self) -> ParametricSystem:
        """The system and the loads as functions of the parameters, if the scene has some."""
        from bvp.parameters import ParametricSystem

        return self.parametric or ParametricSystem.of(self.system, self.forces)

    @property
    def parameters(self) -> dict[str, float]:
        """The values of the parameters, also of those that are expressions of others."""
        return {} if self.parametric is None else self.parametric.all_values()

    def require_used(self, what: str, uses: tuple[str, ...] = ()) -> None:
        """Refuse a scene with loads, or springs that are not linear, that a computation does not use. Its result would belong to another
        system. `what` names the command or function; `uses` are those of `LOADS` that it uses, and ``springs``."""
        for name in self.loads:
            if name not in uses:
                raise BadInput(
                    f"{what} computes motion without loads, and the scene has {LOADS[name]}; expected a scene without it, or saltus run"
                )
        reason = None if "springs" in uses else self.system.why_not_linear()
        if reason is not None:
            raise BadInput(f"{what} computes linear flights, and {reason}; expected a scene with linear [[springs]] and [[dampers]]")

    @property
    def bounds(self) -> dict[str, Any]:
        """The bounds of a search for names: ``energy``, ``quarter_period``, ``impacts``. A scene without them is refused."""
        if self.energy is None:
            raise BadInput("the scene has no table [bounds]; expected one with energy, quarter_period and impacts: they bound this search")
        return {"energy": self.energy, "quarter_period": self.quarter_period, "impacts": self.impacts}

    def reference_points_for(self, system: ImpactSystem) -> dict[str, dict[str, float]]:
        """The reference points for a system; none if it differs from the scene's system."""
        if system.describe() != self.system.describe():
            return {}
        return {name: dict(point) for name, point in self.reference_points.items()}

    def names_for(self, system: ImpactSystem) -> dict[str, dict[str, float]]:
        """Return all names that hold for a system, with their points as `reference_points_for`, or ``{}`` where a name needs none."""
        if system.describe() != self.system.describe():
            return {}
        return {name: dict(self.reference_points.get(name, {})) for name in self.names}


def load_scene(path: str | os.PathLike[str] | None = None, /, **parameters: float) -> Scene:
    """Read a scene from a TOML file, or one that ships with saltus.

    Parameters
    ----------
    path : path-like, optional
        A TOML file, or the bare name of a scene that ships with saltus; by default the reference scene.
    **parameters : float
        Values that replace those of the scene's parameters or of its model: ``mu``, ``sigma``, ``lam``, ``rho``.

    Returns
    -------
    Scene

    Raises
    ------
    ValueError
        With one line that says what was wrong and what was expected.

    Examples
    --------
    >>> scene = load_scene()
    >>> scene.energy, sorted(scene.reference_points)[:2]
    ((0.05, 10000.0), ['S31O11-', 'S55O11-'])
    >>> load_scene(mu=0.37, sigma=0.81).system.describe()["mu"]
    0.37
    """
    shipped = {entry.stem: entry for entry in SHIPPED.glob("*.toml")}
    known = f"; shipped: {listed(sorted(shipped), 12)}"
    path = DEFAULT if path is None else path
    if not isinstance(path, str | os.PathLike):
        raise BadInput(f"scene {shown(path)}: expected a TOML file or the name of a scene{known}")
    place = Path(path)
    if not place.exists() or path == DEFAULT:
        place = shipped.get(os.fspath(path), place)
    return _build(read_toml(place, f"scene {path}", shipped, known), parameters, place.parent)


def _build(scene: TomlTable, overrides: Mapping[str, float], folder: Path) -> Scene:
    from branches.naming.labels import parse_name

    scene.only(*_KEYS)
    own, parametric, nes, lo = _system(scene, overrides, folder)
    system = parametric.system()
    bounds = scene.table("bounds").fields(_BOUNDS) if "bounds" in scene.content else dict.fromkeys(_BOUNDS)
    sections = scene.table("sections", {})
    energies = sections.fields(_SECTIONS)
    if not set(energies["cited"]) <= set(energies["energies"]):
        raise sections.wrong("cited", list(energies["cited"]), "some of the energies")
    names = scene.table("names", {})
    points: dict[str, Mapping[str, float]] = {}
    for name in names.content:
        with refusing(names.where):
            parse_name(name)
        points[name] = {key: value for key, value in names.table(name).fields(_POINT).items() if value is not None}
    # A cited point says nothing about another system; damping and restitution do not belong to the one whose families have names.
    holds = system.underlying.describe() == own.underlying.describe()
    loads = tuple(name for name in LOADS if name in scene.content)
    return Scene(
        system=system,
        **bounds,
        reference_points={name: point for name, point in points.items() if point} if holds else {},
        names=tuple(points) if holds else (),
        complete=scene.table("complete").fields(_BOUNDS) if "complete" in scene.content else bounds,
        sections=energies["energies"],
        cited_sections=energies["cited"] if holds else (),
        title=scene.get("title", TEXT, ""),
        source=scene.get("source", TEXT, ""),
        nes=nes,
        lo=lo,
        forces=parametric.forces(),
        loads=loads,
        parametric=parametric,
    )


def _system(
    scene: TomlTable, overrides: Mapping[str, float], folder: Path
) -> tuple[ImpactSystem, ParametricSystem, tuple[int, ...], tuple[int, ...]]:
    """The system of ``[system]``, its stops, springs, dampers and ``[coordinates]``; the system with its loads and the overriding
    parameters; and the indices of the coordinates of the NES and of the LO."""
    from bvp.parameters import ParametricSystem
    from bvp.system import MODELS, ImpactSystem
    from saltus.scene.reading import read_loads

    table = scene.table("system")
    description = dict(table.content)
    if any(isinstance(description.get(key), str) for key in ("mass", "damping", "stiffness")):
        from saltus.scene.matrices import with_matrices

        description = with_matrices(description, folder, table.where)
    marks = scene.table("coordinates", {}).fields(_COORDINATES)
    model = description.get("model")
    if model is None:
        description |= {"stops": [stop.content for stop in scene.tables("stops")], "coordinates": {}}
        if marks["names"] != ():  # a file has a list in place of no names
            description["coordinates"]["names"] = marks["names"]
        description |= {key: [table.content for table in scene.tables(key)] for key in ("springs", "dampers") if key in scene.content}
    else:
        for other in ("stops", "springs", "dampers", "coordinates"):
            if other in scene.content:
                raise BadInput(f"{scene.where}: [{other}] goes with matrices; model {model} brings its own")
    whole: dict[str, Any] = {"system": description}
    if "parameters" in scene.content:
        whole["parameters"] = scene.table("parameters").content
    try:
        # Texts are expressions in a scene with parameters only.
        plain = None if "parameters" in scene.content else ImpactSystem.from_description(description)
        if plain is None and model in MODELS:
            plain = MODELS[model].make()
        coordinates = plain.coordinates if plain is not None else marks["names"] or _default_names(description.get("mass"))
        nes, lo = (_places(scene, marks, key, coordinates) for key in ("NES", "LO"))
        if model is None:
            single = {name: coordinates[found[0]] for name, found in (("absorber", nes), ("primary", lo)) if len(found) == 1}
            description["coordinates"] |= single
        elif plain is not None:
            nes, lo = (() if index is None else (index,) for index in (plain.absorber, plain.primary))
        whole["forces"] = read_loads(scene, coordinates, folder)
        parametric = ParametricSystem.from_description(whole)
        own = parametric.system()
    except BadInput:
        raise
    except (ValueError, TypeError) as error:
        raise BadInput(f"{scene.where}: {one_line(error)}") from error
    if overrides and not parametric.names:
        name = next(iter(overrides))
        raise BadInput(f"{scene.where} has no parameter {name}: its matrices are numbers; expected a scene with [parameters] or a model")
    return own, parametric.replaced(overrides) if overrides else parametric, nes, lo


def _default_names(mass: Any) -> tuple[str, ...]:
    """Names of coordinates that have none."""
    return tuple(f"u{k}" for k in range(1, len(mass) + 1)) if isinstance(mass, list) else ("u1",)


def _places(scene: TomlTable, marks: Mapping[str, Any], key: str, coordinates: Sequence[str]) -> tuple[int, ...]:
    """The indices of the coordinates that are marked as NES or LO."""
    for name in marks[key]:
        if name not in coordinates:
            known = ", ".join(coordinates)
            raise BadInput(f"{scene.where} [coordinates]: {name!r} is none of the coordinates {known}{nearest(name, coordinates)}")
        if (*marks["NES"], *marks["LO"]).count(name) > 1:
            raise BadInput(f"{scene.where} [coordinates]: {name} is marked twice, as NES or LO; expected once")
    return tuple(coordinates.index(name) for name in marks[key])
