"""How fast sections are computed, and how well energy is kept, beside `scipy.integrate.solve_ivp` with events on the same starts.

    python -m benchmarks.sections [--quick]

For each energy: section points a second and the largest relative drift of energy of `saltus.section` (Lyapunov exponents included) and of
DOP853 with an event on the gap and one on u2, restitution in a loop. The integrator's runs are fewer, and shorter. No bound stands behind
its events: what falls between two of its steps is missed; the last column counts the starts whose fifth point is wrong for that.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np
from scipy.integrate import solve_ivp

import saltus
from saltus.bench.machine import describe
from transitions.section_plane import SectionPlane

__all__ = ["integrated", "main", "wrong"]

STARTS = 12
ENERGIES = (0.06, 0.3, 1.0, 5.0)


def integrated(mu: float, sigma: float, u: np.ndarray, v: np.ndarray, crossings: int, rtol: float, step: float = math.inf) -> np.ndarray:
    """The states (k, 4) at the first upward crossings of u2 = 0, the start left out; `step`: longest step of the integrator."""

    def motion(t: float, x: np.ndarray) -> list[float]:
        force = sigma * (x[0] - x[1])
        return [x[2], x[3], -force / mu, force - x[1]]

    def gap(t: float, x: np.ndarray) -> float:
        return 1.0 - abs(x[0] - x[1])

    def primary(t: float, x: np.ndarray) -> float:
        return x[1]

    gap.terminal, gap.direction, primary.direction = True, -1.0, 1.0  # type: ignore[attr-defined]
    state, found = np.concatenate([u, v]), np.zeros((0, 4))
    first = True
    while len(found) < crossings:
        run = solve_ivp(motion, (0.0, 100.0), state, "DOP853", events=(gap, primary), rtol=rtol, atol=rtol, max_step=step)
        late = run.t_events[1] > (1e-6 if first else 0.0)
        found = np.concatenate([found, np.reshape(run.y_events[1], (-1, 4))[late]])
        state = run.y[:, -1].copy()
        relative = state[2] - state[3]
        if run.status == 1 and relative * (state[0] - state[1]) > 0.0:
            state[2] -= 2.0 * relative / (1.0 + mu)
            state[3] += 2.0 * relative * mu / (1.0 + mu)
        first = False
    return found[:crossings]


def wrong(system: saltus.ImpactSystem, energy: float, count: int, rtol: float) -> str:
    """How many starts the integrator takes elsewhere within five points."""
    plane = SectionPlane(system, energy)
    starts = plane.starts(count)
    found = saltus.section(system, energy, starts=starts, crossings=6)
    u, v = plane.states(starts)
    lost = 0
    for m in range(count):
        states = integrated(0.1, 0.1, u[m], v[m], 5, rtol)
        apart = np.abs(plane.coordinates(states[:, :2], states[:, 2:])[-1] - found.points[m, 5]).max()
        lost += bool(apart > 1e-6 * math.exp(max(0.0, float(found.growths[m].max()))))
    return f"{lost} of {count}"


def main(quick: bool = False) -> None:
    """Print the table."""
    system = saltus.vibro_impact_nes()
    orbits, crossings, few, rtol = (10, 40, 1, 1e-9) if quick else (150, 400, 4, 1e-12)
    saltus.section(system, 0.06, orbits=1, crossings=2)
    for line in describe():
        print(line)
    print(f"\n{orbits} orbits of {crossings} points; DOP853 with atol = rtol = {rtol:g}, {few} orbits of {crossings // 4} points.\n")
    print("| h | impacts a point | points a second | drift | points a second, solve_ivp | drift | ratio | impacts missed |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for energy in ENERGIES[: 2 if quick else None]:
        seconds = math.inf
        for _ in range(3):
            begun = time.perf_counter()
            found = saltus.section(system, energy, orbits=orbits, crossings=crossings)
            _ = found.exponents
            seconds = min(seconds, time.perf_counter() - begun)
        ours = len(found) / seconds
        plane = SectionPlane(system, energy)
        u, v = plane.states(plane.starts(few))
        begun = time.perf_counter()
        states = np.concatenate([integrated(0.1, 0.1, u[m], v[m], crossings // 4, rtol) for m in range(few)])
        theirs = len(states) / (time.perf_counter() - begun)
        drift = float(np.abs(system.energy(states[:, :2], states[:, 2:]) / energy - 1.0).max())
        missed = wrong(system, energy, STARTS if not quick else 2, rtol)
        a_point = found.impacts.sum() / len(found)
        cells = [f"{energy:g}", f"{a_point:.2f}", f"{ours:.0f}", f"{found.drift:.1e}", f"{theirs:.1f}", f"{drift:.1e}"]
        print(f"| {' | '.join([*cells, f'{ours / theirs:.0f}', missed])} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true")
    main(**vars(parser.parse_args()))
