"""Curves that close on themselves in the plane of two parameters: the stop, or the load, depends on p^2 + q^2."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from branches.curves.files import read_curves, save_curves
from branches.curves.identity import curve_id
from branches.curves.record import BifurcationCurve
from branches.curves.starting import CurveStart, curve_at
from branches.curves.tracing import can_go_on, extend_curve, follow_curve
from branches.forced.tracing import follow_response
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.simulate import simulate
from tests.branches.curve_oracles import doubling_stop, fold_stop

WINDOW = ((-3.0, 3.0), (-3.0, 3.0))

W, SLOPE = 2.8, 0.2
"""The frequency of the load is W + SLOPE p."""

DAMPING = {"SN": 0.0, "PD": 0.0, "GR": 0.1}
CONSTANTS = {"SN": 2.0, "PD": 0.3, "GR": 6.0}
"""x <= p^2 + q^2 - constant under a load of amplitude 1; at GR a load of amplitude p^2 + q^2 + constant, and x <= 1."""


def parametric(code: str) -> ParametricSystem:
    """x'' + d x' + x = A cos(w t), x <= s, v -> -0.8 v."""
    sum_of_squares, constant = "p**2 + q**2", CONSTANTS[code]
    stop, amplitude = (1.0, f"{sum_of_squares} + {constant}") if code == "GR" else (f"{sum_of_squares} - {constant}", 1.0)
    return ParametricSystem.from_description(
        {
            "parameters": {"p": 2.0, "q": 2.0},  # units of arclength
            "system": {
                "mass": [[1.0]],
                "damping": [[DAMPING[code]]],
                "stiffness": [[1.0]],
                "stops": [{"c": [1.0], "upper": stop, "restitution": 0.8}],
            },
            "forces": [{"load": [1.0], "amplitude": amplitude, "frequency": f"{W} + {SLOPE}*p"}],
        }
    )


def exact_square(code: str, p: float) -> float:
    """q^2 on the curve, from the closed form of the fold, the period doubling or the grazing at the frequency of p."""
    w = W + SLOPE * p
    if code == "GR":
        return math.hypot(1.0 - w * w, DAMPING[code] * w) - CONSTANTS[code] - p * p
    stop = float((fold_stop if code == "SN" else doubling_stop)(w, 0.8))
    return stop + CONSTANTS[code] - p * p


def settled_problem(made: ParametricSystem, q: float) -> tuple[ForcedProblem, np.ndarray]:
    """The problem in q, and the motion that a simulation from the stop has after many periods."""
    at = made.at({"p": 0.1, "q": q})
    period = 2.0 * math.pi / (W + SLOPE * at["p"])
    motion = simulate(made.system(at), [-1.0], [0.0], 301.0 * period, forces=made.forces(at))
    late = motion.stop_events.times >= 300.0 * period
    assert late.sum() == 1
    problem = ForcedProblem(made, ["+"], ["q"], values={"p": 0.1, "q": q})
    return problem, problem.pack(motion.stop_events.after[late], motion.stop_events.times[late] / period - 300.0, [q])


@cache
def start(code: str) -> CurveStart:
    made = parametric(code)
    if code == "GR":
        problem = ForcedProblem(made, (), ("q",), values={"p": 0.1, "q": 0.1})
        found = follow_response(problem, problem.solve(problem.pack([[0.0, 0.0]], [0.0], [0.1])).y, (0.05, 3.0))
    else:
        q = math.sqrt(CONSTANTS[code] - 0.2 - 0.01)  # there the stop is at -0.2
        found = follow_response(*settled_problem(made, q), (0.0, 3.0))
    return curve_at(found, next(event for event in found.events if event.type == code), ("p", "q"))


@cache
def curve(code: str) -> BifurcationCurve:
    return follow_curve(start(code), WINDOW)


@pytest.mark.parametrize("code", ["PD"])
def test_a_closed_curve_is_that_of_its_closed_form(code):
    """Oracle: see `require_a_closed_curve_is_that_of_its_closed_form`."""
    require_a_closed_curve_is_that_of_its_closed_form(code)


def require_a_closed_curve_is_that_of_its_closed_form(code):
    """Oracle: the closed forms of fold, period doubling and grazing at the frequency of p. The curve goes round p = q = 0 once."""
    found = curve(code)
    assert found.closed and {end.reason for end in found.ended} == {"CLOSED"} and "closed" in found.ended[0].text
    p, q = found.parameters.T
    assert q * q == pytest.approx(np.array([exact_square(code, value) for value in p]), abs=1e-12)
    turn = np.unwrap(np.arctan2(q, p))
    assert abs(turn[-1] - turn[0]) == pytest.approx(2.0 * math.pi, abs=1e-9)
    assert found.unknowns[-1] == pytest.approx(found.unknowns[0], abs=1e-9)
    assert found.residual.max() < 1e-12 and not found.events


@pytest.mark.parametrize("code", ["PD"])
def test_a_closed_curve_stays_closed(code, tmp_path):
    """Oracle: see `require_a_closed_curve_stays_closed`."""
    require_a_closed_curve_stays_closed(code, tmp_path)


def require_a_closed_curve_stays_closed(code, tmp_path):
    """A file keeps the curve, and it does not go on in a wider range. Its id does not depend on where it was started."""
    found, wide = curve(code), ((-5.0, 5.0), (-5.0, 5.0))
    save_curves([found], tmp_path / "curve.json")
    (again,) = read_curves(tmp_path / "curve.json")
    assert again.closed and again.ended == found.ended and np.array_equal(again.parameters, found.parameters)
    assert not any(can_go_on(again, last, wide) for last in (False, True))
    extended = extend_curve(again, wide)
    assert extended.closed and len(extended) == len(found) and extended.ended == found.ended
    other = follow_curve(start(code)._replace(y=found.unknowns[len(found) // 3]), WINDOW)
    assert other.closed and curve_id(other) == curve_id(found)


@pytest.mark.parametrize("code", ["SN"])
def test_an_open_piece_closes(code):
    """Oracle: see `require_an_open_piece_closes`."""
    require_an_open_piece_closes(code)


def require_an_open_piece_closes(code):
    """A piece of few points, followed on, is the closed curve."""
    piece = follow_curve(start(code), WINDOW, points=12)
    assert not piece.closed and len(piece) == 12
    found = extend_curve(piece, WINDOW)
    assert found.closed and curve_id(found) == curve_id(curve(code))
    assert found.unknowns[found.start] == pytest.approx(piece.unknowns[piece.start], abs=0.1)


def test_a_range_cuts_a_closed_curve():
    """Oracle: the closed form. In a range that the curve leaves, the piece has two ends on the bound."""
    found = follow_curve(start("PD"), ((-3.0, 3.0), (0.1, 3.0)))
    assert not found.closed and [end.reason for end in found.ended] == ["EVENT", "EVENT"]
    assert found.parameters[[0, -1], 1] == pytest.approx([0.1, 0.1], abs=1e-9)
    for p, q in found.parameters:
        assert q * q == pytest.approx(exact_square("PD", p), abs=1e-12)
