"""Switching at a bifurcation of a branch: the families that start there or cross there.

At a branch point both families solve the same multipoint problem. Where a symmetry breaks, the period doubles or is multiplied by q, the
new family solves another one - a longer segment between other ends, or the periodic closure - of which the old family is a solution
too, and the event a branch point of it. Seen from the new family that branch point is a crossing with a multiple cover of the old one.

Two sides of a symmetry breaking are images of each other: mirrored (u to -u), backwards in time, or both. So one side is followed, and the
other is its image: the same points and events, exact to rounding.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from branches.branch import Branch, BranchEvent
from branches.family import Family
from branches.first_orbits import across_null_space, first_orbits
from branches.images import Image, images_within
from branches.orbit import label_at, orbit_columns
from branches.presentation import canonical_orbit, embed, solved, starts_of, symmetries
from branches.tracing import follow_family
from bvp.checks import require_branch
from bvp.closures import cycle_of
from bvp.dense import inner, length
from bvp.multipoint import MultipointProblem, Solution
from bvp.stability import stability
from bvp.texts import takes_options_of
from continuation.problem import Step
from continuation.switching import SwitchError, branch_directions, refine_branch_point, tripling_direction

__all__ = ["EmanatingFamily", "emanating_families", "switch"]

TYPES = ("BP", "SB", "PD", "RT")
"""Events that switching starts from."""

NEAR = 1e-6
"""Relative difference within which an image of a located orbit is that orbit."""

BESIDE = 1e-4
"""How far from an event the images of a new family's direction are looked at, in units of the orbit's size. At the first orbit of a family
the square of the distance can already count for more: the period of an orbit with q periods changes with it."""

_MIRRORED = ("start_u", "start_v", "velocities")
_TURNED = (*_MIRRORED, "flight_times", "impact_speeds", "label")
"""Columns that an image changes."""


def images_between(problem: MultipointProblem, middle: np.ndarray, direction: np.ndarray, known: np.ndarray) -> list[Image]:
    """The symmetries that map an orbit to itself but change a nearby orbit: they map one side of a bifurcation to the other.

    Parameters
    ----------
    problem : MultipointProblem
    middle : (u,) float
        The orbit at the bifurcation, as a solution of the problem.
    direction, known : (u,) float
        The directions of a new family, which can have a part along the old one, and of the old one.

    Returns
    -------
    list of Image
        Those first that give the same orbit started elsewhere, then those that change least.
    """
    scale = problem.scales(middle)
    side = middle + BESIDE / length(direction / scale) * direction
    along = known / scale / length(known / scale)

    def across(change: np.ndarray) -> float:
        scaled = change / scale
        return float(np.max(np.abs(scaled - inner(scaled, along) * along)))

    cycles = [cycle_of(problem, y) if problem.periodic else None for y in (middle, side)]
    count = min(starts_of(cycle) if cycle else 1 for cycle in cycles)
    found = []
    for image in images_within(problem, count):
        presentation = image.of(problem, middle, cycles[0])
        kept = float(np.max(np.abs(presentation.unknowns(problem) - middle))) < NEAR * float(np.max(np.abs(middle)))
        # A third of a 3-fold cover keeps the middle and changes the side, but takes it to no other one.
        if kept and across(image.of(problem, side, cycles[1]).unknowns(problem) + side - 2.0 * middle) < 0.5 * across(side - middle):
            found.append(image)
    return sorted(found, key=lambda image: not image.is_the_same_orbit(problem))


def image_of(branch: Branch, image: Image) -> Branch:
    """The branch of the images of a branch's orbits."""
    system = branch.system
    # The mirror image needs no new solution but at the events: the start changes its sign, and no number else changes. Without impacts a
    # closed orbit starts at another instant.
    turned = image.backwards or image.first or (branch.problem.periodic and not branch.problem.sequence)
    wanted = range(len(branch)) if turned else sorted({0, *(event.point for event in branch.events)})
    presentations = {i: image.of(branch.problem, branch.orbit(i).solution.y) for i in wanted}
    problem = MultipointProblem(system, presentations[0].ends, presentations[0].sequence, branch.problem.pieces)
    solutions = {i: solved(problem, presentation.unknowns(problem)) for i, presentation in presentations.items()}
    if turned:
        columns = orbit_columns(problem, list(solutions.values()), branch.points["arclength"])
        points = branch.points | {name: columns[name] for name in _TURNED}
    else:
        points = branch.points | {name: -branch.points[name] for name in _MIRRORED}
    events = tuple(_event(problem, event, solutions[event.point], str(points["label"][event.point])) for event in branch.events)
    ended = []
    for end, at in zip(branch.ended, (0, len(branch) - 1), strict=True):
        for before, after in zip(branch.events, events, strict=True):
            if before.point == at and before.note and after.note:
                end = end._replace(text=end.text.replace(before.note, after.note))
        ended.append(end)
    return replace(branch, problem=problem, points=points, events=events, ended=(ended[0], ended[1]))


