"""`python -m benchmarks smooth`: a point of a smooth family with multipliers, beside AUTO-07p and shooting by scipy.

A point here is predicted, corrected, and has its multipliers and test functions. AUTO-07p follows the same quarter from the origin to rest
by collocation, without multipliers; and the closed orbit, with them. Shooting solves the same quarter by Newton's method on flights of
DOP853 with the equation of variations, from an orbit that is 1e-3 away.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.following import timed_runs
from benchmarks.measure import BELOW, difference, processor_of_children, repeated_times, timed
from benchmarks.peers import auto
from benchmarks.report import Table, machine, number, progress, show, watched
from branches.family import Family
from branches.naming.at_modes import orbit_at_mode
from branches.orbit import Orbit
from branches.tracing import SETTINGS, follow_family
from bvp.smooth_flights import core_flight
from saltus.errors import DONE
from saltus.scene import load_scene

__all__ = ["CASES", "add_arguments", "columns_table", "points_table", "shot_quarter"]

CASES: tuple[tuple[str, dict[str, float], str, float, float], ...] = (
    ("cubic_nes", {}, "mode:2", 0.1, 100.0),
    ("smooth_wall", {"n": 3}, "mode:1", 1.0, 100.0),
    ("smooth_wall", {"n": 20}, "mode:1", 1.0, 200.0),
    ("smooth_wall", {"n": 100}, "mode:1", 1.0, 300.0),
)
"""Scene, its parameters, the linear mode, the energy at which points are timed, microseconds that are aimed at."""

LOWEST = 0.01
"""Part of this energy at which the family is linear enough to begin at its mode."""

MESHES = (20, 50)
"""NTST of AUTO-07p."""

EQUATIONS = "smooth_orbit"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Fill the parser."""
    parser.add_argument("--quick", action="store_true", help="fewer points and repeats")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    print("\n".join(machine()), flush=True)
    show(points_table(arguments.quick))
    show(columns_table(arguments.quick))
    return DONE


def _orbit(scene: str, values: dict[str, float], mode: str, h: float) -> Orbit:
    low, high = LOWEST * h, 1.1 * h
    first = orbit_at_mode(mode, load_scene(scene, **values).system, (low, high))
    return follow_family(first.problem, first.solution.y, energy=(low, high)).orbits_at(energy=h)[0]


def shot_quarter(system: Any, velocities: np.ndarray, time: float, energy: float, rtol: float = 1e-13) -> tuple[np.ndarray, float]:
    """The quarter from the origin to rest at an energy by Newton's method on flights of DOP853.

    Parameters
    ----------
    system : ImpactSystem
        Two degrees of freedom, one spring of an odd power.
    velocities : (2,) float
    time, energy : float
    rtol : float

    Returns
    -------
    (2,) ndarray, float
        Velocities at the start, and the quarter period.
    """
    (spring,) = system.describe()["springs"]
    row, k, power = np.array(spring["c"]), spring["stiffness"], int(spring["power"])
    inverse = np.linalg.inv(system.mass)
    linear, push = -inverse @ system.stiffness, -k * (inverse @ row)

    def right(_: float, y: np.ndarray) -> np.ndarray:
        w, columns = row @ y[:2], y[4:].reshape(4, 2)
        steep = w ** (power - 1)
        bent = linear @ columns[:2] + np.outer(push, power * steep * (row @ columns[:2]))
        return np.concatenate([y[2:4], linear @ y[:2] + push * steep * w, columns[2:].ravel(), bent.ravel()])

    for _ in range(8):
        start = np.concatenate([np.zeros(2), velocities, np.zeros(4), np.eye(2).ravel()])
        end = solve_ivp(right, (0.0, time), start, method="DOP853", rtol=rtol, atol=rtol * 1e-2).y[:, -1]
        jacobian = np.zeros((3, 3))
        jacobian[:2, :2], jacobian[:2, 2] = end[4:].reshape(4, 2)[2:], right(0.0, end)[2:4]
        jacobian[2, :2] = system.mass @ velocities
        change = np.linalg.solve(jacobian, np.append(end[2:4], 0.5 * velocities @ system.mass @ velocities - energy))
        velocities, time = velocities - change[:2], time - float(change[2])
        if np.abs(change).max() < 1e-12:
            break
    return velocities, time


