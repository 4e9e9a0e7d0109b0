"""Single figures of one checkout: seconds of a point, of multipliers and of an impact.

`benchmarks.before_now` runs this text in the environment of each side, from the side's folder: an earlier checkout need not have this
file. A figure that a side cannot measure costs no other one. Where checkouts differ in a name, a figure looks for both.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np


def least(function: Callable[[], object], seconds: float, together: int = 20) -> float:
    """Least mean time of so many calls, repeated for some seconds: processor time, which other processes disturb less."""
    function()
    best, began = math.inf, time.process_time()
    while best == math.inf or time.process_time() - began < seconds:
        start = time.process_time()
        for _ in range(together):
            function()
        best = min(best, (time.process_time() - start) / together)
    return best


def followed(family: Any, y: np.ndarray, seconds: float, points: int = 40) -> float:
    """Least mean time of a point of a run without events."""
    from benchmarks.following import timed_runs

    best, began = math.inf, time.process_time()
    while best == math.inf or time.process_time() - began < seconds:
        best = min(best, *(run.clean_point for run in timed_runs(family, y, points, 5)))
    return best


def masses(n: int, damping: float = 0.0, restitution: float = 1.0) -> Any:
    """A chain of n masses of 1 to 0.5 between walls, with a stop of both sides at the first; damping: as a part of the stiffness."""
    from bvp.system import ImpactSystem, Stop

    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stop = Stop(tuple(np.eye(n)[0]), -1.0, 1.0, restitution)
    return ImpactSystem(np.diag(np.linspace(1.0, 0.5, n)), damping * stiffness, stiffness, (stop,))


def one_impact(n: int, alpha: float | None = None) -> tuple[Any, np.ndarray]:
    """The orbit of that chain with one impact a half period, at a quarter period: its problem and unknowns."""
    from benchmarks.backbone import origin_velocity
    from bvp.multipoint import MultipointProblem

    system, alpha = masses(n), alpha or {2: 1.7, 3: 1.3, 5: 1.2, 12: 1.05}[n]
    problem = MultipointProblem(system, ("origin", "stop+"), ())
    start = problem.modes.from_state @ np.concatenate([np.zeros(n), origin_velocity(system, alpha)])
    return problem, problem.solve(problem.pack(start, [], [alpha]), quarter_period=alpha).y


def step(seconds: float, n: int) -> float:
    """A step of a family, called by itself."""
    from branches.family import Family

    problem, y = one_impact(n)
    family = Family(problem)
    begun = family.begin(y)
    return least(lambda: family.step(begun.y, begun.tangent, 1e-4), seconds)


def multipliers(seconds: float, n: int, impacts: int) -> float:
    """The multipliers of an orbit that is traversed until it has so many impacts."""
    from bvp import multipliers
    from bvp.closures import Cycle, cycle_of

    problem, y = one_impact(n)
    cycle = cycle_of(problem, y)
    k = impacts // len(cycle.contact)
    before, after = np.tile(cycle.before, (k, 1)), np.tile(cycle.after, (k, 1))
    one = Cycle(problem.system, before, after, np.tile(cycle.duration, k), np.tile(cycle.contact, k), 0.0)
    route = getattr(multipliers, "floquet_multipliers", multipliers.saddle_point_multipliers)
    return least(lambda: route(one), seconds)


def out_of_phase(seconds: float) -> Any:
    """A short step along S11O00- at a high energy."""
    from benchmarks.speed_error.exact import EXACT
    from benchmarks.speed_error.methods import OWN_SHORT
    from benchmarks.speed_error.tasks import OUT_OF_PHASE

    straight: Any = next(method for method in EXACT if method.name == OWN_SHORT).prepare(OUT_OF_PHASE, None)
    return min(float(straight.measured().seconds) for _ in range(3))


def out_of_phase_by_auto(seconds: float) -> float | None:
    """The same by AUTO-07p; None where it is not installed, or where its time is lost in its scatter."""
    from benchmarks.peers import auto
    from benchmarks.peers.auto_files import AutoSettings
    from benchmarks.speed_error.methods import SHORT_STEP
    from benchmarks.speed_error.tasks import OUT_OF_PHASE

    if auto.missing() is not None:
        return None
    with auto.Auto() as program:
        # With one interval, some versions of AUTO abort. Its points take so little that processor time needs many of them.
        orbit, settings = (OUT_OF_PHASE.problem, OUT_OF_PHASE.unknowns()), AutoSettings(intervals=2, step=SHORT_STEP)
        taken = program.time_a_point(*orbit, settings, short=auto.SHORT, long=12 * auto.LONG).processor
    return taken.value if taken.value > taken.scatter else None


def in_phase(seconds: float, impacts: int) -> float:
    """A point of S13O00+ with so many inner impacts, as a family is followed."""
    from benchmarks import cases
    from branches.family import Family

    problem, y = cases.segment(cases.system(), impacts)
    return followed(Family(problem), y, seconds)


def chain_point(seconds: float, n: int) -> float:
    """A point of the chain's family, as a family is followed; from where few events are near."""
    from branches.family import Family

    problem, y = one_impact(n, {3: 1.3, 12: 1.0}[n])
    return followed(Family(problem), y, seconds)


