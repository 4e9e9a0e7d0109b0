"""The curves of a chart: from the events of responses, through points of codimension two, each followed once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from branches.curves.record import BifurcationCurve, CurveEvent
from branches.curves.starting import CURVES, CurveStart, NoCurve, curve_start
from branches.curves.switching import curve_through, single_orbit
from branches.curves.tracing import follow_curve
from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.primitive import primitive_orbit
from bvp.forced import ForcedProblem
from transitions.chart.known import KnownCurves
from transitions.chart.plan import ChartPlan

__all__ = ["CurveSearch", "Stage"]

_OTHERS = {
    "R1": {"SN": ("NS",), "NS": ("SN",)},
    "R2": {"PD": ("NS",), "SB": ("NS",), "NS": ("PD",)},
    "FN": {"SN": ("NS",), "NS": ("SN",)},
    "FF": {"SN": ("PD",), "PD": ("SN",), "SB": ("SN",)},
    "PN": {"PD": ("NS",), "SB": ("NS",), "NS": ("PD",)},
    "NN": {"NS": ("NS",)},
    "GPD": {"PD": ("SN",)},
    "DP": {"SB": ("SN",)},
}
"""Types of the curves through a point of codimension two on a curve of some type. PD stands for SB where half the period is solved."""

_LEAST = 3
"""Least points of a curve."""


def _others_at(curve: BifurcationCurve, event: CurveEvent) -> list[str]:
    """Types of the other curves that can pass through a point of codimension two."""
    single = single_orbit(curve, event.point)
    if single is not None:
        return [single.code]
    if event.type.endswith("-GR"):
        return ["GR" if curve.code != "GR" else event.type.removesuffix("-GR")]
    found = _OTHERS.get(event.type, {}).get(curve.code, ())
    return ["SB" if code == "PD" and curve.plane.problem.half else code for code in found]


class Stage(NamedTuple):
    """A stage of the search. starts: events or points that were tried; known: of them on curves that were followed already; outside: out of
    the range; failed: no curve was found; curves: new ones."""

    name: str
    starts: int = 0
    known: int = 0
    outside: int = 0
    failed: int = 0
    curves: int = 0
    left: int = 0


@dataclass
class CurveSearch:
    """The curves of a chart as they are found.

    Attributes
    ----------
    plan : ChartPlan
    curves : list of BifurcationCurve
    stages : list of Stage
    passing : dict of (int, str) to list of int
        Of an event of a curve, by the curve's number and the event's id: numbers of the other curves through it.
    notes : list of str
        Where no curve was found.
    """

    plan: ChartPlan
    on_curve: Callable[[int, BifurcationCurve], object] = lambda number, curve: None
    on_point: Callable[[int], object] | None = None
    curves: list[BifurcationCurve] = field(default_factory=list)
    stages: list[Stage] = field(default_factory=list)
    passing: dict[tuple[int, str], list[int]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    known: KnownCurves = field(default_factory=KnownCurves)
    _begun: int = 0

    def from_events(self, name: str, branches: Iterable[tuple[str, ForcedBranch]]) -> None:
        """Start a curve at each event of some branches, given with words that name them. Those of the shortest period are the first."""
        self.stages.append(Stage(name))
        for words, branch in sorted(branches, key=lambda pair: pair[1].problem.load_periods):
            for event in branch.events:
                if event.type in CURVES:
                    self._from_event(branch.problem, branch.unknowns[event.point], event, f"{event.id} {words}".rstrip())

    def _from_event(self, problem: ForcedProblem, y: np.ndarray, event: ForcedEvent, origin: str) -> None:
        values = problem.parameters(y)
        if not self.plan.contains(values):
            self._count(starts=1, outside=1)
            return
        if event.type in ("GR", "SN"):  # solved over half its period a symmetric orbit touches two stops at once
            problem, y = primitive_orbit(problem, y)
        try:
            start = curve_start(problem, y, event.type, self.plan.names, self.plan.keep, angle=event.angle, origin=origin)
        except (NoCurve, ValueError, np.linalg.LinAlgError) as error:
            self._fail(origin, error)
            return
        self._follow(start)

    def through_points(self) -> None:
        """Start the other curves at points of codimension two of all curves, also of those that are found so."""
        self.stages.append(Stage("points of codimension two"))
        while self._begun < len(self.curves):
            number = self._begun
            curve = self.curves[number]
            for event in curve.events:
                for code in _others_at(curve, event):
                    self._through(number, curve, event, code)
            self._begun += 1

    def _through(self, number: int, curve: BifurcationCurve, event: CurveEvent, code: str) -> None:
        origin = f"{event.id} of curve {number + 1}"
        try:
            start = curve_through(curve, event.point, code)._replace(origin=origin)
        except (NoCurve, ValueError, RuntimeError, StopIteration, np.linalg.LinAlgError) as error:
            self._fail(f"{origin} to {code}", error)
            return
        found = self._follow(start)
        if found is not None:
            self.passing.setdefault((number, event.id), []).append(found)

    def _follow(self, start: CurveStart) -> int | None:
        """The number of the curve of a start, which is followed if it is new."""
        try:
            first = start.curve(self.plan.window).begin(start.y)
        except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            self._fail(start.origin, error)
            return None
        known = self.known.number_at(start, first.y if first.converged else start.y)
        if known is not None:
            self._count(starts=1, known=1)
            return known
        if len(self.curves) >= self.plan.most:
            self._count(starts=1, left=1)
            return None
        try:
            curve = follow_curve(start, self.plan.window, on_point=self.on_point)
        except (NoCurve, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            self._fail(start.origin, error)
            return None
        except KeyboardInterrupt as error:
            computed = getattr(error, "branch", None)
            if computed is not None and len(computed) >= _LEAST:
                self._keep(computed)
            raise
        if len(curve) < _LEAST:
            self._fail(start.origin, NoCurve(f"the curve {start.code} there has no second point: {curve.ended[1].text}"))
            return None
        return self._keep(curve)

    def _keep(self, curve: BifurcationCurve) -> int:
        self._count(starts=1, curves=1)
        self.curves.append(curve)
        self.known.add(curve)
        self.on_curve(len(self.curves), curve)
        return len(self.curves) - 1

    def _fail(self, origin: str, error: Exception) -> None:
        self._count(starts=1, failed=1)
        self.notes.append(f"{origin}: {error}")

    def _count(self, **more: int) -> None:
        last = self.stages[-1]
        self.stages[-1] = last._replace(**{key: getattr(last, key) + value for key, value in more.items()})
