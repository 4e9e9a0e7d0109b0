"""The coordinates of a scene: their names, and which of them belong to the nonlinear energy sink and to the linear oscillator."""

from __future__ import annotations

from typing import TYPE_CHECKING

from saltus.errors import BadInput, nearest
from saltus.table import Table

if TYPE_CHECKING:
    from bvp.system import ImpactSystem

__all__ = ["described", "marked"]

_ROLES = {"NES": "absorber", "LO": "primary"}


def described(coordinates: Table) -> dict[str, object]:
    """The table ``[coordinates]`` as a system's description has it, where a list of several names is no one coordinate."""
    coordinates.only("names", *_ROLES)
    found: dict[str, object] = {"names": list(coordinates.texts("names"))} if "names" in coordinates.keys() else {}
    for key, role in _ROLES.items():
        value = coordinates.content().get(key)
        if isinstance(value, list):
            value = value[0] if len(value) == 1 else None
        if value is not None:
            found[role] = value
    return found


def marked(coordinates: Table, system: ImpactSystem) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Indices of the coordinates of the NES and of the LO.

    Raises
    ------
    BadInput
        For a name that is no coordinate, one that is given twice, an empty list.
    """
    marks = {"NES": system.absorber, "LO": system.primary}
    found: dict[str, tuple[int, ...]] = {key: () if index is None else (index,) for key, index in marks.items()}
    for key in found:
        if not isinstance(coordinates.content().get(key), list):
            continue
        names = coordinates.texts(key)
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
