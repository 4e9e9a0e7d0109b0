"""Further responses of a chart: at levels of the second parameter, from simulations between the curves, along the first one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from branches.curves.record import BifurcationCurve
from branches.forced.branch import ForcedBranch
from branches.forced.identity import invariants
from branches.forced.known import kind_of
from branches.forced.onwards import Onwards, ResponseStart, follow_onwards, trace_start
from branches.forced.primitive import primitive_orbit
from transitions.basin.identity import orbits_at
from transitions.chart.plan import ChartPlan
from transitions.response.starting import Periodic, settled_orbit
from transitions.sweep.settle import settle

__all__ = ["follow_level", "places_between"]

PLACES = 3
"""Values of the first parameter at which motions are simulated on a level."""

MOST_BRANCHES = 6
"""Most families that are followed from one simulated motion."""

THROUGH = ("LB", "GR", "SB", "PD")
"""Events behind which they are followed."""

_SAME = 1e-6


def places_between(curves: Sequence[BifurcationCurve], level: float, interval: tuple[float, float]) -> list[float]:
    """The middles of the widest intervals between curves on a level of the second parameter, the widest first."""
    crossings = [*interval]
    for curve in curves:
        x, off = curve.parameters[:, 0], curve.parameters[:, 1] - level
        k = np.flatnonzero(off[:-1] * off[1:] < 0.0)
        crossings += (x[k] + off[k] / (off[k] - off[k + 1]) * (x[k + 1] - x[k])).tolist()
    ends = np.unique(np.clip(crossings, *interval))
    widths = np.diff(ends)
    return [0.5 * float(ends[k] + ends[k + 1]) for k in np.argsort(-widths, kind="stable")[:PLACES].tolist()]


def follow_level(
    plan: ChartPlan, level: float, curves: Sequence[BifurcationCurve], on_point: Callable[[int], object] | None = None
) -> tuple[list[ForcedBranch], list[str]]:
    """Follow responses along the first parameter on a level of the second one.

    Parameters
    ----------
    plan : ChartPlan
    level : float
    curves : sequence of BifurcationCurve
        Motions are simulated between these.
    on_point : callable, optional
        Called with the number of points of a branch.

    Returns
    -------
    list of ForcedBranch, list of str
        And why a simulated motion has no branch, or not all of them.
    """
    branches: list[ForcedBranch] = []
    notes: list[str] = []
    interval = plan.window[0]
    for place in places_between(curves, level, interval):
        families = Onwards()
        try:
            found = _settled(plan, place, level)
            if not _is_known(branches, found):
                start = ResponseStart(found.problem, found.y)
                follow_onwards(
                    [start], lambda one: trace_start(one, interval, on_point=on_point), through=THROUGH, most=MOST_BRANCHES, found=families
                )
        except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            notes.append(f"the motion from rest at {plan.names[0]} = {place:.6g}, {plan.names[1]} = {level:.6g}: {error}")
        branches += families.branches
    return branches, notes


def _settled(plan: ChartPlan, place: float, level: float) -> Periodic:
    """The orbit on which the motion from rest settles; a ValueError or a RuntimeError where there is none that can be followed."""
    path = plan.path({**plan.start, plan.names[0]: place, plan.names[1]: level})
    system, forces = path.parametric.system(path.values), path.parametric.forces(path.values)
    found = settled_orbit(path, settle(system, forces, most=plan.periods))
    problem, y = primitive_orbit(found.problem, found.y)
    return Periodic(problem, y, found.distance)


def _is_known(branches: Sequence[ForcedBranch], found: Periodic) -> bool:
    """Whether an orbit, or an image of it, is on a branch."""
    kind, numbers = kind_of(found.problem), invariants(found.problem, found.y)
    same = [branch for branch in branches if kind_of(branch.problem) == kind]
    try:
        orbits = orbits_at(same, found.problem.parameters(found.y))
    except ValueError:
        return False
    scale = np.maximum(1.0, np.abs(numbers))
    return any(np.abs((invariants(one.problem, one.unknowns) - numbers) / scale).max() < _SAME for one in orbits)
