"""Orbits next to one that is symmetric, or that runs twice: this single orbit, and back."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from branches.curves.free import BOTH, FOLD, FreeKind
from branches.curves.free_points import event_of
from branches.curves.grazing import Grazing, observed
from branches.curves.record import BifurcationCurve
from branches.forced.primitive import apart_from_image, full_period, image_sign, twice
from branches.forced.resequencing import later, with_touch, without_impact
from branches.released.segments import Segment, segment_of
from branches.sequences import PERIODIC
from bvp.forced import ForcedProblem
from bvp.multipoint import RESULT_INDEX
from bvp.released import ReleasedProblem

__all__ = ["APART", "Narrow", "apart_from_single", "narrowed", "widened", "without_grazing"]

APART = 0.2
"""Difference of an orbit and its image, beside the orbit, up to which the point where they are one is looked for."""


class Narrow(NamedTuple):
    """The single orbit next to a doubled one, or the symmetric one next to another: its problem and unknowns, PD or SB, the difference of
    the orbit and its image beside the orbit, and what is critical of a free orbit. Next to an orbit that touches a stop beside an end at
    rest, the one that touches it there: GR, the part of the segment between the touch and the end, and what grazes."""

    problem: ForcedProblem
    y: np.ndarray
    code: str
    apart: float
    free: FreeKind | None = None
    grazing: Grazing | None = None


def narrowed(problem: ForcedProblem, y: np.ndarray) -> Narrow | None:
    """The mean of an orbit and its image, half a period later or about the middle between two ends; None where the sequence has no such
    image."""
    if isinstance(problem, ReleasedProblem):
        return _narrowed_free(problem, y)
    sign = image_sign(problem)
    if sign == 0.0:
        return None
    count, size, doubled = len(problem.sequence) // 2, 2 * problem.degrees_of_freedom, sign > 0.0
    values, first = problem.parameters(y), problem.sequence[:count]
    nodes, times = problem.nodes(y), problem.flight_times(y)
    closure: dict[str, int] = {"load_periods": problem.load_periods // 2} if doubled else {"half": True}
    try:
        single = problem.sibling(first, values=values, **closure)
    except ValueError:
        return None
    states = 0.5 * (nodes[:count, :size] + sign * nodes[count:, :size])
    fractions = 0.5 * (nodes[:count, size] + nodes[count:, size] - 0.5 * problem.has_clock)
    begun = single.pack(states, fractions * (2.0 if doubled else 1.0), nodes[0, size + 1 :], 0.5 * (times[:count] + times[count:]))
    return Narrow(single, begun, "PD" if doubled else "SB", apart_from_image(problem, y))


def _narrowed_free(problem: ReleasedProblem, y: np.ndarray) -> Narrow | None:
    whole = segment_of(problem, y)
    found = _folded(whole, problem.system.has_odd_symmetry)
    if found is None:
        return None
    if problem.structure.periodic and found.turn is not None:
        half = found.mean.opened(problem, found.turn).half(problem)
    else:
        half = found.mean.half(problem)
    try:
        single = half.problem(problem, y)
    except ValueError:
        return None
    if problem.structure.periodic:
        kind = FreeKind(FOLD if found.turn is None else BOTH)
        return Narrow(single, half.unknowns(single), "PD" if found.turn is None else "SB", found.apart, kind)
    # A quarter doubles in half of its period, which is its own image, too.
    again = _folded(half, False) if single.quarters == 2 else None
    code, _ = event_of(single, _FAR)
    return Narrow(single, half.unknowns(single), code, found.apart, FreeKind(_FAR, again is not None and again.apart < APART))


_FAR = (False, True)
"""The symmetry of the perturbation that leaves the reversal about the start alone."""


class _Folded(NamedTuple):
    """The mean of a segment and its nearest image, their difference beside the orbit, and how the image of a closed segment is a reversal:
    impact i is impact turn - i of the image. None where the segment runs twice."""

    mean: Segment
    apart: float
    turn: int | None = None


def _folded(segment: Segment, odd: bool) -> _Folded | None:
    """The segment and its image about its middle; those of a closed one are its reversals, and half the period later. None where no image
    has its ends and sequence. odd: whether the image of a closed segment can be a mirror image, too."""
    back = segment.backwards()
    images: list[tuple[Segment, int | None]]
    if segment.ends != PERIODIC:
        images = [(back, None), (back.mirrored(), None)]
    else:
        count = len(segment.sequence)
        reversed_ones = [back, back.mirrored()] if odd else [back]
        images = [(one.begun_at(impact), -impact % count) for one in reversed_ones for impact in range(count)]
        if count % 2 == 0:
            images.append((segment.begun_at(count // 2), None))
    found = [
        _Folded(segment.mean(image), float(np.abs(image.after - segment.after).max() / np.abs(segment.after).max()), turn)
        for image, turn in images
        if image[:2] == segment[:2]
    ]
    return min(found, key=lambda one: round(one.apart, 10), default=None)  # an orbit with more symmetries is several of its images


def without_grazing(curve: BifurcationCurve, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit of a curve. The impact that grazes is left out where its image is none: it hides what else the orbit and its image share."""
    problem, grazing = curve.plane.problem, curve.grazing
    if grazing is None or grazing.kind != "speed" or isinstance(problem, ReleasedProblem) or image_sign(problem) != 0.0:
        return problem, y
    solution = observed(problem, y)
    solution.result[RESULT_INDEX["speed_node"]] = grazing.flight
    return without_impact(problem, solution) or (problem, y)


def apart_from_single(problem: ForcedProblem, y: np.ndarray) -> float:
    """The difference of an orbit and its image, beside the orbit; infinity where the sequence has no such image."""
    if isinstance(problem, ReleasedProblem):
        folded = _folded(segment_of(problem, y), problem.system.has_odd_symmetry)
        return math.inf if folded is None else folded.apart
    return math.inf if image_sign(problem) == 0.0 else apart_from_image(problem, y)


def widened(single: ForcedProblem, y: np.ndarray, wide: ForcedProblem, near: np.ndarray) -> np.ndarray | None:
    """An orbit in the unknowns of the problem of twice its segment, in which one of its touches can be an impact; None where it has no such
    touch. near: an orbit of that problem."""
    if isinstance(single, ReleasedProblem):
        assert isinstance(wide, ReleasedProblem)
        whole = segment_of(single, y).twice()
        if not wide.structure.periodic:
            return whole.unknowns(wide)
        whole = whole if whole.ends == PERIODIC else whole.closed()
        turned = [whole.begun_at(impact) for impact in range(len(whole.sequence))]
        return _nearest([one.unknowns(wide) for one in turned if one.sequence == tuple(wide.sequence)], wide, near)
    plain, doubled = (full_period if single.half else twice)(single, y)
    if plain.sequence == wide.sequence:
        return doubled
    found, touching = [], observed(plain, doubled)
    for repeat in (0, single.inner + 1):
        touching.result[RESULT_INDEX["clearance_flight"]] = (int(touching["clearance_flight"]) + repeat) % (plain.inner + 1)
        made, begun = with_touch(plain, touching)
        for _ in made.sequence:
            if made.sequence == wide.sequence:
                found.append(begun)
            made, begun = later(made, begun)
    return _nearest(found, wide, near)


def _nearest(found: list[np.ndarray], problem: ForcedProblem, near: np.ndarray) -> np.ndarray | None:
    """The orbit whose nodes are nearest to those of another one."""
    return min(found, key=lambda one: float(np.abs(problem.nodes(one) - problem.nodes(near)).max()), default=None)
