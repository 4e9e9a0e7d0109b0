"""How the cost grows: a point against impacts and degrees of freedom, a discovery against its period bound."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from branches.discovery.search import discover
from bvp.cycle import cycle_of
from bvp.multipliers import saddle_point_multipliers
from bvp.multipoint import MultipointProblem
from bvp.system import ImpactSystem, Stop
from saltus.bench import backbone, cases
from saltus.bench.effort import Effort

__all__ = ["chain", "growth"]

Row = dict[str, object]

STEP = 1e-3
ENERGY = 1.0
IMPACTS = 10


def growth(effort: Effort) -> Iterator[Row]:
    """Rows of the growth of cost, one after another; each has `growth`, what it is measured against, and `value`."""
    for inner in effort.impacts:
        yield _point("impacts", inner, *cases.segment(cases.system(), inner), effort.repeat)
    for degrees in effort.degrees:
        system = chain(degrees)
        yield _point("degrees of freedom", degrees, *cases.segment(system, 0, physical_period(system)), effort.repeat)
    for period in effort.periods:
        search = partial(discover, cases.system(), ENERGY, quarter_period=period, impacts=IMPACTS)
        found = search()
        seconds = _least(search, effort.repeat)
        row: Row = {"growth": "quarter period", "value": period, "seconds": seconds}
        yield {**row, "orbits": len(found.orbits), "settled": found.settled}


def chain(degrees: int) -> ImpactSystem:
    """A chain of unit masses, each on a spring to the ground and coupled to the next, with a small mass in a cavity of the first.

    Parameters
    ----------
    degrees : int
        Degrees of freedom, 2 or more; with 2 it is the reference system.
    """
    stiffness = np.diag([cases.SIGMA, 1.0 + cases.SIGMA, *[1.0] * (degrees - 2)])
    stiffness[0, 1] = stiffness[1, 0] = -cases.SIGMA
    for i in range(1, degrees - 1):
        stiffness[i : i + 2, i : i + 2] += [[1.0, -1.0], [-1.0, 1.0]]
    gap = (1.0, -1.0, *[0.0] * (degrees - 2))
    return ImpactSystem(np.diag([cases.MU, *[1.0] * (degrees - 1)]), np.zeros((degrees, degrees)), stiffness, (Stop(gap, -1.0, 1.0),))


def physical_period(system: ImpactSystem) -> float:
    """The first quarter period of a grid at which the orbit of one impact a half period stays within the stops.

    Raises
    ------
    RuntimeError
        Where there is none.
    """
    for alpha in np.linspace(0.3, 0.6, 31):
        if backbone.is_physical(system, float(alpha)):
            return float(alpha)
    raise RuntimeError("no orbit of one impact a half period within the stops was found")


def _point(against: str, value: int, problem: MultipointProblem, y: np.ndarray, repeat: float) -> Row:
    """Seconds of a step with all that is known of its point, of one without, and of the multipliers by the saddle-point matrix."""
    here = problem.step(y, np.zeros(2 * problem.unknowns), 0.0)
    if here is None:
        raise RuntimeError(f"the start at {value} {against} was not found")
    there = problem.step(here.y, here.tangent, STEP)
    if there is None:
        raise RuntimeError(f"the step at {value} {against} was not made")
    cycle = cycle_of(problem, there.y)
    return {
        "growth": against,
        "value": value,
        "seconds": _least(lambda: problem.step(here.y, here.tangent, STEP), repeat),
        "orbit_only": _least(lambda: problem.step(here.y, here.tangent, STEP, full=False), repeat),
        "saddle_point": _least(lambda: saddle_point_multipliers(cycle), repeat),
        "residual": there["residual"],
    }


def _least(work: Callable[[], object], repeat: float) -> float:
    """Least processor time of a work that is repeated for so long, five times at least: other work beside does not enter."""
    times: list[float] = []
    while len(times) < 5 or sum(times) < repeat:
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return min(times)
