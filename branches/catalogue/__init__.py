"""A catalogue: the families of one system in one SQLite file, with their points, events, and the graph of how they meet.

Nothing is loaded before it is used: lists of families and the graph need neither numpy nor compiled kernels.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branches.catalogue.errors import CatalogueDamaged, CatalogueError, CatalogueInUse
    from branches.catalogue.rows import Edge, EventOrbit, FamilyRow, Node
    from branches.catalogue.store import Catalogue

__all__ = ["Catalogue", "CatalogueDamaged", "CatalogueError", "CatalogueInUse", "Edge", "EventOrbit", "FamilyRow", "Node"]

_HOMES = {
    "Catalogue": "store",
    "CatalogueDamaged": "errors",
    "CatalogueError": "errors",
    "CatalogueInUse": "errors",
    "Edge": "rows",
    "EventOrbit": "rows",
    "FamilyRow": "rows",
    "Node": "rows",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
