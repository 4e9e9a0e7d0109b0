"""A scene: a system, the bounds of the search for its orbits, and the names that its literature uses.

A scene is a TOML file. Unknown keys are refused.

- ``[system]``: ``model = "vibro_impact_nes"`` with ``mu``, ``sigma``, ``lam``, ``rho``; or matrices ``mass``, ``damping``, ``stiffness``.
- ``[[stops]]``, with matrices: ``c``, ``lower``, ``upper``, ``restitution``, ``name``.
- ``[coordinates]``, with matrices: ``names``, ``LO``, ``NES``; each of the last two is a name or a list of names.
- ``[ground]`` and ``[[forces]]``: loads (`saltus.scene.reading`).
- ``[bounds]``: ``energy``, ``quarter_period`` and ``impacts``, where names are searched.
- ``[complete]``: the same three, up to which a build finds every family.
- ``[sections]``: ``energies`` of panels of Poincare sections; ``cited``, those that the source gives.
- ``[names]``: the reference point of each name, ``{}`` where a name needs none.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bvp.checks import Frozen
from bvp.texts import brief, shown
from saltus.errors import BadInput, nearest, one_line
from saltus.scene.reading import INTEGER, POSITIVE, TEXT, TEXTS, TomlTable, parse_toml, read_loads, read_toml

if TYPE_CHECKING:
    from bvp.forcing import Force
    from bvp.system import ImpactSystem

__all__ = ["DEFAULT", "LOADS", "Scene", "load_scene"]

DEFAULT = "lee2009"
LOADS = {"ground": "[ground]", "forces": "[[forces]]"}
"""Tables of a scene that drive its motion, as messages name them."""
_ROLES = {"NES": "absorber", "LO": "primary"}
"""Keys of ``[coordinates]``, and the corresponding keys of a system's description."""


@brief
@dataclass(frozen=True, eq=False)
class Scene:
    """A system with its bounds and names. Two scenes with the same content are equal.

    Attributes
    ----------
    system : bvp.system.ImpactSystem
    energy : tuple of float
        Lowest and highest energy h that a family is followed to.
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
    """

    system: ImpactSystem
    energy: tuple[float, float]
    quarter_period: float
    impacts: int
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
        content = {item.name: getattr(self, item.name) for item in fields(self)}
        return content | {"system": self.system.describe(), "forces": forces}

    @property
    def underlying(self) -> Scene:
        """The scene of the undamped elastic system without loads, against whose families damped motion is read."""
        return replace(self, system=self.system.underlying, forces=(), loads=())

    def require_used(self, what: str, uses: tuple[str, ...] = ()) -> None:
        """Refuse tables of loads that a computation does not use: its result would belong to another system. `what` names the command or
        function; `uses` are those of `LOADS` that it uses."""
        for name in self.loads:
            if name not in uses:
                raise BadInput(
                    f"{what} computes motion without loads, and the scene has {LOADS[name]}; expected a scene without it, or saltus run"
                )

    @property
    def bounds(self) -> dict[str, Any]:
        """The bounds of a search for names: ``energy``, ``quarter_period``, ``impacts``."""
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


