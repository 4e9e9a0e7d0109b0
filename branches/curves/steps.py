"""Curves of bifurcations of orbits whose steps are compiled."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from branches.curves.grazing import Grazing
from branches.curves.kernels import (
    CONTRACTION,
    CONVERGED,
    DURATION,
    ITERATIONS,
    RESIDUAL,
    SINGULAR,
    SPEED,
    TURN,
    CurveArrays,
    CurveData,
    take_curve_step,
)
from branches.curves.pencils import RowsCondition, whole_rows
from branches.curves.plane import LEAST, ParameterPlane
from bvp.kernels import curvature
from bvp.kernels.forced import forced_step
from bvp.kernels.multipoint import RESULT
from bvp.kernels.newton import LINEARISED
from bvp.kernels.step import Landing, Request
from continuation import curves
from continuation.curves import Condition, Corrected, Curve, Held, Linearised, Monitor, Null

__all__ = ["CompiledCurve", "curve_of"]

_KINDS = {"speed": SPEED, "flight": DURATION}
"""Grazings whose condition is compiled."""


def curve_of(plane: ParameterPlane, condition: Condition, monitor: Monitor, grazing: Grazing | None = None) -> Curve:
    """A curve of orbits; its steps are compiled where its flights are linear and its condition is a compiled one."""
    if grazing is None:
        known = isinstance(condition, RowsCondition)
    else:
        known = grazing.kind in _KINDS and grazing.flight <= plane.problem.inner
    compiled = known and plane.problem.curvature.is_compiled
    return CompiledCurve(plane, condition, monitor, grazing) if compiled else Curve(plane, condition, monitor)


class CompiledCurve(Curve):
    """A curve of orbits with linear flights: of SN, PD, SB, NS, or of grazings. Its points are those of `Curve`.

    Parameters
    ----------
    plane : ParameterPlane
    condition : Condition
        A `branches.curves.pencils.RowsCondition`, or one of `branches.curves.grazing.grazing_condition`.
    monitor : Monitor
    grazing : Grazing, optional
        What grazes: an impact without speed, or a flight without duration.
    """

    def __init__(self, plane: ParameterPlane, condition: Condition, monitor: Monitor, grazing: Grazing | None = None):
        super().__init__(plane, condition, monitor)
        self.plane, self.order = plane, 1 + condition.own
        self._kind, self._flight = (SINGULAR, 0) if grazing is None else (_KINDS[grazing.kind], grazing.flight)
        self._rows, self._multiplier = whole_rows(plane, np.zeros((plane.size, plane.size))), math.nan
        if isinstance(condition, RowsCondition):
            self._rows = condition.rows
            self._multiplier = math.nan if condition.multiplier is None else condition.multiplier

    @cached_property
    def _data(self) -> CurveData:
        plane, problem, rows = self.plane, self.plane.problem, self._rows
        u, other = plane.size, rows.other or problem
        landing = Landing(np.zeros(u), np.zeros(2 * u), np.zeros(len(RESULT)))
        metric, zero, bending = np.zeros((4, problem.coordinates)), np.zeros(2 * u), problem.curvature.bending
        request = Request(0.0, math.nan, LINEARISED)
        step = forced_step.entry(problem.segment, problem._factor, landing.y, zero, request, metric, landing).address
        bend = curvature.second_along.entry(bending, landing.y, landing.y, np.zeros((u - 1, u))).address
        return CurveData(
            step, bend, problem.segment, problem._factor, bending, other.segment, other._factor, other.curvature.bending,
            rows.source, rows.constant, rows.freed, landing, metric, zero, self._kind, rows.shifted, self._multiplier, self._flight,
            plane.place, LEAST, curves.SETTLED, curves.ROUNDING, curves.ITERATIONS,
        )  # fmt: skip

    @cached_property
    def _arrays(self) -> CurveArrays:
        u, d = self.plane.size, self.order
        m, s = u + d - 1, d * u
        return CurveArrays(
            np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(5), np.zeros(u - 1), np.zeros((u, u)), np.zeros(d), np.zeros((d, m)),
            np.zeros((d, s + d)), np.zeros((d, s + d)), np.zeros(2 * d * s), np.zeros((s, u)), np.zeros((u, u)), np.zeros((2, u, u)),
            np.zeros((s + d, s + d)), np.zeros((m, m)), np.zeros(s + d, dtype=np.int64), np.zeros(m), np.zeros(m),
            np.zeros(self.plane.problem.coordinates), np.zeros(u), np.zeros(u), np.zeros(u),
        )  # fmt: skip

    def corrected(self, y: np.ndarray, tangent: np.ndarray, ds: float) -> Corrected | None:
        """See `Curve`."""
        arrays, u, s = self._arrays, self.plane.size, self.order * self.plane.size
        take_curve_step(self._data, np.array(y, dtype=float), np.array(tangent, dtype=float), float(ds), arrays)
        result = arrays.result.tolist()
        if result[CONVERGED] != 1.0:
            return None
        new, residual, rows, scale = arrays.y.copy(), arrays.residual.copy(), arrays.rows.copy(), arrays.scale[:u].copy()
        at = Linearised(new[:u], residual[:-1], rows[:-2], self.plane.parameters(new, residual), rows[-2:], rows)
        values, gradient = arrays.values.copy(), arrays.gradient.copy()
        if self._kind == SINGULAR:
            right, left = arrays.right[:, :s].T.copy(), arrays.left[:, :s].T.copy()
            null = Null(arrays.held.copy(), right, left, self._data.shifted * scale, arrays.slopes.copy())
            held = Held(values, gradient, arrays.borders.copy(), null)
        else:
            held = Held(values, gradient, np.zeros(0))
        return Corrected(
            new, at, held, arrays.tangent.copy(), scale, result[TURN], result[CONTRACTION], int(result[ITERATIONS]), result[RESIDUAL]
        )
