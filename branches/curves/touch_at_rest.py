"""Where a curve of grazings of free orbits ends because the touch has come to an end at rest, and meets its image."""

from __future__ import annotations

import numpy as np

from branches.curves.ends import BLURRED, REACH, End, Follow, is_singular
from branches.curves.grazing import Grazing
from branches.curves.record import BifurcationCurve
from branches.curves.single_orbits import Narrow
from branches.released.segments import segment_of
from bvp.kernels.multipoint import REST
from bvp.released import ReleasedProblem

__all__ = ["touch_at_rest"]

_NEAR_REST = 0.05
"""Part of the segment between a touch and an end at rest up to which the point where they meet is looked for."""


def touch_at_rest(curve: BifurcationCurve, last: bool, follow: Follow) -> End | None:
    """The end where a touch beside an end at rest has come there, and meets its image. The time between them goes as the root of the
    distance along the curve, and its equations are singular. The point is also on the curve of orbits that touch the stop at rest: there
    the gap has no acceleration."""
    if not is_singular(curve, last):
        return None
    rows = curve.unknowns[:: -1 if last else 1, : curve.plane.size]
    left, narrow = 0, _touching(curve, rows[0])
    while narrow is not None and narrow.apart <= BLURRED and left + 2 < len(rows):
        left += 1
        narrow = _touching(curve, rows[left])
    if narrow is None or not BLURRED < narrow.apart <= _NEAR_REST:
        return None
    base = follow(narrow, curve)
    if base is None:
        return None
    problem, single = curve.plane.problem, base.plane.problem
    assert isinstance(problem, ReleasedProblem) and isinstance(single, ReleasedProblem)
    here = curve.parameters[::-1][left] if last else curve.parameters[left]
    for event in base.events:
        distance = float(np.abs(base.parameters[event.point] / here - 1.0).max())
        if event.type == "GR-GR" and distance <= REACH * narrow.apart**2:
            touching = segment_of(single, base.unknowns[event.point, : base.plane.size]).resting(problem.kinds[1] == REST)
            return End(base, event, touching.unknowns(problem), left, "the touch has come to the end at rest, where it meets its image")
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
