"""`python -m benchmarks forced`: a point of a forced family with everything on, compared with AUTO-07p and with one period by scipy.

A point is predicted, corrected, looked at along all its flights, and has its multipliers and test functions. Shooting needs 2 n + 1 periods
for one correction alone. AUTO-07p gets the same segments, and computes neither multipliers nor whether a flight penetrates a stop. Orbits
with 2 and 8 impacts are those with one impact, traversed as often: the equations do not know.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from benchmarks.measure import BELOW, timed
from benchmarks.peers import auto
from benchmarks.peers.auto_files import AutoSettings
from benchmarks.report import Table, machine, number, progress, show
from benchmarks.sweeps import RTOL, integrated
from branches.family import SETTINGS
from branches.forced.family import ForcedFamily
from bvp.forced import ForcedProblem
from bvp.parameters import ParametricSystem
from continuation.control import control_of
from continuation.problem import Goal, Recent
from saltus.errors import DONE
from transitions.sweep.settle import settle

__all__ = ["SIZES", "add_arguments", "chain", "one_impact", "points_table", "repeated"]

SIZES = (1, 2, 5)
"""Degrees of freedom."""

IMPACTS = (1, 2, 8)

TARGETS = {(1, 1): 15.0, (2, 2): 20.0, (5, 8): 100.0}
"""Microseconds that are aimed at."""

INTERVALS = (2, 4, 8, 16)
"""Numbers of mesh intervals of AUTO-07p. The first one counts whose error is below `WANTED`."""

WANTED = 1e-9

LONG = 2000
"""Degrees of freedom times impacts times points of a run of AUTO-07p whose time is taken."""

STEP = 1e-3
"""Length of the steps: short, so that all of a block are on the family."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser."""
    parser.add_argument("--quick", action="store_true", help="fewer steps and sizes")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    show(points_table(arguments.quick))
    return DONE


def chain(n: int) -> ParametricSystem:
    """A damped chain of n masses between two walls, a load on the first one and a stop at the last one."""
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    ends = np.eye(n)[0].tolist(), np.eye(n)[-1].tolist()
    return ParametricSystem.from_description(
        {
            "parameters": {"F": 1.0, "w": 0.8 * math.sqrt(2.0 - 2.0 * math.cos(math.pi / (n + 1)))},
            "system": {
                "mass": np.eye(n).tolist(),
                "damping": (0.1 * np.eye(n) + 0.02 * stiffness).tolist(),
                "stiffness": stiffness.tolist(),
                "stops": [{"c": ends[1], "upper": 0.6, "restitution": 0.6}],
            },
            "forces": [{"load": ends[0], "amplitude": "F", "harmonic": 1}],
        }
    )


def one_impact(parametric: ParametricSystem) -> tuple[ForcedProblem, np.ndarray]:
    """The problem in w of the motion that the system settles on, and its solution."""
    system = parametric.system()
    found = settle(system, parametric.forces(), np.zeros(system.degrees_of_freedom))
    problem = ForcedProblem(parametric, found.stops, ["w"], load_periods=found.period)
    fractions = (found.impacts.times / found.period_of_loads + found.impacts.periods) / found.period
    y = problem.pack(found.impacts.after, fractions, [parametric.values["w"]])
    return problem, problem.solve(y).y


def repeated(problem: ForcedProblem, y: np.ndarray, times: int) -> tuple[ForcedProblem, np.ndarray]:
    """An orbit, traversed so often, as a solution of its own problem."""
    wide = ForcedProblem(problem.parametric, problem.sequence * times, problem.released, load_periods=problem.load_periods * times)
    size = 2 * problem.degrees_of_freedom
    nodes = np.tile(problem.nodes(y), (times, 1))
    fractions = (nodes[:, size] + np.repeat(np.arange(times), problem.inner + 1)) / times
    return wide, wide.solve(wide.pack(nodes[:, :size], fractions, problem.released_values(y))).y


def points_table(quick: bool) -> Table:
    """Microseconds a point, with the error of the orbit."""
    rows = []
    for n in SIZES[: 2 if quick else None]:
        problem, y = one_impact(chain(n))
        for impacts in IMPACTS[: 2 if quick else None]:
            if impacts % len(problem.sequence) == 0:
                progress(f"{n} degrees of freedom, {impacts} impacts")
                rows.append(_row(*repeated(problem, y, impacts // len(problem.sequence)), quick))
    return Table(
        "Points of forced families",
        (
            "n", "impacts", "us a point", "aim", "error", "ms a period, solve_ivp", "its error", "ratio",
            "AUTO-07p, us a point", "NTST", "its error", "ratio",
        ),
        rows,
        (
            f"Least of five blocks of steps. Error: the residual; of DOP853, at {RTOL:g}, the change of the state over a period;",
            "of AUTO-07p the distance to the orbit that Newton's method finds from its orbit.",
            BELOW,
        ),
    )  # fmt: skip


def _row(problem: ForcedProblem, y: np.ndarray, quick: bool) -> tuple[str, ...]:
    family = ForcedFamily(problem)
    begin = family.begin(y)
    unknown = [math.nan] * len(begin.tests)
    control, steps = control_of(SETTINGS)._replace(longest=STEP), 20 if quick else 200
    assert family.advance is not None

    def block() -> int:
        return len(family.advance(Recent(begin, begin.tests, unknown, unknown), STEP, Goal(begin), steps, control).steps)  # type: ignore[misc]

    taken = block()
    seconds = min(timed(block)[1] for _ in range(5)) / taken
    n, size = problem.degrees_of_freedom, 2 * problem.degrees_of_freedom
    # From phase 0 on: the integrator knows no other start.
    node = problem.nodes(begin.y)[-1]
    state, _ = problem.fly(node, (1.0 - float(node[size])) * problem.period(begin.y))
    at = problem.parameters(begin.y)
    system, forces = problem.parametric.system(at), problem.parametric.forces(at)
    (_, end), other = timed(integrated, system, forces, state, problem.period(begin.y))
    ours = float(np.abs(problem.residual(begin.y)).max())
    aim = TARGETS.get((n, len(problem.sequence)))
    return (
        str(n), str(len(problem.sequence)), f"{1e6 * seconds:.1f}", "" if aim is None else f"{aim:g}", number(ours),
        f"{1e3 * other:.1f}", number(float(np.abs(end - state).max())), f"{other / seconds:.0f}", *_beside_auto(problem, y, seconds, quick),
    )  # fmt: skip


def _beside_auto(problem: ForcedProblem, y: np.ndarray, seconds: float, quick: bool) -> tuple[str, ...]:
    """The entries of AUTO-07p in a row; `seconds`: those of a point here."""
    if auto.missing() is not None:
        return ("-",) * 4
    size = problem.degrees_of_freedom * len(problem.sequence)
    with auto.Auto() as program:
        for intervals in INTERVALS:
            settings = AutoSettings(intervals=intervals, step=STEP, points=4)
            orbits = [point.unknowns(problem) for point in program.follow(problem, y, settings).points]
            error = max(float(np.abs(problem.solve(orbit).y - orbit).max()) for orbit in orbits)
            if error < WANTED:
                break
        long, repeats = (LONG // 4, 2) if quick else (LONG, 3)
        time = program.time_a_point(problem, y, settings, short=8, long=8 + long // size, repeats=repeats)
    return time.processor.per(1e-6).text, str(intervals), number(error), time.processor.per(seconds).text