def points_table(quick: bool) -> Table:
    """Microseconds a point, with the relative error of the quarter period."""
    rows = []
    for scene, values, mode, h, aim in watched(CASES[: 2 if quick else None], lambda case: f"points of {_name(*case[:2])}"):
        orbit = _orbit(scene, values, mode, h)
        runs = timed_runs(Family(orbit.problem), np.array(orbit.solution.y), 16 if quick else 40, 3 if quick else 15)
        seconds = min(run.clean_point for run in runs)
        start = np.array(orbit.velocities)
        (_, time), shooting = timed(shot_quarter, orbit.system, start * (1.0 + 1e-3), orbit.alpha * (1.0 + 1e-3), orbit.h)
        error = abs(orbit.alpha / time - 1.0)
        name = _name(scene, values)
        ours = name, f"{h:g}", f"{1e6 * seconds:.0f}", f"{aim:g}", number(error), f"{1e3 * shooting:.0f}", f"{shooting / seconds:.0f}"
        for closed in (False, True):
            for mesh in MESHES:
                form = "period" if closed else "quarter"
                progress(f"points of {name}: AUTO-07p, {form}, NTST {mesh}")
                rows.append((*ours, form, str(mesh), *_beside_auto(orbit, mesh, quick, closed=closed)))
    return Table(
        "Points of smooth families",
        (
            "family", "h", "us a point", "aim", "distance from shooting", "ms, shooting", "ratio", "AUTO-07p", "NTST", "us a point",
            "its error", "here, same step", "ratio",
        ),
        rows,
        (
            "Least of runs of 40 points, with multipliers and test functions. Distances and errors: of the quarter period, relative. Steps",
            "are those of the program's own control; in the last two columns those of AUTO-07p, which are shorter.",
            "AUTO-07p computes multipliers of the period, none of the quarter. Its error is the distance from the quarter period here at",
            "the same energy; its table has eleven digits.",
            BELOW,
        ),
    )  # fmt: skip


def columns_table(quick: bool) -> Table:
    """Nanoseconds of a Taylor step without the derivatives by the state and with them. A flight of no time is taken off: it is the call."""
    rows = []
    for scene, values, mode, h, _ in watched(CASES[: 2 if quick else None], lambda case: f"Taylor steps of {_name(*case[:2])}"):
        orbit = _orbit(scene, values, mode, h)
        flight = core_flight(orbit.system, keep=1)
        start = orbit.system.modes.from_state @ np.concatenate([np.zeros(2), orbit.velocities])
        # The flight that was computed last is kept: two take turns.
        starts = cycle([start, start * (1.0 + 1e-9)])
        works, steps = {"call": partial(_flown, flight, starts, 0.0, False)}, []
        for with_columns in (False, True):
            works[f"columns {with_columns}"] = partial(_flown, flight, starts, orbit.alpha, with_columns)
            steps.append(len(flight.path(start, orbit.alpha, with_columns).times) - 1)
        call, *flights = repeated_times(works, 0.02 if quick else 1.0).values()
        plain, derived = (difference(flight, call) for flight in flights)
        known = plain.value > plain.scatter
        ratios = [derived.per(plain.value * by).text if known else "unknown" for by in (steps[1] / steps[0], 1.0)]
        each, with_them = (flight.per(1e-9 * count).text for flight, count in zip((plain, derived), steps, strict=True))
        rows.append((_name(scene, values), str(steps[0]), each, str(steps[1]), with_them, *ratios))
    return Table(
        "Taylor steps of a quarter, without and with the four columns of derivatives",
        ("family", "steps", "ns each", "steps, with columns", "ns each", "ratio of a step", "ratio of the quarter"),
        rows,
        ("Least of many flights, in turn. Steps with columns are shorter: the terms of columns decrease more slowly.", BELOW),
    )


def _flown(flight: Any, starts: Iterator[np.ndarray], duration: float, with_columns: bool) -> Any:
    return flight.path(next(starts), duration, with_columns)


def _name(scene: str, values: dict[str, float]) -> str:
    return scene + "".join(f", {key} = {value:g}" for key, value in values.items())