def _event(problem: MultipointProblem, event: BranchEvent, solution: Solution, label: str) -> BranchEvent:
    """An event of the image: the same, in terms of its own orbit."""
    if event.type != "GR":
        return event._replace(label=label)
    described = Family(problem).grazing(event.note or "", solution)
    return event._replace(label=label, stop=described["stop"], note=described["note"])


class EmanatingFamily(NamedTuple):
    """One side of a family that starts or crosses at an event.

    problem : MultipointProblem
        What its orbits solve.
    step : continuation.Step
        Its first orbit, with the tangent that leads away from the event.
    image : Image or None
        What takes this side to the other one, where that is its image: the other side is then no emanating family of its own.
    cover : int
        0 if the family's orbits are solved as they were found. k > 1: the orbit found is a k-fold cover, and the family is the one of its
        primitive orbit. 1: the orbit found has more symmetry than the old family. In both cases it continues to both sides of `step`.
    """

    problem: MultipointProblem
    step: Step
    image: Image | None = None
    cover: int = 0


@takes_options_of(follow_family)
def switch(branch: Branch, event: BranchEvent | str, **options: Any) -> list[Branch]:
    """The families that start or cross at an event, each followed away from it.

    Parameters
    ----------
    branch : Branch
    event : BranchEvent or str
        An event of this branch of type BP, SB, PD or RT, or its id.
    **options
        As for `branches.tracing.follow_family`; the energies are not those of the branch.

    Returns
    -------
    list of Branch
        One for each side of each family. Where the two sides are images of each other, the second is the exact image of the first: the
        same points and events, and one id. Where they are the same orbits started at different times (at a PD, and at an RT with
        even q), there is one. If the other family at a branch point consists of multiple covers, or of orbits with more symmetry, the
        result is the family of the primitive orbit alone, followed in both directions. `Branch.cover` counts the periods in the cover.

    Raises
    ------
    ValueError
        For an event of another type, one that this branch does not have, and for an RT of orbits without a reversal other than a tripling.
    RuntimeError
        Where no orbit of a new family is found next to the event.

    Warns
    -----
    RuntimeWarning
        Where two families start, and one of them is not found.
    """
    require_branch(branch)
    out = []
    for emanating in emanating_families(branch, branch.event(event)):
        if emanating.cover:
            primitive = follow_family(emanating.problem, emanating.step, **{"direction": "both", **options})
            out.append(replace(primitive, cover=emanating.cover))
            continue
        side = follow_family(emanating.problem, emanating.step, direction="along", **options)
        out.append(side)
        if emanating.image is not None:
            out.append(image_of(side, emanating.image))
    return out


def emanating_families(branch: Branch, event: BranchEvent) -> list[EmanatingFamily]:
    """The families that start or cross at an event, as starts from which to follow them; raises what `switch` raises."""
    if event.type not in TYPES:
        raise ValueError(f"{event.id} is of type {event.type}; switching starts from BP, SB, PD or RT")
    problem = branch.problem
    here = branch.orbit(event.point).solution
    if event.type == "BP":
        last = len(branch) - 1
        known = branch.unknowns(min(event.point + 1, last)) - branch.unknowns(max(event.point - 1, 0))
        out = _crossing(problem, here.y, known, event)
    else:
        out = []
        for window in _windows(problem, event, here):
            presentation = embed(problem, here.y, window)
            wide = MultipointProblem(problem.system, presentation.ends, presentation.sequence)
            wide = wide.in_enough_pieces(presentation.unknowns(wide))
            nudge = 1e-6 * here.tangent[: problem.unknowns]
            ahead, behind = (embed(problem, here.y + sign * nudge, window).unknowns(wide) for sign in (1.0, -1.0))
            y = presentation.unknowns(wide)
            direction = _across(wide, y, ahead - behind, event)
            found = _sides(wide, y, direction, ahead - behind, at_an_angle=_is_tripling(event))
            if not found:
                missing = f"{event.id}: no orbit found of a family between the ends {wide.ends[0]}, {wide.ends[1]}"
                warnings.warn(missing, RuntimeWarning, stacklevel=3)
            out += found
    if not out:
        raise RuntimeError(f"no orbit of a new family was found next to {event.id}")
    return out


def _crossing(problem: MultipointProblem, y: np.ndarray, known: np.ndarray, event: BranchEvent) -> list[EmanatingFamily]:
    """The other family at a branch point of one problem."""
    family = Family(problem)
    try:
        direction = branch_directions(family, y, known)[0]
    except SwitchError as error:
        # A branch point is known as well as the square root of rounding, where the families are nearly parallel.
        middle = refine_branch_point(family, y, problem.scales(y))
        if middle is None:
            raise RuntimeError(f"no second family at {event.id}: {error}") from error
        y = middle
        try:
            direction = branch_directions(family, y, known)[0]
        except SwitchError as still:
            raise RuntimeError(f"no second family at {event.id}: {still}") from error
    for step in first_orbits(family, y, direction, at_an_angle=True):
        found = symmetries(cycle_of(problem, step.y))
        quarter = len({e for _, e in found.reversals}) == 2 and problem.quarters == 2
        if found.cover > 1 or quarter or (found.reversals and problem.periodic):
            primitive, orbit = canonical_orbit(problem, step.y)
            begin = Family(primitive).begin(orbit)
            if begin.converged:
                return [EmanatingFamily(*_printed(primitive, orbit, begin), cover=found.cover)]
    return _sides(problem, y, direction, known, at_an_angle=True)


