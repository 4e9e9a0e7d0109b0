"""The images of an orbit under the symmetries of its problem: mirrored, backwards in time, begun at another impact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from branches.presentation import Presentation, closed_presentation, presentation_of, run_backwards
from branches.sequences import mirror
from bvp.closures import Cycle, cycle_of
from bvp.multipoint import MultipointProblem

__all__ = ["Image", "images_within"]


class Image(NamedTuple):
    """What takes one presentation of an orbit to another: mirrored, backwards in time, and (periodic ends) from a later impact on."""

    mirrored: bool
    backwards: bool
    first: int = 0

    def of(self, problem: MultipointProblem, y: np.ndarray, cycle: Cycle | None = None) -> Presentation:
        """The image of an orbit; `cycle`, if it is at hand, is that of the orbit."""
        if problem.periodic:
            cycle = cycle_of(problem, y) if cycle is None else cycle
            return closed_presentation(cycle, first=self.first, backwards=self.backwards, mirrored=self.mirrored)
        presentation = presentation_of(problem, y)
        if self.backwards:
            presentation = run_backwards(problem.system, presentation, problem)
        return presentation.mirrored() if self.mirrored else presentation

    def is_the_same_orbit(self, problem: MultipointProblem) -> bool:
        """Whether the image of any orbit of a problem is that orbit itself, started elsewhere."""
        if problem.periodic:
            return not self.mirrored and not self.backwards
        if problem.quarters == 1:
            return True
        return self.mirrored is (problem.ends[0] == "origin")

    def unknowns(self, problem: MultipointProblem, y: np.ndarray) -> np.ndarray | None:
        """The image of an orbit as unknowns of the same problem; None if the orbit does not begin at so many instants."""
        try:
            return self.of(problem, y).unknowns(problem)
        except RuntimeError:
            return None


def images_within(problem: MultipointProblem, starts: int) -> list[Image]:
    """The images of an orbit that solve its own problem, itself among them. starts: at how many instants a closed orbit can begin."""
    found = []
    for backwards in (False, True):
        for mirrored in (False, True)[: 1 + problem.system.has_odd_symmetry]:
            ends, letters = problem.ends, problem.sequence
            if backwards:
                ends, letters = (ends[1], ends[0]), letters[::-1]
            if mirrored:
                first, last = mirror(ends)
                ends, letters = (first, last), mirror(letters)
            firsts = range(starts) if problem.periodic else range(1)
            if ends == problem.ends:
                found += [Image(mirrored, backwards, k) for k in firsts if letters[k:] + letters[:k] == problem.sequence]
    return found
