"""`Catalogue`: the contents of a catalogue with the operations on them as methods."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

from branches.catalogue.database import CatalogueError
from branches.catalogue.store import CatalogueStore
from bvp.texts import brief

if TYPE_CHECKING:
    import networkx
    from matplotlib.axes import Axes

    from branches.branch import Branch
    from branches.catalogue.find import NameMatch
    from branches.catalogue.members import CatalogueFamilies
    from branches.catalogue.rows import FamilyRow
    from branches.catalogue.widening import Kept
    from branches.orbit import Orbit

__all__ = ["Catalogue"]


@brief
class Catalogue(CatalogueStore):
    """The families of one system, in one file.

    Parameters
    ----------
    path : path-like
    mode : {"r", "a"}
        "r" reads and changes nothing. "a" also adds; it makes the file if there is none, and converts a file of an older schema. One
        process writes at a time.
    scene : saltus.Scene, ImpactSystem or SceneRecord, optional
        Needed to make a file. The system of an existing file must be the same.
    provenance : mapping, optional
        JSON values by name, written beside the versions of the libraries when the file is made.

    Raises
    ------
    CatalogueError
        For a file that is no catalogue, has another schema, or belongs to another system. `CatalogueDamaged` and `CatalogueInUse`
        are of this kind.
    WriteFailure
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile, saltus
    >>> directory = tempfile.TemporaryDirectory()
    >>> path = directory.name + "/lee2009.sqlite"
    >>> with saltus.Catalogue(path, "a", scene=saltus.load_scene()) as catalogue:
    ...     id = catalogue.add(saltus.trace("S13O00+", energy=(0.2, 1.0)))
    >>> with saltus.Catalogue(path) as catalogue:
    ...     [family.label for family in catalogue.families(energy=0.5)], [event.id for event in catalogue.branch(id).events]
    (['S13O00+'], ['EP1', 'SB1', 'RT1', 'EP2'])
    >>> directory.cleanup()
    """

    plot: ClassVar[Callable[..., Axes]]
    """`saltus.methods` adds it."""

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        try:
            counts = self.counts()
        except CatalogueError:
            return f"Catalogue {self.path} (closed)", []
        return f"Catalogue {self.path}", [("holds", ", ".join(f"{count} {name}" for name, count in counts.items()))]

    def families(
        self,
        *,
        label: str | None = None,
        energy: float | None = None,
        stable: bool = False,
        ends: str | None = None,
        impacts: tuple[float, float] | None = None,
    ) -> list[FamilyRow]:
        """The families that fit; those with few impacts and low energies first.

        Parameters
        ----------
        label : str, optional
            Only those with such a label somewhere: a label or pattern of labels (``U83``), or shell wildcards (``U8*``).
        energy : float, optional
            Only those that cross this energy.
        stable : bool
            Only those that are stable somewhere. Label, energy and stability have to hold together.
        ends : str, optional
            ``origin-stop`` for both sides of the stop, ``origin-stop+``, ``periodic``.
        impacts : (float, float), optional
            Least and most in half a period.

        Returns
        -------
        list of FamilyRow

        Raises
        ------
        LabelSyntaxError
            For a label that cannot be read and has no wildcard.
        CatalogueError
            For ends that no family has, and for an argument of the wrong type.
        """
        from branches.catalogue.find import chosen

        return chosen(self.all_families(), label=label, energy=energy, stable=stable, ends=ends, impacts=impacts)

    def find(self, name: str, *, reference_points: Mapping[str, Mapping[str, float]] | None = None) -> NameMatch:
        """The one family, or linear mode, that has a name.

        Parameters
        ----------
        name : str
            ``LABEL[@h=..][,alpha=..]``, an id, or the beginning of one that no other has.
        reference_points : mapping, optional
            Cited points that choose among matches of a bare name; by default those of the catalogue's scene.

        Raises
        ------
        NameNotFound, AmbiguousName, LabelSyntaxError, ImpossibleLabelError
        CatalogueError
            If the name is no text.
        """
        from branches.catalogue.find import find

        return find(self, name, self.scene.reference_points if reference_points is None else reference_points)

    def identify(self, orbit: Orbit) -> str | None:
        """The id of the family that passes through an orbit, in any of its images; None if there is none.

        Raises
        ------
        CatalogueError
            For an orbit of another system.
        """
        self.require_system(orbit.system.describe())
        place = self._curves.find(orbit.problem, orbit.solution.y)
        return None if place is None else place.id

    def graph(self) -> networkx.MultiDiGraph:
        """The families and linear modes as nodes, their events as edges: see `branches.catalogue.graph`."""
        from branches.catalogue.graph import graph_of

        return graph_of(self)

    def widen(self, branch: Branch) -> Kept:
        """Add a family, or replace a part of it that is there already. Events and edges stay, in one transaction.

        Returns
        -------
        Kept
            ``NEW``, ``WIDER``, or ``KNOWN`` if all of the branch is there already.

        Raises
        ------
        CannotWiden
            If the branch lacks orbits that are there already, if an edge does not find its event on it, or if a build is not finished.
        CatalogueError, WriteFailure
            As for `add`.
        """
        from branches.catalogue.widening import widen

        return widen(self, branch)

    @cached_property
    def _curves(self) -> CatalogueFamilies:
        from branches.catalogue.members import CatalogueFamilies

        return CatalogueFamilies(self)

    def _changed(self) -> None:
        super()._changed()
        self.__dict__.pop("_curves", None)