def _sides(
    problem: MultipointProblem, middle: np.ndarray, direction: np.ndarray, known: np.ndarray, *, at_an_angle: bool
) -> list[EmanatingFamily]:
    """Both sides of a family that leaves an orbit of a known one in a direction, as one where they are images of each other."""
    steps = list(first_orbits(Family(problem), middle, direction, at_an_angle=at_an_angle))
    images = images_between(problem, middle, direction, known) if steps else []
    if images:
        # An orbit started at its other end is the same orbit, so that between two ends what remains is the mirror.
        image = None if images[0].is_the_same_orbit(problem) else images[0] if problem.periodic else Image(True, False)
        return [EmanatingFamily(*_printed(problem, middle, steps[0]), image)]
    return [EmanatingFamily(*_printed(problem, middle, step)) for step in steps]


def _printed(problem: MultipointProblem, middle: np.ndarray, step: Step) -> tuple[MultipointProblem, Step]:
    """An orbit and its tangent as they are printed: with two origin ends started at the one that gives the label p <= q."""
    label = label_at(problem, step.extra.result)
    if label is None or label.kind != "U" or label.p is None or label.q is None or label.p <= label.q:
        return problem, step
    presentation = embed(problem, step.y, (1, 2))
    turned = MultipointProblem(problem.system, presentation.ends, presentation.sequence)
    family = Family(turned)
    begin = family.begin(presentation.unknowns(turned))
    if not begin.converged:
        return problem, step
    away = (begin.y - embed(problem, middle, (1, 2)).unknowns(turned)) / turned.scales(begin.y) ** 2
    if inner(away, begin.tangent[: turned.unknowns]) < 0.0:
        begin = family.step(begin.y, -begin.tangent, 0.0)
    return turned, begin


def _windows(problem: MultipointProblem, event: BranchEvent, here: Solution) -> list[tuple[int, int] | int]:
    """The intervals of the old orbit that the new families are solved on: (first, last) in segments, or a number of periods that
    close on themselves."""
    if event.type == "RT":
        return _resonant_windows(problem, event, here)
    if problem.periodic or event.breaks == "reversal":
        return [2 if problem.periodic else 1]
    if event.type == "PD" and problem.quarters == 1:
        return [(0, 4), (1, 5)]
    return [(0, 2)] if "about the start" in (event.note or "") else [(1, 3)]


def _resonant_windows(problem: MultipointProblem, event: BranchEvent, here: Solution) -> list[tuple[int, int] | int]:
    """Half the new orbits' periods, from each kind of instant about which they can reverse.

    The map over a half period (with u to -u where orbits have that symmetry; over the period where not) rotates its plane by 2 pi r/s. Its
    orbits that return after s start in two families, one on each kind of line that a reversal keeps: for odd s every line holds
    one of them on either side of the old orbit; for even s a line holds the same one on both sides.
    """
    if event.p_q is None:
        raise ValueError(f"{event.id}: its p/q is not known")
    p, q = event.p_q
    if problem.periodic:
        if q != 3:
            raise ValueError(f"{event.id}: switching at a {p}:{q} resonance needs orbits with a reversal; without one q is 3 at most")
        return [3]
    if problem.quarters == 1:
        turn = Fraction(p, 2 * q)
        level = math.cos(2.0 * math.pi * turn)
        halves = stability(problem, here).tau_half
        assert halves is not None  # of a quarter
        resonant = min(np.real(halves), key=lambda half: abs(abs(half) - abs(2.0 * level)))
        if level * resonant < 0.0:
            turn = Fraction(1, 2) - turn
        s = turn.denominator
    else:
        s = q
    # s of those maps last s solved segments and their reversals.
    return [(0, s)] if s % 2 else [(0, s), (1, 1 + s)]


def _is_tripling(event: BranchEvent) -> bool:
    return event.type == "RT" and event.p_q is not None and event.p_q[1] == 3


def _across(wide: MultipointProblem, y: np.ndarray, known: np.ndarray, event: BranchEvent) -> np.ndarray:
    """The direction of the new family in the null space of the Jacobian."""
    scale = wide.scales(y)
    if event.type == "RT" and wide.periodic:
        try:
            return tripling_direction(Family(wide), y, known, scale)
        except SwitchError as error:
            raise RuntimeError(f"no family of 3-fold orbits at {event.id}: {error}") from error
    if _is_tripling(event):
        # The two families cross at an angle; else the new one leaves at right angles.
        try:
            return branch_directions(Family(wide), y, known)[0]
        except SwitchError as error:
            raise RuntimeError(f"no family of 3-fold orbits at {event.id}: {error}") from error
    return across_null_space(wide, y, known, event.id)
