"""The attractors in the cells of a chart, by simulation: from rest, and from the attractors of the cells beside it.

Rows of cells are simulated beside each other. In the first round each cell starts at rest, and takes over the attractors of its neighbours
in the row. In each further round it takes over those that the round before has found in the rows above and below. An attractor is taken
over where none of its kind is known. So the result depends neither on the number of processes nor on their order.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bvp.forcing import Force
from bvp.parameters import ParametricSystem
from bvp.system import ImpactSystem
from transitions.basin.identity import attractor_of
from transitions.chart.plan import ChartPlan
from transitions.chart.regions import MotionKind, Regions, kind_of_attractor
from transitions.response.path import ParameterPath
from transitions.sweep.forced import Carried, carried_into
from transitions.sweep.settle import settle
from transitions.tasks import completed

__all__ = ["find_regions"]

ROUNDS = 4
"""Most rounds."""

MOST_STARTS = 4
"""Most attractors of neighbours that a cell takes over."""


class _Row(NamedTuple):
    """A row of cells to be simulated, for a process: the line in the first parameter, the values on it, and the most periods."""

    parametric: ParametricSystem
    names: tuple[str, ...]
    keep: tuple[str, ...]
    values: dict[str, float]
    along: np.ndarray
    periods: int


@dataclass
class _Cell:
    """A cell on the way. motions: a state at phase 0 of one attractor of each kind. tried: kinds that were taken over."""

    motions: dict[MotionKind, np.ndarray] = field(default_factory=dict)
    tried: set[MotionKind] = field(default_factory=set)
    reason: str = ""
    simulated: int = 0
    unsettled: int = 0


_Cells = list[_Cell]


def find_regions(
    plan: ChartPlan, executor: Executor | None = None, on_progress: Callable[[int], object] | None = None
) -> tuple[Regions, bool]:
    """Simulate the attractors in the cells of a chart.

    Parameters
    ----------
    plan : ChartPlan
    executor : Executor, optional
        Of processes that simulate rows; by default they are simulated here.
    on_progress : callable, optional
        Called with the number of motions that were simulated.

    Returns
    -------
    Regions, bool
        And whether Ctrl-C came: the rows that were not done have no attractors then.
    """
    nx, ny = plan.grid
    x, y = plan.middles(0, nx), plan.middles(1, ny)
    names = (plan.names[0], *plan.names[2:])
    rows = [_Row(plan.parametric, names, tuple(plan.keep), {**plan.start, plan.names[1]: value}, x, plan.periods) for value in y.tolist()]
    cells: list[_Cells] = [[] for _ in rows]
    given: list[list[dict[MotionKind, np.ndarray]]] = [[{} for _ in range(nx)] for _ in rows]
    interrupted = False
    try:
        for _ in range(ROUNDS):
            known = [[set(cell.motions) for cell in line] for line in cells]
            todo = [j for j in range(ny) if not cells[j] or any(given[j])]
            for k, line in completed(_simulate_row, [(rows[j], cells[j], given[j]) for j in todo], executor):
                cells[todo[k]] = line
                if on_progress is not None:
                    on_progress(sum(cell.simulated for line in cells for cell in line))
            new = [
                [
                    {kind: state for kind, state in cell.motions.items() if not before or kind not in before[i]}
                    for i, cell in enumerate(line)
                ]
                for line, before in zip(cells, known, strict=True)
            ]
            given = [[_beside(new, cells, j, i) for i in range(nx)] for j in range(ny)]
            if not any(any(line) for line in given):
                break
    except KeyboardInterrupt:
        interrupted = True
    return _regions(x, y, cells), interrupted


def _beside(new: Sequence[Sequence[dict[MotionKind, np.ndarray]]], cells: Sequence[_Cells], j: int, i: int) -> dict[MotionKind, np.ndarray]:
    """What a cell takes over from the rows above and below."""
    found: dict[MotionKind, np.ndarray] = {}
    for other in (j - 1, j + 1):
        if 0 <= other < len(new):
            own = cells[j][i]
            found |= {
                kind: state
                for kind, state in new[other][i].items()
                if kind not in own.motions and kind not in own.tried and kind not in found
            }
    return found


def _simulate_row(row: _Row, cells: _Cells, given: list[dict[MotionKind, np.ndarray]]) -> _Cells:
    """A row of cells with what it takes over, or from rest where it has none; then attractors are passed on along it, both ways."""
    first, count = not cells, len(row.along)
    cells = cells or [_Cell() for _ in range(count)]
    settlers = [_Settler(row, float(value)) for value in row.along]
    for way in (1, -1):
        order = range(count)[::way]
        for i in order:
            cell = cells[i]
            if first and way == 1:
                settlers[i].settle_into(cell, None)
            for kind, state in given[i].items() if way == 1 else ():
                settlers[i].take_over(cell, kind, state)
            if 0 <= i - way < count:
                for kind, state in list(cells[i - way].motions.items()):
                    settlers[i].take_over(cell, kind, state)
    return cells


class _Settler:
    """Simulates the motions of one cell."""

    def __init__(self, row: _Row, value: float) -> None:
        self._row, self._value = row, value

    @cached_property
    def _motion(self) -> tuple[ParameterPath, ImpactSystem, Sequence[Force]] | None:
        """The path, the system and the loads of the cell; None if the system cannot have its parameters."""
        row = self._row
        try:
            path = ParameterPath(row.parametric, row.names, row.keep, {**row.values, row.names[0]: self._value}).at()
            if path.parametric.violation(path.values) is not None:
                return None
            return path, path.parametric.system(path.values), path.parametric.forces(path.values)
        except ValueError:
            return None

    def take_over(self, cell: _Cell, kind: MotionKind, state: np.ndarray) -> None:
        """Simulate from an attractor of a neighbour, if the cell has none of its kind."""
        if kind in cell.motions or kind in cell.tried or len(cell.tried) >= MOST_STARTS:
            return
        cell.tried.add(kind)
        self.settle_into(cell, state)

    def settle_into(self, cell: _Cell, state: np.ndarray | None) -> None:
        """Simulate from a state at phase 0, or from rest, and add what it settles to."""
        if self._motion is None:
            cell.reason = "the system cannot have these parameters"
            return
        path, system, forces = self._motion
        cell.simulated += 1
        n = system.degrees_of_freedom
        u = v = None
        if state is not None:
            inside = carried_into(system, Carried(state))[0].state
            u, v = inside[:n], inside[n:]
        found = settle(system, forces, u, v, most=self._row.periods)
        attractor = attractor_of(path, found)
        if attractor is None:
            cell.unsettled += 1
            cell.reason = cell.reason or found.kind.value
            return
        sticks = 0.0 < found.sticking_time and not found.sticking
        cell.motions.setdefault(kind_of_attractor(attractor, len(found.impacts), sticks), found.states[0])


def _regions(x: np.ndarray, y: np.ndarray, cells: Sequence[_Cells]) -> Regions:
    """The result, also of rows that were not simulated."""
    lines = [line or [_Cell(reason="not simulated") for _ in x] for line in cells]
    return Regions(
        x=x, y=y, found=tuple(tuple(frozenset(cell.motions) for cell in line) for line in lines),
        reasons=Counter(cell.reason for line in lines for cell in line if not cell.motions),
        simulated=sum(cell.simulated for line in lines for cell in line),
        unsettled=sum(cell.unsettled for line in lines for cell in line),
    )  # fmt: skip
