"""How the cost grows: a point against impacts and degrees of freedom, a discovery against its period bound."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from branches.discovery.search import discover
from branches.family import Family
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
SPELL = 2e-3
"""Seconds of work for which the clock is asked once."""


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
        row: Row = {"growth": "quarter period", "value": period, **_least({"seconds": search}, effort.repeat)}
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
    """Seconds of a step of its family, with all test functions; of the orbit alone; and of the multipliers by the saddle-point matrix.

    Steps are taken one at a time: for more than two degrees of freedom the engine has no blocks of them.
    """
    here = problem.step(y, np.zeros(2 * problem.unknowns), 0.0)
    if here is None:
        raise RuntimeError(f"the start at {value} {against} was not found")
    there = problem.step(here.y, here.tangent, STEP)
    if there is None:
        raise RuntimeError(f"the step at {value} {against} was not made")
    family, cycle = Family(problem), cycle_of(problem, there.y)
    works = {
        "seconds": lambda: family.step(here.y, here.tangent, STEP),
        "orbit_only": lambda: problem.step(here.y, here.tangent, STEP, full=False),
        "saddle_point": lambda: saddle_point_multipliers(cycle),
    }
    return {"growth": against, "value": value, **_least(works, repeat), "residual": there["residual"]}


def _least(works: Mapping[str, Callable[[], object]], repeat: float) -> dict[str, float]:
    """Least processor time of each of some works. They are done in turn, so that what else the machine does meets all of them, for so many
    seconds each, five times at least; short ones many at a time, for a clock that is asked too often stands still at times."""
    many = {name: max(1, round(SPELL / max(_once(work, 1), 1e-6))) for name, work in works.items()}
    times: dict[str, list[float]] = {name: [] for name in works}
    while any(len(done) < 5 or sum(done) * many[name] < repeat for name, done in times.items()):
        for name, work in works.items():
            times[name].append(_once(work, many[name]))
    return {name: min(done) for name, done in times.items()}


def _once(work: Callable[[], object], many: int) -> float:
    """Processor time of a work, from doing it so many times."""
    began = time.process_time()
    for _ in range(many):
        work()
    return (time.process_time() - began) / many
