"""Where a curve of doubled orbits, or of orbits without symmetry, ends at the orbits that they emanate from.

A curve SN of doubled orbits ends at a generalised period doubling, one of orbits without symmetry at a degenerate pitchfork. One of
another bifurcation ends where that meets the doubling, or the symmetry breaking, of the single orbits. A curve of their grazings ends
where the doubling, or the symmetry breaking, grazes itself. There the equations of the wider problem are singular, and steps fail nearby.
The point is located on the curve PD, or SB, of the single orbits, where it is regular.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from branches.curves.extending import numbered, reversed_curve
from branches.curves.free import BOTH, FOLD, FreeKind, names_quarter_period
from branches.curves.free_points import event_of
from branches.curves.grazing import Grazing, observed
from branches.curves.record import BifurcationCurve, CurveEvent
from branches.events import Ended
from branches.forced.primitive import apart_from_image, full_period, image_sign, twice
from branches.forced.resequencing import later, with_touch, without_impact
from branches.released.segments import Segment, segment_of
from branches.sequences import PERIODIC
from bvp.forced import ForcedProblem
from bvp.kernels.multipoint import REST
from bvp.multipoint import RESULT_INDEX
from bvp.released import ReleasedProblem

__all__ = ["Narrow", "narrowed", "with_collapsed_ends", "without_grazing"]

_APART = 0.2
"""Difference of an orbit and its image, beside the orbit, up to which the point where they are one is looked for."""

_BLURRED = 1e-4
"""The same difference, below which the wider equations show events that are rounding."""

_NEAR_REST = 0.05
"""Part of the segment between a touch and an end at rest up to which the point where they meet is looked for."""

_REACH = 10.0
"""Distance of that point in the parameters, relative, in squares of that difference; along a grazing in such differences."""

_ROOT = 1.5e-8
"""The root of rounding, to which the equations of the wider orbits determine that point."""

_SINGULAR = ("GR-GR", "DP", "GPD", "R2", "FF", "PN")
"""Events at which the equations can be singular, so that they are not located."""

_MEETINGS = {"SB": ("R2",), "PD": ("FF",), "NS": ("FF", "PN")}
"""The events of the single orbits at which another curve than of folds or grazings ends."""


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
    try:
        if doubled:
            single = problem.sibling(first, load_periods=problem.load_periods // 2, values=values)
        else:
            single = problem.sibling(first, half=True, values=values)
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
    return Narrow(single, half.unknowns(single), code, found.apart, FreeKind(_FAR, again is not None and again.apart < _APART))


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
    return min(found, key=lambda one: one.apart, default=None)


def with_collapsed_ends(curve: BifurcationCurve, follow: Callable[[Narrow, BifurcationCurve], BifurcationCurve | None]) -> BifurcationCurve:
    """A curve whose ends at the orbits that it emanates from are located there.

    Parameters
    ----------
    curve : BifurcationCurve
    follow : callable
        Gives the curve PD or SB of the single orbits near a place.
    """
    free = curve.free
    if curve.closed or (free is not None and free.symmetry == FOLD and names_quarter_period(curve.plane) and not free.in_energy):
        return curve
    for last in (False, True):
        end = _collapse(curve, last, follow) or _touch_at_rest(curve, last, follow)
        curve = curve if end is None else _ending(curve, last, end)
    return curve


class _End(NamedTuple):
    """An end of a curve at an event of another one: that curve, the event, the orbit there in the unknowns of the first curve, how many of
    its points are left out, and what happens."""

    base: BifurcationCurve
    event: CurveEvent
    y: np.ndarray
    left: int
    note: str


def _collapse(
    curve: BifurcationCurve, last: bool, follow: Callable[[Narrow, BifurcationCurve], BifurcationCurve | None]
) -> _End | None:
    """The end at the single orbits; None where there is none."""
    place = len(curve) - 1 if last else 0
    stopped = next((event for event in curve.events if event.point == place), None)
    singular = stopped if stopped is not None and stopped.type in _SINGULAR else None
    if curve.ended[int(last)].reason != "MINIMUM_STEP" and singular is None:
        return None
    unknowns = curve.unknowns[:, : curve.plane.size]
    narrow = narrowed(*without_grazing(curve, unknowns[place]))
    if narrow is None or narrow.apart > _APART:
        return None
    near = narrow.apart < _BLURRED
    if singular is not None and singular.status == "located" and not near:
        return None
    base = follow(narrow, curve)
    if base is None:
        return None
    wanted = _MEETINGS.get(curve.code) or {"PD": ("GPD", "PD-GR"), "SB": ("DP", "SB-GR")}[narrow.code]
    here = curve.parameters[place]
    found = [(float(np.abs(base.parameters[event.point] / here - 1.0).max()), event) for event in base.events if event.type in wanted]
    distance, event = min(found, key=lambda one: one[0], default=(math.inf, None))
    # The orbits part from their image as the root of the distance from a doubling. On a grazing they do in proportion to that from its end.
    reach = narrow.apart if near and curve.grazing is not None else narrow.apart**2
    if event is None or not distance <= _REACH * reach + _ROOT:
        return None
    rows = unknowns[::-1] if last else unknowns
    blurred = next((k for k, y in enumerate(rows) if not _apart(*without_grazing(curve, y)) < _BLURRED), len(curve))
    left = min(max(blurred, int(stopped is not None)), len(curve) - 1)
    whole = _widened(base.plane.problem, base.unknowns[event.point, : base.plane.size], curve.plane.problem, rows[left])
    words = "are symmetric" if base.code == "SB" else "are those of half the period, traversed twice"
    named = {
        "GPD": ": generalised period doubling", "DP": ": degenerate pitchfork",
        "PD-GR": ": their doubling grazes", "SB-GR": ": their symmetry breaking grazes",
    }  # fmt: skip
    note = f"the orbits {words}{named.get(event.type, f', with {event.note}')}"
    return None if whole is None else _End(base, event, whole, left, note)


def _touch_at_rest(
    curve: BifurcationCurve, last: bool, follow: Callable[[Narrow, BifurcationCurve], BifurcationCurve | None]
) -> _End | None:
    """The end where a touch beside an end at rest has come there, and meets its image. The time between them goes as the root of the
    distance along the curve, and its equations are singular. The point is also on the curve of orbits that touch the stop at rest: there
    the gap has no acceleration."""
    place = len(curve) - 1 if last else 0
    stopped = any(event.point == place and event.type in _SINGULAR for event in curve.events)
    if not stopped and curve.ended[int(last)].reason != "MINIMUM_STEP":
        return None
    rows = curve.unknowns[:: -1 if last else 1, : curve.plane.size]
    left, narrow = 0, _touching(curve, rows[0])
    while narrow is not None and narrow.apart <= _BLURRED and left + 2 < len(rows):
        left += 1
        narrow = _touching(curve, rows[left])
    if narrow is None or not _BLURRED < narrow.apart <= _NEAR_REST:
        return None
    base = follow(narrow, curve)
    if base is None:
        return None
    problem, single = curve.plane.problem, base.plane.problem
    assert isinstance(problem, ReleasedProblem) and isinstance(single, ReleasedProblem)
    here = curve.parameters[::-1][left] if last else curve.parameters[left]
    for event in base.events:
        distance = float(np.abs(base.parameters[event.point] / here - 1.0).max())
        if event.type == "GR-GR" and distance <= _REACH * narrow.apart**2:
            touching = segment_of(single, base.unknowns[event.point, : base.plane.size]).resting(problem.kinds[1] == REST)
            return _End(base, event, touching.unknowns(problem), left, "the touch has come to the end at rest, where it meets its image")
    return None


def _touching(curve: BifurcationCurve, y: np.ndarray) -> Narrow | None:
    """An orbit that touches a stop beside an end at rest, as one that touches it there; None where it has no such touch."""
    problem, grazing = curve.plane.problem, curve.grazing
    if not isinstance(problem, ReleasedProblem) or grazing is None or grazing.kind != "speed" or not problem.inner:
        return None
    far = problem.kinds[1] == REST and grazing.flight == problem.inner - 1
    if not far and not (problem.kinds[0] == REST and grazing.flight == 0):
        return None
    whole = segment_of(problem, y)
    single = whole.stopped(far)
    try:
        made = single.problem(problem, y)
    except ValueError:
        return None
    apart = float(whole.times[-1 if far else 0] / np.sum(whole.times))
    return Narrow(made, single.unknowns(made), "GR", apart, None, Grazing("speed", made.inner if far else made.inner + 1))


def without_grazing(curve: BifurcationCurve, y: np.ndarray) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit of a curve. The impact that grazes is left out where its image is none: it hides what else the orbit and its image share."""
    problem, grazing = curve.plane.problem, curve.grazing
    if grazing is None or grazing.kind != "speed" or isinstance(problem, ReleasedProblem) or image_sign(problem) != 0.0:
        return problem, y
    solution = observed(problem, y)
    solution.result[RESULT_INDEX["speed_node"]] = grazing.flight
    return without_impact(problem, solution) or (problem, y)