def load_scene(path: str | os.PathLike[str] | None = None, **parameters: float) -> Scene:
    """Read a scene.

    Parameters
    ----------
    path : path-like, optional
        A TOML file, or the bare name of a scene that ships with saltus; by default the reference scene.
    **parameters : float
        Values that replace those of the scene's model: ``mu``, ``sigma``, ``lam``, ``rho``.

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
    folder: Path | Traversable = resources.files("catalogues")
    shipped = {entry.name.removesuffix(".toml"): entry for entry in folder.iterdir() if entry.name.endswith(".toml")}
    if path is not None and (not isinstance(path, str | os.PathLike) or not os.fspath(path)):
        raise BadInput(f"scene {shown(path)}: expected a TOML file or the name of a scene that ships: {', '.join(sorted(shipped))}")
    if path is None:
        where, text = DEFAULT, shipped[DEFAULT].read_text(encoding="utf-8")
    elif Path(path).exists() or os.fspath(path) not in shipped:
        where, folder = os.fspath(path), Path(path).parent
        text = read_toml(Path(path), "scene", shipped, f"; shipped: {', '.join(sorted(shipped))}")
    else:
        where, text = os.fspath(path), shipped[os.fspath(path)].read_text(encoding="utf-8")
    return _build(parse_toml(text, f"scene {where}"), parameters, folder)


def _build(scene: TomlTable, overrides: Mapping[str, float], folder: Path | Traversable) -> Scene:
    scene.only("system", "stops", "coordinates", "ground", "forces", "bounds", "complete", "sections", "names", "title", "source")
    own, system = _system(scene, overrides)
    points = _names(scene.table("names", {}))
    bounds = _bounds(scene.table("bounds"))
    energies, cited = _sections(scene.table("sections", {}))
    nes, lo = _marked_coordinates(scene.table("coordinates", {}), system)
    # A cited point says nothing about another system; damping and restitution do not belong to the one whose families have names.
    holds = system.underlying.describe() == own.underlying.describe()
    return Scene(
        system=system,
        **bounds,
        reference_points={name: point for name, point in points.items() if point} if holds else {},
        names=tuple(points) if holds else (),
        complete=_bounds(scene.table("complete")) if "complete" in scene.content else bounds,
        sections=energies,
        cited_sections=cited if holds else (),
        title=scene.get("title", TEXT, ""),
        source=scene.get("source", TEXT, ""),
        nes=nes,
        lo=lo,
        forces=read_loads(scene, system, folder),
        loads=tuple(name for name in LOADS if name in scene.content),
    )


def _bounds(bounds: TomlTable) -> dict[str, Any]:
    bounds.only("energy", "quarter_period", "impacts")
    energy = bounds.numbers("energy", 2)
    if not 0.0 < energy[0] < energy[1] < math.inf:
        raise bounds.wrong("energy", list(energy), "[lowest, highest] with 0 < lowest < highest")
    quarter_period = bounds.get("quarter_period", POSITIVE)
    impacts = bounds.get("impacts", INTEGER)
    if impacts < 0:
        raise bounds.wrong("impacts", impacts, "an integer, 0 or more")
    return {"energy": (energy[0], energy[1]), "quarter_period": quarter_period, "impacts": impacts}


def _sections(sections: TomlTable) -> tuple[tuple[float, ...], tuple[float, ...]]:
    sections.only("energies", "cited")
    if not sections.content:
        return (), ()
    energies = sections.numbers("energies")
    if not energies or not all(0.0 < energy < math.inf for energy in energies) or list(energies) != sorted(set(energies)):
        raise sections.wrong("energies", list(energies), "rising energies above 0")
    cited = sections.numbers("cited") if "cited" in sections.content else ()
    for energy in cited:
        if energy not in energies:
            raise sections.wrong("cited", list(cited), "some of the energies")
    return energies, cited


def _names(names: TomlTable) -> dict[str, Mapping[str, float]]:
    """Map each name to its reference point; the point is empty if the name alone identifies the family."""
    from branches.naming.labels import parse_name

    points: dict[str, Mapping[str, float]] = {}
    for name in names.content:
        point = names.table(name)
        point.only("h", "alpha")
        try:
            parse_name(name)
        except ValueError as error:
            raise BadInput(f"{names.where}: {one_line(error)}") from error
        points[name] = {key: point.get(key, POSITIVE) for key in point.content}
    return points


def _system(scene: TomlTable, overrides: Mapping[str, float]) -> tuple[ImpactSystem, ImpactSystem]:
    """Build the system of ``[system]``, ``[[stops]]`` and ``[coordinates]``, and that with the overriding parameters."""
    from bvp.system import MODELS, ImpactSystem

    system = scene.table("system")
    description = dict(system.content)
    if "model" in description:
        model = system.choice("model", tuple(MODELS))
        known = MODELS[model][1]
        system.only("model", *known)
        for other in ("stops", "coordinates"):
            if other in scene.content:
                raise BadInput(f"{scene.where}: [{other}] goes with matrices; model {model} brings its own")
        for name in overrides:
            if name not in known:
                raise BadInput(f"unknown parameter {name!r} of model {model}{nearest(name, known)}")
    else:
        system.only("model", "mass", "damping", "stiffness")
        if overrides:
            name = next(iter(overrides))
            raise BadInput(f"{name} is a parameter of a model, and {scene.where} gives matrices instead of a model")
        for required in ("mass", "stiffness"):
            system.matrix(required)
        description["stops"] = [stop.content for stop in _stops(scene)]
        if "coordinates" in scene.content:
            description["coordinates"] = _coordinates_described(scene.table("coordinates"))
    try:
        own = ImpactSystem.from_description(description)
    except ValueError as error:
        raise BadInput(f"{scene.where}: {one_line(error)}") from error
    return own, ImpactSystem.from_description({**description, **overrides}) if overrides else own


def _stops(scene: TomlTable) -> list[TomlTable]:
    stops = scene.tables("stops")
    if not stops:
        raise BadInput(f"{scene.where}: [[stops]] is missing; a scene with matrices has at least one stop")
    for stop in stops:
        stop.only("c", "lower", "upper", "restitution", "name")
        stop.numbers("c")
    return stops


def _coordinates_described(coordinates: TomlTable) -> dict[str, object]:
    """The table ``[coordinates]`` as a system's description has it, where a list of several names is no one coordinate."""
    coordinates.only("names", *_ROLES)
    found: dict[str, object] = {"names": list(coordinates.get("names", TEXTS))} if "names" in coordinates.content else {}
    for key, role in _ROLES.items():
        value = coordinates.content.get(key)
        if isinstance(value, list):
            value = value[0] if len(value) == 1 else None
        if value is not None:
            found[role] = value
    return found


def _marked_coordinates(coordinates: TomlTable, system: ImpactSystem) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Indices of the coordinates of the NES and of the LO, each once."""
    marks = {"NES": system.absorber, "LO": system.primary}
    found: dict[str, tuple[int, ...]] = {key: () if index is None else (index,) for key, index in marks.items()}
    for key in found:
        if not isinstance(coordinates.content.get(key), list):
            continue
        names = coordinates.get(key, TEXTS)
        for name in names:
            if name not in system.coordinates:
                listed = ", ".join(system.coordinates)
                raise coordinates.wrong(key, name, f"some of the coordinates {listed}{nearest(name, system.coordinates)}")
        if not names or len(set(names)) < len(names):
            raise coordinates.wrong(key, list(names), "names of coordinates, each once")
        found[key] = tuple(system.coordinates.index(name) for name in names)
    for index in found["NES"]:
        if index in found["LO"]:
            raise BadInput(f"{coordinates.where}: {system.coordinates[index]} is marked as NES and as LO, expected one of them")
    return found["NES"], found["LO"]
