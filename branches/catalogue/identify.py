"""Which family of a catalogue an orbit lies on, however it is started, mirrored, or run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from branches.catalogue.known import KnownFamilies, Place
from branches.identity import all_presentations
from branches.words import parse_ends, parse_word

if TYPE_CHECKING:
    import numpy as np

    from branches.catalogue.rows import FamilyRow
    from branches.catalogue.store import Catalogue
    from branches.words import Ends, Word
    from bvp.multipoint import MultipointProblem

__all__ = ["KeptFamilies"]

_MARGIN = 1e-6
"""How far, relatively, an orbit's energy may be beyond the ends of a family that is looked at."""


class KeptFamilies:
    """The families of a catalogue; the points of those that may have an orbit are read when it is asked for.

    Parameters
    ----------
    catalogue : Catalogue
    """

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._known = KnownFamilies()
        self._waiting: dict[tuple[Ends, Word], list[FamilyRow]] = {}
        for row in catalogue.families():
            self._waiting.setdefault((parse_ends(row.ends), parse_word(row.word)), []).append(row)

    def find(self, problem: MultipointProblem, y: np.ndarray) -> Place | None:
        """The family that an orbit lies on, and where; None where it lies on none.

        Parameters
        ----------
        problem : MultipointProblem
            Of the catalogue's system.
        y : (u,) float
            Unknowns of a solved orbit.
        """
        h = problem.energy(y)
        images = all_presentations(problem, y)
        for key in dict.fromkeys((image.ends, image.word) for image in images):
            kept = []
            for row in self._waiting.pop(key, []):
                if row.h[0] * (1.0 - _MARGIN) <= h <= row.h[1] * (1.0 + _MARGIN):
                    self._known.add(row.id, self._catalogue.branch(row.id))
                else:
                    kept.append(row)
            if kept:
                self._waiting[key] = kept
        return self._known.place(problem.system, images)