def response(seconds: float, n: int, impacts: int) -> float:
    """A point of a response with so many impacts, in blocks of steps."""
    from benchmarks.forced import STEP, chain, one_impact, repeated
    from branches.family import SETTINGS
    from branches.forced.family import ForcedFamily
    from continuation.control import control_of
    from continuation.problem import Goal, Recent

    problem, y = one_impact(chain(n))
    wide, y = repeated(problem, y, impacts // len(problem.sequence))
    family: Any = ForcedFamily(wide)
    begin = family.begin(y)
    unknown, control, steps = [math.nan] * len(begin.tests), control_of(SETTINGS)._replace(longest=STEP), 200

    def block() -> int:
        return len(family.advance(Recent(begin, begin.tests, unknown, unknown), STEP, Goal(begin), steps, control).steps)

    taken = block()
    return least(block, seconds, 1) / taken


def free_in_a_parameter(seconds: float, whole: bool) -> float:
    """A point of S13O00+ at a constant energy in the mass ratio: of a run of steps, or of a whole family with its record."""
    from branches.forced.family import parameter_family
    from branches.forced.tracing import follow_response
    from bvp.multipoint import MultipointProblem
    from bvp.parameters import ParametricSystem
    from bvp.released import ReleasedProblem
    from bvp.system import vibro_impact_nes

    parametric = ParametricSystem.of(vibro_impact_nes())
    plain = MultipointProblem(parametric.system(), ("origin", "stop+"), ())
    guess = plain.pack(plain.modes.from_state @ np.array([0.0, 0.0, 1.4, 1.0]), None, [1.7])
    y = plain.solve(guess, quarter_period=1.7).y
    h = plain.energy(y)
    problem = ReleasedProblem(parametric, ("origin", "stop+"), (), ("mu",), [f"energy = {h!r}"], energy=h)
    begin = problem.of_orbit(plain, y)
    if whole:
        points = len(follow_response(problem, begin, (0.09, 0.12)))
        return least(lambda: follow_response(problem, begin, (0.09, 0.12)), seconds, 1) / points
    return followed(parameter_family(problem), begin, seconds, 16)


def smooth(seconds: float, index: int) -> float:
    """A point of a smooth family (`benchmarks.smooth.CASES`)."""
    from benchmarks.smooth import CASES, _orbit
    from branches.family import Family

    scene, values, mode, h, _ = CASES[index]
    orbit = _orbit(scene, values, mode, h)
    return followed(Family(orbit.problem), np.array(orbit.solution.y), seconds)


def impact_of_a_study(seconds: float) -> float:
    """An impact of 20,000 runs of a study, in one process."""
    from benchmarks.motions import plan
    from transitions.study.runs import run_block

    wanted = plan(20_000)
    given = wanted.values(0, wanted.count)
    impacts = int(run_block(wanted, given)["impacts"].sum())
    return least(lambda: run_block(wanted, given), seconds, 1) / impacts


def impact_of_a_simulation(seconds: float, n: int) -> float:
    """An impact of a simulated motion of the damped chain, with its energy budget and its record."""
    from bvp.forcing import Harmonic
    from bvp.simulate import simulate

    system, load = masses(n, 0.005, 0.9), Harmonic(0.9, 2.0 * np.eye(n)[-1])

    def motion() -> Any:
        return simulate(system, np.zeros(n), np.zeros(n), 5000.0, forces=load)

    return least(motion, seconds, 1) / motion().impacts


FIGURES: dict[str, tuple[Any, ...]] = {
    **{f"point {n}": (step, n) for n in (2, 3, 5, 12)},
    **{f"multipliers {n} {impacts}": (multipliers, n, impacts) for n in (2, 3, 5, 12) for impacts in (2, 64)},
    "S11O00- at h = 1e4": (out_of_phase,),
    "S11O00- at h = 1e4, AUTO-07p": (out_of_phase_by_auto,),
    "followed, S13O00+": (in_phase, 0),
    "followed, 8 inner impacts": (in_phase, 8),
    **{f"followed, n = {n}": (chain_point, n) for n in (3, 12)},
    **{f"followed, response, n = {n}, impacts {k}": (response, n, k) for n, k in ((1, 1), (2, 2), (5, 8))},
    "followed, S13O00+ in mu": (free_in_a_parameter, False),
    "whole family, S13O00+ in mu": (free_in_a_parameter, True),
    "followed, smooth, cubic": (smooth, 0),
    **{f"followed, smooth, n = {n}": (smooth, k) for k, n in enumerate((3, 20, 100), 1)},
    "impact of a study": (impact_of_a_study,),
    **{f"impact of a simulation, n = {n}": (impact_of_a_simulation, n) for n in (2, 5)},
}
"""Each figure by its name: a function and its arguments."""


def measured(seconds: float, names: Iterable[str]) -> tuple[dict[str, float], dict[str, str]]:
    """Return the seconds of each figure, and for those that cannot be measured the reason."""
    found: dict[str, float] = {}
    failed: dict[str, str] = {}
    for name in names:
        function, *arguments = FIGURES[name]
        try:
            value = function(seconds, *arguments)
        except Exception as error:  # of any kind: another checkout has other names
            failed[name] = f"{type(error).__name__}: {error}"
        else:
            if value is not None:
                found[name] = value
    return found, failed


if __name__ == "__main__":
    print(json.dumps(measured(float(sys.argv[1]), [name for name in FIGURES if sys.argv[2] in name])))
