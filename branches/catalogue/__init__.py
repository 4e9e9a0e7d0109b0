"""A catalogue: the families of one system in one SQLite file, with their points, events, and the graph of how they meet.

Lists of families and the graph need neither numpy nor compiled kernels.
"""

from branches.catalogue.catalogue import Catalogue
from branches.catalogue.database import CatalogueDamaged, CatalogueError, CatalogueInUse
from branches.catalogue.rows import Edge, EventOrbit, FamilyRow, Node

__all__ = ["Catalogue", "CatalogueDamaged", "CatalogueError", "CatalogueInUse", "Edge", "EventOrbit", "FamilyRow", "Node"]
