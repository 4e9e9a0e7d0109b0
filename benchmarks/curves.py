"""`python -m benchmarks curves`: a point of a curve of bifurcations in two parameters, compared with a point of the family that it crosses.

A point of a curve is predicted and corrected, with the condition of the bifurcation and all test functions: the coefficient of the normal
form, multipliers, and the bounds of all flights. A point of a family has all of its own. The engine takes both kinds of points in single
steps; families also take blocks of steps in compiled code.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from benchmarks.backbone import energy
from benchmarks.measure import timed
from benchmarks.report import Table, machine, number, show, watched
from branches.curves.free_start import released_of
from branches.curves.monitor import Window
from branches.curves.record import BifurcationCurve
from branches.curves.starting import CurveStart, curve_at, curve_start
from branches.curves.tracing import follow_curve
from branches.family import SETTINGS
from branches.forced.branch import ForcedBranch, ForcedEvent
from branches.forced.family import ForcedFamily
from branches.forced.tracing import follow_response, switch_response
from branches.released.family import ReleasedFamily
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from bvp.released import ReleasedProblem
from bvp.system import vibro_impact_nes
from continuation.control import Settings, control_of
from continuation.problem import Goal, Problem, Recent, Step
from saltus import trace
from saltus.errors import DONE
from saltus.scene import load_scene
from transitions.response.path import ParameterPath
from transitions.response.starting import settled_orbit
from transitions.sweep.settle import settle

__all__ = ["Case", "absorber_cases", "add_arguments", "curves_table", "doubling_stop", "fold_stop", "free_cases", "oscillator_cases"]

RESTITUTION = 0.8
"""Of the oscillator."""

POINTS = 500

STEP, FAMILY_STEP = 0.01, 0.003
"""Lengths of single steps along a curve, and along a family."""

NEXT = 1e-3
"""Distance of another multiplier from the critical one, below which the critical one is known to the root of rounding."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser."""
    parser.add_argument("--quick", action="store_true", help="fewer curves and repeats")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    show(curves_table(arguments.quick))
    return DONE


class Case(NamedTuple):
    """A curve: its system, a family that it crosses and a point of it, where it is started, the ranges of the parameters, and the error."""

    system: str
    branch: ForcedBranch
    point: int
    start: CurveStart
    window: Window
    error: Callable[[BifurcationCurve], float]


def _forced_case(
    system: str,
    branch: ForcedBranch,
    event: ForcedEvent,
    names: tuple[str, str],
    window: Window,
    error: Callable[[BifurcationCurve], float],
) -> Case:
    """A curve that starts at an event of a response."""
    return Case(system, branch, _plain_point(branch, event), curve_at(branch, event, names), window, error)


def _terms(w: float) -> tuple[float, float, float, float]:
    """sin T, cos T, (1 + r) sin T/(1 - cos T) and (1 - r)/w of x'' + x = cos(w t) with the period T = 2 pi/w."""
    sine, cosine = math.sin(2.0 * math.pi / w), math.cos(2.0 * math.pi / w)
    return sine, cosine, (1.0 + RESTITUTION) * sine / (1.0 - cosine), (1.0 - RESTITUTION) / w


def fold_stop(w: float) -> float:
    """The place s of the stop at the fold of x'' + x = cos(w t), x <= s, with one impact a period."""
    _, _, c, rest = _terms(w)
    return -math.copysign(math.hypot(1.0, c / rest), c) / abs(1.0 - w * w)


def doubling_stop(w: float) -> float:
    """The place s of the stop at its period doubling: the derivative of the map from impact to impact has the eigenvalue -1."""
    sine, cosine, c, rest = _terms(w)
    push = (1.0 + RESTITUTION) * w * w * sine
    k = 1.0 + RESTITUTION**2 - 2.0 * RESTITUTION * cosine + 0.5 * (1.0 + RESTITUTION) * sine * c * (1.0 - w * w)
    return math.copysign(k, sine * k) / math.sqrt(k * k + c * k * push + 0.25 * (c * c + rest * rest) * push**2) / abs(1.0 - w * w)


