"""The branch in one parameter through a point of a curve of the absorber in the plane of two: it must have the curve's event there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from branches.curves.record import BifurcationCurve
from branches.forced.family import ForcedFamily
from branches.forced.tracing import follow_response
from bvp.forced import ForcedProblem
from tests.branches.curve_oracles import AbsorberOrbit

BESIDE = 1e-5
"""Arclength before and behind the point at which the test function of the event is computed."""

SINGULAR = ("R1", "R2", "CP", "DP")
"""Points where the branch has another event: two multipliers are critical at once, two folds meet, or the orbits get a symmetry."""


def steepest(curve: BifurcationCurve, i: int) -> int:
    """The parameter to keep at a point, 0 or 1: that which changes more along the curve there, so that the branch crosses it."""
    around = curve.parameters[min(i + 1, len(curve) - 1)] - curve.parameters[max(i - 1, 0)]
    return int(np.argmax(np.abs(around) / np.ptp(curve.parameters, axis=0)))


def critical_function(code: str, orbit: AbsorberOrbit, cosine: float) -> float:
    """What changes its sign at an event, from matrix exponentials: 1 - mu, or 1 + mu, of all multipliers, made smooth at grazings by the
    impact speeds; the modulus of the pair; the slowest impact."""
    speeds = orbit.impact_speeds()
    if code == "GR":
        return float(speeds[np.argmin(np.abs(speeds))])
    multipliers = orbit.multipliers()
    if code == "NS":
        pair = complex(cosine, np.sqrt(max(0.0, 1.0 - cosine * cosine)))
        return float(np.abs(multipliers[np.argmin(np.abs(multipliers - pair))]) - 1.0)
    return float(np.prod(1.0 - multipliers if code == "SN" else 1.0 + multipliers).real * np.prod(speeds))


def require_event(curve: BifurcationCurve, i: int) -> None:
    """The test function changes its sign along the branch, and the event that is located there has the parameter of the point.

    A located event is 1e-10 of arclength from its place. Its parameter is as near as that, and nearer at a fold, where it is quadratic."""
    problem, y = curve.plane.problem, curve.unknowns[i, : curve.plane.size]
    name = curve.names[1 - steepest(curve, i)]
    value = problem.parameters(y)[name]
    single = ForcedProblem(
        problem.parametric, problem.sequence, (name,), load_periods=problem.load_periods, half=problem.half, values=problem.parameters(y)
    )
    nodes, size = problem.nodes(y), 2 * problem.degrees_of_freedom
    family = ForcedFamily(single)
    begin = family.begin(single.pack(nodes[:, :size], nodes[:, size], [value], problem.flight_times(y)))
    where = f"{curve.code} at {curve.parameters[i]}, point {i}"
    assert begin.converged, where
    beside = [family.step(begin.y, begin.tangent, length) for length in (-BESIDE, BESIDE)]
    assert all(step.converged for step in beside), where
    tests = [critical_function(curve.code, AbsorberOrbit.of(single, step.y), float(curve.cosine[i])) for step in beside]
    assert tests[0] * tests[1] < 0.0, (where, tests)
    inside = next(step for step in beside if min(step.extra[name] for name in ("clearance", "speed", "flight")) > 0.0)
    branch = follow_response(single, inside, (value - 0.002, value + 0.002), points=20, stop_at=curve.code)
    located = [abs(event.values[name] - value) / value for event in branch.events if event.type == curve.code]
    assert min(located, default=np.inf) < 1e-9, (where, located)


def regular_points(curve: BifurcationCurve) -> Sequence[int]:
    """All points but those at which a branch has another event than the curve, or ends at the same time: `SINGULAR`, and grazing ends."""
    left = {event.point for event in curve.events if event.type in SINGULAR or event.type.endswith("-GR") and curve.code != "GR"}
    return [i for i in range(len(curve)) if i not in left]
