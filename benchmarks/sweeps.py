"""`python -m benchmarks sweeps`: impacts a second of forced motion in a sweep, compared with scipy's integrator.

The integrator is `scipy.integrate.solve_ivp` (DOP853) with an event for each bound of a gap. It records nothing but the impacts. A sweep
records states, impacts, energies and peaks, and carries a tangent vector.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.measure import timed
from benchmarks.report import Table, machine, show, watched
from bvp.forcing import Constant, Force, Harmonic
from bvp.system import ImpactSystem
from saltus.errors import DONE
from saltus.scene import load_scene
from transitions.sweep.forced import Carried, ForcedMotion, carried_into
from transitions.sweep.sweep import Sweep, SweepSettings, sweep

__all__ = ["SCENES", "add_arguments", "integrated", "sweep_table"]

SCENES = ("impact_oscillator", "absorber", "forced_chain", "oscillator_at_wall")
"""Scenes with one, two and three degrees of freedom, at their own values."""

RTOL = 1e-9
"""Tolerance of the integrator."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser."""
    parser.add_argument("--quick", action="store_true", help="fewer scenes and periods")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    show(sweep_table(arguments.quick))
    return DONE


def integrated(system: ImpactSystem, forces: Sequence[Force], state: np.ndarray, duration: float) -> tuple[int, np.ndarray]:
    """Integrate from (u, v) at phase 0; the number of impacts, and (u, v) at the end."""
    n = system.degrees_of_freedom
    inverse = np.linalg.inv(system.mass)

    def load(t: float) -> np.ndarray:
        total = np.zeros(n)
        for force in forces:
            if isinstance(force, Harmonic):
                total += force.cosine * math.cos(force.frequency * t) + force.sine * math.sin(force.frequency * t)
            elif isinstance(force, Constant):
                total += force.load
        return total

    def motion(t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], inverse @ (load(t) - system.damping @ x[n:] - system.stiffness @ x[:n])])

    sides = [(stop, bound, side) for stop in system.stops for bound, side in ((stop.lower, -1.0), (stop.upper, 1.0))]
    contacts = [(np.array(stop.gap), stop.restitution, bound, side) for stop, bound, side in sides if math.isfinite(bound)]
    events = [_distance(row, bound, side) for row, _, bound, side in contacts]
    t, x, impacts = 0.0, state.copy(), 0
    while t < duration:
        run = solve_ivp(motion, (t, duration), x, "DOP853", events=events, rtol=RTOL, atol=RTOL)
        t, x = float(run.t[-1]), run.y[:, -1].copy()
        if run.status == 1:
            row, restitution, _, side = contacts[next(k for k, times in enumerate(run.t_events) if len(times))]
            speed = side * float(row @ x[n:])
            if speed > 0.0:
                x[n:] -= side * (1.0 + restitution) * speed * (inverse @ row) / float(row @ inverse @ row)
                impacts += 1
    return impacts, x


def _distance(row: np.ndarray, bound: float, side: float) -> Callable[[float, np.ndarray], float]:
    """The event of a contact."""

    def distance(t: float, x: np.ndarray) -> float:
        return side * (bound - float(row @ x[: len(row)]))

    distance.terminal, distance.direction = True, -1.0  # type: ignore[attr-defined]
    return distance


def sweep_table(quick: bool) -> Table:
    """Impacts a second of processor time, and their ratio."""
    periods, few = (60, 4) if quick else (2000, 40)
    rows = [_row(name, periods, few) for name in watched(SCENES[: 2 if quick else None], str)]
    return Table(
        "Sweeps",
        ("scene", "n", "impacts a period", "exponent", "impacts a second", "solve_ivp", "ratio"),
        rows,
        (f"{periods} periods of one value in processor time, with all results; DOP853 with atol = rtol = {RTOL:g}, {few} periods.",),
    )


def _row(name: str, periods: int, few: int) -> tuple[str, ...]:
    scene = load_scene(name)
    system, forces = scene.system, scene.forces
    inside, _ = carried_into(system, Carried(np.zeros(2 * system.degrees_of_freedom)))
    motion = ForcedMotion(system, forces, inside)
    motion.advance(200)
    begin = motion.carried

    def ours() -> Sweep:
        return sweep(lambda _: (system, forces), [0.0], start=begin, settings=SweepSettings(0, periods))[0]

    found = ours()  # loads the kernels
    count = len(found.impact_speeds)
    rate = count / min(timed(ours)[1] for _ in range(3))
    (other, _), seconds = timed(integrated, system, forces, begin.state, few * motion.period)
    n, exponent = system.degrees_of_freedom, float(found.exponents[0])
    speeds = f"{rate:.0f}", f"{other / seconds:.0f}", f"{rate * seconds / other:.0f}"
    return name, str(n), f"{count / periods:.2f}", f"{exponent:.3f}", *speeds