def oscillator_cases() -> list[Case]:
    """SN and PD of x'' + x = cos(w t), x <= s, over the frequency and the place of the stop."""
    parametric = ParametricSystem.from_description(
        {
            "parameters": {"w": 2.8, "s": -0.2},
            "system": {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "s", "restitution": RESTITUTION}]},
            "forces": [{"load": [1.0], "amplitude": 1.0, "harmonic": 1}],
        }
    )
    found = settle(parametric.system(), parametric.forces(), np.array([-1.0]))
    problem = ForcedProblem(parametric, found.stops, ["s"], load_periods=found.period)
    fractions = (found.impacts.times / found.period_of_loads + found.impacts.periods) / found.period
    branch = follow_response(problem, problem.pack(found.impacts.after, fractions, [-0.2]), (-3.0, 1.0))

    def error(form: Callable[[float], float]) -> Callable[[BifurcationCurve], float]:
        return lambda curve: max(abs(s - form(w)) for w, s in curve.parameters if abs(w - 2.0) > NEXT)

    window, forms = ((1.2, 6.0), (-5.0, 1.0)), {"SN": fold_stop, "PD": doubling_stop}
    events = [next(event for event in branch.events if event.type == code) for code in forms]
    return [_forced_case("oscillator", branch, event, ("w", "s"), window, error(forms[event.type])) for event in events]


def absorber_cases(codes: tuple[str, ...] = ("SN", "NS", "SB", "PD", "GR")) -> list[Case]:
    """Curves of the shipped absorber over the frequency and the amplitude of its load, from its response and families that emanate from
    it: with one impact more in half a period, and without the symmetry."""
    parametric = load_scene("absorber").parametric
    assert parametric is not None
    found = settled_orbit(ParameterPath(parametric, ["w"]), settle(parametric.system(), parametric.forces()))
    branches = [follow_response(found.problem, found.y, (0.7, 2.2))]
    for code in ("GR", "SB"):
        event = next(event for event in branches[-1].events if event.type == code)
        branches.append(follow_response(*switch_response(branches[-1], event)[0], (0.7, 2.2)))
    cases = []
    for code in codes:
        branch, event = next((branch, event) for branch in branches for event in branch.events if event.type == code)
        cases.append(_forced_case("absorber", branch, event, ("w", "F"), ((0.5, 3.0), (0.05, 3.5)), _critical_error))
    return cases


def free_cases(codes: tuple[str, ...] = ("SN", "SB", "GR")) -> list[Case]:
    """Curves of free orbits of the reference system over the mass ratio and the energy, and its families over the mass ratio."""
    cases = []
    for code in codes:
        name = "S13O00+" if code == "SB" else "S11O00-"
        branch = trace(name, vibro_impact_nes(mu=0.1, sigma=0.1), energy=(0.06, 4.0))
        event = next(event for event in branch.events if event.type == code)
        start = curve_start(*released_of(branch.orbit(event.point), ("mu", "energy")), code, ("mu", "energy"))
        problem, y = released_of(branch.orbit(branch.start), ("mu",))
        family = follow_response(problem, y, (0.02, 1.0))
        cases.append(Case("reference", family, _plain_point(family, family.events[0]), start, ((0.02, 1.0), (0.01, 20.0)), _energy_error))
    return cases


def _energy_error(curve: BifurcationCurve) -> float:
    """The largest relative difference of the energy from the closed form at the quarter period."""
    problem, worst = curve.plane.problem, 0.0
    for y in curve.unknowns:
        values = problem.known_values(y[: curve.plane.size])
        exact = float(energy(problem.parametric.system({"mu": values["mu"]}), values["quarter_period"]))
        worst = max(worst, abs(values["energy"] / exact - 1.0))
    return worst


def _critical_error(curve: BifurcationCurve) -> float:
    """How far the critical multiplier, from flights and saltation matrices, is from its value; at a grazing the impact speed."""
    problem, worst = curve.plane.problem, 0.0
    for y, multipliers in zip(curve.unknowns, curve.multipliers, strict=True):
        if curve.grazing is not None:
            worst = max(worst, float(np.abs(problem.impact_speeds(y[: curve.plane.size])).min()))
            continue
        value = 1.0 if curve.code == "SN" else -1.0 if curve.code != "NS" else complex(y[-1], math.sqrt(max(0.0, 1.0 - y[-1] ** 2)))
        # The multipliers are those of the full period; of half of it the event has its value.
        distances = np.sort(np.abs(multipliers - (value**2 if getattr(problem, "half", False) else value)))
        if distances[1] > NEXT:
            worst = max(worst, float(distances[0]))
    return worst


def curves_table(quick: bool) -> Table:
    """Microseconds a point of each curve, and the ratio to a point of its family."""
    forced = [*oscillator_cases(), *absorber_cases(("SN", "SB") if quick else ("SN", "NS", "SB", "PD", "GR"))]
    cases = [*forced, *free_cases(("SN",) if quick else ("SN", "SB", "GR"))]
    return Table(
        "Points of curves in two parameters",
        (
            "system", "curve", "flights", "us a point", "of the family", "ratio", "in blocks", "ratio", "points", "events",
            "us a point of a run", "of the family", "ratio", f"s for {POINTS} points", "error",
        ),
        [_row(case, quick) for case in watched(cases, lambda case: f"{case.system}, {case.start.code}")],
        (
            "Least of some repeats. Us a point: single steps, with all test functions. Of the family: the same of the family on which the",
            "curve is started; in blocks: its compiled steps. Of a run: with events and record. For 500 points: a run of them, with steps",
            "as short as it needs. Error of the oscillator: the distance from the closed form. Of the absorber: the distance of the",
            "critical multiplier, by flights and saltation matrices, from its value, or the speed of the impact that grazes. The families",
            "of the reference system are those over the mass ratio at one energy. Its error is the relative difference of the energy from",
            "the closed form.",
        ),
    )  # fmt: skip