def _apart(problem: ForcedProblem, y: np.ndarray) -> float:
    """The difference of an orbit and its image, beside the orbit; infinity where the sequence has no such image."""
    if isinstance(problem, ReleasedProblem):
        folded = _folded(segment_of(problem, y), problem.system.has_odd_symmetry)
        return math.inf if folded is None else folded.apart
    return math.inf if image_sign(problem) == 0.0 else apart_from_image(problem, y)


def _ending(curve: BifurcationCurve, last: bool, at: _End) -> BifurcationCurve:
    """The curve with the point of an event of another curve as its end, in place of some points."""
    if not last:
        return reversed_curve(_ending(reversed_curve(curve), True, at))
    stop, u = len(curve) - at.left, curve.plane.size
    position, near, place = curve.plane.position, curve.unknowns[stop - 1], at.base.parameters[at.event.point]
    length = float(curve.arclength[stop - 1]) + float(np.linalg.norm(position(at.y) - position(near[:u])))
    new = {
        "unknowns": np.concatenate([at.y, near[u:]]), "tangents": curve.tangents[stop - 1], "parameters": place,
        "arclength": length, "residual": at.base.residual[at.event.point], "multipliers": np.full(curve.multipliers.shape[1], np.nan),
        "coefficient": math.nan,
    }  # fmt: skip
    columns: dict[str, Any] = {
        name: np.concatenate([column := getattr(curve, name)[:stop], np.asarray(row, column.dtype)[None]]) for name, row in new.items()
    }
    end = at.event._replace(point=stop, arclength=length, bracket=(length, length), note=at.note)
    where = " and ".join(f"{name} = {value:.12g}" for name, value in zip(curve.names, place, strict=True))
    return replace(
        curve, **columns,
        events=numbered([*(one for one in curve.events if one.point < stop), end]),
        ended=(curve.ended[0], Ended("EVENT", f"{at.event.type} at {where}: {at.note}")),
        start=min(curve.start, stop - 1),
    )  # fmt: skip


def _widened(single: ForcedProblem, y: np.ndarray, wide: ForcedProblem, near: np.ndarray) -> np.ndarray | None:
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