def _beside_auto(orbit: Orbit, mesh: int, quick: bool, *, closed: bool) -> tuple[str, ...]:
    """The entries of AUTO-07p: microseconds a point and error; microseconds here with its step, and the ratio."""
    if auto.missing() is not None:
        return ("-",) * 4
    short, long = (20, 120) if quick else (50, 450)
    with tempfile.TemporaryDirectory(prefix="saltus-auto-") as place:
        folder = Path(place)
        shutil.copy(Path(__file__).parent / "peers" / f"{EQUATIONS}.f90", folder)
        _write_start(folder, orbit, closed)
        _follow(folder, mesh, 2, closed)  # compiles the equations
        few, many = ([_follow(folder, mesh, count, closed) for _ in range(2)] for count in (short, long))
        table = many[0][1]
    if len(table) <= len(few[0][1]):
        return "-", "no convergence", "-", "-"
    time = difference(*([used for used, _ in runs] for runs in (many, few))).per(len(table) - len(few[0][1]))
    h, duration = table[len(few[0][1]) // 2]
    alpha = duration / 4.0 if closed else duration
    exact = orbit.problem.solve(orbit.solution.y, energy=float(h))["quarter_period"]
    family = Family(orbit.problem)
    step = float(abs((table[-1, 0] - table[0, 0]) / (len(table) - 1) / family.begin(orbit.solution.y).slope))
    settings = replace(SETTINGS, initial_step=step, maximum_step=step)
    runs = timed_runs(family, np.array(orbit.solution.y), short, 3 if quick else 15, settings)
    seconds = min(run.clean_point for run in runs)
    return time.per(1e-6).text, number(abs(alpha / exact - 1.0)), f"{1e6 * seconds:.0f}", time.per(seconds).text


def _write_start(folder: Path, orbit: Orbit, closed: bool) -> None:
    """The parameters and the first orbit, as the equations read them."""
    system = orbit.system
    (spring,) = system.describe()["springs"]
    duration = orbit.period if closed else orbit.alpha
    numbers = orbit.h, system.mass[0, 0], -system.stiffness[0, 1], spring["power"], 0.0, float(closed), duration
    (folder / f"{EQUATIONS}.start").write_text(" ".join(repr(float(x)) for x in numbers), encoding="ascii")
    places = np.linspace(0.0, 1.0, 401)
    u, v = orbit.sample(places * duration)
    np.savetxt(folder / f"{EQUATIONS}.dat", np.column_stack([places, u, v]), fmt="%.17g")


def _follow(folder: Path, mesh: int, points: int, closed: bool) -> tuple[float, np.ndarray]:
    """Processor seconds of a run of AUTO-07p; energies of its points with their quarter periods, or periods if closed: (N, 2)."""
    form = "IPS=2, ISP=2, ICP=[5, 11, 1]" if closed else "IPS=4, ISP=0, ICP=[1, 11], NBC=5, NINT=0"
    (folder / f"c.{EQUATIONS}").write_text(
        f"dat='{EQUATIONS}', NDIM=4, {form}, IRS=0, ILP=0, NTST={mesh}, NCOL=4, IAD=3, ISW=1, IPLT=0\n"
        f"NMX={points}, NPR=0, MXBF=0, IID=0, ITMX=9, ITNW=7, NWTN=3, JAC=1, EPSL=1e-10, EPSU=1e-10, EPSS=1e-10\n"
        "DS=0.001, DSMIN=1e-6, DSMAX=0.001, IADS=0, NPAR=11\n",
        encoding="ascii",
    )
    (folder / "follow.auto").write_text(f"run(e='{EQUATIONS}', c='{EQUATIONS}', sv='{EQUATIONS}')\n", encoding="ascii")
    program = next(found for found in map(shutil.which, auto.PROGRAMS) if found is not None)
    began = processor_of_children()
    done = subprocess.run(
        [program, "follow.auto"], cwd=folder, env={**os.environ, "OMP_NUM_THREADS": "1"}, capture_output=True, text=True, check=False,
        stdin=subprocess.DEVNULL, timeout=auto.SECONDS,
    )  # fmt: skip
    table = folder / f"b.{EQUATIONS}"
    if done.returncode != 0 or not table.exists():
        raise RuntimeError(f"AUTO failed: {auto.last_lines(done.stdout, done.stderr)}")
    used, rows, columns = processor_of_children() - began, [], []
    for line in table.read_text(encoding="utf-8").splitlines():
        words = line.replace("MAX U(", "MAX_U(").split()
        if words[:4] == ["0", "PT", "TY", "LAB"]:
            columns = words
        elif words and words[0] != "0":
            rows.append([float(words[columns.index("PAR(1)")]), float(words[columns.index("PERIOD" if closed else "PAR(11)")])])
    return used, np.array(rows)