def _row(case: Case, quick: bool) -> tuple[str, ...]:
    branch, start = case.branch, case.start
    family = ReleasedFamily(branch.problem) if isinstance(branch.problem, ReleasedProblem) else ForcedFamily(branch.problem)
    y = branch.unknowns[case.point]
    steps = [_single_steps(start.curve(case.window), start.y, STEP), _single_steps(family, y, FAMILY_STEP)]
    if family.advance is not None:
        steps.append(_blocks(family, y))
    point, single, *blocks = _least(steps, 3 if quick else 25)
    curve = follow_curve(start, case.window, points=POINTS)
    runs = partial(_curve_points, start, case.window), partial(_branch_points, branch)
    whole, of_branch = _least(runs, 1 if quick else 4)
    (long,) = _least([partial(_curve_points, start, case.window, _short_steps(start, case.window, len(curve)))], 1 if quick else 3)
    in_blocks = [f"{1e6 * block:.1f}" for block in blocks] or ["none"]
    of_blocks = [f"{point / block:.1f}" for block in blocks] or ["none"]
    return (
        case.system, start.code, str(branch.problem.inner + 1), f"{1e6 * point:.0f}", f"{1e6 * single:.0f}", f"{point / single:.1f}",
        *in_blocks, *of_blocks, str(len(curve)), str(len(curve.events)), f"{1e6 * whole:.0f}",
        f"{1e6 * of_branch:.0f}", f"{whole / of_branch:.1f}", f"{long * POINTS:.2f}", number(case.error(curve), 2),
    )  # fmt: skip


def _least(runs: Sequence[Callable[[], int]], repeats: int) -> list[float]:
    """The least seconds of a point of each run, which gives the number of its points. The runs take turns."""
    found = [math.inf] * len(runs)
    for _ in range(repeats + 1):
        for k, run in enumerate(runs):
            points, seconds = timed(run)
            found[k] = min(found[k], seconds / max(1, points))
    return found


def _plain_point(branch: ForcedBranch, event: ForcedEvent) -> int:
    """The point of a branch halfway between an event and the one before it, or after it: which of them are further apart."""
    places = sorted({0, len(branch) - 1, *(one.point for one in branch.events)})
    k = places.index(event.point)
    low, high = places[max(0, k - 1)], places[min(len(places) - 1, k + 1)]
    beside = low if event.point - low > high - event.point else high
    return (event.point + beside) // 2


def _single_steps(problem: Problem, y: np.ndarray, ds: float) -> Callable[[], int]:
    """Steps one by one."""
    begin = problem.begin(y)

    def run() -> int:
        step: Step = begin
        count = 0
        while step.converged and count < 40:
            step = problem.step(step.y, step.tangent, ds)
            count += 1
        return count

    return run


def _blocks(family: ForcedFamily | ReleasedFamily, y: np.ndarray) -> Callable[[], int]:
    """Steps in a compiled block."""
    begin = family.begin(y)
    unknown = [math.nan] * len(begin.tests)
    control = control_of(SETTINGS)._replace(longest=0.1 * FAMILY_STEP)
    assert family.advance is not None

    def run() -> int:
        arguments = Recent(begin, begin.tests, unknown, unknown), control.longest, Goal(begin), 200, control
        return len(family.advance(*arguments).steps)  # type: ignore[misc]

    return run


def _curve_points(start: CurveStart, window: Window, settings: Settings = SETTINGS) -> int:
    return len(follow_curve(start, window, points=POINTS, settings=settings))


def _short_steps(start: CurveStart, window: Window, points: int) -> Settings:
    """Settings with which a curve of so many points has `POINTS` of them."""
    settings = SETTINGS
    while points < POINTS:
        first, longest, turn = (0.7 * length for length in (settings.initial_step, settings.maximum_step, settings.target_turn))
        settings = replace(settings, initial_step=first, maximum_step=longest, target_turn=turn)
        points = _curve_points(start, window, settings)
    return settings


def _branch_points(branch: ForcedBranch) -> int:
    return len(follow_response(branch.problem, branch.unknowns[branch.start], branch.interval))
