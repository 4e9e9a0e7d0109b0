"""Images of orbits and branches under the symmetries of the equations: the mirror u to -u, and the reversal of time.

Two sides of a symmetry breaking are such images of each other. So one is followed, and the other is its image: the same points and
events, exact to rounding.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from branches.branch import Branch, BranchEvent
from branches.family import Family
from branches.presentation import Presentation, closed_presentation, presentation_of, run_backwards, solved
from branches.stability import describe
from bvp.closures import cycle_of
from bvp.multipoint import MultipointProblem, Solution

__all__ = ["Image", "image_of", "images_between"]

NEAR = 1e-6
"""Relative difference within which an image of a located orbit is that orbit."""

_MIRRORED = ("start_u", "start_v", "velocities")
_TURNED = (*_MIRRORED, "flight_times", "impact_speeds", "label")
"""Columns that an image changes."""


class Image(NamedTuple):
    """What takes one presentation of an orbit to another: mirrored, backwards in time, and (periodic ends) from a later impact on."""

    mirrored: bool
    backwards: bool
    first: int = 0

    def of(self, problem: MultipointProblem, y: np.ndarray) -> Presentation:
        """The image of an orbit."""
        if problem.periodic:
            presentation = closed_presentation(cycle_of(problem, y), first=self.first, backwards=self.backwards)
        else:
            presentation = presentation_of(problem, y)
            if self.backwards:
                presentation = run_backwards(problem.system, presentation)
        return presentation.mirrored() if self.mirrored else presentation

    def is_the_same_orbit(self, problem: MultipointProblem) -> bool:
        """Whether the image of any orbit of a problem is that orbit itself, started elsewhere."""
        if problem.periodic:
            return not self.mirrored and not self.backwards
        if problem.quarters == 1:
            return True
        return self.mirrored is (problem.ends[0] == "origin")


def images_between(problem: MultipointProblem, middle: np.ndarray, side: np.ndarray) -> list[Image]:
    """The images that keep an orbit and change one beside it: those that take one side of a bifurcation to the other.

    Parameters
    ----------
    problem : MultipointProblem
    middle, side : (u,) float
        The orbit at the bifurcation and one of a new family, as solutions of the problem.

    Returns
    -------
    list of Image
        Those first that give the same orbit started elsewhere, then those that change least.
    """
    odd = problem.system.has_odd_symmetry
    count = len(problem.sequence) if problem.periodic else 1
    every = [Image(m, b, k) for b in (False, True) for m in (False, True)[: 1 + odd] for k in range(count)]
    found = []
    for image in every:
        presentation = image.of(problem, middle)
        if (presentation.ends, presentation.sequence) != (problem.ends, problem.sequence):
            continue
        apart = float(np.max(np.abs(side - middle)))
        kept = float(np.max(np.abs(presentation.unknowns(problem) - middle))) < NEAR * float(np.max(np.abs(middle)))
        # A third of three turns keeps the middle and changes the side, but takes it to no other one.
        if kept and float(np.max(np.abs(image.of(problem, side).unknowns(problem) + side - 2.0 * middle))) < 0.5 * apart:
            found.append(image)
    return sorted(found, key=lambda image: not image.is_the_same_orbit(problem))


def image_of(branch: Branch, image: Image) -> Branch:
    """The branch of the images of a branch's orbits."""
    system = branch.system
    # The mirror image needs no new solution but at the events: the start changes its sign, and no number else changes.
    turned = image.backwards or image.first
    wanted = range(len(branch)) if turned else sorted({0, *(event.point for event in branch.events)})
    presentations = {i: image.of(branch.problem, branch.orbit(i).solution.y) for i in wanted}
    problem = MultipointProblem(system, presentations[0].ends, presentations[0].sequence)
    solutions = {i: solved(problem, presentation.unknowns(problem)) for i, presentation in presentations.items()}
    if turned:
        columns = describe(problem, list(solutions.values()), branch.points["arclength"]).columns
        points = branch.points | {name: columns[name] for name in _TURNED}
    else:
        points = branch.points | {name: -branch.points[name] for name in _MIRRORED}
    events = tuple(_event(problem, event, solutions[event.point], str(points["label"][event.point])) for event in branch.events)
    ended = tuple(
        end._replace(text=end.text.replace(before.note, after.note)) if before is not None and before.note and after.note else end
        for end, (before, after) in zip(branch.ended, _last_events(branch, events), strict=True)
    )
    return replace(branch, problem=problem, points=points, events=events, ended=(ended[0], ended[1]))


def _last_events(branch: Branch, events: tuple[BranchEvent, ...]) -> list[tuple[Any, Any]]:
    """The events at both ends, of the branch and of its image."""
    pairs = list(zip(branch.events, events, strict=True))
    return [next(((a, b) for a, b in pairs if a.point == at and a.type in ("GR", "EP")), (None, None)) for at in (0, len(branch) - 1)]


def _event(problem: MultipointProblem, event: BranchEvent, solution: Solution, label: str) -> BranchEvent:
    """An event of the image: the same, in the words of its own orbit."""
    if event.type != "GR":
        return event._replace(label=label)
    said = Family(problem).grazing(event.note or "", solution)
    return event._replace(label=label, stop=said["stop"], note=said["note"])
